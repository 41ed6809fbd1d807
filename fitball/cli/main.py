"""The entry of the command line: which verb, and what its end means.

Exit codes: 0 done; 1 the run finished but its own checks failed; 2 bad input or usage; 130 interrupted. Verb modules
import what is heavy inside functions, so that `fitball --help` is quick.
"""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from fitball.cli import (
    batch,
    bench,
    calibrate,
    compare,
    completion,
    datasets,
    export,
    plan,
    plot,
    population,
    predict,
    rederive,
    repeat,
    simulate,
    verify,
)
from fitball.cli.options import add_verb
from fitball.cli.parser import Parser
from fitball.cli.progress import told_of_compiling
from fitball.cli.visible_stream import visible_streams
from fitball.environment import check_environment
from fitball.errors import FitballError, enough_memory
from fitball.version import __version__
from fitball.visible import one_line
from fitball.wording import speaking_to_command_line

DESCRIPTION = "fitball: what the bounce of a tennis ball says about the ball and the court."
EPILOG = """examples:
  fitball calibrate wang_zero_spin.csv     fit the two-mass ball to a bundled table
  fitball datasets check my_balls.csv      every fault of a table, with row and column
  fitball VERB --help                      what a verb does, with an example"""


# Each says what it is (HELP, EXAMPLE, and DESCRIPTION where that is more), what it may be asked, and how it runs.
VERBS = (
    calibrate, plot, predict, simulate, compare, batch, population, plan, export, verify, repeat, datasets, rederive,
    bench, completion,
)  # fmt: skip


def make_parser() -> argparse.ArgumentParser:
    """The whole command line."""
    parser: argparse.ArgumentParser = Parser(
        prog="fitball", description=DESCRIPTION, epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--version", action="version", version=f"fitball {__version__}")
    subparsers = parser.add_subparsers(dest="verb", metavar="VERB", title="verbs")
    for verb in VERBS:
        name = verb.__name__.rpartition(".")[2]
        verb.add_options(
            add_verb(subparsers, name, verb.run, verb.HELP, verb.EXAMPLE, getattr(verb, "DESCRIPTION", None))
        )
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
        completion.complete(parser)
        args = parser.parse_args(words)
        args.command = shlex.join(["fitball", *words])
        if args.verb is None:
            parser.print_help()
            return 2
        check_environment()
        with enough_memory(), told_of_compiling(args):
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
