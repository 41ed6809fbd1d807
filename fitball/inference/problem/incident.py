"""Errors of the incident state: it was measured too, and what it leaves open shows in the rebound.

The true incident state is marginalised with a flat prior. To first order, with `J` the exact Jacobian of the bounce,
the measured outputs of an impact then scatter about the prediction with covariance `diag(sd^2) + J S J^T`, `S` that
of the incident state (Fuller 1987, section 3.1). They are whitened one after the other (Cholesky), so that heavy
tails and scores by column keep their meaning: each given those before it.
"""

from __future__ import annotations

from collections.abc import Sequence
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


def spread_by_input(slopes: FloatArray, covariance: FloatArray) -> FloatArray:
    """Covariance (draws, impacts, observables, observables) that the incident errors alone give the observables.

    `slopes` (draws, impacts, observables, 3); `covariance` (impacts, 3, 3), or any that broadcasts to
    (draws, impacts, 3, 3).
    """
    spread: FloatArray = np.einsum("...ck,...kl,...ml->...cm", slopes, covariance, slopes, optimize=True)
    return spread


def whitened(deviations: Sequence[FloatArray], spreads: Sequence[FloatArray], shared: FloatArray) -> tuple[
    list[FloatArray], list[FloatArray]
]:  # fmt: skip
    """Standardised deviations (draws, impacts) of each observable given those before it, and their conditional sds.

    `deviations` and `spreads` are (draws, impacts) per observable; `shared` (draws, impacts, observables,
    observables).
    """
    count = len(deviations)
    lower: list[list[FloatArray]] = []
    standardised: list[FloatArray] = []
    sds: list[FloatArray] = []
    for i in range(count):
        row: list[FloatArray] = []
        for j in range(i):
            known = np.sum([row[k] * lower[j][k] for k in range(j)], axis=0)
            row.append((shared[..., i, j] - known) / sds[j])
        # Never below the observable's own noise: the rest is a covariance, whose Schur complement rounding may spoil.
        rest = shared[..., i, i] - np.sum([entry * entry for entry in row], axis=0)
        sds.append(np.sqrt(spreads[i] * spreads[i] + np.maximum(rest, 0.0)))
        explained = np.sum([row[k] * standardised[k] for k in range(i)], axis=0)
        standardised.append((deviations[i] - explained) / sds[i])
        lower.append(row)
    return standardised, sds
