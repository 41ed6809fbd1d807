"""Probability integral transforms of measurements that were left out: is each where the others say it would be?"""

from __future__ import annotations

import numpy as np

from fitball.inference.likelihood.posterior import impact_terms
from fitball.inference.prediction.posterior_predictive import measurements
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import impacts_in_parts, part_of
from fitball.inference.results.results import Posterior, thinned
from fitball.inference.sampling.importance import K_TRUSTED, equal_draws, refitted, smoothed
from fitball.models.types import Rebound
from fitball.values import FloatArray

# Draws that stand for a posterior, and rows beyond which leaving one of them out changes nothing that could be seen.
DRAWS, LEFT_OUT = 1000, 400
# Effective draws of a refit: a share is then known to 0.04, less than one place among 15 that are looked at together.
REFIT_DRAWS = 200.0


def loo_pit(problem: Problem, posterior: Posterior, rng: np.random.Generator) -> FloatArray:
    """The share of the posterior without its impact that predicts less than each measurement, (columns, impacts), NaN
    where there is none.

    By Pareto smoothed importance sampling (Vehtari, Gelman and Gabry 2017; the weights are ArviZ's), each draw with a
    noise of its own; where its k is not to be trusted by a refit, if that settles.
    """
    values, leave_out = thinned(posterior, DRAWS), len(problem.impacts) <= LEFT_OUT
    parts = [_at_impacts(part, values, leave_out, rng) for _rows, part in impacts_in_parts(problem, len(values))]
    shares, whole, pareto_k = (np.concatenate(of, axis=-1) for of in zip(*parts, strict=True))
    columns = [observable.name for observable in problem.observables]
    for row in np.flatnonzero(~(pareto_k <= K_TRUSTED)).tolist():
        again = refitted(problem, equal_draws(values), whole[:, row], row, columns, rng, REFIT_DRAWS)
        if again is not None:
            alone, drawn = part_of(problem, np.array([row])), again.draws
            weights = np.exp(drawn.log_weights)[:, None]
            shares[:, row] = _shares(alone, drawn.values, alone.rebound(drawn.values), weights, rng)[:, 0]
    return shares


def _at_impacts(
    problem: Problem, values: FloatArray, leave_out: bool, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The shares by smoothed weights, the log likelihood (draws, impacts) of each impact, and the Pareto k (impacts,)
    of leaving it out; -inf where none is left out.
    """
    rebound = problem.rebound(values)
    whole = np.sum(list(impact_terms(problem, values, rebound).values()), axis=0)
    found = [smoothed(-one if leave_out else np.zeros(len(values)), 1.0) for one in whole.T]
    weights = np.exp(np.stack([own for own, _k in found], axis=1))
    return _shares(problem, values, rebound, weights, rng), whole, np.array([k for _own, k in found])


def _shares(
    problem: Problem, values: FloatArray, rebound: Rebound, weights: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """The share of draws (draws, free) with `weights` (draws, impacts) that lie below each measurement."""
    shares = []
    for observable, _predicted, _spread, data in measurements(problem, problem.all_values(values), rebound, rng):
        below = (data < observable.observed) + 0.5 * (data == observable.observed)
        shares.append(np.where(np.isnan(observable.observed), np.nan, np.sum(weights * below, axis=0)))
    return np.stack(shares)
