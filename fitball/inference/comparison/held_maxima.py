"""Maxima of the posterior without some impacts: the searches of all folds advance together, a batch of the kernel a
round.

As in `withheld`, only the likelihood of what is left out goes: the scene's knowledge, the priors, and that every
impact must be possible stay.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fitball.inference.point.gauss_newton import Searches, descend
from fitball.inference.point.surface import Conditions, surface_of
from fitball.inference.problem.problem import Problem
from fitball.values import FloatArray

# A promised gain of log posterior below which a maximum is found: errors of left-out impacts then stand to a
# thousandth of their noise.
SETTLED = 1e-7


def free_values(problem: Problem, optima: Sequence[Mapping[str, float]]) -> FloatArray:
    """Free values (optima, free) of optima, all parameters by name."""
    return np.array([[optimum[name] for name in problem.free_names] for optimum in optima])


def held_maxima(
    problem: Problem, left: Sequence[NDArray[np.int64]], starts: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Free values (folds, free) of the highest maximum without the rows `left` of each fold, searched from its own
    `starts`, free values (starts, free); and minus its log posterior, but for a constant, inf where none was found.
    """
    assert problem.force is None, "records of the force are no measurements of an impact that could be left out here"
    surface = surface_of(problem, SETTLED, penalised=True)
    fold = np.repeat(np.arange(len(left)), [len(some) for some in starts])
    counted = np.ones((len(left), len(problem.impacts)), dtype=bool)
    for k, rows in enumerate(left):
        counted[k, rows] = False
    given = Conditions(np.empty((fold.size, 0)), problem.contact_time is not None, counted[fold])
    begun = surface.from_values(np.concatenate(starts))
    reached = descend(surface, Searches(begun, np.full(fold.size, -1), given))
    best = [np.flatnonzero(fold == k)[np.argmin(reached.cost[fold == k])] for k in range(len(left))]
    return surface.values(reached.x[best], given.take(np.array(best))), reached.cost[best]
