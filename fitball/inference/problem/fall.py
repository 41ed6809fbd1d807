"""What heights share because the air brakes every ball alike.

Heights become speeds at a usual drag coefficient (`base.air`). If the true one is another, all
speeds of a table are off together: a ball that was dropped lands a little faster or slower, and one
that rises to a height left the court slower or faster. So the drag is a parameter of the fit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base import air
from fitball.base.priors import ParameterSpec
from fitball.base.values import BoolArray, FloatArray, Impacts, IntArray
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.inference.forward import Values
from fitball.models.types import Rebound

DRAG_SPEC = ParameterSpec(
    "drag",
    "",
    0.01,
    3.0,
    f"normal({air.SLOW_DRAG.value:g}, {air.SLOW_DRAG.sd:g})",
    "drag coefficient of falls and rises, below 15 m/s",
    r"$C_d$",
)
# The parameters of falls, by name.
FALL_SPECS: Mapping[str, ParameterSpec] = {DRAG_SPEC.name: DRAG_SPEC}


class FallModel(NamedTuple):
    """Which velocities of a table are heights, read at the `usual` drag coefficient: `dropped` and
    `risen` say for each impact whether v_y1 and v_y2 are. `braking` [1/m] is that of a drag of one.
    """

    usual: float
    braking: float
    dropped: Annotated[BoolArray, "impacts"]
    risen: Annotated[BoolArray, "impacts"]

    def take(self, rows: Annotated[IntArray, "chosen"]) -> FallModel:
        """The model of the impacts with these row numbers alone."""
        return self._replace(dropped=self.dropped[rows], risen=self.risen[rows])

    def true_states(self, values: Values, measured: Impacts) -> Impacts:
        """True incident states (draws, impacts) of measured ones: the heights are as measured, the
        drag is that of each draw.
        """
        if not self.dropped.any():
            return measured
        height = air.drop_height(measured.v_y1, self.braking * self.usual)
        landing = air.landing_speed(height, self._braking(values))
        v_y1 = np.where(self.dropped, landing, measured.v_y1)
        return Impacts(*np.broadcast_arrays(measured.v_x1, v_y1, measured.omega_1))

    def measured_rebounds(self, values: Values, rebound: Rebound) -> Rebound:
        """Rebounds (draws, impacts) as their heights read at the usual drag."""
        if not self.risen.any():
            return rebound
        height = air.rebound_height(rebound.v_y2, self._braking(values))
        launch = air.launch_speed(height, self.braking * self.usual)
        return replace(rebound, v_y2=np.where(self.risen, launch, rebound.v_y2))

    def _braking(self, values: Values) -> FloatArray:
        """The braking (draws, 1) [1/m] of each draw, the usual one where no drag was fitted."""
        drag = values.get(DRAG_SPEC.name, np.array([self.usual]))
        return self.braking * drag[:, None]


def fall_of(table: ImpactTable, scene: Scene) -> FallModel | None:
    """The model of a table's heights; None where it has none. Heights that 3.0.dev0 read stand for
    speeds without air.
    """
    read = [entry for entry in table.read if "heights" in entry]
    if not read:
        return None
    names = np.array(table.labels.get("table", ("",) * len(table)))
    fallen = {"v_y1": np.zeros(len(table), np.bool_), "v_y2": np.zeros(len(table), np.bool_)}
    for entry in read:
        for speed in entry["heights"].split(","):
            fallen[speed] |= names == entry.get("table", "")
    braking = air.braking_per_drag(scene.ball_value(), scene.air)
    usual = float(read[0]["drag"])
    return FallModel(usual, braking, fallen["v_y1"], fallen["v_y2"])
