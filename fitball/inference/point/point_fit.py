"""The point fits of a problem: least squares and the maximum of the posterior, from many starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fitball.inference.point.least_squares import deeper, least_squares
from fitball.inference.point.maximum_posterior import (
    follow_maximum,
    higher_maximum,
    maximum_posterior,
    with_best_noise,
)
from fitball.inference.point.starts import STARTS, starting_points
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import thinned_problem
from fitball.inference.results.results import LeastSquares, PointFit
from fitball.values import FloatArray

# Rows on which a large table's optima are searched; they move by less than a standard deviation of these rows after.
SEARCHED = 100
# Each further sample is so many times as large: the optimum of the one is then within some sd of that of the next.
GROWTH = 40
# Chi-square of an optimum of a sample, as a multiple of the best, up to which it may be the best of the whole.
RIVAL = 1.2


def point_fit(
    problem: Problem, rng: np.random.Generator, beside: Sequence[Mapping[str, float]] = ()
) -> tuple[LeastSquares, PointFit]:
    """Least squares and the maximum of the posterior, searched at last from `beside` (all parameters by name) too.

    Tables of many rows are searched on a sample spread over incidence, from every start; its best optima are then
    followed on samples that grow to the whole table. Raises FitError as both fits do.
    """
    squares, point = _searched(problem, rng)
    if not beside:
        return squares, point
    return deeper(problem, squares, beside), higher_maximum(problem, point, _starts(problem, beside))


def _searched(problem: Problem, rng: np.random.Generator) -> tuple[LeastSquares, PointFit]:
    first = thinned_problem(problem, SEARCHED) if len(problem.impacts) > 2 * SEARCHED else problem
    starts = starting_points(first, rng, STARTS)
    squares = least_squares(first, starts)
    if first is problem:
        # Either search may miss what the other finds: at other noise the valleys have other floors.
        point = higher_maximum(first, maximum_posterior(first, starts), _starts(first, squares.optima[:1]))
        return deeper(first, squares, [point.values]), point
    # What is found here is only where the next sample starts.
    point = maximum_posterior(first, _starts(problem, squares.optima))
    sizes = [SEARCHED * GROWTH**k for k in range(1, 6) if len(problem.impacts) > 2 * SEARCHED * GROWTH**k]
    for level in (*(thinned_problem(problem, size) for size in sizes), problem):
        # Two optima are carried on until a sample of more rows has decided between them.
        followed = 1 if level is problem and sizes else 2
        near = [
            optimum
            for optimum, chi_square in zip(squares.optima, squares.optima_chi_square, strict=True)
            if chi_square < RIVAL * squares.chi_square
        ]
        squares = replace(least_squares(level, _starts(problem, near[:followed])), starts=len(starts))
        begun = with_best_noise(level, _starts(problem, squares.optima[:followed]))
        point = follow_maximum(level, np.concatenate([begun, _starts(problem, point.optima[:followed])]))
    return squares, point


def _starts(problem: Problem, optima: Sequence[Mapping[str, float]]) -> FloatArray:
    return np.array([[optimum[name] for name in problem.free_names] for optimum in optima])
