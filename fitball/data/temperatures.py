"""The column of ball temperatures: printed in certificates, used in no fit."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from fitball.data.cells import Findings, Texts
from fitball.data.columns import BALL_TEMPERATURE
from fitball.data.numbers import absent, plain_numbers
from fitball.data.scene_keys import SIZES
from fitball.data.table import frozen
from fitball.values import FloatArray

# Degrees Celsius of a number in other units: factor, and what is added.
_CELSIUS, _FAHRENHEIT, _KELVIN = (1.0, 0.0), (5.0 / 9.0, -160.0 / 9.0), (1.0, -273.15)
_UNITS: Mapping[str, tuple[float, float]] = {
    "": _CELSIUS, "c": _CELSIUS, "celsius": _CELSIUS, "f": _FAHRENHEIT, "fahrenheit": _FAHRENHEIT, "k": _KELVIN,
    "kelvin": _KELVIN,
}  # fmt: skip
ALLOWED = SIZES["ball.temperature"]


def ball_temperatures(texts: Mapping[str, Texts], unit: str | None, found: Findings) -> FloatArray | None:
    """The temperatures of the ball (impacts,) in degrees Celsius, NaN in empty cells; None without such a column, and
    for one that is empty. A fault for each cell that is no temperature, and for an unknown unit.
    """
    cells = texts.get(BALL_TEMPERATURE)
    if cells is None:
        return None
    spelled = re.sub(r"degrees?|deg|[°º\s._]", "", (unit or "").casefold())
    if spelled not in _UNITS:
        found.header_fault(f"read unit '[{unit}]'; expected degC, degF or K", BALL_TEMPERATURE)
        return None
    factor, shift = _UNITS[spelled]
    numbers, _ = plain_numbers({BALL_TEMPERATURE: cells})
    values = np.full(len(cells), np.nan)
    for k, cell in enumerate(numbers[BALL_TEMPERATURE]):
        if absent(cell):
            continue
        try:
            values[k] = factor * float(cell) + shift
        except ValueError:
            values[k] = np.nan
        if not ALLOWED.least <= values[k] <= ALLOWED.most:
            words = ALLOWED.words.replace("degrees Celsius", "degC")
            found.fault(
                f"read '{cells[k]}'; expected a temperature of {words}, or an empty cell", BALL_TEMPERATURE, k
            )
    if np.isnan(values).all():
        return None
    found.notice(f"{BALL_TEMPERATURE} is printed in the certificate and not used in the fit", BALL_TEMPERATURE)
    return frozen(values)
