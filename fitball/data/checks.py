"""Checks of the columns of a table and of their numbers: missing columns, signs, ranges, components larger than the
speed, and redundant columns that disagree. Rebounds that are faster, or have more energy, than noise explains are
faults too.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from math import pi
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from fitball.data.cells import Findings
from fitball.data.columns import ANGLES, COLUMNS, INCIDENT, NUMBERS, REBOUND, SD_SUFFIX
from fitball.data.header import guess_of, without_unit
from fitball.data.heights import GROSS
from fitball.data.kinematics import Uncertain, independent, velocity
from fitball.data.numbers import Columns, NumberColumn
from fitball.data.scene import Scene
from fitball.observables import OBSERVABLES
from fitball.values import FloatArray, quotient
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
    "rebound motion along the court, but no incident motion; expected a column v_x1 (zeros if the ball was dropped; "
    "a rebound speed straight up is v_y2)"
)


def knows_incident(names: Iterable[str]) -> bool:
    """Whether the columns determine the incident velocity (v_y1 alone does: a drop test)."""
    return independent(names, "1") in (("v_x1", "v_y1"), ("v_1", "theta_1"), ("v_y1",))


def check_columns(
    present: Collection[str],
    named: Sequence[str],
    extras: Sequence[str],
    found: Findings,
    rebound: bool = True,
    grouping: Collection[str] = (),
) -> None:
    """Add a fault for every column that is not `present`, and a notice for what is assumed or ignored; `named` are
    those that were read, `extras` those among them that are neither numbers nor known labels, and `grouping` the
    extras whose labels group rows.

    Without `rebound` a table of incident columns alone is complete.
    """
    incident = independent(present, "1")
    missing = []
    if len(incident) < 2 and incident != ("v_y1",):
        missing.append(_INCIDENT_GAPS[incident])
    elif not knows_incident(present):
        missing.append(f"{' and '.join(incident)} do not make an incident velocity; expected {_INCIDENT_FORMS}")
    elif incident == ("v_y1",):
        for name in [name for name, item in OBSERVABLES.items() if item.along and name in present]:
            found.header_fault(_NO_INCIDENT_MOTION, name)
    if rebound and not any(name in present for name in REBOUND):
        missing.append(f"no rebound column; expected at least one of {', '.join(REBOUND)}")
    if missing:
        # Said once: what is to be done stays whole in a line of limited length.
        missing[-1] += f" (columns read: {some(named)})"
        missing[0] += _what_is_meant(extras, present)
    for message in missing:
        found.header_fault(message)
    _check_sds(present, found)
    if "omega_2" in present and "omega_1" not in present:
        found.notice("no column omega_1: incident spin is set to 0", "omega_1")
    if unused := [name for name in extras if name not in grouping]:
        if not {"omega_1", "omega_2"} & set(present) and len(incident) == 2:
            found.notice("no columns omega_1 and omega_2: incident spin is set to 0", "omega_1")
        kept = some([_with_guess(name, present) for name in unused])
        found.notice(f"columns not used: {kept}", *unused)


def _guessed(name: str, present: Collection[str]) -> tuple[str, ...]:
    """Columns of ours, not there yet, that an extra column may be."""
    return tuple(item for item in guess_of(name) if item in NUMBERS and item not in present)


def _with_guess(name: str, present: Collection[str]) -> str:
    """An extra column, and how to use it where its name says what it probably is."""
    meant = _guessed(name, present)
    if not meant:
        return name
    return f"{name} (to read it as {' or '.join(meant)}: {_named({meant[0]: _with_unit(name)})})"


def _with_unit(name: str) -> str:
    """The name of a column as an option takes it, with the unit that is one of its words."""
    unit = without_unit(name)[1]
    return name if unit is None else f"{name} [{unit}]"


def _named(columns: Mapping[str, str]) -> str:
    """The option that names columns."""
    return spoken(
        f'--columns "{", ".join(f"{ours}={name}" for ours, name in columns.items())}"', f"columns={columns}"
    )


def surely_meant(extras: Collection[str], present: Collection[str]) -> dict[str, str]:
    """By our name the extra columns whose names say which columns of ours they probably are: beside `angle after`
    an `angle` is the incident one.
    """
    sure: dict[str, str] = {}
    for name in sorted(extras, key=lambda name: len(_guessed(name, present))):
        meant = _guessed(name, {*present, *sure})
        if len(meant) == 1:
            sure[meant[0]] = _with_unit(name)
    return {name: sure[name] for name in NUMBERS if name in sure}


def _what_is_meant(extras: Collection[str], present: Collection[str]) -> str:
    """How to name the extra columns that may be what is missing; empty where none may."""
    if {"x", "y"} <= {*extras} and {"t", "frame"} & {*extras}:
        return f"; these are positions on film: {spoken('fitball track', 'fitball.track')} finds their impacts"
    said, sure = [], surely_meant(extras, present)
    for name in extras:
        meant = _guessed(name, present)
        if len(meant) > 1 and _with_unit(name) not in sure.values():
            said.append(f"; '{name}' may be {' or '.join(meant)}: choose with {spoken('--columns', 'columns={...}')}")
    if sure:
        said.insert(0, f"; if these are the columns, pass {_named(sure)}")
    if extras and not said:
        needed = {"v_1": "NAME", "theta_1": "NAME [deg]", "omega_1": "NAME [rpm]"}
        said.append(f"; if they have other names, pass {_named(needed | {'...': '...'})}")
    return "".join(said)


def _check_sds(present: Collection[str], found: Findings) -> None:
    """Add a fault for every sd without its column, and for the sd of a speed without that of its angle."""
    names = set(present)
    for name in present:
        base = name.removesuffix(SD_SUFFIX)
        if base not in names:
            message = f"standard deviation of '{base}', but there is no column '{base}'; add it or delete this one"
            found.header_fault(message, name)
    if independent({name for name in names if not name.endswith(SD_SUFFIX)}, "1") == ("v_1", "theta_1"):
        stated = names & {"v_1_sd", "theta_1_sd"}
        if len(stated) == 1:
            (missing,) = {"v_1_sd", "theta_1_sd"} - stated
            message = f"column '{missing}' is missing; the incident components need the sd of both speed and angle"
            found.header_fault(message, *stated)


BoolArray = NDArray[np.bool_]

_UPWARD = ": all are negative; if upward is positive in this table, pass "
# Share of the others up to which rows are few enough to be slips; one row is, beside two.
FEW = 0.2
# Share of the speed towards the court below which a ball comes straight down.
STEEP = 0.1
AGAINST = (
    "balls move towards negative v_x, where topspin and offsets have the opposite sign. The mirrored table is "
    "equivalent: v_x and spins with the other sign, 180 deg minus the angles"
)


def one_sign(columns: Columns, found: Findings) -> Columns:
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
                read = f"read {column.text(k)}, but other rows are {word}"
                found.fault(f"{read}; expected one sign in all rows: check this row", name, k)
            # The odd rows are reported; the magnitude lets the other checks go on without repeating it.
            turned[name] = replace(column, values=np.abs(column.values))
        elif negative.any():
            turned[name] = replace(column, values=-column.values)
            found.notice(f"{name} is negative in every row; its sign was changed", name)
    return turned


def check_ranges(columns: Columns, found: Findings) -> None:
    """Add a fault for every speed, time or sd that is not positive, every angle outside 0 to 180 deg."""
    for name, column in columns.items():
        expected = "a positive standard deviation" if name.endswith(SD_SUFFIX) else COLUMNS[name].positive
        if expected:
            bad = column.values <= 0.0
            hint = _UPWARD + option("flip", "v_y1") if name == "v_y1" and bool((column.values < 0.0).all()) else ""
            _report(column, bad, f"expected {expected}{hint}", found)
        if name in ANGLES:
            outside = (column.values <= 0.0) | (column.values >= pi)
            _report(column, outside, "expected an angle from the court between 0 and 180 deg: check the unit", found)


def check_directions(columns: Columns, found: Findings) -> None:
    """Add a notice for the few rows whose ball moves in the opposite direction along the court to all others, or one
    notice for all rows against the positive direction.
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
    kind = f"the ball moves in the opposite direction along the court to {int(many.sum())} other rows: check the sign"
    for k in np.flatnonzero(few).tolist() if odd else ():
        found.notice(f"{kind}: {column.name} = {column.text(k)}", column.name, place=k, kind=kind)


def check_pairs(columns: Columns, found: Findings) -> None:
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
        found.fault(f"read {column.text(k)}; {expected}", column.name, k)


# Beyond the rounding of the printed digits, columns may differ by this fraction (of the speed; in
# radians for angles) without a word. Tables print means of repeated throws, and the mean of speeds exceeds
# the speed of the mean velocity by half the squared relative scatter across it: 0.5 % stands for a
# scatter of 10 %. Wang's tables stay below 0.25 % and 0.06 degrees except in the two rows that
# are at odds by 1.1 % and by 0.4 and 0.7 degrees.
AVERAGING = 0.005


def check_redundant(columns: Columns, end: str, found: Findings) -> None:
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
    """Compare a column with what the two of its `basis` give, to rounding and to shares of a `scale` (impacts,)."""
    names = " and ".join(basis)
    excess = np.abs(read.values - said.value) - said.reach - read.half_width
    kind = f"{read.name} disagrees with {names}, which are used"
    for k in np.flatnonzero(excess > AVERAGING * scale).tolist():
        seen = f"read {read.text(k)}, but {names} give {read.printed(float(said.value[k]))}"
        if excess[k] > GROSS * scale[k]:
            advice = "check the units and the row, or delete the redundant column"
            found.fault(f"{seen}; expected agreement: {advice}", read.name, k)
        else:
            found.notice(f"{read.name}: {seen}; {names} are used", read.name, *basis, place=k, kind=kind)


# Chance that noise alone puts the worst row of a table this far above a bound, were every true value on it: 4.4 sd of
# noise among 20 rows, 6 among 100,000.
CHANCE = 1e-4
# Sds of the scene's ball within which it may lie.
BALL_SDS = 5.0
HINT = (
    "check the units and look for swapped columns, or give the noise ([measurement]) and the ball ([ball]) in the "
    "scene"
)


def normal_speed(columns: Columns, end: str) -> FloatArray | None:
    """v_y [m/s] of `end` ("1" or "2") as a column or from speed and angle; None otherwise.

    Other pairs of columns determine it too, but at steep or grazing angles so badly that no bound
    can rest on it.
    """
    names = _normal_columns(columns, end)
    speed = velocity({name: Uncertain.exact(columns[name].values) for name in names}, end).y
    return None if speed is None else speed.value


def _normal_columns(columns: Columns, end: str) -> tuple[str, ...]:
    counted = independent(columns, end)
    if f"v_y{end}" in counted:
        return (f"v_y{end}",)
    return counted if counted == (f"v_{end}", f"theta_{end}") else ()


def check_bounds(columns: Columns, scene: Scene, found: Findings) -> None:
    """Add a fault for rows with a coefficient of restitution above 1 or a gain of energy that noise does not explain,
    a notice for those where it does.

    Noise is what the table states, or else what the scene knows or expects. All rows together are held to it too, so
    that swapped columns of slow impacts are found. Spin may turn into speed and back, so energy counts both, with
    the gyration of the scene's ball that favours the table. What was not measured of the rebound counts as zero.
    Nothing is checked while the incident velocity is incomplete.
    """
    if not knows_incident(columns):
        return
    known = _known(columns, scene)
    blamed = _check_restitution(known, columns, found)
    _check_energy(known, columns, scene, blamed, found)


def _check_bound(
    excess: Uncertain,
    kind: str,
    expected: str,
    words: Callable[[int], str],
    column: Callable[[int], str],
    blamed: BoolArray,
    found: Findings,
) -> BoolArray:
    """Add faults or notices for rows that are above a bound and not `blamed` (rows,) yet; returns the rows that are
    either. `excess` says by how much they are, with its sd; `kind` names the bound, `words` give a row's numbers,
    `column` is the column to point at.
    """
    sds = quotient(excess.value, excess.sd)
    known = np.isfinite(sds)
    above = (sds > 0.0) & ~blamed
    beyond = above & (sds > _reach(max(int(known.sum()), 1)))
    for k in np.flatnonzero(beyond).tolist():
        message = f"{kind}: {words(k)}, {sds[k]:.3g} times the sd of the noise; expected {expected}: {HINT}"
        found.fault(message, column(k), k)
    spread = float(np.sqrt(np.sum(excess.sd[known] ** 2)))
    together = float(np.sum(excess.value[known])) / spread if spread > 0.0 else 0.0
    if together > _reach(1) and not beyond.any() and above.any():
        message = (
            f"{kind} in {int(above.sum())} of {len(found.rows)} rows: each alone may be noise, but together they are "
            f"{together:.3g} times its sd; expected {expected}: {HINT}"
        )
        found.fault(message, column(int(np.flatnonzero(above)[0])))
    else:
        within = f"{kind}, within its noise"
        for k in np.flatnonzero(above & ~beyond).tolist():
            found.notice(f"{within}: {words(k)}", column(k), place=k, kind=within)
    return above | blamed


def _reach(count: int) -> float:
    """Sds that the largest of `count` normal deviations exceeds with probability CHANCE."""
    return -NormalDist().inv_cdf(CHANCE / count)


def _known(columns: Columns, scene: Scene) -> dict[str, Uncertain]:
    """The columns that count, each with its noise: as stated, or else as the scene expects it of the rebound."""
    quantities = {}
    for name in (*independent(columns, "1"), *independent(columns, "2"), "omega_1", "omega_2"):
        if name not in columns:
            continue
        values, sd = columns[name].values, columns.get(name + SD_SUFFIX)
        # Of an angle without its speed the noise is that of a velocity, in number.
        speed = columns["v_2"].values if "v_2" in columns else np.ones_like(values)
        expected = scene.noise_of(name, speed) if name.endswith("2") else np.zeros_like(values)
        quantities[name] = Uncertain.measured(name, values, expected if sd is None else sd.values)
    return quantities


def _check_restitution(known: Mapping[str, Uncertain], columns: Columns, found: Findings) -> BoolArray:
    """Rows (rows,) whose restitution is above 1."""
    blamed = np.zeros(len(found.rows), dtype=np.bool_)
    before, after = (
        velocity({name: known[name] for name in _normal_columns(columns, end)}, end).y for end in ("1", "2")
    )
    if before is None or after is None:
        return blamed
    v_1, v_2 = before.value, after.value

    def words(k: int) -> str:
        return f"{v_2[k] / v_1[k]:.3f}, v_y2 = {v_2[k]:.4g} m/s after v_y1 = {v_1[k]:.4g} m/s"

    # A speed that is not towards the court is a fault of its own.
    excess = Uncertain(np.where(v_1 > 0.0, after.value - v_1, np.nan), (after - before).parts)
    column = "v_y2" if "v_y2" in columns else "v_2"
    kind = "coefficient of restitution above 1"
    return _check_bound(excess, kind, "at most 1", words, lambda _k: column, blamed, found)


def _check_energy(
    known: Mapping[str, Uncertain], columns: Columns, scene: Scene, blamed: BoolArray, found: Findings
) -> None:
    """By the gain of energy over half the mass [m^2/s^2]."""
    zero = Uncertain.exact(np.zeros(len(found.rows)))
    known = {name: _or_zero(quantity) if name.endswith("2") else quantity for name, quantity in known.items()}
    before, after = (_least_speed_squared(known, end, zero) for end in ("1", "2"))
    spin_1, spin_2 = (known.get(name, zero) for name in ("omega_1", "omega_2"))
    gained = spin_2 * spin_2 - spin_1 * spin_1
    least, most = gyration(scene)
    weight = Uncertain.exact(np.where(gained.value > 0.0, least, most))

    def words(k: int) -> str:
        return (
            f"{np.sqrt(after.value[k]):.4g} m/s and {abs(spin_2.value[k]):.4g} rad/s after "
            f"{np.sqrt(before.value[k]):.4g} m/s and {abs(spin_1.value[k]):.4g} rad/s, for a ball of radius "
            f"{1e3 * scene.ball.radius:.4g} mm and I/(M R^2) = {scene.ball.inertia_ratio:.3g}"
        )

    def column(k: int) -> str:
        """A velocity when the speed alone is too much, the spin otherwise."""
        by_speed = after.value[k] > before.value[k]
        order = ("v_2", "v_x2", "v_y2", "omega_2") if by_speed else ("omega_2", "v_2", "v_x2", "v_y2")
        return next(name for name in order if name in columns)

    kind = "the ball has more energy after the impact than before"
    _check_bound(after - before + weight * gained, kind, "a loss", words, column, blamed, found)


def _or_zero(quantity: Uncertain) -> Uncertain:
    """The quantity, zero where it was not measured."""
    parts = {name: np.nan_to_num(part, nan=0.0) for name, part in quantity.parts.items()}
    return Uncertain(np.nan_to_num(quantity.value, nan=0.0), parts)


def gyration(scene: Scene) -> tuple[float, float]:
    """Least and largest radius of gyration squared [m^2] that the scene's ball may have."""

    def end(sds: float) -> float:
        ratio = scene.ball.inertia_ratio + sds * scene.ball_sd.get("inertia_ratio", 0.0)
        radius = max(scene.ball.radius + sds * scene.ball_sd.get("radius", 0.0), 0.0)
        return min(max(ratio, 0.0), 1.0) * radius**2

    return end(-BALL_SDS), end(BALL_SDS)


def _least_speed_squared(known: Mapping[str, Uncertain], end: str, zero: Uncertain) -> Uncertain:
    """v^2 [m^2/s^2] as far as the columns determine it; components count before the speed."""
    parts = [known[name] for name in (f"v_x{end}", f"v_y{end}") if name in known]
    if f"v_{end}" in known and len(parts) < 2:
        parts = [known[f"v_{end}"]]
    return sum((part * part for part in parts), zero)
