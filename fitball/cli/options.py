"""Options that several verbs share."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from fitball.errors import ParameterError
from fitball.models.names import DEFAULT_MODEL
from fitball.visible import one_line

if TYPE_CHECKING:
    from fitball.api.calibrating import Reading

T = TypeVar("T")


def either(names: Sequence[str]) -> str:
    """`a, b or c`."""
    return f"{', '.join(names[:-1])} or {names[-1]}"


def marked(models: Sequence[str]) -> list[str]:
    """Names of models, the default marked."""
    return [f"{name} (default)" if name == DEFAULT_MODEL else name for name in models]


def whole(text: str) -> int:
    """A whole number, as the type of an option."""
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"read '{text}', expected a whole number") from None


def place(text: str) -> str:
    """A file or folder to write, as the type of an option; an empty text is rather a slip than a place."""
    if not text.strip() or "\0" in text:
        raise argparse.ArgumentTypeError(f"read {text!r}, expected the name of a file or folder")
    return text


def file_place(text: str) -> str:
    """The same of what is always a file."""
    is_folder = text.endswith(("/", os.sep))
    with suppress(OSError):
        # What the system refuses to look at is told where it is to be written.
        is_folder = is_folder or Path(place(text)).is_dir()
    if is_folder:
        raise argparse.ArgumentTypeError(f"read '{text}', a folder; name a file in it")
    return text


def count(text: str) -> int:
    """A whole number of at least one, as the type of an option."""
    with suppress(ValueError):
        if int(text) >= 1:
            return int(text)
    raise argparse.ArgumentTypeError(f"read '{text}', expected a whole number, 1 or more")


def pairs(
    option: str,
    given: Iterable[str],
    convert: Callable[[str], T],
    form: str = "NAME=VALUE",
    number: str = "a number in SI units",
    last: bool = False,
) -> dict[str, T]:
    """Read options NAME=VALUE given more than once, divided at the first `=`, or at the `last` one. Raises
    ParameterError for what has not the `form`, for no `number`, for a name said twice.
    """
    values: dict[str, T] = {}
    for text in given:
        name, equals, value = (part.strip() for part in (text.rpartition("=") if last else text.partition("=")))
        if not (name and equals and value):
            raise ParameterError(f"{option} {text}: expected {form}")
        if name in values:
            raise ParameterError(f"{option} {text}: {name} is given twice")
        try:
            values[name] = convert(value)
        except ValueError:
            raise ParameterError(f"{option} {text}: read '{value}', expected {number}") from None
    return values


def add_verb(
    subparsers: argparse._SubParsersAction[argparse.ArgumentParser],
    name: str,
    run: Callable[[argparse.Namespace], int],
    help: str,
    epilog: str,
    description: str | None = None,
) -> argparse.ArgumentParser:
    """Add a verb whose work is `run`, which returns the exit code; without a `description` it is the help."""
    parser = subparsers.add_parser(
        name,
        help=help,
        description=description or help[0].upper() + help[1:] + ".",
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run)
    return parser


def add_cores(parser: argparse.ArgumentParser) -> None:
    """Add `--cores`; without it all the machine has."""
    parser.add_argument(
        "--cores", type=count, metavar="N", default=os.cpu_count() or 1, help="threads (default: all)"
    )


def add_scheduler(parser: argparse.ArgumentParser) -> None:
    """Add `--scheduler`, where processes need not be those of this machine."""
    parser.add_argument(
        "--scheduler", metavar="ADDRESS",
        help="run on the Dask cluster there, e.g. tls://head:8786 or scheduler.json; by tcp:// whoever "
        "reaches it can run programs as you",
    )  # fmt: skip


def add_structure(parser: argparse.ArgumentParser) -> None:
    """Add what a likelihood may have beyond independent normal noise."""
    parser.add_argument("--noise", metavar="KIND", help="normal (default), or student-t, which allows outliers")
    parser.add_argument(
        "--velocity-noise", metavar="KIND",
        help="tied (one velocity_sd for all columns of the rebound velocity) or separate (v_x_sd and v_y_sd, or "
        "speed_sd and angle_sd); by default separate where the table has rows enough to tell them apart",
    )  # fmt: skip
    parser.add_argument(
        "--pool", metavar="NAME=COLUMN", action="append", default=[],
        help="let a parameter differ between surfaces, balls or tables, pooled in part, e.g. mu=surface",
    )  # fmt: skip
    parser.add_argument(
        "--offsets", metavar="COLUMN", help="fit a bias of each measured column to each group, e.g. group"
    )
    parser.add_argument(
        "--exact-incidence", action="store_true", help="take the incident state as exact even where its sd is stated"
    )


def add_flip(parser: argparse.ArgumentParser) -> None:
    """Add `--flip`."""
    parser.add_argument(
        "--flip", metavar="A,B,...", type=_names, action="extend", default=[],
        help="columns that count the other way round, e.g. omega_1,omega_2: spins and velocities of the other sign, "
        "angles measured from the normal (TABLE:COLUMN for one of several tables)",
    )  # fmt: skip


def add_columns(parser: argparse.ArgumentParser) -> None:
    """Add `--columns`."""
    parser.add_argument(
        "--columns", metavar="OURS=THEIRS,...", type=_naming, action=_Naming, default={},
        help='what columns are called here, e.g. "v_1=Vin, theta_1=angle_in [deg]" (also [columns] in the scene)',
    )  # fmt: skip


class _Naming(argparse.Action):
    """Gathers `--columns` given more than once."""

    def __call__(
        self, _parser: object, namespace: argparse.Namespace, values: object, _option: object = None
    ) -> None:
        """See argparse.Action."""
        assert isinstance(values, dict)
        setattr(namespace, self.dest, {**getattr(namespace, self.dest), **values})


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Add what says how a table is to be read."""
    add_flip(parser)
    add_columns(parser)
    parser.add_argument(
        "--as-read", action="store_true",
        help="the table and the scene are right, though another reading explains the table much better or the ball "
        "is unlike any of a game",
    )  # fmt: skip


def reading_of(args: argparse.Namespace) -> Reading:
    """What was said of how a table is to be read, by `--config` and those of `add_reading`."""
    return {"config": args.config, "flip": args.flip, "columns": args.columns, "as_read": args.as_read}


def _names(text: str) -> list[str]:
    names = [part.strip() for part in text.split(",")]
    if not all(names):
        raise argparse.ArgumentTypeError(f"read '{text}', expected names of columns separated by commas")
    return names


def _naming(text: str) -> dict[str, str]:
    names: dict[str, str] = {}
    for part in text.split(","):
        ours, equals, theirs = (word.strip() for word in part.partition("="))
        if not equals or not ours or not theirs or ours in names:
            raise argparse.ArgumentTypeError(
                f"read '{part.strip()}', expected OURS=THEIRS once for each column, separated by commas (write a "
                "name with a comma into [columns] of the scene)"
            )
        names[ours] = theirs
    return names


def add_study(parser: argparse.ArgumentParser, folder: Path) -> None:
    """Add what every study takes: where to write (by default `folder`), cores, how to print."""
    parser.add_argument("--out", type=place, metavar="DIR", help=f"where to write (default: {folder})")
    add_cores(parser)
    parser.add_argument("--json", action="store_true", help="print JSON for other programs")
    parser.add_argument("--quiet", action="store_true", help="no progress")


def tell_notes(notes: Iterable[object]) -> None:
    """What one should know of a result, on stderr, each in a line."""
    for note in notes:
        print(one_line(f"note: {note}"), file=sys.stderr)


def tell_files(args: argparse.Namespace, json_text: str, text: str, places: Iterable[Path]) -> None:
    """A result as JSON, or as text with the files that were written; of a quiet run the files alone."""
    if args.json:
        print(json_text, end="")
        return
    if not args.quiet:
        print(f"{text}\n\nResults:")
    for place in places:
        print(place if args.quiet else f"  {place}")


def stages(quiet: bool) -> Callable[[str], None]:
    """Tells the stages of a study, unless `quiet`."""

    def tell(stage: str) -> None:
        if not quiet:
            print(f"{stage} ...", file=sys.stderr)

    return tell
