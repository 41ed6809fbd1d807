"""Parameters before any data: what each is, and its prior.

Models, noises, the camera, spreads between levels and derived quantities all describe themselves by
`ParameterSpec`.
"""

import math
import re
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fitball.base.display_units import SI
from fitball.base.errors import ParameterError, suggestion
from fitball.base.numbers import Unit
from fitball.base.values import FloatArray

# How each family is written, by name.
_FORMS = {
    "normal": "normal(mean, sd)",
    "lognormal": "lognormal(median, sd of the natural logarithm)",
    "uniform": "uniform(lower, upper)",
    "loguniform": "loguniform(lower, upper)",
    "half-normal": "half-normal(scale)",
    "half-t": "half-t(scale, degrees of freedom)",
}
_WRITTEN = re.compile(r"\s*([A-Za-z-]+)\s*\(([^()]*)\)\s*")
# Numbers in a prior, whose squares are doubles still; the widest logarithm that is knowledge of any
# kind; and the share of a bell that bounds must leave: with less, prior and bounds contradict each
# other.
_SMALLEST = 1e-100
_LARGEST = 1e100
_WIDEST_LOG = 50.0
_LEAST_MASS = 1e-6


@dataclass(frozen=True)
class ParameterSpec:
    """A parameter: SI `unit` (empty: dimensionless), closed bounds, default `prior` as text,
    `meaning` (a comma after its short name), `symbol` in mathtext; `typical` is the default of
    simulations, `display_unit` the unit that people read, by default `unit`;
    `logarithmic` its axes.
    """

    name: str
    unit: str
    lower: float
    upper: float
    prior: str
    meaning: str
    symbol: str
    typical: float | None = None
    display_unit: Unit = SI
    logarithmic: bool = False

    def __post_init__(self) -> None:
        if self.display_unit is SI:
            object.__setattr__(self, "display_unit", Unit(self.unit))


@dataclass(frozen=True)
class Prior:
    """A density truncated to [`lower`, `upper`] in its coordinate, the natural logarithm where
    `log`, else the value in SI: Student's t of `freedom` (normal: infinite) about `location` with
    `scale`, or `flat`. `text` is as written, `source` where it was published.
    """

    text: str
    lower: float
    upper: float
    location: float
    scale: float
    freedom: float = np.inf
    log: bool = False
    flat: bool = False
    source: str = ""

    def coordinate(self, values: FloatArray) -> FloatArray:
        """Coordinates of values in SI, any shape; `value` is the inverse."""
        return np.log(values) if self.log else np.array(values, dtype=np.float64)

    def value(self, coordinates: FloatArray) -> FloatArray:
        """Values in SI."""
        return np.exp(coordinates) if self.log else np.array(coordinates, dtype=np.float64)

    def log_density(self, coordinates: FloatArray) -> FloatArray:
        """Normalised, with respect to the coordinate; -inf outside the bounds."""
        inside = (coordinates >= self.lower) & (coordinates <= self.upper)
        return np.where(inside, self._bell(coordinates) - math.log(self.mass), -np.inf)

    def _bell(self, coordinates: FloatArray) -> FloatArray:
        """The log density before the truncation, of a flat prior zero."""
        if self.flat:
            return np.zeros(np.shape(coordinates))
        from scipy.special import poch

        square = ((coordinates - self.location) / self.scale) ** 2
        if math.isinf(self.freedom):
            return -0.5 * square - math.log(self.scale) - 0.5 * math.log(2.0 * math.pi)
        # Gamma(half + 1/2)/Gamma(half) at once: the logarithms of both cancel at many degrees of
        # freedom.
        half = 0.5 * self.freedom
        level = (
            math.log(poch(half, 0.5))
            - 0.5 * math.log(math.pi * self.freedom)
            - math.log(self.scale)
        )
        return np.asarray(level - (half + 0.5) * np.log1p(square / self.freedom))

    @cached_property
    def mass(self) -> float:
        """Share of the bell between the bounds, 1e-6 or more, which leaves ten digits; of a flat
        prior its width.
        """
        return self.upper - self.lower if self.flat else self._shares[1] - self._shares[0]

    @cached_property
    def _shares(self) -> tuple[float, float]:
        """The shares of the bell below both bounds."""
        from scipy.special import ndtr, stdtr

        ends = [(end - self.location) / self.scale for end in (self.lower, self.upper)]
        low, high = (
            ndtr(end) if math.isinf(self.freedom) else stdtr(self.freedom, end) for end in ends
        )
        return float(low), float(high)

    def quantile(self, shares: FloatArray) -> FloatArray:
        """In SI; draws are quantiles of uniform shares."""
        from scipy.special import ndtri, stdtrit

        if self.flat:
            found = self.lower + shares * (self.upper - self.lower)
        else:
            among = self._shares[0] + shares * self.mass
            z = ndtri(among) if math.isinf(self.freedom) else stdtrit(self.freedom, among)
            found = np.asarray(self.location + z * self.scale)
        # Rounding may step over a bound; shares of zero and one are bounds.
        return self.value(np.clip(found, self.lower, self.upper))


def parse_prior(spec: ParameterSpec, text: str = "") -> Prior:
    """`normal(mean, sd)`, `lognormal(median, sd of ln)`, `uniform(a, b)`, `loguniform(a, b)`,
    `half-normal(scale)`, `half-t(scale, freedom)`; without text the spec's. Raises ParameterError
    (`prior`), also for mass below 1e-6.
    """
    text = (text or spec.prior).strip()
    family, numbers = _read(spec.name, text)
    log = family.startswith("log")
    half = family.startswith("half")
    flat = family.endswith("uniform")
    with np.errstate(divide="ignore"):
        # A parameter that may be zero has a logarithm without lower end.
        lower, upper = (
            np.log([max(spec.lower, 0.0), max(spec.upper, 0.0)])
            if log
            else (spec.lower, spec.upper)
        )
    lower = max(float(lower), 0.0) if half else float(lower)
    upper = float(upper)
    if flat:
        ends = [math.log(number) for number in numbers] if log else numbers
        lower = max(lower, ends[0])
        upper = min(upper, ends[1])
        prior = Prior(text, lower, upper, 0.5 * (lower + upper), upper - lower, log=log, flat=True)
    elif half:
        prior = Prior(
            text,
            lower,
            upper,
            0.0,
            numbers[0],
            numbers[-1] if family == "half-t" else math.inf,
        )
    else:
        prior = Prior(
            text,
            lower,
            upper,
            math.log(numbers[0]) if log else numbers[0],
            numbers[1],
            log=log,
        )
    if not lower < upper or not (flat or prior.mass * (1.0 + half) > _LEAST_MASS):
        bounds = f"{spec.lower:g} to {spec.upper:g} {spec.unit}".rstrip()
        words = (
            f"prior of {spec.name}: read '{text}'; the bounds {bounds} leave nothing of it; "
            "change the prior"
        )
        raise ParameterError(words, "prior")
    return prior


def _read(name: str, text: str) -> tuple[str, list[float]]:
    """Family and numbers of a prior. Raises ParameterError for those that the family cannot
    have.
    """

    def fault(wanted: str) -> ParameterError:
        return ParameterError(f"prior of {name}: read '{text}'; {wanted}", "prior")

    found = _WRITTEN.fullmatch(text)
    if found is None:
        raise fault("expected a form such as normal(0.55, 0.05)")
    family = found[1].lower()
    if family not in _FORMS:
        raise fault(f"unknown family '{found[1]}', {suggestion(family, _FORMS)}")
    form = _FORMS[family]
    try:
        numbers = [float(part) for part in found[2].split(",")]
    except ValueError:
        numbers = []
    good = all(abs(number) <= _LARGEST and not 0.0 < abs(number) < _SMALLEST for number in numbers)
    if len(numbers) != form.count(",") + 1 or not good:
        raise fault(f"expected {form}, numbers of {_SMALLEST:g} to {_LARGEST:g} in size")
    flat = family.endswith("uniform")
    positive = numbers[0] > 0.0 or family in ("normal", "uniform")
    if not positive or not (numbers[0] < numbers[1] if flat else numbers[-1] > 0.0):
        wanted = "lower < upper" if flat else "a positive width"
        raise fault(
            f"expected {form} with "
            f"{wanted}{'' if family in ('normal', 'uniform') else ', all positive'}"
        )
    if family == "lognormal" and numbers[1] > _WIDEST_LOG:
        raise fault(f"expected {form}, with a sd of at most {_WIDEST_LOG:g}")
    return family, numbers
