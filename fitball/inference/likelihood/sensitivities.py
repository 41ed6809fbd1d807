"""Derivatives of rebounds with respect to the free parameters, batched over draws, and what follows from them.

A model differentiates itself (`Model.jacobian`); all here is the chain rule.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitball.inference.likelihood.incident_marginal import incident_sds
from fitball.inference.likelihood.residuals import Weighting
from fitball.inference.problem.noise import NORMAL, Sizes
from fitball.inference.problem.observables import Observable
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.problem import Problem
from fitball.models.types import Rebound
from fitball.observables import OBSERVABLES
from fitball.values import FloatArray

Slopes = Mapping[str, FloatArray]
Columns = Mapping[str, FloatArray]


def observable_slopes(problem: Problem, observable: Observable, rebound: Rebound, slopes: Slopes) -> FloatArray:
    """Derivatives (draws, impacts, free) of what is measured in an observable, the bias of its group included."""
    derivatives = observable.column.slopes(rebound, slopes)
    if problem.group_bias is None:
        return derivatives
    derivatives = derivatives.copy()
    for place, label in enumerate(problem.group_bias.labels):
        name = problem.group_bias.name(observable.name, label)
        if name in problem.free_names:
            derivatives[:, problem.group_bias.index == place, problem.free_names.index(name)] += 1.0
    return derivatives


def deviation_slopes(
    problem: Problem, observable: Observable, columns: Columns, sizes: Sizes, rebound: Rebound, slopes: Slopes
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Predicted less measured (draws, measurements) in units of the noise among `sizes`, its derivatives (...,
    free), and those of minus the logarithm of its spread, None where that depends on noise alone.
    """
    mine = slice(None) if observable.rows is None else observable.rows
    spread = np.broadcast_to(observable.sds(sizes, rebound), rebound.v_x2[:, mine].shape)
    z = -problem.deviation(columns, observable, rebound) / spread
    slope = observable_slopes(problem, observable, rebound, slopes)[:, mine] / spread[..., None]
    if not observable.turned:
        return z, slope, None
    # The spread of an angle falls with the rebound speed: z = (angle - observed) speed/noise.
    growth = (OBSERVABLES["v_2"].slopes(rebound, slopes) / np.hypot(rebound.v_x2, rebound.v_y2)[..., None])[:, mine]
    return z, slope + z[..., None] * growth, growth


def residual_slopes(problem: Problem, coordinates: FloatArray, weighting: Weighting) -> FloatArray:
    """Derivatives (draws, residuals, free) of `residuals` with respect to coordinates (draws, free), all exact; zero
    where a rebound cannot be evaluated and residuals are constant. Not for errors of the incident state, whose
    residuals hold derivatives themselves (`differentiable`).
    """
    values = problem.to_values(coordinates)
    columns = problem.all_values(values)
    rebound, slopes = problem.differentiated(coordinates)
    kind = problem.noise if weighting.penalised else NORMAL
    rows = []
    for observable in problem.observables:
        z, slope, _growth = deviation_slopes(problem, observable, columns, weighting.noise, rebound, slopes)
        rows.append(kind.residual_rate(z, weighting.noise)[..., None] * slope)
    if problem.contact_time is not None:
        rows.append(slopes["contact_time"].mean(axis=1, keepdims=True) / problem.contact_time[1])
    if weighting.penalised:
        for k, parameter in enumerate(problem.free):
            if parameter.prior.normal and parameter.name not in NOISE_SPECS:
                unit = np.eye(problem.dimension)[k] / parameter.prior.b
                rows.append(np.broadcast_to(unit, (coordinates.shape[0], 1, unit.size)))
    stacked = np.concatenate(rows, axis=1)
    impossible = np.any(rebound.status, axis=1) | ~np.all(np.isfinite(stacked), axis=(1, 2))
    stacked[impossible] = 0.0
    return stacked


def differentiable(problem: Problem) -> bool:
    """Whether `residual_slopes` has an exact derivative of every residual. It has none of those with errors of the
    incident state, which hold derivatives themselves, nor of force records, whose start of contact is searched for.
    """
    return problem.incident is None and problem.force is None


def prediction_slopes(problem: Problem, coordinates: FloatArray) -> FloatArray:
    """Derivatives (draws, measurements, free) of all predictions, in units of their noise, with respect to
    coordinates (draws, free) counted in widths of the priors; measurements run observable by observable, impact by
    impact of those that have one.

    Errors of the incident state count as noise; a measurement with heavy tails is worth less than a normal one.
    """
    rebound, slopes = problem.differentiated(coordinates)
    columns = problem.all_values(problem.to_values(coordinates))
    by_incidence = incident_sds(problem, columns, rebound)
    worth = np.sqrt(problem.noise.information(columns))[..., None, None]
    rows = []
    for observable in problem.observables:
        mine = slice(None) if observable.rows is None else observable.rows
        spread = np.broadcast_to(observable.sds(columns, rebound), rebound.v_x2[:, mine].shape)
        spread = np.hypot(spread, np.broadcast_to(by_incidence[observable.name], rebound.v_x2.shape)[:, mine])
        rows.append(worth * observable_slopes(problem, observable, rebound, slopes)[:, mine] / spread[..., None])
    scaled: FloatArray = np.concatenate(rows, axis=1) * problem.prior.width
    return scaled
