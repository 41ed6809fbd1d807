"""Draws from all that was known before a table, also where a scene's contact time lies far out in the priors."""

from __future__ import annotations

import numpy as np

from fitball.errors import FitError
from fitball.inference.identifiability.information import fisher_information, inverse, prior_sds
from fitball.inference.identifiability.verdict import scene_words
from fitball.inference.likelihood.posterior import densities
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import spanning_part
from fitball.inference.sampling.importance import importance_posterior
from fitball.inference.sampling.moves import StudentProposal
from fitball.values import FloatArray

# Draws from all that was known before the table: priors, what the model can evaluate, what the scene says.

BATCH, PART = 4000, 500
WANTED = 1500
# Batches after which fewer accepted draws must do; scenes that know much accept few prior draws.
MOST_BATCHES = 12
# Impacts that are looked at.
LOOKED_AT = 1000


def prior_draws(problem: Problem, rng: np.random.Generator, wanted: int = WANTED, batch: int = BATCH) -> FloatArray:
    """Independent draws (draws, free) in SI by rejection from the priors, at most `wanted`. Of a large table some
    impacts stand for all: their mean contact time for that of all, and those farthest out for what is possible.
    """
    problem = spanning_part(problem, LOOKED_AT)
    accepted: list[FloatArray] = []
    # The scene's knowledge is a normal density: its peak bounds it.
    value_sd = problem.contact_time
    peak = 0.0 if value_sd is None else -0.5 * float(np.log(2.0 * np.pi)) - float(np.log(value_sd[1]))
    for _ in range(MOST_BATCHES):
        values, luck = problem.prior.draw(rng, batch), rng.uniform(size=batch)
        # Looked at a part at a time: most tables take what they want of the first parts.
        for first in range(0, batch, PART):
            some = slice(first, first + PART)
            density = densities(problem, values[some], measured=False)
            chance = np.where(density.possible, np.exp(density.scene - peak), 0.0)
            accepted.append(values[some][luck[some] < chance])
            if sum(map(len, accepted)) >= wanted:
                return np.concatenate(accepted)[:wanted]
    return np.concatenate(accepted)


# Draws by rejection that tell how wide each parameter was; and draws in their place where they are fewer.
LEAST, DRAWN = 300, 1500


def known_before(problem: Problem, optimum: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draws (draws, free) in SI: by rejection from the priors, or, where these hardly ever have the contact time that
    the scene knows, as of another ball than their own, by weights. The `optimum` (free,), in coordinates, has it.

    Raises FitError where no weighted draws are found either.
    """
    drawn = prior_draws(problem, rng)
    if len(drawn) >= LEAST or problem.contact_time is None:
        return drawn
    part = spanning_part(problem, LOOKED_AT)
    weighed = importance_posterior(part, [_about(part, optimum)], rng, density=_log_density)
    if not weighed.settled:
        raise FitError(
            f"the priors leave no room for {scene_words(problem)}: state priors of this ball, such as that of "
            "k_y, or leave the contact time out"
        )
    return weighed.values[rng.choice(len(weighed.values), DRAWN, p=np.exp(weighed.log_weights))]


def _log_density(problem: Problem, coordinates: FloatArray) -> FloatArray:
    """Priors, what the model can evaluate, and what the scene knows (draws,), but for a constant."""
    total = problem.prior.log_density(coordinates)
    inside = np.flatnonzero(np.isfinite(total))
    known = densities(problem, problem.to_values(coordinates[inside]), measured=False)
    total[inside] += np.where(known.possible, known.scene, -np.inf)
    return total


def _about(problem: Problem, optimum: FloatArray) -> StudentProposal:
    """The priors where the scene leaves them, to first order about a point that has its contact time."""
    scene = fisher_information(problem, optimum, scene=True) - fisher_information(problem, optimum, scene=False)
    width = problem.prior.width * prior_sds(problem)
    covariance = inverse(np.nan_to_num(scene), 1.0)
    half = np.array([0.5])
    middle = np.array([float(item.prior.coordinate(item.prior.quantile(half))[0]) for item in problem.free])
    centre = optimum + width * (covariance @ ((middle - optimum) / width))
    factor = np.linalg.cholesky(covariance * np.outer(width, width))
    return StudentProposal(centre, np.asarray(factor, dtype=np.float64))
