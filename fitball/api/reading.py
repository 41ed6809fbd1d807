"""What a caller hands over, looked at before anything begins, since no type checker may have seen it: tables and
choices; and whether a table is fit to be fitted.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from numbers import Real
from typing import TYPE_CHECKING, Any, TypeAlias, TypedDict, TypeVar

from fitball.data.force import find_force
from fitball.data.read import check_source, in_memory, load_table, trusted_table
from fitball.data.scene import Scene, likely_scene, load_scene
from fitball.data.table import ImpactTable, Notice
from fitball.errors import Fault, FitballError, ParameterError, ReadingError, SceneError, TableError
from fitball.inference.problem.parameters import FAMILIES
from fitball.inference.problem.problem import Choices
from fitball.kinds import checked
from fitball.visible import one_line

if TYPE_CHECKING:
    import pandas as pd

T = TypeVar("T")
PathLike = str | os.PathLike[str]
# A table: read already, a path or bundled name, a data frame, or columns by name.
Table: TypeAlias = "ImpactTable | PathLike | pd.DataFrame | Mapping[str, Sequence[Any]]"


class Reading(TypedDict, total=False):
    """How a table is to be read: the arguments of `read` beside the table."""

    scene: Scene | None
    config: PathLike | None
    flip: str | Sequence[str]
    columns: Mapping[str, str] | None
    as_read: bool
    units: Mapping[str, str] | None


def read(
    data: Table | Sequence[Table],
    *,
    scene: Scene | None = None,
    config: PathLike | None = None,
    flip: str | Sequence[str] = (),
    columns: Mapping[str, str] | None = None,
    as_read: bool = False,
    units: Mapping[str, str] | None = None,
) -> tuple[ImpactTable, Scene, tuple[str, ...], tuple[str, ...]]:
    """A table, or one joined of several, with its scene, what is to be said of it, and the files it was read from.

    The scene is `scene`, or the file `config`, or the TOML file beside the first table. Raises as reading and
    `trusted_table` do.
    """
    sources, files = sources_of(data)
    if scene is None:
        known = load_scene(files[0] if files else None, config, as_read)
    else:
        known = likely_scene(scene, as_read)
    table, doubts = trusted_table(sources, known, flips(flip), as_read, columns, units)
    if len(sources) > 1 and scene is None and known.source is not None:
        doubts = (*doubts, f"the scene of {config or (files[0] if files else 'no file')} is taken for all tables")
    return table, known, doubts, files


def sources_of(data: Any) -> tuple[list[Any], tuple[str, ...]]:
    """The tables that were handed over, one by one, and the files they were or are read from."""
    alone = isinstance(data, ImpactTable | str | os.PathLike) or in_memory(data)
    sources = list(data) if not alone and isinstance(data, Sequence) else [data]
    if not sources:
        raise ParameterError("read an empty list of tables, expected at least one")
    files = []
    for source in sources:
        if isinstance(source, ImpactTable):
            files += [place for place, _digest in source.files]
        elif not in_memory(source):
            check_source(source)
            files.append(os.fspath(source))
    return sources, tuple(files)


def flips(flip: str | Sequence[str]) -> tuple[str, ...]:
    """Columns to flip; one may be named without a list."""
    return (flip,) if isinstance(flip, str) else tuple(flip)


def given(options: Mapping[str, T] | None) -> Mapping[str, T]:
    """What was said by name, nothing for None; what is no mapping stays for `checked_choices`."""
    return {} if options is None else options


def checked_choices(choices: Choices) -> None:
    """Raise ParameterError for choices of a type that cannot be meant, and say how they are written."""
    for field in fields(choices):
        value = getattr(choices, field.name)
        if field.name in ("closures", "priors", "fix", "pool"):
            if not isinstance(value, Mapping):
                raise ParameterError(f"{field.name}: read {value!r}, expected a dict, such as {EXAMPLES[field.name]}")
            for name, item in value.items():
                _check_item(field.name, name, item)


EXAMPLES = {
    "closures": "{'cor': 'saturating'}",
    "priors": "{'mu': 'normal(0.55, 0.05)'}",
    "fix": "{'eps_slope': 0.0}",
    "pool": "{'mu': 'surface'}",
}


def _check_item(option: str, name: object, value: object) -> None:
    if option == "fix":
        if type(value) is bool or not isinstance(value, Real):
            raise ParameterError(f"fix: {name} = {value!r}: expected a number in SI units, such as {EXAMPLES['fix']}")
    elif not isinstance(value, str):
        more = ""
        if option == "priors":
            more = f"{_pair_words(name, value)}; forms: {', '.join(form for form, *_ in FAMILIES.values())}"
        raise ParameterError(f"{option}: {name} = {value!r}: expected a text, such as {EXAMPLES[option]}{more}")


def _pair_words(name: object, value: object) -> str:
    """What a pair of numbers may have been meant as: mean and sd or two bounds, which nobody can tell."""
    if not (isinstance(value, Sequence) and len(value) == 2 and all(isinstance(item, Real) for item in value)):
        return ""
    a, b = value
    spread, ends = f"'normal({a:g}, {b:g})'", f"'uniform({min(a, b):g}, {max(a, b):g})'"
    return f"; if these are mean and sd, write {{{name!r}: {spread}}}; if they are bounds, {{{name!r}: {ends}}}"


@dataclass(frozen=True, repr=False)
class Checked:
    """What a look at a table found: `errors` for which it would be refused, `notices`, and the `table` if it could be
    read. It counts as true where there is no error.
    """

    source: str
    errors: tuple[FitballError, ...]
    notices: tuple[Notice, ...]
    table: ImpactTable | None

    @property
    def ok(self) -> bool:
        """Whether the table would be taken."""
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
            lines.append(f"{self.table.source}: {len(self.table)} impacts{', no fault' if self.ok else ''}")
            told = (*self.table.remarks, *(str(item) for item in self.notices[len(self.table.notices) :]))
            lines += [one_line(f"  - {remark}") for remark in told]
        return "\n".join(lines)


@checked
def check(
    data: Table,
    *,
    scene: Scene | None = None,
    config: PathLike | None = None,
    force: PathLike | None = None,
    units: Mapping[str, str] | None = None,
    flip: str | Sequence[str] = (),
    columns: Mapping[str, str] | None = None,
    as_read: bool = False,
) -> Checked:
    """Look for every fault of a table, its scene and its force records, as the verb `datasets check` does.

    For what is handed over, one table, see `calibrate`. Raises nothing that is a fault of the table.

    >>> fitball.check({"v_y1": [4.0, 6.0], "v_y2": [3.2, -4.7]}).ok
    False
    """
    errors: list[FitballError] = []
    table: ImpactTable | None = None
    extra: tuple[str, ...] = ()
    sources, files = sources_of(data)
    if len(sources) > 1:
        raise ParameterError(f"read a list of {len(sources)} tables, expected one: check each by itself")
    known = scene
    try:
        if known is None:
            try:
                known = load_scene(files[0] if files else None, config, as_read)
            except SceneError as error:
                # The table is still looked at, as one of tennis balls.
                errors.append(error)
        source = sources[0]
        table = source if isinstance(source, ImpactTable) else load_table(
            source, scene=known or Scene(), flip=flips(flip), columns=columns, units=units
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
        faults = [*error.faults, *(Fault(f"what may be meant: {hint}") for hint in error.hints)]
    else:
        faults = [Fault(text) for text in (error.readings if isinstance(error, ReadingError) else [str(error)])]
    return [{"file": getattr(error, "source", None), **asdict(fault)} for fault in faults]
