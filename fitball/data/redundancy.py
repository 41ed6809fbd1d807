"""Columns that say the same thing in other words: which of them count, and whether they agree."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from fitball.data.findings import Findings
from fitball.data.number_column import NumberColumn
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


def check_redundant(columns: Mapping[str, NumberColumn], end: str, found: Findings) -> None:
    """Compare every velocity column that does not count with those that do, row by row.

    A difference beyond rounding and averaging becomes a notice, a gross one a fault.
    """
    counted = independent(columns, end)
    for name in (f"v_x{end}", f"v_y{end}", f"v_{end}", f"theta_{end}"):
        if name in columns and name not in counted:
            expected = _from_components if counted[0].startswith("v_x") else _from_polar
            _compare(columns[name], expected(columns, end, name), found)


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


def _compare(read: NumberColumn, expected: _Expected, found: Findings) -> None:
    first, second = expected.basis
    excess = np.abs(read.values - expected.values) - expected.rounding - read.half_width
    kind = f"{read.name} is at odds with {first} and {second}, which are used"
    for k in np.flatnonzero(excess > AVERAGING * expected.scale).tolist():
        here, there = read.shown(read.values[k]), read.shown(expected.values[k])
        seen = f"read {here}, but {first} and {second} give {there}"
        if excess[k] > GROSS * expected.scale[k]:
            advice = "check the units and the row, or delete the redundant column"
            found.fault(f"{seen}; expected agreement: {advice}", read.name, k)
        else:
            message = f"{read.name}: {seen}; {first} and {second} are used"
            found.notice(message, read.name, first, second, place=k, kind=kind)
