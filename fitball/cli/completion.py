"""`fitball completion SHELL`: a script with which a shell completes the command line by argcomplete.

The shell asks `fitball` itself, so that what it offers is what this version knows. Nothing heavy is imported for it.
"""

from __future__ import annotations

import argparse
import os
import sys

from fitball.errors import ParameterError, suggestion

SHELLS = ("bash", "zsh", "fish")
# Set by the script when the shell asks.
ASKED = "_ARGCOMPLETE"
HELP = "a script that completes the command line with Tab (bash, zsh, fish)"
DESCRIPTION = "Print a script with which a shell completes the command line."
EXAMPLE = """examples:
  eval "$(fitball completion bash)"                                        in ~/.bashrc
  eval "$(fitball completion zsh)"                                         in ~/.zshrc, after compinit
  fitball completion fish > ~/.config/fish/completions/fitball.fish

Then Tab completes verbs, options and files."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add what the verb may be asked."""
    parser.add_argument("shell", metavar="SHELL", help=f"{', '.join(SHELLS[:-1])} or {SHELLS[-1]}")


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    if args.shell not in SHELLS:
        raise ParameterError(f"unknown shell '{args.shell}': {suggestion(args.shell, SHELLS)}")
    from argcomplete.shell_integration import shellcode

    print(shellcode(["fitball"], shell=args.shell).strip())
    return 0


def complete(parser: argparse.ArgumentParser) -> None:
    """Answer the shell and leave, if it is the shell that asks; else do nothing."""
    if ASKED not in os.environ:
        return
    import argcomplete

    argcomplete.autocomplete(parser, always_complete_options="long", exit_method=sys.exit)
