"""The posterior without one impact, drawn anew: for those whose importance weights are not to be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from fitball.inference.likelihood.posterior import pointwise
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import withheld
from fitball.inference.sampling.importance import K_TRUSTED, smoothed
from fitball.inference.sampling.importance_posterior import WeightedDraws, fitted_to, importance_posterior
from fitball.inference.sampling.moves import StudentProposal
from fitball.values import FloatArray

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
    """Draws of the posterior without the measurements of the impact `row`, worth `enough` independent ones if so many
    can be had, and its log density by the measured `columns`.

    Importance sampling by proposals that are adapted to that posterior: from draws of the `whole`, as they are and as
    weighted without the impact, whose log `likelihood` (draws,) there is known, and those `beside`. None where its
    Pareto k is not to be trusted either, it is worth too little, or its draws hardly meet those of the whole.
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
