"""Coordinates in which parameters are searched and sampled: the value, its logarithm, its logit."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fitball.base.values import FloatArray


@dataclass(frozen=True)
class Coordinate:
    """A coordinate `of` values between `lower` and `upper`, its inverse `value`, and `stretch`, the
    derivative of the value with the coordinate, from values; all of arrays of any shape. `levels`:
    spreads between levels are spreads of it.
    """

    name: str
    lower: float
    upper: float
    of: Callable[[FloatArray], FloatArray]
    value: Callable[[FloatArray], FloatArray]
    stretch: Callable[[FloatArray], FloatArray]
    levels: bool


def _same(values: FloatArray) -> FloatArray:
    """A copy of the values, which are their own coordinates."""
    return np.array(values, dtype=np.float64)


def _ones(values: FloatArray) -> FloatArray:
    """The derivative of values with themselves."""
    return np.ones(np.shape(values))


def _logit(values: FloatArray) -> FloatArray:
    """`ln(x/(1 - x))` of values x between 0 and 1."""
    from scipy.special import logit

    return np.asarray(logit(values))


def _expit(coordinates: FloatArray) -> FloatArray:
    """`1/(1 + exp(-q))` of coordinates q, the inverse of the logit."""
    from scipy.special import expit

    return np.asarray(expit(coordinates))


def _between(values: FloatArray) -> FloatArray:
    """`x (1 - x)`, the derivative of values x with their logit."""
    return np.asarray(values * (1.0 - np.asarray(values)))


VALUE = Coordinate("value", -np.inf, np.inf, _same, _same, _ones, levels=True)
LOGARITHM = Coordinate("natural logarithm", 0.0, np.inf, np.log, np.exp, _same, levels=True)
LOGIT = Coordinate("ln(x/(1 - x))", 0.0, 1.0, _logit, _expit, _between, levels=False)
