"""A posterior quickly: weighted draws from a Student distribution that is fitted to them round by round.

Adaptive multiple importance sampling (Cornuet, Marin, Mira and Robert 2012, *Scand. J. Statist.* 39, 798): all draws
so far are weighted by the mixture of all proposals so far. Batches suit the kernels: some thousand draws cost less
than the search for one maximum.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from fitball.inference.likelihood.posterior import log_posterior
from fitball.inference.problem.problem import Problem
from fitball.inference.sampling.moves import StudentProposal
from fitball.values import FloatArray

# Draws of a round; rounds at most, and how many times as many draws as are asked for they may make.
ROUND, ROUNDS, LAVISH = 500, 16, 5.0
# Effective draws that end the rounds, and those below which nothing is said.
ENOUGH, LEAST = 400.0, 100.0
# Effective draws a parameter from which the next proposal is fitted; where there are fewer the weights are flattened.
SPANNING = 5.0
FLATTER, FLATTEST = 0.8, 0.05


@dataclass(frozen=True)
class WeightedDraws:
    """Draws of a posterior: `values` (draws, free) in SI with `log_weights` (draws,) that add up to one, and how many
    independent draws they are worth; their log density `score` (draws,), where they were drawn for it.
    """

    values: FloatArray
    log_weights: FloatArray
    effective: float
    score: FloatArray | None = None

    @property
    def settled(self) -> bool:
        """Whether there are draws enough to say something."""
        return self.effective >= LEAST

    def quantiles(self, column: FloatArray, levels: FloatArray) -> FloatArray:
        """Quantiles (levels,) of a quantity (draws,), among the draws for which it is finite."""
        known = np.isfinite(column)
        weights = np.exp(self.log_weights[known])
        return np.asarray(np.quantile(column[known], levels, weights=weights, method="inverted_cdf"))

    def sd(self, column: FloatArray) -> float:
        """Standard deviation of a quantity (draws,), among the draws for which it is finite."""
        known = np.isfinite(column)
        weights = np.exp(self.log_weights[known])
        mean = np.average(column[known], weights=weights)
        return float(np.sqrt(np.average((column[known] - mean) ** 2, weights=weights)))


def equal_draws(values: FloatArray) -> WeightedDraws:
    """Draws (draws, free) of a chain, all of one weight."""
    return WeightedDraws(values, np.full(len(values), -np.log(len(values))), float(len(values)))


def importance_posterior(
    problem: Problem,
    begun: Sequence[StudentProposal],
    rng: np.random.Generator,
    enough: float = ENOUGH,
    density: Callable[[Problem, FloatArray], FloatArray] = log_posterior,
) -> WeightedDraws:
    """Weighted draws of the posterior, worth `enough` independent ones if so many can be had, from the proposals that
    it is `begun` with; or of another log `density` of a problem at coordinates (draws, free).
    """
    fitted = [*begun]
    proposals: list[tuple[int, StudentProposal]] = []
    coordinates, score = np.empty((0, problem.dimension)), np.empty(0)
    # Log densities (proposals, draws): those of a round's draws and proposals join those of the rounds before.
    drawn_from = np.empty((0, 0))
    for _ in range(max(ROUNDS, round(LAVISH * enough / ROUND))):
        known = len(coordinates)
        added = [proposal.draw(rng, ROUND // len(fitted)) for proposal in fitted]
        drawn = np.concatenate(added)
        before, now = proposals, [(len(own), proposal) for own, proposal in zip(added, fitted, strict=True)]
        proposals = [*before, *now]
        coordinates, score = (
            np.concatenate([coordinates, drawn]),
            np.concatenate([score, density(problem, drawn)]),
        )
        drawn_from = np.block([
            [drawn_from, _log_densities(before, drawn)],
            [_log_densities(now, coordinates[:known]), _log_densities(now, drawn)],
        ])  # fmt: skip
        if not np.any(np.isfinite(score)):
            return WeightedDraws(np.empty((0, problem.dimension)), np.empty(0), 0.0)
        ratios = score - logsumexp(drawn_from, axis=0)
        log_weights = ratios - logsumexp(ratios)
        effective = float(1.0 / np.sum(np.exp(2.0 * log_weights)))
        if effective >= enough:
            break
        following = fitted_to(coordinates, log_weights)
        fitted = fitted if following is None else [following]
    possible = np.isfinite(log_weights)
    return WeightedDraws(problem.to_values(coordinates[possible]), log_weights[possible], effective, score[possible])


def _log_densities(proposals: Sequence[tuple[int, StudentProposal]], coordinates: FloatArray) -> FloatArray:
    """Those (proposals, draws) of each proposal at coordinates (draws, free), all times their numbers of draws."""
    rows = [np.log(count) + one.log_density(coordinates) - one.log_volume for count, one in proposals]
    return np.array(rows).reshape(len(proposals), len(coordinates))


def fitted_to(coordinates: FloatArray, log_weights: FloatArray) -> StudentProposal | None:
    """The proposal fitted to weighted draws (draws, free); None where they do not span the space."""
    needed, power = SPANNING * coordinates.shape[1], 1.0
    while True:
        weights = np.exp(power * (log_weights - log_weights.max()))
        weights /= weights.sum()
        if 1.0 / np.sum(weights**2) >= needed or power < FLATTEST:
            break
        power *= FLATTER
    return StudentProposal.fit(coordinates, weights)
