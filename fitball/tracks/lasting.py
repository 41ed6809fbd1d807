"""Errors of positions that last over several frames, where none are stated: those of a motion
model, which estimates positions of its own, goes on as before at a bounce and follows it later.

Residuals of a parabola through frames beside the contact are M e, with M = I - H, and e the errors.
Where these are independent and normal, the share q = r'Lr/r'r of products of neighbours, L, has the
mean tr(ML)/n and the mean square (2 tr(MLML) + tr(ML)^2)/(n (n + 2)), n = tr M, whatever their
size: that a fit makes residuals correlate is no alarm.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.values import FloatArray
from fitball.tracks.flight import T1, T2, Impact

# Frames beside the contact in which a motion model has not settled.
_FRAMES = 16
# Fewest frames of a parabola that show how its residuals correlate.
_FEWEST_FRAMES = 6
# A parabola has so many unknowns.
_UNKNOWNS = 3
# Neighbours are nearer in time than this many usual steps.
_MOST_STEPS = 1.5
# Standard errors of the correlation from which on it is none of chance: of 24,000 simulated films
# three had more.
_LEAST_SDS = 3.5
# Correlations of neighbouring errors that are tried.
_CORRELATIONS = np.linspace(0.0, 0.98, 50)


class _Parabola(NamedTuple):
    """A parabola through frames: the residuals of x and of y, M, and L, half a one for neighbours;
    how many frames each is `apart` from each.
    """

    residuals: Annotated[FloatArray, "frames 2"]
    maker: Annotated[FloatArray, "frames frames"]
    neighbours: Annotated[FloatArray, "frames frames"]
    apart: Annotated[FloatArray, "frames frames"]


def lasting_correlation(impacts: Sequence[Impact]) -> float:
    """The correlation of errors of neighbouring frames beside the contacts of impacts, as that of
    an autoregressive process; 0 where chance explains it.
    """
    excess = variance = products = squares = 0.0
    expected = np.zeros((2, _CORRELATIONS.size))
    for parabola in (each for impact in impacts for each in _parabolas(impact)):
        product = parabola.maker @ parabola.neighbours @ parabola.maker
        freedom = len(product) - _UNKNOWNS
        mean = np.trace(product) / freedom
        mean_square = 2.0 * np.sum(product**2) + np.trace(product) ** 2
        for residual in parabola.residuals.T:
            of_neighbours = residual @ parabola.neighbours @ residual
            excess += of_neighbours / (residual @ residual) - mean
            variance += mean_square / (freedom * (freedom + 2.0)) - mean**2
            products += of_neighbours
            squares += residual @ residual
        for k, correlation in enumerate(_CORRELATIONS):
            errors = correlation**parabola.apart
            expected[:, k] += np.sum(product * errors), np.sum(parabola.maker * errors)
    if not excess > _LEAST_SDS * np.sqrt(variance):
        return 0.0
    return float(np.interp(products / squares, expected[0] / expected[1], _CORRELATIONS))


def widening(correlation: float) -> float:
    """By how much larger sds of velocities are where errors of neighbours have a correlation: that
    of a mean over many frames.
    """
    return float(np.sqrt((1.0 + correlation) / (1.0 - correlation)))


def _parabolas(impact: Impact) -> Iterator[_Parabola]:
    """The parabolas of both flights of an impact, where they have frames enough."""
    step = float(np.median(np.diff(impact.t)))
    for side, time in zip(impact.sides(), impact.p[[T1, T2]], strict=True):
        rows = np.flatnonzero(side)
        rows = np.sort(rows[np.argsort(np.abs(impact.t[rows] - time), kind="stable")[:_FRAMES]])
        if rows.size < _FEWEST_FRAMES:
            continue
        t = (impact.t[rows] - impact.t[rows].mean()) / step
        basis, _ = np.linalg.qr(np.vander(t, _UNKNOWNS))
        maker = np.eye(t.size) - basis @ basis.T
        position = impact.position[rows]
        # One that stands still was not measured: its residuals are roundings.
        moves = np.ptp(position, axis=0) > 0.0
        residuals = maker @ position[:, moves]
        if residuals.size:
            apart = np.abs(np.subtract.outer(t, t))
            neighbours = 0.5 * ((apart > 0.0) & (apart < _MOST_STEPS))
            yield _Parabola(residuals, maker, neighbours, apart)
