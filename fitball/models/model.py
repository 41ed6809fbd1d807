"""What every bounce model has in common: a name, a ball, parameters, `rebound`, and what it can do beside that.

Callers ask a model what it can do, not for its name or class.
"""

from __future__ import annotations

import reprlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any, ClassVar, Literal, Protocol, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fitball.errors import ModelError, ParameterError, suggestion
from fitball.models.history import History
from fitball.models.kernels.contact import ANCHOR_SPEED
from fitball.models.kernels.dual import STEP, NumberArray
from fitball.models.specs import BALL_PARAMETERS, BALL_SPECS, ParameterSpec
from fitball.models.types import OUTPUTS, STATUS_REASON, Rebound, Status
from fitball.observables import ReboundColumn
from fitball.values import Ball, FloatArray, Impacts, OwnImpacts, numbers
from fitball.wording import spoken

# How far inside an end where the model stops (a restitution of zero, a shell without mass) a search may go, in units
# of the quantity itself: nothing measurable, and far above rounding.
ROUNDING = 1e-6
# A hair inside a bound that a restitution and a mass ratio share: a few times the rounding of either.
HAIR = 1e-12
# Places of the derivatives with respect to an impact's own restitution, and behind all of its inputs.
COR, INPUT_COUNT = 3, 4


@dataclass(frozen=True)
class LinearConstraint:
    """`sum(coefficients[name] * value) <= bound`, in SI: where it is broken the model has no answer.

    `margin` is how far inside a search stays, in units of the bound. `lower_bound_of` names a parameter, of
    coefficient -1, for which the others make this a lower bound that moves with them, and on which the best fit often
    lies; `words` are that bound for a reader.
    """

    coefficients: Mapping[str, float]
    bound: float
    margin: float = 0.0
    lower_bound_of: str = ""
    words: str = ""


class Oracle(Protocol):
    """A slow solution of the same motion that shares no formula with the kernel."""

    def steps(self, parameters: Mapping[str, float], impacts: Impacts) -> float:
        """Steps that the impact which takes most would need, of some microseconds each."""

    def rebound(self, parameters: Mapping[str, float], impacts: Impacts, digits: int | None = None) -> Rebound:
        """Rebound of each impact, (impacts,), in double precision or with so many `digits`."""


# How a kernel of one impact is called, as (arguments) -> (results):
#   impulse   (row, v_x1, v_y1, omega_1) -> (status, v_x2, v_y2, omega_2, phases)
#   two-mass  (row, codes, v_x1, v_y1, omega_1, cor, scratch) -> Bounce, see `kernels.bounce`
#   thesis    (row, damping, cor, v_x1, v_y1, omega_1) -> (status, v_x2, v_y2, omega_2, contact_time, phases)
Convention = Literal["impulse", "two-mass", "thesis"]


@dataclass(frozen=True)
class KernelCall:
    """The kernel of one impact and its constant arguments, in SI: all that a port needs besides the kernel's source.

    `row` are the numbers named by `columns`, `codes` the closures as the kernel reads them.
    """

    convention: Convention
    entry: Callable[..., Any]
    columns: tuple[str, ...]
    row: tuple[float, ...]
    codes: tuple[int, ...]


INPUTS = ("v_x1", "v_y1", "omega_1")


@dataclass(frozen=True)
class ReboundJacobian:
    """A rebound, (draws, impacts), and its derivatives, SI units; the outputs are in the order of `OUTPUTS`.

    `inputs` (draws, impacts, outputs, 3): with respect to `INPUTS`, including what the lines of `eps` and of the
    restitution make of `v_y1`. `parameters` (draws, impacts, outputs, names): with respect to `names`. `cor` (draws,
    impacts, outputs): with respect to the impact's own measured restitution, which the closure `cor = measured` makes
    an input independent of the speeds; None without that closure. All are those of the regime the impact is in; on
    the boundary of two regimes the rebound has a kink, and they are one-sided. Where the status is not OK they are
    NaN, as is the contact time of models that have none.
    """

    rebound: Rebound
    names: tuple[str, ...]
    inputs: FloatArray
    parameters: FloatArray
    cor: FloatArray | None


def by_output(slopes: FloatArray) -> dict[str, FloatArray]:
    """Derivatives (..., outputs, inputs) as a view (..., inputs) of each output, by name."""
    return {name: slopes[..., place, :] for place, name in enumerate(OUTPUTS)}


def seeds(
    rows: Callable[[Sequence[str], NumberArray], NumberArray],
    names: Sequence[str],
    values: FloatArray,
    parameters: Sequence[str],
) -> FloatArray:
    """What each column of `rows(names, values)` gains per unit of a parameter, (parameters, draws, columns)."""
    moved = np.repeat(values[None].astype(np.complex128), len(parameters), axis=0)
    for k, name in enumerate(parameters):
        moved[k, :, list(names).index(name)] += 1j * STEP
    gains = rows(names, moved.reshape(-1, values.shape[1])).imag / STEP
    return gains.reshape(len(parameters), values.shape[0], gains.shape[1])


@dataclass(frozen=True)
class Model(ABC):
    """A bounce model with its ball; subclasses define its parameters and evaluate it.

    `options` are the named choices it was composed of, as text. With `tangential` false only the vertical motion is
    solved.

    Attributes state what a model can do besides `rebound`: `has_time` (a contact time), `has_force`
    (`force_integrals`), `has_gaps` (what is between the flights), `no_history` (why `history` gives no courses,
    if so), `linear_constraints`, `oracle`. With `absent_is_zero`, parameters that it does not list are zero.
    `remark` is a note in every fit of it; `unranked` is the reason why comparisons refuse it, if they do.
    `unported` is the reason why no port can have its kernel, if so.
    `kernel` is that of one impact, called as `convention` says with a row of `columns`, of which mass, radius and
    inertia of the ball are the last.
    """

    convention: ClassVar[Convention]
    kernel: ClassVar[Callable[..., Any]]
    columns: ClassVar[tuple[str, ...]]

    has_time: ClassVar[bool] = False
    has_force: ClassVar[bool] = False
    has_gaps: ClassVar[bool] = False
    no_history: ClassVar[str] = "has no time axis: it computes a bounce as one impulse"
    absent_is_zero: ClassVar[bool] = False
    remark: ClassVar[str] = ""
    unported: ClassVar[str] = ""
    unranked: ClassVar[str] = ""

    name: str
    ball: Ball
    options: Mapping[str, str]
    parameters: tuple[ParameterSpec, ...]
    tangential: bool = field(default=True, kw_only=True)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters `rebound` needs, in order."""
        return tuple(spec.name for spec in self.parameters)

    @cached_property
    def specs(self) -> Mapping[str, ParameterSpec]:
        """Its parameters and those of its ball, by name."""
        return {**{spec.name: spec for spec in self.parameters}, **BALL_SPECS}

    @final
    def gives(self, column: ReboundColumn) -> bool:
        """Whether it predicts a column of a rebound at all."""
        return (self.has_time or not column.timed) and (self.has_gaps or not column.gap)

    @property
    def has_regimes(self) -> bool:
        """Whether its impacts have sequences of slip and grip."""
        return self.tangential

    @property
    def without(self) -> str:
        """Why it gives no rebound, if so: a function of one's own that is not known here."""
        return ""

    @property
    def needs_cor(self) -> bool:
        """Whether each impact must bring its own measured coefficient of restitution."""
        return self.options.get("cor") == "measured"

    @abstractmethod
    def evaluate(self, names: Sequence[str], values: FloatArray, impacts: Impacts | OwnImpacts) -> Rebound:
        """Rebounds, (draws, impacts), for `values` (draws, names) without validation.

        `names` are those of `parameters`, with any of the ball's own parameters beside them. What cannot be
        evaluated is NaN and marked by its status.
        """

    @abstractmethod
    def slopes(
        self, names: Sequence[str], values: FloatArray, impacts: Impacts | OwnImpacts, parameters: Sequence[str]
    ) -> FloatArray:
        """Derivatives of what `evaluate` gives, (draws, impacts, outputs, 4 + parameters): with respect to `INPUTS`,
        to the measured restitution where there is one, and to the `parameters` among `names`. See `ReboundJacobian`.
        """

    @final
    def jacobian(
        self,
        names: Sequence[str],
        values: FloatArray,
        impacts: Impacts | OwnImpacts,
        parameters: Sequence[str] | None = None,
    ) -> ReboundJacobian:
        """Rebounds as `evaluate` gives them, with their exact derivatives; `names`, `values` (draws, names) as there.

        `parameters` are those of `names` to differentiate with respect to: all by default, `()` for none, which
        leaves the derivatives with respect to the incident state.
        """
        chosen = tuple(names) if parameters is None else tuple(parameters)
        slopes = self.slopes(names, values, impacts, chosen)
        return ReboundJacobian(
            rebound=self.evaluate(names, values, impacts),
            names=chosen,
            inputs=slopes[..., :COR],
            parameters=slopes[..., INPUT_COUNT:],
            cor=slopes[..., COR] if self.needs_cor else None,
        )

    @property
    def codes(self) -> NDArray[np.int64]:
        """The closures as the kernel reads them."""
        return np.zeros(0, dtype=np.int64)

    def rows(self, names: Sequence[str], values: NumberArray) -> NumberArray:
        """The kernel's parameter rows, (draws, columns), in the kind of number of `values`."""
        rows = np.zeros((values.shape[0], len(self.columns)), dtype=values.dtype)
        columns, places = _places(self.columns, tuple(names))
        rows[:, columns] = values[:, places]
        rows[:, -3], rows[:, -2], rows[:, -1] = ball_columns(self.ball, names, values)
        return rows

    @final
    def kernel_call(self, names: Sequence[str], values: FloatArray) -> KernelCall:
        """The call of the kernel of one impact that `evaluate` makes for `values` (names,). Raises ModelError for a
        model that is `unported`.
        """
        if self.unported:
            raise ModelError(f"model {self.name} {self.unported}")
        row = self.rows(names, np.asarray(values, dtype=np.float64)[None, :])[0]
        kernel = type(self).kernel
        return KernelCall(self.convention, kernel, self.columns, tuple(map(float, row)), tuple(map(int, self.codes)))

    def linear_constraints(self, impacts: Impacts) -> tuple[LinearConstraint, ...]:
        """Conditions on the parameters at these impacts besides their bounds: a restitution in (0, 1]."""
        return tuple(
            constraint
            for line in restitution_lines(self.parameter_names, impacts)
            for constraint in (positive(line), LinearConstraint(line, 1.0))
        )

    @property
    def oracle(self) -> Oracle | None:
        """An independent solution of the same motion, None where there is none to integrate."""
        return None

    @property
    def force_remark(self) -> str:
        """What a force record shows otherwise than `force_integrals`; empty if nothing."""
        return ""

    def force_integrals(
        self,
        names: Sequence[str],  # noqa: ARG002
        values: NumberArray,  # noqa: ARG002
        impacts: Impacts,  # noqa: ARG002
        first: NumberArray,  # noqa: ARG002
        spacing: FloatArray,  # noqa: ARG002
        count: int,  # noqa: ARG002
    ) -> tuple[NumberArray, NumberArray, NumberArray]:
        """First and second time integral of the vertical spring's force [N s, N s^2], (draws, impacts, `count`), at
        `first` (draws, impacts) [s] after landing and every `spacing` (impacts,) from there; and the mean time of
        that force after landing, (draws, impacts).

        No validation; NaN where the motion has no answer. With complex `values` (see `dual`) the imaginary parts are
        derivatives. Raises ModelError for a model without a force-time course (`has_force`).
        """
        raise ModelError(f"model {self.name} has no force-time course")

    @final
    def rebound(self, parameters: Mapping[str, ArrayLike], impacts: Impacts) -> Rebound:
        """Rebounds for named parameter values in SI units.

        Numbers give arrays of shape (impacts,); arrays of `n` draws, broadcast against each other, give
        (n, impacts). Raises ParameterError for unknown, missing, non-finite or out-of-bounds values, and, for
        a single parameter set, when an impact cannot be evaluated; in a batch such impacts are NaN and
        marked in `status`.
        """
        names, values, single = self._checked(parameters)
        check_impacts(impacts)
        if self.needs_cor and impacts.cor is None:
            raise ModelError(
                "cor = measured needs the measured coefficient of restitution of each impact: "
                + spoken("use cor = line or mean", "pass impacts(..., cor=...)")
            )
        rebound = self.evaluate(names, values, impacts)
        if not single:
            return rebound
        failed = np.flatnonzero(rebound.status[0])
        if failed.size:
            first = int(failed[0])
            reason = STATUS_REASON[Status(int(rebound.status[0, first]))]
            raise ParameterError(
                f"model {self.name}: impact {first + 1} (v_y1 = {impacts.v_y1[first]:g} m/s) cannot be "
                f"evaluated: {reason}"
            )
        return rebound.each(lambda array: array[0])

    def history(
        self,
        parameters: Mapping[str, ArrayLike],  # noqa: ARG002
        impact: Impacts,  # noqa: ARG002
        times: ArrayLike,  # noqa: ARG002
    ) -> History:
        """Exact courses of one impact at `times` [s after landing], (times,), up to the contact time.

        `parameters` are one value each, as `rebound` takes them. Raises what `rebound` raises, ModelError for a
        model that has no such courses, and ParameterError for more than one impact, a time outside the contact, or
        NaN.
        """
        raise ModelError(f"model {self.name} {self.no_history}")

    def _single(self, parameters: Mapping[str, ArrayLike], impact: Impacts) -> tuple[tuple[str, ...], FloatArray]:
        """Names and values (1, names) of one parameter set for one impact. Raises ParameterError."""
        names, values, single = self._checked(parameters)
        if not single:
            raise ParameterError("a history takes one value of each parameter, not draws")
        check_impacts(impact)
        if len(impact) != 1:
            raise ParameterError(f"a history has one impact: read {len(impact)}")
        return names, values

    def _checked(self, parameters: Mapping[str, ArrayLike]) -> tuple[tuple[str, ...], FloatArray, bool]:
        if not isinstance(parameters, Mapping):
            raise ParameterError(
                f"parameters: read {reprlib.repr(parameters)}, expected a dict, such as {{'mu': 0.5}}"
            )
        needed = self.parameter_names
        allowed = (*needed, *BALL_PARAMETERS)
        for name in parameters:
            if name not in allowed:
                raise ParameterError(f"unknown parameter '{name}' of model {self.name}: {suggestion(name, allowed)}")
        missing = [name for name in needed if name not in parameters]
        if missing:
            raise ParameterError(f"model {self.name} needs a value of {', '.join(missing)}")
        names = tuple(parameters)
        columns = [numbers(name, parameters[name]) for name in names]
        for name, column in zip(names, columns, strict=True):
            spec = self.specs[name]
            if column.ndim > 1:
                raise ParameterError(f"{name} has shape {column.shape}: expected a number or one value per draw")
            bad = ~((column >= spec.lower) & (column <= spec.upper))
            if np.any(bad):
                value = column[bad][0] if column.ndim else column
                raise ParameterError(
                    f"{name} = {float(value):g} {spec.unit}".rstrip()
                    + f": expected a value within [{spec.lower:g}, {spec.upper:g}]"
                )
        try:
            values = np.stack(np.broadcast_arrays(*columns), axis=-1)
        except ValueError:
            lengths = {name: column.shape for name, column in zip(names, columns, strict=True)}
            raise ParameterError(f"all parameters need the same number of draws: read {lengths}") from None
        return names, np.atleast_2d(values), values.ndim == 1


# Incident columns as `Impacts.states` gives them, in any kind of number; and what a bounce makes of them.
States: TypeAlias = tuple[NumberArray, NumberArray, NumberArray, NumberArray | None]
Bounced: TypeAlias = tuple[NumberArray, NDArray[np.int64], NDArray[np.int8]]


@dataclass(frozen=True)
class SteppedModel(Model):
    """A model whose bounce takes complex numbers: its derivatives are complex steps (see `kernels.dual`)."""

    @abstractmethod
    def bounce(self, names: Sequence[str], values: NumberArray, states: States) -> Bounced:
        """Those of `OUTPUTS` that there are, (outputs, draws, impacts) in the kind of number of `values`, regimes and
        statuses; incident columns as `Impacts.states` gives them.
        """

    def evaluate(self, names: Sequence[str], values: FloatArray, impacts: Impacts | OwnImpacts) -> Rebound:
        """See `Model.evaluate`."""
        out, regime, status = self.bounce(names, values, impacts.states())
        unknown = np.full((len(OUTPUTS) - len(out), *regime.shape), np.nan)
        return Rebound(*(*out, *unknown, regime, status))

    def slopes(
        self, names: Sequence[str], values: FloatArray, impacts: Impacts | OwnImpacts, parameters: Sequence[str]
    ) -> FloatArray:
        """See `Model.slopes`."""
        given = [column for column in impacts.states()[: 4 if self.needs_cor else 3] if column is not None]
        draws, count, first, moves = values.shape[0], len(impacts), len(given), len(given) + len(parameters)
        # One complex step after the other, all in one batch, as if they were draws.
        rows = np.repeat(values[None].astype(np.complex128), moves, axis=0)
        for k, name in enumerate(parameters):
            rows[first + k, :, list(names).index(name)] += 1j * STEP
        columns = []
        for k, column in enumerate(given):
            moved = np.repeat(np.broadcast_to(column, (1, draws, count)).astype(np.complex128), moves, axis=0)
            moved[k] += 1j * STEP
            columns.append(moved.reshape(-1, count))
        told = columns[COR] if first > COR else None
        out, _regime, status = self.bounce(
            names, rows.reshape(-1, values.shape[1]), (columns[0], columns[1], columns[2], told)
        )
        slopes = np.full((draws, count, len(OUTPUTS), INPUT_COUNT + len(parameters)), np.nan)
        rates = np.where(status == Status.OK, np.imag(out) / STEP, np.nan).reshape(len(out), moves, draws, count)
        rates = rates.transpose(2, 3, 0, 1)
        slopes[:, :, : len(out), :first] = rates[..., :first]
        slopes[:, :, : len(out), INPUT_COUNT:] = rates[..., first:]
        return slopes


def check_impacts(impacts: object) -> None:
    """Raise ParameterError unless these are impacts."""
    if not isinstance(impacts, Impacts):
        raise ParameterError(f"read impacts of type {type(impacts).__name__}, expected fitball.impacts(...)")


def restitution_lines(names: Sequence[str], impacts: Impacts) -> list[dict[str, float]]:
    """The restitution at the slowest and at the fastest impact as coefficients of parameters among `names`; none
    where it is no parameter.
    """
    if "cor_10" not in names:
        return []
    speeds = float(impacts.v_y1.min()), float(impacts.v_y1.max())
    rates = [{"cor_slope": speed - ANCHOR_SPEED} if "cor_slope" in names else {} for speed in speeds]
    return [{"cor_10": 1.0, **rate} for rate in rates]


def positive(line: Mapping[str, float]) -> LinearConstraint:
    """That a restitution is above zero."""
    return LinearConstraint({name: -factor for name, factor in line.items()}, 0.0, ROUNDING)


def below_mass_ratio(line: Mapping[str, float], measured: float = 0.0) -> LinearConstraint:
    """That the core returns no faster than it came: a restitution, `measured` or a `line`, below the mass ratio."""
    return LinearConstraint(
        {**line, "mass_ratio": -1.0},
        -measured,
        HAIR * (measured or 1.0),
        lower_bound_of="mass_ratio",
        words="mass_ratio >= COR",
    )


def saturating_constraints(capped_by_mass_ratio: bool) -> tuple[LinearConstraint, ...]:
    """Conditions of the law `cor = saturating` at every speed: `cor_10` in (0, 1) or below the mass ratio, and a
    rebound speed that does not fall.
    """
    value = {"cor_10": 1.0}
    cap = below_mass_ratio(value) if capped_by_mass_ratio else LinearConstraint(value, 1.0, ROUNDING)
    return positive(value), cap, positive({"cor_10": 1.0, "cor_slope": ANCHOR_SPEED})


@lru_cache(maxsize=64)
def _places(columns: tuple[str, ...], names: tuple[str, ...]) -> tuple[list[int], list[int]]:
    """Places in a kernel's rows of those that are among `names`, and their places there: asked at every step."""
    known = [place for place, name in enumerate(columns) if name in names]
    return known, [names.index(columns[place]) for place in known]


def ball_columns(
    ball: Ball, names: Sequence[str], values: NumberArray
) -> tuple[NumberArray, NumberArray, NumberArray]:
    """Mass, radius, inertia, each (draws,), where any of them may be among the sampled `names`."""

    def column(name: str, default: float) -> NumberArray:
        if name in names:
            return values[:, list(names).index(name)]
        return np.full(values.shape[0], default)

    mass = column("ball_mass", ball.mass)
    radius = column("ball_radius", ball.radius)
    if {"ball_mass", "ball_radius", "inertia_ratio"}.isdisjoint(names):
        return mass, radius, np.full(values.shape[0], ball.inertia)
    return mass, radius, column("inertia_ratio", ball.inertia_ratio) * mass * radius**2
