"""Algebraic bounces without a time axis: `grip-slip` and its special case `brody`.

Impulse balance of a rigid ball with a tangential restitution `e_x` at the contact point and a normal force
that acts a distance `offset` ahead of the centre; the grip impulse is limited by Coulomb friction (Walton
1993; Foerster et al. 1994; Cross 2002, 2003). With `e_x = 0` and no offset the ball slides or rolls (Brody 1984).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitball.models.model import Model, ball_columns
from fitball.models.types import Phase, Rebound, Status
from fitball.values import FloatArray, Impacts

ANCHOR_SPEED = 10.0

GRIP_SLIP_PARAMETERS = ("mu", "e_x", "offset", "cor_10", "cor_slope")
BRODY_PARAMETERS = ("mu", "cor_10", "cor_slope")


@dataclass(frozen=True)
class GripSlipModel(Model):
    """The algebraic bounce; parameters that it does not list (`e_x`, `offset`) are zero."""

    @property
    def has_time(self) -> bool:
        """An impulse has no duration."""
        return False

    def evaluate(self, names: Sequence[str], values: FloatArray, impacts: Impacts) -> Rebound:
        """See `Model.evaluate`."""
        index = {name: column for column, name in enumerate(names)}

        def column(name: str) -> FloatArray:
            return values[:, index[name], None] if name in index else np.zeros((values.shape[0], 1))

        mass, radius, inertia = (item[:, None] for item in ball_columns(self.ball, names, values))
        cor = column("cor_10") + column("cor_slope") * (impacts.v_y1 - ANCHOR_SPEED)
        outside = ~((cor > 0.0) & (cor <= 1.0))
        cor = np.where(outside, np.nan, cor)
        normal_impulse = mass * (1.0 + cor) * impacts.v_y1
        limit = column("mu") * normal_impulse
        a = inertia / (mass * radius**2)
        slip = impacts.v_x1 - radius * impacts.omega_1
        shift = column("offset") * normal_impulse
        grip = mass * a / (1.0 + a) * ((1.0 + column("e_x")) * slip + shift / (a * mass * radius))
        impulse = np.clip(grip, -limit, limit)
        regime = np.select(
            [grip > limit, grip < -limit],
            [int(Phase.SLIDE_FORWARD), int(Phase.SLIDE_BACKWARD)],
            int(Phase.GRIP),
        )
        v_x2 = impacts.v_x1 - impulse / mass
        return Rebound(
            v_x2=v_x2,
            v_y2=cor * impacts.v_y1,
            omega_2=impacts.omega_1 + (radius * impulse - shift) / inertia,
            contact_time=np.full(v_x2.shape, np.nan),
            regime=np.where(outside, 0, regime).astype(np.int64),
            status=np.where(outside, int(Status.COR_OUT_OF_RANGE), int(Status.OK)).astype(np.int8),
        )
