"""The point fits of a problem: least squares and the maximum of the posterior density, from many starts: the best of
many draws of the priors that lie apart, and the best of other regimes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from fitball.errors import FitError
from fitball.inference.likelihood.posterior import log_likelihood, log_posterior
from fitball.inference.likelihood.residuals import named_values, root_mean_squares
from fitball.inference.point.gauss_newton import SAME_OPTIMUM, Searches, apart, descend
from fitball.inference.point.least_squares import deeper, least_squares
from fitball.inference.point.surface import Surface, surface_of
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import LOOKED_AT, thinned_problem
from fitball.inference.results.results import LeastSquares, PointFit
from fitball.values import FloatArray

# Optima this far below the best (in log posterior) hold no mass worth starting an ensemble in.
WORTH_KEEPING = 12.0
# Change of the log posterior over a whole simplex below which it has settled: a hundredth of a sd or less.
SETTLED = 1e-5
# Edge of a simplex, in widths of the priors.
SIMPLEX = 0.02
# Distance in widths of the priors within which two starts that were optima of samples belong to one optimum.
ONE_BASIN = 0.3
# Log density per measurement by which a start may lie below another and still lead to the higher optimum.
HOPELESS_GAP = 0.1


@dataclass(frozen=True)
class Candidate:
    """A maximum so far: its log posterior, its coordinates (free,); `settled` where the slopes promise no more."""

    score: float
    coordinates: FloatArray
    settled: bool = False


def maximum_posterior(problem: Problem, starts: FloatArray) -> PointFit:
    """The highest of the posterior's maxima reached from starts (starts, free), with the other relevant ones.

    Damped Gauss-Newton steps of all starts together, each begun with the noise that is best for it; where those do
    not settle a simplex on the posterior itself, with every bound and kink. Raises FitError where no start
    leads to parameters of finite density.
    """
    return _best_of(problem, maxima(problem, with_best_noise(problem, starts)))


def follow_maximum(problem: Problem, starts: FloatArray) -> PointFit:
    """As `maximum_posterior`, from starts (starts, free) that are near already, each with its noise: large tables end
    here. Of starts in one basin only the higher is followed, and none that is hopeless.
    """
    begun = problem.to_coordinates(starts)
    scores = log_posterior(problem, begun)
    measured = sum(observable.observed.size for observable in problem.observables)
    hopeful = [k for k in np.argsort(-scores, kind="stable") if scores[k] >= scores.max() - HOPELESS_GAP * measured]
    followed = apart(begun / problem.prior.width, hopeful, ONE_BASIN)
    return _best_of(problem, maxima(problem, starts[followed]))


def higher_maximum(problem: Problem, known: PointFit, starts: FloatArray) -> PointFit:
    """The highest maximum among those `known` and those that searches from `starts` (starts, free) reach, each
    begun with its noise. It is nowhere below a start.

    Raises FitError as `maximum_posterior` does.
    """
    return _best_of(problem, maxima(problem, np.concatenate([problem.free_rows(known.optima), starts])))


def with_best_noise(problem: Problem, starts: FloatArray) -> FloatArray:
    """Free values (starts, free) with the noise that were best for them if it were normal."""
    likelihood = Surface(problem)
    x = likelihood.from_values(starts)
    return likelihood.values(x, likelihood.free(x))


def maxima(problem: Problem, starts: FloatArray, promised: float = SETTLED) -> list[Candidate]:
    """Where searches from free values (starts, free) end, none below its start; settled where they promise less
    than `promised`.
    """
    surface = surface_of(problem, promised, penalised=True)
    x = surface.from_values(starts)
    reached = descend(surface, Searches(x, np.full(len(x), -1), surface.free(x)), rivals=WORTH_KEEPING)
    begun, ended = (problem.to_coordinates(at) for at in (starts, surface.values(reached.x, surface.free(x))))
    before, after = (log_posterior(problem, at) for at in (begun, ended))
    # A start at the very edge of the model is searched from a place inside.
    higher = after >= before
    settled = reached.settled & (after > before - surface.promised)
    return [
        Candidate(*found)
        for found in zip(
            np.where(higher, after, before).tolist(),
            np.where(higher[:, None], ended, begun),
            settled.tolist(),
            strict=True,
        )
    ]


def distinct(reached: Sequence[Candidate], width: FloatArray) -> list[Candidate]:
    """The possible ones, best first, that lie apart from all before them, in widths of the priors (free,)."""
    found: list[Candidate] = []
    for candidate in sorted(reached, key=lambda candidate: -candidate.score):
        apart = [np.max(np.abs(candidate.coordinates - other.coordinates) / width) > SAME_OPTIMUM for other in found]
        if math.isfinite(candidate.score) and all(apart):
            found.append(candidate)
    return found


def _best_of(problem: Problem, reached: Sequence[Candidate]) -> PointFit:
    width = problem.prior.width
    candidates = distinct(reached, width)
    if not candidates:
        raise FitError(f"model {problem.model.name}: no search found parameters of finite posterior density")
    best, *others = (item for item in candidates if item.score > candidates[0].score - WORTH_KEEPING)
    if not best.settled and len(problem.impacts) <= LOOKED_AT:
        best = _climb(problem, best)
    kept = [best, *(item for item in others if len(distinct([best, item], width)) == 2)]
    points = problem.to_values(np.array([item.coordinates for item in kept]))
    rebound = problem.rebound(points[:1])
    return PointFit(
        values=named_values(problem, points[0]),
        log_posterior=best.score,
        log_likelihood=float(log_likelihood(problem, points[:1], rebound)[0]),
        rms=root_mean_squares(problem, points[0]),
        rebound=rebound,
        optima=tuple(named_values(problem, point) for point in points),
        optima_log_posterior=tuple(item.score for item in kept),
    )


def _climb(problem: Problem, found: Candidate) -> Candidate:
    """Polish a maximum on the posterior itself, restarted until it no longer moves."""
    start = found.coordinates

    def cost(step: FloatArray) -> float:
        value = float(log_posterior(problem, (start + problem.prior.width * step)[None, :])[0])
        return -value if math.isfinite(value) else 1e10

    score = cost(np.zeros(problem.dimension))
    for _ in range(3):
        step = minimize(
            cost,
            np.zeros(problem.dimension),
            method="Nelder-Mead",
            options={
                "initial_simplex": np.vstack([np.zeros(problem.dimension), SIMPLEX * np.eye(problem.dimension)]),
                "adaptive": True,
                "maxfev": 1200,
                "xatol": 1.0,
                "fatol": SETTLED,
            },
        ).x
        following = cost(step)
        if following >= score - 10.0 * SETTLED:
            break
        start, score = start + problem.prior.width * step, following
    return Candidate(-score, start, settled=True)


SCREENED = 4000
STARTS = 16
# To so many starts comes one in which impacts slip that grip in those, or the other way round. Where all of them grip
# nothing depends on the friction, and no search from there finds the friction at which they slip.
OTHER_REGIMES = 3
# Widths of its prior to either side of its middle over which one parameter of a start is moved to reach such regimes,
# and the steps of the way; beyond, a normal prior costs more than any table repays.
REACH, STEPS = 5.0, 20
# Rows on which a large table's regimes and optima are searched; these move by less than a standard deviation of such
# rows after.
SEARCHED = 100


def starting_points(problem: Problem, rng: np.random.Generator, count: int) -> FloatArray:
    """The best of many prior draws that lie apart from each other, (<= count, free), and after them starts with other
    regimes of impacts, where there are any.

    Raises FitError when the model cannot evaluate a single draw of the prior.
    """
    values = problem.prior.draw(rng, SCREENED)
    score = log_posterior(problem, problem.to_coordinates(values))
    ranked = [int(k) for k in np.argsort(-score) if np.isfinite(score[k])]
    if not ranked:
        raise FitError(
            f"model {problem.model.name} cannot evaluate these impacts at any of {SCREENED} draws from the priors: "
            "widen the priors or change the fixed values"
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
    seen = thinned_problem(problem, SEARCHED)
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
        if parameter.prior.bell:
            low, high = (
                max(low, parameter.prior.a - REACH * parameter.prior.b),
                min(high, parameter.prior.a + REACH * parameter.prior.b),
            )
        moved = np.repeat(coordinates, STEPS, axis=0)
        moved[:, column] = np.tile(np.linspace(low, high, STEPS), len(starts))
        shifted.append(moved)
    return problem.to_values(np.concatenate(shifted))


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
    return deeper(problem, squares, beside), higher_maximum(problem, point, problem.free_rows(beside))


def _searched(problem: Problem, rng: np.random.Generator) -> tuple[LeastSquares, PointFit]:
    first = thinned_problem(problem, SEARCHED) if len(problem.impacts) > 2 * SEARCHED else problem
    starts = starting_points(first, rng, STARTS)
    squares = least_squares(first, starts)
    if first is problem:
        # Either search may miss what the other finds: at other noise the valleys have other floors.
        point = higher_maximum(first, maximum_posterior(first, starts), problem.free_rows(squares.optima[:1]))
        return deeper(first, squares, [point.values]), point
    # What is found here is only where the next sample starts.
    point = maximum_posterior(first, problem.free_rows(squares.optima))
    sizes = [SEARCHED * GROWTH**k for k in range(1, 6) if len(problem.impacts) > 2 * SEARCHED * GROWTH**k]
    for level in (*(thinned_problem(problem, size) for size in sizes), problem):
        # Two optima are carried on until a sample of more rows has decided between them.
        followed = 1 if level is problem and sizes else 2
        near = [
            optimum
            for optimum, chi_square in zip(squares.optima, squares.optima_chi_square, strict=True)
            if chi_square < RIVAL * squares.chi_square
        ]
        squares = replace(least_squares(level, problem.free_rows(near[:followed])), starts=len(starts))
        begun = with_best_noise(level, problem.free_rows(squares.optima[:followed]))
        point = follow_maximum(level, np.concatenate([begun, problem.free_rows(point.optima[:followed])]))
    return squares, point
