"""New impacts whose incident state is itself uncertain: drawn anew for each draw of the posterior.

Nothing is linearised here: the bounce of every drawn state is computed. The variance of a rebound comes from the
parameters and from the incident state; a measurement of it adds its noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fitball.inference.likelihood import regime_mixture
from fitball.inference.results.fitted_model import FittedModel
from fitball.models.types import OUTPUTS, Rebound, Status
from fitball.values import FloatArray, Impacts


@dataclass(frozen=True)
class Shares:
    """Standard deviations (impacts,) that one output owes to the parameters (at the stated incident state), to the
    incident state (averaged over the parameters) and to a new measurement of it (None where its noise is not known).

    The sum of their squares is the variance of a new measurement, but for what parameters and incident state do only
    together.
    """

    parameters: FloatArray
    incident: FloatArray
    measurement: FloatArray | None


def drawn_rebound(fitted: FittedModel, impacts: Impacts, covariance: FloatArray, rng: np.random.Generator) -> Rebound:
    """Rebounds (draws, impacts), each draw of the parameters with incident states of its own.

    `covariance` (impacts, 3, 3) is that of `(v_x1, v_y1, omega_1)` in SI. A drawn state that does not move towards
    the court is no impact: it is NaN and marked.
    """
    draws = fitted.draws.shape[0]
    root = regime_mixture.roots(covariance)
    moves = np.einsum("kij,dkj->dki", root, rng.standard_normal((draws, len(impacts), 3)))
    possible = impacts.v_y1 + moves[..., 1] > 0.0
    # Something must be bounced in the place of what is no impact; it is struck out below.
    moves[~possible] = 0.0
    every = np.arange(len(impacts))
    made = [
        fitted.rebound(regime_mixture.shifted(impacts, moves[k], every), fitted.draws[k : k + 1])
        for k in range(draws)
    ]
    rebound = Rebound.joined(made, axis=0)
    for name in OUTPUTS:
        getattr(rebound, name)[~possible] = np.nan
    rebound.status[~possible] = Status.NO_IMPACT
    return rebound


def shares(fixed: FloatArray, one: FloatArray, other: FloatArray, noise: FloatArray | None) -> Shares:
    """Where the uncertainty of one output comes from.

    All (draws, impacts), with the same parameters in a row: `fixed` at the stated incident state, `one` and `other`
    at two independent draws of it, whose half squared difference is the variance they leave given the parameters;
    `noise` of a new measurement.
    """
    incident = np.sqrt(over_draws(np.nanmean, 0.5 * (one - other) ** 2))
    return Shares(over_draws(np.nanstd, fixed), incident, None if noise is None else over_draws(np.nanstd, noise))


def over_draws(statistic: Callable[..., FloatArray], array: FloatArray) -> FloatArray:
    """A statistic (impacts,) of what is not NaN among draws (draws, impacts); NaN where no draw can be evaluated."""
    result = np.full(array.shape[1], np.nan)
    known = np.any(np.isfinite(array), axis=0)
    result[known] = statistic(array[:, known], axis=0)
    return result
