"""Errors of the incident state: it was measured too, and what it leaves open shows in the rebound.

The true incident state is marginalised with a flat prior. To first order, with `J` the exact Jacobian of the bounce,
the measured outputs of an impact then scatter about the prediction with covariance `diag(sd^2) + J S J^T`, `S` that
of the incident state (Fuller 1987, section 3.1). They are whitened one after the other (Cholesky), so that heavy
tails and scores by column keep their meaning: each given those before it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitball.values import FloatArray


@dataclass(frozen=True)
class IncidentErrors:
    """`covariance` (impacts, 3, 3) of `(v_x1, v_y1, omega_1)` in SI."""

    covariance: FloatArray

    def take(self, rows: NDArray[np.int64]) -> IncidentErrors:
        """The same for some of the impacts."""
        return IncidentErrors(self.covariance[rows])
