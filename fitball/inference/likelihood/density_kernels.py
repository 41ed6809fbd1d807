"""Densities of many draws in one call, as kernels: transform, prior, rebounds, likelihood, knowledge of the scene.

What they read is a `Layout`; formulas are those of `docs/inference.md`. For a part of the draws at a time the rows of
the bounce's kernel are laid, all are bounced in one batch, and what the measured cells say is added up.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fitball.inference.problem.layout import ANGLE, SPEED, Cells, KernelRow, Layout, Levels, Transform
from fitball.models.impulse import algebraic_batch
from fitball.models.kernels.bounce import BATCH
from fitball.models.kernels.compiled import calling, compiled_allocating, inner, inner_allocating
from fitball.values import FloatArray

# Rebounds made before they are looked at: they stay in the cache of a core, and fill any lanes of the kernels.
PART = 4096
# What `out` holds of each draw.
PRIOR, SCENE, LIKELIHOOD = range(3)
LOG_TAU = math.log(2.0 * math.pi)


@inner
def log_prior(point: FloatArray, transform: Transform) -> float:
    """Log density of the coordinates of a draw; -inf outside the bounds, and where a coordinate is NaN."""
    total = -transform.constant
    for k in range(point.size):
        if not transform.low[k] <= point[k] <= transform.high[k]:
            return -math.inf
        z = (point[k] - transform.centre[k]) * transform.precision[k]
        total -= 0.5 * z * z
    return total


@inner
def lay_values(point: FloatArray, from_coordinates: bool, transform: Transform, values: FloatArray) -> None:
    """Fill `values` with those of a draw, all that is constant behind them."""
    for k in range(point.size):
        values[k] = math.exp(point[k]) if from_coordinates and transform.log[k] else point[k]
    for k in range(transform.rest.size):
        values[point.size + k] = transform.rest[k]


@inner
def lay_row(
    values: FloatArray, own: FloatArray, levels: Levels, block: int, kernel: KernelRow, row: FloatArray
) -> bool:
    """Fill the kernel's `row` of a draw for a block of impacts; whether all pooled parameters are within bounds.

    `own` is scratch: the values with those of the block's levels among them.
    """
    for k in range(own.size):
        own[k] = values[k]
    inside = True
    for k in range(levels.common.size):
        shift = values[levels.spread[k]] * values[levels.place[block, k]]
        common = values[levels.common[k]]
        level = common * math.exp(shift) if levels.log[k] else common + shift
        inside = inside and levels.low[k] <= level <= levels.high[k]
        own[levels.common[k]] = level
    for k in range(row.size):
        row[k] = own[kernel.source[k]]
    if kernel.inertia_ratio >= 0:
        mass, radius = row[row.size - 3], row[row.size - 2]
        row[row.size - 1] = own[kernel.inertia_ratio] * mass * (radius * radius)
    return inside


@inner
def log_cells(values: FloatArray, cells: Cells, block: int, rebounds: FloatArray, i: int) -> float:
    """Log likelihood of the cells of a block for rebounds (outputs, draws, impacts) of draw `i`."""
    total = 0.0
    nu, constant = 0.0, -0.5 * LOG_TAU
    if cells.freedom >= 0:
        nu = values[cells.freedom]
        constant = math.lgamma(0.5 * (nu + 1.0)) - math.lgamma(0.5 * nu) - 0.5 * math.log(math.pi * nu)
    for segment in range(cells.segments[block], cells.segments[block + 1]):
        measure, noise, turned = cells.measure[segment], cells.noise[segment], cells.turned[segment]
        begin, end = cells.first[segment], cells.first[segment + 1]
        shared = values[noise] if noise >= 0 else 1.0
        total += (end - begin) * (constant - math.log(shared))
        for cell in range(begin, end):
            j = cells.impact[cell]
            v_x, v_y = rebounds[0, i, j], rebounds[1, i, j]
            if measure == SPEED:
                predicted = math.hypot(v_x, v_y)
            elif measure == ANGLE:
                predicted = math.atan2(v_y, v_x)
            else:
                predicted = rebounds[measure, i, j]
            gap = cells.observed[cell] - predicted
            if cells.bias[cell] >= 0:
                gap -= values[cells.bias[cell]]
            sd = shared
            if noise < 0:
                sd = cells.sd[cell]
                total -= math.log(sd)
            elif turned:
                # The spread of an angle falls with the rebound speed.
                speed = math.hypot(v_x, v_y)
                sd = shared / speed
                total += math.log(speed)
            z = gap / sd
            total -= 0.5 * (nu + 1.0) * math.log1p(z * z / nu) if cells.freedom >= 0 else 0.5 * z * z
    return total


@inner
def begin(
    points: FloatArray, from_coordinates: bool, transform: Transform, values: FloatArray, draws: NDArray[np.int64],
    out: FloatArray,
) -> int:  # fmt: skip
    """Fill `out` with the priors of all `points`, zero beside, and for those inside the bounds `values` and their
    numbers, `draws`; how many these are.
    """
    count = 0
    for i in range(points.shape[0]):
        out[PRIOR, i] = log_prior(points[i], transform) if from_coordinates else 0.0
        out[SCENE, i] = out[LIKELIHOOD, i] = 0.0
        if out[PRIOR, i] > -math.inf:
            lay_values(points[i], from_coordinates, transform, values[count])
            draws[count] = i
            count += 1
    return count


@inner
def add(
    layout: Layout, measured: bool, block: int, values: FloatArray, draws: NDArray[np.int64],
    inside: NDArray[np.bool_], rebounds: FloatArray, status: NDArray[np.int8], out: FloatArray,
) -> None:  # fmt: skip
    """Add to `out` the likelihood of a block's cells, -inf where an impact has no answer, and to the scene's place
    the sum of contact times.
    """
    for i in range(draws.size):
        possible = inside[i]
        for j in range(status.shape[1]):
            possible = possible and status[i, j] == 0
        if not possible:
            out[LIKELIHOOD, draws[i]] = -math.inf
            continue
        if layout.contact_time[1] > 0.0:
            for j in range(status.shape[1]):
                out[SCENE, draws[i]] += rebounds[3, i, j]
        if measured:
            out[LIKELIHOOD, draws[i]] += log_cells(values[i], layout.cells, block, rebounds, i)


@inner
def finish(layout: Layout, draws: NDArray[np.int64], impacts: int, out: FloatArray) -> None:
    """Replace the sums of contact times by the log density of what the scene knows of their mean."""
    value, sd = layout.contact_time
    if sd > 0.0:
        for i in draws:
            z = (out[SCENE, i] / impacts - value) / sd
            out[SCENE, i] = -0.5 * (z * z + LOG_TAU) - math.log(sd)


@inner_allocating
def rows_of(values: FloatArray, layout: Layout, block: int) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Rows of the kernel (draws, columns) for a block, and whether pooled parameters are within their bounds."""
    rows, inside = np.empty((len(values), layout.row.source.size)), np.empty(len(values), dtype=np.bool_)
    own = np.empty(values.shape[1])
    for i in range(len(values)):
        inside[i] = lay_row(values[i], own, layout.levels, block, layout.row, rows[i])
    return rows, inside


bounce_batch = BATCH.call


@inner_allocating
def fill(
    points: FloatArray, from_coordinates: bool, measured: bool, layout: Layout, codes: NDArray[np.int64] | None,
    out: FloatArray,
) -> None:  # fmt: skip
    """See `log_densities`; without `codes` the bounce is algebraic, and the other is not compiled."""
    values = np.empty((points.shape[0], points.shape[1] + layout.transform.rest.size))
    draws = np.empty(points.shape[0], dtype=np.int64)
    count = begin(points, from_coordinates, layout.transform, values, draws, out)
    incident, bounds = layout.incident, layout.levels.first
    step = max(1, PART // incident.v_x1.size)
    for start in range(0, count, step):
        some = slice(start, min(start + step, count))
        for block in range(bounds.size - 1):
            rows, inside = rows_of(values[some], layout, block)
            mine, shape = slice(bounds[block], bounds[block + 1]), (len(rows), bounds[block + 1] - bounds[block])
            v_x, v_y = incident.v_x1[mine].reshape(1, -1), incident.v_y1[mine].reshape(1, -1)
            omega, cor = incident.omega_1[mine].reshape(1, -1), incident.cor[mine].reshape(1, -1)
            rebounds = np.empty((4, *shape))
            regime, status = np.empty(shape, dtype=np.int64), np.empty(shape, dtype=np.int8)
            if codes is None:
                algebraic_batch(rows, v_x, v_y, omega, rebounds, regime, status)
            else:
                bounce_batch(rows, codes, v_x, v_y, omega, cor, rebounds, regime, status)
            add(layout, measured, block, values[some], draws[some], inside, rebounds, status, out)
    finish(layout, draws[:count], incident.v_x1.size, out)


@calling(BATCH)
def log_densities(
    points: FloatArray, from_coordinates: bool, measured: bool, layout: Layout, out: FloatArray
) -> None:
    """Fill `out` (3, draws) with log densities of `points` (draws, free): their prior (0 for values instead of
    coordinates), what the scene says, and the likelihood: 0 unless `measured`, -inf where any impact has no answer.
    """
    fill(points, from_coordinates, measured, layout, layout.row.codes, out)


@compiled_allocating
def algebraic_log_densities(
    points: FloatArray, from_coordinates: bool, measured: bool, layout: Layout, out: FloatArray
) -> None:
    """As `log_densities`, of the algebraic bounce."""
    fill(points, from_coordinates, measured, layout, None, out)
