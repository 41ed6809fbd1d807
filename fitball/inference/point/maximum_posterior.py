"""The maximum of the posterior density, searched from many starts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from fitball.errors import FitError
from fitball.inference.likelihood.posterior import log_likelihood, log_posterior
from fitball.inference.likelihood.residuals import named_values, root_mean_squares
from fitball.inference.point.gauss_newton import SAME_OPTIMUM, Searches, apart, descend
from fitball.inference.point.surface import SEARCHED, Surface, surface_of
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import PointFit
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
    """The highest of the posterior's maxima reached from starts (starts, free), with the others worth knowing.

    Damped Gauss-Newton steps of all starts together, each begun with the noise that is best for it; where those do
    not settle a simplex on the posterior itself, which knows every bound and kink. Raises FitError where no start
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
    optima = np.array([[optimum[name] for name in problem.free_names] for optimum in known.optima])
    return _best_of(problem, maxima(problem, np.concatenate([optima, starts])))


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
    settled = reached.settled & (after > before - promised)
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
        raise FitError(f"model {problem.model.name}: no start led to parameters of finite posterior density")
    best, *others = (item for item in candidates if item.score > candidates[0].score - WORTH_KEEPING)
    if not best.settled and len(problem.impacts) <= SEARCHED:
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
    """Polish a maximum on the posterior itself, restarted until it stands still."""
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
