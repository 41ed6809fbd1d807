"""A dozen impacts with their rebounds to full precision, for checking a port of the model."""

from __future__ import annotations

import numpy as np

from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.results import Golden
from fitball.values import Impacts

COUNT = 12


def golden_impacts(impacts: Impacts) -> Impacts:
    """Half of them spread over the table; the others inside its range with spins from back to top."""
    rows = np.unique(np.linspace(0, len(impacts) - 1, min(COUNT // 2, len(impacts))).astype(int))
    count = COUNT - rows.size
    share = (np.arange(count) + 0.5) / count

    def across(column: np.ndarray, order: np.ndarray) -> np.ndarray:
        return np.concatenate([column[rows], column.min() + (column.max() - column.min()) * order])

    # Golden-ratio steps cover the square evenly without a random generator.
    other = np.modf(share * count * 0.6180339887498949)[0]
    v_x1, v_y1 = across(impacts.v_x1, other), across(impacts.v_y1, share)
    omega = np.concatenate([impacts.omega_1[rows], np.linspace(-200.0, 400.0, count)])
    if np.ptp(impacts.v_x1) + np.max(np.abs(impacts.v_x1)) <= 0.0:
        omega = np.zeros(COUNT)
    return Impacts(v_x1, v_y1, omega, None if impacts.cor is None else across(impacts.cor, share))


def golden(fitted: FittedModel, impacts: Impacts) -> Golden:
    """Rebounds of those impacts at the point estimate; impacts the model cannot evaluate are left out."""
    chosen = golden_impacts(impacts)
    rebound = fitted.rebound(chosen)
    kept = np.flatnonzero(rebound.status[0] == 0)
    cor = None if chosen.cor is None else chosen.cor[kept]
    kept_impacts = Impacts(chosen.v_x1[kept], chosen.v_y1[kept], chosen.omega_1[kept], cor)
    names = dict(zip(fitted.names, (float(value) for value in fitted.point), strict=True))
    return Golden(names, kept_impacts, rebound.each(lambda array: array[0][kept]))
