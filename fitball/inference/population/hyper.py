"""Centre and spread of a population: their posterior on a grid that covers it closely."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from fitball.inference.population.box import Grid, covering_grid
from fitball.inference.population.draws import TableDraws, log_likelihood, log_mass
from fitball.values import FloatArray

# The largest spread that is looked at, in sds of its half-normal prior.
REACH = 5.0
# Share of the mass of the grid that may be left out where tables are weighted.
LEFT_OUT = 1e-4
# Median, and ends of a 95 % interval.
LEVELS = (0.5, 0.025, 0.975)
# Steps in which quantiles are looked for.
FINE = 2001
# While the grid is searched a share of the draws will do, and so many standard errors, and sds of a table, hold the
# centre for sure.
ROUGHLY = 8
FAR = 8.0


@dataclass(frozen=True)
class Before:
    """What is known of a population before any table: the log density of its centre, the sd `spread` of the
    half-normal prior of its spread, and the ends between which the quantity may lie, and its centre.
    """

    log_centre: Callable[[FloatArray], FloatArray]
    spread: float
    ends: tuple[float, float]

    def log_density(self, points: FloatArray) -> FloatArray:
        """Log density (points,) of populations (points, 2), up to a constant."""
        return np.asarray(self.log_centre(points[:, 0]) - 0.5 * (points[:, 1] / self.spread) ** 2)


@dataclass(frozen=True)
class Known:
    """A number with its 95 % interval; `error` is the sd that the finite number of draws gives its mean."""

    median: float
    low: float
    high: float
    error: float = 0.0

    @classmethod
    def of(cls, drawn: FloatArray, error: float = 0.0) -> Known:
        """From draws (draws,)."""
        median, low, high = (float(end) for end in np.quantile(drawn, LEVELS))
        return cls(median, low, high, error)


@dataclass(frozen=True)
class Chart:
    """Numbers (z, u) in which the posterior of centre and spread has no long tails: the spread is `size` sinh u, and
    the centre lies z of its standard errors at that spread from `middle`.
    """

    middle: float
    size: float
    count: int

    def error(self, u: FloatArray) -> FloatArray:
        """Standard error of the centre."""
        return np.asarray(self.size * np.cosh(u) / np.sqrt(self.count))

    def points(self, places: FloatArray) -> FloatArray:
        """Centre and spread (points, 2) at (z, u), (points, 2)."""
        z, u = places.T
        return np.stack([self.middle + z * self.error(u), self.size * np.sinh(u)], axis=1)

    def log_volume(self, places: FloatArray) -> FloatArray:
        """Log density (points,) of (z, u) where that of centre and spread is one, up to a factor of the count."""
        return 2.0 * np.log(self.size * np.cosh(places[:, 1]))


@dataclass(frozen=True)
class HyperPosterior:
    """The posterior of centre and spread on a `grid` of the `chart`."""

    grid: Grid
    chart: Chart

    @property
    def heaviest(self) -> tuple[FloatArray, FloatArray]:
        """Centre and spread (points, 2) of what holds all but `LEFT_OUT` of the mass, and their shares (points,)."""
        shares = self.grid.shares.ravel()
        order = np.argsort(shares)[::-1]
        kept = np.sort(order[: int(np.searchsorted(np.cumsum(shares[order]), 1.0 - LEFT_OUT)) + 1])
        return self.chart.points(self.grid.points[kept]), shares[kept] / shares[kept].sum()

    @property
    def ends(self) -> FloatArray:
        """Least and largest centre, least and largest spread of the grid, (2, 2)."""
        z, u = self.grid.sides
        errors = self.chart.error(u)
        centre = [self.chart.middle + np.min(z[0] * errors), self.chart.middle + np.max(z[-1] * errors)]
        return np.array([centre, self.chart.size * np.sinh(u[[0, -1]])])

    def below_centre(self, places: FloatArray) -> FloatArray:
        """Probability (places,) that the centre is less, by splines through the grid."""
        z, u = self.grid.sides
        below = np.zeros(len(places))
        for column, error in zip(self.grid.shares.T, self.chart.error(u), strict=True):
            below += _upto(z, _density(column))(np.clip((places - self.chart.middle) / error, z[0], z[-1]))
        return np.asarray(below / below[-1])

    def below_spread(self, places: FloatArray) -> FloatArray:
        """Probability (places,) that the spread is less."""
        u = self.grid.sides[1]
        below = _upto(u, _density(self.grid.shares.sum(axis=0)))(
            np.clip(np.arcsinh(places / self.chart.size), u[0], u[-1])
        )
        return np.asarray(below / below[-1])


def hyper_posterior(tables: Sequence[TableDraws], before: Before) -> HyperPosterior:
    """Centre and spread of a quantity from the draws of at least two tables."""
    sds = [table.sd for table in tables]
    chart = Chart(float(np.median([table.mean for table in tables])), float(np.median(sds)), len(tables))

    def log_density(places: FloatArray, every: int) -> FloatArray:
        points = chart.points(places)
        total = before.log_density(points) + chart.log_volume(places)
        low, high = before.ends
        inside = np.isfinite(total) & (points[:, 0] >= low) & (points[:, 0] <= high)
        total[~inside] = -np.inf
        points = points[inside]
        for table in tables:
            total[inside] += log_likelihood(table.take(every), points)
        total[inside] -= len(tables) * log_mass(points, before.ends)
        return total

    reach = FAR + np.sqrt(len(tables)) * FAR
    grid = covering_grid(
        lambda places: log_density(places, ROUGHLY),
        lambda places: log_density(places, 1),
        np.array([-reach, 0.0]),
        np.array([reach, np.arcsinh(REACH * before.spread / chart.size)]),
    )
    return HyperPosterior(grid, chart)


def quantile_ends(fine: FloatArray, side: FloatArray, shares: FloatArray) -> tuple[float, float, float]:
    """Median, low and high end of the 95 % interval, among `fine` places, of shares (points,) on a side of a grid."""
    return _quantiles(fine, _upto(side, _density(shares))(fine))


def centre_and_spread(parts: Sequence[HyperPosterior], shares: Sequence[float]) -> tuple[Known, Known]:
    """Median and 95 % interval of centre and spread, of posteriors mixed in these shares."""
    ends = np.array([part.ends for part in parts])
    (low, least), (high, most) = ends[:, :, 0].min(axis=0), ends[:, :, 1].max(axis=0)
    size = min(part.chart.size for part in parts)
    spreads = size * np.sinh(np.linspace(np.arcsinh(least / size), np.arcsinh(most / size), FINE))
    found = []
    for places, name in ((np.linspace(low, high, FINE), "below_centre"), (spreads, "below_spread")):
        below = sum(share * getattr(part, name)(places) for part, share in zip(parts, shares, strict=True))
        found.append(Known(*_quantiles(places, np.asarray(below))))
    return found[0], found[1]


def _density(shares: FloatArray) -> FloatArray:
    """Density at the points of a side, up to a constant, of shares by the trapezoidal rule."""
    density = shares.copy()
    density[[0, -1]] *= 2.0
    return density


def _upto(side: FloatArray, density: FloatArray) -> Callable[[FloatArray], FloatArray]:
    upto: Callable[[FloatArray], FloatArray] = CubicSpline(side, density).antiderivative()
    return upto


def _quantiles(places: FloatArray, below: FloatArray) -> tuple[float, float, float]:
    """Median, low and high end of 95 % of a mass of which so much lies `below` places."""
    rising = np.maximum.accumulate(below)
    middle, low, high = np.interp(np.array(LEVELS) * rising[-1], rising, places)
    return float(middle), float(low), float(high)
