"""Covariances as they are written: a file with columns id, column, column, value, beside the table or named, or a
mapping or an array in Python; each as entries for a row and two columns of the table.
"""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from numbers import Real
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fitball.data.bundled import COVARIANCE_ENDING, PARQUET_SUFFIXES, resolve_table
from fitball.data.cells import Findings, RawTable, Rows, Texts, Vocabulary, printed_number
from fitball.data.columns import HEIGHTS, MEASURED, SD_SUFFIX
from fitball.data.header import Naming, bare, our_column, split_cell
from fitball.data.numbers import plain_numbers, read_column
from fitball.data.text import read_raw
from fitball.data.units import Dimension, Unit, unit_of
from fitball.errors import ParameterError, TableError, suggestion
from fitball.visible import some, unguarded

# A path, `{id: {(column, column): value}}`, or an array (rows, columns, columns).
Given: TypeAlias = str | os.PathLike[str] | Mapping[str, Mapping[tuple[str, str], float]] | ArrayLike
LEFT_OUT = "none"
IN_PYTHON = "covariance"
EXPECTED = "expected columns id, column, column and value, such as 'id,column,column,value'"
# What else people call these columns, and what a program makes of two columns of one name.
_NAMES: Mapping[str, str] = {
    **dict.fromkeys(("id", "impact", "impactid", "no", "nr", "#"), "id"),
    **dict.fromkeys(("column", "column1", "columna", "col1"), "first"),
    **dict.fromkeys(("column2", "columnb", "col2"), "second"),
    **dict.fromkeys(("value", "covariance", "cov"), "value"),
}
# The largest number, which a whole number of Python may exceed.
MOST = sys.float_info.max
# Values are products of numbers of any two columns.
_PRODUCT = Unit("", Dimension.SPEED, 1.0)


@dataclass(frozen=True)
class Layout:
    """The table that covariances are of: its `source`, its `columns` (fitball's names) in the order of the header,
    their `units`, those of them that are `ignored`, and how columns are named there. `ids` are those of its impacts.
    Of each row that was read `names` are the ids as they are written, and `places` those among the impacts, None for
    rows that were left out.
    """

    source: str
    columns: tuple[str, ...]
    units: Mapping[str, Unit]
    ignored: frozenset[str]
    naming: Naming
    ids: tuple[str, ...]
    names: tuple[str, ...]
    places: tuple[int | None, ...]

    @property
    def gone(self) -> frozenset[str]:
        """Ids of rows that were left out."""
        return frozenset(name for name, place in zip(self.names, self.places, strict=True) if place is None)

    @property
    def ambiguous(self) -> frozenset[str]:
        """Ids of several rows."""
        return frozenset(name for name, count in Counter(self.names).items() if count > 1)


@dataclass(frozen=True)
class Entry:
    """A covariance of the impact at `row` between the columns at `one` and `other` of the layout, in their units;
    `half` is half a unit of its last printed digit, `place` its row in the file, None in Python.
    """

    row: int
    one: int
    other: int
    value: float
    half: float = 0.0
    place: int | None = None


@dataclass(frozen=True)
class Written:
    """Covariances as entries: `source` in words, the `place` of the file ("" in Python), the SHA-256 of its content,
    and what was found in it.
    """

    source: str
    place: str
    digest: str
    entries: list[Entry]
    found: Findings
    notes: list[str] = field(default_factory=list)

    def fault(self, message: str, layout: Layout, entry: Entry) -> None:
        """Add a fault of an entry."""
        one, other = layout.columns[entry.one], layout.columns[entry.other]
        named = f"'{layout.ids[entry.row]}', {one}" + (f" and {other}" if one != other else "")
        self.found.fault(f"{named}: {message}", None if entry.place is None else "value", entry.place)


def beside(source: object, name: str) -> Path | None:
    """The file of covariances beside the table called `name`, None where there is none."""
    if not isinstance(source, str | os.PathLike):
        return None
    try:
        table = resolve_table(source)
    except TableError:
        return None
    places = [table.with_name(name + COVARIANCE_ENDING + suffix) for suffix in (".csv", *PARQUET_SUFFIXES)]
    return next((place for place in places if os.path.lexists(place)), None)


def read_entries(given: Given, layout: Layout) -> Written:
    """The covariances that are given for a table. Raises TableError for a file that cannot be taken apart,
    ParameterError for what is neither a path nor a mapping nor an array of numbers.
    """
    if isinstance(given, str | os.PathLike):
        return _of_file(Path(given), layout)
    if isinstance(given, Mapping):
        return _of_mapping(given, layout)
    return _of_array(given, layout)


def _of_file(path: Path, layout: Layout) -> Written:
    raw = read_raw(path, Vocabulary(lambda cell: float(_named(cell) is not None), lambda _text: False))
    found = Findings.from_raw(raw)
    found.notices.clear()
    places = _header(raw, found)
    written = Written(str(path), str(path.resolve()), sha256(raw.data).hexdigest(), [], found, list(raw.notes))
    if len(found.faults) > len(raw.faults):
        return written
    if not raw.rows:
        found.header_fault("no rows after the header; expected variances and covariances of the impacts")
    cells, notes = plain_numbers({"value": raw.columns[places["value"]]})
    written.notes.extend(notes)
    values = read_column("value", _PRODUCT, cells["value"], found).values
    rows = _rows(unguarded(raw.columns[places["id"]]), layout, found)
    first, second = (unguarded(raw.columns[places[name]]) for name in ("first", "second"))
    ends = _columns(first, layout, found), _columns(second, layout, found, but=first)
    for place, (row, one, other, value) in enumerate(zip(rows, *ends, values.tolist(), strict=True)):
        if row is None or one is None or other is None or value != value:
            continue
        number = printed_number(cells["value"][place])
        half = 0.0 if number is None else number[1]
        written.entries.append(Entry(row, one, other, value, half, place))
    return written


def _named(cell: str) -> str | None:
    """Which column of the file a header cell names."""
    plain = bare(split_cell(cell)[0])
    return _NAMES.get(plain)


def _header(raw: RawTable, found: Findings) -> dict[str, int]:
    """Places of the four columns; a fault for each that is missing, or comes too often, and for a unit."""
    places = dict[str, int]()
    for index, cell in enumerate(raw.header):
        named = _named(cell)
        if named == "first" and named in places and bare(cell) in ("column", "column1"):
            named = "second"
        if named is None:
            continue
        if named in places:
            found.header_fault("two columns have this meaning; keep one", cell)
            continue
        places[named] = index
        unit = split_cell(cell)[1]
        if unit is not None:
            found.header_fault(
                f"states the unit '[{unit}]'; expected none: each value has the product of the units of its two "
                "columns, as in the header of the table",
                cell,
            )
    for name, words in {"id": "id", "first": "column", "second": "the second column", "value": "value"}.items():
        if name not in places:
            what = f"column '{words}'" if name != "second" else "a second column named 'column' (or 'column_2')"
            found.header_fault(f"{what} is missing; {EXPECTED}; columns read: {some(raw.header)}")
    return places


def _rows(names: Texts, layout: Layout, found: Findings) -> list[int | None]:
    """The place of each named impact, None with a fault for one that is not in the table."""
    said = _lookup(layout)
    known: dict[str, int | str | None] = {}
    rows: list[int | None] = []
    for place, name in enumerate(names):
        if name not in known:
            known[name] = said(name)
        row = known[name]
        if isinstance(row, str):
            found.fault(row, "id", place)
        rows.append(None if isinstance(row, str) else row)
    return rows


def _lookup(layout: Layout) -> Callable[[str], int | str | None]:
    """What an id means: the place of an impact, None for a row that was left out, or a text that says what is wrong
    with it.
    """
    places = {name: k for k, name in enumerate(layout.ids)}
    ambiguous, gone = layout.ambiguous, layout.gone

    def row(name: str) -> int | str | None:
        if name in ambiguous:
            return f"read '{name}', which names several impacts of {layout.source}; expected one impact for each id"
        if name in places:
            return places[name]
        if name in gone:
            return None
        count = len(layout.ids)
        hint = suggestion(name, layout.ids) if count <= 40 or name else f"it has {count} impacts"
        return f"read '{name}', which is not an impact of {layout.source}; {hint}"

    return row


def _columns(cells: Texts, layout: Layout, found: Findings, but: Texts = ()) -> list[int | None]:
    """The place of each named column, None with a fault for one that the table has not got, None alone for one that
    is ignored. Faults of a cell that is the same in `but` are there already.
    """
    known: dict[str, int | str | None] = {}
    places: list[int | None] = []
    for place, cell in enumerate(cells):
        if cell not in known:
            known[cell] = _column(cell, layout)
        index = known[cell]
        if isinstance(index, str) and not (but and but[place] == cell):
            found.fault(index, "column", place)
        places.append(None if isinstance(index, str) else index)
    return places


def _column(cell: str, layout: Layout) -> int | str | None:
    ours, name, unit = our_column(cell, layout.naming)
    if ours in layout.ignored:
        return None
    having = ", ".join(layout.columns)
    if ours in layout.columns:
        assert ours is not None
        own = layout.units[ours]
        if unit is not None and unit_of(unit) != own:
            return (
                f"read '{cell}', but {ours} is in {own.symbol} in {layout.source}; expected its name without a unit"
            )
        return layout.columns.index(ours)
    if ours is not None and ours.removesuffix(SD_SUFFIX) in layout.columns:
        base = ours.removesuffix(SD_SUFFIX)
        return f"read '{cell}', a standard deviation; expected '{base}': its variance is the entry ({base}, {base})"
    if ours in HEIGHTS:
        return f"read '{cell}'; speeds are computed from heights: state its error as {ours}_sd in {layout.source}"
    if ours in MEASURED:
        return f"read '{cell}', but {layout.source} has no such column with numbers; it has {having}"
    return f"read '{name}', which is not a column of {layout.source}: {suggestion(name, layout.columns)}"


def _of_mapping(given: Mapping[Any, Any], layout: Layout) -> Written:
    found = Findings(Rows((), ()), None)
    digest = sha256(
        repr([(key, list(value.items())) for key, value in given.items() if isinstance(value, Mapping)]).encode(
            "utf-8", "backslashreplace"
        )
    )
    written = Written(IN_PYTHON, "", digest.hexdigest(), [], found)
    said = _lookup(layout)
    for name, pairs in given.items():
        row = said(str(name))
        if isinstance(row, str):
            found.fault(row)
            continue
        if not isinstance(pairs, Mapping):
            raise ParameterError(
                f"covariance: '{name}': read {type(pairs).__name__}, expected {{(column, column): value}}"
            )
        for pair, value in pairs.items():
            if not (isinstance(pair, tuple) and len(pair) == 2 and all(isinstance(item, str) for item in pair)):
                raise ParameterError(f"covariance: '{name}': read the key {pair!r}, expected (column, column)")
            if isinstance(value, bool) or not isinstance(value, Real) or not abs(value) <= MOST:  # type: ignore[operator]
                found.fault(f"'{name}', {pair[0]} and {pair[1]}: read {value!r}; expected a finite number")
                continue
            places = [_column(item, layout) for item in pair]
            for item in dict.fromkeys(places):
                if isinstance(item, str):
                    found.fault(f"'{name}': {item}")
            one, other = places
            if row is not None and isinstance(one, int) and isinstance(other, int):
                written.entries.append(Entry(row, one, other, float(value)))
    return written


def _of_array(given: Any, layout: Layout) -> Written:
    try:
        values = np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ParameterError(
            f"covariance: read {type(given).__name__}, expected a path, {{id: {{(column, column): value}}}}, or an "
            "array of numbers (rows, columns, columns)"
        ) from None
    having = tuple(layout.columns)
    wanted = (len(layout.names), len(having), len(having))
    if values.shape != wanted:
        raise ParameterError(
            f"covariance: read an array of shape {values.shape}, expected {wanted}: the rows of {layout.source}, and "
            f"its columns in this order: {', '.join(having)}"
        )
    found = Findings(Rows((), ()), None)
    written = Written(IN_PYTHON, "", sha256(np.ascontiguousarray(values).tobytes()).hexdigest(), [], found)
    infinite = np.argwhere(np.isinf(values))
    for k, i, j in infinite[:1].tolist():
        found.fault(
            f"'{layout.names[k]}', {having[i]} and {having[j]}: read {values[k, i, j]}; expected a finite number"
        )
    stated = np.isfinite(values) & (values != 0.0)
    kept = [k for k, name in enumerate(having) if name not in layout.ignored]
    for k, i, j in np.argwhere(stated).tolist():
        row = layout.places[k]
        if row is not None and i in kept and j in kept:
            written.entries.append(Entry(row, i, j, float(values[k, i, j])))
    return written
