"""The point fits of a problem: least squares and the maximum of the posterior, from many starts: the
best of many draws of the priors that lie apart, and the best of other regimes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fitball.errors import FitError
from fitball.inference.likelihood.posterior import log_posterior
from fitball.inference.point.least_squares import deeper, least_squares
from fitball.inference.point.maximum_posterior import (
    follow_maximum,
    higher_maximum,
    maximum_posterior,
    with_best_noise,
)
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import thinned_problem
from fitball.inference.results.results import LeastSquares, PointFit
from fitball.values import FloatArray

SCREENED = 4000
STARTS = 16
# To so many starts comes one in which impacts slip that grip in those, or the other way round. Where all of them grip
# nothing depends on the friction, and no search from there finds the friction at which they slip.
OTHER_REGIMES = 3
# Widths of its prior to either side of its middle over which one parameter of a start is moved to reach such regimes,
# and the steps of the way; beyond, a normal prior costs more than any table repays.
REACH, STEPS = 5.0, 20
# Rows that tell the regimes of a table.
LOOKED_AT = 100


def starting_points(problem: Problem, rng: np.random.Generator, count: int) -> FloatArray:
    """The best of many prior draws that lie apart from each other, (<= count, free), and after them starts in which
    impacts meet other regimes than in those, where there are any.

    Raises FitError when the model cannot evaluate a single draw of the prior.
    """
    values = problem.prior.draw(rng, SCREENED)
    score = log_posterior(problem, problem.to_coordinates(values))
    ranked = [int(k) for k in np.argsort(-score) if np.isfinite(score[k])]
    if not ranked:
        raise FitError(
            f"model {problem.model.name} can evaluate none of {SCREENED} draws of the priors for these impacts: "
            "loosen the priors or the fixed values"
        )
    # Distance in prior probability, so that every parameter counts alike.
    place = np.argsort(np.argsort(values, axis=0), axis=0) / SCREENED
    chosen = [ranked[0]]
    for radius in (0.5, 0.35, 0.2, 0.0):
        for k in ranked[: SCREENED // 4]:
            if len(chosen) >= count:
                break
            if k not in chosen and np.min(np.linalg.norm(place[chosen] - place[k], axis=1)) > radius:
                chosen.append(k)
    best = values[chosen]
    return np.concatenate([best, other_regimes(problem, best, max(1, count // OTHER_REGIMES))])


def other_regimes(problem: Problem, starts: FloatArray, count: int) -> FloatArray:
    """At most `count` free values (found, free), of `starts` with one parameter moved, that send impacts through
    other regimes than the starts do: each the furthest from all before it, and of those the most probable.
    """
    trials = _moved(problem, starts)
    score = log_posterior(problem, problem.to_coordinates(trials))
    trials, score = trials[np.isfinite(score)], score[np.isfinite(score)]
    seen = thinned_problem(problem, LOOKED_AT)
    known, patterns = seen.rebound(starts).regime, seen.rebound(trials).regime
    gap = np.full(len(trials), np.inf)
    for pattern in known:
        gap = np.minimum(gap, _distance(patterns, pattern))
    chosen: list[int] = []
    while len(chosen) < count and np.any(gap > 0.0):
        furthest = np.flatnonzero(gap >= gap.max())
        chosen.append(int(furthest[np.argmax(score[furthest])]))
        gap = np.minimum(gap, _distance(patterns, patterns[chosen[-1]]))
    return trials[chosen]


def _distance(patterns: NDArray[np.int64], pattern: NDArray[np.int64]) -> FloatArray:
    """Share of the impacts whose regime differs, (trials,)."""
    return np.asarray(np.mean(patterns != pattern, axis=1))


def _moved(problem: Problem, starts: FloatArray) -> FloatArray:
    """The starts (trials, free) with each parameter in turn moved across its prior."""
    coordinates = problem.to_coordinates(starts)
    shifted = []
    for column, parameter in enumerate(problem.free):
        low, high = parameter.prior.support
        if parameter.prior.normal:
            low, high = (
                max(low, parameter.prior.a - REACH * parameter.prior.b),
                min(high, parameter.prior.a + REACH * parameter.prior.b),
            )
        moved = np.repeat(coordinates, STEPS, axis=0)
        moved[:, column] = np.tile(np.linspace(low, high, STEPS), len(starts))
        shifted.append(moved)
    return problem.to_values(np.concatenate(shifted))


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
