"""Priors: proper one-dimensional densities, truncated by the bounds of their parameter."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri

from fitball.errors import ParameterError, suggestion
from fitball.values import FloatArray

FORM = re.compile(r"^\s*([A-Za-z_]+)\s*\(([^()]*)\)\s*$")
# No quantity is larger or smaller than these, nor its logarithm less known; beyond, quantiles leave the doubles.
SMALLEST, LARGEST, WIDEST_LOG = 1.0e-100, 1.0e100, 50.0
LOG_ROOT_TAU = 0.5 * math.log(2.0 * math.pi)


@dataclass(frozen=True)
class Prior:
    """A uniform or normal density of `x`, or of `ln x` when `log`, truncated to [lower, upper].

    For a normal one `a`, `b` are its mean and sd (of `ln x` when `log`); for a uniform one its ends. `text` is
    how it was written.
    """

    text: str
    normal: bool
    log: bool
    a: float
    b: float
    lower: float
    upper: float

    def coordinate(self, x: FloatArray) -> FloatArray:
        """The coordinate in which the density has its shape: `ln x` or `x`."""
        return np.log(x) if self.log else x

    def value(self, coordinate: FloatArray) -> FloatArray:
        """Inverse of `coordinate`."""
        return np.exp(coordinate) if self.log else coordinate

    @property
    def ends(self) -> tuple[float, float]:
        """Coordinates of the truncation; a log prior on [0, ...) begins at minus infinity."""
        if not self.log:
            return self.lower, self.upper
        return (math.log(self.lower) if self.lower > 0.0 else -math.inf), math.log(self.upper)

    @property
    def _scaled_ends(self) -> tuple[float, float]:
        low, high = self.ends
        return (low - self.a) / self.b, (high - self.a) / self.b

    def log_density(self, coordinate: FloatArray) -> FloatArray:
        """Log density with respect to `coordinate`, normalised, -inf outside the bounds."""
        low, high = self.support
        z = (coordinate - self.a) / self.b if self.normal else np.zeros(np.shape(coordinate))
        return np.where((coordinate >= low) & (coordinate <= high), -0.5 * z * z - self.log_scale, -np.inf)

    @property
    def support(self) -> tuple[float, float]:
        """Coordinates between which the density is positive."""
        low, high = self.ends
        return (low, high) if self.normal else (max(low, self.a), min(high, self.b))

    @property
    def width(self) -> float:
        """A length along the coordinate: the sd of a normal prior, the range of a uniform one."""
        return self.b if self.normal else self.b - self.a

    @property
    def variance(self) -> float:
        """Variance of the coordinate, from evenly spaced quantiles."""
        levels = (np.arange(2000) + 0.5) / 2000
        return float(np.var(self.coordinate(self.quantile(levels))))

    @property
    def log_scale(self) -> float:
        """Minus the log density at the peak."""
        low, high = self.support
        return LOG_ROOT_TAU + math.log(self.b) + self._log_mass if self.normal else math.log(high - low)

    @property
    def _log_mass(self) -> float:
        low, high = self._scaled_ends
        if low > 0.0:
            low, high = -high, -low
        upper, lower = float(log_ndtr(high)), float(log_ndtr(low))
        return upper + math.log1p(-math.exp(lower - upper))

    def quantile(self, probability: FloatArray) -> FloatArray:
        """Values of the parameter at the given probabilities."""
        if self.normal:
            low, high = self._scaled_ends
            # In the upper tail the probabilities are counted from above, where they keep their digits.
            side = -1.0 if low > 0.0 else 1.0
            first, last = float(ndtr(side * low)), float(ndtr(side * high))
            coordinate = self.a + side * self.b * ndtri(first + probability * (last - first))
        else:
            low, high = self.support
            coordinate = low + probability * (high - low)
        low, high = self.ends
        # Rounding of the inverse may step over a bound by one unit in the last place.
        return self.value(np.minimum(np.maximum(coordinate, low), high))

    def draw(self, rng: np.random.Generator, size: int) -> FloatArray:
        """`size` independent values."""
        return self.quantile(rng.uniform(size=size))


def _uniform(x: list[float]) -> tuple[bool, bool, float, float]:
    return False, False, x[0], x[1]


def _loguniform(x: list[float]) -> tuple[bool, bool, float, float]:
    return False, True, math.log(x[0]), math.log(x[1])


def _normal(x: list[float]) -> tuple[bool, bool, float, float]:
    return True, False, x[0], x[1]


def _lognormal(x: list[float]) -> tuple[bool, bool, float, float]:
    return True, True, math.log(x[0]), x[1]


FAMILIES: Mapping[str, tuple[str, Callable[[list[float]], tuple[bool, bool, float, float]]]] = {
    "uniform": ("uniform(lower, upper)", _uniform),
    "loguniform": ("loguniform(lower, upper), both positive", _loguniform),
    "normal": ("normal(mean, sd)", _normal),
    "lognormal": ("lognormal(median, sd of the natural logarithm)", _lognormal),
}


def parse_prior(name: str, text: str, lower: float, upper: float, unit: str = "") -> Prior:
    """Read a prior such as `normal(0.55, 0.05)` for the parameter `name` with bounds [lower, upper].

    Raises ParameterError when the form, the family or a number is wrong, or when the bounds leave the prior
    no mass.
    """
    matched = FORM.match(text)
    if matched is None:
        raise ParameterError(f"prior of {name}: read '{text}', expected a form such as normal(0.55, 0.05)")
    family = matched.group(1).lower()
    if family not in FAMILIES:
        raise ParameterError(f"prior of {name}: unknown family '{matched.group(1)}': {suggestion(family, FAMILIES)}")
    form, build = FAMILIES[family]
    try:
        numbers = [float(part) for part in matched.group(2).split(",")]
    except ValueError:
        raise ParameterError(f"prior of {name}: read '{text}', expected numbers: {form}") from None
    if len(numbers) != 2 or not all(math.isfinite(number) for number in numbers):
        raise ParameterError(f"prior of {name}: read '{text}', expected two finite numbers: {form}")
    if not all(number == 0.0 or SMALLEST <= abs(number) <= LARGEST for number in numbers):
        raise ParameterError(
            f"prior of {name}: read '{text}', expected numbers of {SMALLEST:g} to {LARGEST:g} in size"
        )
    if family == "lognormal" and numbers[1] > WIDEST_LOG:
        raise ParameterError(f"prior of {name}: read '{text}', expected {form} with a sd of at most {WIDEST_LOG:g}")
    ordered = numbers[0] < numbers[1] if family.endswith("uniform") else numbers[1] > 0.0
    if not ordered or (family.startswith("log") and numbers[0] <= 0.0):
        raise ParameterError(f"prior of {name}: read '{text}', expected {form} with lower < upper and sd > 0")
    normal, log, a, b = build(numbers)
    if log and upper <= 0.0:
        raise ParameterError(f"prior of {name}: {text} is positive but the bounds are [{lower:g}, {upper:g}] {unit}")
    prior = Prior(text.strip(), normal, log, a, b, lower, upper)
    low, high = prior.ends
    if normal:
        empty = not math.isfinite(prior._log_mass) if _has_mass(prior) else True
    else:
        empty = max(low, a) >= min(high, b)
    if empty:
        raise ParameterError(
            f"prior of {name}: {text} has no mass within the bounds [{lower:g}, {upper:g}]"
            + (f" {unit}" if unit else "")
            + "; change the prior"
        )
    return prior


def _has_mass(prior: Prior) -> bool:
    """Whether a normal prior keeps at least 1e-12 of its mass within its bounds."""
    low, high = prior._scaled_ends
    if low > 0.0:
        low, high = -high, -low
    return float(ndtr(high) - ndtr(low)) > 1e-12
