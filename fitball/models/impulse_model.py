"""The face of bounces without a time axis: one impulse, given by a kernel of one impact and its batch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from fitball.models.capabilities import KernelCall
from fitball.models.jacobian import INPUTS, ReboundJacobian
from fitball.models.kernels.dual import STEP, NumberArray
from fitball.models.model import Model, ball_columns
from fitball.models.specs import ParameterSpec
from fitball.models.types import OUTPUTS, Rebound, Status
from fitball.values import Ball, FloatArray, Impacts, OwnImpacts


@dataclass(frozen=True)
class ImpulseModel(Model):
    """An algebraic bounce; parameters of the kernel that it does not list are zero.

    A subclass names its `kernel` of one impact, the `batch` of it over draws and impacts (as `algebraic` has them),
    and the `columns` of their rows, which end with mass, radius and inertia of the ball. Both take numbers that carry
    a derivative, see `kernels.dual`.
    """

    absent_is_zero = True

    kernel: ClassVar[Callable[..., Any]]
    batch: ClassVar[Callable[..., None]]
    columns: ClassVar[tuple[str, ...]]

    @classmethod
    def composer(
        cls, specs: Sequence[ParameterSpec], vertical: Sequence[ParameterSpec]
    ) -> Callable[[str, Ball, bool, None], Model]:
        """What composes the model with parameters `specs`, those of `vertical` without motion along the court."""

        def compose(name: str, ball: Ball, tangential: bool, _closures: None) -> Model:
            return cls(name, ball, {}, tuple(specs if tangential else vertical), tangential=tangential)

        return compose

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
        draws, count, moves = values.shape[0], len(impacts), len(INPUTS) + len(chosen)
        # One complex step after the other, all in one batch, as if they were draws.
        rows = np.repeat(values[None].astype(np.complex128), moves, axis=0)
        for k, name in enumerate(chosen):
            rows[len(INPUTS) + k, :, list(names).index(name)] += 1j * STEP
        columns = []
        for k, column in enumerate(impacts.states()[:3]):
            columns.append(np.repeat(np.broadcast_to(column, (1, draws, count)).astype(np.complex128), moves, axis=0))
            columns[k][k] += 1j * STEP
        flat = (column.reshape(-1, count) for column in columns)
        out, _regime, status = self._bounce(names, rows.reshape(-1, values.shape[1]), *flat)
        slopes = np.full((draws, count, len(OUTPUTS), moves), np.nan)
        rates = np.where(status == Status.OK, np.imag(out) / STEP, np.nan).reshape(3, moves, draws, count)
        slopes[:, :, :3] = rates.transpose(2, 3, 0, 1)
        return ReboundJacobian(
            rebound=self.evaluate(names, values, impacts),
            names=chosen,
            inputs=slopes[..., : len(INPUTS)],
            parameters=slopes[..., len(INPUTS) :],
            cor=None,
        )

    def kernel_call(self, names: Sequence[str], values: FloatArray) -> KernelCall:
        """See `Model.kernel_call`."""
        row = self._rows(names, np.asarray(values, dtype=np.float64)[None, :])[0]
        return KernelCall("impulse", type(self).kernel, self.columns, tuple(map(float, row)), (), {})

    def _rows(self, names: Sequence[str], values: NumberArray) -> NumberArray:
        """The kernel's parameter rows, (draws, columns), in the kind of number of `values`."""
        rows = np.zeros((values.shape[0], len(self.columns)), dtype=values.dtype)
        for column, name in enumerate(self.columns):
            if name in names:
                rows[:, column] = values[:, list(names).index(name)]
        rows[:, -3], rows[:, -2], rows[:, -1] = ball_columns(self.ball, names, values)
        return rows

    def _bounce(
        self, names: Sequence[str], values: NumberArray, v_x: NumberArray, v_y: NumberArray, omega: NumberArray
    ) -> tuple[NumberArray, NDArray[np.int64], NDArray[np.int8]]:
        """`(v_x2, v_y2, omega_2)` (3, draws, impacts) in the kind of number given, regimes and statuses."""
        shape = (values.shape[0], v_x.shape[1])
        out = np.empty((3, *shape), dtype=values.dtype)
        regime, status = np.empty(shape, dtype=np.int64), np.empty(shape, dtype=np.int8)
        type(self).batch(self._rows(names, values), v_x, v_y, omega, out, regime, status)
        return out, regime, status
