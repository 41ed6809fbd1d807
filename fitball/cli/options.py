"""What verbs are made of: a verb is data, and so are its options; those that several verbs share stand here once."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from fitball.errors import ParameterError
from fitball.models.specs import DEFAULT_MODEL, RANKED
from fitball.visible import one_line

if TYPE_CHECKING:
    from fitball.api.reading import Reading
    from fitball.inference.effort import Effort
    from fitball.inference.problem.problem import Choices

T = TypeVar("T")


@dataclass(frozen=True)
class Option:
    """An option, or an operand, as argparse has it: its name, a line of help, and what else is told."""

    flag: str
    help: str
    more: Mapping[str, Any] = field(default_factory=dict)


def option(flag: str, metavar: str, help: str, **more: Any) -> Option:
    """An option with a value, or an operand; `more` is what argparse is told besides."""
    return Option(flag, help, {"metavar": metavar, **more})


def switch(flag: str, help: str) -> Option:
    """An option without a value."""
    return Option(flag, help, {"action": "store_true"})


@dataclass(frozen=True)
class Verb:
    """A verb: a line of help, what it may be asked, what runs it and returns the exit code, and what its help ends
    with. The description is the line of help unless there is more to say. A verb of verbs has `actions`.
    """

    name: str
    help: str
    options: Sequence[Option]
    run: Callable[[argparse.Namespace], int]
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


class _Naming(argparse.Action):
    """Gathers `--columns` given more than once."""

    def __call__(
        self, _parser: object, namespace: argparse.Namespace, values: object, _option: object = None
    ) -> None:
        """See argparse.Action."""
        assert isinstance(values, dict)
        setattr(namespace, self.dest, {**getattr(namespace, self.dest), **values})


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
COLUMNS = option(
    "--columns", "OURS=THEIRS,...",
    'what columns are called here, e.g. "v_1=Vin, theta_1=angle_in [deg]" (also [columns] in the scene)',
    type=_naming, action=_Naming, default={},
)  # fmt: skip
AS_READ = switch(
    "--as-read",
    "the table and the scene are right, though another reading explains the table much better or the ball is unlike "
    "any of a game",
)
# How a table is to be read.
READING = (FLIP, COLUMNS, AS_READ)
CONFIG = option("--config", "FILE.toml", "scene file (default: the .toml beside DATA)")
SEED = option("--seed", "N", "seed of all random numbers (default 1)", type=whole, default=1)
# Model, priors, structure of the likelihood, effort.
FITTING = (
    option("--model", "NAME", either(marked(RANKED))),
    option("--closure", "NAME=OPTION", "replace a closure, e.g. normal=total", action="append", default=[]),
    CONFIG,
    option("--fix", "NAME=VALUE", "hold a parameter (SI units)", action="append", default=[]),
    option(
        "--prior", "NAME=DIST(...)",
        'e.g. "mu=normal(0.6, 0.1)", or one from the literature: mu=literature:clay (fitball datasets priors)',
        action="append", default=[],
    ),
    option("--noise", "KIND", "normal (default), or student-t, which allows outliers"),
    option(
        "--velocity-noise", "KIND",
        "tied (one velocity_sd for all columns of the rebound velocity) or separate (v_x_sd and v_y_sd, or speed_sd "
        "and angle_sd); by default separate where the table has rows enough to tell them apart",
    ),
    option(
        "--pool", "NAME=COLUMN",
        "let a parameter differ between surfaces, balls or tables, pooled in part, e.g. mu=surface",
        action="append", default=[],
    ),
    option("--offsets", "COLUMN", "fit a bias of each measured column to each group, e.g. group"),
    switch("--exact-incidence", "take the incident state as exact even where its sd is stated"),
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


def reading_of(args: argparse.Namespace) -> Reading:
    """What was said of how a table is to be read, by `--config` and those of `add_reading`."""
    return {"config": args.config, "flip": args.flip, "columns": args.columns, "as_read": args.as_read}


def choices_of(args: argparse.Namespace) -> Choices:
    """The choices that the options ask for. Raises ParameterError."""
    from fitball.inference.problem.problem import Choices

    return Choices(
        model=args.model,
        closures=pairs("--closure", args.closure, str),
        priors=pairs("--prior", args.prior, str),
        fix=pairs("--fix", args.fix, float),
        noise=args.noise,
        pool=pairs("--pool", args.pool, str),
        offsets=args.offsets,
        incident_errors=not args.exact_incidence,
        velocity_noise=args.velocity_noise,
    )


def make_effort(args: argparse.Namespace, cores: int) -> Effort:
    """The effort the options ask for, with so many threads."""
    from fitball.inference.effort import MAX_STEPS, Effort

    return Effort(
        seed=args.seed,
        point_only=args.point_only,
        walkers=args.walkers,
        max_steps=MAX_STEPS if args.max_steps is None else args.max_steps,
        cores=cores,
    )


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
