"""What is wrong with the columns of a table, and with their numbers: columns that an impact needs, signs, ranges,
parts larger than their whole, and columns that say the same in other words.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from math import pi

import numpy as np
from numpy.typing import NDArray

from fitball.data.columns import ANGLES, COLUMNS, INCIDENT, NUMBERS, REBOUND, SD_SUFFIX
from fitball.data.findings import Findings
from fitball.data.header import Header
from fitball.data.kinematics import Uncertain, independent, velocity
from fitball.data.names import guess_of
from fitball.data.numbers import NumberColumn
from fitball.observables import OBSERVABLES
from fitball.values import FloatArray
from fitball.visible import some
from fitball.wording import option, spoken

_INCIDENT_FORMS = "v_x1 and v_y1, or v_1 and theta_1, or v_y1 alone for a drop test"
_INCIDENT_GAPS = {
    ("v_x1",): "column v_y1 is missing; expected the speed towards the court beside v_x1",
    ("v_1",): "column theta_1 is missing; expected the angle beside v_1 (for a drop test rename v_1 to v_y1)",
    ("theta_1",): "column v_1 is missing; expected the speed beside theta_1",
    (): f"no incident velocity; expected {_INCIDENT_FORMS}",
}
_NO_INCIDENT_MOTION = (
    "a rebound along the court without its incident motion; expected a column v_x1 "
    "(write zeros if the ball was dropped; a rebound speed straight up is v_y2)"
)


def knows_incident(names: Iterable[str]) -> bool:
    """Whether the columns determine the incident velocity (v_y1 alone does: a drop test)."""
    return independent(names, "1") in (("v_x1", "v_y1"), ("v_1", "theta_1"), ("v_y1",))


def check_columns(present: Collection[str], header: Header, found: Findings, rebound: bool = True) -> None:
    """Add a fault for every column that is not `present`, and a notice for what is assumed or ignored.

    Without `rebound` a table of incident columns alone is complete.
    """
    read = some([*header.numbers, *header.texts])
    incident = independent(present, "1")
    missing = []
    if len(incident) < 2 and incident != ("v_y1",):
        missing.append(f"{_INCIDENT_GAPS[incident]} (columns read: {read})")
    elif not knows_incident(present):
        missing.append(f"{' and '.join(incident)} do not make an incident velocity; expected {_INCIDENT_FORMS}")
    elif incident == ("v_y1",):
        for name in [name for name, item in OBSERVABLES.items() if item.along and name in present]:
            found.header_fault(_NO_INCIDENT_MOTION, name)
    if rebound and not any(name in present for name in REBOUND):
        missing.append(f"no rebound column; expected at least one of {', '.join(REBOUND)} (columns read: {read})")
    if missing:
        missing[0] += _what_is_meant(header.extras, present)
    for message in missing:
        found.header_fault(message)
    _check_sds(present, found)
    if "omega_2" in present and "omega_1" not in present:
        found.notice("no column omega_1: incident spin taken as 0", "omega_1")
    if header.extras:
        kept = some([_with_guess(name, present) for name in header.extras])
        found.notice(f"columns kept and not used: {kept}", *header.extras)


def _guessed(name: str, present: Collection[str]) -> tuple[str, ...]:
    """Columns of ours, not there yet, that an extra column may be."""
    guess = guess_of(name)
    return () if guess is None else tuple(item for item in guess.names if item in NUMBERS and item not in present)


def _with_guess(name: str, present: Collection[str]) -> str:
    """An extra column, and how to use it where its name says what it probably is."""
    meant = _guessed(name, present)
    if not meant:
        return name
    return f"{name} (if it is {' or '.join(meant)}: {_named({meant[0]: name})})"


def _named(columns: Mapping[str, str]) -> str:
    """How a caller says names of columns."""
    return spoken(
        f'--columns "{", ".join(f"{ours}={name}" for ours, name in columns.items())}"', f"columns={columns}"
    )


def _what_is_meant(extras: Collection[str], present: Collection[str]) -> str:
    """How to name the extra columns that may be what is missing; empty where none may."""
    sure: dict[str, str] = {}
    said = []
    for name in extras:
        meant = _guessed(name, present)
        if len(meant) == 1 and meant[0] not in sure:
            sure[meant[0]] = name
        elif len(meant) > 1:
            said.append(
                f"; '{name}' may be {' or '.join(meant)}: say which with {spoken('--columns', 'columns={...}')}"
            )
    if sure:
        said.insert(0, f"; if these are meant pass {_named(sure)}")
    if extras and not said:
        said.append(f"; if they have other names here, say which: {_named({'v_1': 'NAME', 'theta_1': 'NAME [deg]'})}")
    return "".join(said)


def _check_sds(present: Collection[str], found: Findings) -> None:
    """Add a fault for every sd without its column, and for the sd of a speed without that of its angle."""
    names = set(present)
    for name in present:
        base = name.removesuffix(SD_SUFFIX)
        if base not in names:
            message = f"a standard deviation of '{base}', but there is no column '{base}'; add it or delete this one"
            found.header_fault(message, name)
    if independent({name for name in names if not name.endswith(SD_SUFFIX)}, "1") == ("v_1", "theta_1"):
        stated = names & {"v_1_sd", "theta_1_sd"}
        if len(stated) == 1:
            missing = ({"v_1_sd", "theta_1_sd"} - stated).pop()
            message = f"column '{missing}' is missing; the incident components need the sd of both speed and angle"
            found.header_fault(message, stated.pop())


BoolArray = NDArray[np.bool_]

_UPWARD = ": it is negative in every row, as if counted upward; if so pass "
# Share of the others up to which rows are few enough to be slips; one row is, beside two.
FEW = 0.2
# Share of the speed towards the court below which a ball comes straight down.
STEEP = 0.1
AGAINST = (
    "balls fly against x, along which offsets and topspin are counted: there topspin and offsets ahead of the ball "
    "are negative; mirrored they say the same (v_x and spins with the other sign, angles from 180 deg)"
)


def one_sign(columns: Mapping[str, NumberColumn], found: Findings) -> dict[str, NumberColumn]:
    """The columns with `v_y2`, `theta_2` and `theta_1` counted positive.

    A column that is negative throughout is turned once, with a notice; mixed signs are a fault of the
    rows in the minority.
    """
    turned = dict(columns)
    for name in (*REBOUND, *INCIDENT):
        column = columns.get(name)
        if column is None or not COLUMNS[name].turned:
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
        expected = "a positive standard deviation" if name.endswith(SD_SUFFIX) else COLUMNS[name].positive
        if expected:
            bad = column.values <= 0.0
            hint = _UPWARD + option("flip", "v_y1") if name == "v_y1" and bool((column.values < 0.0).all()) else ""
            _report(column, bad, f"expected {expected}{hint}", found)
        if name in ANGLES:
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


# Beyond the rounding of the printed digits, columns may differ by this fraction (of the speed; in
# radians for angles) without a word. Tables print means of repeated throws, and the mean of speeds exceeds
# the speed of the mean velocity by half the squared relative scatter across it: 0.5 % stands for a
# scatter of 10 %. Wang's tables stay below 0.25 % and 0.06 degrees except in the two rows that
# are at odds by 1.1 % and by 0.4 and 0.7 degrees.
AVERAGING = 0.005
# No averaging or misprint of a late digit explains this much: a unit or a column is wrong.
GROSS = 0.2


def check_redundant(columns: Mapping[str, NumberColumn], end: str, found: Findings) -> None:
    """Compare every velocity column that does not count with those that do, row by row.

    A difference beyond rounding and averaging becomes a notice, a gross one a fault.
    """
    counted = independent(columns, end)
    read = {name: columns[name] for name in counted}
    halves = {name: np.full_like(item.values, item.half_width) for name, item in read.items()}
    known = {name: Uncertain.measured(name, item.values, halves[name]) for name, item in read.items()}
    said = velocity(known, end).columns(end)
    for name, other in said.items():
        if name in columns and name not in counted:
            scale = np.ones_like(other.value) if name in ANGLES else np.abs(said[f"v_{end}"].value)
            _compare(columns[name], other, scale, counted, found)


def _compare(read: NumberColumn, said: Uncertain, scale: FloatArray, basis: tuple[str, ...], found: Findings) -> None:
    """Hold a column against what the two of its `basis` say, to rounding and to shares of a `scale` (impacts,)."""
    names = " and ".join(basis)
    excess = np.abs(read.values - said.value) - said.reach - read.half_width
    kind = f"{read.name} is at odds with {names}, which are used"
    for k in np.flatnonzero(excess > AVERAGING * scale).tolist():
        seen = f"read {read.shown(read.values[k])}, but {names} give {read.shown(said.value[k])}"
        if excess[k] > GROSS * scale[k]:
            advice = "check the units and the row, or delete the redundant column"
            found.fault(f"{seen}; expected agreement: {advice}", read.name, k)
        else:
            found.notice(f"{read.name}: {seen}; {names} are used", read.name, *basis, place=k, kind=kind)
