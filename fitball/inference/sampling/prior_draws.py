"""Draws from all that was known before the table: priors, what the model can evaluate, what the scene says."""

from __future__ import annotations

import numpy as np

from fitball.inference.likelihood.posterior import densities
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import spanning_part
from fitball.values import FloatArray

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
