"""What cannot be: missing columns, limits, signs, contradictions, energy gained by 5 sd.

Each check adds faults to `Cells`, by row and column. Numbers are by column, `NAME_sd` among them,
(rows,) in SI, NaN where nothing was measured, so that no check sees a gap. `units` are symbols by
column as in the file.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from fitball.base.columns import COLUMNS, COMPONENTS, REBOUND, velocity_columns
from fitball.base.display_units import PLAIN
from fitball.base.text import listed
from fitball.base.units import factor_of
from fitball.base.values import Ball, FloatArray
from fitball.data.cells import Cells
from fitball.data.kinematics import Columns, counted, slopes, velocity

Numbers = Mapping[str, FloatArray]
Units = Mapping[str, str]

# Columns that determine an incident velocity; columns that tables which count along a fixed axis
# have all negative.
INCIDENCES = (("v_x1", "v_y1"), ("v_1", "theta_1"), ("v_y1",))
_ONE_SIGN = ("v_y2", "theta_1", "theta_2")
# Shares of the speed, or of the angle, by which columns that say the same may differ, and may not:
# tables print means of repeated throws, and a mean of speeds exceeds the speed of the mean by half
# the squared relative scatter across it (0.5 % for a scatter of 10 %); no averaging or misprint of
# a late digit makes a fifth.
_NOTED = 0.01
_GROSS = 0.2
# Sds of the noise by which no row is above what is possible: by chance one of three million on the
# bound.
_SDS = 5.0


def shown(name: str, value: float, units: Units) -> str:
    """A value [SI] in the unit of the file."""
    si = COLUMNS[name.removesuffix("_sd")].unit
    unit = units.get(name, si)
    return f"{value / factor_of(unit, si):.5g} {unit}".rstrip()


def missing_columns(
    cells: Cells,
    present: Collection[str],
    guesses: Mapping[str, str],
    rebound: bool,
) -> None:
    """Faults of columns that are needed and not `present`; `guesses` are those of other names that
    may be meant.
    """
    incident = counted(present, "1")
    option = ",".join(f"{ours}={theirs}" for ours, theirs in guesses.items())
    meant = (
        f': did you mean --columns "{option}"?'
        if guesses
        else f" (columns: {listed(cells.names, most=20)})"
    )
    if incident not in INCIDENCES:
        read = f"read {listed(incident) or 'no incident velocity'}"
        forms = "v_x1 and v_y1, or v_1 and theta_1, or v_y1 alone for a drop test"
        cells.fault("no-incident", f"{read}; expected {forms}{meant}")
        meant = ""
    elif incident == ("v_y1",):
        for name in [name for name in REBOUND if name in present and COLUMNS[name].tangential]:
            expected = (
                "expected a column v_x1 (zeros if the ball was dropped; a rebound speed "
                "straight up is v_y2)"
            )
            cells.fault(
                "no-incident-motion",
                f"motion along the court after the impact only; {expected}",
                name,
            )
    if rebound and not {*REBOUND} & {*present}:
        cells.fault(
            "no-rebound",
            f"no rebound column; expected one of {listed(REBOUND, 'or', 20)}{meant}",
        )
    if "omega_2" in present and "omega_1" not in present:
        cells.note("no-incident-spin", "no column omega_1: the incident spin is taken as 0")


def one_sign(cells: Cells, numbers: Numbers, units: Units) -> dict[str, FloatArray]:
    """The numbers with v_y2 and angles counted positive: turned where they are negative throughout;
    faults of the rows whose sign is that of fewer.
    """
    turned = dict(numbers)
    for name in [name for name in _ONE_SIGN if name in numbers and (numbers[name] < 0.0).any()]:
        negative = numbers[name] < 0.0
        positive = numbers[name] > 0.0
        turned[name] = np.abs(numbers[name])
        if not positive.any():
            cells.note("turned", f"{name} is negative in every row: its sign was changed")
            continue
        odd, others = (
            (negative, "positive") if negative.sum() <= positive.sum() else (positive, "negative")
        )
        for k in np.flatnonzero(odd).tolist():
            read = f"read {shown(name, float(numbers[name][k]), units)}, but most rows are {others}"
            cells.fault("mixed-signs", f"{read}; expected one sign in all rows", name, k)
    return turned


def limits(cells: Cells, numbers: Numbers, units: Units) -> dict[str, FloatArray]:
    """The numbers without those that no ball and no instrument has, which are faults."""
    within = {}
    for name, values in numbers.items():
        column = COLUMNS[name.removesuffix("_sd")]
        low, high = (0.0, column.limits[1]) if name.endswith("_sd") else column.limits
        # A speed, an angle or an sd of zero is none.
        bad = (values > high) | (values <= low if low == 0.0 else values < low)
        unit = column.display_unit
        ends = f"{low * unit.factor:.4g} to {high * unit.factor:.4g} {unit.name}"
        for k in np.flatnonzero(bad).tolist():
            read = (
                f"read {shown(name, float(values[k]), units)}; expected "
                f"{'more than ' * (low == 0.0)}{ends}"
            )
            cells.fault("out-of-limits", f"{read}: check the unit and the sign", name, k)
        within[name] = np.where(bad, np.nan, values)
    return within


def deviations(cells: Cells, numbers: Numbers) -> None:
    """Faults of deviations without their column, and of measured cells without one in a column that
    states them.
    """
    for name in [name for name in numbers if name.endswith("_sd")]:
        value = name.removesuffix("_sd")
        if value not in numbers:
            cells.fault(
                "sd-without-column",
                f"standard deviation of {value}, but there is no such column",
                name,
            )
            continue
        for k in np.flatnonzero(np.isnan(numbers[name]) & ~np.isnan(numbers[value])).tolist():
            cells.fault(
                "no-sd",
                f"no sd of {value}; expected one in every measured row or in none",
                name,
                k,
            )


def _further(velocities: Numbers, end: str) -> dict[str, FloatArray]:
    """What follows from the velocity of one `end` besides components, speed and angle, where both
    components are known.
    """
    if not velocities.keys() >= {*COMPONENTS[end]}:
        return {}
    components = [velocities[name] for name in COMPONENTS[end]]
    formulas = {name: COLUMNS[name].formula for name in velocity_columns(end)}
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return {
            name: formula(*components)
            for name, formula in formulas.items()
            if formula is not None and name not in velocities
        }


def redundant(cells: Cells, numbers: Numbers, units: Units) -> None:
    """Faults and notes of velocity columns that contradict those which count, row by row."""
    for end in "12":
        names = counted(numbers, end)
        said = velocity({name: numbers[name] for name in names}, end)
        further = _further(said, end)
        said |= further
        basis = listed(names)
        for name in [name for name in said if name in numbers and name not in names]:
            speed = COLUMNS[name].unit == "m/s"
            scale = np.abs(said[f"v_{end}"] if speed else said[name])
            if name in further:
                # It may be zero in some rows.
                scale = np.maximum(scale, np.nanmedian(scale))
            share = np.abs(numbers[name] - said[name]) / np.maximum(scale, 1e-12)
            for k in np.flatnonzero(share > _GROSS).tolist():
                read, given = (
                    shown(name, float(column[name][k]), units) for column in (numbers, said)
                )
                words = (
                    f"read {read}, but {basis} give {given}; expected agreement: check the "
                    "units and the row"
                )
                cells.fault(
                    "contradiction",
                    f"{words}, or leave the column out (--ignore {name})",
                    name,
                    k,
                )
            if (rows := np.flatnonzero((share > _NOTED) & (share <= _GROSS))).size:
                named = f"row{'s' * (rows.size > 1)} {listed(cells.rows[rows].astype(str))}"
                where = f"{100.0 * float(share[rows].max()):.2g} % ({named})"
                cells.note(
                    "disagreement",
                    f"{name} differs from {basis} by up to {where}; {basis} are used",
                )
            if f"{name}_sd" in numbers:
                cells.note("sd-not-used", f"{name}_sd is not used: {basis} are")


def energy(
    cells: Cells,
    numbers: Numbers,
    units: Units,
    ball: Ball,
    noise: Mapping[str, float],
) -> None:
    """Faults of rows that rebound faster, or with more energy, than they came, by 5 sd of the
    stated or expected `noise` [SI, by column]. What was not measured of the rebound counts as zero.
    """
    used = [*counted(numbers, "1"), *counted(numbers, "2"), "omega_1", "omega_2"]
    used = [name for name in used if name in numbers]
    known = {
        name: np.nan_to_num(numbers[name]) if name.endswith("2") else numbers[name] for name in used
    }
    results, slope = slopes(lambda columns: _gains(columns, ball), known)
    variance = np.zeros(slope.shape[:2])
    for k, name in enumerate(used):
        sd = np.nan_to_num(np.asarray(numbers.get(f"{name}_sd", noise.get(name, 0.0))))
        variance += (slope[:, :, k] * sd[..., None]) ** 2
    blamed = np.zeros(len(slope), dtype=np.bool_)
    # Where a slope is not finite nothing is known, and no comparison holds.
    for code, gain, sds in zip(results, results.values(), np.sqrt(variance).T, strict=True):
        above = (gain > _SDS * sds) & ~blamed
        column = (
            next((name for name in ("v_y2", "v_2") if name in known), None)
            if code == "restitution"
            else None
        )
        blamed |= above
        for k in np.flatnonzero(above).tolist():
            read = listed(
                (f"{name} = {shown(name, float(known[name][k]), units)}" for name in used),
                most=8,
            )
            gained = "v_y2 exceeds v_y1" if code == "restitution" else "the ball gains energy"
            size = PLAIN.number(gain[k] / sds[k], 2)
            words = (
                f"{gained} by {size} sd of the noise: {read}; expected a loss: look for "
                "swapped columns and"
            )
            cells.fault(
                code,
                f"{words} other units, or state ball and noise in the scene",
                column,
                k,
            )


def _gains(known: Columns, ball: Ball) -> Columns:
    """By how much v_y2 exceeds v_y1 [m/s], and energy after energy before, over half the mass
    [m^2/s^2].
    """
    before = velocity(known, "1")
    after = velocity(known, "2")
    none = 0.0 * next(iter(known.values()))
    last = after.get("v_2", after.get("v_x2", after.get("v_y2", none)))
    spins = known.get("omega_2", none) ** 2 - known.get("omega_1", none) ** 2
    gain = (
        last**2
        - before.get("v_1", before["v_y1"]) ** 2
        + ball.inertia_ratio * ball.radius**2 * spins
    )
    return ({"restitution": after["v_y2"] - before["v_y1"]} if "v_y2" in after else {}) | {
        "energy": gain
    }
