"""Which rows are impacts, and what they are called.

A gap in a rebound column (a cell that says that nothing was measured) is no fault: the rest of its row counts. A row
of which the incident state is not known, or nothing of the rebound, is left out, and a column without a single number
is taken as not there.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fitball.data.columns import REBOUND, SD_SUFFIX
from fitball.data.findings import Findings
from fitball.data.header import Header
from fitball.data.kinematics import Uncertain, independent, velocity
from fitball.data.numbers import NumberColumn
from fitball.data.table import summed_up
from fitball.observables import OBSERVABLES, VELOCITIES

Columns = Mapping[str, NumberColumn]


def without_empty(columns: Columns, found: Findings) -> dict[str, NumberColumn]:
    """The columns that hold at least one number, or something that was meant as one; a notice for each other."""
    empty = [name for name, column in columns.items() if column.missing.size and column.missing.all()]
    for name in empty:
        found.notice(f"column {name} holds no number: taken as not there", name)
    gone = {*empty, *(name + SD_SUFFIX for name in empty)}
    return {name: column for name, column in columns.items() if name not in gone}


def without_gaps(columns: Columns, rebound: bool, least: int, found: Findings) -> dict[str, NumberColumn]:
    """The columns of the impacts that can be used, whose rows alone are left in what was `found`.

    Velocity cells that are missing are taken from speed and angle where their row has both. An impact whose incident
    state, or, with `rebound`, whose whole rebound is missing is left out; where fewer than `least` stay, and where a
    number has no sd although its column states them, that is a fault.
    """
    if not any(column.missing.any() for column in columns.values()):
        return dict(columns)
    told = _with_sds(_filled(_filled(columns, "1", found), "2", found), found)
    rows, before = found.rows, len(found.notices)
    kept = _usable(told, rebound, found)
    if len(kept) < least <= len(rows):
        lost = summed_up(found.notices[before:])
        found.fault(f"{len(kept)} of {len(rows)} rows are left; expected {least}: {'; '.join(lost)}")
        return told
    found.rows = tuple(rows[k] for k in kept)
    left = without_empty({name: column.take(kept) for name, column in told.items()}, found)
    for name, column in left.items():
        if name in REBOUND and column.missing.any():
            gaps = np.flatnonzero(column.missing)
            found.notice(
                f"{name} is missing in {gaps.size} of {len(kept)} rows, first in row {found.rows[gaps[0]].number}: "
                "what else was measured there counts",
                name,
            )
    return left


def _filled(columns: Columns, end: str, found: Findings) -> dict[str, NumberColumn]:
    """Missing velocity components of `end` ("1" or "2") from speed and angle of the same row.

    Only where all four are columns: then components count, and speed and angle repeat them. A component with a stated
    sd is filled where its sd follows too.
    """
    filled = dict(columns)
    components, polar = (f"v_x{end}", f"v_y{end}"), (f"v_{end}", f"theta_{end}")
    if not columns.keys() >= {*components, *polar}:
        return filled
    stated = {
        name: columns[name + SD_SUFFIX].values if name + SD_SUFFIX in columns else np.full(len(found.rows), np.nan)
        for name in polar
    }
    other = velocity({name: Uncertain.measured(name, columns[name].values, stated[name]) for name in polar}, end)
    for name, said in zip(components, (other.x, other.y), strict=True):
        assert said is not None
        sd = columns.get(name + SD_SUFFIX)
        open_cells = columns[name].missing & np.isfinite(said.value)
        if sd is not None:
            open_cells &= np.isfinite(said.sd)
            filled[sd.name] = _put(sd, open_cells, said.sd)
        filled[name] = _put(columns[name], open_cells, said.value)
        kind = f"{name} is missing and taken from {' and '.join(polar)}"
        for k in np.flatnonzero(open_cells).tolist():
            found.notice(kind, name, *polar, place=k, kind=kind)
    return filled


def _put(column: NumberColumn, where: NDArray[np.bool_], values: NDArray[np.float64]) -> NumberColumn:
    return replace(column, values=np.where(where, values, column.values), missing=column.missing & ~where)


def _with_sds(columns: Columns, found: Findings) -> dict[str, NumberColumn]:
    """The columns, no sd where there is no number; a fault for each number without its sd."""
    told = dict(columns)
    for name, column in columns.items():
        sd = columns.get(name + SD_SUFFIX)
        if sd is None:
            continue
        for k in np.flatnonzero(sd.missing & ~column.missing).tolist():
            found.fault(
                f"no standard deviation beside {name} = {column.shown(column.values[k])}; expected one in every row "
                f"that has {name}: give it, or delete the column {sd.name} (then one noise is fitted to {name})",
                sd.name, k,
            )  # fmt: skip
        told[sd.name] = replace(sd, values=np.where(column.missing, np.nan, sd.values))
    return told


def _usable(columns: Columns, rebound: bool, found: Findings) -> NDArray[np.int64]:
    """Places of the rows that are impacts with a known incident state and, with `rebound`, a measured one; a notice
    for each other row.
    """
    nowhere = np.zeros(len(found.rows), dtype=np.bool_)
    incident = [name for name in (*independent(columns, "1"), "omega_1") if name in columns]
    counted = [*independent(columns, "2"), *(name for name in OBSERVABLES if name not in VELOCITIES)]
    after = [columns[name].missing for name in counted if name in columns]
    unknown = np.any([columns[name].missing for name in incident], axis=0) if incident else nowhere
    nothing = np.all(after, axis=0) if rebound and after else nowhere
    for k in np.flatnonzero(unknown | nothing).tolist():
        gaps = [name for name in incident if columns[name].missing[k]]
        what = f"{' and '.join(gaps)} of the incident ball" if gaps else "the rebound"
        kind = f"left out, because {what} was not measured"
        found.notice(kind, *gaps, place=k, kind=kind)
    return np.flatnonzero(~(unknown | nothing))


def unique_ids(header: Header, found: Findings) -> tuple[str, ...]:
    """One name an impact; a notice for each that was empty or stood already."""
    if "id" not in header.texts:
        return tuple(str(row.number) for row in found.rows)
    written = header.cells("id", found.rows)
    taken = set(written)
    ids: list[str] = []
    seen: Counter[str] = Counter()
    for place, text in enumerate(written):
        name, kind = text, ""
        if not text:
            kind = "id is empty: the number of the row is taken"
            name = _free(f"row {found.rows[place].number}", 0, taken)
        elif seen[text]:
            kind = "id names an earlier impact too and was made unique"
            name = _free(text, seen[text], taken)
        if kind:
            found.notice(f"{kind}: '{name}'", "id", place=place, kind=kind)
        seen[text] += 1
        taken.add(name)
        ids.append(name)
    return tuple(ids)


def repeated(name: str, k: int = 2) -> str:
    """The name of the `k`-th impact that is called `name`."""
    return f"{name} ({k})"


def _free(name: str, count: int, taken: set[str]) -> str:
    """`name`, or the first `name (2)`, `name (3)`, ... that is not taken; `count` impacts have the name already."""
    if name not in taken:
        return name
    k = count + 1
    while repeated(name, k) in taken:
        k += 1
    return repeated(name, k)
