"""Algebraic bounces without a time axis: `grip-slip` and its special case `brody`.

Impulse balance of a rigid ball with a tangential restitution `e_x` at the contact point and a normal force
that acts a distance `offset` ahead of the centre; the grip impulse is limited by Coulomb friction (Walton
1993; Foerster et al. 1994; Cross 2002, 2003). With `e_x = 0` and no offset the ball slides or rolls (Brody 1984).
"""

from __future__ import annotations

from dataclasses import dataclass

from fitball.models.impulse_model import ImpulseModel
from fitball.models.kernels import algebraic
from fitball.models.specs import specs

VERTICAL = specs("cor_10", "cor_slope")
GRIP_SLIP = specs("mu", "e_x", "offset", "cor_10", "cor_slope")
BRODY = specs("mu", "cor_10", "cor_slope")


@dataclass(frozen=True)
class GripSlipModel(ImpulseModel):
    """The algebraic bounce with all or some of the parameters of `GRIP_SLIP`."""

    kernel = staticmethod(algebraic.algebraic_bounce)
    batch = staticmethod(algebraic.algebraic_batch)
    columns = algebraic.COLUMNS
