"""Importance sampling: weights, Pareto-smoothed by ArviZ where the largest of them have a tail to be fitted;
posteriors as weighted draws, of whole tables and without one impact.

Adaptive multiple importance sampling (Cornuet, Marin, Mira and Robert 2012, *Scand. J. Statist.* 39, 798): draws come
from Student distributions that are fitted to them round by round, and all draws so far are weighted by the mixture of
all proposals so far. Batches suit the kernels: some thousand draws cost less than the search for one maximum.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.special import logsumexp

from fitball.inference.likelihood.posterior import log_posterior, pointwise
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import withheld
from fitball.inference.sampling.moves import StudentProposal
from fitball.values import FloatArray

# Draws in a tail that a Pareto distribution can be fitted to, at least.
LEAST_TAIL = 5
# Above this shape of the fitted Pareto tail the importance sampling estimate is not to be trusted (Vehtari, Simpson,
# Gelman, Yao and Gabry 2024).
K_TRUSTED = 0.7


def smoothed(log_ratios: FloatArray, efficiency: float) -> tuple[FloatArray, float]:
    """Logarithms of weights (draws,) that add up to one, from those of importance ratios (draws,), and the Pareto k.

    Where the draws have no tail to be fitted, because walkers sat there or the ratios hardly differ, the weights are
    the ratios themselves and k is infinite, "unreliable"; it is -infinite where all ratios are equal, for those are
    exact. `efficiency` is the effective sample size over the number of draws.
    """
    from fitball.inference.sampling.array_stats import array_stats

    ratios = np.exp(log_ratios - log_ratios.max())
    if np.ptp(ratios) <= 0.0:
        return np.full(ratios.shape, -np.log(ratios.size)), -np.inf
    if not has_tail(ratios, efficiency):
        return log_ratios - logsumexp(log_ratios), np.inf
    weights, k = array_stats.psislw(-log_ratios, r_eff=efficiency, axis=-1)
    return weights, float(k)


def smoothed_elpd(
    whole: FloatArray, scored: FloatArray, efficiency: float, log_weights: FloatArray | float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Leave-one-out log densities (impacts,) by Pareto smoothed importance sampling, and the Pareto k (impacts,).

    `whole` (draws, impacts) is the log likelihood of all measurements of an impact, which is what leaving it out
    takes away; `scored` (draws, impacts) that of the measurements to be scored, the same or a part of it.
    `efficiency` is the effective sample size over the number of draws (Vehtari, Gelman and Gabry 2017);
    `log_weights` (draws,) are those of draws that are weighted already.
    """
    count = whole.shape[1]
    elpd, pareto_k = np.empty(count), np.empty(count)
    for row in range(count):
        own, pareto_k[row] = smoothed(log_weights - whole[:, row], efficiency)
        elpd[row] = logsumexp(own + scored[:, row])
    return elpd, pareto_k


def has_tail(ratios: FloatArray, efficiency: float) -> bool:
    """Whether a Pareto distribution can be fitted to the largest of the ratios (draws,).

    The fit divides by how far the first quartile of the tail lies above its edge, the largest ratio outside: draws
    that are tied there make it zero. Sizes as Vehtari, Simpson, Gelman, Yao and Gabry (2024) have them.
    """
    count = ratios.size
    size = int(min(count / 5.0, 3.0 * np.sqrt(count / efficiency)))
    if size < LEAST_TAIL:
        return False
    tail = np.sort(ratios)[-size - 1 :]
    return bool(tail[int(size / 4 + 0.5)] > tail[0] and tail[-1] > tail[1])


# Draws of a round; rounds at most, and how many times as many draws as are asked for they may make.
ROUND, ROUNDS, LAVISH = 500, 16, 5.0
# Effective draws that end the rounds, and those below which nothing is said.
ENOUGH, LEAST = 400.0, 100.0
# Effective draws a parameter from which the next proposal is fitted; where there are fewer the weights are flattened.
SPANNING = 5.0
FLATTER, FLATTEST = 0.8, 0.05


@dataclass(frozen=True)
class WeightedDraws:
    """Draws of a posterior: `values` (draws, free) in SI with `log_weights` (draws,) that add up to one, and their
    effective sample size; their log density `score` (draws,), where they were drawn for it.
    """

    values: FloatArray
    log_weights: FloatArray
    effective: float
    score: FloatArray | None = None

    @property
    def settled(self) -> bool:
        """Whether the effective sample is large enough."""
        return self.effective >= LEAST


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
    """Weighted draws of the posterior, with an effective sample of `enough` if possible, from the proposals that it
    is `begun` with; or of another log `density` of a problem at coordinates (draws, free).
    """
    fitted = [*begun]
    proposals: list[tuple[float, StudentProposal]] = []
    coordinates, score = np.empty((0, problem.dimension)), np.empty(0)
    # Log densities (proposals, draws): those of a round's draws and proposals join those of the rounds before.
    drawn_from = np.empty((0, 0))
    for _ in range(max(ROUNDS, round(LAVISH * enough / ROUND))):
        known = len(coordinates)
        added = [within_bounds(problem, partial(proposal.draw, rng), ROUND // len(fitted)) for proposal in fitted]
        drawn = np.concatenate([own for own, _share in added])
        before = proposals
        now = [(len(own) / share, proposal) for (own, share), proposal in zip(added, fitted, strict=True)]
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


def within_bounds(problem: Problem, draw: Callable[[int], FloatArray], count: int) -> tuple[FloatArray, float]:
    """What `draw(count)` gives (count, free), and the share of it from which it is: all of it, or where most is
    outside of the priors' bounds, as about scatter of zero, the part inside.
    """
    drawn = draw(count)
    inside = np.isfinite(problem.prior.log_density(drawn))
    if np.mean(inside) >= MOSTLY:
        return drawn, 1.0
    kept, tried = [drawn[inside]], count
    while (found := sum(map(len, kept))) < max(count, COUNTED) and tried < MOST_TRIED:
        more = draw(TRIED)
        kept.append(more[np.isfinite(problem.prior.log_density(more))])
        tried += TRIED
    return (np.concatenate(kept)[:count], found / tried) if found >= count else (drawn, 1.0)


def _log_densities(proposals: Sequence[tuple[float, StudentProposal]], coordinates: FloatArray) -> FloatArray:
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


# Of proposals less of which is inside the bounds only that part is drawn from. Its share is counted from so many
# draws inside, which gives it to 2 %, of so many at a time and at most.
MOSTLY, COUNTED, TRIED, MOST_TRIED = 0.5, 2000, 20_000, 1_000_000

# Share of the draws asked for that a refit must be worth at least.
WORTH = 0.4
# Of these the share that must meet the posterior with the impact: of 400 then 100, by which its density is known to
# a tenth.
MEETING = 0.25


@dataclass(frozen=True)
class Refitted:
    """Draws of a posterior without an impact, with smoothed weights, and the log density `elpd` of that impact."""

    draws: WeightedDraws
    elpd: float


def refitted(
    problem: Problem,
    whole: WeightedDraws,
    likelihood: FloatArray,
    row: int,
    columns: Sequence[str],
    rng: np.random.Generator,
    enough: float,
    beside: Sequence[StudentProposal] = (),
) -> Refitted | None:
    """Draws of the posterior without the measurements of the impact `row`, with an effective sample of `enough` if
    possible, and its log density by the measured `columns`.

    Importance sampling by proposals that are adapted to that posterior: from draws of the `whole`, as they are and as
    weighted without the impact, whose log `likelihood` (draws,) there is known, and those `beside`. None where its
    Pareto k is unreliable too, its effective sample is too small, or its draws hardly overlap those of the whole.
    """
    held = replace(withheld(problem, np.array([row])), force=problem.force)
    coordinates = problem.to_coordinates(whole.values)
    without = smoothed(whole.log_weights - likelihood, 1.0)[0]
    fitted = [fitted_to(coordinates, weights) for weights in (whole.log_weights, without)]
    proposals = [*(proposal for proposal in fitted if proposal is not None), *beside]
    if not proposals:
        return None
    drawn = importance_posterior(held, proposals, rng, enough)
    if drawn.effective < WORTH * enough:
        return None
    weights, pareto_k = smoothed(drawn.log_weights, 1.0)
    shares = weights + pointwise(problem, drawn.values, columns)[1][:, row]
    told = float(logsumexp(shares))
    if pareto_k > K_TRUSTED or 2.0 * told - logsumexp(2.0 * shares) < np.log(MEETING * WORTH * enough):
        return None
    return Refitted(replace(drawn, log_weights=weights), told)
