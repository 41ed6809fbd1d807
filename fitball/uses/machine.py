"""What a machine can be set to: the units of a table, round numbers within its range."""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil, floor, log10
from typing import Annotated

import numpy as np

from fitball.base import air
from fitball.base.columns import COLUMNS
from fitball.base.display_units import CM
from fitball.base.numbers import Unit
from fitball.base.text import from_pairs
from fitball.base.units import factor_of
from fitball.base.values import FloatArray
from fitball.data.heights import usual_braking
from fitball.inference.fitted import Fitted
from fitball.inference.problem.fall import fall_of

# Columns whose unit is that of a setting, the first that the table has.
_SAME_UNIT: Mapping[str, tuple[str, ...]] = {
    "v_1": ("v_1", "v_x1", "v_y1"),
    "theta_1": ("theta_1", "theta_2"),
    "omega_1": ("omega_1", "omega_2"),
}
# The setting of drops from heights, and what is read of them.
HEIGHT = "drop_height"
REBOUND_HEIGHT = "rebound_height"
# Round numbers are these times a power of ten.
_ROUND = (1.0, 2.0, 5.0)
# Share of the spacing of settings that is a round number's distance to the next at most.
_SHARE_OF_SPACING = 0.5
# Share of a distance that is rounding.
_ROUNDING = 1e-9


def machine_units(fit: Fitted) -> dict[str, Unit]:
    """The units in which speed, angle and spin are set, and columns of the table are filled in, by
    column: those of the table, else those that people read. Drops from heights have these in cm.
    """
    read = fit.run.table.read
    symbols = from_pairs(read[0].get("units", "")) if read else {}
    units = {
        name: _unit_of(symbol, COLUMNS[name].unit)
        for name, symbol in symbols.items()
        if name in COLUMNS and COLUMNS[name].unit
    }
    for name, columns in _SAME_UNIT.items():
        column = COLUMNS[name]
        symbol = next((symbols[other] for other in columns if other in symbols), "")
        units[name] = column.display_unit
        if symbol and column.unit:
            units[name] = _unit_of(symbol, column.unit)
    fall = fall_of(fit.run.table, fit.run.scene)
    tangential = fit.problem.forward.model.tangential
    if not tangential and fall is not None and bool(fall.dropped.all()):
        units[HEIGHT] = CM
        if fall.risen.all():
            units[REBOUND_HEIGHT] = CM
    return units


def _unit_of(symbol: str, si: str) -> Unit:
    """The unit with a symbol, of the SI unit `si`."""
    factor = 1.0 / factor_of(symbol, si)
    return Unit(symbol, factor)


def round_steps(
    low: float,
    high: float,
    count: int,
    unit: Unit,
) -> Annotated[FloatArray, "steps"]:
    """At most so many values from `low` to `high`, in SI, evenly spread, each a round number in the
    unit; as they are where the range has no two round numbers.
    """
    shown = np.linspace(low, high, count) * unit.factor
    spacing = (shown[-1] - shown[0]) / max(count - 1, 1)
    if not spacing > 0.0:
        return np.array([low])
    step = _round_below(_SHARE_OF_SPACING * spacing)
    first = ceil(shown[0] / step - _ROUNDING)
    last = floor(shown[-1] / step + _ROUNDING)
    places = np.unique(np.clip(np.round(shown / step), first, last))
    if first >= last:
        return np.linspace(low, high, count)
    return np.asarray(places * step / unit.factor)


def _round_below(value: float) -> float:
    """The largest round number that is at most a positive value."""
    power = 10.0 ** floor(log10(value) + _ROUNDING)
    return max(number * power for number in _ROUND if number * power <= value * (1.0 + _ROUNDING))


def speeds_of_heights(fit: Fitted, count: int) -> Annotated[FloatArray, "steps"]:
    """Landing speeds [m/s] of drops from round heights within those of the table."""
    braking = usual_braking(fit.run.scene)
    measured = fit.run.table.impacts.v_y1
    heights = air.drop_height(np.array([measured.min(), measured.max()]), braking)
    return air.landing_speed(round_steps(heights[0], heights[1], count, CM), braking)


def heights_of(fit: Fitted, speeds: FloatArray) -> FloatArray:
    """Heights [m] from which a ball lands at these speeds [m/s]."""
    return air.drop_height(speeds, usual_braking(fit.run.scene))
