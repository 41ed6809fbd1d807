"""Verbs and options as data: what argparse is given for each, and the options that several verbs share."""

from __future__ import annotations

import argparse
import os
import re
import sys
import textwrap
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
    """An option, or an operand, as argparse has it: its name, a line of help, the other arguments of `add_argument`,
    and its `old` name, which is still accepted.
    """

    flag: str
    help: str
    more: Mapping[str, Any] = field(default_factory=dict)
    old: str = ""


@dataclass(frozen=True)
class Group:
    """Options under a title of their own in the help of a verb."""

    title: str
    options: Sequence[Option]


def option(flag: str, metavar: str, help: str, old: str = "", **more: Any) -> Option:
    """An option with a value, or an operand; `more` are further arguments of `add_argument`."""
    return Option(flag, help, {"metavar": metavar, **more}, old)


def switch(flag: str, help: str, **more: Any) -> Option:
    """An option without a value."""
    return Option(flag, help, {"action": "store_true", **more})


Run = Callable[[argparse.Namespace], int]


class Help(argparse.HelpFormatter):
    """Wraps paragraphs, and lists of names with words, to the width of the terminal; examples stay lines."""

    def add_argument(self, action: argparse.Action) -> None:
        """See argparse, which forgets that names of verbs are indented."""
        super().add_argument(action)
        if isinstance(action, argparse._SubParsersAction):
            self._action_max_length += self._indent_increment

    def _fill_text(self, text: str, width: int, indent: str) -> str:  # noqa: ARG002
        lines: list[str] = []
        for line in text.split("\n"):
            if lines and line[:1].strip() and lines[-1][:1].strip():
                lines[-1] += f" {line}"
            else:
                lines.append(line)
        return "\n".join(self._wrapped(line, width) for line in lines)

    def _wrapped(self, line: str, width: int) -> str:
        named = re.match(r"  \S.*?  +", line)
        if line.startswith(" ") and named is None:
            return line
        head = "" if named is None else named[0]
        return textwrap.fill(
            line[len(head) :], width, initial_indent=head, subsequent_indent=" " * len(head), break_on_hyphens=False
        )


@dataclass(frozen=True)
class Verb:
    """A verb: a line of help, its options, the function that runs it and returns the exit code, and the end of its
    help. Without a `description` the line of help is used. A verb of verbs has `actions`.
    """

    name: str
    help: str
    options: Sequence[Option | Group]
    run: Run
    epilog: str
    description: str = ""
    actions: Sequence[Verb] = ()

    def add(self, subparsers: argparse._SubParsersAction[Any]) -> None:
        """Add it to the command line."""
        listed = [part for group in self.options for part in (group.options if isinstance(group, Group) else [group])]
        operands = [_operand(part) for part in listed if not part.flag.startswith("-")]
        required = [f"{part.flag} {part.more['metavar']}" for part in listed if part.more.get("required")]
        parser = subparsers.add_parser(
            self.name,
            help=self.help,
            usage=None if self.actions else " ".join(["%(prog)s", *required, "[options]", *operands]),
            description=self.description or self.help[0].upper() + self.help[1:] + ".",
            epilog=self.epilog,
            formatter_class=Help,
            add_help=False,
        )
        parser._positionals.title = "arguments"
        target: argparse._ActionsContainer = parser
        for group in self.options:
            target = parser.add_argument_group(group.title) if isinstance(group, Group) else parser
            for part in group.options if isinstance(group, Group) else [group]:
                target.add_argument(part.flag, help=part.help, **part.more)
        target.add_argument("-h", "--help", action="help", help="print this help")
        parser.renamed = {part.old: part.flag for part in listed if part.old}
        parser.set_defaults(run=self.run)
        if self.actions:
            inner = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
            for action in self.actions:
                action.add(inner)


def _operand(part: Option) -> str:
    """An operand in the line of usage."""
    name = str(part.more["metavar"])
    return {"?": f"[{name}]", "+": f"{name} [{name} ...]"}.get(part.more.get("nargs", ""), name)


def either(names: Sequence[str]) -> str:
    """`a, b or c`."""
    return f"{', '.join(names[:-1])} or {names[-1]}"


def marked(models: Sequence[str]) -> list[str]:
    """Names of models, the default marked."""
    return [f"{name} (default)" if name == DEFAULT_MODEL else name for name in models]


def one_of(kind: str, known: Collection[str], more: str = "") -> Callable[[str], str]:
    """A name among `known`, as the type of an option; the message for any other name ends with `more`. The function
    raises ParameterError.
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
    """A file or folder to write, as the type of an option; an empty text is refused."""
    if not text.strip() or "\0" in text:
        raise argparse.ArgumentTypeError(f"read {text!r}, expected the name of a file or folder")
    return text


def file_place(text: str) -> str:
    """The same of what is always a file."""
    is_folder = text.endswith(("/", os.sep))
    with suppress(OSError):
        # A place that cannot be examined is reported where it is written.
        is_folder = is_folder or Path(place(text)).is_dir()
    if is_folder:
        raise argparse.ArgumentTypeError(f"read '{text}', which is a folder; expected a file")
    return text


def count(text: str) -> int:
    """A whole number of at least one, as the type of an option."""
    with suppress(ValueError):
        if int(text) >= 1:
            return int(text)
    raise argparse.ArgumentTypeError(f"read '{text}', expected a whole number, 1 or more")


class Pairs(argparse.Action):
    """Gathers NAME=VALUE from a repeated option, or `several` separated by commas; split at the first `=`, or at the
    `last` one. A word of `alone` stands for what it maps to. Raises ParameterError for another form than `form`, for
    a value that is not a `number`, and for a name that is given twice.
    """

    def __init__(
        self,
        *,
        convert: Callable[[str], object] = str,
        form: str = "NAME=VALUE",
        number: str = "a number in SI units",
        several: bool = False,
        last: bool = False,
        alone: Mapping[str, str] | None = None,
        **more: Any,
    ) -> None:
        super().__init__(**more)
        self.convert, self.form, self.number, self.several, self.last = convert, form, number, several, last
        self.alone = alone or {}

    def __call__(self, _parser: object, namespace: argparse.Namespace, given: Any, flag: str | None = None) -> None:
        """See argparse.Action."""
        values = dict(getattr(namespace, self.dest) or {})
        for word in given.split(",") if self.several else [given]:
            text = self.alone.get(word.strip(), word)
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
        raise argparse.ArgumentTypeError(f"read '{text}', expected names separated by commas")
    return names


CORES = option("--cores", "N", "number of threads (default: all)", type=count, default=os.cpu_count() or 1)
# Where processes may run on other machines.
SCHEDULER = option(
    "--scheduler", "ADDRESS",
    "run on the Dask cluster at this address, e.g. tls://head:8786 or scheduler.json. With tcp://, anyone who can "
    "connect to it can run programs as you",
)  # fmt: skip
FLIP = option(
    "--flip", "A,B,...",
    "columns with the opposite convention, e.g. omega_1,omega_2: the sign of spins and velocities is reversed, "
    "angles are taken from the normal. TABLE:COLUMN for one of several tables",
    type=_names, action="extend", default=[],
)  # fmt: skip
COLUMNS = pairs(
    "--columns", "OURS=THEIRS,...",
    'names of the columns in this file, e.g. "v_1=Vin, theta_1=angle_in [deg]" (or [columns] in the scene)',
    several=True,
    form="OURS=THEIRS once for each column, separated by commas (a name with a comma goes into [columns] of the "
    "scene)",
)  # fmt: skip
AS_READ = switch(
    "--as-read",
    "accept table and scene as they are, even if another reading fits much better or the ball is unlike any game "
    "ball",
)
IGNORE = option(
    "--ignore", "A,B,...",
    "measured columns of the rebound to leave out, e.g. contact_time,omega_2. TABLE:COLUMN for one of several tables",
    type=_names, action="extend", default=[],
)  # fmt: skip
COVARIANCE = option(
    "--covariance", "FILE",
    "errors that belong together, with columns id, column, column, value; none to ignore them (default: "
    "<table>_covariance.csv beside DATA)",
)  # fmt: skip
# How a table is read.
READING = (FLIP, COLUMNS, IGNORE, COVARIANCE, AS_READ)
# Of figures.
FORMATS = ("png", "svg", "pdf")
PICTURE = option(
    "--format", "FORMAT", "format of figures: png, svg or pdf (default: png)", default="png",
    type=one_of("format", FORMATS),
)  # fmt: skip
SCENE = option(
    "--scene", "FILE.toml", "what is known about ball, court and measurement (default: the .toml file beside DATA)",
    old="--config", dest="config",
)  # fmt: skip
FORCE = option(
    "--force-records", "FILE",
    "force-time records with columns id, t, F; none to ignore them (default: <table>_force.csv beside DATA)",
    old="--force", dest="force",
)  # fmt: skip
SEED = option("--seed", "N", "seed of all random numbers (default: 1)", type=whole, default=1)
FULL = switch("--full", "print the whole report (default: its first screen)")
EXACT = "--exact-incidence", "treat the incident state as exact, even if its sd is given"
LEVEL = pairs(
    "--level", "COLUMN=LABEL",
    "the surface, ball or place, if parameters of the fit differ between them, e.g. surface=clay; new for one of "
    "which nothing was measured (repeatable)",
    dest="levels",
)  # fmt: skip
FIT = option("fit", "FIT", "a result folder of fitball calibrate, or its fit.json")
OWN = option("--model", "FILE:NAME", "the Python function of a fit of your own model, as in mymodel.py:rebound")
OVERWRITE = switch("--overwrite", "replace an older result in the folder")
MODEL = Group("model and priors", (
    option("--model", "NAME", f"{either(marked(RANKED))}; or a Python function, as in mymodel.py:rebound"),
    pairs("--closure", "NAME=OPTION", "change a model assumption, e.g. normal=total (repeatable)", dest="closures"),
    pairs("--fix", "NAME=VALUE", "hold a parameter at a value in SI units (repeatable)", convert=float),
    pairs(
        "--prior", "NAME=DIST(...)",
        'prior of a parameter, e.g. "mu=normal(0.6, 0.1)", or a published one, e.g. mu=literature:clay; '
        "list: fitball datasets priors (repeatable)",
        dest="priors",
    ),
    pairs(
        "--pool", "NAME=COLUMN",
        "fit a parameter to each surface, ball, place or table that a column names, with partial pooling, e.g. "
        "mu=group; none: one value for all (repeatable; default: mu and cor_10 to each surface, mu to each place, "
        "cor_10 and the offset to each ball, where the table names several with five rows each, or three of a place)",
        alone={"none": "all=none"}, form="NAME=COLUMN, or none",
    ),
))  # fmt: skip
NOISE = Group("noise", (
    option(
        "--noise", "A,B",
        "normal or student-t (allows for outliers; default: normal), and tied or separate: one noise for all columns "
        "of the rebound velocity, or one for each column (default: separate if the table has enough rows); where the "
        "table states sds it is what measurements scatter by beyond these, and stated: not at all",
        old="--velocity-noise", type=_names, action="extend",
    ),
    option("--offsets", "COLUMN", "estimate a measurement bias for each group that a column names, e.g. group"),
    switch(*EXACT, action="store_false", dest="incident_errors"),
))  # fmt: skip
SAMPLING = Group("sampling", (
    switch("--point-only", "compute best-fit values only, without the posterior"),
    SEED,
    option("--max-steps", "N", "maximum number of steps of each ensemble (default: 20000)", type=count),
    option("--walkers", "N", "number of walkers in each ensemble (default: 4 per parameter)", type=count),
    CORES,
))  # fmt: skip


def study(folder: Path) -> tuple[Option, ...]:
    """Options of every study: where to write (by default `folder`), cores, how to print."""
    out = option("--out", "DIR", f"result folder (default: {folder})", type=place)
    return out, CORES, switch("--json", "print JSON for other programs"), switch("--quiet", "no progress")


def fitting_of(args: argparse.Namespace) -> Fitting:
    """The options that say how a table is read and fitted, by their names in Python."""
    from fitball.api.reading import Fitting

    return cast(Fitting, {name: getattr(args, name) for name in Fitting.__annotations__ if hasattr(args, name)})


# Lines of notes before a fit; the report has all of them.
MOST_NOTES = 3


def print_notes(notes: Sequence[object], full: bool = True) -> None:
    """Notes, on stderr, one line each; unless `full`, the first ones of many and how many more there are."""
    first = notes if full or len(notes) <= MOST_NOTES else notes[: MOST_NOTES - 1]
    for note in first:
        print(one_line(f"note: {note}"), file=sys.stderr)
    if len(first) < len(notes):
        print(f"note: ... and {len(notes) - len(first):,} more: --full", file=sys.stderr)


class Result(Protocol):
    """What the results of all verbs have in common."""

    @property
    def report(self) -> Callable[..., str]:
        """The whole result as text."""

    def json(self) -> Mapping[str, object]:
        """The whole result for other programs."""


def print_result(args: argparse.Namespace, result: Result, brief: object, *where: Path) -> None:
    """A result as JSON, `brief` where the run is quiet, else as text, with the folder that it was saved in."""
    from fitball.report.form.files import json_text

    if args.json:
        print(json_text(result.json()), end="")
    else:
        show(str(brief) if args.quiet else result.report(*where))


def print_files(args: argparse.Namespace, json_text: str, text: str, places: Iterable[Path]) -> None:
    """A result as JSON, or as text with the files that were written; with `--quiet` the files alone."""
    if args.json:
        print(json_text, end="")
        return
    if not args.quiet:
        show(f"{text}\n\nResults:")
    for place in places:
        print(place if args.quiet else f"  {place}")


def stages(quiet: bool) -> Callable[[str], None]:
    """Prints the stages of a study, unless `quiet`."""

    def print_stage(stage: str) -> None:
        if not quiet:
            print(f"{stage} ...", file=sys.stderr)

    return print_stage
