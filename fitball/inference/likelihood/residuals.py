"""Weighted residuals of a problem for given noise, and their derivatives, batched over draws."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitball.inference.likelihood.cells import cells, cells_of
from fitball.inference.likelihood.force import force_residuals
from fitball.inference.problem.noise import NORMAL
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.problem import Problem
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
    kind = problem.noise if weighting.penalised else NORMAL
    columns = {**problem.all_values(values), **_held(weighting, values.shape[0])}
    rows = [kind.residual(-cells_of(problem, columns, rebound).z, columns)]
    if problem.contact_time is not None:
        value, sd = problem.contact_time
        rows.append((rebound.contact_time.mean(axis=1, keepdims=True) - value) / sd)
    if problem.force is not None:
        rows.append(force_residuals(problem, columns))
    if weighting.penalised:
        coordinates = problem.to_coordinates(values)
        for column, parameter in enumerate(problem.free):
            if parameter.prior.bell and parameter.name not in NOISE_SPECS:
                rows.append(parameter.prior.residual(coordinates[:, column])[0][:, None])
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


def residual_slopes(problem: Problem, coordinates: FloatArray, weighting: Weighting) -> FloatArray:
    """Derivatives (draws, residuals, free) of `residuals` with respect to coordinates (draws, free), all exact; zero
    for the noise, which is held, and where a rebound cannot be evaluated and residuals are constant. Not for errors
    of the incident state, whose residuals hold derivatives themselves (`differentiable`).
    """
    made = cells(problem, coordinates, slopes=True, sizes=_held(weighting, coordinates.shape[0]))
    kind = problem.noise if weighting.penalised else NORMAL
    slope = made.slope + made.z[..., None] * made.growth
    slope[..., [k for k, name in enumerate(problem.free_names) if name in NOISE_SPECS]] = 0.0
    rows = [kind.residual_rate(-made.z, made.columns)[..., None] * slope]
    if problem.contact_time is not None:
        rows.append(made.pace[:, None] / problem.contact_time[1])
    if weighting.penalised:
        for k, parameter in enumerate(problem.free):
            if parameter.prior.bell and parameter.name not in NOISE_SPECS:
                rate = parameter.prior.residual(coordinates[:, k])[1]
                rows.append(rate[:, None, None] * np.eye(problem.dimension)[k])
    stacked = np.concatenate(rows, axis=1)
    impossible = np.any(made.rebound.status, axis=1) | ~np.all(np.isfinite(stacked), axis=(1, 2))
    stacked[impossible] = 0.0
    return stacked


def differentiable(problem: Problem) -> bool:
    """Whether `residual_slopes` has an exact derivative of every residual. It has none of those with errors of the
    incident state, which hold derivatives themselves, nor of force records, whose start of contact is searched for.
    """
    return problem.errors is None and problem.force is None
