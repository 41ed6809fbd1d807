"""Compiled: the residuals of impacts whose columns err together, by covariance and Cholesky factor.

In NumPy the many small matrices take longer than the bounces that they are made of.
"""

import math
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.values import BoolArray, FloatArray
from fitball.models.kernels.compiled import entry, inlined


class Whitened(NamedTuple):
    """Predictions and residuals of impacts: the `mean` prediction in SI, the whitened residual `z`,
    the log of its scale, both zero where nothing was measured, and the lower Cholesky `factor` of
    the covariance, in which what was not measured stands apart with a scale of one.
    """

    mean: Annotated[FloatArray, "draws impacts columns"]
    z: Annotated[FloatArray, "draws impacts columns"]
    log_sd: Annotated[FloatArray, "draws impacts columns"]
    factor: Annotated[FloatArray, "draws impacts columns columns"]


def whitened(
    points: Annotated[FloatArray, "draws points impacts columns"],
    answered: Annotated[BoolArray, "draws points impacts"],
    rest: Annotated[FloatArray, "impacts columns columns"],
    y: Annotated[FloatArray, "impacts columns"],
    sds: Annotated[FloatArray, "draws impacts columns"],
) -> Whitened:
    """The measurements `y`, NaN where there is none, beside the mean of predictions at sigma points
    of equal weight.

    The covariance of an impact is that of its predictions, the `rest` of stated errors, and
    independent scatter with `sds`. Points that are not `answered` are left out.
    """
    shape = (len(points), *y.shape)
    result = Whitened(
        np.empty(shape),
        np.empty(shape),
        np.empty(shape),
        np.zeros((*shape, shape[-1])),
    )
    _whiten(
        _of_one_kind(points),
        np.require(answered, np.bool_, ("C", "W")),
        _of_one_kind(rest),
        _of_one_kind(y),
        _of_one_kind(np.broadcast_to(sds, shape)),
        *result,
    )
    return result


def _of_one_kind(array: FloatArray) -> FloatArray:
    """The array, or a copy that can be written and has the usual order: for each kind of array
    numba compiles anew.
    """
    return np.require(array, np.float64, ("C", "W"))


@inlined
def _left(away: FloatArray, rest: FloatArray, lower: FloatArray, c: int, k: int) -> float:
    """The covariance of two columns, without scatter, that the columns before `k` leave."""
    left: float = rest[c, k]
    for p in range(away.shape[0]):
        left += away[p, c] * away[p, k]
    for j in range(k):
        left -= lower[c, j] * lower[k, j]
    return left


@inlined
def _average(
    points: FloatArray,
    answered: BoolArray,
    mean: FloatArray,
    away: FloatArray,
) -> int:
    """Write the mean (columns,) of those points (points, columns) that are answered, and how
    far each lies from it, over the root of their number; return this number.
    """
    columns = mean.size
    used = 0
    mean[:] = 0.0
    for p in range(answered.size):
        if answered[p]:
            for c in range(columns):
                away[used, c] = points[p, c]
                mean[c] += points[p, c]
            used += 1
    share = 1.0 / max(used, 1)
    root = math.sqrt(share)
    for c in range(columns):
        mean[c] *= share
        for p in range(used):
            away[p, c] = root * (away[p, c] - mean[c])
    return used


@inlined
def _solve(
    y: FloatArray,
    mean: FloatArray,
    away: FloatArray,
    rest: FloatArray,
    sds: FloatArray,
    lower: FloatArray,
    z: FloatArray,
) -> None:
    """Write the Cholesky factor of one impact, and its residuals (columns,) whitened, column by
    column. `away` (points, columns) are deviations of predictions from their mean.
    """
    for c in range(y.size):
        if math.isnan(y[c]):
            z[c] = 0.0
            lower[c, c] = 1.0
            continue
        known = 0.0
        for k in range(c):
            if not math.isnan(y[k]):
                left = _left(away, rest, lower, c, k)
                lower[c, k] = left / lower[k, k]
                known += lower[c, k] * z[k]
        # Never below the column's own: what is left is a covariance, whose Schur complement
        # rounding may spoil.
        own = max(_left(away, rest, lower, c, c), 0.0)
        lower[c, c] = math.sqrt(sds[c] * sds[c] + own)
        z[c] = (y[c] - mean[c] - known) / lower[c, c]


@entry
def _whiten(
    points: FloatArray,
    answered: BoolArray,
    rest: FloatArray,
    y: FloatArray,
    sds: FloatArray,
    mean: FloatArray,
    z: FloatArray,
    log_sd: FloatArray,
    factor: FloatArray,
) -> None:
    draws, count, impacts, columns = points.shape
    away = np.empty((count, columns))
    for d in range(draws):
        for i in range(impacts):
            used = _average(points[d, :, i], answered[d, :, i], mean[d, i], away)
            _solve(y[i], mean[d, i], away[:used], rest[i], sds[d, i], factor[d, i], z[d, i])
            for c in range(columns):
                log_sd[d, i, c] = math.log(factor[d, i, c, c])
