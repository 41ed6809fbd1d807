"""The likelihood of force-time records: a pure function beside that of the table, batched over draws.

What the model predicts is the force of its vertical spring, averaged as the record was (see `force_records`). When
contact started is a nuisance of each record: a time with a normal prior, wide where only the record shows it, over
which the likelihood is integrated to first order about its best (Laplace), so that it costs a record the one
degree of freedom it takes. Noise is normal, whatever that of the table.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitball.inference.problem.force_records import ForceRecords
from fitball.inference.problem.parameters import FORCE_NOISE, NOISE_SPECS
from fitball.inference.problem.problem import Problem
from fitball.models.kernels.dual import STEP, NumberArray
from fitball.values import FloatArray

Columns = Mapping[str, NumberArray]
SD, MISFIT = FORCE_NOISE
# Gauss-Newton steps to the best start of contact. Where the mean times of force and record coincide it is within some
# per cent of the contact; each step leaves some hundredths of what was left.
PASSES = 3
# Longest of these steps, as a share of the contact: a trust region for parameters far from the record.
LONGEST = 0.25


@dataclass(frozen=True)
class Aligned:
    """Records against the model at nearly the best starts of contact `start` (draws, records) [s].

    `z` (draws, records, nodes) are the independent deviations in units of their `spread`, `slope` what they lose per
    second of later start. `move` (draws, records) [s] is the rest of the way to the best start, `information` the
    second derivative of minus the log posterior of the start.
    """

    start: FloatArray
    z: FloatArray
    slope: FloatArray
    spread: FloatArray
    move: FloatArray
    information: FloatArray

    def rows(self, records: ForceRecords) -> FloatArray:
        """Weighted residuals at the best start (draws, records, nodes + 1), the last that of the start itself."""
        mean, sd = records.start
        rest = self.z - self.slope * self.move[..., None]
        return np.concatenate([rest, ((self.start + self.move - mean) / sd)[..., None]], axis=2)


def spread(records: ForceRecords, sd: FloatArray, misfit: FloatArray) -> FloatArray:
    """Standard deviations (draws, records, nodes) [N] of independent deviations for noise (draws,)."""
    slow = (misfit[:, None] * records.peak)[:, :, None] ** 2 * records.slow
    return np.asarray(np.sqrt(sd[:, None, None] ** 2 + slow))


def mean_forces(
    problem: Problem,
    columns: Columns,
    rows: NDArray[np.int64],
    first: FloatArray,
    spacing: FloatArray,
    count: int,
) -> tuple[NumberArray, NumberArray]:
    """Triangular means of the spring's force (draws, rows, count) [N] about times `first` (draws, rows) after landing
    and every `spacing` (rows,) [s], each over one spacing to either side; and their rates of change [N/s].
    """
    impulse, integral, _centroid = problem.force_integrals(columns, rows, first - spacing, spacing, count + 2)
    area = (spacing**2)[:, None]
    force = (integral[..., 2:] - 2.0 * integral[..., 1:-1] + integral[..., :-2]) / area
    rate = (impulse[..., 2:] - 2.0 * impulse[..., 1:-1] + impulse[..., :-2]) / area
    return force, rate


def rotated(records: ForceRecords, means: FloatArray) -> FloatArray:
    """Means (draws, records, nodes) along the common axes of both covariances."""
    return np.asarray((records.rotation @ means.transpose(1, 2, 0)).transpose(2, 0, 1))


def aligned(problem: Problem, records: ForceRecords, columns: Mapping[str, FloatArray]) -> Aligned:
    """Each record against the model, at the start of contact that fits best for the noise among `columns`."""
    mean, sd = records.start
    draws = columns[SD].shape[0]
    none = np.zeros((draws, len(records)))
    _p, _q, centroid = problem.force_integrals(columns, records.rows, none, records.spacing, 0)
    start = records.centroid - centroid if records.start_sd is None else none
    spreads = spread(records, columns[SD], columns[MISFIT])
    for step in range(PASSES + 1):
        force, rate = mean_forces(
            problem, columns, records.rows, records.first - start, records.spacing, records.nodes
        )
        z = rotated(records, records.means - np.where(records.mask, force, 0.0)) / spreads
        # Later by a second, the force is what it was before: it falls by its rate.
        slope = rotated(records, np.where(records.mask, -rate, 0.0)) / spreads
        information = np.sum(slope * slope, axis=2) + 1.0 / sd**2
        move = (np.sum(slope * z, axis=2) - (start - mean) / sd**2) / information
        if step < PASSES:
            start = start + np.clip(move, -LONGEST * records.length, LONGEST * records.length)
    return Aligned(start, z, slope, spreads, move, information)


def force_log_likelihood(problem: Problem, records: ForceRecords, columns: Mapping[str, FloatArray]) -> FloatArray:
    """Log likelihood (draws,) of the records, NaN where the model has no answer."""
    alignment = aligned(problem, records, columns)
    rows = alignment.rows(records)
    logs = np.sum(np.where(records.mask, np.log(alignment.spread), 0.0), axis=(1, 2))
    # The normal prior of the start against the width of what is left of it.
    width = 0.5 * np.sum(np.log(alignment.information * records.start[1] ** 2), axis=1)
    return np.asarray(records.constant - 0.5 * np.sum(rows * rows, axis=(1, 2)) - logs - width)


def force_residuals(problem: Problem, columns: Mapping[str, FloatArray]) -> FloatArray:
    """Weighted residuals (draws, residuals) for the noise among `columns`; none without records."""
    if problem.force is None:
        return np.empty((len(next(iter(columns.values()))), 0))
    rows = aligned(problem, problem.force, columns).rows(problem.force)
    return rows.reshape(rows.shape[0], -1)


def force_slopes(
    problem: Problem, records: ForceRecords, coordinates: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Weighted residuals (draws, records, nodes + 1) at `coordinates` (draws, free), their derivatives (..., free)
    with respect to coordinates at given noise, and the share (..., nodes, 2) of each noise in the squared spreads.

    Exact derivatives of the force by complex steps; the start of contact follows to its best, which changes the
    cost in second order only (variable projection in Kaufman's form, 1975).
    """
    columns = problem.all_values(problem.to_values(coordinates))
    alignment = aligned(problem, records, columns)
    rows = alignment.rows(records)
    slopes = np.zeros((*rows.shape, problem.dimension))
    still = NOISE_SPECS.keys() | (
        problem.group_bias.names(problem.observables) if problem.group_bias is not None else set()
    )
    sd = records.start[1]
    for k, name in enumerate(problem.free_names):
        if name in still:
            continue
        moved = coordinates.astype(np.complex128)
        moved[:, k] += 1j * STEP
        there = problem.all_values(problem.to_values(moved))
        first = records.first - alignment.start
        force, _rate = mean_forces(problem, there, records.rows, first, records.spacing, records.nodes)
        change = -rotated(records, np.where(records.mask, force.imag / STEP, 0.0)) / alignment.spread
        follow = np.sum(alignment.slope * change, axis=2) / alignment.information
        slopes[..., :-1, k] = change - alignment.slope * follow[..., None]
        slopes[..., -1, k] = follow / sd
    shares = np.stack([columns[SD][:, None, None] ** 2 + 0.0 * alignment.spread, alignment.spread**2], axis=-1)
    shares[..., 1] -= shares[..., 0]
    return rows, slopes, shares / (alignment.spread**2)[..., None]


def force_information_rows(
    problem: Problem, records: ForceRecords, coordinates: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Derivatives with respect to coordinates (draws, free) of the weighted residuals of each record (draws, records,
    nodes + 1, free), and of the logarithms of their spreads (draws, records, nodes, free): the squares of the first
    and twice those of the second add up to the expected information.
    """
    rows, slopes, shares = force_slopes(problem, records, coordinates)
    growth = np.zeros((*rows[..., :-1].shape, problem.dimension))
    for which, name in enumerate(FORCE_NOISE):
        if name in problem.free_names:
            k = problem.free_names.index(name)
            scale = 1.0 if problem.free[k].prior.log else 1.0 / coordinates[:, k, None, None]
            growth[..., k] = scale * np.where(records.mask, shares[..., which], 0.0)
    return slopes, growth


def force_information(problem: Problem, records: ForceRecords, coordinates: FloatArray) -> FloatArray:
    """Expected information (free, free) of the records at `coordinates` (free,), with respect to coordinates."""
    told = force_information_rows(problem, records, coordinates[None, :])
    flat, growth = (rows.reshape(-1, problem.dimension) for rows in told)
    information: FloatArray = flat.T @ flat + 2.0 * growth.T @ growth
    return information


def force_cost(problem: Problem, columns: Mapping[str, FloatArray]) -> FloatArray:
    """Minus the log likelihood (draws,) of the records, each start of contact at its best; 0 without records."""
    records = problem.force
    if records is None:
        return np.zeros(len(next(iter(columns.values()))))
    alignment = aligned(problem, records, columns)
    logs = np.sum(np.where(records.mask, np.log(alignment.spread), 0.0), axis=(1, 2))
    return np.asarray(0.5 * np.sum(alignment.rows(records) ** 2, axis=(1, 2)) + logs - records.constant)


def noise_held(problem: Problem, values: Mapping[str, float]) -> Problem:
    """The same problem with the noise of its records fixed at `values`: so profiles of the likelihood are made, whose
    search handles independent noise only. The problem itself without records.
    """
    if problem.force is None:
        return problem
    held = tuple(
        replace(parameter, fixed=values[parameter.name], fixed_because="held at its most probable size")
        if parameter.name in FORCE_NOISE and parameter.free
        else parameter
        for parameter in problem.parameters
    )
    return replace(problem, parameters=held)
