"""The likelihood of a table as a surface over the parameters that are not noise, the noise at its best at every
point.

The scene's contact time counts as one more measurement where that is asked for. No prior enters; bounds, and what
the model can evaluate, do. Coordinates are those of the priors, but for parameters of the model's linear constraints,
which are taken as values, as the constraints are linear in.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fitball.inference.likelihood.force import force_cost, force_slopes
from fitball.inference.likelihood.posterior import log_scene_density
from fitball.inference.likelihood.sensitivities import deviation_slopes
from fitball.inference.problem.batches import batches
from fitball.inference.problem.noise import LOG_TAU
from fitball.inference.problem.parameters import NOISE_SPECS, Parameter
from fitball.inference.problem.problem import Problem
from fitball.models.capabilities import ROUNDING
from fitball.models.types import Rebound
from fitball.values import FloatArray

Columns = Mapping[str, FloatArray]
# A log prior on [0, ...) ends at minus infinity; this many of its sds below its median a search gives up.
PRIOR_REACH = 8.0


@dataclass(frozen=True)
class Conditions:
    """What holds in each row of a batch: `noise` (rows, noise parameters) holds the coordinates of noise parameters
    that are held, NaN where the best one is taken; `scene` says whether the scene's contact time counts.
    """

    noise: FloatArray
    scene: bool

    def take(self, rows: NDArray[np.int64] | slice) -> Conditions:
        """Those of some rows."""
        return Conditions(self.noise[rows], self.scene)


@dataclass(frozen=True)
class ProfileObjective:
    """The negative log likelihood of a problem and its derivatives, batched over rows.

    Where `stretched`, bounds that only end a search lie one width of the prior further out, as far as physics goes. A
    search has settled where it promises to lower the cost by less than `promised`.
    """

    problem: Problem
    stretched: bool = False
    promised: float = 1e-3

    @cached_property
    def columns(self) -> list[int]:
        """Places, among the free parameters, of those that are not noise."""
        return [k for k, parameter in enumerate(self.problem.free) if parameter.name not in NOISE_SPECS]

    @cached_property
    def noise_columns(self) -> list[int]:
        """Places of the noise parameters."""
        return [k for k, parameter in enumerate(self.problem.free) if parameter.name in NOISE_SPECS]

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
        if self.is_value(column):
            return prior.lower, prior.upper
        low, high = prior.ends
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

    def values(self, x: FloatArray, given: Conditions) -> FloatArray:
        """Free values (rows, free), the noise as held or at its best."""
        values = self.problem.to_values(self._coordinates(x))
        sizes = self._noise(self.problem.all_values(values), self.problem.rebound(values), given)
        for k in self.noise_columns:
            values[:, k] = sizes[self.problem.free[k].name]
        return values

    def _noise(self, columns: Columns, rebound: Rebound, given: Conditions) -> dict[str, FloatArray]:
        """Every noise parameter (rows,): fixed, held, or the root mean square of what it has to explain."""
        sizes = {
            parameter.name: np.full(given.noise.shape[0], parameter.fixed)
            for parameter in self.problem.parameters
            if parameter.fixed is not None and parameter.name in NOISE_SPECS
        }
        for position, k in enumerate(self.noise_columns):
            parameter = self.problem.free[k]
            squares, count = np.zeros(given.noise.shape[0]), 0
            for observable in self.problem.observables:
                if observable.noise == parameter.name:
                    z = self.problem.deviation(columns, observable, rebound) / observable.spread(1.0, rebound)
                    squares, count = squares + np.sum(z * z, axis=1), count + observable.observed.size
            best = np.clip(np.sqrt(squares / count), parameter.prior.lower, parameter.prior.upper)
            held = given.noise[:, position]
            sizes[parameter.name] = np.where(np.isnan(held), best, parameter.prior.value(np.nan_to_num(held)))
        return sizes

    @cached_property
    def structure_precision(self) -> FloatArray:
        """Of each column the precision of what is part of the model and no knowledge of a parameter: how levels and
        biases of groups scatter about what they have in common, about zero; 0 for all others.
        """
        names = set() if self.problem.group_bias is None else self.problem.group_bias.names(self.problem.observables)
        for pooling in self.problem.pooling:
            names |= {pooling.spread_name, *map(pooling.place_name, pooling.labels)}
        return np.array([item.prior.b**-2.0 if item.name in names else 0.0 for item in self.parameters])

    def _held(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What holds columns beside the measurements: its cost (rows,), slopes and curvatures (rows, columns)."""
        precision = np.broadcast_to(self.structure_precision, x.shape)
        return 0.5 * np.sum(precision * x**2, axis=1), precision * x, precision

    def _with_held(
        self, x: FloatArray, cost: FloatArray, gradient: FloatArray, curvature: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        more, slopes, curvatures = self._held(x)
        return cost + more, gradient + slopes, curvature + curvatures[:, :, None] * np.eye(x.shape[1])

    def cost(self, x: FloatArray, given: Conditions) -> FloatArray:
        """Negative log likelihood (rows,) of the measurements, and of the scene's contact time where it counts; inf
        where the model has no answer.
        """
        costs = []
        for some in batches(self.problem, x.shape[0]):
            values = self.problem.to_values(self._coordinates(x[some]))
            columns, rebound, here = self.problem.all_values(values), self.problem.rebound(values), given.take(some)
            costs.append(self._cost(columns, rebound, here, self._noise(columns, rebound, here)))
        return np.concatenate(costs) + self._held(x)[0]

    def _cost(self, columns: Columns, rebound: Rebound, given: Conditions, sizes: Columns) -> FloatArray:
        total = np.zeros(rebound.v_x2.shape[0])
        for observable in self.problem.observables:
            spread = observable.sds(sizes, rebound)
            z = self.problem.deviation(columns, observable, rebound) / spread
            total = total + np.sum(0.5 * (z * z + LOG_TAU) + np.log(spread), axis=1)
        if self.problem.force is not None:
            total = total + force_cost(self.problem, columns)
        if given.scene:
            total = total - log_scene_density(self.problem, rebound)
        return np.where(np.any(rebound.status, axis=1), np.inf, total)

    def linearised(self, x: FloatArray, given: Conditions) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Cost (rows,), its gradient (rows, columns), and its expected curvature (rows, columns, columns).

        At the best noise the gradient is that for given noise, because the cost is level in the noise there. The
        curvature is Gauss's and Newton's: products of first derivatives of the residuals.
        """
        split = batches(self.problem, x.shape[0], cost=2 * self.problem.dimension + 1)
        parts = [self._linearised(x[some], given.take(some)) for some in split]
        cost, gradient, curvature = (np.concatenate(column) for column in zip(*parts, strict=True))
        return self._with_held(x, cost, gradient, curvature)

    def _linearised(self, x: FloatArray, given: Conditions) -> tuple[FloatArray, FloatArray, FloatArray]:
        coordinates = self._coordinates(x)
        rebound, slopes = self.problem.differentiated(coordinates)
        columns = self.problem.all_values(self.problem.to_values(coordinates))
        sizes = self._noise(columns, rebound, given)
        # From coordinates of the priors to those of the objective.
        chain = np.where(self._as_value, 1.0 / np.where(self._as_value, x, 1.0), 1.0)
        rows, count = x.shape
        gradient = np.zeros((rows, count))
        curvature = np.zeros((rows, count, count))

        def gather(z: FloatArray, slope: FloatArray) -> None:
            nonlocal gradient, curvature
            gradient = gradient + np.einsum("bm,bmk->bk", z, slope)
            curvature = curvature + np.einsum("bmk,bml->bkl", slope, slope)

        for observable in self.problem.observables:
            z, slope, growth = deviation_slopes(self.problem, observable, columns, sizes, rebound, slopes)
            gather(z, slope[..., self.columns] * chain[:, None, :])
            if growth is not None:
                gradient = gradient - growth[..., self.columns].sum(axis=1) * chain
        if self.problem.force is not None:
            z, slope, _shares = force_slopes(self.problem, self.problem.force, coordinates)
            slope = slope[..., self.columns].reshape(rows, -1, count) * chain[:, None, :]
            gather(z.reshape(rows, -1), slope)
        if given.scene and self.problem.contact_time is not None:
            value, sd = self.problem.contact_time
            slope = slopes["contact_time"][..., self.columns].mean(axis=1, keepdims=True) * chain[:, None, :]
            gather((rebound.contact_time.mean(axis=1, keepdims=True) - value) / sd, slope / sd)
        return self._cost(columns, rebound, given, sizes), gradient, curvature
