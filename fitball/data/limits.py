"""Numbers that no impact of a ball has, whatever ball and court: a wrong unit or a slip of a digit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitball.data.columns import NUMBERS, SD_SUFFIX
from fitball.data.findings import Findings
from fitball.data.number_column import NumberColumn
from fitball.data.units import UNITS, Dimension, symbols
from fitball.errors import ParameterError
from fitball.values import FloatArray


@dataclass(frozen=True)
class Limit:
    """A quantity is `least` to `most` [SI] in size; `words` say so in units that people use."""

    least: float
    most: float
    words: str


# Ten times the fastest serve and the fastest spins of any ball game, and more; contacts last from a fifth of a
# millisecond (hard spheres of some centimetres) to some tens (soft balls).
LIMITS: Mapping[Dimension, Limit] = {
    Dimension.SPEED: Limit(0.0, 1000.0, "at most 1000 m/s"),
    Dimension.SPIN: Limit(0.0, 1.0e5, "at most 1e5 rad/s"),
    Dimension.TIME: Limit(1.0e-4, 0.1, "0.1 to 100 ms"),
    # Higher up a ball falls at its terminal speed.
    Dimension.LENGTH: Limit(1.0e-3, 50.0, "1 mm to 50 m"),
}
# Of standard deviations: no instrument is as good as the least.
SD_LIMITS: Mapping[Dimension, Limit] = {
    Dimension.SPEED: Limit(1.0e-9, 1000.0, "1e-9 to 1000 m/s"),
    Dimension.SPIN: Limit(1.0e-9, 1.0e5, "1e-9 to 1e5 rad/s"),
    Dimension.ANGLE: Limit(1.0e-9, np.pi, "1e-9 rad to 180 deg"),
    Dimension.TIME: Limit(1.0e-12, 0.1, "1e-12 s to 100 ms"),
    Dimension.LENGTH: Limit(1.0e-9, 50.0, "1e-9 to 50 m"),
}
# Of these columns instead. A ball that does not come says nothing of a bounce; too large an angle is no matter of
# units alone, and the check of ranges tells.
NAMED: Mapping[str, Limit] = {
    **dict.fromkeys(("v_1", "v_y1"), Limit(1.0e-3, 1000.0, "0.001 to 1000 m/s")),
    "theta_1": Limit(1.0e-4, np.inf, "at least 0.006 deg"),
    "theta_2": Limit(0.0, np.inf, ""),
}


def _limit(name: str) -> Limit:
    kind = NUMBERS[name]
    if name.endswith(SD_SUFFIX):
        return SD_LIMITS[kind]
    return NAMED[name] if name in NAMED else LIMITS[kind]


def beyond_limit(name: str, values: FloatArray) -> NDArray[np.bool_]:
    """Where `values` [SI] of a quantity, or of its sd, cannot be (same shape).

    What is zero or negative is left to checks that say why it may not be.
    """
    limit, size = _limit(name), np.abs(values)
    beyond: NDArray[np.bool_] = (size > limit.most) | ((size > 0.0) & (size < limit.least))
    return beyond


def within_limits(columns: Mapping[str, NumberColumn], found: Findings) -> dict[str, NumberColumn]:
    """The columns with NaN and a fault for every number beyond the limit of its quantity.

    NaN, so that no later check draws conclusions from it.
    """
    kept = dict(columns)
    for name, column in columns.items():
        beyond = beyond_limit(name, column.values)
        if not beyond.any():
            continue
        kept[name] = replace(column, values=np.where(beyond, np.nan, column.values))
        meant = _meant(column)
        for k in np.flatnonzero(beyond).tolist():
            read = f"read {column.shown(column.values[k])}; expected {_limit(name).words}"
            found.fault(f"{read}: check the unit and the digits{meant}", name, k)
    return kept


def _meant(column: NumberColumn) -> str:
    """A question, where a single other unit makes every number of a column one that can be."""
    units = [UNITS[symbol] for symbol in symbols(column.unit.dimension)]
    with np.errstate(over="ignore"):
        written = column.unit.from_si(column.values[np.isfinite(column.values)])
        fitting = [unit.symbol for unit in units if not beyond_limit(column.name, unit.to_si(written)).any()]
    return f"; did you mean '{column.name} [{fitting[0]}]' in the header?" if len(fitting) == 1 else ""


def refuse_beyond(name: str, values: FloatArray) -> None:
    """Raise ParameterError for a quantity of an option's text that no impact has; `values` in SI."""
    if beyond_limit(name, values).any():
        raise ParameterError(f"{name}: expected {_limit(name).words}: check the unit and the digits")
