"""Where searches start: draws of the priors, and the best of them that lie apart."""

from __future__ import annotations

import numpy as np

from fitball.errors import FitError
from fitball.inference.posterior import Problem
from fitball.values import FloatArray

SCREENED = 4000
STARTS = 16


def prior_draws(problem: Problem, rng: np.random.Generator, size: int) -> FloatArray:
    """Free values (size, free) drawn from the priors."""
    return np.stack([item.prior.draw(rng, size) for item in problem.free], axis=1)


def starting_points(problem: Problem, rng: np.random.Generator, count: int) -> FloatArray:
    """The best of many prior draws that lie apart from each other, (<= count, free).

    Raises FitError when the model cannot evaluate a single draw of the prior.
    """
    values = prior_draws(problem, rng, SCREENED)
    score = problem.log_posterior(problem.to_coordinates(values))
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
                return values[chosen]
            if k not in chosen and np.min(np.linalg.norm(place[chosen] - place[k], axis=1)) > radius:
                chosen.append(k)
    return values[chosen]
