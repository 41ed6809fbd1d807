"""Probability integral transforms of measurements that were left out: is each where the others say it would be?"""

from __future__ import annotations

import numpy as np

from fitball.inference.likelihood.incident_marginal import incident_sds
from fitball.inference.likelihood.posterior import impact_terms
from fitball.inference.prediction.posterior_predictive import with_noise
from fitball.inference.problem.batches import cells
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import part_of
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
    count = len(problem.impacts)
    size = max(1, cells(problem) // len(values))
    parts = []
    for start in range(0, count, size):
        rows = np.arange(start, min(start + size, count))
        part = problem if rows.size == count else part_of(problem, rows)
        parts.append(_at_impacts(part, values, count <= LEFT_OUT, rng))
    return np.concatenate(parts, axis=1)


def _at_impacts(problem: Problem, values: FloatArray, leave_out: bool, rng: np.random.Generator) -> FloatArray:
    rebound = problem.rebound(values)
    columns = problem.all_values(values)
    weights = np.full((len(values), len(problem.impacts)), 1.0 / len(values))
    if leave_out:
        whole = np.sum(list(impact_terms(problem, values, rebound).values()), axis=0)
        weights = np.exp(np.stack([smoothed(-one, 1.0)[0] for one in whole.T], axis=1))
    by_incidence = incident_sds(problem, columns, rebound)
    shares = []
    for observable in (item.everywhere(len(problem.impacts)) for item in problem.observables):
        _, _, data = with_noise(problem.noise, observable, columns, rebound, rng, by_incidence[observable.name])
        if problem.group_bias is not None:
            data = data + problem.group_bias.offset(columns, observable.name)
        below = (data < observable.observed) + 0.5 * (data == observable.observed)
        shares.append(np.where(np.isnan(observable.observed), np.nan, np.sum(weights * below, axis=0)))
    return np.stack(shares)
