"""The likelihood of a table as a surface over the parameters that are not noise, the noise at its best at every
point; or its posterior, as one over all of them.

The scene's contact time counts as one more measurement where that is asked for. No prior enters a likelihood; bounds,
and what the model can evaluate, do.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitball.inference.likelihood.force import force_cost, force_slopes
from fitball.inference.likelihood.posterior import log_scene_density
from fitball.inference.likelihood.residuals import deviation_slopes
from fitball.inference.point.searched_columns import SearchedColumns
from fitball.inference.problem.noise import LOG_TAU
from fitball.inference.problem.observables import Observable
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.subsample import PART, batches, part_of
from fitball.models.types import Rebound
from fitball.values import FloatArray

Columns = Mapping[str, FloatArray]


@dataclass(frozen=True)
class Conditions:
    """What holds in each row of a batch: `noise` (rows, noise parameters) holds the coordinates of noise parameters
    that are held, NaN where the best one is taken; `scene` says whether the scene's contact time counts, `counted`
    (rows, impacts) which impacts do, all of them where it is None.
    """

    noise: FloatArray
    scene: bool
    counted: NDArray[np.bool_] | None = None

    def take(self, rows: NDArray[np.int64] | slice) -> Conditions:
        """Those of some rows."""
        return Conditions(self.noise[rows], self.scene, None if self.counted is None else self.counted[rows])

    def of(self, impacts: NDArray[np.int64]) -> Conditions:
        """Those of a problem that consists of some `impacts` alone."""
        return self if self.counted is None else replace(self, counted=self.counted[:, impacts])

    def measurements(self, observable: Observable) -> NDArray[np.bool_]:
        """Which measurements of an observable count, broadcastable to (rows, measurements)."""
        if self.counted is None:
            return np.ones((1, observable.observed.size), dtype=bool)
        return self.counted[:, observable.places(self.counted.shape[1])]


class Linear(NamedTuple):
    """The first order of what was measured: `gradient` (rows, columns) of its cost, its expected `curvature` (rows,
    columns, columns), the mean contact `time` (rows,) and the derivatives of that, `pace` (rows, columns).
    """

    gradient: FloatArray
    curvature: FloatArray
    time: FloatArray
    pace: FloatArray


@dataclass(frozen=True)
class Surface(SearchedColumns):
    """The negative log likelihood of a problem and its derivatives, batched over rows; where `penalised`, minus the
    log posterior but for a constant. A search has settled where it promises to lower it by less than `promised`.
    """

    promised: float = 1e-3

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
        """Every noise parameter (rows,): fixed, held, or the root mean square of what it has to explain."""
        sizes = {name: column for name, column in columns.items() if name in NOISE_SPECS}
        for position, k in enumerate(self.noise_columns):
            parameter = self.problem.free[k]
            squares, count = np.zeros(given.noise.shape[0]), 0
            for observable in self.problem.observables:
                if observable.noise == parameter.name:
                    z = self.problem.deviation(columns, observable, rebound) / observable.spread(1.0, rebound)
                    squares, count = squares + np.sum(z * z, axis=1), count + observable.observed.size
            # A noise that nothing shows any more stays where it is.
            best = columns[parameter.name]
            if count:
                best = np.clip(np.sqrt(squares / count), parameter.prior.lower, parameter.prior.upper)
            held = given.noise[:, position]
            known = ~np.isnan(held)
            if known.any():
                best = np.where(known, parameter.prior.value(np.where(known, held, 0.0)), best)
            sizes[parameter.name] = best
        return sizes

    @cached_property
    def knowledge_apart(self) -> tuple[FloatArray, FloatArray]:
        """Precision and centre (columns,), in coordinates of the priors, of what is part of the model or was measured
        apart (`Problem.known_apart`); zero precision for all others.
        """
        priors = [item.prior for item in self.parameters]
        apart = [item.name in self.problem.known_apart and item.prior.normal for item in self.parameters]
        precision = [prior.b**-2.0 if known else 0.0 for prior, known in zip(priors, apart, strict=True)]
        return np.array(precision), np.array([prior.a for prior in priors])

    def _held(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What holds columns beside the measurements: its cost (rows,), slopes and curvatures (rows, columns)."""
        precision, centre = self._knowledge
        chain = self._chain(x)
        away = np.where(self._as_value, np.log(np.where(self._as_value, x, 1.0)), x) - centre
        return 0.5 * np.sum(precision * away**2, axis=1), precision * away * chain, precision * chain**2

    @cached_property
    def _knowledge(self) -> tuple[FloatArray, FloatArray]:
        """Precision and centre (columns,) of what is known of each column, in coordinates of the priors; a uniform
        prior only bounds.
        """
        if not self.penalised:
            return self.knowledge_apart
        priors = [item.prior for item in self.parameters]
        return np.array([item.b**-2.0 if item.normal else 0.0 for item in priors]), np.array([p.a for p in priors])

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
            terms = 0.5 * (z * z + LOG_TAU) + np.log(spread)
            total = total + np.sum(np.where(given.measurements(observable), terms, 0.0), axis=1)
        if self.problem.force is not None:
            total = total + force_cost(self.problem, columns)
        if given.scene:
            total = total - log_scene_density(self.problem, rebound)
        return np.where(np.any(rebound.status, axis=1), np.inf, total)

    def linearised(self, x: FloatArray, given: Conditions) -> tuple[FloatArray, FloatArray]:
        """The gradient (rows, columns) of the cost, and its expected curvature (rows, columns, columns).

        At the best noise the gradient is that for given noise, because the cost is level in the noise there. The
        curvature is Gauss's and Newton's: products of first derivatives of the residuals.
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
        if count <= PART or self.noise_columns:
            split = batches(self.problem, x.shape[0], cost=2 * self.problem.dimension + 1)
            parts = [self._linearised(x[some], given.take(some)) for some in split]
            return Linear(*(np.concatenate(column) for column in zip(*parts, strict=True)))
        whole = Linear(*(np.zeros((1,) * axes) for axes in (2, 3, 1, 2)))
        for rows in np.array_split(np.arange(count), -(-count // PART)):
            told = replace(self, problem=part_of(self.problem, rows))._measured(x, given.of(rows))
            share = rows.size / count
            told = told._replace(time=share * told.time, pace=share * told.pace)
            whole = Linear(*(one + other for one, other in zip(whole, told, strict=True)))
        return whole

    def _linearised(self, x: FloatArray, given: Conditions) -> Linear:
        coordinates = self._coordinates(x)
        rebound, slopes = self.problem.differentiated(coordinates)
        columns = self.problem.all_values(self.problem.to_values(coordinates))
        sizes = self._noise(columns, rebound, given)
        chain = self._chain(x)
        rows, count = x.shape
        gradient = np.zeros((rows, count))
        curvature = np.zeros((rows, count, count))

        def gather(z: FloatArray, slope: FloatArray) -> None:
            nonlocal gradient, curvature
            gradient = gradient + np.einsum("bm,bmk->bk", z, slope)
            curvature = curvature + np.einsum("bmk,bml->bkl", slope, slope)

        for observable in self.problem.observables:
            z, slope, growth = deviation_slopes(self.problem, observable, columns, sizes, rebound, slopes)
            counted = given.measurements(observable)
            z = np.where(counted, z, 0.0)
            gather(z, np.where(counted[..., None], slope[..., self.columns] * chain[:, None, :], 0.0))
            if growth is not None:
                turned = np.where(counted[..., None], growth[..., self.columns], 0.0)
                gradient = gradient - turned.sum(axis=1) * chain
            if self.penalised and observable.noise in self.problem.free_names:
                k = self.problem.free_names.index(observable.noise)
                rate = 1.0 if self.problem.free[k].prior.log else 1.0 / x[:, k]
                number = counted.sum(axis=1)
                gradient[:, k] += rate * (number - np.sum(z * z, axis=1))
                curvature[:, k, k] += 2.0 * rate**2 * number
        if self.problem.force is not None:
            z, slope, _shares = force_slopes(self.problem, self.problem.force, coordinates)
            slope = slope[..., self.columns].reshape(rows, -1, count) * chain[:, None, :]
            gather(z.reshape(rows, -1), slope)
        pace = slopes["contact_time"][..., self.columns].mean(axis=1) * chain
        return Linear(gradient, curvature, rebound.contact_time.mean(axis=1), pace)
