"""Derivatives of rebounds with respect to the free parameters, batched over draws, and what follows from them.

`rebound_slopes` is the only place that differentiates a model here; all else is the chain rule.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitball.inference.likelihood.incident_marginal import incident_sds
from fitball.inference.problem.observables import Observable
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.problem import Problem
from fitball.models.types import OUTPUTS, Rebound
from fitball.values import FloatArray

Slopes = Mapping[str, FloatArray]
# Step of the central differences, in widths of the prior: small beside any posterior, large beside rounding (near the
# cube root of it, where both cost the same).
STEP = 1e-5


def rebound_slopes(problem: Problem, coordinates: FloatArray) -> tuple[Rebound, Slopes]:
    """Rebounds (draws, impacts) at `coordinates` (draws, free), and for each of OUTPUTS its derivatives
    (draws, impacts, free) with respect to coordinates; zero for noise parameters and offsets of groups.

    Central differences, one-sided where the other side cannot be evaluated, NaN where neither can. With the
    calls batched: one for all draws and parameters.
    """
    draws = coordinates.shape[0]
    still = NOISE_SPECS.keys() | (
        problem.group_bias.names(problem.observables) if problem.group_bias is not None else set()
    )
    moving = [k for k, name in enumerate(problem.free_names) if name not in still]
    steps = np.zeros((2 * len(moving), problem.dimension))
    sizes = STEP * problem.prior.width[moving]
    for row, k in enumerate(moving):
        steps[row, k], steps[len(moving) + row, k] = sizes[row], -sizes[row]
    around = coordinates[:, None, :] + np.concatenate([np.zeros((1, problem.dimension)), steps])
    found = problem.rebound(problem.to_values(around.reshape(-1, problem.dimension)))
    stencil = found.each(lambda array: array.reshape(draws, 1 + 2 * len(moving), -1))
    slopes = {}
    for name in OUTPUTS:
        block = getattr(stencil, name)
        centre, up, down = block[:, :1], block[:, 1 : 1 + len(moving)], block[:, 1 + len(moving) :]
        forward, backward = (up - centre) / sizes[:, None], (centre - down) / sizes[:, None]
        central = 0.5 * (forward + backward)
        best = np.where(np.isfinite(central), central, np.where(np.isfinite(forward), forward, backward))
        slopes[name] = np.zeros((draws, block.shape[2], problem.dimension))
        slopes[name][:, :, moving] = best.transpose(0, 2, 1)
    return stencil.each(lambda array: array[:, 0]), slopes


def observable_slopes(problem: Problem, observable: Observable, rebound: Rebound, slopes: Slopes) -> FloatArray:
    """Derivatives (draws, impacts, free) of what is measured in an observable, the bias of its group included."""
    found = observable.column.slopes(rebound, slopes)
    if problem.group_bias is None:
        return found
    found = found.copy()
    for place, label in enumerate(problem.group_bias.labels):
        name = problem.group_bias.name(observable.name, label)
        if name in problem.free_names:
            found[:, problem.group_bias.index == place, problem.free_names.index(name)] += 1.0
    return found


def prediction_slopes(problem: Problem, coordinates: FloatArray) -> FloatArray:
    """Derivatives (draws, measurements, free) of all predictions, in units of their noise, with respect to
    coordinates (draws, free) counted in widths of the priors; measurements run observable by observable.

    Errors of the incident state count as noise; a measurement with heavy tails is worth less than a normal one.
    """
    rebound, slopes = rebound_slopes(problem, coordinates)
    columns = problem.all_values(problem.to_values(coordinates))
    by_incidence = incident_sds(problem, columns, rebound)
    worth = np.sqrt(problem.noise.information(columns))[..., None, None]
    rows = []
    for observable in problem.observables:
        spread = np.broadcast_to(observable.sds(columns, rebound), rebound.v_x2.shape)
        spread = np.hypot(spread, by_incidence[observable.name])
        rows.append(worth * observable_slopes(problem, observable, rebound, slopes) / spread[..., None])
    scaled: FloatArray = np.concatenate(rows, axis=1) * problem.prior.width
    return scaled
