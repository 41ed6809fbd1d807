"""A population over many tables from the stored draws of each: hierarchical inference by importance weights.

Tables were fitted one by one under an interim prior of the quantity. With that prior divided out at every draw and a
normal population of centre `m` and spread `tau` put in its place, the likelihood of the population is, for each
table, the mean of the weights of its draws (Hogg, Myers and Bovy 2010, ApJ 725, 2166); what the population says of a
table is its draws with those weights. Everything here is in the coordinate of the quantity.

A draw stands for a normal density about it, `SMOOTH` sds of its table wide, and draws are drawn together by as much,
so that mean and variance stay what they are (West 1993, J. R. Stat. Soc. B 55, 409): else a spread of zero had no
likelihood.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import ndtr

from fitball.inference.population.box import Grid, covering_grid
from fitball.inference.sampling.importance import K_TRUSTED, smoothed
from fitball.values import FloatArray

SMOOTH = 0.3
# Draws of each table from its weighted ones, from which its quantiles are told.
DRAWN = 1000
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
Ends = tuple[float, float, float]


@dataclass(frozen=True)
class TableDraws:
    """The posterior of a quantity in one table: places (draws,) and width of the densities that stand for its draws,
    and the log density (draws,) of the interim prior there; `efficiency` is effective draws over draws, at most 1.
    """

    name: str
    places: FloatArray
    width: float
    log_interim: FloatArray
    efficiency: float = 1.0

    @classmethod
    def of(
        cls, name: str, draws: FloatArray, interim: Callable[[FloatArray], FloatArray], efficiency: float = 1.0
    ) -> TableDraws:
        """From draws (draws,) in the coordinate, not all equal, and the log density of the interim prior there.

        A normal density over a normal one is normal again, elsewhere and wider: with the slope and the mean curvature
        of the logarithm of the prior, division by it is exact for normal and for flat priors.
        """
        centre, width = draws.mean(), SMOOTH * float(draws.std())
        places = centre + np.sqrt(1.0 - SMOOTH**2) * (draws - centre)
        left, here, right = (interim(places + step) for step in (-width, 0.0, width))
        # At a bound there is no slope to be had.
        inside = np.isfinite(left + right)
        slope, bend = np.zeros((2, len(places)))
        slope[inside] = (right[inside] - left[inside]) / (2.0 * width)
        bend[inside] = (2.0 * here[inside] - left[inside] - right[inside]) / width**2
        wider = width / np.sqrt(1.0 - float(bend.mean()) * width**2)
        log_interim = here - 0.5 * (slope * wider) ** 2 - np.log(wider / width)
        return cls(name, places - wider**2 * slope, wider, log_interim, efficiency)

    def take(self, every: int) -> TableDraws:
        """One of so many draws."""
        return replace(self, places=self.places[::every], log_interim=self.log_interim[::every])


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


@dataclass(frozen=True)
class Weighted:
    """A table, given the others: the quantity there with its sd, the `effective` number of its draws, Pareto k."""

    name: str
    known: Known
    sd: float
    effective: float
    pareto_k: float

    @property
    def trusted(self) -> bool:
        """Whether its weights carry what is said of it."""
        return self.pareto_k <= K_TRUSTED


@dataclass(frozen=True)
class Population:
    """Centre and spread of a quantity over tables, and each table given the others, all in its coordinate."""

    centre: Known
    spread: Known
    tables: tuple[Weighted, ...]

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Tables whose weights are not to be trusted."""
        return tuple(table.name for table in self.tables if not table.trusted)


def log_weights(table: TableDraws, points: FloatArray) -> FloatArray:
    """Logarithms of the weights (points, draws) of a table's draws under normal populations (points, 2) of centre and
    spread.
    """
    variance = points[:, 1:] ** 2 + table.width**2
    weights: FloatArray = table.places - points[:, :1]
    np.square(weights, out=weights)
    weights *= -0.5 / variance
    weights -= table.log_interim
    weights -= 0.5 * np.log(2.0 * np.pi * variance)
    return weights


def log_likelihood(table: TableDraws, points: FloatArray) -> FloatArray:
    """Log likelihood (points,) of populations (points, 2) by one table.

    The logarithm of a mean of `n` draws lies low by half its relative variance; over a thousand tables that adds up.
    """
    shares = log_weights(table, points)
    top = shares.max(axis=1)
    shares -= top[:, None]
    np.exp(shares, out=shares)
    whole, squares = shares.sum(axis=1), np.einsum("ij,ij->i", shares, shares)
    count = shares.shape[1]
    lift = 0.5 * (squares / whole**2 - 1.0 / count) / table.efficiency
    return np.asarray(top + np.log(whole / count) + lift)


def log_mass(points: FloatArray, ends: tuple[float, float]) -> FloatArray:
    """Log share (points,) of a normal population with its centre between the `ends` that lies there too."""
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = ((end - points[:, 0]) / points[:, 1] for end in ends)
        return np.where(points[:, 1] > 0.0, np.log(ndtr(high) - ndtr(low)), 0.0)


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
        """Log density (points,) of (z, u) where that of centre and spread is one, up to a constant."""
        return 2.0 * np.log(np.cosh(places[:, 1]))


def population(tables: Sequence[TableDraws], before: Before) -> Population:
    """Centre and spread of a quantity from the draws of at least two tables, and each table given the others."""
    sds = [float(table.places.std()) for table in tables]
    chart = Chart(float(np.median([table.places.mean() for table in tables])), float(np.median(sds)), len(tables))

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
    places, shares = _heaviest(grid)
    points = chart.points(places)
    spans = points - shares @ points
    # What one draw more or less does to the means (an infinitesimal jackknife).
    scatter = np.zeros(2)
    weighted = []
    for k, table in enumerate(tables):
        weights = log_weights(table, points)
        weights = np.exp(weights - weights.max(axis=1, keepdims=True))
        weights /= weights.sum(axis=1, keepdims=True)
        scatter += np.sum(np.einsum("gs,gk->sk", weights, shares[:, None] * spans) ** 2, axis=0) / table.efficiency
        rng = np.random.default_rng([k, DRAWN])
        weighted.append(_given_others(table, points, shares, weights, rng))
    centre, spread = _ends(grid, chart)
    errors = np.sqrt(scatter)
    return Population(Known(*centre, float(errors[0])), Known(*spread, float(errors[1])), tuple(weighted))


def _heaviest(grid: Grid) -> tuple[FloatArray, FloatArray]:
    """The points (points, 2) that hold all but `LEFT_OUT` of the mass, and their shares (points,)."""
    shares = grid.shares.ravel()
    order = np.argsort(shares)[::-1]
    kept = np.sort(order[: int(np.searchsorted(np.cumsum(shares[order]), 1.0 - LEFT_OUT)) + 1])
    return grid.points[kept], shares[kept] / shares[kept].sum()


def _ends(grid: Grid, chart: Chart) -> tuple[Ends, Ends]:
    """Median, low and high end of the 95 % interval of centre and spread, by splines through the grid."""
    z, u = grid.sides
    fine = np.linspace(u[0], u[-1], FINE)
    in_u = _quantiles(fine, _upto(u, _density(grid.shares.sum(axis=0)))(fine))
    spread = [chart.size * float(np.sinh(end)) for end in in_u]
    errors = chart.error(u)
    fine = chart.middle + np.linspace(np.min(z[0] * errors), np.max(z[-1] * errors), FINE)
    below = np.zeros(FINE)
    for column, error in zip(grid.shares.T, errors, strict=True):
        upto = _upto(z, _density(column))
        below += upto(np.clip((fine - chart.middle) / error, z[0], z[-1]))
    return _quantiles(fine, below), (spread[0], spread[1], spread[2])


def _density(shares: FloatArray) -> FloatArray:
    """Density at the points of a side, up to a constant, of shares by the trapezoidal rule."""
    density = shares.copy()
    density[[0, -1]] *= 2.0
    return density


def _upto(side: FloatArray, density: FloatArray) -> Callable[[FloatArray], FloatArray]:
    upto: Callable[[FloatArray], FloatArray] = CubicSpline(side, density).antiderivative()
    return upto


def _quantiles(places: FloatArray, below: FloatArray) -> Ends:
    """Median, low and high end of 95 % of a mass of which so much lies `below` places."""
    rising = np.maximum.accumulate(below)
    middle, low, high = np.interp(np.array(LEVELS) * rising[-1], rising, places)
    return float(middle), float(low), float(high)


def _given_others(
    table: TableDraws, points: FloatArray, shares: FloatArray, weights: FloatArray, rng: np.random.Generator
) -> Weighted:
    """A table given the others, from its weights (points, draws), of each point adding up to one."""
    # Not by a product of matrices: threads of a numerical library cost more here than they save.
    own = np.einsum("g,gs->s", shares, weights)
    _smooth, pareto_k = smoothed(np.log(np.maximum(own, 1e-300)), table.efficiency)
    which = rng.choice(len(points), DRAWN, p=shares)
    upto = np.cumsum(weights, axis=1)
    # The rows one behind the other rise, so that one search does for all.
    flat = (upto / upto[:, -1:] + np.arange(len(points))[:, None]).ravel()
    chosen = np.searchsorted(flat, which + rng.random(DRAWN)) - which * upto.shape[1]
    place, (centre, spread) = table.places[np.clip(chosen, 0, upto.shape[1] - 1)], points[which].T
    # Within its own density a draw meets the population's: the product of two normal ones.
    share = spread**2 / (spread**2 + table.width**2)
    drawn = centre + share * (place - centre) + np.sqrt(share) * table.width * rng.standard_normal(DRAWN)
    median, low, high = (float(end) for end in np.quantile(drawn, LEVELS))
    return Weighted(table.name, Known(median, low, high), float(drawn.std()), 1.0 / float(own @ own), pareto_k)
