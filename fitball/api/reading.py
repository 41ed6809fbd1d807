"""Arguments of the public functions, checked before anything begins: progress, tables, choices; and the check of a
table for faults.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from numbers import Real
from typing import TYPE_CHECKING, Any, TypeAlias, TypedDict, Unpack, cast

from fitball.api.own_model import AnyModel, named_model
from fitball.data.covariance_entries import Given
from fitball.data.force import find_force
from fitball.data.read import check_source, in_memory, load_table
from fitball.data.scene import Scene, likely_scene, load_scene
from fitball.data.table import ImpactTable, Notice
from fitball.data.tables import trusted_table
from fitball.errors import Fault, FitballError, ParameterError, ReadingError, SceneError, TableError, suggestion
from fitball.inference.effort import Effort
from fitball.inference.problem.noise import KINDS
from fitball.inference.problem.observables import SEPARATE, STATED, TIED
from fitball.inference.problem.parameters import FAMILIES
from fitball.inference.problem.pooling import ALL, NOT_POOLED
from fitball.inference.problem.problem import Choices
from fitball.inference.results.results import TARGET_ESS, TARGET_R_HAT
from fitball.inference.sampling.ensembles import Progress
from fitball.kinds import checked, spelled
from fitball.visible import one_line

if TYPE_CHECKING:
    import pandas as pd

# Is called with the stage of a run and, while sampling, with its progress.
Report: TypeAlias = Callable[[str, Progress | None], None]
# True, False, a function, or None: a bar if somebody is looking.
Wanted: TypeAlias = bool | Report | None


def silent(_stage: str, _progress: Progress | None) -> None:
    """Report nothing."""


def somebody_looks_on() -> bool:
    """Whether this is a terminal or a notebook."""
    notebook = "ipykernel" in sys.modules and "IPython" in sys.modules
    return notebook or bool(sys.stderr is not None and sys.stderr.isatty())


@contextmanager
def reporting(wanted: Wanted) -> Iterator[Report]:
    """The function that reports a run; a bar is closed at the end."""
    if callable(wanted):
        yield wanted
    elif not (somebody_looks_on() if wanted is None else wanted):
        yield silent
    else:
        bar = Bar()
        try:
            yield bar
        finally:
            bar.close()


class Bar:
    """A bar of tqdm for terminals and notebooks: the stage, and while sampling the steps up to the next check of
    convergence.
    """

    def __init__(self) -> None:
        with warnings.catch_warnings():
            # In a notebook without widgets tqdm asks for them; it writes text all the same.
            warnings.simplefilter("ignore")
            from tqdm.auto import tqdm

            self.bar: Any = tqdm(total=1, leave=False, bar_format="{desc} {bar} {elapsed}")

    def __call__(self, stage: str, progress: Progress | None) -> None:
        """Show a stage, or a step of the sampler."""
        self.bar.set_description_str(stage if progress is None else sampling_words(progress), refresh=False)
        self.bar.total = 1 if progress is None else max(progress.next_check, progress.step)
        self.bar.n = 0 if progress is None else progress.step
        self.bar.refresh()

    def close(self) -> None:
        """Remove the bar."""
        self.bar.close()


def sampling_words(progress: Progress) -> str:
    """How far the sampler is."""
    words, found = f"sampling: step {progress.step}", progress.convergence
    if found is None:
        return words
    return (
        f"{words}, smallest effective sample size {found.min_ess:.0f} (target {TARGET_ESS:.0f}), "
        f"largest R-hat {found.max_r_hat:.3f} (target below {TARGET_R_HAT})"
    )


PathLike = str | os.PathLike[str]
# A table: read already, a path or bundled name, a data frame, or columns by name.
Table: TypeAlias = "ImpactTable | PathLike | pd.DataFrame | Mapping[str, Sequence[Any]]"


class Reading(TypedDict, total=False):
    """How a table is read, see `calibrate`; for Python and for the command line."""

    config: PathLike | None
    units: Mapping[str, str] | None
    flip: str | Sequence[str]
    columns: Mapping[str, str] | None
    ignore: str | Sequence[str]
    covariance: Given | None
    as_read: bool


class Fitting(Reading, total=False):
    """How a table is read and fitted, see `calibrate`: choices and effort too."""

    closures: Mapping[str, str] | None
    priors: Mapping[str, str] | None
    fix: Mapping[str, float] | None
    noise: str | Sequence[str] | None
    pool: Mapping[str, str] | str | None
    offsets: str | None
    incident_errors: bool
    velocity_noise: str | None
    seed: int
    point_only: bool
    walkers: int | None
    max_steps: int | None


# An option that is not given is None, or:
DEFAULTS: Mapping[str, Any] = {
    "flip": (), "ignore": (), "as_read": False, "incident_errors": True, "seed": 1, "point_only": False,
}  # fmt: skip
# A mapping as it is written.
EXAMPLES = {
    "closures": "{'cor': 'saturating'}",
    "priors": "{'mu': 'normal(0.55, 0.05)'}",
    "fix": "{'eps_slope': 0.0}",
    "pool": "{'mu': 'surface'}",
}


def reading_of(asked: Mapping[str, Any]) -> Reading:
    """The options that say how a table is read."""
    return cast(Reading, {name: asked[name] for name in Reading.__annotations__ if name in asked})


def choices_of(model: AnyModel | None, asked: Fitting) -> Choices:
    """The choices among the options. Raises ParameterError for values of a wrong type, with an example of a right
    one, and as `_noise_of` does.
    """
    given: dict[str, Any] = {item.name: asked.get(item.name) for item in fields(Choices) if item.name != "model"}
    given |= _noise_of(asked.get("noise"), asked.get("velocity_noise"))
    if isinstance(given["pool"], str) and given["pool"] == NOT_POOLED:
        given["pool"] = {ALL: NOT_POOLED}
    for option in EXAMPLES:
        value = given[option]
        if not isinstance(value, Mapping | None):
            raise ParameterError(f"{option}: read {value!r}, expected a dict, such as {EXAMPLES[option]}")
        for name, item in (value or {}).items():
            _check_item(option, name, item)
    return Choices(
        None if model is None else named_model(model),
        **{name: value for name, value in given.items() if value is not None},
    )


def _noise_of(noise: str | Sequence[str] | None, structure: str | None) -> dict[str, str | None]:
    """Distribution and structure of the noise from names such as "student-t,separate"; `structure` is that of the
    older `velocity_noise`. Raises ParameterError for an unknown name and for two that exclude each other.
    """
    names = [
        name.strip() for text in ([noise] if isinstance(noise, str) else noise or ()) for name in text.split(",")
    ]
    names += [] if structure is None else [structure]
    found: dict[str, str | None] = {"noise": None, "velocity_noise": None}
    for name in names:
        if name not in (known := (*KINDS, TIED, SEPARATE, STATED)):
            raise ParameterError(f"unknown noise '{name}': {suggestion(name, known)}")
        choice = "noise" if name in KINDS else "velocity_noise"
        if found[choice] not in (None, name):
            raise ParameterError(f"noise: {found[choice]} and {name} exclude each other; choose one")
        found[choice] = name
    if structure is not None:
        warnings.warn(f"velocity_noise={structure!r} is now noise={structure!r}", FutureWarning, stacklevel=5)
    return found


def effort_of(asked: Fitting, cores: int) -> Effort:
    """The effort among the options, with this many threads."""
    given = {name: asked.get(name) for name in ("seed", "point_only", "walkers", "max_steps")}
    return Effort(cores=cores, **{name: value for name, value in given.items() if value is not None})  # type: ignore[arg-type]


def read(
    data: Table | Sequence[Table], scene: Scene | None = None, **reading: Unpack[Reading]
) -> tuple[ImpactTable, Scene, tuple[str, ...], tuple[str, ...]]:
    """A table, or one joined of several, with its scene, notes, and the files it was read from.

    The scene is `scene`, or the file `config`, or the TOML file beside the first table. Raises as reading and
    `trusted_table` do.
    """
    sources, files = sources_of(data)
    config, as_read = reading.get("config"), reading.get("as_read", False)
    if scene is None:
        known = load_scene(files[0] if files else None, config, as_read)
    else:
        known = likely_scene(scene, as_read)
    flipped, ignored = listed(reading.get("flip", ())), listed(reading.get("ignore", ()))
    table, doubts = trusted_table(
        sources, known, flipped, as_read, reading.get("columns"), reading.get("units"), ignored,
        reading.get("covariance"),
    )  # fmt: skip
    if len(sources) > 1 and scene is None and known.source is not None:
        doubts = (*doubts, f"the scene of {config or (files[0] if files else 'no file')} is used for all tables")
    return table, known, doubts, files


def sources_of(data: Any) -> tuple[list[Any], tuple[str, ...]]:
    """The tables one by one, and the files they are read from."""
    alone = isinstance(data, ImpactTable | str | os.PathLike) or in_memory(data)
    sources = list(data) if not alone and isinstance(data, Sequence) else [data]
    if not sources:
        raise ParameterError("the list of tables is empty; expected at least one")
    files = []
    for source in sources:
        if isinstance(source, ImpactTable):
            files += [place for place, _digest in source.files]
        elif not in_memory(source):
            check_source(source)
            files.append(os.fspath(source))
    return sources, tuple(files)


def listed(columns: str | Sequence[str]) -> tuple[str, ...]:
    """Names of columns; a single one needs no list."""
    return (columns,) if isinstance(columns, str) else tuple(columns)


def _check_item(option: str, name: object, value: object) -> None:
    if option == "fix":
        if type(value) is bool or not isinstance(value, Real):
            raise ParameterError(f"fix: {name} = {value!r}: expected a number in SI units, such as {EXAMPLES['fix']}")
    elif not isinstance(value, str):
        more = ""
        if option == "priors":
            more = f"{_pair_words(name, value)}; forms: {', '.join(family.form for family in FAMILIES.values())}"
        raise ParameterError(f"{option}: {name} = {value!r}: expected a text, such as {EXAMPLES[option]}{more}")


def _pair_words(name: object, value: object) -> str:
    """The two meanings that a pair of numbers may have: mean and sd, or two bounds."""
    if not (isinstance(value, Sequence) and len(value) == 2 and all(isinstance(item, Real) for item in value)):
        return ""
    a, b = value
    spread, ends = f"'normal({a:g}, {b:g})'", f"'uniform({min(a, b):g}, {max(a, b):g})'"
    return f"; write {{{name!r}: {spread}}} if these are mean and sd, {{{name!r}: {ends}}} if they are bounds"


@dataclass(frozen=True, repr=False)
class Checked:
    """Result of `check`: `errors` that prevent a fit, `notices`, and the `table` if it could be read. It is true if
    there is no error.
    """

    source: str
    errors: tuple[FitballError, ...]
    notices: tuple[Notice, ...]
    table: ImpactTable | None

    @property
    def ok(self) -> bool:
        """Whether the table can be fitted."""
        return not self.errors

    def __bool__(self) -> bool:
        return self.ok

    @property
    def faults(self) -> list[dict[str, Any]]:
        """Every fault with its file, row, line and column, as far as it has them."""
        return [fault for error in self.errors for fault in _faults(error)]

    def to_frame(self) -> pd.DataFrame:
        """The faults, one row each."""
        import pandas as pd

        return pd.DataFrame(self.faults, columns=["file", "row", "line", "column", "message"])

    def __repr__(self) -> str:
        lines = [str(error) for error in self.errors]
        if self.table is not None:
            lines.append(f"{self.table.source}: {len(self.table)} impacts{', no faults found' if self.ok else ''}")
            remarks = (*self.table.remarks, *(str(item) for item in self.notices[len(self.table.notices) :]))
            lines += [one_line(f"  - {remark}") for remark in remarks]
        return "\n".join(lines)


@checked
@spelled(Reading, DEFAULTS)
def check(
    data: Table, *, scene: Scene | None = None, force: PathLike | None = None, **reading: Unpack[Reading]
) -> Checked:
    """Find every fault of a table, its scene and its force records, as the verb `datasets check` does.

    For the arguments see `calibrate`; several tables are checked one by one. Faults of the table are not raised, but
    returned.

    >>> fitball.check({"v_y1": [4.0, 6.0], "v_y2": [3.2, -4.7]}).ok
    False
    """
    errors: list[FitballError] = []
    table: ImpactTable | None = None
    extra: tuple[str, ...] = ()
    sources, files = sources_of(data)
    if len(sources) > 1:
        raise ParameterError(f"read a list of {len(sources)} tables, expected one; check them one by one")
    known, as_read = scene, reading.get("as_read", False)
    try:
        if known is None:
            try:
                known = load_scene(files[0] if files else None, reading.get("config"), as_read)
            except SceneError as error:
                # The table is still checked, with tennis balls assumed.
                errors.append(error)
        source = sources[0]
        table = source if isinstance(source, ImpactTable) else load_table(
            source, scene=known or Scene(), flip=listed(reading.get("flip", ())), columns=reading.get("columns"),
            units=reading.get("units"), ignore=listed(reading.get("ignore", ())),
            covariance=reading.get("covariance"),
        )  # fmt: skip
        if known is not None:
            extra = trusted_table([table], known, as_read=as_read)[1]
            records, found = find_force(files, table, known, None if force is None else os.fspath(force))
            extra += found
            extra += () if records is None else (f"{records.source}: {len(records.records)} force records",)
    except FitballError as error:
        errors.append(error)
    notices = (*(table.notices if table is not None else ()), *(Notice(text) for text in extra))
    return Checked(files[0] if files else "DataFrame", tuple(errors), notices, table)


def _faults(error: FitballError) -> list[dict[str, Any]]:
    if isinstance(error, TableError):
        faults = [*error.faults, *(Fault(f"possible meaning: {hint}") for hint in error.hints)]
    else:
        faults = [Fault(text) for text in (error.readings if isinstance(error, ReadingError) else [str(error)])]
    return [{"file": getattr(error, "source", None), **asdict(fault)} for fault in faults]
