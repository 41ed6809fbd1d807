"""The ball, closures and parameters with which the tests of the oracle begin."""

from __future__ import annotations

import numpy as np

from fitball.models.types import Closures, Rebound
from fitball.values import Ball, Impacts

BALL = Ball()
DEFAULT = Closures("zero_force", "momentum", "contact", "mean", "tied", "matched", "line")
AS_THE_THESIS = Closures("zero_displacement", "inner", "grip", "shell", "tied", "matched", "line")
PARAMETERS = {
    "mass_ratio": 0.8,
    "k_y": 4e4,
    "k_theta": 60.0,
    "mu": 0.55,
    "eps_10": 2e-3,
    "eps_slope": 1e-4,
    "cor_10": 0.75,
    "cor_slope": -0.01,
    "zeta_theta": 0.3,
    "inertia_split": 0.5,
}


def distance(one: Rebound, other: Rebound, at: Impacts) -> float:
    """Largest difference of the rebounds over the largest incident speed."""
    size = np.abs(at.v_x1) + at.v_y1 + BALL.radius * np.abs(at.omega_1)
    apart = [one.v_x2 - other.v_x2, one.v_y2 - other.v_y2, BALL.radius * (one.omega_2 - other.omega_2)]
    return float(np.max(np.abs(apart) / size))
