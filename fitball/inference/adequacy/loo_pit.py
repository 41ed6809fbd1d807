"""Probability integral transforms of measurements that were left out: is each where the others say it would be?"""

from __future__ import annotations

import numpy as np

from fitball.inference.likelihood.posterior import impact_terms
from fitball.inference.prediction.posterior_predictive import measurements
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import impacts_in_parts
from fitball.inference.results.results import Posterior, thinned
from fitball.inference.sampling.importance import smoothed
from fitball.values import FloatArray

# Draws that stand for a posterior, and rows beyond which leaving one of them out changes nothing that could be seen.
DRAWS, LEFT_OUT = 1000, 400


def loo_pit(problem: Problem, posterior: Posterior, rng: np.random.Generator) -> FloatArray:
    """The share of the posterior without its impact that predicts less than each measurement, (columns, impacts), NaN
    where there is none.

    By Pareto smoothed importance sampling (Vehtari, Gelman and Gabry 2017; the weights are ArviZ's), each draw with a
    noise of its own.
    """
    values = thinned(posterior, DRAWS)
    leave_out = len(problem.impacts) <= LEFT_OUT
    parts = [_at_impacts(part, values, leave_out, rng) for _rows, part in impacts_in_parts(problem, len(values))]
    return np.concatenate(parts, axis=1)


def _at_impacts(problem: Problem, values: FloatArray, leave_out: bool, rng: np.random.Generator) -> FloatArray:
    rebound = problem.rebound(values)
    columns = problem.all_values(values)
    weights = np.full((len(values), len(problem.impacts)), 1.0 / len(values))
    if leave_out:
        whole = np.sum(list(impact_terms(problem, values, rebound).values()), axis=0)
        weights = np.exp(np.stack([smoothed(-one, 1.0)[0] for one in whole.T], axis=1))
    shares = []
    for observable, _predicted, _spread, data in measurements(problem, columns, rebound, rng):
        below = (data < observable.observed) + 0.5 * (data == observable.observed)
        shares.append(np.where(np.isnan(observable.observed), np.nan, np.sum(weights * below, axis=0)))
    return np.stack(shares)
