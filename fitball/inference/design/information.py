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
from fitball.inference.likelihood.cells import cells_of
from fitball.inference.problem.problem import Problem
from fitball.models.types import Rebound
from fitball.values import FloatArray


@dataclass(frozen=True)
class Differentiated:
    """Rebounds (draws, impacts) at planned impacts of `problem` for `coordinates` (draws, free), with derivatives of
    each output with respect to coordinates (draws, impacts, free).
    """

    problem: Problem
    coordinates: FloatArray
    rebound: Rebound
    slopes: Mapping[str, FloatArray]

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
    return Differentiated(problem, coordinates, rebound, slopes)


def information_rows(made: Differentiated, sensor: Sensor, root: FloatArray) -> FloatArray:
    """Rows (draws, impacts, rows, directions) of what a `sensor` tells, in the directions of `Knowledge.root`, or of
    `Knowledge.roots` at the draws; zero where a draw cannot be evaluated.
    """
    problem, columns = made.problem, made.columns
    told = cells_of(problem, columns, made.rebound, sensor.columns, made.slopes)
    worth = np.sqrt(problem.noise.information(columns))[..., None, None]
    scale = np.sqrt(problem.noise.scale_information(columns))[..., None, None]
    parts = [worth[..., None] * told.spread_out(told.slope), scale[..., None] * told.spread_out(told.growth)]
    if problem.incident is not None:
        parts.append(scale[..., None] * told.turn)
    rows = np.concatenate(parts, axis=2)
    known = made.solved & np.isfinite(rows).all(axis=(2, 3))
    rows = np.where(known[..., None, None], rows, 0.0)
    return np.asarray(rows @ (root if root.ndim == 2 else root[:, None]))
