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

from fitball.models.jacobian import INPUTS, OUTPUTS, ReboundJacobian, moved_inputs
from fitball.models.kernels import algebraic
from fitball.models.kernels.dual import STEP, NumberArray
from fitball.models.model import Model, ball_columns
from fitball.models.types import Rebound, Status
from fitball.values import FloatArray, Impacts, OwnImpacts

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
        out, regime, status = self._bounce(names, values, *impacts.states()[:3])
        return Rebound(out[0], out[1], out[2], np.full(regime.shape, np.nan), regime, status)

    def jacobian(
        self,
        names: Sequence[str],
        values: FloatArray,
        impacts: Impacts | OwnImpacts,
        parameters: Sequence[str] | None = None,
    ) -> ReboundJacobian:
        """See `Model.jacobian`."""
        chosen = tuple(names) if parameters is None else tuple(parameters)
        plain = replace(impacts, cor=None)
        slopes = np.full((values.shape[0], len(impacts), len(OUTPUTS), len(INPUTS) + len(chosen)), np.nan)
        for moved in moved_inputs(names, values, plain, chosen):
            out, _regime, status = self._bounce(names, moved.values, moved.v_x1, moved.v_y1, moved.omega_1)
            for output, value in enumerate(out):
                slopes[:, :, output, moved.place] = np.where(status == Status.OK, np.imag(value) / STEP, np.nan)
        return ReboundJacobian(
            rebound=self.evaluate(names, values, impacts),
            names=chosen,
            inputs=slopes[..., : len(INPUTS)],
            parameters=slopes[..., len(INPUTS) :],
            cor=None,
        )

    def _rows(self, names: Sequence[str], values: NumberArray) -> NumberArray:
        """The kernel's parameter rows, (draws, columns), in the kind of number of `values`."""
        rows = np.zeros((values.shape[0], len(algebraic.COLUMNS)), dtype=values.dtype)
        for column, name in enumerate(algebraic.COLUMNS):
            if name in names:
                rows[:, column] = values[:, list(names).index(name)]
        rows[:, 5], rows[:, 6], rows[:, 7] = ball_columns(self.ball, names, values)
        return rows

    def _bounce(
        self, names: Sequence[str], values: NumberArray, v_x: NumberArray, v_y: NumberArray, omega: NumberArray
    ) -> tuple[NumberArray, NDArray[np.int64], NDArray[np.int8]]:
        """`(v_x2, v_y2, omega_2)` (3, draws, impacts) in the kind of number given, regimes and statuses."""
        shape = (values.shape[0], v_x.shape[1])
        out = np.empty((3, *shape), dtype=values.dtype)
        regime, status = np.empty(shape, dtype=np.int64), np.empty(shape, dtype=np.int8)
        algebraic.algebraic_batch(self._rows(names, values), v_x, v_y, omega, out, regime, status)
        return out, regime, status
