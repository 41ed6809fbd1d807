"""Fisher information of planned impacts, draw by draw, as rows: their squares add up to it.

Rows are derivatives of what is measured, whitened by its noise, and of the logarithm of that noise where it is
fitted, with respect to directions in which the posterior has the variance one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitball.inference.design.knowledge import solved
from fitball.inference.design.sensor import Sensor
from fitball.inference.likelihood.residuals import observable_slopes
from fitball.inference.problem.incident import spread_by_input
from fitball.inference.problem.problem import Problem
from fitball.models.types import Rebound
from fitball.observables import OBSERVABLES
from fitball.values import FloatArray


@dataclass(frozen=True)
class Differentiated:
    """Rebounds (draws, impacts) at planned impacts of `problem` for `coordinates` (draws, free), with derivatives of
    each output with respect to coordinates (draws, impacts, free) and to the incident state (draws, impacts, 3).
    """

    problem: Problem
    coordinates: FloatArray
    rebound: Rebound
    slopes: Mapping[str, FloatArray]
    by_input: Mapping[str, FloatArray] | None

    @property
    def columns(self) -> Mapping[str, FloatArray]:
        """Every parameter by name, (draws,)."""
        return self.problem.all_values(self.problem.to_values(self.coordinates))

    @property
    def solved(self) -> NDArray[np.bool_]:
        """Which draws can be evaluated at which impacts."""
        return solved(self.rebound)


def differentiated(problem: Problem, coordinates: FloatArray) -> Differentiated:
    """The planned impacts of a problem (see `Knowledge.at`) with all derivatives."""
    rebound, slopes = problem.differentiated(coordinates)
    by_input = None
    if problem.incident is not None:
        columns = problem.all_values(problem.to_values(coordinates))
        by_input = problem.slopes_like(columns, problem.impacts, np.arange(len(problem.impacts)))
    return Differentiated(problem, coordinates, rebound, slopes, by_input)


def information_rows(made: Differentiated, sensor: Sensor, root: FloatArray) -> FloatArray:
    """Rows (draws, impacts, rows, directions) of what a `sensor` tells, in the directions of `Knowledge.root`, or of
    `Knowledge.roots` at the draws; zero where a draw cannot be evaluated.
    """
    problem, columns = made.problem, made.columns
    sds = np.stack([column.sds(columns, made.rebound) for column in sensor.columns], axis=2)
    slopes = np.stack(
        [observable_slopes(problem, column, made.rebound, made.slopes) for column in sensor.columns],
        axis=2,
    )
    known = made.solved & np.isfinite(slopes).all(axis=(2, 3)) & np.isfinite(sds).all(axis=2)
    sds, slopes = np.where(known[..., None], sds, 1.0), np.where(known[..., None, None], slopes, 0.0)
    growth = _growth(made, sensor, known)
    worth = np.sqrt(problem.noise.information(columns))[..., None, None, None]
    if made.by_input is None or problem.incident is None:
        told = slopes / sds[..., None]
    else:
        covariance = covariances(made, sensor, sds, known)
        told = np.linalg.solve(np.linalg.cholesky(covariance), slopes)
        # Of a normal distribution with a covariance C to which each column's own noise adds, columns k and l tell of
        # the logarithms of these noises 2 (s_k (C^-1)_kl s_l)^2: rows are a root of that matrix.
        shares = sds[..., :, None] * np.linalg.inv(covariance) * sds[..., None, :]
        growth = np.linalg.cholesky(shares**2).swapaxes(-1, -2) @ growth
    scale = np.sqrt(problem.noise.scale_information(columns))[..., None, None, None]
    rows = np.concatenate([worth * told, scale * growth], axis=2)
    return np.asarray(rows @ (root if root.ndim == 2 else root[:, None]))


def covariances(made: Differentiated, sensor: Sensor, sds: FloatArray, known: NDArray[np.bool_]) -> FloatArray:
    """Covariance (draws, impacts, columns, columns) of what a sensor reads where incident states are uncertain."""
    assert made.by_input is not None and made.problem.incident is not None
    by_input = np.stack([column.column.slopes(made.rebound, made.by_input) for column in sensor.columns], axis=2)
    shared = spread_by_input(np.where(known[..., None, None], by_input, 0.0), made.problem.incident.covariance)
    return np.asarray(shared + sds[..., None, :] ** 2 * np.eye(sds.shape[-1]))


def _growth(made: Differentiated, sensor: Sensor, known: NDArray[np.bool_]) -> FloatArray:
    """Derivatives (draws, impacts, columns, free) of the logarithm of each column's own noise."""
    problem = made.problem
    growth = np.zeros((*known.shape, len(sensor.columns), problem.dimension))
    for place, column in enumerate(sensor.columns):
        if column.sd is not None:
            continue
        if column.turned:
            speed = np.hypot(made.rebound.v_x2, made.rebound.v_y2)[..., None]
            growth[:, :, place] -= OBSERVABLES["v_2"].slopes(made.rebound, made.slopes) / speed
        if column.noise in problem.free_names:
            k = problem.free_names.index(column.noise)
            rate = 1.0 if problem.free[k].prior.log else 1.0 / made.coordinates[:, k, None]
            growth[:, :, place, k] += rate
    return np.where(known[..., None, None], growth, 0.0)
