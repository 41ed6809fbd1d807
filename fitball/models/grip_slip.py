"""Algebraic bounces without a time axis: `grip-slip` and its special case `brody`.

Impulse balance of a rigid ball with a tangential restitution `e_x` at the contact point and a normal force
that acts a distance `offset` ahead of the centre; the grip impulse is limited by Coulomb friction (Walton
1993; Foerster et al. 1994; Cross 2002, 2003). With `e_x = 0` and no offset the ball slides or rolls (Brody 1984).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

from fitball.models.capabilities import LinearConstraint
from fitball.models.impulse_model import ImpulseModel
from fitball.models.kernels import algebraic
from fitball.models.kernels.dual import NumberArray
from fitball.models.model import Model, saturating_constraints
from fitball.models.specs import ParameterSpec, specs
from fitball.models.types import ImpulseClosures
from fitball.values import Ball, Impacts

VERTICAL = specs("cor_10", "cor_slope")
GRIP_SLIP = specs("mu", "e_x", "offset", "cor_10", "cor_slope")
BRODY = specs("mu", "cor_10", "cor_slope")


@dataclass(frozen=True)
class GripSlipModel(ImpulseModel):
    """The algebraic bounce with all or some of the parameters of `GRIP_SLIP`."""

    kernel = staticmethod(algebraic.algebraic_bounce)
    batch = staticmethod(algebraic.algebraic_batch)
    columns = algebraic.COLUMNS

    @property
    def saturating(self) -> bool:
        """Whether the restitution follows that law instead of a line."""
        return self.options.get("cor") == "saturating"

    def linear_constraints(self, impacts: Impacts) -> tuple[LinearConstraint, ...]:
        """See `Model.linear_constraints`."""
        return saturating_constraints(False) if self.saturating else super().linear_constraints(impacts)

    def _rows(self, names: Sequence[str], values: NumberArray) -> NumberArray:
        rows = super()._rows(names, values)
        rows[:, algebraic.SATURATING] = float(self.saturating)
        return rows


def compose_grip_slip(
    parameters: Sequence[ParameterSpec],
) -> Callable[[str, Ball, bool, ImpulseClosures], Model]:
    """What composes the model with these parameters, those of `VERTICAL` without motion along the court."""

    def compose(name: str, ball: Ball, tangential: bool, closures: ImpulseClosures) -> Model:
        return GripSlipModel(
            name, ball, asdict(closures), tuple(parameters if tangential else VERTICAL), tangential=tangential
        )

    return compose
