"""The entry of the command line: the parser, completion by a shell, and exit codes.

Exit codes: 0 done; 1 the run finished but its own checks failed; 2 bad input or usage; 130 interrupted. Verbs
import heavy packages inside functions, so that `fitball --help` is quick.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn

from fitball.cli.datasets import DATASETS
from fitball.cli.filming import TRACK
from fitball.cli.fitting import BATCH, CALIBRATE, COMPARE, POPULATION, REPEAT
from fitball.cli.options import Help, Verb, either, one_of, option
from fitball.cli.studies import BENCH, REDERIVE, SIMULATE
from fitball.cli.terminal import screen_of, told_of_compiling, visible_streams
from fitball.cli.using import CITE, EXPORT, PLAN, PLOT, PREDICT, VERIFY
from fitball.environment import check_environment
from fitball.errors import FitballError, enough_memory, suggestion
from fitball.version import __version__
from fitball.visible import one_line
from fitball.wording import shown_on, speaking_to_command_line

DESCRIPTION = (
    "Fit a model of a bouncing tennis ball to measured impacts: friction, stiffness and restitution, with their "
    "uncertainty."
)
EPILOG = """examples:
  fitball calibrate wang_zero_spin.csv    fit a model to a bundled table
  fitball datasets check my_balls.csv     find every fault of a table
  fitball VERB --help                     options and examples of a verb"""
SHELLS = ("bash", "zsh", "fish")
# Set by the script when the shell asks.
ASKED = "_ARGCOMPLETE"


class Parser(argparse.ArgumentParser):
    """As argparse's, but with fitball's messages for mistakes, and exit code 2. `renamed` has old names of options,
    which are still accepted, with the new ones.

    Abbreviations are refused: `--over` would be `--overwrite` today and something else after the next version.
    """

    def __init__(self, *positional: Any, **named: Any) -> None:
        super().__init__(*positional, **{"allow_abbrev": False, **named})
        self.renamed: Mapping[str, str] = {}
        # As argparse has it, but for ranges and units behind the number: `--spin -300:300`.
        self._negative_number_matcher = re.compile(r"^-\.?\d")

    # The signature of argparse is wider than what it ever passes.
    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> tuple[Any, list[str]]:  # type: ignore[override]
        """As argparse's, but an unknown word is an error of the verb before it."""
        words = self._with_new_names(sys.argv[1:] if args is None else args)
        self._refuse_unknown(words)
        parsed, rest = super().parse_known_args(words, namespace)
        if rest:
            self._refuse(rest[0])
        return parsed, []

    def error(self, message: str) -> NoReturn:
        """Print a mistake of the command line, and where the help is."""
        self.exit(2, f"fitball: {one_line(message)}\nsee {self.prog} --help\n")

    def _with_new_names(self, words: Sequence[str]) -> list[str]:
        """The words with new names for old ones, each with a note."""
        options = list(words[: words.index("--")] if "--" in words else words)
        for place, word in enumerate(options):
            old, equals, value = word.partition("=")
            if old in self.renamed:
                options[place] = self.renamed[old] + equals + value
                if "--quiet" not in words:
                    print(f"note: {old} is now {self.renamed[old]}", file=sys.stderr)
        return [*options, *words[len(options) :]]

    def _refuse_unknown(self, words: Sequence[str]) -> None:
        """Name the first unknown option, or verb, before argparse reports a missing operand instead."""
        verbs = next((a for a in self._actions if isinstance(a, argparse._SubParsersAction)), None)
        for word in words:
            if word == "--":
                return
            if verbs is not None and not word.startswith("-"):
                if word not in verbs.choices:
                    kind = str(verbs.metavar).lower()
                    self.error(f"unknown {kind} '{word}': {suggestion(word, verbs.choices)}")
                return
            if word.startswith("--") and word.partition("=")[0] not in self._option_string_actions:
                self._refuse(word)

    def _refuse(self, word: str) -> NoReturn:
        verb = self.prog.partition(" ")[2]
        if not word.startswith("-") or word == "-":
            self.error(f"unexpected argument '{word}': {verb or self.prog} takes none here")
        name = word.partition("=")[0]
        if not verb:
            self.error(f"unknown option '{name}' before a verb; write options of a verb after the verb")
        options = [option for option in self._option_string_actions if option.startswith("--")]
        begun = [option for option in options if option.startswith(name)]
        hint = f"did you mean {' or '.join(map(repr, begun))}?" if begun else suggestion(name, options)
        self.error(f"unknown option '{name}' of {verb}: {hint}")


def run_completion(args: argparse.Namespace) -> int:
    """Print the script."""
    from argcomplete.shell_integration import shellcode

    print(shellcode(["fitball"], shell=args.shell).strip())
    return 0


COMPLETION = Verb(
    "completion", "print a script for completion with Tab (bash, zsh, fish)",
    (
        option("shell", "SHELL", either(SHELLS), type=one_of("shell", SHELLS)),
    ),
    run_completion,
    """in ~/.bashrc:
  eval "$(fitball completion bash)"

in ~/.zshrc, after compinit:
  eval "$(fitball completion zsh)"

for fish:
  fitball completion fish > ~/.config/fish/completions/fitball.fish

Tab then completes verbs, options and files.""",
    description="Print a script that lets a shell complete verbs, options and files.",
)  # fmt: skip


def complete(parser: argparse.ArgumentParser) -> None:
    """Print completions and exit when the shell asks for them; else do nothing."""
    if ASKED not in os.environ:
        return
    import argcomplete

    argcomplete.autocomplete(parser, always_complete_options="long", exit_method=sys.exit)


VERBS = (
    CALIBRATE, COMPARE, PREDICT, PLAN, PLOT, SIMULATE, TRACK, BATCH, POPULATION, EXPORT, VERIFY, CITE, REPEAT,
    DATASETS, COMPLETION, REDERIVE, BENCH,
)  # fmt: skip


def make_parser() -> argparse.ArgumentParser:
    """The whole command line."""
    parser: argparse.ArgumentParser = Parser(
        prog="fitball", description=DESCRIPTION, epilog=EPILOG, formatter_class=Help, add_help=False
    )
    subparsers = parser.add_subparsers(dest="verb", metavar="VERB", title="verbs")
    for verb in VERBS:
        verb.add(subparsers)
    parser.add_argument("-h", "--help", action="help", help="print this help")
    parser.add_argument("--version", action="version", version=f"fitball {__version__}", help="print the version")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code."""
    with visible_streams(), speaking_to_command_line(), _plain_matplotlib():
        try:
            return _run(list(sys.argv[1:] if argv is None else argv))
        except FitballError as error:
            print("\n".join(map(one_line, f"fitball: {error}".split("\n"))), file=sys.stderr)
            return 2
        except BrokenPipeError:
            # The reader of our output has left, and with it whoever could read a message.
            return 0
        except OSError as error:
            # No space, no permission, a name too long: a fault that the user can mend.
            where = "" if error.filename is None else f"{error.filename}: "
            print(one_line(f"fitball: {where}cannot be used: {error.strerror or error}"), file=sys.stderr)
            return 2
        except KeyboardInterrupt:
            print("fitball: interrupted", file=sys.stderr)
            return 130


def _run(words: list[str]) -> int:
    try:
        parser = make_parser()
        complete(parser)
        args = parser.parse_args(words)
        args.command = shlex.join(["fitball", *words])
        if args.verb is None:
            parser.print_help()
            return 2
        check_environment()
        with enough_memory(), told_of_compiling(args), shown_on(screen_of(args)):
            return int(args.run(args))
    finally:
        # A fault of writing shows only now.
        sys.stdout.flush()


@contextmanager
def _plain_matplotlib() -> Iterator[None]:
    """Let matplotlib, here and in workers, draw to files and read no settings: with a wrong MPLBACKEND or
    MATPLOTLIBRC it cannot even be imported.
    """
    plain = {"MPLBACKEND": "agg", "MATPLOTLIBRC": os.devnull}
    before = {name: os.environ.pop(name, None) for name in plain}
    os.environ.update(plain)
    try:
        yield
    finally:
        for name, value in before.items():
            del os.environ[name]
            if value is not None:
                os.environ[name] = value
