"""Checks of the numbers: one sign, ranges, and parts no larger than their whole."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import pi

import numpy as np
from numpy.typing import NDArray

from fitball.data.columns import SD_SUFFIX
from fitball.data.findings import Findings
from fitball.data.number_column import NumberColumn
from fitball.observables import OBSERVABLES
from fitball.wording import option

BoolArray = NDArray[np.bool_]

# Angles and the normal rebound speed are printed negative by tables that count along one fixed axis.
_SIGN_IS_CONVENTION = ("v_y2", "theta_2", "theta_1")
_UPWARD = ": it is negative in every row, as if counted upward; if so pass "
# Share of the others up to which rows are few enough to be slips; one row is, beside two.
FEW = 0.2
# Share of the speed towards the court below which a ball comes straight down.
STEEP = 0.1
AGAINST = (
    "balls fly against x, along which offsets and topspin are counted: there topspin and offsets ahead of the ball "
    "are negative; mirrored they say the same (v_x and spins with the other sign, angles from 180 deg)"
)
_POSITIVE = {
    "v_y1": "a positive speed towards the court",
    "v_1": "a positive speed",
    **{name: item.positive for name, item in OBSERVABLES.items() if item.positive},
}
_ANGLES = ("theta_1", *(name for name, item in OBSERVABLES.items() if item.angle))


def one_sign(columns: Mapping[str, NumberColumn], found: Findings) -> dict[str, NumberColumn]:
    """The columns with `v_y2`, `theta_2` and `theta_1` counted positive.

    A column that is negative throughout is turned once, with a notice; mixed signs are a fault of the
    rows in the minority.
    """
    turned = dict(columns)
    for name in _SIGN_IS_CONVENTION:
        column = columns.get(name)
        if column is None:
            continue
        negative, positive = column.values < 0.0, column.values > 0.0
        if negative.any() and positive.any():
            odd, word = (negative, "positive") if negative.sum() <= positive.sum() else (positive, "negative")
            for k in np.flatnonzero(odd).tolist():
                read = f"read {column.shown(column.values[k])}, but other rows are {word}"
                found.fault(f"{read}; expected one sign throughout: is it misprinted?", name, k)
            # The odd rows are reported; the magnitude lets the other checks go on without repeating it.
            turned[name] = replace(column, values=np.abs(column.values))
        elif negative.any():
            turned[name] = replace(column, values=-column.values)
            found.notice(f"{name} is negative in every row and was turned positive", name)
    return turned


def check_ranges(columns: Mapping[str, NumberColumn], found: Findings) -> None:
    """Add a fault for every speed, time or sd that is not positive, every angle outside 0 to 180 deg."""
    for name, column in columns.items():
        expected = "a positive standard deviation" if name.endswith(SD_SUFFIX) else _POSITIVE.get(name)
        if expected:
            bad = column.values <= 0.0
            hint = _UPWARD + option("flip", "v_y1") if name == "v_y1" and bool((column.values < 0.0).all()) else ""
            _report(column, bad, f"expected {expected}{hint}", found)
        if name in _ANGLES:
            outside = (column.values <= 0.0) | (column.values >= pi)
            _report(column, outside, "expected an angle to the court between 0 and 180 deg: check the unit", found)


def check_directions(columns: Mapping[str, NumberColumn], found: Findings) -> None:
    """Add a notice for the few rows whose ball comes the other way along the court than that of all others, or one
    for all rows that come against the direction in which the table counts.
    """
    angle, along, up = columns.get("theta_1"), columns.get("v_x1"), columns.get("v_y1")
    if along is not None:
        column, course = along, along.values
    elif angle is not None:
        column, course, up = angle, np.cos(angle.values), replace(angle, values=np.sin(angle.values))
    else:
        return
    backward, forward = course < 0.0, course > 0.0
    # Of balls that fall straight down the sign is noise.
    against = backward if up is None else backward & (course < -STEEP * up.values)
    few, many = (backward, forward) if backward.sum() <= forward.sum() else (forward, backward)
    odd = bool(few.any() and many.sum() >= 2 and few.sum() <= max(1.0, FEW * float(many.sum())))
    # Without spins no offset is fitted, and the two directions are alike.
    if against.any() and {"omega_1", "omega_2"} & columns.keys() and not (odd and many is forward):
        found.notice(f"{int(against.sum())} of {len(course)} {AGAINST}", column.name)
    kind = f"the ball comes the other way along the court than in {int(many.sum())} other rows: misprinted?"
    for k in np.flatnonzero(few).tolist() if odd else ():
        found.notice(f"{kind}: {column.name} = {column.shown(column.values[k])}", column.name, place=k, kind=kind)


def check_pairs(columns: Mapping[str, NumberColumn], found: Findings) -> None:
    """Add a fault where one rebound component and one polar column contradict each other.

    With both components, or both polar columns, the comparison of redundant columns sees to it.
    """
    x, y, speed, angle = (columns.get(name) for name in ("v_x2", "v_y2", "v_2", "theta_2"))
    part = x or y
    if part is None or (x is not None and y is not None):
        return
    if speed is not None and angle is None:
        too_fast = np.abs(part.values) > speed.values + part.half_width + speed.half_width
        _report(part, too_fast, "expected at most the rebound speed v_2: check the units", found)
    if angle is not None and speed is None and x is not None:
        backward = (np.abs(x.values) > x.half_width) & (np.abs(angle.values - pi / 2) > angle.half_width)
        against = backward & (x.values * np.cos(angle.values) < 0.0)
        _report(x, against, "expected a positive v_x2 where theta_2 is below 90 deg and a negative one above", found)


def _report(column: NumberColumn, bad: BoolArray, expected: str, found: Findings) -> None:
    for k in np.flatnonzero(bad).tolist():
        found.fault(f"read {column.shown(column.values[k])}; {expected}", column.name, k)
