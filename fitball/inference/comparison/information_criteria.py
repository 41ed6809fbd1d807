"""Akaike's and the Bayesian information criterion, from the maximised likelihood without priors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fitball.inference.identifiability.profile_path import free_searches
from fitball.inference.point.gauss_newton import descend
from fitball.inference.point.surface import surface_of
from fitball.inference.problem.problem import Problem

# A promised gain of log likelihood below which the maximum is found.
SETTLED = 1e-7


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
    # Their penalty would be part of the likelihood, and each would count as a parameter.
    assert not problem.pooling and problem.group_bias is None, "levels and biases are not counted"
    objective = surface_of(problem, SETTLED)
    begun = objective.from_values(np.array([[start[name] for name in problem.free_names] for start in starts]))
    reached = descend(objective, free_searches(objective, begun, scene=False))
    measurements = sum(observable.observed.size for observable in problem.observables)
    return Criteria(-float(reached.cost.min()), problem.dimension, measurements)
