"""Expected information gain to first order: how far a normal posterior narrows, draw by draw.

With the posterior covariance as the unit, `B` the covariance that is left after what was chosen so far, and `R` the
rows of a further impact, the measurement has the covariance `1 + R B R^T`. What it tells of a target is its entropy
less that at given target, `ln det(1 + R B R^T)/2 - ln det(1 + R B' R^T)/2`, `B'` being what is left of `B` where the
target is known: a determinant of a few columns instead of one of all parameters (Chaloner and Verdinelli
1995 for the criterion; the identity is that of mutual information).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitball.values import FloatArray

# Directions of a target below this share of its variance are combinations of the others, such as a spin that follows
# from the velocities of a sliding ball.
DEPENDENT = 1e-9


@dataclass(frozen=True)
class Left:
    """What is left open after planned impacts, by draw: covariance `whole` (draws, directions, directions) in units
    of the posterior, for a target whose gradients are `towards` (draws, targets, directions).
    """

    whole: FloatArray
    towards: FloatArray

    def gains(self, rows: FloatArray) -> FloatArray:
        """Nats (draws, impacts) that impacts with `rows` (draws, impacts, rows, directions) tell of the target."""
        return np.asarray(0.5 * (_log_det(rows, self.whole) - _log_det(rows, self._given)))

    def after(self, rows: FloatArray) -> Left:
        """What is left after impacts with `rows` (draws, rows, directions) were measured."""
        across = rows @ self.whole
        inner = np.eye(rows.shape[1]) + across @ rows.transpose(0, 2, 1)
        whole = self.whole - across.transpose(0, 2, 1) @ np.linalg.solve(inner, across)
        return Left(0.5 * (whole + whole.transpose(0, 2, 1)), self.towards)

    @property
    def _given(self) -> FloatArray:
        """The covariance that is left where the target is known."""
        across = self.towards @ self.whole
        size = np.sqrt(np.einsum("dtk,dtk->dt", across, self.towards).clip(np.finfo(np.float64).tiny))
        across = across / size[..., None]
        inner = across @ (self.towards / size[..., None]).transpose(0, 2, 1)
        return np.asarray(
            self.whole - across.transpose(0, 2, 1) @ np.linalg.pinv(inner, DEPENDENT, hermitian=True) @ across
        )

    @property
    def sds(self) -> FloatArray:
        """Standard deviations (draws, targets) of each part of the target."""
        return np.asarray(np.sqrt(np.einsum("dtk,dkl,dtl->dt", self.towards, self.whole, self.towards).clip(0.0)))


def nothing_measured(towards: FloatArray) -> Left:
    """The posterior itself, for gradients (draws, targets, directions)."""
    draws, _targets, directions = towards.shape
    return Left(np.broadcast_to(np.eye(directions), (draws, directions, directions)).copy(), towards)


def _log_det(rows: FloatArray, covariance: FloatArray) -> FloatArray:
    spread = (rows @ covariance[:, None]) @ rows.transpose(0, 1, 3, 2)
    determinants: FloatArray = np.linalg.slogdet(np.eye(rows.shape[2]) + spread)[1]
    return determinants


def over_draws(gains: FloatArray, known: NDArray[np.bool_]) -> FloatArray:
    """Mean (impacts,) over the draws that can be evaluated; NaN where none can."""
    counts = known.sum(axis=0)
    total = np.where(known, gains, 0.0).sum(axis=0)
    return np.where(counts > 0, total / np.maximum(counts, 1), np.nan)
