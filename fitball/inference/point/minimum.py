"""A minimum of least squares, and the search for that of a long table by straight problems (Gauss-Newton)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fitball.inference.likelihood.residuals import IMPOSSIBLE
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import whole_of_parts
from fitball.values import FloatArray

# Times that a problem is straightened, and the length of a step, in sds, that ends it.
STRAIGHTENED, NEAR = 12, 0.01


@dataclass(frozen=True)
class Minimum:
    """A minimum: its chi-square, the fitted coordinates, (fitted,), and how many `residuals` there are."""

    chi_square: float
    at: FloatArray
    residuals: int

    @property
    def possible(self) -> bool:
        """Whether the model can evaluate it."""
        return self.chi_square < self.residuals * IMPOSSIBLE**2


def triangle(problem: Problem, of: Callable[[Problem], FloatArray]) -> FloatArray:
    """The triangle (columns, columns) of a matrix (rows, columns) that is the whole of those `of` parts: any
    combination of columns is as long by it as by all rows (Golub 1965).
    """
    whole = whole_of_parts(problem, of)
    made = np.zeros((whole.shape[1], whole.shape[1]))
    made[: len(whole)] = np.linalg.qr(whole, mode="r")
    return made


def straight_minimum(
    linear: Callable[[FloatArray], FloatArray], start: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[float, FloatArray]:
    """Chi-square and place (fitted,) where steps from `start` (fitted,) end, each to the minimum between `low` and
    `high` of the straight problem there: `linear` gives the triangle of its derivatives and residuals.
    """
    # It is for long tables alone.
    from scipy.optimize import lsq_linear

    cost, at = math.inf, start
    following = start
    for _ in range(STRAIGHTENED):
        made = linear(following)
        here = float(made[:, -1] @ made[:, -1])
        if here >= cost:
            break
        cost, at = here, following
        step = lsq_linear(made[:, :-1], -made[:, -1], (low - at, high - at), tol=1e-14).x
        if np.linalg.norm(made[:, :-1] @ step) < NEAR:
            break
        following = np.clip(at + step, low, high)
    return cost, at
