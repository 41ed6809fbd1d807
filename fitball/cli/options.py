"""What verbs are made of: a verb is data, and so are its options; those that several verbs share stand here once."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

from fitball.cli.terminal import show
from fitball.errors import ParameterError, suggestion
from fitball.models.specs import DEFAULT_MODEL, RANKED
from fitball.visible import one_line

if TYPE_CHECKING:
    from fitball.api.reading import Fitting


@dataclass(frozen=True)
class Option:
    """An option, or an operand, as argparse has it: its name, a line of help, and what else is told."""

    flag: str
    help: str
    more: Mapping[str, Any] = field(default_factory=dict)


def option(flag: str, metavar: str, help: str, **more: Any) -> Option:
    """An option with a value, or an operand; `more` is what argparse is told besides."""
    return Option(flag, help, {"metavar": metavar, **more})


def switch(flag: str, help: str, **more: Any) -> Option:
    """An option without a value."""
    return Option(flag, help, {"action": "store_true", **more})


Run = Callable[[argparse.Namespace], int]


@dataclass(frozen=True)
class Verb:
    """A verb: a line of help, what it may be asked, what runs it and returns the exit code, and what its help ends
    with. The description is the line of help unless there is more to say. A verb of verbs has `actions`.
    """

    name: str
    help: str
    options: Sequence[Option]
    run: Run
    epilog: str
    description: str = ""
    actions: Sequence[Verb] = ()

    def add(self, subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
        """Make it known to the command line."""
        parser = subparsers.add_parser(
            self.name,
            help=self.help,
            description=self.description or self.help[0].upper() + self.help[1:] + ".",
            epilog=self.epilog,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        for item in self.options:
            parser.add_argument(item.flag, help=item.help, **item.more)
        parser.set_defaults(run=self.run)
        if self.actions:
            inner = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
            for action in self.actions:
                action.add(inner)


def either(names: Sequence[str]) -> str:
    """`a, b or c`."""
    return f"{', '.join(names[:-1])} or {names[-1]}"


def marked(models: Sequence[str]) -> list[str]:
    """Names of models, the default marked."""
    return [f"{name} (default)" if name == DEFAULT_MODEL else name for name in models]


def one_of(kind: str, known: Collection[str], more: str = "") -> Callable[[str], str]:
    """A name among `known`, as the type of an option; `more` is said besides of one that is not. Its function raises
    ParameterError.
    """

    def read(name: str) -> str:
        if name not in known:
            raise ParameterError(f"unknown {kind} '{name}': {suggestion(name, known)}{more}")
        return name

    return read


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


class Pairs(argparse.Action):
    """Gathers NAME=VALUE, given more than once, or `several` at once between commas; divided at the first `=`, or at
    the `last` one. Raises ParameterError for what has not the `form`, for no `number`, for a name said twice.
    """

    def __init__(
        self,
        *,
        convert: Callable[[str], object] = str,
        form: str = "NAME=VALUE",
        number: str = "a number in SI units",
        several: bool = False,
        last: bool = False,
        **more: Any,
    ) -> None:
        super().__init__(**more)
        self.convert, self.form, self.number, self.several, self.last = convert, form, number, several, last

    def __call__(self, _parser: object, namespace: argparse.Namespace, given: Any, flag: str | None = None) -> None:
        """See argparse.Action."""
        values = dict(getattr(namespace, self.dest) or {})
        for text in given.split(",") if self.several else [given]:
            parts = text.rpartition("=") if self.last else text.partition("=")
            name, equals, value = (part.strip() for part in parts)
            if not (name and equals and value):
                raise ParameterError(f"{flag} {text.strip()}: expected {self.form}")
            if name in values:
                raise ParameterError(f"{flag} {text.strip()}: {name} is given twice")
            try:
                values[name] = self.convert(value)
            except ValueError:
                raise ParameterError(f"{flag} {text}: read '{value}', expected {self.number}") from None
        setattr(namespace, self.dest, values)


def pairs(flag: str, metavar: str, help: str, **more: Any) -> Option:
    """An option NAME=VALUE, see `Pairs`."""
    return option(flag, metavar, help, **{"action": Pairs, "default": {}, **more})


def _names(text: str) -> list[str]:
    names = [part.strip() for part in text.split(",")]
    if not all(names):
        raise argparse.ArgumentTypeError(f"read '{text}', expected names of columns separated by commas")
    return names


CORES = option("--cores", "N", "threads (default: all)", type=count, default=os.cpu_count() or 1)
# Where processes need not be those of this machine.
SCHEDULER = option(
    "--scheduler", "ADDRESS",
    "run on the Dask cluster there, e.g. tls://head:8786 or scheduler.json; by tcp:// whoever reaches it can run "
    "programs as you",
)  # fmt: skip
FLIP = option(
    "--flip", "A,B,...",
    "columns that count the other way round, e.g. omega_1,omega_2: spins and velocities of the other sign, angles "
    "measured from the normal (TABLE:COLUMN for one of several tables)",
    type=_names, action="extend", default=[],
)  # fmt: skip
COLUMNS = pairs(
    "--columns", "OURS=THEIRS,...",
    'what columns are called here, e.g. "v_1=Vin, theta_1=angle_in [deg]" (also [columns] in the scene)',
    several=True,
    form="OURS=THEIRS once for each column, separated by commas (write a name with a comma into [columns] of the "
    "scene)",
)  # fmt: skip
AS_READ = switch(
    "--as-read",
    "the table and the scene are right, though another reading explains the table much better or the ball is unlike "
    "any of a game",
)
# How a table is to be read.
READING = (FLIP, COLUMNS, AS_READ)
# Of figures.
FORMATS = ("png", "svg", "pdf")
PICTURE: Mapping[str, Any] = {"default": "png", "type": one_of("format", FORMATS)}
CONFIG = option("--config", "FILE.toml", "scene file (default: the .toml beside DATA)")
SEED = option("--seed", "N", "seed of all random numbers (default 1)", type=whole, default=1)
EXACT = "--exact-incidence", "take the incident state as exact even where its sd is stated"
FULL = switch("--full", "print the whole report, not only its first screen")
FIT = option("fit", "FIT", "a result folder of fitball calibrate, or its fit.json")
# Model, priors, structure of the likelihood, effort.
FITTING = (
    option("--model", "NAME", either(marked(RANKED))),
    pairs("--closure", "NAME=OPTION", "replace a closure, e.g. normal=total", dest="closures"),
    CONFIG,
    pairs("--fix", "NAME=VALUE", "hold a parameter (SI units)", convert=float),
    pairs(
        "--prior", "NAME=DIST(...)",
        'e.g. "mu=normal(0.6, 0.1)", or one from the literature: mu=literature:clay (fitball datasets priors)',
        dest="priors",
    ),
    option("--noise", "KIND", "normal (default), or student-t, which allows outliers"),
    option(
        "--velocity-noise", "KIND",
        "tied (one velocity_sd for all columns of the rebound velocity) or separate (v_x_sd and v_y_sd, or speed_sd "
        "and angle_sd); by default separate where the table has rows enough to tell them apart",
    ),
    pairs(
        "--pool", "NAME=COLUMN",
        "let a parameter differ between surfaces, balls or tables, pooled in part, e.g. mu=surface",
    ),
    option("--offsets", "COLUMN", "fit a bias of each measured column to each group, e.g. group"),
    switch(*EXACT, action="store_false", dest="incident_errors"),
    *READING,
    switch("--point-only", "no posterior: the best values only"),
    SEED,
    option("--max-steps", "N", "steps of each ensemble at most (default 20000)", type=count),
    option("--walkers", "N", "walkers of each ensemble (default 4 per parameter)", type=count),
    CORES,
)  # fmt: skip


def study(folder: Path) -> tuple[Option, ...]:
    """What every study takes: where to write (by default `folder`), cores, how to print."""
    out = option("--out", "DIR", f"where to write (default: {folder})", type=place)
    return out, CORES, switch("--json", "print JSON for other programs"), switch("--quiet", "no progress")


def fitting_of(args: argparse.Namespace) -> Fitting:
    """What was said of how a table is to be read and fitted: each option is called as in Python."""
    from fitball.api.reading import Fitting

    return cast(Fitting, {name: getattr(args, name) for name in Fitting.__annotations__ if hasattr(args, name)})


def tell_notes(notes: Iterable[object]) -> None:
    """What one should know of a result, on stderr, each in a line."""
    for note in notes:
        print(one_line(f"note: {note}"), file=sys.stderr)


class Told(Protocol):
    """What every verb's result can be asked."""

    @property
    def report(self) -> Callable[..., str]:
        """All of it as text."""

    def json(self) -> Mapping[str, object]:
        """All of it for machines."""


def print_result(args: argparse.Namespace, result: Told, brief: object, *where: Path) -> None:
    """A result as JSON, `brief` where the run is quiet, else as text, with the folder that it was saved in."""
    from fitball.report.form.files import json_text

    if args.json:
        print(json_text(result.json()), end="")
    else:
        show(str(brief) if args.quiet else result.report(*where))


def tell_files(args: argparse.Namespace, json_text: str, text: str, places: Iterable[Path]) -> None:
    """A result as JSON, or as text with the files that were written; of a quiet run the files alone."""
    if args.json:
        print(json_text, end="")
        return
    if not args.quiet:
        show(f"{text}\n\nResults:")
    for place in places:
        print(place if args.quiet else f"  {place}")


def stages(quiet: bool) -> Callable[[str], None]:
    """Tells the stages of a study, unless `quiet`."""

    def tell(stage: str) -> None:
        if not quiet:
            print(f"{stage} ...", file=sys.stderr)

    return tell
