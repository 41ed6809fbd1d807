"""The posterior density of a problem: pure functions of coordinates or values, batched over draws.

Densities are with respect to the coordinates of the problem.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitball.inference.likelihood.cells import cells_of
from fitball.inference.likelihood.force import force_log_likelihood
from fitball.inference.likelihood.regime_mixture import mixtures
from fitball.inference.problem.noise import LOG_TAU
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import batches
from fitball.models.types import Rebound
from fitball.values import FloatArray


@dataclass(frozen=True)
class Densities:
    """Of each draw (draws,): whether the model can evaluate every impact, the log density of the scene's contact
    time, and the log likelihood (-inf or NaN where it is not possible).
    """

    possible: NDArray[np.bool_]
    scene: FloatArray
    likelihood: FloatArray


def densities(problem: Problem, values: FloatArray, *, measured: bool = True) -> Densities:
    """Densities of free values (draws, free); without `measured` the likelihood is left at zero."""
    parts = []
    for some in batches(problem, values.shape[0]):
        rebound = problem.rebound(values[some])
        # A marked impact (see models.types.Status) has no density: the parameters are impossible there.
        possible = np.logical_not(rebound.status.any(axis=1))
        scene = log_scene_density(problem, rebound)
        likelihood = log_likelihood(problem, values[some], rebound) if measured else np.zeros(possible.size)
        parts.append((possible, scene, likelihood))
    if len(parts) == 1:
        return Densities(*parts[0])
    possible, scene, likelihood = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Densities(possible, scene, likelihood)


def log_scene_density(problem: Problem, rebound: Rebound) -> FloatArray:
    """Log density (draws,) of the scene's mean contact time; zero where none is stated."""
    if problem.contact_time is None:
        return np.zeros(rebound.contact_time.shape[0])
    value, sd = problem.contact_time
    z: FloatArray = (rebound.contact_time.mean(axis=1) - value) / sd
    return -0.5 * (z * z + LOG_TAU) - math.log(sd)


def impact_terms(problem: Problem, values: FloatArray, rebound: Rebound) -> Mapping[str, FloatArray]:
    """Log density of each measurement at free values (draws, free), column -> (draws, impacts): zero where a column
    was not measured.

    Where their errors belong together the measurements of an impact depend on each other: each is given those before
    it, so that they add up to the density of all.
    """
    made = cells_of(problem, problem.all_values(values), rebound)
    terms = made.spread_out(problem.noise.log_density(made.z, made.columns) - made.log_sd)
    if problem.uncertain:
        draws, rows, mixed = mixtures(problem, made.columns, rebound)
        terms[draws, rows] = mixed
    return {item.name: terms[..., k] for k, item in enumerate(problem.observables)}


def measured_terms(problem: Problem, values: FloatArray) -> dict[str, FloatArray]:
    """`impact_terms` of free values (draws, free), some draws at a time."""
    parts = [
        impact_terms(problem, values[some], problem.rebound(values[some]))
        for some in batches(problem, values.shape[0])
    ]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def pointwise(problem: Problem, values: FloatArray, columns: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Log likelihood of each impact at free values (draws, free), all its measurements and those in `columns`
    whatever the others, each (draws, impacts).
    """
    rebound = problem.rebound(values)
    terms = impact_terms(problem, values, rebound)
    whole = np.sum(list(terms.values()), axis=0)
    if problem.errors is not None and terms.keys() - set(columns):
        # Errors are common to the columns, of which each term is given those before it.
        kept = tuple(item for item in problem.observables if item.name in columns)
        terms = impact_terms(replace(problem, observables=kept), values, rebound)
    return whole, np.sum([terms[name] for name in columns], axis=0)


def log_likelihood(problem: Problem, values: FloatArray, rebound: Rebound) -> FloatArray:
    """Log likelihood (draws,) of free values (draws, free); NaN where the model cannot be evaluated."""
    columns = problem.all_values(values)
    if problem.errors is None:
        made = cells_of(problem, columns, rebound)
        total: FloatArray = (problem.noise.log_density(made.z, columns) - made.log_sd).sum(axis=1)
    else:
        total = np.sum(list(impact_terms(problem, values, rebound).values()), axis=(0, 2))
    if problem.force is not None:
        total += force_log_likelihood(problem, problem.force, columns)
    return total


def log_posterior(problem: Problem, coordinates: FloatArray) -> FloatArray:
    """Log posterior density (draws,) of coordinates (draws, free) but for a constant; -inf without an answer."""
    total = problem.prior.log_density(coordinates)
    inside = np.flatnonzero(np.isfinite(total))
    if inside.size == 0:
        return total
    density = densities(problem, problem.to_values(coordinates[inside]))
    total[inside] += np.where(density.possible, density.scene + density.likelihood, -np.inf)
    return total
