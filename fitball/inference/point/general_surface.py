"""The likelihood of a table as a surface over all its free parameters, for noise whose best size has no closed form:
heavy tails, uncertain incident states, where the spread of a rebound depends on every parameter, and force records.

What is minimised is the negative log likelihood itself, mixtures at changes of regime included. Its gradient is taken
by differences; its expected curvature is that of location and scale, `I (m m' + 2 s s')` with `m` the slope of a
prediction in units of its spread, `s` that of the spread's logarithm, and `I` what one deviation tells of its centre.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fitball.inference.likelihood.force import force_information_rows
from fitball.inference.likelihood.incident_marginal import measured_of, seen, standardised
from fitball.inference.likelihood.posterior import impact_terms, log_likelihood, log_scene_density
from fitball.inference.point.surface import Conditions, Linear, Surface
from fitball.inference.problem.noise import NormalNoise
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import batches
from fitball.models.types import Rebound
from fitball.values import FloatArray

# Step of differences in widths of the priors: it moves a minimum by half of itself, far less than any error.
STEP = 1e-6
# Rows up to which a search begins from many places.
SEARCHED = 1000


def surface_of(problem: Problem, promised: float = 1e-3, *, penalised: bool = False) -> Surface:
    """The surface of a problem's likelihood, or posterior; see `Surface` for `promised` and `penalised`."""
    # With records the noise of a likelihood is held, see `noise_held`; that of a posterior is not.
    recorded = penalised and problem.force is not None
    closed = isinstance(problem.noise, NormalNoise) and problem.incident is None and not recorded
    return (Surface if closed else GeneralSurface)(problem, promised=promised, penalised=penalised)


@dataclass(frozen=True)
class _Deviations:
    """At each row: the `cost` (rows,) of what was measured, deviations `z` and logarithms `log_sd` (rows,
    measurements) of their spreads, and the mean contact time `time` (rows,).
    """

    cost: FloatArray
    z: FloatArray
    log_sd: FloatArray
    time: FloatArray


@dataclass(frozen=True)
class GeneralSurface(Surface):
    """Like its base, with the noise among the columns."""

    @cached_property
    def noise_columns(self) -> list[int]:
        """None: noise is a column like others."""
        return []

    def cost(self, x: FloatArray, given: Conditions) -> FloatArray:
        """See `Surface`."""
        costs = []
        for some in batches(self.problem, x.shape[0]):
            values = self.problem.to_values(self._coordinates(x[some]))
            costs.append(self._negative(values, self.problem.rebound(values), given.take(some)))
        return np.concatenate(costs) + self._held(x)[0]

    def _negative(self, values: FloatArray, rebound: Rebound, given: Conditions) -> FloatArray:
        if given.counted is None:
            total = -log_likelihood(self.problem, values, rebound)
        else:
            terms = sum(impact_terms(self.problem, values, rebound).values())
            total = -np.sum(np.where(given.counted, terms, 0.0), axis=1)
        if given.scene:
            total = total - log_scene_density(self.problem, rebound)
        return np.where(np.any(rebound.status, axis=1) | np.isnan(total), np.inf, total)

    def _linearised(self, x: FloatArray, given: Conditions) -> Linear:
        rows, count = x.shape
        steps = self._steps(x)
        moves = np.concatenate([np.zeros((rows, 1, count)), steps[:, :, None] * np.eye(count)], axis=1)
        around = x[:, None, :] + moves
        at = self._deviations(around.reshape(-1, count), given.take(np.repeat(np.arange(rows), count + 1)))
        cost, z, log_sd, time = (
            part.reshape(rows, count + 1, *part.shape[1:]) for part in (at.cost, at.z, at.log_sd, at.time)
        )
        with np.errstate(invalid="ignore"):
            gradient = (cost[:, 1:] - cost[:, :1]) / steps
            spread = (log_sd[:, 1:] - log_sd[:, :1]) / steps[:, :, None]
            centre = (z[:, 1:] - z[:, :1]) / steps[:, :, None] + z[:, :1] * spread
            clock = (time[:, 1:] - time[:, :1]) / steps
        told = np.broadcast_to(self.problem.noise.information(self._sizes(x)), (rows,))[:, None, None]
        curvature = told * (centre @ centre.transpose(0, 2, 1) + 2.0 * spread @ spread.transpose(0, 2, 1))
        self._add_shape(curvature, x, z[:, 0])
        if self.problem.force is not None:
            told_by = force_information_rows(self.problem, self.problem.force, self._coordinates(x))
            slopes, growth = (part.reshape(rows, -1, count) * self._chain(x)[:, None] for part in told_by)
            curvature += slopes.transpose(0, 2, 1) @ slopes + 2.0 * growth.transpose(0, 2, 1) @ growth
        return Linear(gradient, curvature, time[:, 0], clock)

    def _steps(self, x: FloatArray) -> FloatArray:
        """Steps (rows, columns) of differences, away from bounds and walls that are near."""
        _, high = self.limits
        a, b = self.walls
        step = STEP * self.width
        outside = x + step > high
        if b.size:
            outside |= np.any((x @ a.T)[:, :, None] + a * step > b[:, None], axis=1)
        return np.where(outside, -step, step)

    def _sizes(self, x: FloatArray) -> dict[str, FloatArray]:
        return dict(self.problem.all_values(self.problem.to_values(self._coordinates(x))))

    def _add_shape(self, curvature: FloatArray, x: FloatArray, z: FloatArray) -> None:
        """The noise's own parameters: the squares of the slopes of each log density (Berndt et al. 1974)."""
        for parameter in self.problem.noise.parameters:
            if parameter.name not in self.problem.free_names:
                continue
            k = self.problem.free_names.index(parameter.name)
            moved = x.copy()
            moved[:, k] += STEP * self.width[k]
            here, there = (self.problem.noise.log_density(z, self._sizes(place)) for place in (x, moved))
            curvature[:, k, k] += np.sum(((there - here) / (STEP * self.width[k])) ** 2, axis=1)

    def _deviations(self, x: FloatArray, given: Conditions) -> _Deviations:
        parts = []
        for some in batches(self.problem, x.shape[0]):
            values = self.problem.to_values(self._coordinates(x[some]))
            rebound = self.problem.rebound(values)
            here = given.take(some)
            counted = np.concatenate([here.measurements(item) for item in self.problem.observables], axis=1)
            z, log_sd = (np.where(counted, part, 0.0) for part in self._standardised(values, rebound))
            # A model without a time axis has none that counts.
            time = rebound.contact_time.mean(axis=1) if given.scene else np.zeros(values.shape[0])
            parts.append((self._negative(values, rebound, replace(here, scene=False)), z, log_sd, time))
        return _Deviations(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def _standardised(self, values: FloatArray, rebound: Rebound) -> tuple[FloatArray, FloatArray]:
        """Deviations and logarithms of their spreads, first order in errors of the incident state."""
        columns = self.problem.all_values(values)
        if self.problem.incident is not None:
            slopes = self.problem.slopes_like(columns, self.problem.impacts, np.arange(len(self.problem.impacts)))
            measured = seen(self.problem, columns)
            z, sds = standardised(measured, columns, rebound, slopes, self.problem.incident.covariance)
            known, widths = (np.concatenate(measured_of(measured, part), axis=1) for part in (z, sds))
            return known, np.log(widths)
        gaps, spreads = [], []
        for observable in self.problem.observables:
            gap = self.problem.deviation(columns, observable, rebound)
            spread = np.broadcast_to(observable.sds(columns, rebound), gap.shape)
            gaps.append(gap / spread)
            spreads.append(np.log(spread))
        return np.concatenate(gaps, axis=1), np.concatenate(spreads, axis=1)
