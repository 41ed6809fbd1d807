"""What heights, and times of flights, share because the air brakes every ball alike.

Both become speeds at a usual drag coefficient (`base.air`). If the true one is another, all
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
    name="drag",
    unit="",
    lower=0.01,
    upper=3.0,
    prior=f"normal({air.SLOW_DRAG.value:g}, {air.SLOW_DRAG.sd:g})",
    meaning="drag coefficient of falls and rises, below 15 m/s",
    symbol=r"$C_d$",
)
# Speed [m/s] in place of one that no air brakes: below the terminal one of any ball.
_ANY_SPEED = 1.0
# The parameters of falls, by name.
FALL_SPECS: Mapping[str, ParameterSpec] = {DRAG_SPEC.name: DRAG_SPEC}


class FallModel(NamedTuple):
    """Which velocities of a table were heights or times of flights, made speeds at the `usual` drag
    coefficient. `dropped` and `risen` say of each impact whether v_y1 and v_y2 were heights,
    `flown_in` and `flown_out` whether they were times. `braking` [1/m] is that of a drag
    coefficient of one.
    """

    usual: float
    braking: float
    dropped: Annotated[BoolArray, "impacts"]
    risen: Annotated[BoolArray, "impacts"]
    flown_in: Annotated[BoolArray, "impacts"]
    flown_out: Annotated[BoolArray, "impacts"]

    def measured(self, column: str) -> str:
        """The column of the table that a measured column was made from in all rows, else that
        itself.
        """
        if column == "v_y2" and self.risen.all():
            return "rebound_height"
        if column == "v_y2" and self.flown_out.all():
            return "flight_time_2"
        return column

    def take(self, rows: Annotated[IntArray, "chosen"]) -> FallModel:
        """The model of the impacts with these row numbers alone."""
        return FallModel(
            self.usual,
            self.braking,
            self.dropped[rows],
            self.risen[rows],
            self.flown_in[rows],
            self.flown_out[rows],
        )

    def true_states(self, values: Values, measured: Impacts) -> Impacts:
        """True incident states (draws, impacts) of measured ones: the heights and times are as
        measured, the drag is that of each draw.
        """
        v_y1 = measured.v_y1
        usual_braking = self.braking * self.usual
        if self.dropped.any():
            height = air.drop_height(np.where(self.dropped, v_y1, _ANY_SPEED), usual_braking)
            v_y1 = np.where(self.dropped, air.landing_speed(height, self._braking(values)), v_y1)
        if self.flown_in.any():
            landing = np.where(self.flown_in, v_y1, _ANY_SPEED)
            again = air.landing_of_same_time(landing, usual_braking, self._braking(values))
            v_y1 = np.where(self.flown_in, again, v_y1)
        if v_y1 is measured.v_y1:
            return measured
        return Impacts(*np.broadcast_arrays(measured.v_x1, v_y1, measured.omega_1))

    def measured_rebounds(self, values: Values, rebound: Rebound) -> Rebound:
        """Rebounds (draws, impacts) as their heights and times read at the usual drag."""
        v_y2 = rebound.v_y2
        usual_braking = self.braking * self.usual
        if self.risen.any():
            height = air.rebound_height(v_y2, self._braking(values))
            v_y2 = np.where(self.risen, air.launch_speed(height, usual_braking), v_y2)
        if self.flown_out.any():
            again = air.launch_of_same_time(v_y2, self._braking(values), usual_braking)
            v_y2 = np.where(self.flown_out, again, v_y2)
        return rebound if v_y2 is rebound.v_y2 else replace(rebound, v_y2=v_y2)

    def _braking(self, values: Values) -> FloatArray:
        """The braking (draws, 1) [1/m] of each draw, the usual one where no drag was fitted."""
        drag = values.get(DRAG_SPEC.name, np.array([self.usual]))
        return self.braking * drag[:, None]


def fall_of(table: ImpactTable, scene: Scene) -> FallModel | None:
    """The model of a table's heights and flights; None where it has none. A fit that was saved
    before heights were recorded has none: its heights became speeds without air.
    """
    sources = [entry for entry in table.read if "heights" in entry or "flights" in entry]
    if not sources:
        return None
    # Of several tables together each impact has the name of its own.
    source_names = np.array(table.labels.get("table", ("",) * len(table)))

    def impacts_with(kind: str, speed: str) -> BoolArray:
        """Which impacts have a speed that was a height or a time, by the `kind` of the entry."""
        chosen = np.zeros(len(table), np.bool_)
        for entry in sources:
            if speed in entry.get(kind, "").split(","):
                chosen |= source_names == entry.get("table", "")
        return chosen

    return FallModel(
        usual=float(sources[0]["drag"]),
        braking=air.braking_per_drag(scene.ball_value(), scene.air),
        dropped=impacts_with("heights", "v_y1"),
        risen=impacts_with("heights", "v_y2"),
        flown_in=impacts_with("flights", "v_y1"),
        flown_out=impacts_with("flights", "v_y2"),
    )
