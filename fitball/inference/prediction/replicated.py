"""What draws of the posterior say of the table, draw by draw: how probable each impact is, and tables like it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitball.inference.likelihood.incident_marginal import incident_sds
from fitball.inference.likelihood.posterior import impact_terms
from fitball.inference.prediction.posterior_predictive import with_noise
from fitball.inference.problem.batches import batches
from fitball.inference.problem.problem import Problem
from fitball.values import FloatArray


@dataclass(frozen=True)
class Replicated:
    """Of each draw: the log likelihood of all measurements of each impact together (draws, impacts), and new
    measurements of every column at the same impacts, column -> (draws, impacts) in SI, NaN where a column of stated
    sds states none.
    """

    log_likelihood: FloatArray
    measurements: Mapping[str, FloatArray]


def replicated(problem: Problem, values: FloatArray, rng: np.random.Generator) -> Replicated:
    """For free values (draws, free), some draws at a time."""
    densities, tables = [], []
    for some in batches(problem, values.shape[0]):
        rebound = problem.rebound(values[some])
        terms = impact_terms(problem, values[some], rebound)
        densities.append(np.sum(list(terms.values()), axis=0))
        columns = problem.all_values(values[some])
        by_incidence = incident_sds(problem, columns, rebound)
        made = {}
        for item in (item.everywhere(len(problem.impacts)) for item in problem.observables):
            _mean, _spread, data = with_noise(problem.noise, item, columns, rebound, rng, by_incidence[item.name])
            bias = 0.0 if problem.group_bias is None else problem.group_bias.offset(columns, item.name)
            made[item.name] = data + bias
        tables.append(made)
    return Replicated(
        np.concatenate(densities), {name: np.concatenate([part[name] for part in tables]) for name in tables[0]}
    )
