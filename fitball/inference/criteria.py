"""Akaike's and the Bayesian information criterion, from the maximised likelihood without priors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitball.inference.minimiser import Minimiser
from fitball.inference.posterior import Problem
from fitball.inference.residuals import Weighting, default_noise
from fitball.values import FloatArray

# Rounds of parameters for given noise, then noise for given parameters; a handful is enough, each raises the
# likelihood.
ROUNDS = 30
# Relative change of the noise at which the log likelihood, flat to first order there, of n measurements is settled
# to some n times its square: 1e-5 for a hundred.
SETTLED = 3e-4


@dataclass(frozen=True)
class Criteria:
    """`log_likelihood` at its maximum; `parameters` free ones, noise included, whether or not the table sees them;
    `measurements` n of the criteria. `aicc` is None where n leaves it undefined.
    """

    log_likelihood: float
    parameters: int
    measurements: int

    @property
    def aicc(self) -> float | None:
        """-2 ln L + 2 k + 2 k (k + 1) / (n - k - 1) (Hurvich and Tsai 1989)."""
        k, n = self.parameters, self.measurements
        if n - k - 1 <= 0:
            return None
        return -2.0 * self.log_likelihood + 2.0 * k + 2.0 * k * (k + 1) / (n - k - 1)

    @property
    def bic(self) -> float:
        """-2 ln L + k ln n (Schwarz 1978)."""
        return -2.0 * self.log_likelihood + self.parameters * math.log(self.measurements)


def criteria(problem: Problem, starts: Sequence[Mapping[str, float]]) -> Criteria:
    """Maximise the likelihood from `starts` (values by name), noise included, within the bounds of the parameters.

    What the scene knows of the contact time is prior knowledge and does not enter.
    """
    bare = replace(problem, contact_time=None)
    found = [_climb(bare, start) for start in starts]
    measurements = sum(channel.observed.size for channel in bare.channels)
    return Criteria(max(found), bare.dimension, measurements)


def _climb(problem: Problem, start: Mapping[str, float]) -> float:
    """The highest log likelihood reached from one start."""
    noise = {name: start[name] for name in default_noise(problem)}
    minimiser = Minimiser(problem, Weighting(noise, penalised=False))
    low, high = minimiser.limits()
    values = np.array([[start[name] for name in problem.free_names]])
    at = np.minimum(np.maximum(minimiser.to_fitted(values)[0], low), high)
    best = -math.inf
    for _ in range(ROUNDS):
        at = Minimiser(problem, Weighting(noise, penalised=False)).run(at).at
        following = _best_noise(problem, at, noise)
        settled = all(abs(math.log(following[name] / noise[name])) < SETTLED for name in noise)
        noise = following
        values = Minimiser(problem, Weighting(noise, penalised=False)).values(at[None, :])
        best = max(best, float(problem.log_likelihood(values, problem.rebound(values))[0]))
        if settled:
            break
    return best


def _best_noise(problem: Problem, at: FloatArray, noise: Mapping[str, float]) -> dict[str, float]:
    """The noise of highest likelihood for the residuals at fitted coordinates `at`: their root mean square.

    The likelihood of a noise has one peak, so where that lies beyond a bound, the bound is best.
    """
    values = Minimiser(problem, Weighting(noise, penalised=False)).values(at[None, :])
    rebound = problem.rebound(values)
    best = dict(noise)
    for item in problem.free:
        mine = [channel for channel in problem.channels if channel.noise == item.name]
        if not mine:
            continue
        z = [((c.observed - c.predict(rebound)) / c.spread(1.0, rebound)).ravel() for c in mine]
        best[item.name] = float(np.clip(np.sqrt(np.mean(np.concatenate(z) ** 2)), item.spec.lower, item.spec.upper))
    return best
