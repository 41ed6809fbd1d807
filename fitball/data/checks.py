"""What cannot be: missing columns, limits, contradictions.

Each check adds faults to `Cells`, by row and column. Numbers are by column, `NAME_sd` among them,
(rows,) in SI, NaN where nothing was measured, so that no check sees a gap. `units` are symbols by
column as in the file.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from shlex import quote
from typing import TypeAlias

import numpy as np

from fitball.base.columns import (
    COLUMNS,
    COMPONENTS,
    FLIGHTS,
    HEIGHTS,
    RATIOS,
    REBOUND,
    velocity_columns,
)
from fitball.base.text import listed
from fitball.base.units import factor_of
from fitball.base.values import FloatArray
from fitball.data.cells import TableCells
from fitball.data.kinematics import Columns, counting_columns, velocity
from fitball.data.positions import are_positions
from fitball.data.table import UNKNOWN_SPIN_SD

# Symbols of units by column.
Units: TypeAlias = Mapping[str, str]

# Columns that determine an incident velocity.
INCIDENCES = (("v_x1", "v_y1"), ("v_1", "theta_1"), ("v_y1",))
# Share of the speed, or of the angle, by which columns that say the same may differ without a note:
# tables print means of repeated throws, and a mean of speeds exceeds the speed of the mean by half
# the squared relative scatter across it (0.5 % for a scatter of 10 %).
_NOTED_SHARE = 0.01
# Share by which they may not: no averaging or misprint of a late digit makes a fifth.
_FAULTY_SHARE = 0.2
# Columns of a table, and columns to choose from, that a message names.
_NAMED_COLUMNS = 20


def in_unit_of_file(name: str, value: float, units: Units) -> str:
    """A value [SI] of a column in the unit of the file, with that unit."""
    si = COLUMNS[name.removesuffix("_sd")].unit
    unit = units.get(name, si)
    return f"{value / factor_of(unit, si):.5g} {unit}".rstrip()


def missing_columns(
    cells: TableCells,
    present: Collection[str],
    option: str,
    rebound: bool,
) -> None:
    """Add faults of columns that are needed and not `present`; `option` is what `--columns` takes
    to read those of other names that may be meant. Without `rebound` incident columns suffice.
    """
    incident = counting_columns(present, "1")
    meant = f" (columns: {listed(cells.names, most=_NAMED_COLUMNS)})"
    if not incident and are_positions(cells):
        file = quote(cells.source) if cells.lines is not None else "of this table"
        meant = f"{meant}: for positions over time, fitball track {file}"
    else:
        meant = f"{meant}: rename those that are meant, or state them in [columns] of a scene"
    if option:
        meant = f': did you mean --columns "{option}"?'
    if incident not in INCIDENCES:
        read = f"read {listed(incident) or 'no incident velocity'}"
        forms = (
            "v_x1 and v_y1, or v_1 and theta_1; of a drop test v_y1 or drop_height; of successive "
            "bounces bounce_interval, bounce_time or peak_height"
        )
        cells.fault("no-incident", f"{read}; expected {forms}{meant}")
        # What is proposed was tried: nothing else is missing.
        rebound = rebound and not option
        meant = ""
    elif incident == ("v_y1",):
        for name in REBOUND:
            if name in present and COLUMNS[name].tangential:
                words = (
                    "motion along the court after the impact only; expected a column v_x1 (zeros "
                    "if the ball was dropped; a rebound speed straight up is v_y2)"
                )
                cells.fault("no-incident-motion", words, name)
    after = (*REBOUND, HEIGHTS[1], FLIGHTS[1], *RATIOS)
    if rebound and not any(name in present for name in after):
        forms = listed(after, "or", _NAMED_COLUMNS)
        cells.fault("no-rebound", f"no rebound column; expected one of {forms}{meant}")
    if "omega_2" in present and "omega_1" not in present:
        unknown = f"each incident spin is unknown, 0 ± {UNKNOWN_SPIN_SD:.0f} rad/s"
        of_zeros = "of balls without spin state a column omega_1 = 0"
        cells.note("no-incident-spin", f"no column omega_1: {unknown}; {of_zeros}")


def limits(cells: TableCells, numbers: Columns, units: Units) -> dict[str, FloatArray]:
    """The numbers, NaN in place of those that no ball and no instrument has, which are faults."""
    within = {}
    for name, values in numbers.items():
        column = COLUMNS[name.removesuffix("_sd")]
        low, high = column.limits
        if name == "v_y1" and "surface_speed" in numbers:
            # A racket hits a ball at rest, or one that flies away from it.
            low = -high
        if name.endswith("_sd"):
            low = 0.0
        # A speed, an angle or an sd of zero is none.
        too_low = values <= low if low == 0.0 else values < low
        bad = (values > high) | too_low
        unit = column.display_unit
        ends = f"{low * unit.factor:.4g} to {high * unit.factor:.4g} {unit.name}"
        if low == 0.0:
            ends = f"more than {ends}"
        for k in np.flatnonzero(bad).tolist():
            read = f"read {in_unit_of_file(name, float(values[k]), units)}"
            remedy = "check the unit and the sign"
            if values[k] == 0.0:
                remedy = "leave the cell empty if nothing was measured"
            words = f"{read}; expected {ends}: {remedy}"
            cells.fault("out-of-limits", words, name, k)
        within[name] = np.where(bad, np.nan, values)
    return within


def deviations(cells: TableCells, numbers: Columns) -> None:
    """Add faults of deviations without their column, and of measured cells without one in a column
    that states them.
    """
    for name, sds in numbers.items():
        if not name.endswith("_sd"):
            continue
        base = name.removesuffix("_sd")
        if base not in numbers:
            words = f"standard deviation of {base}, but there is no such column"
            cells.fault("sd-without-column", words, name)
            continue
        for k in np.flatnonzero(np.isnan(sds) & ~np.isnan(numbers[base])).tolist():
            words = (
                f"no sd of {base}; expected one in every measured row or in none: leave the column "
                f"out (--ignore {name})"
            )
            cells.fault("no-sd", words, name, k)


def _further(velocities: Columns, end: str) -> dict[str, FloatArray]:
    """What follows from the velocity of one `end` besides components, speed and angle, as columns
    (rows,), where both components are known.
    """
    if not velocities.keys() >= {*COMPONENTS[end]}:
        return {}
    components = [velocities[name] for name in COMPONENTS[end]]
    further = {}
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for name in velocity_columns(end):
            formula = COLUMNS[name].formula
            if formula is not None and name not in velocities:
                further[name] = formula(*components)
    return further


def redundant(cells: TableCells, numbers: Columns, units: Units) -> None:
    """Add faults and notes of velocity columns that contradict those which count, row by row."""
    for end in "12":
        names = counting_columns(numbers, end)
        determined = velocity({name: numbers[name] for name in names}, end)
        further = _further(determined, end)
        determined |= further
        basis = listed(names)
        for name, expected in determined.items():
            if name not in numbers or name in names:
                continue
            is_speed = COLUMNS[name].unit == "m/s"
            scale = np.abs(determined[f"v_{end}"] if is_speed else expected)
            if name in further:
                # It may be zero in some rows.
                scale = np.maximum(scale, np.nanmedian(scale))
            share = np.abs(numbers[name] - expected) / np.maximum(scale, 1e-12)
            for k in np.flatnonzero(share > _FAULTY_SHARE).tolist():
                read = in_unit_of_file(name, float(numbers[name][k]), units)
                other = in_unit_of_file(name, float(expected[k]), units)
                words = (
                    f"read {read}, but {basis} give {other}; expected agreement: check the "
                    "units and the row"
                )
                cells.fault("contradiction", words, name, k)
            _note_disagreement(cells, name, basis, share)
            if f"{name}_sd" in numbers:
                cells.note("sd-not-used", f"{name}_sd is not used: {basis} are")


def _note_disagreement(cells: TableCells, name: str, basis: str, share: FloatArray) -> None:
    """Note rows in which a column differs from those that count by a `share` (rows,) that errors
    may have.
    """
    rows = np.flatnonzero((share > _NOTED_SHARE) & (share <= _FAULTY_SHARE))
    if rows.size:
        word = "row" if rows.size == 1 else "rows"
        named = f"{word} {listed(cells.rows[rows].astype(str))}"
        where = f"{100.0 * float(share[rows].max()):.2g} % ({named})"
        words = f"{name} differs from {basis} by up to {where}; {basis} are used"
        cells.note("disagreement", words)
