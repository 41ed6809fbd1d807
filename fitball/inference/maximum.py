"""The maximum of the posterior density, searched from many starts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fitball.errors import FitError
from fitball.inference.channels import Channel
from fitball.inference.minimiser import Minimiser, minima, simplex
from fitball.inference.parameters import NOISE_SPECS
from fitball.inference.posterior import Problem
from fitball.inference.residuals import Weighting, default_noise, named_values, root_mean_squares
from fitball.inference.results import PointFit
from fitball.values import FloatArray

# Optima this far below the best (in log posterior) hold no mass worth starting an ensemble in.
WORTH_KEEPING = 12.0
# Minima this far below the best at their first noise are not followed further.
ALTERNATED = 30.0
# Change of the log posterior over a whole simplex below which it has settled: a hundredth of a sd or less.
SETTLED = 1e-5
# Rows up to which the simplex polishes the maximum: it costs some thousand densities.
CLIMBED = 1000


@dataclass(frozen=True)
class Candidate:
    """A maximum so far: its log posterior, all coordinates (free,), the fitted ones, and the noise."""

    score: float
    coordinates: FloatArray
    at: FloatArray
    noise: Mapping[str, float]


def maximum_posterior(problem: Problem, starts: FloatArray) -> PointFit:
    """The highest of the posterior's maxima reached from the starts, with the others worth knowing.

    Levenberg-Marquardt on residuals and priors for given noise, in turn with the best noise for those residuals, then
    a simplex on the posterior itself, which knows every bound. Raises FitError as `least_squares` does.
    """
    noise = default_noise(problem)
    distinct, _ = minima(problem, Weighting(noise, penalised=True), starts)
    first = [_with_best_noise(problem, item.at, noise, rounds=1) for item in distinct]
    top = max((item.score for item in first), default=-math.inf)
    candidates = [
        _with_best_noise(problem, item.at, item.noise, rounds=8) for item in first if item.score > top - ALTERNATED
    ]
    return _best_of(problem, candidates)


def follow_maximum(problem: Problem, starts: FloatArray, noise: Mapping[str, float]) -> PointFit:
    """As `maximum_posterior`, from starts (starts, free) and noise that are already near: large tables end here.

    The simplex is left out where it would cost too much. Raises FitError as `least_squares` does.
    """
    known = {**default_noise(problem), **noise}
    fitted = Minimiser(problem, Weighting(known, penalised=True)).to_fitted(starts)
    return _best_of(problem, [_with_best_noise(problem, at, known, rounds=8) for at in fitted])


def _best_of(problem: Problem, found: Sequence[Candidate]) -> PointFit:
    candidates = sorted((item for item in found if math.isfinite(item.score)), key=lambda item: -item.score)
    if not candidates:
        raise FitError(f"model {problem.model.name}: no start led to parameters of finite posterior density")
    top_point = candidates[0].coordinates
    best = _climb(problem, top_point) if len(problem.impacts) <= CLIMBED else top_point
    others = [item for item in candidates[1:] if item.score > candidates[0].score - WORTH_KEEPING]
    kept = [best, *(item.coordinates for item in others)]
    scores = problem.log_posterior(np.array(kept))
    values = problem.to_values(best[None, :])
    rebound = problem.rebound(values)
    return PointFit(
        values=named_values(problem, values[0]),
        log_posterior=float(scores[0]),
        log_likelihood=float(problem.log_likelihood(values, rebound)[0]),
        rms=root_mean_squares(problem, values[0]),
        rebound=rebound,
        optima=tuple(named_values(problem, problem.to_values(at[None, :])[0]) for at in kept),
        optima_log_posterior=tuple(float(score) for score in scores),
    )


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
    score = float(problem.log_posterior(coordinates[None, :])[0])
    return Candidate(score, coordinates, at, current)


def _best_noise(problem: Problem, values: FloatArray, current: Mapping[str, float]) -> dict[str, float]:
    """Noise that maximises the posterior for the residuals at `values` (1, free), on a fine grid of the prior."""
    rebound = problem.rebound(values)
    best = dict(current)
    for item in problem.free:
        if item.name not in NOISE_SPECS:
            continue
        low, high = item.prior.ends
        grid = np.linspace(low, high, 4001)
        sd = item.prior.value(grid)
        score = item.prior.log_density(grid)
        for channel in (channel for channel in problem.channels if channel.noise == item.name):
            score = score + _noise_score(channel, sd, channel.predict(rebound), channel.spread(1.0, rebound))
        best[item.name] = float(sd[np.argmax(score)])
    return best


def _noise_score(channel: Channel, sd: FloatArray, predicted: FloatArray, unit_spread: FloatArray) -> FloatArray:
    z2 = float(np.sum(((channel.observed - predicted) / unit_spread) ** 2))
    score: FloatArray = -0.5 * z2 / sd**2 - channel.observed.size * np.log(sd)
    return score


def _climb(problem: Problem, start: FloatArray) -> FloatArray:
    """Polish a maximum (free,) in coordinates on the posterior itself, restarted until it stands still."""

    def cost(step: FloatArray) -> float:
        value = float(problem.log_posterior((start + problem.prior.width * step)[None, :])[0])
        return -value if math.isfinite(value) else 1e10

    score = cost(np.zeros(problem.dimension))
    for _ in range(3):
        step = simplex(cost, problem.dimension, size=0.02, tolerance=SETTLED)
        following = cost(step)
        if following >= score - 10.0 * SETTLED:
            break
        start, score = start + problem.prior.width * step, following
    return start
