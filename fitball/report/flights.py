"""How pages speak of speeds that were measured as heights or times of flights."""

from __future__ import annotations

import numpy as np

from fitball.base import air
from fitball.base.columns import COLUMNS
from fitball.base.display_units import CM, MS
from fitball.inference.fitted import Fitted
from fitball.inference.judgement.adequacy_words import of_size
from fitball.report.quantities import column_unit


def measured_as(fit: Fitted, column: str) -> str:
    """The column of the table that a measured column was made from, else that itself."""
    fall = fit.problem.fall
    return column if fall is None else fall.measured(column)


def size_as(fit: Fitted, column: str) -> str:
    """What has a size in the unit of a column: it, or the speed of a height or a time."""
    return of_size(column, measured_as(fit, column))


def symbol_as(fit: Fitted, column: str) -> str:
    """The symbol of a measured column, with that of a height or a time that it was made from."""
    measured = measured_as(fit, column)
    symbol = COLUMNS[column].symbol
    return symbol if measured == column else f"{symbol} of {COLUMNS[measured].symbol}"


def scatter_as(fit: Fitted, column: str, sd: float) -> str:
    """The sd of a measured column with its name; of a speed [m/s] that was made from heights or
    times as that of their median, with that of the speed in brackets.
    """
    unit = column_unit(column)
    size = unit.with_unit(unit.number(sd, 2))
    measured = measured_as(fit, column)
    fall = fit.problem.fall
    if measured == column or fall is None:
        return f"{column} {size}"
    speed = float(np.nanmedian(fit.run.table.values[column]))
    ends = np.array([max(speed - sd, 0.0), speed + sd])
    of_speeds, unit = air.flight_time, MS
    if measured == "rebound_height":
        of_speeds, unit = air.rebound_height, CM
    low, high = of_speeds(ends, fall.usual * fall.braking).tolist()
    return f"{measured} {unit.with_unit(unit.number(0.5 * (high - low), 2))} ({size} as a speed)"
