"""Errors of positions that last over several frames, where none are stated: those of a motion
model, which estimates positions of its own, goes on as before at a bounce and follows it later; or
those of a disc whose felt and mark turn with the ball, and move its edge and its angle.

Residuals of a parabola through frames beside the contact are M e, with M = I - H, and e the errors.
Where these are independent and normal, the share q = r'Lr/r'r of products of neighbours, L, has the
mean tr(ML)/n and the mean square (2 tr(MLML) + tr(ML)^2)/(n (n + 2)), n = tr M, whatever their
size: that a fit makes residuals correlate is no alarm.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.values import FloatArray, IntArray
from fitball.tracks.flight import T1, T2, Impact

# Frames beside the contact in which a motion model has not settled.
_FRAMES = 16
# Unknowns of polynomials; twice as many frames show how residuals correlate.
_PARABOLA = 3
_LINE = 2
# Frames with a lower probability of being no outlier are left out.
_FITTING_PROBABILITY = 0.5
# Angles with residuals of more than so many medians of their sizes are left out.
_OUTLYING_MEDIANS = 5.0
# Neighbours are nearer in time than this many usual steps.
_MOST_STEPS = 1.5
# Standard errors of the correlation from which on it is none of chance: of 24,000 simulated films
# three had more.
_LEAST_SDS = 3.5
# Correlations of neighbouring errors that are tried.
_CORRELATIONS = np.linspace(0.0, 0.98, 50)


class _Piece(NamedTuple):
    """A polynomial through frames of a flight: the residuals of what was measured, M, and L, half a
    one for neighbours; how many frames each is `apart` from each; the number of its `unknowns`.
    """

    residuals: Annotated[FloatArray, "frames columns"]
    maker: Annotated[FloatArray, "frames frames"]
    neighbours: Annotated[FloatArray, "frames frames"]
    apart: Annotated[FloatArray, "frames frames"]
    unknowns: int


def lasting_correlation(impacts: Sequence[Impact]) -> float:
    """The correlation of errors of neighbouring frames beside the contacts of impacts, as that of
    an autoregressive process; 0 where chance explains it.
    """
    return _correlation((piece for impact in impacts for piece in _parabolas(impact)), 1.0)


def widening(correlation: float) -> float:
    """By how much larger sds of velocities are where errors of neighbours have a correlation: that
    of a mean over many frames.
    """
    return float(np.sqrt((1.0 + correlation) / (1.0 - correlation)))


def widening_of_discs(impacts: Sequence[Impact]) -> float:
    """By how much larger sds are of impacts whose discs were measured, since errors last while felt
    and mark turn: as a smooth function of the time, with the correlation c^(k^2) of frames that are
    k apart. It is 1 where chance explains them.
    """
    correlation = _correlation((piece for impact in impacts for piece in _flights(impact)), 2.0)
    apart = np.arange(1, _FRAMES)
    return float(np.sqrt(1.0 + 2.0 * np.sum(correlation ** (apart**2.0))))


def widening_of_spins(impacts: Sequence[Impact]) -> float:
    """By how much larger sds of spins are since errors of the mark's angle last, as those of an
    autoregressive process; 1 where chance explains that, or no impact has sure spins.
    """
    marked = [impact for impact in impacts if impact.sure_pair]
    return widening(_correlation((piece for impact in marked for piece in _turning(impact)), 1.0))


def _correlation(pieces: Iterable[_Piece], power: float) -> float:
    """The correlation c of errors of neighbours in pieces of flights, where that of frames that are
    k apart is c^(k^power); 0 where chance explains it.
    """
    excess = variance = products = squares = 0.0
    expected = np.zeros((2, _CORRELATIONS.size))
    for piece in pieces:
        product = piece.maker @ piece.neighbours @ piece.maker
        freedom = len(product) - piece.unknowns
        mean = np.trace(product) / freedom
        mean_square = 2.0 * np.sum(product**2) + np.trace(product) ** 2
        for residual in piece.residuals.T:
            of_neighbours = residual @ piece.neighbours @ residual
            excess += of_neighbours / (residual @ residual) - mean
            variance += mean_square / (freedom * (freedom + 2.0)) - mean**2
            products += of_neighbours
            squares += residual @ residual
        for k, correlation in enumerate(_CORRELATIONS):
            errors = correlation ** (piece.apart**power)
            expected[:, k] += np.sum(product * errors), np.sum(piece.maker * errors)
    if not excess > _LEAST_SDS * np.sqrt(variance):
        return 0.0
    return float(np.interp(products / squares, expected[0] / expected[1], _CORRELATIONS))


def _parabolas(impact: Impact) -> Iterator[_Piece]:
    """Parabolas through the frames of both flights beside the contact of an impact."""
    for side, time in zip(impact.sides(), impact.p[[T1, T2]], strict=True):
        rows = np.flatnonzero(side)
        nearest = np.argsort(np.abs(impact.t[rows] - time), kind="stable")[:_FRAMES]
        rows = np.sort(rows[nearest])
        yield from _piece(impact, rows, impact.position[rows], _PARABOLA)


def _flights(impact: Impact) -> Iterator[_Piece]:
    """Parabolas through the residuals of both flights of an impact, outliers left out."""
    for side in impact.sides():
        rows = np.flatnonzero(side & (impact.weight > _FITTING_PROBABILITY))
        yield from _piece(impact, rows, impact.residual[rows], _PARABOLA)


def _turning(impact: Impact) -> Iterator[_Piece]:
    """Lines through the residuals of the angles of both flights of an impact, outliers left out."""
    residuals = impact.angle_residuals()
    usual = np.nanmedian(np.abs(residuals))
    good = np.abs(residuals) < _OUTLYING_MEDIANS * usual
    for side in impact.turning():
        rows = np.flatnonzero(side & good)
        yield from _piece(impact, rows, residuals[rows, None], _LINE)


def _piece(
    impact: Impact,
    rows: IntArray,
    measured: Annotated[FloatArray, "frames columns"],
    unknowns: int,
) -> Iterator[_Piece]:
    """The piece of `rows` of an impact, whose polynomial has these `unknowns`; none where frames
    are too few, or nothing moves.
    """
    if rows.size < 2 * unknowns:
        return
    step = float(np.median(np.diff(impact.t)))
    t = (impact.t[rows] - impact.t[rows].mean()) / step
    basis, _ = np.linalg.qr(np.vander(t, unknowns))
    maker = np.eye(t.size) - basis @ basis.T
    # What stands still was not measured: its residuals are roundings.
    residuals = maker @ measured[:, np.ptp(measured, axis=0) > 0.0]
    if residuals.size:
        apart = np.abs(np.subtract.outer(t, t))
        neighbours = 0.5 * ((apart > 0.0) & (apart < _MOST_STEPS))
        yield _Piece(residuals, maker, neighbours, apart, unknowns)
