"""Maxima of the posterior without some impacts: the searches of all folds advance together, a batch of the kernel a
round.

As in `withheld`, only the likelihood of what is left out goes: the scene's knowledge, the priors, and that every
impact must be possible stay.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fitball.inference.identifiability.gauss_newton import Searches, descend
from fitball.inference.identifiability.profile_general import GeneralObjective
from fitball.inference.identifiability.profile_objective import Conditions
from fitball.inference.likelihood.posterior import impact_terms, log_scene_density
from fitball.inference.problem.problem import Problem
from fitball.models.types import Rebound
from fitball.values import FloatArray

# A promised gain of log posterior below which a maximum is found: errors of left-out impacts then stand to a
# thousandth of their noise.
SETTLED = 1e-7


@dataclass(frozen=True)
class Counting(Conditions):
    """Conditions under which the impacts `counted` (rows, impacts) alone count."""

    counted: NDArray[np.bool_]

    def take(self, rows: NDArray[np.int64] | slice) -> Counting:
        """Those of some rows."""
        return Counting(self.noise[rows], self.scene, self.counted[rows])


@dataclass(frozen=True)
class HeldPosterior(GeneralObjective):
    """Minus the log posterior of a problem, but for a constant, in each row of the impacts that count there."""

    @cached_property
    def _precision(self) -> FloatArray:
        return np.array([item.prior.b**-2.0 if item.prior.normal else 0.0 for item in self.parameters])

    def _held(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The priors; a uniform one only bounds."""
        away = self._coordinates(x) - np.array([item.prior.a for item in self.parameters])
        chain = np.where(self._as_value, 1.0 / np.where(self._as_value, x, 1.0), 1.0)
        return (
            0.5 * np.sum(self._precision * away**2, axis=1),
            self._precision * away * chain,
            self._precision * chain**2,
        )

    def _searched(self, column: int) -> tuple[float, float]:
        low, high = super()._searched(column)
        prior = self.problem.free[column].prior
        ends = prior.support
        first, last = prior.value(np.array(ends)) if self.is_value(column) else ends
        return max(low, float(first)), min(high, float(last))

    def _negative(self, values: FloatArray, rebound: Rebound, given: Conditions) -> FloatArray:
        assert isinstance(given, Counting)
        terms = sum(impact_terms(self.problem, values, rebound).values())
        total = -np.sum(np.where(given.counted, terms, 0.0), axis=1) - log_scene_density(self.problem, rebound)
        return np.where(np.any(rebound.status, axis=1) | np.isnan(total), np.inf, total)

    def _standardised(self, values: FloatArray, rebound: Rebound, given: Conditions) -> tuple[FloatArray, FloatArray]:
        assert isinstance(given, Counting)
        z, log_sd = super()._standardised(values, rebound, given)
        places = np.concatenate([item.places(len(self.problem.impacts)) for item in self.problem.observables])
        counted = given.counted[:, places]
        return np.where(counted, z, 0.0), np.where(counted, log_sd, 0.0)


def free_values(problem: Problem, optima: Sequence[Mapping[str, float]]) -> FloatArray:
    """Free values (optima, free) of optima, all parameters by name."""
    return np.array([[optimum[name] for name in problem.free_names] for optimum in optima])


def held_maxima(
    problem: Problem, left: Sequence[NDArray[np.int64]], starts: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Free values (folds, free) of the highest maximum without the rows `left` of each fold, searched from its own
    `starts`, free values (starts, free); and minus its log posterior, but for a constant, inf where none was found.
    """
    objective = HeldPosterior(problem, promised=SETTLED)
    fold = np.repeat(np.arange(len(left)), [len(some) for some in starts])
    counted = np.ones((len(left), len(problem.impacts)), dtype=bool)
    for k, rows in enumerate(left):
        counted[k, rows] = False
    begun = objective.from_values(np.concatenate(starts))
    given = Counting(np.empty((fold.size, 0)), problem.contact_time is not None, counted[fold])
    reached = descend(objective, Searches(begun, np.full(fold.size, -1), given))
    best = [np.flatnonzero(fold == k)[np.argmin(reached.cost[fold == k])] for k in range(len(left))]
    return objective.values(reached.x[best], given.take(np.array(best))), reached.cost[best]
