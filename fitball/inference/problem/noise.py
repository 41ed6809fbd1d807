"""How standardised deviations scatter: normally, or with the heavy tails of Student's t."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import gammaln

from fitball.values import FloatArray

LOG_TAU = math.log(2.0 * math.pi)
NORMAL, STUDENT = "normal", "student-t"
DISTRIBUTIONS = (NORMAL, STUDENT)


def log_density(z: FloatArray, degrees_of_freedom: FloatArray | None) -> FloatArray:
    """Log density of standardised deviations `z`; `degrees_of_freedom` broadcastable to it, None for normal ones."""
    if degrees_of_freedom is None:
        return np.asarray(-0.5 * (z * z + LOG_TAU))
    nu = degrees_of_freedom
    constant = gammaln(0.5 * (nu + 1.0)) - gammaln(0.5 * nu) - 0.5 * np.log(math.pi * nu)
    return np.asarray(constant - 0.5 * (nu + 1.0) * np.log1p(z * z / nu))


def as_residual(z: FloatArray, degrees_of_freedom: float | None) -> FloatArray:
    """A residual whose square is minus twice the log density but for a constant: what least squares can minimise."""
    if degrees_of_freedom is None:
        return z
    nu = degrees_of_freedom
    return np.asarray(np.copysign(np.sqrt((nu + 1.0) * np.log1p(z * z / nu)), z))


def draw(rng: np.random.Generator, shape: tuple[int, ...], degrees_of_freedom: FloatArray | None) -> FloatArray:
    """Standardised deviations of the given shape."""
    if degrees_of_freedom is None:
        return rng.standard_normal(shape)
    return rng.standard_t(np.broadcast_to(degrees_of_freedom, shape))
