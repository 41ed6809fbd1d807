"""Draws of a posterior to first order, where there are none of a sampler."""

from __future__ import annotations

import numpy as np

from fitball.inference.identifiability.fisher import fisher_information, inverse, prior_sds
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import PointFit
from fitball.values import FloatArray


def first_order_draws(problem: Problem, point: PointFit, count: int, rng: np.random.Generator) -> FloatArray:
    """Free values (count, free) in SI of the normal distribution about a point that the information of table, scene
    and priors promises, within the bounds.
    """
    at = problem.to_coordinates(np.array([[point.values[name] for name in problem.free_names]]))[0]
    width = problem.prior.width * prior_sds(problem)
    information = np.nan_to_num(fisher_information(problem, at, scene=True))
    factor = np.linalg.cholesky(inverse(information, 1.0)) * width[:, None]
    draws = at + rng.standard_normal((count, at.size)) @ factor.T
    return problem.to_values(np.clip(draws, *problem.prior.limits))
