"""A range of one quantity written in a line, such as `5:20`, `20:60 mph` or `-300:300:7`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import isfinite, pi

import numpy as np

from fitball.data.impact_text import SIZE
from fitball.data.limits import refuse_beyond
from fitball.data.units import Dimension, parse_unit
from fitball.errors import ParameterError, UnitError

_NUMBER = rf"[+-]?{SIZE}"
_RANGE = re.compile(
    rf"^\s*(?P<low>{_NUMBER})\s*(?::\s*(?P<high>{_NUMBER}))?\s*(?::\s*(?P<count>\d{{1,3}}))?\s*(?P<unit>[^:]*?)\s*$"
)
FORM = "expected LOW:HIGH, LOW:HIGH:COUNT or one VALUE, with a unit behind it if it is not the usual one"
QUANTITIES = {
    "speed": ("v_1", Dimension.SPEED), "angle": ("theta_1", Dimension.ANGLE), "spin": ("omega_1", Dimension.SPIN),
}  # fmt: skip


@dataclass(frozen=True)
class Range:
    """`low` to `high` in SI, in so many steps if a `count` was given."""

    low: float
    high: float
    count: int | None = None


def parse_range(quantity: str, text: str) -> Range:
    """The range of a quantity, one of `QUANTITIES`. Numbers without a unit are in m/s, degrees or rad/s.

    Raises ParameterError that quotes the text.
    """
    matched = _RANGE.match(" ".join(text.split()))
    if matched is None:
        raise ParameterError(f"{quantity} '{text}': {FORM}")
    try:
        unit = parse_unit(matched["unit"] or None, QUANTITIES[quantity][1])
    except UnitError as error:
        raise ParameterError(f"{quantity} '{text}': {error}") from None
    low = unit.to_si(float(matched["low"]))
    high = low if matched["high"] is None else unit.to_si(float(matched["high"]))
    count = None if matched["count"] is None else int(matched["count"])
    return checked_range(quantity, Range(low, high, count), f"{quantity} '{text}'")


def checked_range(quantity: str, given: Range, said: str) -> Range:
    """The range, if impacts can have it. Raises ParameterError that begins with what was `said`."""
    if not (isfinite(given.low) and isfinite(given.high)) or given.low > given.high:
        raise ParameterError(f"{said}: expected a range of finite numbers that rises")
    if given.count is not None and (given.count < 2 or given.low == given.high):
        raise ParameterError(f"{said}: expected two steps or more, from LOW to a HIGH above it")
    if quantity == "speed" and not given.low > 0.0:
        raise ParameterError(f"{said}: expected speeds above 0")
    if quantity == "angle" and not 0.0 < given.low <= given.high <= pi / 2.0 * (1.0 + 1e-12):
        raise ParameterError(f"{said}: expected angles to the court above 0 and up to 90 deg")
    try:
        refuse_beyond(QUANTITIES[quantity][0], np.array([given.low, given.high]))
    except ParameterError as error:
        raise ParameterError(f"{said}: {error}") from None
    return given
