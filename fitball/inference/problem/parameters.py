"""Which parameters a fit has: free with a prior, or fixed at a value. Priors are proper one-dimensional densities,
truncated by the bounds of their parameter: uniform, normal, or Student's t.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import exprel, gammaln, log_ndtr, ndtr, ndtri, stdtr, stdtrit

from fitball.errors import ParameterError, suggestion
from fitball.inference.problem.noise import KINDS
from fitball.models.kernels.dual import NumberArray
from fitball.models.specs import POSITIVE, ParameterSpec
from fitball.observables import OBSERVABLES, SHARED_NOISE, SHARED_SD, ColumnNoise
from fitball.values import FloatArray

FORM = re.compile(r"^\s*([A-Za-z_-]+)\s*\(([^()]*)\)\s*$")
# No quantity is larger or smaller than these, nor its logarithm less known; beyond, quantiles leave the doubles.
SMALLEST, LARGEST, WIDEST_LOG = 1.0e-100, 1.0e100, 50.0
LOG_ROOT_TAU = 0.5 * math.log(2.0 * math.pi)


def tailed(square: FloatArray, freedom: float | FloatArray) -> FloatArray:
    """Minus twice the log density of Student's t, but for a constant, at a `square` of a distance in scales."""
    return np.asarray((freedom + 1.0) * np.log1p(square / freedom))


@dataclass(frozen=True)
class Prior:
    """A density of `x`, or of `ln x` when `log`, truncated to [lower, upper]: uniform, or a bell.

    A bell (`bell`) is normal, or Student's t where its degrees of `freedom` are finite; `a`, `b` are its centre and
    scale (of `ln x` when `log`), of a normal one mean and sd. For a uniform one they are its ends. `text` is how it
    was written.
    """

    text: str
    bell: bool
    log: bool
    a: float
    b: float
    lower: float
    upper: float
    freedom: float = math.inf

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
        z = (coordinate - self.a) / self.b if self.bell else np.zeros(np.shape(coordinate))
        square = z * z if math.isinf(self.freedom) else tailed(z * z, self.freedom)
        return np.where((coordinate >= low) & (coordinate <= high), -0.5 * square - self.log_scale, -np.inf)

    def residual(self, coordinate: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The residual of a bell, half of whose square is minus its log density but for a constant, and its
        derivative.
        """
        z = (coordinate - self.a) / self.b
        if math.isinf(self.freedom):
            return z, np.full(np.shape(z), 1.0 / self.b)
        # ln(1 + u)/u, which is one at u = 0.
        share = 1.0 / exprel(np.log1p(z * z / self.freedom))
        root = np.sqrt((self.freedom + 1.0) / self.freedom * share)
        return z * root, (self.freedom + 1.0) / (self.freedom + z * z) / root / self.b

    @property
    def support(self) -> tuple[float, float]:
        """Coordinates between which the density is positive."""
        low, high = self.ends
        return (low, high) if self.bell else (max(low, self.a), min(high, self.b))

    @property
    def width(self) -> float:
        """A length along the coordinate: the scale of a bell, the range of a uniform prior."""
        return self.b if self.bell else self.b - self.a

    @property
    def variance(self) -> float:
        """Variance of the coordinate, from evenly spaced quantiles."""
        levels = (np.arange(2000) + 0.5) / 2000
        return float(np.var(self.coordinate(self.quantile(levels))))

    @property
    def log_scale(self) -> float:
        """Minus the log density at the peak."""
        low, high = self.support
        if not self.bell:
            return math.log(high - low)
        half = 0.5 * self.freedom
        level = (
            LOG_ROOT_TAU
            if math.isinf(half)
            else float(gammaln(half) - gammaln(half + 0.5) + 0.5 * math.log(math.pi * self.freedom))
        )
        return level + math.log(self.b) + self._log_mass

    @property
    def _lower_ends(self) -> tuple[float, float]:
        """The ends of a bell, mirrored where both lie in the upper tail."""
        low, high = self._scaled_ends
        return (-high, -low) if low > 0.0 else (low, high)

    @property
    def has_mass(self) -> bool:
        """Whether the bounds leave anything of it: of a bell at least 1e-12."""
        if not self.bell:
            return self.support[0] < self.support[1]
        low, high = self._lower_ends
        return self.below(high) - self.below(low) > 1e-12 and math.isfinite(self._log_mass)

    def below(self, z: float) -> float:
        """Probability of less than `z` scales from the centre of a bell that nothing truncates."""
        return float(ndtr(z) if math.isinf(self.freedom) else stdtr(self.freedom, z))

    @property
    def _log_mass(self) -> float:
        low, high = self._lower_ends
        if math.isfinite(self.freedom):
            # Tails of Student's t stay within the doubles.
            return math.log(self.below(high) - self.below(low))
        upper, lower = float(log_ndtr(high)), float(log_ndtr(low))
        return upper + math.log1p(-math.exp(lower - upper))

    def quantile(self, probability: FloatArray) -> FloatArray:
        """Values of the parameter at the given probabilities."""
        if self.bell:
            low, high = self._scaled_ends
            # In the upper tail the probabilities are counted from above, where they keep their digits.
            side = -1.0 if low > 0.0 else 1.0
            first, last = self.below(side * low), self.below(side * high)
            among = first + probability * (last - first)
            inverse = ndtri(among) if math.isinf(self.freedom) else stdtrit(self.freedom, among)
            coordinate = self.a + side * self.b * inverse
        else:
            low, high = self.support
            coordinate = low + probability * (high - low)
        low, high = self.ends
        # Rounding of the inverse may step over a bound by one unit in the last place.
        return self.value(np.minimum(np.maximum(coordinate, low), high))

    def draw(self, rng: np.random.Generator, size: int) -> FloatArray:
        """`size` independent values."""
        return self.quantile(rng.uniform(size=size))


@dataclass(frozen=True)
class Family:
    """How a prior is written, in so many `numbers`; whether it is a `bell`, of the logarithm, and only its upper
    `half`, about zero.
    """

    form: str
    bell: bool = False
    log: bool = False
    half: bool = False
    numbers: int = 2


FAMILIES: Mapping[str, Family] = {
    "uniform": Family("uniform(lower, upper)"),
    "loguniform": Family("loguniform(lower, upper), both positive", log=True),
    "normal": Family("normal(mean, sd)", bell=True),
    "lognormal": Family("lognormal(median, sd of the natural logarithm)", bell=True, log=True),
    "half-normal": Family("half-normal(scale)", bell=True, half=True, numbers=1),
    "half-t": Family("half-t(scale, degrees of freedom)", bell=True, half=True),
}


def parse_prior(name: str, text: str, lower: float, upper: float, unit: str = "") -> Prior:
    """Read a prior such as `normal(0.55, 0.05)` for the parameter `name` with bounds [lower, upper].

    Raises ParameterError when the form, the family or a number is wrong, or when the bounds leave the prior
    no mass.
    """
    matched = FORM.match(text)
    if matched is None:
        raise ParameterError(f"prior of {name}: read '{text}', expected a form such as normal(0.55, 0.05)")
    family = FAMILIES.get(matched.group(1).lower())
    if family is None:
        hint = suggestion(matched.group(1).lower(), FAMILIES)
        raise ParameterError(f"prior of {name}: unknown family '{matched.group(1)}': {hint}")
    numbers = _numbers(name, text, matched.group(2), family)
    if family.log and upper <= 0.0:
        raise ParameterError(f"prior of {name}: {text} is positive but the bounds are [{lower:g}, {upper:g}] {unit}")
    freedom = math.inf
    if family.half:
        freedom = numbers[1] if family.numbers == 2 else math.inf
        numbers, lower = [0.0, numbers[0]], max(lower, 0.0)
    a, b = numbers
    if family.log:
        a, b = math.log(a), b if family.bell else math.log(b)
    prior = Prior(text.strip(), family.bell, family.log, a, b, lower, upper, freedom)
    if not prior.has_mass:
        raise ParameterError(
            f"prior of {name}: {text} has no mass within the bounds [{lower:g}, {upper:g}]"
            + (f" {unit}" if unit else "")
            + "; change the prior"
        )
    return prior


def _numbers(name: str, text: str, written: str, family: Family) -> list[float]:
    """The numbers of a prior. Raises ParameterError for those that its family cannot have."""
    form = family.form
    try:
        numbers = [float(part) for part in written.split(",")]
    except ValueError:
        raise ParameterError(f"prior of {name}: read '{text}', expected numbers: {form}") from None
    if len(numbers) != family.numbers or not all(math.isfinite(number) for number in numbers):
        count = "two finite numbers" if family.numbers == 2 else "one finite number"
        raise ParameterError(f"prior of {name}: read '{text}', expected {count}: {form}")
    if not all(number == 0.0 or SMALLEST <= abs(number) <= LARGEST for number in numbers):
        raise ParameterError(
            f"prior of {name}: read '{text}', expected numbers of {SMALLEST:g} to {LARGEST:g} in size"
        )
    if family.half:
        if min(numbers) <= 0.0:
            raise ParameterError(f"prior of {name}: read '{text}', expected {form}, positive")
        return numbers
    if family.bell and family.log and numbers[1] > WIDEST_LOG:
        raise ParameterError(f"prior of {name}: read '{text}', expected {form} with a sd of at most {WIDEST_LOG:g}")
    ordered = numbers[1] > 0.0 if family.bell else numbers[0] < numbers[1]
    if not ordered or (family.log and numbers[0] <= 0.0):
        raise ParameterError(f"prior of {name}: read '{text}', expected {form} with lower < upper and sd > 0")
    return numbers


@dataclass(frozen=True)
class Pull:
    """How priors hold coordinates beside the measurements: with `precision` (columns,), zero where they do not,
    towards `centre` (columns,), as normal densities do or those of Student's t with degrees of `freedom` (columns,).
    """

    centre: FloatArray
    precision: FloatArray
    freedom: FloatArray

    @classmethod
    def from_priors(cls, priors: Sequence[Prior], counted: Sequence[bool]) -> Pull:
        """That of the bells among `priors` that are `counted`."""
        both = [prior.bell and own for prior, own in zip(priors, counted, strict=True)]
        return cls(
            np.array([prior.a for prior in priors]),
            np.array([prior.b**-2.0 if own else 0.0 for prior, own in zip(priors, both, strict=True)]),
            np.array([prior.freedom for prior in priors]),
        )

    def take(self, column: int) -> Pull:
        """That on one column."""
        return Pull(self.centre[[column]], self.precision[[column]], self.freedom[[column]])

    def cost(self, x: FloatArray) -> FloatArray:
        """Minus the log density (rows, columns) at coordinates (rows, columns), but for a constant."""
        square = self.precision * (x - self.centre) ** 2
        tails = np.isfinite(self.freedom)
        square[:, tails] = tailed(square[:, tails], self.freedom[tails])
        return np.asarray(0.5 * square)

    def weight(self, x: FloatArray) -> FloatArray:
        """The slope of that cost over the distance from the centre (rows, columns): the curvature of the normal
        density that touches it, which lies below.
        """
        weight = np.broadcast_to(self.precision, x.shape).copy()
        tails = np.isfinite(self.freedom)
        own, precision = self.freedom[tails], self.precision[tails]
        square = precision * (x[:, tails] - self.centre[tails]) ** 2
        weight[:, tails] = precision * (own + 1.0) / (own + square)
        return weight


@dataclass(frozen=True)
class JointPrior:
    """Independent `priors`, one per column."""

    priors: tuple[Prior, ...]

    @cached_property
    def _logs(self) -> list[int]:
        return [k for k, prior in enumerate(self.priors) if prior.log]

    @cached_property
    def limits(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper ends of the supports, each (priors,), in coordinates."""
        ends = np.array([prior.support for prior in self.priors])
        return ends[:, 0].copy(), ends[:, 1].copy()

    @cached_property
    def shape(self) -> tuple[FloatArray, FloatArray, float]:
        """Centre of each column, one over its scale (0 where it is flat), and the joint constant."""
        centre = np.array([prior.a for prior in self.priors])
        rate = np.array([1.0 / prior.b if prior.bell else 0.0 for prior in self.priors])
        return centre, rate, float(sum(prior.log_scale for prior in self.priors))

    @cached_property
    def tails(self) -> dict[int, float]:
        """Columns with tails of Student's t, and their degrees of freedom."""
        return {k: prior.freedom for k, prior in enumerate(self.priors) if math.isfinite(prior.freedom)}

    @cached_property
    def width(self) -> FloatArray:
        """A length along each coordinate, (priors,)."""
        return np.array([prior.width for prior in self.priors])

    def value(self, coordinates: NumberArray) -> NumberArray:
        """Values (draws, priors) of coordinates (draws, priors)."""
        values = coordinates.copy()
        values[:, self._logs] = np.exp(coordinates[:, self._logs])
        return values

    def coordinate(self, values: FloatArray) -> FloatArray:
        """Inverse of `value`."""
        coordinates = values.copy()
        coordinates[:, self._logs] = np.log(values[:, self._logs])
        return coordinates

    def rates(self, values: FloatArray) -> FloatArray:
        """Derivatives (draws, priors) of values (draws, priors) with respect to their coordinates."""
        rates = np.ones(values.shape)
        rates[:, self._logs] = values[:, self._logs]
        return rates

    def draw(self, rng: np.random.Generator, size: int) -> FloatArray:
        """Values (size, priors)."""
        return np.stack([prior.draw(rng, size) for prior in self.priors], axis=1)

    def log_density(self, coordinates: FloatArray) -> FloatArray:
        """Log density (draws,) with respect to coordinates; -inf outside the bounds."""
        low, high = self.limits
        centre, rate, constant = self.shape
        z = (coordinates - centre) * rate
        density = -0.5 * np.einsum("ij,ij->i", z, z) - constant
        for column, freedom in self.tails.items():
            square = z[:, column] ** 2
            density += 0.5 * (square - tailed(square, freedom))
        inside = np.all((coordinates >= low) & (coordinates <= high), axis=1)
        return np.where(inside, density, -np.inf)


def _spec(noise: ColumnNoise, unit: str) -> ParameterSpec:
    prior = f"lognormal({noise.typical}, 0.7)"
    words = f"noise of {noise.source}"
    handy = next((column.handy for column in OBSERVABLES.values() if column.noise is noise), None)
    return ParameterSpec(
        noise.name, unit, noise.lower, noise.upper, prior, words, noise.symbol, possible=POSITIVE, handy=handy
    )


# Noise of the measurement, one standard deviation, common to all rows that state none of their own.
SD_SPECS: Mapping[str, ParameterSpec] = {
    SHARED_SD: _spec(SHARED_NOISE, OBSERVABLES["v_x2"].unit),
    **{column.noise.name: _spec(column.noise, column.unit) for column in OBSERVABLES.values()},
}
# What separates force records from the model; where there are records, their size centres the first prior.
FORCE_NOISE = ("force_sd", "force_misfit")
_FORCE_SPECS: Mapping[str, ParameterSpec] = {
    "force_sd": ParameterSpec(
        "force_sd", "N", 1e-3, 1e4, "lognormal(10, 1.0)", "noise of force, of one sample of a record", r"$\sigma_F$"
    ),
    "force_misfit": ParameterSpec(
        "force_misfit", "", 1e-4, 3.0, "lognormal(0.03, 1.0)",
        "misfit of force, model to record, slow in time, as a share of its peak", r"$\delta_F$",
        handy=("%", 1e2),
    ),
}  # fmt: skip
NOISE_SPECS: Mapping[str, ParameterSpec] = {
    **SD_SPECS,
    **_FORCE_SPECS,
    **{spec.name: spec for kind in KINDS.values() for spec in kind.parameters},
}


@dataclass(frozen=True)
class Parameter:
    """A parameter of a fit: its spec, its prior, and the value it is fixed at (None when free). `prior_source` is
    where a prior from the literature was published, empty for any other.
    """

    spec: ParameterSpec
    prior: Prior
    fixed: float | None
    fixed_because: str = ""
    prior_source: str = ""

    @property
    def name(self) -> str:
        """The name of the parameter."""
        return self.spec.name

    @property
    def free(self) -> bool:
        """Whether the data may move it."""
        return self.fixed is None


def build_parameters(
    names: Sequence[str],
    specs: Mapping[str, ParameterSpec],
    priors: Mapping[str, str],
    fixed: Mapping[str, tuple[float, str]],
    ball_names: Sequence[str] = (),
    extra: Mapping[str, ParameterSpec] | None = None,
    sources: Mapping[str, str] | None = None,
) -> tuple[Parameter, ...]:
    """Parameters called `names`, with overridden `priors`, and `fixed` name -> (value, why).

    `specs` are those of the model, and of noises that add to stated errors, which may be fixed at zero; `extra` are
    further parameters that only this problem has, by name; `sources` is where priors were published. Raises
    ParameterError for a name that is not among them, a value outside its bounds, or a bad prior.
    """
    others = extra or {}
    everything = (*names, *ball_names, *others)
    for kind, given in (("prior", priors), ("fixed value", fixed)):
        for name in given:
            if name not in everything:
                raise ParameterError(f"{kind} for unknown parameter '{name}': {suggestion(name, everything)}")
    built = []
    for name in everything:
        spec = others.get(name) or specs.get(name) or NOISE_SPECS[name]
        prior = parse_prior(name, priors.get(name, spec.prior), spec.lower, spec.upper, spec.unit)
        value, why = fixed.get(name, (None, ""))
        lower = 0.0 if name in NOISE_SPECS and name in specs else spec.lower
        if value is not None and not lower <= value <= spec.upper:
            raise ParameterError(
                f"fixed value {name} = {value:g}"
                + (f" {spec.unit}" if spec.unit else "")
                + f" lies outside its bounds [{lower:g}, {spec.upper:g}]"
            )
        built.append(Parameter(spec, prior, value, why, "" if sources is None else sources.get(name, "")))
    return tuple(built)
