"""Ways of measuring a planned impact: the columns that are read, each with its noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitball.inference.problem.observables import Observable
from fitball.inference.problem.problem import Problem
from fitball.models.types import Rebound
from fitball.observables import OBSERVABLES, ReboundColumn
from fitball.values import FloatArray, Impacts

# The name of measuring as the fitted table was measured.
AS_BEFORE = "as before"


@dataclass(frozen=True)
class PlannedColumn:
    """One column that is read: its noise is `share` of the fitted parameter `noise`, or `sd` [SI] where known."""

    name: str
    noise: str | None
    sd: float | None = None
    share: float = 1.0

    @property
    def column(self) -> ReboundColumn:
        """What is true of this column in every table."""
        return OBSERVABLES[self.name]

    @property
    def turned(self) -> bool:
        """See `Observable.turned`."""
        return self._observable.turned

    @property
    def _observable(self) -> Observable:
        return Observable(self.name, np.empty(0), None, self.noise)

    def sds(self, columns: Mapping[str, FloatArray], rebound: Rebound) -> FloatArray:
        """Standard deviation (draws, impacts) of a measurement, for parameters among `columns` (draws,)."""
        shape = rebound.v_x2.shape
        if self.sd is not None:
            return np.full(shape, self.sd)
        return np.asarray(self.share * np.broadcast_to(self._observable.sds(columns, rebound), shape))


@dataclass(frozen=True)
class Sensor:
    """A way of measuring an impact, called `name` and in `words`, at a `cost` of so many ordinary impacts.

    A `drop` is the one impact that it is made with; None: any. With a `plate` force is recorded too, with that sd [N]
    of a sample.
    """

    name: str
    words: str
    columns: tuple[PlannedColumn, ...]
    cost: float = 1.0
    drop: Impacts | None = None
    plate: float | None = None


def as_before(problem: Problem, cost: float = 1.0) -> Sensor:
    """The columns of the fitted table, each as well as it was measured there (a stated sd: its median)."""
    columns = tuple(
        PlannedColumn(item.name, item.noise, None if item.sd is None else float(np.nanmedian(item.sd)))
        for item in problem.observables
    )
    return Sensor(AS_BEFORE, "measured as before", columns, cost)
