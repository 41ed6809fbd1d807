"""Measured columns as the likelihood sees them: what a model predicts for each, and with which noise."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitball.data.table import ImpactTable
from fitball.inference.problem.noise import Sizes
from fitball.models.types import Rebound
from fitball.observables import OBSERVABLES, SHARED_SD, ReboundColumn
from fitball.values import FloatArray


@dataclass(frozen=True)
class Observable:
    """One measured column: `observed` (impacts,), its stated `sd` (impacts,) or the noise parameter it uses.

    With `rows` only those impacts of the problem have a measurement here, and (impacts,) means (rows,). It is None
    where all have: this is the one place where it is known which measurements are missing, and residuals, densities
    and derivatives are formed of those that are there.
    """

    name: str
    observed: FloatArray
    sd: FloatArray | None
    noise: str | None
    rows: NDArray[np.int64] | None = None

    @property
    def column(self) -> ReboundColumn:
        """What is true of this column in every table."""
        return OBSERVABLES[self.name]

    def predict(self, rebound: Rebound) -> FloatArray:
        """What the model says, (draws, impacts) or (impacts,)."""
        return self._mine(self.column.predict(rebound))

    @property
    def turned(self) -> bool:
        """Whether this is an angle with the noise of a velocity component: that noise over the rebound speed."""
        return self.column.angle and self.noise == SHARED_SD

    def known(self, names: Collection[str]) -> bool:
        """Whether the noise of this column is stated, or among the parameters `names`."""
        return self.sd is not None or self.noise in names

    def spread(self, noise: FloatArray | float, rebound: Rebound) -> FloatArray:
        """Standard deviation, broadcastable to (draws, impacts); `noise` is (draws, 1) or a number."""
        if self.sd is not None:
            return self.sd
        if self.turned:
            return noise / self._mine(np.hypot(rebound.v_x2, rebound.v_y2))
        return np.asarray(noise, dtype=np.float64)

    def sds(self, sizes: Sizes, rebound: Rebound) -> FloatArray:
        """`spread` for the noise parameters among `sizes`."""
        return self.spread(0.0 if self.noise is None else np.asarray(sizes[self.noise])[..., None], rebound)

    def at(self, entries: NDArray[np.int64]) -> Observable:
        """The column with some of its entries alone; `rows` still say which impacts of the problem they belong to."""
        sd = None if self.sd is None else self.sd[entries]
        rows = entries if self.rows is None else self.rows[entries]
        return replace(self, observed=self.observed[entries], sd=sd, rows=rows)

    def everywhere(self, impacts: int) -> Observable:
        """The column over all impacts of the problem, `observed` and stated `sd` NaN where nothing was measured."""
        if self.rows is None:
            return self
        sd = None if self.sd is None else self.spread_out(self.sd, impacts, np.nan)
        return replace(self, observed=self.spread_out(self.observed, impacts, np.nan), sd=sd, rows=None)

    def places(self, impacts: int) -> NDArray[np.int64]:
        """Which impacts of the problem have a measurement, (measurements,)."""
        return np.arange(impacts) if self.rows is None else self.rows

    def count(self, impacts: int) -> int:
        """How many of the problem's impacts have a measurement."""
        return impacts if self.rows is None else int(self.rows.size)

    def spread_out(self, array: FloatArray, impacts: int, absent: float) -> FloatArray:
        """Numbers (..., measurements) over all impacts of the problem (..., impacts)."""
        if self.rows is None:
            return array
        whole = np.full((*array.shape[:-1], impacts), absent)
        whole[..., self.rows] = array
        return whole

    def _mine(self, array: FloatArray) -> FloatArray:
        return array if self.rows is None else array[..., self.rows]


def build_observables(
    table: ImpactTable, tangential: bool, has_time: bool, needs_cor: bool, noise_of: Mapping[str, str]
) -> tuple[tuple[Observable, ...], list[str]]:
    """Observables the model can answer for, and a sentence for each column it cannot.

    `noise_of` names the noise parameter of each column.
    """
    observables, notes = [], []
    for measurement in table.measurements:
        column = OBSERVABLES[measurement.name]
        if column.tangential and not tangential:
            notes.append(f"{measurement.name} is not used: without v_x1 only the vertical motion is fitted")
        elif column.timed and not has_time:
            notes.append(f"{measurement.name} is not used: this model has no time axis")
        elif column.restitution and needs_cor:
            notes.append(f"{measurement.name} is not scored: the measured coefficient of restitution is an input")
        else:
            noise = noise_of[measurement.name] if measurement.sd is None else None
            whole = Observable(measurement.name, measurement.values, measurement.sd, noise)
            observables.append(whole if measurement.complete else whole.at(np.flatnonzero(measurement.measured)))
    return tuple(observables), notes
