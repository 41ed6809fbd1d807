"""Weighted residuals of a problem for given noise, batched over draws."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitball.inference.likelihood.force import force_residuals
from fitball.inference.likelihood.incident_marginal import measured_of, seen, standardised
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
    """Unweighted root mean square residual of each observable at free values (free,)."""
    rebound = problem.rebound(values[None, :])
    return {
        observable.name: float(np.sqrt(np.mean((observable.predict(rebound)[0] - observable.observed) ** 2)))
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
