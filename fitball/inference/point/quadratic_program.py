"""The step that minimises a quadratic within linear conditions."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from fitball.values import FloatArray

# Distance (relative) from a contradiction below which conditions count as contradicting each other: rounding of the
# non-negative least squares it is read from.
CONTRADICTION = 1e-10


def constrained_step(curvature: FloatArray, gradient: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray | None:
    """Minimise `d' curvature d/2 + gradient' d` over d (n,) subject to `a d <= b`, curvature positive definite; None
    when no d meets the conditions.

    With `curvature = L L'` and `y = L' d + L^-1 gradient` it is a least-distance problem, solved by non-negative
    least squares (Lawson and Hanson 1974, chapter 23).
    """
    factor = np.linalg.cholesky(curvature)
    shift = np.linalg.solve(factor, gradient)
    # Conditions on y, as `normals y >= offsets`, each scaled to unit length.
    normals = -np.linalg.solve(factor, a.T).T
    offsets = -(b - normals @ shift)
    lengths = np.maximum(np.linalg.norm(normals, axis=1), np.finfo(float).tiny)
    normals, offsets = normals / lengths[:, None], offsets / lengths
    size = max(float(np.max(np.abs(offsets), initial=0.0)), np.finfo(float).tiny)
    stacked = np.vstack([normals.T, offsets / size])
    target = np.zeros(gradient.size + 1)
    target[-1] = 1.0
    residual = stacked @ nnls(stacked, target)[0] - target
    if -residual[-1] < CONTRADICTION:
        return None
    nearest = size * residual[:-1] / -residual[-1]
    step: FloatArray = np.linalg.solve(factor.T, nearest - shift)
    return step
