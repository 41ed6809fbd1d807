"""Coordinates in which levels of a pooled parameter are nearly normal and independent of their spread: for moves.

With `q` the common value, `tau` the spread and `z` a place, a level lies at `q + tau z`. Where the data determine a
level well that sum is almost known, and `q`, `tau`, `z` lie on a curved, narrow ridge; where they hardly do, `z`
follows its prior. Between these lies a partial centring, by the information of the data (Papaspiliopoulos, Roberts
and Skoeld 2007, Statist. Sci. 22, 59). Were the table a normal measurement `m` of the level with precision `p`, then

    w = (z (1 + p tau^2) + (q - m) p tau) / sqrt(1 + p tau^2)

would be standard normal whatever `q` and `tau`, and `q` given `tau` normal with the precision `sum p/(1 + p tau^2)`
and that of its prior. Sampling moves walkers in `w`, the standardised `q`, and `ln tau`. `m` and `p` are those under
which the draws of the warm-up are likeliest; were they wrong, moves would be refused more often, and nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from fitball.inference.problem.pooling import Pooling
from fitball.inference.problem.problem import Problem
from fitball.values import FloatArray

# Draws of the warm-up that teach a level, and logarithms of the precision (times the mean squared spread) among which
# that is sought: from one that tells nothing to one that knows the level to a thousandth of the spread.
TAUGHT = 2000
LEAST, MOST = -12.0, 14.0


@dataclass(frozen=True)
class LevelCoordinates:
    """Those of one pooled parameter: the columns of common value (None: held at `held`), spread and places (levels,)
    among the coordinates of a problem; `mean` and `precision` (levels,) as above; `prior_mean` and
    `prior_precision` of the common value; `log` whether the spread's own coordinate is its logarithm.
    """

    common: int | None
    spread: int
    places: NDArray[np.int64]
    mean: FloatArray
    precision: FloatArray
    prior_mean: float
    prior_precision: float
    log: bool
    held: float = 0.0

    def straighten(self, coordinates: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Coordinates (draws, free) replaced by straight ones, and the log of the volume (draws,) that a unit of the
        former takes among the latter.
        """
        straight = coordinates.copy()
        x = coordinates[:, self.spread]
        tau = np.exp(x) if self.log else x
        known = 1.0 + self.precision * (tau * tau)[:, None]
        q = np.full(len(x), self.held) if self.common is None else coordinates[:, self.common]
        away = (q[:, None] - self.mean) * self.precision * tau[:, None]
        straight[:, self.places] = (coordinates[:, self.places] * known + away) / np.sqrt(known)
        volume = 0.5 * np.log(known).sum(axis=1)
        if self.common is not None:
            middle, root = self._common(known)
            straight[:, self.common] = (q - middle) * root
            volume += np.log(root)
        if not self.log:
            straight[:, self.spread] = np.log(tau)
            volume -= straight[:, self.spread]
        return straight, volume

    def bend(self, straight: FloatArray) -> FloatArray:
        """Inverse of `straighten`: coordinates (draws, free)."""
        coordinates = straight.copy()
        tau = np.exp(straight[:, self.spread])
        known = 1.0 + self.precision * (tau * tau)[:, None]
        q = np.full(len(tau), self.held)
        if self.common is not None:
            middle, root = self._common(known)
            q = coordinates[:, self.common] = middle + straight[:, self.common] / root
        away = (q[:, None] - self.mean) * self.precision * tau[:, None]
        coordinates[:, self.places] = (straight[:, self.places] * np.sqrt(known) - away) / known
        if not self.log:
            coordinates[:, self.spread] = tau
        return coordinates

    def _common(self, known: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean of the common value and root of its precision, each (draws,), `known` being `1 + p tau^2`."""
        weight = self.precision / known
        precision = self.prior_precision + weight.sum(axis=1)
        middle = (self.prior_precision * self.prior_mean + weight @ self.mean) / precision
        return middle, np.sqrt(precision)


def taught_level(level: FloatArray, common: FloatArray, spread: FloatArray) -> tuple[float, float]:
    """Mean and precision under which draws (draws,) of a level, the common value and the spread are likeliest."""
    place, square = (level - common) / spread, spread * spread
    scale = float(np.mean(square))

    def best_mean(precision: float) -> tuple[float, float]:
        """The best mean for a precision, and minus the mean log density."""
        known = 1.0 + precision * square
        slope = precision * spread / np.sqrt(known)
        at_zero = place * np.sqrt(known) + common * slope
        mean = float(at_zero @ slope / (slope @ slope))
        w = at_zero - slope * mean
        return mean, float(np.mean(0.5 * w * w - 0.5 * np.log(known)))

    found = minimize_scalar(
        lambda x: best_mean(np.exp(x) / scale)[1], bounds=(LEAST, MOST), method="bounded", options={"xatol": 1e-2}
    )
    precision = float(np.exp(found.x) / scale)
    return best_mean(precision)[0], precision


@dataclass(frozen=True)
class Straight:
    """Straight coordinates of a whole problem: those of each of its pooled parameters, in turn; none without any."""

    levels: Sequence[LevelCoordinates] = ()

    def straighten(self, coordinates: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `LevelCoordinates.straighten`."""
        volume = np.zeros(len(coordinates))
        for level in self.levels:
            coordinates, more = level.straighten(coordinates)
            volume += more
        return coordinates, volume

    def bend(self, straight: FloatArray) -> FloatArray:
        """See `LevelCoordinates.bend`."""
        for level in self.levels:
            straight = level.bend(straight)
        return straight


def straight_coordinates(problem: Problem, taught: FloatArray) -> Straight:
    """Those of a problem, learnt from draws (draws, free) in its coordinates. A parameter whose spread is held has
    none: there the ridge is straight.
    """
    if not problem.pooling:
        return Straight()
    some = taught[np.linspace(0, len(taught) - 1, min(TAUGHT, len(taught))).astype(int)]
    names = problem.free_names
    return Straight(
        tuple(
            _of(problem, pooling, some)
            for pooling in problem.pooling
            if pooling.spread_name in names and _places(problem, pooling)
        )
    )


def _places(problem: Problem, pooling: Pooling) -> list[int]:
    names = problem.free_names
    return [names.index(name) for name in map(pooling.place_name, pooling.labels) if name in names]


def _of(problem: Problem, pooling: Pooling, draws: FloatArray) -> LevelCoordinates:
    parameter = next(item for item in problem.parameters if item.name == pooling.parameter)
    spread, prior = problem.free_names.index(pooling.spread_name), parameter.prior
    log = problem.free[spread].prior.log
    tau = np.exp(draws[:, spread]) if log else draws[:, spread]
    common, held = None, 0.0
    if parameter.fixed is None:
        common = problem.free_names.index(parameter.name)
    else:
        held = float(prior.coordinate(np.array(parameter.fixed)))
    q = np.full(len(tau), held) if common is None else draws[:, common]
    places = _places(problem, pooling)
    learnt = np.array([taught_level(q + tau * draws[:, k], q, tau) for k in places])
    middle = float(prior.coordinate(prior.quantile(np.array(0.5))))
    return LevelCoordinates(
        common, spread, np.array(places), learnt[:, 0], learnt[:, 1], middle, 1.0 / prior.variance, log, held
    )
