"""How pages speak of speeds that were measured as heights or times of flights."""

from __future__ import annotations

import numpy as np

from fitball.base import air
from fitball.base.columns import COLUMNS
from fitball.base.display_units import CM
from fitball.inference.fitted import Fitted

# The only measured column that a height or a time says.
_SPEED = "v_y2"


def measured_as(fit: Fitted, column: str) -> str:
    """A measured column by its name, after that of the table where it was a height or a time."""
    measured = _measured(fit, column)
    return column if measured == column else f"{measured}, as {column}"


def symbol_as(fit: Fitted, column: str) -> str:
    """The symbol of a measured column, with that of a height or a time that it was made from."""
    measured = _measured(fit, column)
    symbol = COLUMNS[column].symbol
    return symbol if measured == column else f"{symbol} of {COLUMNS[measured].symbol}"


def _measured(fit: Fitted, column: str) -> str:
    """The column of the table that a measured column was made from, else that itself."""
    fall = fit.problem.fall
    if column == _SPEED and fall is not None:
        if fall.risen.all():
            return "rebound_height"
        if fall.flown_out.all():
            return "flight_time_2"
    return column


def in_height(fit: Fitted, column: str, sd: float) -> str:
    """The sd of a speed [m/s] as that of the median rebound height, in brackets; "" where no height
    was measured.
    """
    fall = fit.problem.fall
    if column != _SPEED or fall is None or not fall.risen.all():
        return ""
    speed = float(np.nanmedian(fit.run.table.values[_SPEED]))
    braking = fall.usual * fall.braking
    low, high = (float(air.rebound_height(speed + side * sd, braking)) for side in (-1.0, 1.0))
    return f" ({CM.with_unit(CM.number(0.5 * (high - low), 2))} of height)"
