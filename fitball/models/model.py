"""`Model`, a value without a hierarchy of classes, and solvers by compiled kernels."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fitball.base.columns import Column
from fitball.base.errors import ModelError, ParameterError, suggestion
from fitball.base.priors import ParameterSpec
from fitball.base.values import Ball, FloatArray, Impacts, IntArray
from fitball.models.history import History, followed
from fitball.models.kernels.contact import Flags
from fitball.models.kernels.phases import Outcome
from fitball.models.specs import BALL_PARAMETERS, SPECS
from fitball.models.types import REASONS, Rebound, Status


class KernelCall(NamedTuple):
    """The scalar kernel of one impact and its constant arguments: all that a port needs besides the
    kernel's source. Every kernel is called `entry(row, flags, v_x1, v_y1, omega_1, cor)`; `row`
    holds `columns` in SI.
    """

    entry: Callable[..., Outcome]
    columns: tuple[str, ...]
    row: tuple[float, ...]
    flags: Flags


@dataclass(frozen=True)
class KernelSolver:
    """Rebounds by a compiled kernel under the choices `flags`; `absent` are the values of columns
    that are neither a parameter's nor the ball's.

    A subclass names the `entry` of one impact, the `batch` over draws and impacts as in
    `kernels.batch`, and the `columns` of a row, of which the last are BALL_PARAMETERS.
    """

    flags: Flags
    absent: tuple[float, ...]

    entry: ClassVar[Callable[..., Outcome]]
    batch: ClassVar[Callable[..., tuple[FloatArray, IntArray, IntArray]]]
    columns: ClassVar[tuple[str, ...]]

    def rows(self, ball: Ball, names: Sequence[str], values: FloatArray) -> FloatArray:
        """Rows of the kernel (draws, columns), SI, at `values` (draws, names)."""
        rows = np.empty((values.shape[0], len(self.columns)))
        rows[:] = (*self.absent, ball.mass, ball.radius, ball.inertia_ratio)
        rows[:, _places(self.columns, tuple(names))] = values
        return rows

    def __call__(
        self,
        ball: Ball,
        names: Sequence[str],
        values: FloatArray,
        impacts: Impacts,
        cor: FloatArray | None,
    ) -> Rebound:
        """Rebounds (draws, impacts) as of `Model.evaluate`."""
        rows = self.rows(ball, names, values)
        batch = type(self).batch
        state = (impacts.v_x1, impacts.v_y1, impacts.omega_1)
        out, regime, status = batch(rows, self.flags, *state, cor)
        v_x2, v_y2, omega_2, contact_time, gap_time, gap_path, gap_turn = out
        return Rebound(
            v_x2,
            v_y2,
            omega_2,
            contact_time,
            gap_time,
            gap_path,
            gap_turn,
            regime,
            status,
        )


@lru_cache(maxsize=256)
def _places(columns: tuple[str, ...], names: tuple[str, ...]) -> IntArray:
    """Places in a row (names,) of the parameters `names`."""
    return np.array([columns.index(name) for name in names], dtype=np.int64)


@dataclass(frozen=True)
class Model:
    """A model of the bounce: `options` are its assumptions by name, `parameters` those that it has
    besides the ball's.

    If it is not `tangential` there is vertical motion only. If it is `timed` it follows the contact
    in time. `below` are pairs of parameters of which the first must be less, ("cor_10",
    "mass_ratio"), the only wall within bounds. `source` is the SHA-256 of a user's function, by
    which a saved fit recognizes it. `text` is as `--model` takes it, `two-mass+offset=grip`. A
    model of another ball is `replace(model, ball=...)`. `solve` is a `KernelSolver` or a user's
    function.
    """

    name: str
    text: str
    ball: Ball
    options: Mapping[str, str]
    parameters: tuple[ParameterSpec, ...]
    solve: Callable[..., Rebound]
    tangential: bool = True
    timed: bool = False
    below: tuple[tuple[str, str], ...] = ()
    source: str = ""

    def predicts(self, column: Column) -> bool:
        """Whether the model says anything of a rebound column."""
        moves = self.tangential or not column.tangential
        return moves and (self.timed or not column.timed)

    def evaluate(
        self,
        names: Sequence[str],
        values: FloatArray,
        impacts: Impacts,
        cor: FloatArray | None = None,
    ) -> Rebound:
        """Rebounds (draws, impacts) at `values` (draws, names) in SI of its parameters and any of
        BALL_PARAMETERS, which are not checked. `cor` (impacts,) replaces the law of restitution
        where it is not NaN, as the thesis's computation needs it.
        """
        rebound = self.solve(self.ball, names, values, impacts, cor)
        if not self.tangential:
            rebound.regime[:] = 0
        return rebound

    def rebound(self, parameters: Mapping[str, ArrayLike], impacts: Impacts) -> Rebound:
        """Rebounds at checked parameters in SI: (impacts,) at one number of each, (draws, impacts)
        at draws (draws,) of each. Raises ParameterError (`parameters`, `out-of-bounds`, and of a
        single set `no-answer`).
        """
        names, values, single = self._checked(parameters)
        if impacts.v_x1.ndim > 1:
            draws = len(impacts.v_x1)
            if single:
                values = np.repeat(values, draws, axis=0)
                single = False
            if len(values) != draws:
                raise self._wrong(
                    f"takes as many draws as of impacts: read {len(values)} and {draws}"
                )
        rebound = self.evaluate(names, values, impacts)
        if not single:
            return rebound
        if rebound.status.any():
            first = int(np.flatnonzero(rebound.status[0])[0])
            reason = REASONS[Status(int(rebound.status[0, first]))]
            raise ParameterError(
                f"model {self.name} has no answer for impact {first + 1} (v_y1 = "
                f"{impacts.v_y1[first]:g} m/s): {reason}.",
                "no-answer",
            )
        return Rebound(**{name: array[0] for name, array in vars(rebound).items()})

    def history(
        self,
        parameters: Mapping[str, float],
        impact: Impacts,
        times: FloatArray,
    ) -> History:
        """Courses of one impact (1,) at `times` (times,) [s after landing]. Raises ModelError
        (`no-history`), ParameterError (`times`, and as `rebound`).
        """
        if not (self.timed and isinstance(self.solve, KernelSolver)):
            raise ModelError(
                f"model {self.name} has no time axis: use two-mass or thesis-exact",
                "no-history",
            )
        names, values, single = self._checked(parameters)
        if not single or impact.v_x1.shape != (1,):
            raise self._wrong("has courses of one impact with one value of each parameter")
        contact_time = float(self.rebound(parameters, impact).contact_time[0])
        times = np.atleast_1d(np.asarray(times, dtype=np.float64))
        if not np.all((times >= 0.0) & (times <= contact_time)):
            raise ParameterError(
                f"read times from {times.min():g} to {times.max():g} s: expected times within the "
                f"contact, 0 to {contact_time:.6g} s",
                "times",
            )
        row = self.solve.rows(self.ball, names, values)[0]
        history = followed(row, self.solve.flags, impact, times)
        if not self.tangential:
            history.phase[:] = 0
        return history

    def kernel_call(self, parameters: Mapping[str, float]) -> KernelCall:
        """The kernel with its arguments at one set of parameters, of which ports are made. Raises
        ModelError (`own-model`), ParameterError (`parameters`, `out-of-bounds`).
        """
        if not isinstance(self.solve, KernelSolver):
            raise ModelError(
                f"model {self.name} is a Python function: it cannot be ported",
                "own-model",
            )
        names, values, _ = self._checked(parameters)
        row = self.solve.rows(self.ball, names, values)[0]
        return KernelCall(
            type(self.solve).entry,
            self.solve.columns,
            tuple(map(float, row)),
            self.solve.flags,
        )

    @cached_property
    def specs(self) -> Mapping[str, ParameterSpec]:
        """Its parameters and those of its ball, by name."""
        ball = [SPECS[name] for name in BALL_PARAMETERS]
        return {spec.name: spec for spec in (*self.parameters, *ball)}

    def _checked(
        self,
        parameters: Mapping[str, ArrayLike],
    ) -> tuple[tuple[str, ...], FloatArray, bool]:
        """Names, values (draws, names), and whether these are a single set of numbers. Raises
        ParameterError (`parameters`, `out-of-bounds`).
        """
        for name in parameters:
            if name not in self.specs:
                raise self._wrong(f"has no parameter '{name}': {suggestion(name, self.specs)}")
        missing = [spec.name for spec in self.parameters if spec.name not in parameters]
        if missing:
            raise self._wrong(f"needs a value of {', '.join(missing)}")
        try:
            columns = [np.asarray(value, dtype=np.float64) for value in parameters.values()]
            stacked = np.stack(np.broadcast_arrays(*columns), axis=-1)
        except (TypeError, ValueError) as error:
            text = f"takes numbers, or as many draws of each parameter: {error}"
            raise self._wrong(text) from None
        if stacked.ndim > 2:
            raise self._wrong(f"takes numbers or draws (draws,): read shape {stacked.shape[:-1]}")
        values = np.atleast_2d(stacked)
        self._check_bounds([self.specs[name] for name in parameters], values)
        return tuple(parameters), values, stacked.ndim == 1

    def _check_bounds(self, specs: Sequence[ParameterSpec], values: FloatArray) -> None:
        """Whether all `values` (draws, specs) are within their bounds; those of NaN are not. Raises
        ParameterError (`out-of-bounds`) for the first that is not.
        """
        low = np.array([spec.lower for spec in specs])
        high = np.array([spec.upper for spec in specs])
        outside = ~((values >= low) & (values <= high))
        if not outside.any():
            return
        draw, k = np.argwhere(outside)[0]
        spec = specs[k]
        read = f"{spec.name} = {values[draw, k]:g} {spec.unit}".rstrip()
        text = f"{read}: expected a value from {spec.lower:g} to {spec.upper:g}"
        raise ParameterError(text, "out-of-bounds")

    def _wrong(self, text: str) -> ParameterError:
        """An error in the parameters, not yet raised."""
        return ParameterError(f"model {self.name} {text}", "parameters")
