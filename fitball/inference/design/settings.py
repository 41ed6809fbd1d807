"""Incident states that a machine can be set to: a grid over speed, angle and spin, on each surface of a fit."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fitball.data.lines import Range
from fitball.errors import ParameterError
from fitball.inference.design.target import first_rows, surfaces
from fitball.inference.problem.problem import Problem
from fitball.values import FloatArray, Impacts
from fitball.wording import option

# Steps of a range for which no number of steps was given.
SPEEDS, ANGLES, SPINS = 6, 15, 5
# Points of a grid, beyond which it takes longer than it tells.
MOST = 20_000


@dataclass(frozen=True)
class Setting:
    """An incident state: `speed`, `angle` to the court, `spin`, and the `surface` (empty where there is one only)."""

    surface: str
    speed: float
    angle: float
    spin: float


@dataclass(frozen=True)
class Settings:
    """The grid: axes in SI, and the table's `rows` whose surface and ball are met, with their `surfaces`. `assumed`
    says which ranges nobody asked for.
    """

    speeds: FloatArray
    angles: FloatArray
    spins: FloatArray
    rows: tuple[int, ...]
    surfaces: tuple[str, ...]
    assumed: tuple[str, ...]

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Surfaces, speeds, angles, spins."""
        return len(self.rows), self.speeds.size, self.angles.size, self.spins.size

    @cached_property
    def _points(self) -> list[FloatArray]:
        axes = (np.arange(len(self.rows), dtype=np.float64), self.speeds, self.angles, self.spins)
        return [axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")]

    @property
    def impacts(self) -> Impacts:
        """All of them, (settings,), in the order of `shape`."""
        _surface, speed, angle, spin = self._points
        upright = np.isclose(angle, np.pi / 2.0)
        return Impacts(np.where(upright, 0.0, speed * np.cos(angle)), speed * np.sin(angle), spin)

    @property
    def like(self) -> NDArray[np.int64]:
        """The row of the table whose surface and ball each meets, (settings,)."""
        return np.array(self.rows, dtype=np.int64)[self._points[0].astype(np.int64)]

    def setting(self, place: int) -> Setting:
        """One of them."""
        surface, *state = (float(axis[place]) for axis in self._points)
        return Setting(self.surfaces[int(surface)], *state)


def build_settings(problem: Problem, speed: Range | None, angle: Range | None, spin: Range | None) -> Settings:
    """The grid of the ranges asked for, those of the fitted table where nothing was.

    Raises ParameterError for a range of what the fit knows nothing of, and for a grid too fine.
    """
    table = problem.table
    open_to = {"speed": True, "angle": table.has_tangential, "spin": table.has_tangential and table.has_spin}
    for name, given, words in (
        ("angle", angle, "this fit of a drop test knows the vertical motion only"),
        ("spin", spin, "no spin was measured, so this fit knows none"),
    ):
        if given is not None and not open_to[name]:
            raise ParameterError(f"{option(name, '...')}: {words}; leave it out")
    impacts = problem.impacts
    assumed = []
    axes = []
    measured = (
        ("speed", speed, np.hypot(impacts.v_x1, impacts.v_y1), SPEEDS),
        ("angle", angle, np.minimum(np.arctan2(impacts.v_y1, np.abs(impacts.v_x1)), np.pi / 2.0), ANGLES),
        ("spin", spin, impacts.omega_1, SPINS),
    )
    for name, given, values, steps in measured:
        chosen = given or Range(float(values.min()), float(values.max()))
        # Of a drop test there is but one angle and no spin.
        if given is None and open_to[name]:
            assumed.append(name)
        count = chosen.count or (steps if chosen.high > chosen.low else 1)
        axes.append(np.linspace(chosen.low, chosen.high, count))
    rows = first_rows(problem)
    size = len(rows) * axes[0].size * axes[1].size * axes[2].size
    if size > MOST:
        raise ParameterError(f"{size:,} settings: expected {MOST:,} at most; ask for fewer steps")
    return Settings(axes[0], axes[1], axes[2], tuple(rows), tuple(surfaces(problem, rows)), tuple(assumed))
