"""Algebraic bounces without a time axis: `grip-slip` and its special case `brody`.

Impulse balance of a rigid ball with a tangential restitution `e_x` at the contact point and a normal force
that acts a distance `offset` ahead of the centre; the grip impulse is limited by Coulomb friction (Walton
1993; Foerster et al. 1994; Cross 2002, 2003). With `e_x = 0` and no offset the ball slides or rolls (Brody 1984).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitball.models.dual import STEP, NumberArray
from fitball.models.jacobian import INPUTS, OUTPUTS, ReboundJacobian, moved_inputs
from fitball.models.model import Model, ball_columns
from fitball.models.types import Phase, Rebound, Status
from fitball.values import FloatArray, Impacts, OwnImpacts

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

    def evaluate(self, names: Sequence[str], values: FloatArray, impacts: Impacts | OwnImpacts) -> Rebound:
        """See `Model.evaluate`."""
        found, regime, outside = self._bounce(names, values, *impacts.states()[:3])
        return Rebound(
            *found,
            contact_time=np.full(regime.shape, np.nan),
            regime=np.where(outside, 0, regime).astype(np.int64),
            status=np.where(outside, int(Status.COR_OUT_OF_RANGE), int(Status.OK)).astype(np.int8),
        )

    def jacobian(
        self,
        names: Sequence[str],
        values: FloatArray,
        impacts: Impacts | OwnImpacts,
        parameters: Sequence[str] | None = None,
    ) -> ReboundJacobian:
        """See `Model.jacobian`."""
        chosen = tuple(names) if parameters is None else tuple(parameters)
        shape = values.shape[0], len(impacts)
        slopes = np.full((*shape, len(OUTPUTS), len(INPUTS) + len(chosen)), np.nan)
        # All moves at once, one below the other: a call costs more than the numbers of a small table.
        moves = tuple(moved_inputs(names, values, replace(impacts, cor=None), chosen))
        states = (
            np.concatenate([np.broadcast_to(getattr(moved, name), shape) for moved in moves]) for name in INPUTS
        )
        found, _regime, outside = self._bounce(names, np.concatenate([moved.values for moved in moves]), *states)
        for output, value in enumerate(found):
            gained = np.where(outside, np.nan, np.imag(value) / STEP).reshape(-1, *shape)
            slopes[:, :, output, :] = np.moveaxis(gained, 0, -1)
        return ReboundJacobian(
            rebound=self.evaluate(names, values, impacts),
            names=chosen,
            inputs=slopes[..., : len(INPUTS)],
            parameters=slopes[..., len(INPUTS) :],
            cor=None,
        )

    def _bounce(
        self, names: Sequence[str], values: NumberArray, v_x: NumberArray, v_y: NumberArray, omega: NumberArray
    ) -> tuple[tuple[NumberArray, NumberArray, NumberArray], NDArray[np.int64], NDArray[np.bool_]]:
        """`(v_x2, v_y2, omega_2)`, regime, and where the restitution is impossible, in the kind of number given."""
        index = {name: column for column, name in enumerate(names)}

        def column(name: str) -> NumberArray:
            return values[:, index[name], None] if name in index else np.zeros((values.shape[0], 1))

        mass, radius, inertia = (item[:, None] for item in ball_columns(self.ball, names, values))
        cor = column("cor_10") + column("cor_slope") * (v_y - ANCHOR_SPEED)
        outside = ~((cor.real > 0.0) & (cor.real <= 1.0))
        cor = np.where(outside, np.nan, cor)
        normal_impulse = mass * (1.0 + cor) * v_y
        limit = column("mu") * normal_impulse
        a = inertia / (mass * radius**2)
        slip = v_x - radius * omega
        shift = column("offset") * normal_impulse
        grip = mass * a / (1.0 + a) * ((1.0 + column("e_x")) * slip + shift / (a * mass * radius))
        forward, backward = grip.real > limit.real, grip.real < -limit.real
        impulse = np.where(forward, limit, np.where(backward, -limit, grip))
        regime = np.where(forward, Phase.SLIDE_FORWARD, np.where(backward, Phase.SLIDE_BACKWARD, Phase.GRIP))
        v_x2 = v_x - impulse / mass
        return (v_x2, cor * v_y, omega + (radius * impulse - shift) / inertia), regime, outside
