"""The likelihood of a table as a surface over the parameters that are not noise, the noise at its best at every
point; or over all of them, where the best noise has no closed form; or its posterior, over all of them; or half the
sum of its squared deviations.

Columns are coordinates of the priors, but for parameters of the model's linear constraints, which are taken as
values, as the constraints are linear in. The scene's contact time counts as one more measurement where that is asked
for. No prior enters a likelihood; bounds, and what the model can evaluate, do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitball.inference.likelihood.cells import Cells, cells_of
from fitball.inference.likelihood.force import (
    force_cost,
    force_information_rows,
    force_log_likelihood,
    force_slopes,
)
from fitball.inference.likelihood.posterior import impact_terms, log_scene_density
from fitball.inference.problem.noise import NORMAL, NoiseKind, NormalNoise
from fitball.inference.problem.parameters import NOISE_SPECS, Parameter, Pull
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import PART, batches, part_of
from fitball.models.model import ROUNDING
from fitball.models.types import Rebound
from fitball.values import FloatArray

Columns = Mapping[str, FloatArray]
# A log prior on [0, ...) ends at minus infinity; this many of its sds below its median a search gives up.
PRIOR_REACH = 8.0
# Step of differences in widths of the priors: it moves a minimum by half of itself, far less than any error.
STEP = 1e-6
# Mixtures make the density jump by some 1e-4 where a part of one, or an impact, changes sides of a boundary. No slope
# is known better than over this many standard deviations, and no promise than to this.
SPAN = 0.1
JUMPS = 1e-3


def surface_of(problem: Problem, promised: float = 1e-3, *, penalised: bool = False) -> Surface:
    """The surface of a problem's likelihood, or posterior; see `Surface` for `promised` and `penalised`."""
    # With records the noise of a likelihood is held, see `noise_held`; that of a posterior is not.
    recorded = penalised and problem.force is not None
    # Nor has the best scatter beyond stated errors a closed form.
    scatters = any(item.scatters and item.noise in problem.free_names for item in problem.observables)
    closed = isinstance(problem.noise, NormalNoise) and problem.errors is None and not (recorded or scatters)
    least = JUMPS if problem.uncertain and not closed else 0.0
    return Surface(problem, promised=max(promised, least), penalised=penalised, closed=closed)


@dataclass(frozen=True)
class Conditions:
    """What holds in each row of a batch: `noise` (rows, noise parameters) holds the coordinates of noise parameters
    that are held, NaN where the best one is taken; `scene`: whether the scene's contact time counts, `counted`
    (rows, impacts) which impacts do, all of them where it is None.
    """

    noise: FloatArray
    scene: bool
    counted: NDArray[np.bool_] | None = None

    def take(self, rows: NDArray[np.int64] | slice) -> Conditions:
        """Those of some rows."""
        return Conditions(self.noise[rows], self.scene, None if self.counted is None else self.counted[rows])

    def for_impacts(self, impacts: NDArray[np.int64]) -> Conditions:
        """Those of a problem that consists of some `impacts` alone."""
        return self if self.counted is None else replace(self, counted=self.counted[:, impacts])

    def counting(self, array: FloatArray, impact: NDArray[np.int64]) -> FloatArray:
        """An array (rows, cells, ...) that is zero where the `impact` (cells,) does not count."""
        if self.counted is None:
            return array
        counted = self.counted[:, impact]
        return np.where(counted.reshape(*counted.shape, *(1,) * (array.ndim - 2)), array, 0.0)


class Linear(NamedTuple):
    """The first order of what was measured: `gradient` (rows, columns) of its cost, its expected `curvature` (rows,
    columns, columns), the mean contact `time` (rows,) and the derivatives of that, `pace` (rows, columns).
    """

    gradient: FloatArray
    curvature: FloatArray
    time: FloatArray
    pace: FloatArray


@dataclass(frozen=True)
class Surface:
    """The negative log likelihood of a problem and its derivatives, batched over rows, in the free parameters that
    are not noise, if that is normal and its best size known (`closed`); in all of them where it is not, or where the
    surface is `penalised`: minus the log posterior but for a constant, within the priors. Of `squares` it is half the
    chi-square but for a constant: no prior, the noise in the middle of its own.

    A search has settled where it promises to lower it by less than `promised`. Where `stretched`, bounds that only
    end a search lie one width of the prior further out, as far as physics goes.
    """

    problem: Problem
    promised: float = 1e-3
    penalised: bool = False
    stretched: bool = False
    closed: bool = True
    squares: bool = False

    @cached_property
    def columns(self) -> list[int]:
        """Places of the columns among the free parameters."""
        return [k for k in range(self.problem.dimension) if k not in self.noise_columns]

    @cached_property
    def noise_columns(self) -> list[int]:
        """Places of the noise parameters that are no columns, but at their best at every point."""
        noise = [k for k, parameter in enumerate(self.problem.free) if parameter.name in NOISE_SPECS]
        return noise if self.closed and not self.penalised else []

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
        middle = own.a if own.bell else 0.5 * (own.a + own.b)
        return max(low, middle - PRIOR_REACH * own.width) if own.log else low, high

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
    def _levels(self) -> list[tuple[int, NDArray[np.int64]]]:
        """Of each parameter that differs between levels the columns of spread and places, where all are free and the
        common value is in the coordinate of its prior.
        """
        places = {parameter.name: k for k, parameter in enumerate(self.parameters)}
        return [
            (places[item.spread_name], np.array([places[name] for name in item.hidden[1:]]))
            for item in self.problem.pooling
            if {item.parameter, *item.hidden} <= places.keys() and not self._as_value[places[item.parameter]]
        ]

    def moved(self, x: FloatArray, step: FloatArray) -> FloatArray:
        """Where a step (rows, columns) leads, within bounds. What is linear along it is a level, `q + tau z`, which
        the data determine, and not the place `z`: else steps would follow a curved ridge.
        """
        there = x + step
        low, high = self.limits
        for spread, places in self._levels:
            log = self.parameters[spread].prior.log
            before, after = (np.exp(at[:, spread]) if log else at[:, spread] for at in (x, there))
            rate = before * step[:, spread] if log else step[:, spread]
            # From the common value, which moves too.
            level = before[:, None] * there[:, places] + x[:, places] * rate[:, None]
            sure = after > 0.0
            there[np.ix_(sure, places)] = level[sure] / after[sure, None]
            there[:, places] = np.clip(there[:, places], low[places], high[places])
        return there

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

    def free(self, x: FloatArray) -> Conditions:
        """Conditions of rows `x` (rows, columns) that hold nothing, with the scene's contact time if there is one."""
        noise = np.full((x.shape[0], len(self.noise_columns)), np.nan)
        return Conditions(noise, self.problem.contact_time is not None)

    def values(self, x: FloatArray, given: Conditions) -> FloatArray:
        """Free values (rows, free), the noise as held or at its best."""
        values = self.problem.to_values(self._coordinates(x))
        for some in batches(self.problem, x.shape[0]) if self.noise_columns else ():
            here = values[some]
            sizes = self._noise(self.problem.all_values(here), self.problem.rebound(here), given.take(some))
            for k in self.noise_columns:
                here[:, k] = sizes[self.problem.free[k].name]
        return values

    def _noise(self, columns: Columns, rebound: Rebound, given: Conditions) -> dict[str, FloatArray]:
        """Every noise parameter (rows,): fixed, held, or the root mean square of what it has to explain; of a scatter
        beyond stated errors, by the moments of that.
        """
        sizes = {name: column for name, column in columns.items() if name in NOISE_SPECS}
        for position, k in enumerate([] if self.squares else self.noise_columns):
            parameter = self.problem.free[k]
            squares, count = np.zeros(given.noise.shape[0]), 0
            for observable in self.problem.observables:
                if observable.noise == parameter.name:
                    unit = observable.scatter(1.0, rebound)
                    z = self.problem.deviation(columns, observable, rebound) / unit
                    squares, count = squares + np.sum(z * z, axis=1), count + observable.observed.size
                    if observable.sd is not None:
                        stated = np.broadcast_to(observable.sd / unit, z.shape)
                        squares = squares - np.sum(stated * stated, axis=1)
            # A noise that nothing shows any more stays where it is.
            best = columns[parameter.name]
            if count:
                size = np.sqrt(np.maximum(squares, 0.0) / count)
                best = np.clip(size, parameter.prior.lower, parameter.prior.upper)
            held = given.noise[:, position]
            known = ~np.isnan(held)
            if known.any():
                best = np.where(known, parameter.prior.value(np.where(known, held, 0.0)), best)
            sizes[parameter.name] = best
        return sizes

    @cached_property
    def knowledge_apart(self) -> Pull:
        """What is part of the model or was measured apart (`Problem.known_apart`), in coordinates of the priors."""
        return self._pull([item.name in self.problem.known_apart for item in self.parameters])

    def _pull(self, counted: Sequence[bool]) -> Pull:
        return Pull.from_priors([item.prior for item in self.parameters], counted)

    def _held(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What holds columns beside the measurements: its cost (rows,), slopes and curvatures (rows, columns)."""
        known, chain = self._knowledge, self._chain(x)
        at = np.where(self._as_value, np.log(np.where(self._as_value, x, 1.0)), x)
        weight = known.weight(at)
        return known.cost(at).sum(axis=1), weight * (at - known.centre) * chain, weight * chain**2

    @cached_property
    def _knowledge(self) -> Pull:
        """What is known of each column, in coordinates of the priors; a uniform prior only bounds."""
        if self.penalised or self.squares:
            return self._pull([not self.squares] * len(self.columns))
        return self.knowledge_apart

    def cost(self, x: FloatArray, given: Conditions) -> FloatArray:
        """The surface (rows,), with the scene's contact time where it counts; inf where the model has no answer."""
        return self._measured_cost(x, given) + self._held(x)[0]

    def _measured_cost(self, x: FloatArray, given: Conditions) -> FloatArray:
        costs = []
        for some in batches(self.problem, x.shape[0]):
            values = self.problem.to_values(self._coordinates(x[some]))
            rebound, here = self.problem.rebound(values), given.take(some)
            total = -self._log_likelihood(values, rebound, here)
            if here.scene:
                total = total - log_scene_density(self.problem, rebound)
            costs.append(np.where(rebound.status.any(axis=1) | np.isnan(total), np.inf, total))
        return np.concatenate(costs)

    def _log_likelihood(self, values: FloatArray, rebound: Rebound, given: Conditions) -> FloatArray:
        """That (rows,) of the impacts that count, each start of contact at its best where the surface is `closed`."""
        problem = self.problem
        if problem.errors is not None and not self.closed:
            # Mixtures at changes of regime too.
            terms = np.sum(list(impact_terms(problem, values, rebound).values()), axis=0)
            total = given.counting(terms, np.arange(len(problem.impacts))).sum(axis=1)
            columns = problem.all_values(values)
        else:
            made = self._cells(values, rebound, given)
            terms = self._kind.log_density(made.z, made.columns) - (0.0 if self.squares else made.log_sd)
            total, columns = given.counting(terms, made.impact).sum(axis=1), made.columns
        if problem.force is not None:
            total += (
                -force_cost(problem, columns)
                if self.closed
                else force_log_likelihood(problem, problem.force, columns)
            )
        return np.asarray(total)

    def _cells(self, values: FloatArray, rebound: Rebound, given: Conditions, moved: Columns | None = None) -> Cells:
        """See `cells_of`, the noise as held or at its best."""
        columns = self.problem.all_values(values)
        return cells_of(self.problem, {**columns, **self._noise(columns, rebound, given)}, rebound, moved=moved)

    @property
    def _kind(self) -> NoiseKind:
        """The noise by which deviations are judged."""
        return NORMAL if self.closed else self.problem.noise

    def linearised(self, x: FloatArray, given: Conditions) -> tuple[FloatArray, FloatArray]:
        """The gradient (rows, columns) of the cost, and its expected curvature (rows, columns, columns).

        At the best noise the gradient is that for given noise, because the cost is level in the noise there. The
        curvature is the information of location and scale: `I m m' + J s s'` with `m` the slope of a prediction in
        units of its spread, `s` that of the spread's logarithm, and `I` and `J` the information of one deviation on
        either.
        """
        told = self._measured(x, given)
        gradient, curvature = told.gradient, told.curvature
        if given.scene and self.problem.contact_time is not None:
            value, sd = self.problem.contact_time
            slope = told.pace / sd
            gradient = gradient + ((told.time - value) / sd)[:, None] * slope
            curvature = curvature + slope[:, :, None] * slope[:, None, :]
        _, slopes, curvatures = self._held(x)
        return gradient + slopes, curvature + curvatures[:, :, None] * np.eye(x.shape[1])

    def _measured(self, x: FloatArray, given: Conditions) -> Linear:
        """Of a long table some impacts at a time, where no noise is the best for all of them."""
        count = len(self.problem.impacts)
        if count <= PART or (self.noise_columns and not self.squares):
            split = batches(self.problem, x.shape[0], cost=2 * self.problem.dimension + 1)
            parts = [self._linearised(x[some], given.take(some)) for some in split]
            return Linear(*(np.concatenate(column) for column in zip(*parts, strict=True)))
        whole = Linear(*(np.zeros((1,) * axes) for axes in (2, 3, 1, 2)))
        for rows in np.array_split(np.arange(count), -(-count // PART)):
            told = replace(self, problem=part_of(self.problem, rows))._measured(x, given.for_impacts(rows))
            share = rows.size / count
            told = told._replace(time=share * told.time, pace=share * told.pace)
            whole = Linear(*(one + other for one, other in zip(whole, told, strict=True)))
        return whole

    def _linearised(self, x: FloatArray, given: Conditions) -> Linear:
        problem, kind, at, chain = self.problem, self._kind, self._coordinates(x), self._chain(x)
        (rows, count), values = x.shape, self.problem.to_values(at)
        rebound, moved = problem.differentiated(at)
        made = self._cells(values, rebound, given, moved)
        slope, growth = (
            given.counting(part[..., self.columns], made.impact) * chain[:, None]
            for part in (made.slope, made.growth)
        )
        centre, scale = (
            np.broadcast_to(told, (rows,))[:, None, None]
            for told in (kind.information(made.columns), kind.scale_information(made.columns))
        )
        score = kind.residual(made.z, made.columns) * kind.residual_rate(made.z, made.columns)
        level = 0.0 if self.squares else 1.0
        gradient = np.einsum("bm,bmk->bk", level - score * made.z, growth) - np.einsum("bm,bmk->bk", score, slope)
        if self.squares:
            curvature = _squares(slope + made.z[..., None] * growth)
        else:
            curvature = centre * _squares(slope) + scale * _squares(growth)
        for parameter in kind.parameters:
            if parameter.name in problem.free_names:
                # The squares of the slopes of each log density (Berndt et al. 1974).
                k = problem.free_names.index(parameter.name)
                step = STEP * self.width[k]
                there = problem.all_values(problem.to_values(at + step * chain[:, k, None] * np.eye(count)[k]))
                change = kind.log_density(made.z, there) - kind.log_density(made.z, made.columns)
                change = given.counting(change, made.impact) / step
                gradient[:, k] -= change.sum(axis=1)
                curvature[:, k, k] += np.sum(change**2, axis=1)
        if problem.force is not None and self.closed:
            z, by_record, _shares = force_slopes(problem, problem.force, at)
            by_record = by_record[..., self.columns].reshape(rows, -1, count) * chain[:, None]
            gradient += np.einsum("bm,bmk->bk", z.reshape(rows, -1), by_record)
            curvature += _squares(by_record)
        elif problem.force is not None:
            parts = (
                part.reshape(rows, -1, count) * chain[:, None]
                for part in force_information_rows(problem, problem.force, at)
            )
            curvature += sum(weight * _squares(part) for weight, part in zip((1.0, 2.0), parts, strict=True))
        if made.turn.size and not self.squares:
            turn = made.turn if given.counted is None else np.where(given.counted[..., None, None], made.turn, 0.0)
            curvature += scale * _squares(
                turn.reshape(rows, -1, problem.dimension)[..., self.columns] * chain[:, None]
            )
        searched = problem.force is not None and not self.closed
        if searched or (problem.errors is not None and (self.squares or not self.closed)):
            gradient = self._by_differences(x, replace(given, scene=False), curvature)
        pace = made.pace[:, self.columns] * chain
        return Linear(gradient, curvature, rebound.contact_time.mean(axis=1), pace)

    def _by_differences(self, x: FloatArray, given: Conditions, curvature: FloatArray) -> FloatArray:
        """The gradient of what has no exact one: whitening that moves, starts of contact that are searched for. With
        mixtures it is that between points on either side, `SPAN` apart by the `curvature` (rows, columns, columns).
        """
        rows, count = x.shape
        wide = self.problem.uncertain and not self.squares
        step = np.broadcast_to(STEP * self.width, x.shape)
        if wide:
            step = SPAN / np.sqrt(np.einsum("bkk->bk", curvature) + self.width**-2.0)
        ahead, behind = self._outside(x, step), self._outside(x, -step)
        # Away from bounds and walls that are near: to one side only.
        first = np.where(ahead, -step, step)
        second = np.where(wide & ~ahead & ~behind, -step, 0.0)
        moves = first[:, None] if not wide else np.stack([first, second], axis=1)
        around = x[:, None, None] + moves[..., None] * np.eye(count)
        there = given.take(np.repeat(np.arange(rows), 1 + moves[0].size))
        points = np.concatenate([x[:, None], around.reshape(rows, -1, count)], axis=1)
        cost = self._measured_cost(points.reshape(-1, count), there).reshape(rows, -1)
        with np.errstate(invalid="ignore"):
            if not wide:
                return np.asarray((cost[:, 1:] - cost[:, :1]) / first)
            return np.asarray((cost[:, 1 : count + 1] - cost[:, count + 1 :]) / (first - second))

    def _outside(self, x: FloatArray, step: FloatArray) -> NDArray[np.bool_]:
        """Whether a step (rows, columns) along a column leads beyond bounds or walls."""
        (low, high), (a, b) = self.limits, self.walls
        outside: NDArray[np.bool_] = (x + step > high) | (x + step < low)
        if b.size:
            outside |= np.any((x @ a.T)[:, :, None] + a * step[:, None] > b[:, None], axis=1)
        return outside


def _squares(rows: FloatArray) -> FloatArray:
    """Sums (draws, columns, columns) of products of rows (draws, rows, columns)."""
    return rows.transpose(0, 2, 1) @ rows
