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

# Draws of a round, after which the proposal is fitted again.
ROUND = 500
# Rounds at most, unless many draws are wanted.
ROUNDS = 16
# How many times as many draws as are wanted may be made: weights cost some of them.
LAVISH = 5.0
# Effective draws a parameter from which the next proposal is fitted; where there are fewer the
# weights are flattened.
SPANNING = 5.0
# By so much in the exponent at each step of that.
FLATTER = 0.8
# And to this exponent at most, where all draws count nearly alike.
FLATTEST = 0.05
# Degrees of freedom of a fitted proposal: its tails are heavier than those of most posteriors.
FREEDOM = 8.0
# What a fitted proposal is wider than its draws, in squares: what is narrower has weights without
# end.
WIDENING = 1.1
# Condition of correlations from which draws span no space but for rounding.
CONDITION = 1e12
# Parts of a proposal for chains: enough for a bent posterior, few enough to have draws each.
PARTS = 6
# Rounds of the EM that fits the parts; a proposal need not be exact.
FITTING = 20
# Draws that the parts are fitted to: more cost time and move them little.
SEEN = 6_000
# What keeps a part of few draws regular, as a share of the variance of all.
REGULAR = 1e-6
# Pareto k up to which weights are reliable (Vehtari et al. 2024, JMLR 25, 72).
RELIABLE = 0.7
# Fewest draws in a tail to which a Pareto distribution is fitted.
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
        square = np.sum(z * z, axis=1)
        return np.asarray(self._at_centre - power * np.log1p(square / self.freedom))

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


def fit_student(x: FloatArray, log_weights: FloatArray | None = None) -> Student | None:
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
    if not np.all(scale > 0.0):
        return None
    correlation = covariance / np.outer(scale, scale)
    if np.linalg.cond(correlation) > CONDITION:
        return None
    factor = np.asarray(np.linalg.cholesky(WIDENING * covariance), dtype=np.float64)
    return Student(weights @ x, factor, FREEDOM)


def fit_mixture(x: FloatArray, rng: np.random.Generator) -> list[tuple[float, Student]]:
    """Student distributions of parts of draws (draws, free) with their shares, by EM of normal ones
    (Dempster, Laird and Rubin 1977): together they follow a bent posterior, or one at a wall,
    closer than one does. Empty where the draws do not span the space.
    """
    x = x[evenly_spread(len(x), SEEN, down=True)]
    whole = fit_student(x)
    if whole is None:
        return []
    # Of normal parts about the mean of all: units and scales of coordinates differ by powers of
    # ten.
    w = (x - whole.centre) @ whole.whitening
    middles = w[rng.choice(len(w), PARTS, replace=False), None]
    logs = -np.sum((w - middles) ** 2, axis=2)
    parts = list[Student]()
    for _ in range(FITTING):
        belongs = np.exp(logs - np.logaddexp.reduce(logs))
        belongs = belongs[belongs.sum(axis=1) >= SPANNING * x.shape[1]]
        shares = belongs.mean(axis=1)
        parts = []
        normal = list[FloatArray]()
        weights = belongs / belongs.sum(axis=1, keepdims=True)
        for share, weight in zip(shares, weights, strict=True):
            middle = weight @ w
            away = w - middle
            covariance = (weight * away.T) @ away
            factor = np.linalg.cholesky(covariance + REGULAR * np.eye(x.shape[1]))
            z = away @ np.linalg.inv(factor).T
            size = np.sum(np.log(np.diagonal(factor)))
            normal.append(np.log(share) - size - 0.5 * np.sum(z * z, axis=1))
            centre = whole.centre + whole.factor @ middle
            wider = np.sqrt(WIDENING) * whole.factor @ factor
            parts.append(Student(centre, wider, FREEDOM))
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
        new = np.concatenate([student.draw(rng, count) for student in proposals])
        now = [(log(count), student) for student in proposals]
        used += now
        before = np.logaddexp(mixed, _mixture(now, x))
        mixed = np.concatenate([before, _mixture(used, new)])
        x = np.concatenate([x, new])
        score = np.concatenate([score, log_density(new)])
        if not np.isfinite(score).any():
            continue
        weights = _normalised(score - mixed)
        if effective_size(weights) >= enough:
            break
        following = fit_student(x, weights)
        proposals = proposals if following is None else [following]
    possible = np.isfinite(score)
    if not possible.any():
        return x[possible], score[possible], np.inf
    return x[possible], weights[possible], pareto_smoothed(weights[possible], 1.0)[1]


def effective_size(log_weights: FloatArray) -> float:
    """Effective size of draws whose log weights add up to one (Kish)."""
    return float(1.0 / np.sum(np.exp(2.0 * log_weights)))


def _mixture(proposals: Sequence[tuple[float, Student]], x: FloatArray) -> FloatArray:
    """Log density (draws,) of draws from all proposals, each with the logarithm of their number."""
    densities = [count + student.log_density(x) for count, student in proposals]
    return np.asarray(np.logaddexp.reduce(densities, axis=0))


def _normalised(log_ratios: FloatArray) -> FloatArray:
    return np.asarray(log_ratios - np.logaddexp.reduce(log_ratios))


def pareto_smoothed(log_ratios: FloatArray, efficiency: float) -> tuple[FloatArray, float]:
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
