"""`Model`: a value, no hierarchy."""

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
    """Rebounds by a compiled kernel under the choices `flags`; `absent` is what columns without a
    parameter hold.

    A subclass names the `entry` of one impact, the `batch` over draws and impacts as in
    `kernels.batch`, and the `columns` of a row, of which the last are BALL_PARAMETERS.
    """

    flags: Flags
    absent: tuple[float, ...]

    entry: ClassVar[Callable[..., Outcome]]
    batch: ClassVar[Callable[..., tuple[FloatArray, IntArray, IntArray]]]
    columns: ClassVar[tuple[str, ...]]

    def rows(self, ball: Ball, names: Sequence[str], values: FloatArray) -> FloatArray:
        """Rows of the kernel, (draws, columns)."""
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
        """See `Model.evaluate`."""
        rows = self.rows(ball, names, values)
        out, regime, status = type(self).batch(
            rows,
            self.flags,
            impacts.v_x1,
            impacts.v_y1,
            impacts.omega_1,
            cor,
        )
        return Rebound(out[0], out[1], out[2], out[3], out[4], out[5], out[6], regime, status)


@lru_cache(maxsize=256)
def _places(columns: tuple[str, ...], names: tuple[str, ...]) -> IntArray:
    """Columns of the parameters `names`."""
    return np.array([columns.index(name) for name in names], dtype=np.int64)


@dataclass(frozen=True)
class Model:
    """A model of the bounce: `options` are its named assumptions, `parameters` what it takes
    besides the ball's.

    Not `tangential`: vertical motion only. `timed`: it follows the contact in time. `below`: pairs
    of parameters of which the first must be less, ("cor_10", "mass_ratio"), the only wall within
    bounds. `source`: SHA-256 of a function of one's own, by which a saved fit knows it again.
    `text` is as `--model` takes it, `two-mass+offset=grip`. A model of another ball is
    `replace(model, ball=...)`. `solve` is a `KernelSolver` or a function of one's own.
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
        """Rebounds (draws, impacts) at `values` (draws, names) of its parameters and any of
        BALL_PARAMETERS, unchecked. `cor` (impacts,) replaces the law of restitution, as the
        thesis's computation needs it.
        """
        rebound = self.solve(self.ball, names, values, impacts, cor)
        if not self.tangential:
            rebound.regime[:] = 0
        return rebound

    def rebound(self, parameters: Mapping[str, ArrayLike], impacts: Impacts) -> Rebound:
        """The same, checked: numbers give (impacts,), draws (draws, impacts). Raises ParameterError
        (`parameters`, `out-of-bounds`, `no-answer` for a single set).
        """
        names, values, single = self._checked(parameters)
        if impacts.v_x1.ndim > 1:
            draws = len(impacts.v_x1)
            values = np.repeat(values, draws, axis=0) if single else values
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
                f"{impacts.v_y1[first]:g} m/s): "
                f"{reason}.",
                "no-answer",
            )
        return Rebound(*(array[0] for array in vars(rebound).values()))

    def history(
        self,
        parameters: Mapping[str, float],
        impact: Impacts,
        times: FloatArray,
    ) -> History:
        """Courses of one impact at `times` [s after landing]. Raises ModelError (`no-history`),
        ParameterError.
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
                "contact, "
                f"0 to {contact_time:.6g} s",
                "times",
            )
        found = followed(
            self.solve.rows(self.ball, names, values)[0],
            self.solve.flags,
            impact,
            times,
        )
        if not self.tangential:
            found.phase[:] = 0
        return found

    def kernel_call(self, parameters: Mapping[str, float]) -> KernelCall:
        """What ports are made of. Raises ModelError (`own-model`)."""
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
        return {
            spec.name: spec
            for spec in (*self.parameters, *(SPECS[name] for name in BALL_PARAMETERS))
        }

    def _checked(
        self,
        parameters: Mapping[str, ArrayLike],
    ) -> tuple[tuple[str, ...], FloatArray, bool]:
        """Names, values (draws, names), and whether they are numbers. Raises ParameterError."""
        for name in parameters:
            if name not in self.specs:
                raise self._wrong(f"has no parameter '{name}': {suggestion(name, self.specs)}")
        if missing := [spec.name for spec in self.parameters if spec.name not in parameters]:
            raise self._wrong(f"needs a value of {', '.join(missing)}")
        try:
            columns = [np.asarray(value, dtype=np.float64) for value in parameters.values()]
            given = np.stack(np.broadcast_arrays(*columns), axis=-1)
        except (TypeError, ValueError) as error:
            raise self._wrong(
                f"takes numbers, or as many draws of each parameter: {error}"
            ) from None
        if given.ndim > 2:
            raise self._wrong(f"takes numbers or draws (draws,): read shape {given.shape[:-1]}")
        values = np.atleast_2d(given)
        specs = [self.specs[name] for name in parameters]
        low, high = np.array([(spec.lower, spec.upper) for spec in specs]).T
        good = (values >= low) & (values <= high)
        if not good.all():
            draw, place = np.argwhere(~good)[0]
            read = f"{specs[place].name} = {values[draw, place]:g} {specs[place].unit}".rstrip()
            raise ParameterError(
                f"{read}: expected a value from {low[place]:g} to {high[place]:g}",
                "out-of-bounds",
            )
        return tuple(parameters), values, given.ndim == 1

    def _wrong(self, text: str) -> ParameterError:
        return ParameterError(f"model {self.name} {text}", "parameters")
