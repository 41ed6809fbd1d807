"""Columns that say the same thing in other words: which of them count, and whether they agree."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from fitball.data.dialect.cells import RawRow
from fitball.data.number_column import NumberColumn
from fitball.data.table import Notice
from fitball.errors import Fault
from fitball.values import FloatArray

# Beyond the rounding of the printed digits, columns may differ by this fraction (of the speed; in
# radians for angles) without a word. Tables print means of repeated throws, and the mean of speeds exceeds
# the speed of the mean velocity by half the squared relative scatter across it: 0.5 % stands for a
# scatter of 10 %. Wang's tables stay below 0.25 % and 0.06 degrees except in the two rows that
# are at odds by 1.1 % and by 0.4 and 0.7 degrees.
AVERAGING = 0.005
# No averaging or misprint of a late digit explains this much: a unit or a column is wrong.
GROSS = 0.2


@dataclass(frozen=True)
class _Expected:
    """What other columns say of one column: `values`, the `rounding` half-width they carry, the `scale` of a
    relative difference (all (impacts,), SI), and which columns they are.
    """

    values: FloatArray
    rounding: FloatArray
    scale: FloatArray
    basis: tuple[str, str]


def independent(names: Iterable[str], end: str) -> tuple[str, ...]:
    """The velocity columns of one `end` ("1" or "2") that count: at most two, components before polar.

    With one component and both polar columns the polar pair counts: it always determines the
    velocity, while a component and the angle or the speed need not.
    """
    present = set(names)
    components = [f"v_x{end}", f"v_y{end}"]
    polar = [f"v_{end}", f"theta_{end}"]
    for pair in (components, polar):
        if present.issuperset(pair):
            return tuple(pair)
    return tuple(name for name in components + polar if name in present)


def check_redundant(
    columns: Mapping[str, NumberColumn],
    end: str,
    rows: tuple[RawRow, ...],
    faults: list[Fault],
    notices: list[Notice],
) -> None:
    """Compare every velocity column that does not count with those that do, row by row.

    A difference beyond rounding and averaging becomes a Notice, a gross one a Fault.
    """
    counted = independent(columns, end)
    for name in (f"v_x{end}", f"v_y{end}", f"v_{end}", f"theta_{end}"):
        if name in columns and name not in counted:
            expected = (
                _from_components(columns, end, name)
                if counted[0].startswith("v_x")
                else _from_polar(columns, end, name)
            )
            _compare(columns[name], expected, rows, faults, notices)


def _from_components(columns: Mapping[str, NumberColumn], end: str, name: str) -> _Expected:
    x, y = columns[f"v_x{end}"], columns[f"v_y{end}"]
    speed = np.hypot(x.values, y.values)
    basis = (x.name, y.name)
    with np.errstate(divide="ignore", invalid="ignore"):
        if name.startswith("theta"):
            rounding = (np.abs(y.values) * x.half_width + np.abs(x.values) * y.half_width) / speed**2
            return _Expected(np.arctan2(y.values, x.values), rounding, np.ones_like(speed), basis)
        rounding = (np.abs(x.values) * x.half_width + np.abs(y.values) * y.half_width) / speed
        return _Expected(speed, rounding, speed, basis)


def _from_polar(columns: Mapping[str, NumberColumn], end: str, name: str) -> _Expected:
    speed, angle = columns[f"v_{end}"], columns[f"theta_{end}"]
    along, across = np.cos(angle.values), np.sin(angle.values)
    if name.startswith("v_y"):
        along, across = across, along
    rounding = np.abs(along) * speed.half_width + np.abs(speed.values * across) * angle.half_width
    return _Expected(speed.values * along, rounding, np.abs(speed.values), (speed.name, angle.name))


def _compare(
    read: NumberColumn,
    expected: _Expected,
    rows: tuple[RawRow, ...],
    faults: list[Fault],
    notices: list[Notice],
) -> None:
    excess = np.abs(read.values - expected.values) - expected.rounding - read.half_width
    for index in np.flatnonzero(excess > AVERAGING * expected.scale):
        row, (first, second) = rows[index], expected.basis
        here, there = read.shown(read.values[index]), read.shown(expected.values[index])
        seen = f"read {here}, but {first} and {second} give {there}"
        if excess[index] > GROSS * expected.scale[index]:
            message = f"{seen}; expected agreement: check the units and the row, or delete the redundant column"
            faults.append(Fault(message, row=row.number, line=row.line, column=read.name))
        else:
            message = f"{read.name}: {seen}; {first} and {second} are used"
            kind = f"{read.name} is at odds with {first} and {second}, which are used"
            notices.append(Notice(message, row.number, (read.name, first, second), kind))
