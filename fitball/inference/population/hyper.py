"""Centre and spread of a population from the draws of its tables: their posterior on a grid that covers it closely.

Tables were fitted one by one under an interim prior of the quantity. That prior is divided out at every draw and
replaced by a normal population of centre `m` and spread `tau`. Then the likelihood of the population is the mean of
the weights of the draws (Hogg, Myers and Bovy 2010, ApJ 725, 2166). Everything here is in the coordinate of the
quantity.

A draw stands for a normal density about it, `SMOOTH` sds of its table wide (of its middle half where that is
narrower), and draws are drawn together by as much, so that mean and variance are unchanged (West 1993, J. R.
Stat. Soc. B 55, 409): else a spread of zero had no likelihood.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.special import ndtr, ndtri
from scipy.stats import iqr

from fitball.inference.problem.parameters import Prior
from fitball.values import FloatArray

SMOOTH = 0.3


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
    def drawn(
        cls, name: str, draws: FloatArray, interim: Callable[[FloatArray], FloatArray], efficiency: float = 1.0
    ) -> TableDraws:
        """From draws (draws,) in the coordinate, not all equal, and the log density of the interim prior there.

        A normal density over a normal one is normal again, elsewhere and wider: with the slope and the mean curvature
        of the logarithm of the prior, division by it is exact for normal and for flat priors.
        """
        centre, sd = draws.mean(), float(draws.std())
        # A long tail, or a second mode, is no reason to blur the first.
        width = SMOOTH * (min(sd, float(iqr(draws, scale="normal"))) or sd)
        places = centre + np.sqrt(1.0 - (width / sd) ** 2) * (draws - centre)
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

    @property
    def mean(self) -> float:
        """Mean of the draws."""
        return float(self.places.mean())

    @property
    def sd(self) -> float:
        """Sd of the draws."""
        return float(self.places.std())


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


def shares_of(table: TableDraws, points: FloatArray) -> FloatArray:
    """The weights (points, draws), those of each point adding up to one."""
    weights = log_weights(table, points)
    weights = np.exp(weights - weights.max(axis=1, keepdims=True))
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def drawn_given(
    table: TableDraws, points: FloatArray, shares: FloatArray, which: NDArray[np.int64], rng: np.random.Generator
) -> FloatArray:
    """A value (draws,) of the table under each of the populations `which` of `points`, from its `shares_of` them."""
    upto = np.cumsum(shares, axis=1)
    # The rows one behind the other rise, so that one search does for all.
    flat = (upto / upto[:, -1:] + np.arange(len(points))[:, None]).ravel()
    chosen = np.searchsorted(flat, which + rng.random(len(which))) - which * upto.shape[1]
    place, (centre, spread) = table.places[np.clip(chosen, 0, upto.shape[1] - 1)], points[which].T
    # Within its own density a draw meets the population's: the product of two normal ones.
    share = spread**2 / (spread**2 + table.width**2)
    return np.asarray(
        centre + share * (place - centre) + np.sqrt(share) * table.width * rng.standard_normal(len(which))
    )


def drawn_new(points: FloatArray, ends: tuple[float, float], rng: np.random.Generator) -> FloatArray:
    """A value (points,) of a new table from each of the populations (points, 2), between the `ends`."""
    centre, spread = points.T
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = (ndtr((end - centre) / spread) for end in ends)
        drawn = centre + spread * ndtri(low + rng.random(len(points)) * (high - low))
    return np.asarray(np.where(spread > 0.0, drawn, centre))


# A density of a few numbers on a grid that covers it closely: boxes are cut down until little of them is empty.

# Points along each side of the box. A density that falls off as a normal one does has some six of its sds to either
# side in such a box, and where points lie half an sd apart the trapezoidal rule is exact to many digits.
POINTS = 24
# Log density below the peak that counts as empty.
EMPTY = 18.0
MOST_CUTS = 12
# While a box is cut a share of the draws will do: one of so many.
ROUGHLY = 8


@dataclass(frozen=True)
class Grid:
    """`sides` of a grid, each (points,), and the `shares` (points, points, ...) of the mass that its points stand
    for; `log_mass` is the logarithm of all of it.
    """

    sides: tuple[FloatArray, ...]
    shares: FloatArray
    log_mass: float

    @property
    def points(self) -> FloatArray:
        """All points, (all points, sides), in the order of the shares."""
        return _mesh(self.sides)


def covering_grid(
    log_density: Callable[[FloatArray, int], FloatArray],
    low: Sequence[float],
    high: Sequence[float],
    points: int = POINTS,
    empty: float = EMPTY,
    every: int = 1,
) -> Grid:
    """The density whose logarithm at places (places, sides) is (places,), on a grid of so many `points` a side within
    the box of these ends (sides,), which is cut down as far as the density falls off by `empty`. It is computed from
    one in `every` so many draws, and while it is cut from fewer. It has one peak, or several that the first box
    shows.
    """
    shape = (points,) * len(low)
    for _ in range(MOST_CUTS):
        sides = _sides(low, high, points)
        low, high, narrower = _cut(sides, log_density(_mesh(sides), max(every, ROUGHLY)).reshape(shape), empty)
        if not narrower:
            break
    sides = _sides(low, high, points)
    density = log_density(_mesh(sides), every).reshape(shape)
    top = float(density.max())
    mass = np.exp(density - top) * reduce(np.multiply.outer, map(_trapezoid, sides))
    return Grid(sides, mass / mass.sum(), top + float(np.log(mass.sum())))


def _sides(low: Sequence[float], high: Sequence[float], points: int) -> tuple[FloatArray, ...]:
    return tuple(np.linspace(*ends, points) for ends in zip(low, high, strict=True))


def _mesh(sides: tuple[FloatArray, ...]) -> FloatArray:
    return np.stack([side.ravel() for side in np.meshgrid(*sides, indexing="ij")], axis=1)


def _trapezoid(side: FloatArray) -> FloatArray:
    widths = np.full(len(side), side[1] - side[0])
    widths[[0, -1]] *= 0.5
    return widths


def _cut(sides: tuple[FloatArray, ...], table: FloatArray, empty: float) -> tuple[list[float], list[float], bool]:
    """Ends of the box in which the table is not empty, one point wider, and whether that is narrower by much."""
    full = table > table.max() - empty
    ends = []
    for axis, side in enumerate(sides):
        where = np.flatnonzero(np.moveaxis(full, axis, 0).reshape(len(side), -1).any(axis=1))
        ends.append((float(side[max(where[0] - 1, 0)]), float(side[min(where[-1] + 1, len(side) - 1)])))
    shares = [(high - low) / (side[-1] - side[0]) for (low, high), side in zip(ends, sides, strict=True)]
    return [low for low, _high in ends], [high for _low, high in ends], min(shares) < 0.8


# The posterior of centre and spread.

# Share of the prior of a spread below the largest that is looked at: five sds of a normal one.
REACHED = 1.0 - 6e-7
# Share of the mass of the grid that may be left out where tables are weighted.
LEFT_OUT = 1e-4
# Median, and ends of a 95 % interval.
LEVELS = (0.5, 0.025, 0.975)
# Steps in which quantiles are looked for.
FINE = 2001
# So many standard errors, and sds of a table, hold the centre for sure.
FAR = 8.0


@dataclass(frozen=True)
class Before:
    """What is known of a population before any table: the log density of its centre, the priors of its spread (over
    levels of that between these) and of that `within` levels, and the ends between which the quantity may lie, and
    its centre.
    """

    log_centre: Callable[[FloatArray], FloatArray]
    spread: Prior
    within: Prior
    ends: tuple[float, float]

    def log_density(self, points: FloatArray) -> FloatArray:
        """Log density (points,) of populations (points, 2), up to a constant."""
        return np.asarray(self.log_centre(points[:, 0]) + self.spread.log_density(points[:, 1]))


def reach(spread: Prior, size: float) -> float:
    """The largest spread that is looked at, in coordinates `u` where the spread is `size` sinh u."""
    return float(np.arcsinh(float(spread.quantile(np.array(REACHED))) / size))


@dataclass(frozen=True)
class Known:
    """A number with its 95 % interval; `error` is the sd that the finite number of draws gives its mean."""

    median: float
    low: float
    high: float
    error: float = 0.0

    @classmethod
    def drawn(cls, drawn: FloatArray, error: float = 0.0) -> Known:
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

    far = FAR + float(np.sqrt(len(tables))) * FAR
    return HyperPosterior(covering_grid(log_density, (-far, 0.0), (far, reach(before.spread, chart.size))), chart)


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
