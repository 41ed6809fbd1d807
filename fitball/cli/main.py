"""The entry of the command line: its parser, its completion by a shell, which verb, and what its end means.

Exit codes: 0 done; 1 the run finished but its own checks failed; 2 bad input or usage; 130 interrupted. Verbs
import what is heavy inside functions, so that `fitball --help` is quick.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn

from fitball.cli.datasets import DATASETS
from fitball.cli.fitting import BATCH, CALIBRATE, COMPARE, POPULATION, REPEAT
from fitball.cli.options import Verb, either, one_of, option
from fitball.cli.studies import BENCH, REDERIVE, SIMULATE
from fitball.cli.terminal import screen_of, told_of_compiling, visible_streams
from fitball.cli.using import EXPORT, PLAN, PLOT, PREDICT, VERIFY
from fitball.environment import check_environment
from fitball.errors import FitballError, enough_memory, suggestion
from fitball.version import __version__
from fitball.visible import one_line
from fitball.wording import shown_on, speaking_to_command_line

DESCRIPTION = "fitball: what the bounce of a tennis ball says about the ball and the court."
EPILOG = """examples:
  fitball calibrate wang_zero_spin.csv     fit the two-mass ball to a bundled table
  fitball datasets check my_balls.csv      every fault of a table, with row and column
  fitball VERB --help                      what a verb does, with an example"""
SHELLS = ("bash", "zsh", "fish")
# Set by the script when the shell asks.
ASKED = "_ARGCOMPLETE"


class Parser(argparse.ArgumentParser):
    """As argparse's, with mistakes told in the words of fitball, exit code 2.

    Abbreviations are refused: `--over` would be `--overwrite` today and something else after the next version.
    """

    def __init__(self, *positional: Any, **named: Any) -> None:
        super().__init__(*positional, **{"allow_abbrev": False, **named})
        # As argparse has it, but for ranges and units behind the number: `--spin -300:300`.
        self._negative_number_matcher = re.compile(r"^-\.?\d")

    # The signature of argparse is wider than what it ever passes.
    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> tuple[Any, list[str]]:  # type: ignore[override]
        """As argparse's, but a word it does not know is an error of the verb that it stands behind."""
        words = list(sys.argv[1:] if args is None else args)
        self._refuse_unknown(words)
        parsed, rest = super().parse_known_args(words, namespace)
        if rest:
            self._refuse(rest[0])
        return parsed, []

    def error(self, message: str) -> NoReturn:
        """Tell a mistake of the command line, and where to read on."""
        self.exit(2, f"fitball: {one_line(message)}\nsee {self.prog} --help\n")

    def _refuse_unknown(self, words: Sequence[str]) -> None:
        """Name the first unknown option, or verb, before argparse misses what stands behind it."""
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
            self.error(f"read '{word}', one word more than {verb or self.prog} takes")
        name = word.partition("=")[0]
        if not verb:
            self.error(f"unknown option '{name}' before a verb; options of a verb stand behind it")
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
    "completion", "a script that completes the command line with Tab (bash, zsh, fish)",
    (
        option("shell", "SHELL", either(SHELLS), type=one_of("shell", SHELLS)),
    ),
    run_completion,
    """examples:
  eval "$(fitball completion bash)"                                        in ~/.bashrc
  eval "$(fitball completion zsh)"                                         in ~/.zshrc, after compinit
  fitball completion fish > ~/.config/fish/completions/fitball.fish

Then Tab completes verbs, options and files.""",
    description="Print a script with which a shell completes the command line.",
)  # fmt: skip


def complete(parser: argparse.ArgumentParser) -> None:
    """Answer the shell and leave, if it is the shell that asks; else do nothing."""
    if ASKED not in os.environ:
        return
    import argcomplete

    argcomplete.autocomplete(parser, always_complete_options="long", exit_method=sys.exit)


VERBS = (
    CALIBRATE, PLOT, PREDICT, SIMULATE, COMPARE, BATCH, POPULATION, PLAN, EXPORT, VERIFY, REPEAT, DATASETS, REDERIVE,
    BENCH, COMPLETION,
)  # fmt: skip


def make_parser() -> argparse.ArgumentParser:
    """The whole command line."""
    parser: argparse.ArgumentParser = Parser(
        prog="fitball", description=DESCRIPTION, epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--version", action="version", version=f"fitball {__version__}")
    subparsers = parser.add_subparsers(dest="verb", metavar="VERB", title="verbs")
    for verb in VERBS:
        verb.add(subparsers)
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
            # The reader of our output has left; there is nobody to tell.
            return 0
        except OSError as error:
            # What the system refuses (no space, no permission, a name too long) is for the user to mend.
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
        # Whether it was taken is known when it has left.
        sys.stdout.flush()


@contextmanager
def _plain_matplotlib() -> Iterator[None]:
    """Matplotlib in here, and in workers, draws to files and reads no settings, whatever MPLBACKEND and MATPLOTLIBRC
    say: it cannot even be imported when these name no backend, or no text.
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
