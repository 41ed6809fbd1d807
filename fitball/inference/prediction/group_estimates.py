"""What each surface, ball or table has of a parameter that differs between them."""

from __future__ import annotations

import numpy as np

from fitball.inference.problem.problem import Problem
from fitball.inference.results.quantiles import MEDIAN_FIRST, quantiles
from fitball.inference.results.results import LevelEstimate, PointFit, Posterior
from fitball.values import FloatArray


def group_estimates(problem: Problem, point: PointFit, posterior: Posterior | None) -> tuple[LevelEstimate, ...]:
    """The value at every level, at the point estimate and, with a posterior, its quantiles."""
    at_point = {name: np.array([value]) for name, value in point.values.items()}
    columns = None if posterior is None else problem.all_values(posterior.draws)
    estimates = []
    for pooling in problem.pooling:
        for place, label in enumerate(pooling.labels):
            draws: FloatArray | None = None if columns is None else pooling.value(columns, label)
            estimates.append(
                LevelEstimate(
                    pooling.parameter,
                    pooling.column,
                    label,
                    problem.model.specs[pooling.parameter].unit,
                    int(np.count_nonzero(pooling.index == place)),
                    float(pooling.value(at_point, label)[0]),
                    sd=None if draws is None else float(np.std(draws, ddof=1)),
                    **(dict.fromkeys(MEDIAN_FIRST) if draws is None else quantiles(draws, MEDIAN_FIRST)),
                )
            )
    return tuple(estimates)
