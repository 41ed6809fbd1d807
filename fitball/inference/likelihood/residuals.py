"""Weighted residuals of a problem for given noise, and derivatives of these and of rebounds with respect to the free
parameters, batched over draws. A model differentiates itself (`Model.jacobian`); here is the chain rule.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitball.inference.likelihood.force import force_residuals
from fitball.inference.likelihood.incident_marginal import UNKNOWN, measured_of, seen, standardised, whitening
from fitball.inference.problem.noise import NORMAL, Sizes
from fitball.inference.problem.observables import Observable
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.problem import Problem
from fitball.models.types import Rebound
from fitball.observables import OBSERVABLES
from fitball.values import FloatArray

# Residual [sd] that stands for a parameter set the model cannot evaluate; it only has to be worse than any fit.
IMPOSSIBLE = 1e3


@dataclass(frozen=True)
class Weighting:
    """Standard deviations for a least-squares problem: noise parameters held at `noise`; `penalised` adds the
    priors as residuals and heavy tails as they are, which makes the minimum that of the posterior for that noise.
    """

    noise: Mapping[str, float]
    penalised: bool


def residuals(problem: Problem, values: FloatArray, weighting: Weighting) -> FloatArray:
    """Weighted residuals (draws, residuals) at free values (draws, free); the scene's contact time is one."""
    rebound = problem.rebound(values)
    columns = problem.all_values(values)
    kind = problem.noise if weighting.penalised else NORMAL
    rows = []
    if problem.incident is not None:
        held = {**columns, **_held(weighting, values.shape[0])}
        slopes = problem.slopes_like(columns, problem.impacts, np.arange(len(problem.impacts)))
        measured = seen(problem, held)
        deviations, _ = standardised(measured, held, rebound, slopes, problem.incident.covariance)
        rows = [kind.residual(-z, weighting.noise) for z in measured_of(measured, deviations)]
    for observable in problem.observables if problem.incident is None else ():
        z = problem.deviation(columns, observable, rebound) / observable.sds(weighting.noise, rebound)
        rows.append(kind.residual(-z, weighting.noise))
    if problem.contact_time is not None:
        value, sd = problem.contact_time
        rows.append((rebound.contact_time.mean(axis=1, keepdims=True) - value) / sd)
    if problem.force is not None:
        rows.append(force_residuals(problem, {**columns, **_held(weighting, values.shape[0])}))
    if weighting.penalised:
        coordinates = problem.to_coordinates(values)
        for column, parameter in enumerate(problem.free):
            if parameter.prior.normal and parameter.name not in NOISE_SPECS:
                rows.append(((coordinates[:, column] - parameter.prior.a) / parameter.prior.b)[:, None])
    stacked = np.concatenate(rows, axis=1)
    # So near to where the model ends numbers may overflow before it says so.
    impossible = np.any(rebound.status, axis=1) | ~np.all(np.isfinite(stacked), axis=1)
    stacked[impossible] = IMPOSSIBLE
    return stacked


def _held(weighting: Weighting, draws: int) -> dict[str, FloatArray]:
    return {name: np.full(draws, value) for name, value in weighting.noise.items()}


def root_mean_squares(problem: Problem, values: FloatArray) -> dict[str, float]:
    """Unweighted root mean square residual of each observable at free values (free,), biases of groups taken off."""
    rebound, columns = problem.rebound(values[None, :]), problem.all_values(values[None, :])
    return {
        observable.name: float(np.sqrt(np.mean(problem.deviation(columns, observable, rebound) ** 2)))
        for observable in problem.observables
    }


def default_noise(problem: Problem) -> dict[str, float]:
    """Noise parameters at their fixed or nominal (prior median) size."""
    return {
        parameter.name: parameter.fixed
        if parameter.fixed is not None
        else float(parameter.prior.quantile(np.array([0.5]))[0])
        for parameter in problem.parameters
        if parameter.name in NOISE_SPECS
    }


def named_values(problem: Problem, values: FloatArray) -> dict[str, float]:
    """All parameters by name at free values (free,)."""
    return {name: float(column[0]) for name, column in problem.all_values(values[None, :]).items()}


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


def own_spreads(problem: Problem, columns: Columns, rebound: Rebound) -> FloatArray:
    """The noise (draws, impacts, columns) of each measured column, `UNKNOWN` where nothing was measured."""
    spreads = []
    for observable in problem.observables:
        sds = np.broadcast_to(observable.sds(columns, rebound), (*rebound.v_x2.shape[:-1], observable.observed.size))
        spreads.append(observable.spread_out(sds, len(problem.impacts), UNKNOWN))
    return np.stack(spreads, axis=2)


def prediction_slopes(problem: Problem, coordinates: FloatArray) -> FloatArray:
    """Derivatives (draws, impacts, columns, free) of all predictions, in units of their noise, with respect to
    coordinates (draws, free) counted in widths of the priors; zero where nothing was measured.

    Errors of the incident state count as noise that the columns of an impact share: each is taken given those before
    it. A measurement with heavy tails is worth less than a normal one.
    """
    rebound, slopes = problem.differentiated(coordinates)
    columns = problem.all_values(problem.to_values(coordinates))
    spreads = own_spreads(problem, columns, rebound)
    by_column = [observable_slopes(problem, observable, rebound, slopes) for observable in problem.observables]
    told = np.where(spreads[..., None] < UNKNOWN, np.stack(by_column, axis=2), 0.0)
    if problem.incident is None:
        told /= spreads[..., None]
    else:
        told = whitening(problem, problem.incident, columns, rebound, spreads) @ told
    scaled: FloatArray = np.sqrt(problem.noise.information(columns))[..., None, None, None] * told
    return scaled * problem.prior.width
