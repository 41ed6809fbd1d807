"""Families of priors, a class each; all else asks the class.

A family says in which coordinate its density is smooth and without walls, how far the log density
lies below its peak there, with slope and curvature, and which share of it lies below a place. A new
one is a class here, with its row in `FAMILIES`.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar, Self, TypeAlias

import numpy as np

from fitball.base.coordinates import LOGARITHM, LOGIT, VALUE, Coordinate
from fitball.base.values import FloatArray

DrawsOfPriors: TypeAlias = Annotated[FloatArray, "draws priors"]

# The widest sd of a logarithm that is knowledge of any kind.
WIDEST_LOG = 50.0
# Least shape of a gamma or beta density: with less, draws lie so close to an end that doubles
# cannot tell them from it. Its half is Jeffreys' prior of a proportion.
LEAST_SHAPE = 0.5
# Largest shape, an sd of a thousandth of the value: with more, the height of the peak is a
# difference of numbers so large that fewer than nine digits of it are left.
LARGEST_SHAPE = 1e6
# Quantiles from which the mean and sd of a truncated density are computed.
MOMENT_QUANTILES = 1000


@dataclass(frozen=True)
class Prior(ABC):
    """A density in a coordinate, truncated there to [`lower`, `upper`], which are `limits` in SI.

    It has the `numbers` of its `text`, as written; `source` is where it was published.

    A family has a `form`, how it is written; its `coordinate_kind`; `flat` where it has no slope,
    `normal` where it is a normal density in the coordinate; and `full_mass`, what `cdf` has
    without bounds.
    """

    form: ClassVar[str]
    coordinate_kind: ClassVar[Coordinate] = VALUE
    flat: ClassVar[bool] = False
    normal: ClassVar[bool] = False
    full_mass: ClassVar[float] = 1.0

    text: str
    numbers: tuple[float, ...]
    lower: float
    upper: float
    source: str = ""
    limits: tuple[float, float] = (-math.inf, math.inf)

    @classmethod
    @abstractmethod
    def fault(cls, numbers: tuple[float, ...]) -> str:
        """What the numbers, each of a size that can be squared, should be and are not; else ""."""

    @classmethod
    def span(cls, numbers: tuple[float, ...]) -> tuple[float, float]:
        """The ends of the density in SI, before the bounds of a parameter."""
        del numbers
        return -math.inf, math.inf

    @classmethod
    def support(cls, numbers: tuple[float, ...]) -> tuple[float, float]:
        """The ends of the density in its coordinate, before the bounds of a parameter."""
        return cls.span(numbers)

    @property
    @abstractmethod
    def location(self) -> float:
        """The coordinate of the peak of the density, be it within the bounds or not; of a flat one
        the middle.
        """

    @property
    @abstractmethod
    def width(self) -> float:
        """The sd of the coordinate before truncation, or what stands for it: steps of searches are
        counted in it.
        """

    @property
    @abstractmethod
    def peak(self) -> float:
        """The log density at `location`, with respect to the coordinate, before truncation."""

    @property
    @abstractmethod
    def constants(self) -> tuple[float, ...]:
        """What `deviance` and `pull` take beside coordinates."""

    @staticmethod
    @abstractmethod
    def deviance(q: DrawsOfPriors, *constants: Annotated[FloatArray, "priors"]) -> DrawsOfPriors:
        """Twice how far the log density at coordinates lies below its peak, of priors that have the
        same formula with other `constants`.
        """

    @staticmethod
    @abstractmethod
    def pull(
        q: DrawsOfPriors, *constants: Annotated[FloatArray, "priors"]
    ) -> tuple[DrawsOfPriors, DrawsOfPriors]:
        """Slope and curvature of minus the log density at coordinates. Where the density is not
        log-concave the curvature is that of the normal density that touches it and lies below.
        """

    @abstractmethod
    def cdf(self, q: FloatArray) -> FloatArray:
        """The share of the density below coordinates, before truncation."""

    @abstractmethod
    def ppf(self, shares: FloatArray) -> FloatArray:
        """Coordinates below which shares of the density lie, before truncation."""

    @classmethod
    def within(cls, text: str, numbers: tuple[float, ...], lower: float, upper: float) -> Self:
        """The prior of a parameter with closed bounds in SI; `share` says what they leave."""
        kind = cls.coordinate_kind
        with np.errstate(divide="ignore"):
            # A parameter that may be zero has a logarithm without lower end.
            ends = kind.of(np.clip([lower, upper], kind.lower, kind.upper))
        low, high = cls.support(numbers)
        least, largest = cls.span(numbers)
        return cls(
            text,
            numbers,
            max(float(ends[0]), low),
            min(float(ends[1]), high),
            limits=(max(lower, least), min(upper, largest)),
        )

    @property
    def log(self) -> bool:
        """Whether the coordinate is the natural logarithm."""
        return self.coordinate_kind == LOGARITHM

    @property
    def rate(self) -> float:
        """One over the width, zero of a flat density: deviations of a measured value weigh so."""
        return 0.0 if self.flat else 1.0 / self.width

    def coordinate(self, values: FloatArray) -> FloatArray:
        """Coordinates of values in SI, of any shape; `value` is the inverse."""
        return self.coordinate_kind.of(values)

    def value(self, coordinates: FloatArray) -> FloatArray:
        """Values in SI of coordinates, of any shape; `coordinate` is the inverse."""
        return self.coordinate_kind.value(coordinates)

    def stretch(self, values: FloatArray) -> FloatArray:
        """Derivatives of values in SI with their coordinates."""
        return self.coordinate_kind.stretch(values)

    @cached_property
    def height(self) -> float:
        """The log density at `location` after truncation, be the place within the bounds or not."""
        return self.peak - math.log(self.mass)

    def log_density(
        self, coordinates: Annotated[FloatArray, "..."]
    ) -> Annotated[FloatArray, "..."]:
        """The log density, normalised, with respect to the coordinate; -inf outside the bounds."""
        q = np.asarray(coordinates, dtype=np.float64)
        inside = (q >= self.lower) & (q <= self.upper)
        # Outside a formula may have no number.
        safe = np.where(inside, q, self.location)
        constants = [np.asarray(number) for number in self.constants]
        return np.where(inside, self.height - 0.5 * self.deviance(safe, *constants), -np.inf)

    @cached_property
    def mass(self) -> float:
        """What `cdf` has between the bounds."""
        return self._ends[1] - self._ends[0]

    @cached_property
    def share(self) -> float:
        """The share of the density that the bounds leave."""
        return self.mass / self.full_mass

    @cached_property
    def _ends(self) -> tuple[float, float]:
        """The shares of the density below both bounds."""
        low, high = (float(self.cdf(np.asarray(end))) for end in (self.lower, self.upper))
        return low, high

    def quantile(self, shares: FloatArray) -> FloatArray:
        """Values in SI, of any shape, below which these shares of the truncated density lie, none
        beyond its limits.
        """
        # The way back from the coordinate may step over a limit by one rounding.
        return np.clip(self.value(self._truncated_ppf(shares)), *self.limits)

    def coordinate_quantile(self, shares: FloatArray) -> FloatArray:
        """Coordinates, of any shape, below which these shares of the truncated density lie: draws
        are those of uniform shares.
        """
        # By the value, whose rounding the draws of a seed have always had.
        return self.coordinate(self.quantile(shares))

    def _truncated_ppf(self, shares: FloatArray) -> FloatArray:
        """Coordinates below which these shares of the truncated density lie, of any shape."""
        q = self.ppf(self._ends[0] + shares * self.mass)
        # Rounding may step over a bound.
        return np.clip(q, self.lower, self.upper)

    def even_values(self) -> Annotated[FloatArray, "values"]:
        """Values in SI at evenly spaced quantiles."""
        return self.quantile((np.arange(MOMENT_QUANTILES) + 0.5) / MOMENT_QUANTILES)

    def at_levels(self) -> "Prior":
        """What stands for it where a parameter has a value at each level: spreads between levels
        are those of values or their logarithms, so that another coordinate gives way to a normal
        density of values.
        """
        if self.coordinate_kind.levels:
            return self
        values = self.even_values()
        lower, upper = self.value(np.array([self.lower, self.upper])).tolist()
        numbers = (float(values.mean()), float(values.std()))
        return Normal(self.text, numbers, lower, upper, self.source)


class Bell(Prior):
    """A normal density in the coordinate, or one so wide that it is flat."""

    normal = True

    @property
    def peak(self) -> float:
        return -math.log(self.width) - 0.5 * math.log(2.0 * math.pi)

    @property
    def constants(self) -> tuple[float, ...]:
        """Location and rate."""
        return self.location, self.rate

    @staticmethod
    def deviance(q: FloatArray, *constants: FloatArray) -> FloatArray:
        location, rate = constants
        return np.asarray((rate * (q - location)) ** 2)

    @staticmethod
    def pull(q: FloatArray, *constants: FloatArray) -> tuple[FloatArray, FloatArray]:
        location, rate = constants
        curvature = np.broadcast_to(rate**2, q.shape)
        return curvature * (q - location), curvature

    def cdf(self, q: FloatArray) -> FloatArray:
        from scipy.special import ndtr

        return np.asarray(ndtr((q - self.location) / self.width))

    def ppf(self, shares: FloatArray) -> FloatArray:
        from scipy.special import ndtri

        return np.asarray(self.location + ndtri(shares) * self.width)


class Normal(Bell):
    """A value that is known to so much either way."""

    form = "normal(mean, sd)"

    @classmethod
    def fault(cls, numbers: tuple[float, ...]) -> str:
        return "" if numbers[1] > 0.0 else "with a positive width"

    @property
    def location(self) -> float:
        """The mean."""
        return self.numbers[0]

    @property
    def width(self) -> float:
        """The sd."""
        return self.numbers[1]


class LogNormal(Bell):
    """A positive value that is known to a factor."""

    form = "lognormal(median, sd of the natural logarithm)"
    coordinate_kind = LOGARITHM

    @classmethod
    def fault(cls, numbers: tuple[float, ...]) -> str:
        if min(numbers) <= 0.0:
            return "with a positive width, all positive"
        return "" if numbers[1] <= WIDEST_LOG else f"with a sd of at most {WIDEST_LOG:g}"

    @property
    def location(self) -> float:
        """The logarithm of the median."""
        return math.log(self.numbers[0])

    @property
    def width(self) -> float:
        """The sd of the logarithm."""
        return self.numbers[1]


class Uniform(Bell):
    """Any value between two ends, each as probable."""

    # `cdf` and `ppf` count in units of the coordinate.

    form = "uniform(lower, upper)"
    flat = True
    normal = False
    # However much the bounds cut off, what they leave is flat.
    share = 1.0
    peak = 0.0

    @classmethod
    def fault(cls, numbers: tuple[float, ...]) -> str:
        return "" if numbers[0] < numbers[1] else "with lower < upper"

    @classmethod
    def span(cls, numbers: tuple[float, ...]) -> tuple[float, float]:
        """Between both numbers."""
        return numbers[0], numbers[1]

    @property
    def location(self) -> float:
        """The middle."""
        return 0.5 * (self.lower + self.upper)

    @property
    def width(self) -> float:
        """The sd, truncation included."""
        return (self.upper - self.lower) / math.sqrt(12.0)

    def cdf(self, q: FloatArray) -> FloatArray:
        """The coordinate itself."""
        return q

    def ppf(self, shares: FloatArray) -> FloatArray:
        """The coordinate itself."""
        return shares


class LogUniform(Uniform):
    """A positive value of any order between two ends."""

    form = "loguniform(lower, upper)"
    coordinate_kind = LOGARITHM

    @classmethod
    def fault(cls, numbers: tuple[float, ...]) -> str:
        return "" if 0.0 < numbers[0] < numbers[1] else "with lower < upper, all positive"

    @classmethod
    def support(cls, numbers: tuple[float, ...]) -> tuple[float, float]:
        """Between the logarithms of both numbers."""
        return math.log(numbers[0]), math.log(numbers[1])


class Half(Prior):
    """The upper half of a density about zero: its first number is its scale."""

    # `cdf` is that of both sides.
    full_mass = 0.5
    location = 0.0

    @classmethod
    def fault(cls, numbers: tuple[float, ...]) -> str:
        return "" if min(numbers) > 0.0 else "with a positive width, all positive"

    @classmethod
    def span(cls, numbers: tuple[float, ...]) -> tuple[float, float]:
        """From zero."""
        del numbers
        return 0.0, math.inf

    @property
    def width(self) -> float:
        """The scale."""
        return self.numbers[0]


class HalfNormal(Half, Bell):
    """A size that may be zero and is hardly larger than a scale."""

    form = "half-normal(scale)"


class HalfT(Half):
    """A size that may be zero, is probably no larger than a scale, and may be much larger."""

    form = "half-t(scale, degrees of freedom)"

    @property
    def peak(self) -> float:
        from scipy.special import poch

        # Gamma(half + 1/2)/Gamma(half) at once: the logarithms of both cancel at many degrees of
        # freedom.
        scale, freedom = self.numbers
        return float(
            math.log(poch(0.5 * freedom, 0.5)) - 0.5 * math.log(math.pi * freedom) - math.log(scale)
        )

    @property
    def constants(self) -> tuple[float, ...]:
        """Rate and degrees of freedom."""
        return self.rate, self.numbers[1]

    @staticmethod
    def deviance(q: FloatArray, *constants: FloatArray) -> FloatArray:
        rate, freedom = constants
        return np.asarray((freedom + 1.0) * np.log1p((rate * q) ** 2 / freedom))

    @staticmethod
    def pull(q: FloatArray, *constants: FloatArray) -> tuple[FloatArray, FloatArray]:
        # The density is not log-concave.
        rate, freedom = constants
        weight = rate**2
        curvature = weight * ((freedom + 1.0) / (freedom + weight * q**2))
        return curvature * q, curvature

    def cdf(self, q: FloatArray) -> FloatArray:
        from scipy.special import stdtr

        scale, freedom = self.numbers
        return np.asarray(stdtr(freedom, q / scale))

    def ppf(self, shares: FloatArray) -> FloatArray:
        from scipy.special import stdtrit

        scale, freedom = self.numbers
        return np.asarray(stdtrit(freedom, shares) * scale)


class Gamma(Prior):
    """A positive value of mean shape times scale. In the logarithm the density is log-concave and
    finite, whatever the shape.
    """

    form = "gamma(shape, scale)"
    coordinate_kind = LOGARITHM

    @classmethod
    def fault(cls, numbers: tuple[float, ...]) -> str:
        if LEAST_SHAPE <= numbers[0] <= LARGEST_SHAPE and numbers[1] > 0.0:
            return ""
        return f"with a shape of {LEAST_SHAPE:g} to {LARGEST_SHAPE:g} and a positive scale"

    @property
    def location(self) -> float:
        """The logarithm of the mean."""
        shape, scale = self.numbers
        return math.log(shape) + math.log(scale)

    @property
    def width(self) -> float:
        """The sd of the logarithm."""
        from scipy.special import polygamma

        return math.sqrt(polygamma(1, self.numbers[0]))

    @property
    def peak(self) -> float:
        shape = self.numbers[0]
        return shape * math.log(shape) - shape - math.lgamma(shape)

    @property
    def constants(self) -> tuple[float, ...]:
        """Location and shape."""
        return self.location, self.numbers[0]

    @staticmethod
    def deviance(q: FloatArray, *constants: FloatArray) -> FloatArray:
        location, shape = constants
        away = q - location
        with np.errstate(over="ignore"):
            return np.asarray(2.0 * shape * (np.expm1(away) - away))

    @staticmethod
    def pull(q: FloatArray, *constants: FloatArray) -> tuple[FloatArray, FloatArray]:
        location, shape = constants
        away = q - location
        return shape * np.expm1(away), shape * np.exp(away)

    def cdf(self, q: FloatArray) -> FloatArray:
        from scipy.special import gammainc

        shape, scale = self.numbers
        return np.asarray(gammainc(shape, np.exp(q - math.log(scale))))

    def ppf(self, shares: FloatArray) -> FloatArray:
        from scipy.special import gammaincinv

        shape, scale = self.numbers
        with np.errstate(divide="ignore"):
            return np.asarray(math.log(scale) + np.log(gammaincinv(shape, shares)))


class Beta(Prior):
    """A value between zero and one, of mean a/(a + b). In the logit the density is log-concave and
    has no ends.
    """

    form = "beta(a, b)"
    coordinate_kind = LOGIT

    @classmethod
    def fault(cls, numbers: tuple[float, ...]) -> str:
        if min(numbers) >= LEAST_SHAPE and max(numbers) <= LARGEST_SHAPE:
            return ""
        return f"with both of {LEAST_SHAPE:g} to {LARGEST_SHAPE:g}"

    @property
    def location(self) -> float:
        """The logit of the mean."""
        return math.log(self.numbers[0] / self.numbers[1])

    @property
    def width(self) -> float:
        """The sd of the logit."""
        from scipy.special import polygamma

        return math.sqrt(polygamma(1, self.numbers).sum())

    @property
    def peak(self) -> float:
        from scipy.special import betaln

        a, b = self.numbers
        return float(a * math.log(a / (a + b)) + b * math.log(b / (a + b)) - betaln(a, b))

    @property
    def constants(self) -> tuple[float, ...]:
        """Both numbers."""
        return self.numbers

    @staticmethod
    def deviance(q: FloatArray, *constants: FloatArray) -> FloatArray:
        a, b = constants
        away = q - np.log(a / b)
        above = away > 0.0
        # Mirrored above the peak, so that the exponential has no overflow.
        size = np.abs(away)
        share = np.where(above, b, a) / (a + b)
        fall = np.where(above, b, a) * size + (a + b) * np.log1p(share * np.expm1(-size))
        return np.asarray(2.0 * fall)

    @staticmethod
    def pull(q: FloatArray, *constants: FloatArray) -> tuple[FloatArray, FloatArray]:
        from scipy.special import expit

        a, b = constants
        below = expit(q)
        return np.asarray((a + b) * below - a), np.asarray((a + b) * below * expit(-q))

    def cdf(self, q: FloatArray) -> FloatArray:
        from scipy.special import betainc, expit

        a, b = self.numbers
        return np.asarray(betainc(a, b, expit(q)))

    def ppf(self, shares: FloatArray) -> FloatArray:
        from scipy.special import betaincinv

        a, b = self.numbers
        with np.errstate(divide="ignore"):
            # Each end from its own side keeps the digits there.
            above = betaincinv(b, a, 1.0 - shares)
            return np.asarray(np.log(betaincinv(a, b, shares)) - np.log(above))

    def coordinate_quantile(self, shares: FloatArray) -> FloatArray:
        # Not by the value: one that rounds to 1 has a finite logit all the same.
        return self._truncated_ppf(shares)


# By the name with which it is written.
FAMILIES: Mapping[str, type[Prior]] = {
    family.form.partition("(")[0]: family
    for family in (
        Normal,
        LogNormal,
        Uniform,
        LogUniform,
        HalfNormal,
        HalfT,
        Gamma,
        Beta,
    )
}
