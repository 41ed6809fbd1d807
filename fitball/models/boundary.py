"""How far an impact is from a change of regime, where the rebound has a kink and first order ends."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fitball.errors import ParameterError
from fitball.models.model import Model
from fitball.models.types import Status
from fitball.values import FloatArray, Impacts

BoolArray = NDArray[np.bool_]

# Distance between looks along a ray [standard deviations]: a regime entered and left within it goes unseen.
STRIDE = 0.5
# Halvings of the stride that holds the change: it is then known to a hundredth of a standard deviation.
HALVINGS = 6


def boundary_margin(
    model: Model,
    names: Sequence[str],
    values: FloatArray,
    impacts: Impacts,
    covariance: FloatArray,
    reach: float = 3.0,
) -> FloatArray:
    """Standard deviations of the incident state from each impact to the nearest change of regime, (draws, impacts).

    `covariance` (impacts, 3, 3) or (3, 3) is that of `(v_x1, v_y1, omega_1)`; `names` and `values` (draws, names) as
    in `Model.evaluate`. The regime is looked at in steps along both directions of each principal axis of the
    correlation, as far as a plane at distance `reach` is sure to be met; through the crossings `d` found there goes
    a plane, at the distance `1/sqrt(sum 1/d^2)`. An axis without a crossing counts as crossed where the search ends,
    so that the distance of a flat boundary is never overrated. Infinite where no ray changes regime. What cannot be
    evaluated, or does not approach the court, counts as another regime; an impact that cannot be evaluated itself
    gives NaN.
    One kink changes no regime and goes unseen: that of zero incident slip which the landing impulse does not leave at
    that, because the offset overcomes friction or acts while gripping only.
    Raises ParameterError for a covariance of another shape or not positive semidefinite. About 0.2 ms an impact.
    """
    factors = _factors(covariance, len(impacts))
    # A plane at distance `reach` crosses the nearest of three perpendicular rays at sqrt(3) times that or before.
    strides = int(np.ceil(reach * np.sqrt(3.0) / STRIDE))
    found = np.empty((values.shape[0], len(impacts)))
    for draw, row in enumerate(values):
        found[draw] = _margin(_Rays(model, names, row[None, :], impacts, factors), strides)
    return found


class _Rays:
    """The six rays of each impact, for one draw."""

    def __init__(
        self, model: Model, names: Sequence[str], values: FloatArray, impacts: Impacts, factors: FloatArray
    ) -> None:
        self.model, self.names, self.values, self.impacts = model, names, values, impacts
        # (impacts, rays, 3): one standard deviation along each.
        columns = np.swapaxes(factors, 1, 2)
        self.steps = np.concatenate([columns, -columns], axis=1)
        self.still = ~np.any(self.steps, axis=2)
        start = model.evaluate(names, values, impacts)
        self.regime = start.regime[0]
        self.solved = start.status[0] == Status.OK

    def changed(self, distances: FloatArray) -> BoolArray:
        """Whether the regime at `distances` (impacts, rays) is another than at the impact itself."""
        state = np.stack([self.impacts.v_x1, self.impacts.v_y1, self.impacts.omega_1], axis=-1)
        points = state[:, None, :] + distances[..., None] * self.steps
        away = points[..., 1] <= 0.0
        points = np.where(away[..., None], state[:, None, :], points)
        cor = self.impacts.cor
        there = self.model.evaluate(
            self.names,
            self.values,
            Impacts(
                points[..., 0].ravel(), points[..., 1].ravel(), points[..., 2].ravel(),
                None if cor is None else np.repeat(cor, points.shape[1]),
            ),
        )  # fmt: skip
        other = there.regime[0].reshape(away.shape) != self.regime[:, None]
        failed = there.status[0].reshape(away.shape) != Status.OK
        return np.asarray(other | failed | away)


def _margin(rays: _Rays, strides: int) -> FloatArray:
    shape = rays.still.shape
    far = np.full(shape, np.inf)
    for k in range(1, strides + 1):
        open_ = np.isinf(far) & ~rays.still
        far[open_ & rays.changed(np.full(shape, k * STRIDE))] = k * STRIDE
    crossed = np.isfinite(far)
    near = np.where(crossed, far - STRIDE, 0.0)
    far = np.where(crossed, far, 0.0)
    for _ in range(HALVINGS):
        middle = 0.5 * (near + far)
        beyond = rays.changed(middle)
        far, near = np.where(beyond, middle, far), np.where(beyond, near, middle)
    crossing = np.where(crossed, 0.5 * (near + far), np.where(rays.still, np.inf, strides * STRIDE))
    half = crossing.shape[1] // 2
    nearest = np.minimum(crossing[:, :half], crossing[:, half:])
    met = np.any(crossed, axis=1)
    margin = np.full(met.shape, np.inf)
    margin[met] = 1.0 / np.sqrt(np.sum(1.0 / nearest[met] ** 2, axis=1))
    margin[~rays.solved] = np.nan
    return margin


def _factors(covariance: FloatArray, count: int) -> FloatArray:
    """Square roots (impacts, 3, 3) of covariances that may be singular, as those of a spin known exactly are."""
    given = np.asarray(covariance, dtype=np.float64)
    if given.shape not in ((3, 3), (count, 3, 3)):
        raise ParameterError(f"covariance has shape {given.shape}: expected (3, 3) or ({count}, 3, 3)")
    if not np.isfinite(given).all():
        raise ParameterError("covariance of the incident state holds a number that is not finite")
    scale = np.sqrt(np.abs(np.diagonal(given, axis1=-2, axis2=-1)))
    scale = np.where(scale > 0.0, scale, 1.0)
    correlation = given / (scale[..., :, None] * scale[..., None, :])
    eigenvalues, vectors = np.linalg.eigh(correlation)
    # Rounding of a singular correlation matrix leaves eigenvalues of its own size on either side of zero.
    if not (eigenvalues > -1e-12).all():
        raise ParameterError("covariance of the incident state is not positive semidefinite")
    roots = scale[..., :, None] * vectors * np.sqrt(np.maximum(eigenvalues, 0.0))[..., None, :]
    return np.broadcast_to(roots, (count, 3, 3))
