"""The maximum of the posterior density, searched from many starts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fitball.errors import FitError
from fitball.inference.likelihood.force import best_force_noise
from fitball.inference.likelihood.posterior import log_likelihood, log_posterior
from fitball.inference.likelihood.residuals import Weighting, default_noise, named_values, root_mean_squares
from fitball.inference.point.gauss_newton import Searches, descend
from fitball.inference.point.general_surface import smooth, surface_of
from fitball.inference.point.lmfit_minimiser import SAME_OPTIMUM, Minimiser, minima, simplex
from fitball.inference.problem.parameters import NOISE_SPECS, SD_SPECS
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import PointFit
from fitball.values import FloatArray

# Optima this far below the best (in log posterior) hold no mass worth starting an ensemble in.
WORTH_KEEPING = 12.0
# Minima this far below the best at their first noise are not followed further.
ALTERNATED = 30.0
# Change of the log posterior over a whole simplex below which it has settled: a hundredth of a sd or less.
SETTLED = 1e-5
# Standardised distance within which two starts that were optima of samples belong to one optimum of the whole.
ONE_BASIN = 0.3
# Log density per measurement by which a start may lie below another and still lead to the higher optimum.
HOPELESS_GAP = 0.1
# Rows up to which the simplex polishes the maximum: it costs some thousand densities.
CLIMBED = 1000


@dataclass(frozen=True)
class Candidate:
    """A maximum so far: its log posterior, all coordinates (free,), the fitted ones, and the noise; `settled` where
    the slopes promise no more.
    """

    score: float
    coordinates: FloatArray
    at: FloatArray = field(default_factory=lambda: np.empty(0))
    noise: Mapping[str, float] = field(default_factory=dict)
    settled: bool = False


def maximum_posterior(problem: Problem, starts: FloatArray, noise: Mapping[str, float] | None = None) -> PointFit:
    """The highest of the posterior's maxima reached from the starts, with the others worth knowing.

    Damped Gauss-Newton steps of all starts together, each begun with the noise that is best for it; where those do
    not settle a simplex on the posterior itself, which knows every bound and kink. On surfaces that are not `smooth`
    Levenberg-Marquardt for given noise, `noise` being the first guess, in turn with the best noise for those
    residuals. Raises FitError as `least_squares` does.
    """
    if smooth(problem):
        likelihood = surface_of(problem)
        x = likelihood.from_values(starts)
        return _best_of(problem, _descended(problem, likelihood.values(x, likelihood.free(x))))
    noise = {**default_noise(problem), **(noise or {})}
    distinct, _ = minima(problem, Weighting(noise, penalised=True), starts)
    first = [_with_best_noise(problem, minimum.at, noise, rounds=1) for minimum in distinct]
    top = max((candidate.score for candidate in first), default=-math.inf)
    candidates = [
        _with_best_noise(problem, candidate.at, candidate.noise, rounds=8)
        for candidate in first
        if candidate.score > top - ALTERNATED
    ]
    return _best_of(problem, candidates)


def follow_maximum(problem: Problem, starts: FloatArray, noise: Mapping[str, float]) -> PointFit:
    """As `maximum_posterior`, from starts (starts, free) that are already near: large tables end here.

    Each start first takes the noise that is best for it, `noise` being a guess; of starts in one basin only the
    higher is followed, and none that is hopeless. The simplex is left out where it would cost too much. Raises
    FitError as `least_squares` does.
    """
    candidates = [_as_candidate(problem, start[None, :], noise) for start in starts]
    scale = Minimiser(problem, Weighting(candidates[0].noise, penalised=True)).scale()
    followed: list[Candidate] = []
    least = max(candidate.score for candidate in candidates) - HOPELESS_GAP * sum(
        observable.observed.size for observable in problem.observables
    )
    for candidate in sorted(
        (candidate for candidate in candidates if candidate.score >= least), key=lambda candidate: -candidate.score
    ):
        apart = [np.max(np.abs(candidate.at - other.at) / scale) > ONE_BASIN for other in followed]
        if all(apart):
            followed.append(candidate)
    return _best_of(
        problem, [_with_best_noise(problem, candidate.at, candidate.noise, rounds=8) for candidate in followed]
    )


def higher_maximum(problem: Problem, known: PointFit, starts: FloatArray) -> PointFit:
    """The highest maximum among those `known` and those that searches from `starts` (starts, free) reach, each
    begun with its noise. It is nowhere below a start.

    Raises FitError as `least_squares` does.
    """
    if smooth(problem):
        optima = np.concatenate([_row(problem, optimum) for optimum in known.optima])
        return _best_of(problem, _descended(problem, np.concatenate([optima, starts])))
    candidates = [
        Candidate(score, problem.to_coordinates(_row(problem, optimum))[0])
        for optimum, score in zip(known.optima, known.optima_log_posterior, strict=True)
    ]
    for start in starts:
        coordinates = problem.to_coordinates(start[None, :])
        score = float(log_posterior(problem, coordinates)[0])
        own = {name: value for name, value in named_values(problem, start).items() if name in NOISE_SPECS}
        first = _as_candidate(problem, start[None, :], own)
        reached = _with_best_noise(problem, first.at, first.noise, rounds=8)
        # A search may end at a wall, or where the regime changes, below where it began.
        candidates.append(reached if reached.score >= score else Candidate(score, coordinates[0], first.at, own))
    return _best_of(problem, candidates)


def _descended(problem: Problem, starts: FloatArray) -> list[Candidate]:
    """Where searches from free values (starts, free) end."""
    surface = surface_of(problem, SETTLED, penalised=True)
    x = surface.from_values(starts)
    reached = descend(surface, Searches(x, np.full(len(x), -1), surface.free(x)), rivals=WORTH_KEEPING)
    coordinates = problem.to_coordinates(surface.values(reached.x, surface.free(x)))
    scores = log_posterior(problem, coordinates)
    return [
        Candidate(float(score), at, settled=bool(settled))
        for score, at, settled in zip(scores, coordinates, reached.settled, strict=True)
    ]


def _row(problem: Problem, optimum: Mapping[str, float]) -> FloatArray:
    return np.array([[optimum[name] for name in problem.free_names]])


def _as_candidate(problem: Problem, values: FloatArray, noise: Mapping[str, float]) -> Candidate:
    """Free values (1, free) with the noise that is best for them, `noise` being a guess."""
    own = _best_noise(problem, values, {**default_noise(problem), **noise})
    minimiser = Minimiser(problem, Weighting(own, penalised=True))
    at = minimiser.to_fitted(values)[0]
    score = float(log_posterior(problem, problem.to_coordinates(minimiser.values(at[None, :])))[0])
    return Candidate(score, values[0], at, own)


def _best_of(problem: Problem, reached: Sequence[Candidate]) -> PointFit:
    candidates = sorted(
        (candidate for candidate in reached if math.isfinite(candidate.score)), key=lambda candidate: -candidate.score
    )
    if not candidates:
        raise FitError(f"model {problem.model.name}: no start led to parameters of finite posterior density")
    top_point = candidates[0].coordinates
    settled = candidates[0].settled or len(problem.impacts) > CLIMBED
    best = top_point if settled else _climb(problem, top_point)
    others = [
        candidate.coordinates for candidate in candidates[1:] if candidate.score > candidates[0].score - WORTH_KEEPING
    ]
    # Searches that were apart at their first noise may have met since; the climb is from the first of all.
    distinct = _distinct([top_point, best, *others], problem.prior.width)
    kept = [best, *(point for point in distinct if point is not top_point and point is not best)]
    scores = log_posterior(problem, np.array(kept))
    values = problem.to_values(best[None, :])
    rebound = problem.rebound(values)
    return PointFit(
        values=named_values(problem, values[0]),
        log_posterior=float(scores[0]),
        log_likelihood=float(log_likelihood(problem, values, rebound)[0]),
        rms=root_mean_squares(problem, values[0]),
        rebound=rebound,
        optima=tuple(named_values(problem, problem.to_values(at[None, :])[0]) for at in kept),
        optima_log_posterior=tuple(float(score) for score in scores),
    )


def _distinct(points: Sequence[FloatArray], width: FloatArray) -> list[FloatArray]:
    """Those of the points (free,) that lie apart from all before them, in widths of the priors (free,)."""
    distinct: list[FloatArray] = []
    for point in points:
        if all(np.max(np.abs(point - other) / width) > SAME_OPTIMUM for other in distinct):
            distinct.append(point)
    return distinct


def _with_best_noise(problem: Problem, at: FloatArray, noise: Mapping[str, float], rounds: int) -> Candidate:
    """Alternate between parameters for given noise and noise for given parameters, from fitted coordinates `at`."""
    current = dict(noise)
    for _ in range(rounds):
        minimiser = Minimiser(problem, Weighting(current, penalised=True))
        at = minimiser.run(at).at
        following = _best_noise(problem, minimiser.values(at[None, :]), current)
        settled = all(abs(math.log(following[name] / current[name])) < 1e-4 for name in current)
        current = following
        if settled:
            break
    minimiser = Minimiser(problem, Weighting(current, penalised=True))
    coordinates = problem.to_coordinates(minimiser.values(at[None, :]))[0]
    score = float(log_posterior(problem, coordinates[None, :])[0])
    return Candidate(score, coordinates, at, current)


def _best_noise(problem: Problem, values: FloatArray, current: Mapping[str, float]) -> dict[str, float]:
    """Noise that maximises the posterior for the residuals at `values` (1, free), on a fine grid of the prior."""
    rebound = problem.rebound(values)
    columns = problem.all_values(values)
    units = {
        observable.name: observable.spread(1.0, rebound) for observable in problem.observables if observable.noise
    }
    gaps = {observable.name: problem.deviation(columns, observable, rebound) for observable in problem.observables}
    best = dict(current)
    for parameter in problem.free:
        if parameter.name not in SD_SPECS:
            continue
        mine = [
            (gaps[observable.name] / units[observable.name]).ravel()
            for observable in problem.observables
            if observable.noise == parameter.name
        ]
        if not mine:  # Nothing is left that shows this noise.
            continue
        best[parameter.name] = problem.noise.best_scale(parameter.prior, np.concatenate(mine), best)
    if problem.force is not None:
        best |= best_force_noise(problem, problem.force, columns, best)
    z = [gaps[observable.name] / observable.sds(best, rebound) for observable in problem.observables]
    priors = {parameter.name: parameter.prior for parameter in problem.free}
    return best | problem.noise.best_shape(priors, np.concatenate([column.ravel() for column in z]), best)


def _climb(problem: Problem, start: FloatArray) -> FloatArray:
    """Polish a maximum (free,) in coordinates on the posterior itself, restarted until it stands still."""

    def cost(step: FloatArray) -> float:
        value = float(log_posterior(problem, (start + problem.prior.width * step)[None, :])[0])
        return -value if math.isfinite(value) else 1e10

    score = cost(np.zeros(problem.dimension))
    for _ in range(3):
        step = simplex(cost, problem.dimension, size=0.02, tolerance=SETTLED)
        following = cost(step)
        if following >= score - 10.0 * SETTLED:
            break
        start, score = start + problem.prior.width * step, following
    return start
