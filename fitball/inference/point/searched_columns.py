"""The columns in which a surface is searched: coordinates, sizes, bounds and walls.

Coordinates are those of the priors, but for parameters of the model's linear constraints, which are taken as values,
as the constraints are linear in.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fitball.inference.problem.parameters import NOISE_SPECS, Parameter
from fitball.inference.problem.problem import Problem
from fitball.models.model import ROUNDING
from fitball.values import FloatArray

# A log prior on [0, ...) ends at minus infinity; this many of its sds below its median a search gives up.
PRIOR_REACH = 8.0


@dataclass(frozen=True)
class SearchedColumns:
    """The free parameters of a problem that are not noise; where `penalised`, all of them, within their priors.

    Where `stretched`, bounds that only end a search lie one width of the prior further out, as far as physics goes.
    """

    problem: Problem
    stretched: bool = False
    penalised: bool = False

    @cached_property
    def columns(self) -> list[int]:
        """Places of the columns among the free parameters."""
        return [k for k in range(self.problem.dimension) if k not in self.noise_columns]

    @cached_property
    def noise_columns(self) -> list[int]:
        """Places of the noise parameters that are no columns."""
        noise = [k for k, parameter in enumerate(self.problem.free) if parameter.name in NOISE_SPECS]
        return [] if self.penalised else noise

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters of the objective, one per column."""
        return tuple(self.problem.free[k] for k in self.columns)

    @cached_property
    def _constrained(self) -> frozenset[str]:
        """Parameters of which the model demands something linear, at some level at least."""
        constraints = self.problem.model.linear_constraints(self.problem.impacts)
        return frozenset(name for constraint in constraints for name in constraint.coefficients)

    @cached_property
    def _as_value(self) -> NDArray[np.bool_]:
        """Columns taken as values although their prior is one of the logarithm."""
        return np.array(
            [parameter.prior.log and parameter.name in self._constrained for parameter in self.parameters], dtype=bool
        )

    @cached_property
    def width(self) -> FloatArray:
        """A typical size of each column."""
        return np.array([self._width(k) for k in self.columns])

    def _width(self, column: int) -> float:
        prior = self.problem.free[column].prior
        return prior.width * (float(np.exp(prior.a)) if prior.log and self.is_value(column) else 1.0)

    def is_value(self, column: int) -> bool:
        """Whether a free parameter's coordinate is here its value although its prior has another."""
        return self.problem.free[column].name in self._constrained

    def ends(self, column: int) -> tuple[float, float]:
        """Bounds of a free parameter in the coordinate it has here."""
        low, high = self._searched(column)
        if not self.stretched:
            return low, high
        (first, last), width = self._possible(column), self._width(column)
        return max(low - width, min(low, first)), min(high + width, max(high, last))

    def _searched(self, column: int) -> tuple[float, float]:
        parameter = self.problem.free[column]
        own = parameter.prior
        # A bound at which the model has no answer is kept off as such a constraint is.
        prior = replace(own, upper=own.upper - ROUNDING) if parameter.spec.open_above else own
        low, high = prior.support if self.penalised else prior.ends
        if self.is_value(column):
            return float(prior.value(np.array(low))), float(prior.value(np.array(high)))
        return max(low, own.a - PRIOR_REACH * own.b) if own.log else low, high

    def _possible(self, column: int) -> tuple[float, float]:
        """What physics leaves of a free parameter, in the coordinate it has here."""
        parameter = self.problem.free[column]
        low, high = parameter.spec.beyond
        if parameter.prior.log and not self.is_value(column):
            return (math.log(low) if low > 0.0 else -math.inf), math.log(high)
        return low, high

    @cached_property
    def searched_for(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which ends of all columns only end a search, (columns,) each: physics goes on there."""
        ends = [(self._searched(k), self._possible(k)) for k in self.columns]
        low = np.array([first > possible for (first, _), (possible, _) in ends], dtype=bool)
        high = np.array([last < possible - ROUNDING for (_, last), (_, possible) in ends], dtype=bool)
        return low, high

    @cached_property
    def limits(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of all columns, (columns,) each."""
        low, high = np.array([self.ends(k) for k in self.columns]).reshape(-1, 2).T
        return low, high

    @cached_property
    def walls(self) -> tuple[FloatArray, FloatArray]:
        """The model's linear constraints as conditions `a x <= b`, (walls, columns) and (walls,)."""
        fixed = {
            parameter.name: parameter.fixed for parameter in self.problem.parameters if parameter.fixed is not None
        }
        places = {parameter.name: k for k, parameter in enumerate(self.parameters)}
        rows: list[FloatArray] = []
        bounds: list[float] = []
        for constraint in self.problem.linear_constraints:
            row, bound = np.zeros(len(places)), constraint.bound - constraint.margin
            for name, factor in constraint.coefficients.items():
                if name in places:
                    row[places[name]] = factor
                elif name in fixed:
                    bound -= factor * fixed[name]
            if np.any(row):
                rows.append(row)
                bounds.append(bound)
        return np.array(rows).reshape(-1, len(places)), np.array(bounds)

    def from_values(self, values: FloatArray) -> FloatArray:
        """Columns (rows, columns) of free values (rows, free)."""
        x = self.problem.to_coordinates(values)[:, self.columns]
        x[:, self._as_value] = values[:, self.columns][:, self._as_value]
        return x

    def _coordinates(self, x: FloatArray) -> FloatArray:
        """Coordinates (rows, free) of the priors; noise, which the rebound does not see, at its prior's centre."""
        full = np.empty((x.shape[0], self.problem.dimension))
        full[:, self.columns] = np.where(self._as_value, np.log(np.where(self._as_value, x, 1.0)), x)
        full[:, self.noise_columns] = self._typical_noise
        return full

    @cached_property
    def _typical_noise(self) -> FloatArray:
        priors = [self.problem.free[k].prior for k in self.noise_columns]
        return np.array([float(prior.coordinate(prior.quantile(np.array([0.5])))[0]) for prior in priors])

    def _chain(self, x: FloatArray) -> FloatArray:
        """Derivatives (rows, columns) of the coordinates of the priors."""
        return np.where(self._as_value, 1.0 / np.where(self._as_value, x, 1.0), 1.0)
