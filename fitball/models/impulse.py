"""Bounces without a time axis: one impulse. What they share, and `grip-slip` with its special case `brody`.

Impulse balance of a rigid ball with a tangential restitution `e_x` at the contact point and a normal force that acts
a distance `offset` ahead of the centre. With the normal impulse `P = M (1 + COR) v_y1`, `a = I/(M R^2)` and the slip
`u = v_x - R omega`, the friction impulse of a grip is `H = M a/(1 + a) ((1 + e_x) u + D P/(a M R))` with `D` the
offset, at most `mu P`; then `v_x` loses `H/M` and `omega` gains `(R H - D P)/I` (Walton 1993; Foerster et al. 1994;
Cross 2002, 2003). With `e_x = 0` and no offset the ball slides or rolls (Brody 1984).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.compiled import compiled, inner
from fitball.models.kernels.contact import ANCHOR_SPEED, saturating_restitution
from fitball.models.kernels.dual import Number, NumberArray
from fitball.models.model import (
    Bounced,
    LinearConstraint,
    Model,
    States,
    SteppedModel,
    saturating_constraints,
)
from fitball.models.specs import ParameterSpec, specs
from fitball.models.types import GRIP, SLIDE_BACKWARD, SLIDE_FORWARD, ImpulseClosures, Status
from fitball.values import Ball, Impacts


@dataclass(frozen=True)
class ImpulseModel(SteppedModel):
    """An algebraic bounce; parameters of the kernel that it does not list are zero.

    A subclass names its `kernel` of one impact, the `batch` of it over draws and impacts (as below),
    and the `columns` of their rows, which end with mass, radius and inertia of the ball. Both take numbers that carry
    a derivative, see `kernels.dual`.
    """

    absent_is_zero = True
    convention = "impulse"

    batch: ClassVar[Callable[..., None]]

    @classmethod
    def composer(
        cls, specs: Sequence[ParameterSpec], vertical: Sequence[ParameterSpec]
    ) -> Callable[[str, Ball, bool, ImpulseClosures | None], Model]:
        """What composes the model with parameters `specs`, those of `vertical` without motion along the court."""

        def compose(name: str, ball: Ball, tangential: bool, closures: ImpulseClosures | None) -> Model:
            options = {} if closures is None else asdict(closures)
            return cls(name, ball, options, tuple(specs if tangential else vertical), tangential=tangential)

        return compose

    def bounce(self, names: Sequence[str], values: NumberArray, states: States) -> Bounced:
        """See `SteppedModel.bounce`; no impulse takes the restitution as an input."""
        v_x1, v_y1, omega_1, _cor = states
        shape = (values.shape[0], v_x1.shape[1])
        out = np.empty((3, *shape), dtype=values.dtype)
        regime, status = np.empty(shape, dtype=np.int64), np.empty(shape, dtype=np.int8)
        type(self).batch(self.rows(names, values), v_x1, v_y1, omega_1, out, regime, status)
        return out, regime, status


COLUMNS = ("mu", "e_x", "offset", "cor_10", "cor_slope", "saturating", "ball_mass", "ball_radius", "ball_inertia")
# Above zero where the law of restitution is that of `restitution`, else it is a line.
SATURATING = COLUMNS.index("saturating")

OK = int(Status.OK)
COR_OUT_OF_RANGE = int(Status.COR_OUT_OF_RANGE)
REBOUND_FALLS = int(Status.REBOUND_FALLS)


@inner
def algebraic_bounce(
    row: NumberArray, v_x: Number, v_y: Number, omega: Number
) -> tuple[int, Number, Number, Number, int]:
    """Return `(status, v_x2, v_y2, omega_2, regime)` of one impact.

    The grip impulse is that of a tangential restitution `e_x` at the contact point with the normal force `offset`
    ahead of the centre; friction limits it (Walton 1993; Foerster et al. 1994; Cross 2002).
    """
    mu, e_x, offset, cor_10, cor_slope, saturating, mass, radius, inertia = row
    cor = cor_10 + cor_slope * (v_y - ANCHOR_SPEED)
    if saturating.real > 0.0:
        cor = saturating_restitution(cor_10, cor_slope, 1.0 + 0.0 * cor_10, v_y)
        if ANCHOR_SPEED * cor_slope.real <= -cor_10.real:
            return REBOUND_FALLS, cor, cor, cor, 0
    if not 0.0 < cor.real <= 1.0:
        nothing = math.nan + 0.0 * cor
        return COR_OUT_OF_RANGE, nothing, nothing, nothing, 0
    normal_impulse = mass * (1.0 + cor) * v_y
    limit = mu * normal_impulse
    a = inertia / (mass * (radius * radius))
    slip = v_x - radius * omega
    shift = offset * normal_impulse
    impulse = mass * a / (1.0 + a) * ((1.0 + e_x) * slip + shift / (a * mass * radius))
    regime = GRIP
    if impulse.real > limit.real:
        impulse, regime = limit, SLIDE_FORWARD
    elif impulse.real < -limit.real:
        impulse, regime = -limit, SLIDE_BACKWARD
    return OK, v_x - impulse / mass, cor * v_y, omega + (radius * impulse - shift) / inertia, regime


@compiled
def algebraic_batch(
    rows: NumberArray,
    v_x1: NumberArray,
    v_y1: NumberArray,
    omega_1: NumberArray,
    out: NumberArray,
    regime: NDArray[np.int64],
    status: NDArray[np.int8],
) -> None:
    """Fill `out` (3, draws, impacts) with v_x2, v_y2, omega_2 (all in one kind of number), regimes and statuses.

    The incident columns are (1, impacts), shared by all draws, or (draws, impacts).
    """
    for i in range(rows.shape[0]):
        row = rows[i]
        own = i if v_x1.shape[0] > 1 else 0
        for j in range(v_x1.shape[1]):
            status[i, j], out[0, i, j], out[1, i, j], out[2, i, j], regime[i, j] = algebraic_bounce(
                row, v_x1[own, j], v_y1[own, j], omega_1[own, j]
            )


VERTICAL = specs("cor_10", "cor_slope")
GRIP_SLIP = specs("mu", "e_x", "offset", "cor_10", "cor_slope")
BRODY = specs("mu", "cor_10", "cor_slope")


@dataclass(frozen=True)
class GripSlipModel(ImpulseModel):
    """The algebraic bounce with all or some of the parameters of `GRIP_SLIP`."""

    kernel = staticmethod(algebraic_bounce)
    batch = staticmethod(algebraic_batch)
    columns = COLUMNS

    @property
    def saturating(self) -> bool:
        """Whether the restitution follows that law instead of a line."""
        return self.options.get("cor") == "saturating"

    def linear_constraints(self, impacts: Impacts) -> tuple[LinearConstraint, ...]:
        """See `Model.linear_constraints`."""
        return saturating_constraints(False) if self.saturating else super().linear_constraints(impacts)

    def rows(self, names: Sequence[str], values: NumberArray) -> NumberArray:
        """See `Model.rows`."""
        rows = super().rows(names, values)
        rows[:, SATURATING] = float(self.saturating)
        return rows
