"""The likelihood of a table whose incident states were measured with errors; see `incident` and `regime_mixture`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitball.inference.likelihood import regime_mixture
from fitball.inference.problem.incident import IncidentErrors, spread_by_input, whitened
from fitball.inference.problem.noise import NoiseKind
from fitball.inference.problem.observables import Observable
from fitball.inference.problem.problem import Problem
from fitball.models.types import Rebound
from fitball.values import FloatArray

Columns = Mapping[str, FloatArray]
# Stands for the spread of a measurement that is not there: its square is finite, its inverse nothing.
UNKNOWN = 1e150
# Angle [rad] by which a velocity noise of 1 m/s turns a rebound of some 10 m/s.
TURN = 0.1
# Pairs of draw and impact that are split at once: more only take more memory.
PAIRS = 2000


@dataclass(frozen=True)
class Seen:
    """A measured column beside what it is compared with: `observable`, whose numbers are broadcastable to (draws,
    impacts), NaN where nothing was measured; the `bias` of its group; and the `typical` of stated sds, else None.
    """

    observable: Observable
    bias: FloatArray
    typical: FloatArray | None

    def paired(self, draws: NDArray[np.int64], rows: NDArray[np.int64]) -> Seen:
        """For pairs of a draw and an impact, each of shape (pairs, 1)."""
        given = self.observable
        sd = None if given.sd is None else given.sd[rows][:, None]
        bias = self.bias[draws, rows][:, None] if self.bias.ndim == 2 else self.bias
        return Seen(replace(given, observed=given.observed[rows][:, None], sd=sd), bias, self.typical)


def seen(problem: Problem, columns: Columns) -> tuple[Seen, ...]:
    """All measured columns of the table."""
    measured = []
    for observable in (item.everywhere(len(problem.impacts)) for item in problem.observables):
        bias = np.zeros(()) if problem.group_bias is None else problem.group_bias.offset(columns, observable.name)
        typical = None if observable.sd is None else np.asarray(np.nanmedian(observable.sd))
        measured.append(Seen(observable, bias, typical))
    return tuple(measured)


def measured_of(measured: Sequence[Seen], arrays: Sequence[FloatArray]) -> list[FloatArray]:
    """Of `arrays` (draws, impacts), one for each column, what belongs to a measurement, (draws, measurements)."""
    known = [np.flatnonzero(~np.isnan(item.observable.observed)) for item in measured]
    return [
        array if places.size == array.shape[1] else array[:, places]
        for places, array in zip(known, arrays, strict=True)
    ]


def marginal_terms(
    problem: Problem, incident: IncidentErrors, values: FloatArray, rebound: Rebound
) -> Mapping[str, FloatArray]:
    """Log density of each measurement given those before it, observable name -> (draws, impacts).

    Near a change of regime only their sum over an impact is meant: it stands in the first observable.
    """
    columns = problem.all_values(values)
    measured = seen(problem, columns)
    slopes = problem.slopes_like(columns, problem.impacts, np.arange(len(problem.impacts)))
    terms = _log_densities(problem.noise, measured, columns, rebound, slopes, incident.covariance)
    root = regime_mixture.roots(incident.covariance)
    towards = regime_mixture.crossings(
        lambda impacts, rows: problem.rebound_like(columns, impacts, rows), problem.impacts, root, rebound
    )
    draws, rows = np.nonzero(np.any(np.abs(towards) > 0.0, axis=-1))
    for start in range(0, draws.size, PAIRS):
        some, of = draws[start : start + PAIRS], rows[start : start + PAIRS]
        pairs = Pairs(
            problem.paired(columns, some, of), [measurement.paired(some, of) for measurement in measured],
            _upright(problem, of), root[of], towards[some, of],
        )  # fmt: skip
        mixture = _mixture(problem, pairs)
        for place, term in enumerate(terms):
            term[some, of] = mixture if place == 0 else 0.0
    return {measurement.observable.name: term for measurement, term in zip(measured, terms, strict=True)}


def incident_covariance(problem: Problem, incident: IncidentErrors, columns: Columns, rebound: Rebound) -> FloatArray:
    """What incident errors alone make the columns scatter by together (draws, impacts, columns, columns), to first
    order.
    """
    slopes = problem.slopes_like(columns, problem.impacts, np.arange(len(problem.impacts)))
    by_input = np.stack([observable.column.slopes(rebound, slopes) for observable in problem.observables], axis=2)
    return spread_by_input(by_input, incident.covariance)


def joint_root(
    problem: Problem, incident: IncidentErrors, columns: Columns, rebound: Rebound, spreads: FloatArray
) -> FloatArray:
    """Lower factor (draws, impacts, columns, columns) of the covariance of what is measured, of the `spreads` (draws,
    impacts, columns) of each column and of incident errors; NaN where there is no rebound.
    """
    unit = np.eye(spreads.shape[-1])
    whole = incident_covariance(problem, incident, columns, rebound) + spreads[..., None] ** 2 * unit
    solved = np.isfinite(whole).all(axis=(2, 3), keepdims=True)
    return np.where(solved, np.linalg.cholesky(np.where(solved, whole, unit)), np.nan)


def whitening(
    problem: Problem, incident: IncidentErrors, columns: Columns, rebound: Rebound, spreads: FloatArray
) -> FloatArray:
    """Inverse (draws, impacts, columns, columns) of the `joint_root`."""
    root = joint_root(problem, incident, columns, rebound, spreads)
    solved = np.isfinite(root).all(axis=(2, 3), keepdims=True)
    return np.where(solved, np.linalg.inv(np.where(solved, root, np.eye(root.shape[-1]))), np.nan)


def standardised(
    measured: Sequence[Seen], columns: Columns, rebound: Rebound, slopes: Columns, covariance: FloatArray
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Whitened deviations (draws, impacts) of each measured column from rebounds, first order about these.

    `slopes` (draws, impacts, 3) of each output of the model, `covariance` (impacts, 3, 3) or (draws, 1, 3, 3) of the
    incident states. Returns those deviations and their conditional sds. What was not measured has the deviation zero
    and the sd `UNKNOWN`, which takes part in nothing.
    """
    by_observable = np.stack(
        [measurement.observable.column.slopes(rebound, slopes) for measurement in measured], axis=2
    )
    gaps, spreads = [], []
    for measurement in measured:
        observable = measurement.observable
        gap = observable.observed - observable.predict(rebound) - measurement.bias
        missing = np.broadcast_to(np.isnan(observable.observed), gap.shape)
        gaps.append(np.where(missing, 0.0, gap))
        spreads.append(np.where(missing, UNKNOWN, np.broadcast_to(observable.sds(columns, rebound), gap.shape)))
    return whitened(gaps, spreads, spread_by_input(by_observable, covariance))


def _log_densities(
    noise: NoiseKind,
    measured: Sequence[Seen],
    columns: Columns,
    rebound: Rebound,
    slopes: Columns,
    covariance: FloatArray,
) -> list[FloatArray]:
    """Log density (draws, impacts) of each measured column given those before it; 0 where there is none."""
    z, sds = standardised(measured, columns, rebound, slopes, covariance)
    return [
        np.where(sd < UNKNOWN, noise.log_density(one, columns) - np.log(sd), 0.0)
        for one, sd in zip(z, sds, strict=True)
    ]


@dataclass(frozen=True)
class Pairs:
    """Pairs of a draw and an impact of the table near a change of regime.

    `columns` parameters (pairs,), `measured` what was seen, `states` incident states (pairs, 1); `root` (pairs, 3, 3)
    as in `regime_mixture.roots`, `towards` (pairs, 3) a direction, in principal axes, in which the regime changes.
    """

    columns: Columns
    measured: Sequence[Seen]
    states: regime_mixture.States
    root: FloatArray
    towards: FloatArray


def _mixture(problem: Problem, pairs: Pairs) -> FloatArray:
    """Log density (pairs,) of all measurements of each impact, its incident errors split."""
    across = _across(problem, pairs)
    along = np.einsum("pij,pj->pi", pairs.root, across)
    states, possible = regime_mixture.displaced(pairs.states, regime_mixture.parts()[0][:, None] * along[:, None, :])
    rebound, slopes = problem.linearised(pairs.columns, states)
    narrow = regime_mixture.narrowed(pairs.root, across)[:, None]
    terms = _log_densities(problem.noise, pairs.measured, pairs.columns, rebound, slopes, narrow)
    density = np.sum(terms, axis=0)
    return regime_mixture.mixed(np.where(possible & (rebound.status == 0), density, -np.inf))


def _across(problem: Problem, pairs: Pairs) -> FloatArray:
    """Directions (pairs, 3), in principal axes, across the boundaries that lie `towards` somewhere.

    The rebound is continuous, so that its derivative jumps by a matrix of rank one whose rows point across.
    """
    moves = regime_mixture.REACH * np.einsum("pij,pj->pi", pairs.root, pairs.towards)
    states, possible = regime_mixture.displaced(pairs.states, np.stack([np.zeros_like(moves), moves], axis=1))
    rebound, slopes = problem.linearised(pairs.columns, states)
    # In units of any noise: only the direction of the jump is wanted.
    by_observable = np.stack(
        [
            measurement.observable.column.slopes(rebound, slopes) / _typical_noise(measurement, pairs.columns)
            for measurement in pairs.measured
        ],
        axis=2,
    )
    jump = np.matmul(by_observable[:, 1] - by_observable[:, 0], pairs.root)
    # Where the other side has no derivative the way that was looked is all that is known.
    known = np.isfinite(jump).all(axis=(1, 2)) & possible[:, 1]
    across = pairs.towards.copy()
    across[known] = np.linalg.svd(jump[known])[2][:, 0]
    return across


def _upright(problem: Problem, rows: NDArray[np.int64]) -> regime_mixture.States:
    """The incident states of the table's `rows`, one below the other."""
    v_x1, v_y1, omega_1, cor = problem.impacts.take(rows).states()
    return v_x1.T, v_y1.T, omega_1.T, None if cor is None else cor.T


def _typical_noise(measurement: Seen, columns: Columns) -> FloatArray:
    """A noise of the measured column, (pairs, 1, 1) or one number."""
    if measurement.typical is not None:
        return measurement.typical
    size = columns[str(measurement.observable.noise)][:, None, None]
    return TURN * size if measurement.observable.turned else size
