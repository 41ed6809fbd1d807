"""What every bounce model has in common: a name, a ball, parameters, and `rebound`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from fitball.errors import ModelError, ParameterError, suggestion
from fitball.models.history import MODELS_WITH_HISTORY, History
from fitball.models.jacobian import ReboundJacobian
from fitball.models.kernels.dual import NumberArray
from fitball.models.specs import BALL_PARAMETERS, SPECS, ParameterSpec
from fitball.models.types import STATUS_REASON, Rebound, Status
from fitball.values import Ball, FloatArray, Impacts, OwnImpacts


@dataclass(frozen=True)
class Model(ABC):
    """A bounce model with its ball; subclasses say which parameters it has and evaluate it.

    `options` are the named choices it was composed of, as text.
    """

    name: str
    ball: Ball
    options: Mapping[str, str]
    parameters: tuple[ParameterSpec, ...]

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters `rebound` needs, in order."""
        return tuple(spec.name for spec in self.parameters)

    @property
    @abstractmethod
    def has_time(self) -> bool:
        """Whether the model has a time axis, and so a contact time."""

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

    @final
    def rebound(self, parameters: Mapping[str, ArrayLike], impacts: Impacts) -> Rebound:
        """Rebounds for named parameter values in SI units.

        Numbers give arrays of shape (impacts,); arrays of `n` draws, broadcast against each other, give
        (n, impacts). Raises ParameterError for unknown, missing, non-finite or out-of-bounds values, and, for
        a single parameter set, when an impact cannot be evaluated; in a batch such impacts are NaN and
        marked in `status`.
        """
        names, values, single = self._checked(parameters)
        if self.needs_cor and impacts.cor is None:
            raise ModelError("closure cor = 'measured' needs each impact's own `cor`: pass impacts(..., cor=...)")
        found = self.evaluate(names, values, impacts)
        if not single:
            return found
        failed = np.flatnonzero(found.status[0])
        if failed.size:
            first = int(failed[0])
            reason = STATUS_REASON[Status(int(found.status[0, first]))]
            raise ParameterError(
                f"model {self.name}: impact {first + 1} (v_y1 = {impacts.v_y1[first]:g} m/s) cannot be "
                f"evaluated: {reason}"
            )
        return Rebound(
            found.v_x2[0],
            found.v_y2[0],
            found.omega_2[0],
            found.contact_time[0],
            found.regime[0],
            found.status[0],
        )

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
        raise ModelError(
            f"model {self.name} has no time axis: its bounce is one impulse; models with a history: "
            + ", ".join(MODELS_WITH_HISTORY)
        )

    def _single(self, parameters: Mapping[str, ArrayLike], impact: Impacts) -> tuple[tuple[str, ...], FloatArray]:
        """Names and values (1, names) of one parameter set for one impact. Raises ParameterError."""
        names, values, single = self._checked(parameters)
        if not single:
            raise ParameterError("a history takes one value of each parameter, not draws")
        if len(impact) != 1:
            raise ParameterError(f"a history is that of one impact: read {len(impact)}")
        return names, values

    def _checked(self, parameters: Mapping[str, ArrayLike]) -> tuple[tuple[str, ...], FloatArray, bool]:
        needed = self.parameter_names
        allowed = (*needed, *BALL_PARAMETERS)
        for name in parameters:
            if name not in allowed:
                raise ParameterError(f"model {self.name} has no parameter '{name}': {suggestion(name, allowed)}")
        missing = [name for name in needed if name not in parameters]
        if missing:
            raise ParameterError(f"model {self.name} needs a value of {', '.join(missing)}")
        names = tuple(parameters)
        columns = [np.asarray(parameters[name], dtype=np.float64) for name in names]
        for name, column in zip(names, columns, strict=True):
            spec = SPECS[name]
            if column.ndim > 1:
                raise ParameterError(f"{name} has shape {column.shape}: expected a number or one value a draw")
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
            raise ParameterError(f"parameters differ in number of draws: {lengths}") from None
        return names, np.atleast_2d(values), values.ndim == 1


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
