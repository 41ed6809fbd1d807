"""The draws of one table under populations: weights, the likelihood, what a population says of the table.

Tables were fitted one by one under an interim prior of the quantity. With that prior divided out at every draw and a
normal population of centre `m` and spread `tau` put in its place, the likelihood of the population is the mean of
the weights of the draws (Hogg, Myers and Bovy 2010, ApJ 725, 2166). Everything here is in the coordinate of the
quantity.

A draw stands for a normal density about it, `SMOOTH` sds of its table wide (of its middle half where that is
narrower), and draws are drawn together by as much, so that mean and variance stay what they are (West 1993, J. R.
Stat. Soc. B 55, 409): else a spread of zero had no likelihood.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri
from scipy.stats import iqr

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
    def of(
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
