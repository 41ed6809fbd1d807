"""What a population is asked of: a parameter, or the ratio of two, with the prior it had in each table.

A population takes the place of the prior of the quantity alone. The rest of the prior is unchanged and cancels in the
ratio of the two densities: priors of the other parameters given the quantity, what the model can evaluate, the
scene's contact time. The prior of a ratio is that of the priors of its parts, which are independent: the density of a
difference of logarithms.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from fitball.errors import ParameterError
from fitball.inference.population.hyper import Before
from fitball.inference.problem.parameters import NOISE_SPECS, Prior, parse_prior
from fitball.inference.problem.spreads import kind_of, spread_prior
from fitball.models.registry import parameter_spec
from fitball.models.specs import ParameterSpec
from fitball.values import FloatArray

# Evenly spaced quantiles of a divisor over which the prior of a ratio is averaged.
QUANTILES = 2000


@dataclass(frozen=True)
class Quantity:
    """A parameter, or the ratio of two (`parts`); its coordinate is the logarithm where `log`."""

    name: str
    parts: tuple[ParameterSpec, ...]
    log: bool

    @property
    def unit(self) -> str:
        """SI unit, empty where there is none."""
        units = [part.unit for part in self.parts]
        if len(units) == 1 or not units[-1]:
            return units[0]
        return "" if units[0] == units[1] else f"({units[0] or 1})/({units[1]})"

    def coordinates(self, columns: Mapping[str, FloatArray]) -> FloatArray:
        """Coordinates (draws,) from the columns of all parameters."""
        if len(self.parts) == 2:
            return np.log(columns[self.parts[0].name] / columns[self.parts[1].name])
        column = columns[self.parts[0].name]
        return np.log(column) if self.log else column

    def value(self, coordinate: float) -> float:
        """In SI."""
        return float(np.exp(coordinate)) if self.log else coordinate

    def log_prior(self, priors: Mapping[str, Prior | float]) -> Callable[[FloatArray], FloatArray]:
        """Log density with respect to the coordinate, from the prior of each part or the value it is fixed at."""
        over = self.parts[0].name
        first = priors[over]
        if len(self.parts) == 1:
            assert isinstance(first, Prior)
            return lambda places: log_density(first, places, self.log)
        return _log_ratio(first, priors[self.parts[1].name])

    def ends(self, priors: Mapping[str, Prior | float]) -> tuple[float, float]:
        """Coordinates between which the prior is positive."""
        sides = [_support(priors[part.name], self.log) for part in self.parts]
        if len(sides) == 1:
            return sides[0]
        (low, high), (lower, higher) = sides
        return low - higher, high - lower

    def before(self, ends: tuple[float, float], over: str = "") -> Before:
        """What is known of the population: the centre as the parameter itself by default, the spread as a pooled
        parameter's over the label `over` (empty: over the tables); the quantity lies between `ends`.
        """
        priors: dict[str, Prior | float] = {part.name: default_prior(part) for part in self.parts}
        first, kind = default_prior(self.parts[0]), kind_of(over)
        log = self.log or len(self.parts) == 2
        between, within = (spread_prior(self.name, level, log, first).prior for level in (kind, None))
        return Before(self.log_prior(priors), between, within, ends)


def quantity(name: str) -> Quantity:
    """The quantity that is written `mu` or `k_theta/k_y`. Raises ParameterError for another."""
    parts = tuple(_spec(part.strip(), name) for part in name.split("/"))
    if len(parts) > 2 or len({part.name for part in parts}) < len(parts):
        raise ParameterError(f"population of {name}: expected a parameter, or the ratio of two, such as k_theta/k_y")
    if len(parts) == 2:
        for part in parts:
            if not np.isfinite(_support(default_prior(part), True)[0]) and not default_prior(part).log:
                raise ParameterError(
                    f"population of {name}: {part.name} may be zero or negative, and a ratio is estimated by its "
                    "logarithm: use positive parameters, such as k_theta/k_y"
                )
        return Quantity(name, parts, True)
    return Quantity(name, parts, default_prior(parts[0]).log)


def _spec(name: str, asked: str) -> ParameterSpec:
    spec = parameter_spec(name) or NOISE_SPECS.get(name)
    if spec is None:
        raise ParameterError(
            f"population of {asked}: no model has a parameter '{name}'. Expected a parameter that the tables were "
            "fitted with, or the ratio of two, such as k_theta/k_y"
        )
    return spec


def known(name: str) -> bool:
    """Whether a population can be asked of what is called so."""
    return parameter_spec(name) is not None or name in NOISE_SPECS


def default_prior(spec: ParameterSpec) -> Prior:
    """The prior that a parameter has unless something else is known."""
    return prior_of(spec, spec.prior)


def prior_of(spec: ParameterSpec, text: str) -> Prior:
    """The prior that is written so."""
    return parse_prior(spec.name, text, spec.lower, spec.upper, spec.unit)


def log_density(prior: Prior, places: FloatArray, log: bool) -> FloatArray:
    """Log density of a prior at coordinates: with respect to the logarithm where `log`, else to the value, whichever
    the prior itself has its shape in.
    """
    if prior.log == log:
        return prior.log_density(places)
    if log:
        return prior.log_density(np.exp(places)) + places
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log(places)
        return np.where(places > 0.0, prior.log_density(logs) - logs, -np.inf)


def _support(prior: Prior | float, log: bool) -> tuple[float, float]:
    if not isinstance(prior, Prior):
        place = float(np.log(prior)) if log else prior
        return place, place
    ends = np.array(prior.support)
    if prior.log and not log:
        ends = np.exp(ends)
    elif log and not prior.log:
        with np.errstate(divide="ignore"):
            ends = np.log(np.maximum(ends, 0.0))
    return float(ends[0]), float(ends[1])


def _log_ratio(first: Prior | float, second: Prior | float) -> Callable[[FloatArray], FloatArray]:
    """Log density of the logarithm of a ratio of two independent values, at least one of which has a prior."""
    if not isinstance(first, Prior):
        assert isinstance(second, Prior)
        at = float(np.log(first))
        return lambda places: log_density(second, at - places, True)
    if not isinstance(second, Prior):
        below = np.array([np.log(second)])
    else:
        below = np.log(second.quantile((np.arange(QUANTILES) + 0.5) / QUANTILES))

    def density(places: FloatArray) -> FloatArray:
        rows = [log_density(first, place + below, True) for place in places]
        return np.asarray(logsumexp(np.array(rows), axis=1) - np.log(len(below)))

    return density
