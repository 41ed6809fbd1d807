"""`Model`, a value without a hierarchy of classes, and solvers that run compiled kernels."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Annotated, ClassVar, NamedTuple

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
from fitball.models.travel import bounced, travel_of, turn_back, with_share
from fitball.models.types import REASONS, Rebound, Status


class KernelCall(NamedTuple):
    """The scalar kernel of one impact with its constant arguments, of which ports are made.

    Every kernel is called `entry(row, flags, v_x1, v_y1, omega_1, cor)`. `row` has the values of
    `columns` in SI; `flags` are the choices of the model.
    """

    entry: Callable[..., Outcome]
    columns: tuple[str, ...]
    row: tuple[float, ...]
    flags: Flags


@dataclass(frozen=True)
class KernelSolver:
    """Rebounds by a compiled kernel under the choices `flags`.

    A subclass names the `entry` of one impact, the `batch` over draws and impacts as in
    `kernels.batch`, and the `columns` of a row, of which the last are BALL_PARAMETERS. `absent` has
    a value for each of the other columns, for models without that parameter.
    """

    flags: Flags
    absent: tuple[float, ...]

    entry: ClassVar[Callable[..., Outcome]]
    batch: ClassVar[Callable[..., tuple[FloatArray, IntArray, IntArray]]]
    columns: ClassVar[tuple[str, ...]]

    def rows(
        self,
        ball: Ball,
        names: Sequence[str],
        values: Annotated[FloatArray, "draws parameters"],
    ) -> Annotated[FloatArray, "draws columns"]:
        """Rows of the kernel in SI, at `values` of the parameters `names`; others are those of
        `absent` and of the ball.
        """
        rows = np.empty((values.shape[0], len(self.columns)))
        rows[:] = (*self.absent, ball.mass, ball.radius, ball.inertia_ratio)
        rows[:, _indices_in_row(self.columns, tuple(names))] = values
        return rows

    def __call__(
        self,
        ball: Ball,
        names: Sequence[str],
        values: Annotated[FloatArray, "draws parameters"],
        impacts: Impacts,
        cor: Annotated[FloatArray, "..."] | None,
    ) -> Rebound:
        """Rebounds (draws, impacts) of a ball, as `Model.evaluate` returns them."""
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
def _indices_in_row(columns: tuple[str, ...], names: tuple[str, ...]) -> IntArray:
    """Indices in a row of the parameters `names`, (names,)."""
    return np.array([columns.index(name) for name in names], dtype=np.int64)


@dataclass(frozen=True)
class Model:
    """A model of the bounce, from parameters and incident states to rebounds.

    `name` is that of the model, and `text` is as `--model` takes it, `two-mass+offset=grip`.
    `options` are its assumptions by name. `parameters` are those that it has besides the ball's.
    `solve` is a `KernelSolver`, or runs a user's function.

    If the model is not `tangential` there is vertical motion only. If it is `timed` it follows the
    contact in time. `below` are pairs of parameters of which the first must be less, such as
    ("cor_10", "mass_ratio"), the only wall within bounds. `source` is the SHA-256 of a user's
    function, by which a saved fit recognizes it. A model of another ball is `replace(model,
    ball=...)`.

    Example:
        >>> import fitball
        >>> model = fitball.model("two-mass", offset="grip")
        >>> model.text
        'two-mass+offset=grip'
        >>> [spec.name for spec in model.parameters][:4]
        ['mass_ratio', 'k_y', 'k_theta', 'mu']
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
        """Whether the model has an answer for a rebound column.

        Example:
            >>> import fitball
            >>> from fitball.base.columns import COLUMNS
            >>> fitball.model("two-mass").predicts(COLUMNS["contact_time"])
            True
            >>> fitball.model("brody").predicts(COLUMNS["contact_time"])
            False
        """
        moves = self.tangential or not column.tangential
        return moves and (self.timed or not column.timed)

    def evaluate(
        self,
        names: Sequence[str],
        values: Annotated[FloatArray, "draws parameters"],
        impacts: Impacts,
        cor: Annotated[FloatArray, "..."] | None = None,
    ) -> Rebound:
        """Rebounds (draws, impacts) at many parameter sets, which are not checked.

        Args:
            names: all parameters of the model, and any of the ball (`ball_mass`, `ball_radius`,
                `inertia_ratio`)
            values: a row of their values for each draw, SI
            impacts: incident states of all draws, or of each
            cor: restitution in place of the law, where it is not NaN; of each impact, or
                (draws, 1) of each draw

        Raises:
            ModelError: a user's function fails (`own-model`).

        Example:
            >>> import fitball
            >>> import numpy as np
            >>> brody = fitball.model("brody")
            >>> draws = np.array([[0.5, 0.7, 0.0], [0.6, 0.8, 0.0]])
            >>> impacts = fitball.impacts([20.0, 15.0, 5.0], 10.0)
            >>> rebound = brody.evaluate(["mu", "cor_10", "cor_slope"], draws, impacts)
            >>> rebound.v_y2.tolist()
            [[7.0, 7.0, 7.0], [8.0, 8.0, 8.0]]
        """
        rebound = bounced(self.solve, self.ball, names, values, impacts, cor)
        if not self.tangential:
            rebound.regime[:] = 0
        return rebound

    def rebound(self, parameters: Mapping[str, ArrayLike], impacts: Impacts) -> Rebound:
        """Rebounds at `parameters` by name, SI, which are checked.

        Arrays are (impacts,) at a number for each parameter, and (draws, impacts) at draws
        (draws,) of any parameter.

        Raises:
            ParameterError: a parameter is unknown or missing, or shapes differ (`parameters`). A
                value is outside its bounds (`out-of-bounds`). A single parameter set has no answer
                for an impact (`no-answer`).
            ModelError: a user's function fails (`own-model`).

        Example:
            >>> import fitball
            >>> brody = fitball.model("brody")
            >>> impacts = fitball.impacts([20.0, 5.0], 10.0)
            >>> brody.rebound({"mu": 0.5, "cor_10": 0.75, "cor_slope": 0.0}, impacts).v_x2.shape
            (2,)
            >>> draws = {"mu": [0.5, 0.6, 0.7], "cor_10": 0.75, "cor_slope": 0.0}
            >>> brody.rebound(draws, impacts).v_x2.shape
            (3, 2)
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
        times: Annotated[FloatArray, "times"],
    ) -> History:
        """The courses of one impact (1,) at `times` [s] after landing.

        Args:
            parameters: a number for each parameter, SI
            impact: one incident state
            times: times within the contact

        Raises:
            ModelError: the model has no time axis (`no-history`).
            ParameterError: a time is outside the contact (`times`). There are several impacts or
                draws, or a parameter is unknown or missing (`parameters`). A value is outside its
                bounds (`out-of-bounds`). The model has no answer (`no-answer`).

        Example:
            >>> import fitball
            >>> import numpy as np
            >>> model = fitball.model("two-mass")
            >>> parameters = {spec.name: spec.typical for spec in model.parameters}
            >>> impact = fitball.impacts(20.0, 8.0)
            >>> history = model.history(parameters, impact, np.array([0.0, 1e-3, 2e-3]))
            >>> history.courses["slip"].round(1).tolist()
            [15.1, 15.3, 9.9]
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
        travel = travel_of(impact)
        row = self.solve.rows(self.ball, names, with_share(names, values, travel.share[:, None]))[0]
        history = followed(row, self.solve.flags, travel.forwards, times)
        turn_back(history.courses, travel.side)
        if not self.tangential:
            history.phase[:] = 0
        return history

    def kernel_call(self, parameters: Mapping[str, float]) -> KernelCall:
        """The kernel of one impact with its arguments at one set of `parameters`, SI.

        Raises:
            ModelError: the model is a Python function (`own-model`).
            ParameterError: a parameter is unknown or missing (`parameters`), or a value is outside
                its bounds (`out-of-bounds`).

        Example:
            >>> import fitball
            >>> brody = fitball.model("brody")
            >>> call = brody.kernel_call({"mu": 0.5, "cor_10": 0.75, "cor_slope": 0.0})
            >>> call.columns[:4], call.row[:4]
            (('mu', 'e_x', 'offset', 'cor_10'), (0.5, 0.0, 0.0, 0.75))
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
        """The parameters of the model, then those of its ball, by name.

        Example:
            >>> import fitball
            >>> list(fitball.model("brody").specs)
            ['mu', 'cor_10', 'cor_slope', 'ball_mass', 'ball_radius', 'inertia_ratio']
        """
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
        """Refuse `values` (draws, specs) outside their bounds, and NaN. Raises ParameterError
        (`out-of-bounds`) for the first of them.
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
