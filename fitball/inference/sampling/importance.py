"""Weighted draws: adaptive multiple importance sampling (Cornuet et al. 2012), Pareto smoothing.

Draws come from Student distributions that are fitted to them round by round, and all draws so far
are weighted by the mixture of all proposals so far.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import lgamma, log, pi

import numpy as np

from fitball.base.selection import evenly_spread
from fitball.base.values import FloatArray
from fitball.inference.sampling.convergence import arviz

# Draws of a round; rounds at most, and how many times as many draws as are asked for they may make.
ROUND = 500
ROUNDS = 16
LAVISH = 5.0
# Effective draws a parameter from which the next proposal is fitted; where there are fewer the
# weights are flattened, in steps, to so flat at most.
SPANNING = 5.0
FLATTER = 0.8
FLATTEST = 0.05
# Degrees of freedom of a fitted proposal, and what it is wider than its draws, in squares;
# condition of correlations from which they span no space.
FREEDOM = 8.0
WIDENING = 1.1
CONDITION = 1e12
# Parts of a proposal for chains, rounds that fit them, draws that these see; what keeps a part of
# few draws regular, as a share of the variance of all.
PARTS = 6
FITTING = 20
SEEN = 6_000
REGULAR = 1e-6
# Pareto k up to which weights are reliable (Vehtari et al. 2024, JMLR 25, 72); fewest draws in a
# tail.
RELIABLE = 0.7
LEAST_TAIL = 5


@dataclass(frozen=True)
class Student:
    """A multivariate t: `centre` (free,), lower `factor` (free, free) of its scale matrix, degrees
    of `freedom`.
    """

    centre: FloatArray
    factor: FloatArray
    freedom: float = 5.0

    def draw(self, rng: np.random.Generator | np.random.RandomState, count: int) -> FloatArray:
        """Coordinates (count, free)."""
        normal = rng.standard_normal((count, self.centre.size))
        stretch = np.sqrt(rng.chisquare(self.freedom, size=count) / self.freedom)
        return np.asarray(self.centre + normal @ self.factor.T / stretch[:, None])

    def log_density(self, x: FloatArray) -> FloatArray:
        """Normalised, (draws,), at coordinates (draws, free)."""
        z = (x - self.centre) @ self.whitening
        power = 0.5 * (self.freedom + self.centre.size)
        return np.asarray(self._at_centre - power * np.log1p(np.sum(z * z, axis=1) / self.freedom))

    @cached_property
    def whitening(self) -> FloatArray:
        """What makes deviations standard ones, (free, free): a chain asks for it at every step."""
        return np.asarray(np.linalg.inv(self.factor).T)

    @cached_property
    def _at_centre(self) -> float:
        nu = self.freedom
        size = self.centre.size
        constant = lgamma(0.5 * (nu + size)) - lgamma(0.5 * nu) - 0.5 * size * log(nu * pi)
        return float(constant - np.sum(np.log(np.diagonal(self.factor))))


def fitted(x: FloatArray, log_weights: FloatArray | None = None) -> Student | None:
    """The Student distribution of draws (draws, free), equal or weighted; None where they do not
    span the space.
    """
    log_weights = np.zeros(len(x)) if log_weights is None else log_weights
    power = 1.0
    while True:
        weights = np.exp(power * (log_weights - log_weights.max()))
        weights /= weights.sum()
        if 1.0 / np.sum(weights**2) >= SPANNING * x.shape[1] or power < FLATTEST:
            break
        power *= FLATTER
    # One draw that has all the weight spans nothing.
    if not np.sum(weights**2) < 1.0:
        return None
    covariance = np.atleast_2d(np.cov(x, rowvar=False, aweights=weights))
    scale = np.sqrt(np.diagonal(covariance))
    if not np.all(scale > 0.0) or np.linalg.cond(covariance / np.outer(scale, scale)) > CONDITION:
        return None
    return Student(
        weights @ x,
        np.asarray(np.linalg.cholesky(WIDENING * covariance), dtype=np.float64),
        FREEDOM,
    )


def parted(x: FloatArray, rng: np.random.Generator) -> list[tuple[float, Student]]:
    """Student distributions of parts of draws (draws, free) with their shares, by EM of normal ones
    (Dempster, Laird and Rubin 1977): together they follow a bent posterior, or one at a wall,
    closer than one does. Empty where the draws do not span the space.
    """
    x = x[evenly_spread(len(x), SEEN, down=True)]
    whole = fitted(x)
    if whole is None:
        return []
    # Of normal parts about the mean of all: units and scales of coordinates differ by powers of
    # ten.
    w = (x - whole.centre) @ whole.whitening
    logs = -np.sum((w - w[rng.choice(len(w), PARTS, replace=False), None]) ** 2, axis=2)
    parts = list[Student]()
    for _ in range(FITTING):
        belongs = np.exp(logs - np.logaddexp.reduce(logs))
        belongs = belongs[belongs.sum(axis=1) >= SPANNING * x.shape[1]]
        shares = belongs.mean(axis=1)
        parts = []
        normal = list[FloatArray]()
        for share, own in zip(shares, belongs / belongs.sum(axis=1, keepdims=True), strict=True):
            away = w - own @ w
            factor = np.linalg.cholesky((own * away.T) @ away + REGULAR * np.eye(x.shape[1]))
            z = away @ np.linalg.inv(factor).T
            normal.append(
                np.log(share) - np.sum(np.log(np.diagonal(factor))) - 0.5 * np.sum(z * z, axis=1)
            )
            centre = whole.centre + whole.factor @ (own @ w)
            parts.append(Student(centre, np.sqrt(WIDENING) * whole.factor @ factor, FREEDOM))
        logs = np.stack(normal)
    return list(zip((shares / shares.sum()).tolist(), parts, strict=True))


def importance(
    log_density: Callable[[FloatArray], FloatArray],
    begin: Sequence[Student],
    rng: np.random.Generator,
    enough: float,
) -> tuple[FloatArray, FloatArray, float]:
    """Coordinates (draws, free) of a log density, until their effective size is `enough`; log
    weights (draws,) that add up to one; Pareto k. No draws, and k infinite, where none is possible.
    """
    used = list[tuple[float, Student]]()
    proposals = [*begin]
    x = np.empty((0, begin[0].centre.size))
    score = np.empty(0)
    mixed = np.empty(0)
    weights = score
    for _ in range(max(ROUNDS, round(LAVISH * enough / ROUND))):
        count = -(-ROUND // len(proposals))
        new = np.concatenate([one.draw(rng, count) for one in proposals])
        now = [(log(count), one) for one in proposals]
        used += now
        x = np.concatenate([x, new])
        score = np.concatenate([score, log_density(new)])
        mixed = np.concatenate(
            [np.logaddexp(mixed, _mixture(now, x[: len(mixed)])), _mixture(used, new)]
        )
        if not np.isfinite(score).any():
            continue
        weights = _normalised(score - mixed)
        if effective(weights) >= enough:
            break
        following = fitted(x, weights)
        proposals = proposals if following is None else [following]
    possible = np.isfinite(score)
    if not possible.any():
        return x[possible], score[possible], np.inf
    return x[possible], weights[possible], smoothed(weights[possible], 1.0)[1]


def effective(log_weights: FloatArray) -> float:
    """Effective size of draws whose log weights add up to one (Kish)."""
    return float(1.0 / np.sum(np.exp(2.0 * log_weights)))


def _mixture(proposals: Sequence[tuple[float, Student]], x: FloatArray) -> FloatArray:
    """Log density (draws,) of draws from all proposals, each with the logarithm of their number."""
    return np.asarray(
        np.logaddexp.reduce([count + one.log_density(x) for count, one in proposals], axis=0)
    )


def _normalised(log_ratios: FloatArray) -> FloatArray:
    return np.asarray(log_ratios - np.logaddexp.reduce(log_ratios))


def smoothed(log_ratios: FloatArray, efficiency: float) -> tuple[FloatArray, float]:
    """Pareto-smoothed log weights (draws,) that add up to one, and k (Vehtari et al. 2024), of
    draws whose effective size over their number is `efficiency`. k is infinite where too few differ
    for a tail, -infinite where all ratios are equal.
    """
    size = int(min(log_ratios.size / 5.0, 3.0 * np.sqrt(log_ratios.size / efficiency)))
    tail = np.sort(log_ratios)[-size - 1 :]
    if np.ptp(log_ratios) <= 0.0:
        return _normalised(log_ratios), -np.inf
    # The fit divides by how far the first quartile of the tail lies above its edge.
    if size < LEAST_TAIL or not (tail[int(size / 4 + 0.5)] > tail[0] and tail[-1] > tail[1]):
        return _normalised(log_ratios), np.inf
    weights, k = arviz().psislw(-log_ratios, r_eff=efficiency, axis=-1)
    return weights, float(k)
