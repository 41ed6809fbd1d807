"""How much of a problem is evaluated at once, so that memory does not grow with draws times impacts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fitball.values import FloatArray

if TYPE_CHECKING:
    from fitball.inference.problem.problem import Problem

# Draws times impacts that are evaluated at once: some twenty arrays of as many numbers live at a time (150 MB).
CELLS = 1_000_000
# With errors of the incident state a cell has Jacobians too.
INCIDENT_COST = 8


def cells(problem: Problem) -> int:
    """Draws times impacts of a problem that are evaluated at once."""
    cost = 1 if problem.incident is None else INCIDENT_COST
    return CELLS // (cost if problem.force is None else cost * problem.force.nodes)


def batches(problem: Problem, draws: int, cost: int = 1) -> Iterator[slice]:
    """Draws that are evaluated at once; `cost` is how many rebounds each needs. There is one batch at least."""
    size = max(1, cells(problem) // (cost * len(problem.impacts)))
    return (slice(start, start + size) for start in range(0, max(draws, 1), size))


@dataclass(frozen=True)
class Densities:
    """Of each draw (draws,): whether the model can evaluate every impact, the log density of what the scene knows,
    and the log likelihood (NaN where it is not possible).
    """

    possible: NDArray[np.bool_]
    knowledge: FloatArray
    likelihood: FloatArray


def densities(problem: Problem, values: FloatArray, *, measured: bool = True) -> Densities:
    """What free values (draws, free) are worth; without `measured` the likelihood is left at zero."""
    found = []
    for some in batches(problem, values.shape[0]):
        rebound = problem.rebound(values[some])
        # A marked impact (see models.types.Status) has no density: the parameters are impossible there.
        possible = ~np.any(rebound.status, axis=1)
        knowledge = problem.log_knowledge(rebound)
        likelihood = problem.log_likelihood(values[some], rebound) if measured else np.zeros_like(knowledge)
        found.append((possible, knowledge, likelihood))
    possible, knowledge, likelihood = (np.concatenate(column) for column in zip(*found, strict=True))
    return Densities(possible, knowledge, likelihood)
