"""All impacts of a session: common noise and drag, spins, court height."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from fitball.base.values import FloatArray
from fitball.data.scene import CameraSection, ValueWithSd
from fitball.tracks.find import UNSEEN_GRAVITY, Gravity
from fitball.tracks.flight import (
    DRAG,
    FIRST_NOISE,
    T1,
    T2,
    UNKNOWNS,
    VY1,
    VY2,
    Impact,
    fit,
    start,
)
from fitball.tracks.spins import pairs_of, weights
from fitball.tracks.types import FilmAssumptions

# Noise of angles [rad] before it is measured (three degrees).
_FIRST_ANGLE_NOISE = 0.05
# Share of outliers of positions before it is measured: one frame in fifty.
_FIRST_OUTLIERS = 0.02
# Share of outliers of angles before it is measured: marks are harder to see than balls.
_FIRST_ANGLE_OUTLIERS = 0.05
# Frames as which these first shares count, so that short films keep them.
_FRAMES_OF_FIRST_OUTLIERS = 50.0
# Least and most share of outliers: with none every frame would have to fit, and with more it is
# the flights that do not fit.
_OUTLIER_RANGE = (2e-3, 0.3)
# Least noise of positions [m], so that frames without errors have finite weights.
_LEAST_NOISE = 1e-7
# Least noise of angles [rad], for the same reason.
_LEAST_ANGLE_NOISE = 1e-4
# Frames of the session's noise to which that of a track is drawn, where tracks are too few to show
# how much noise differs between them.
_USUAL_SHARED_FRAMES = 6.0
# Fewest tracks that show how much noise differs between them.
_FEWEST_TRACKS = 10
# Tracks with fewer degrees of freedom do not count for that.
_LEAST_FREEDOM = 2.0
# Most frames of the session's noise to which that of a track is drawn; tracks are then equal.
_MOST_SHARED_FRAMES = 1e3
# Sd of drag from shot to shot (Cross and Lindsey 2014).
_DRAG_SHOT_SD = 0.024
# Passes over a session, in which noise, drag and spins settle.
PASSES = 5
# Passes after which spins are looked for: twice as their noise is renewed, and at the end.
_SPIN_PASSES = (1, 2, 4)
# Factors of errors in the first sweeps, in which outliers are still among the frames.
_WIDENING = (8.0, 4.0, 2.0)
# The court is first taken so far [m] above the lowest frames, in which the ball is pressed in.
_FIRST_DEPTH = 0.01
# Most steps to the height of a court.
_HEIGHT_STEPS = 4
# Steps end when the height moves by less than this [m], far below its error.
_HEIGHT_SETTLED = 1e-5
# By how much less time [s/m] passes between the flights if the court is higher, where no impact
# shows it: that of 10 m/s before and after.
_USUAL_SLOPE = 0.2


@dataclass
class Session:
    """The impacts of a session and what they have in common. `height` [m] of the centre at contact
    has an sd where it was found from contacts, else 0. `noise` [m] is that of x and of y,
    `angle_noise` [rad] that of the mark; `outliers` and `angle_outliers` are shares. `correlation`
    is that of errors of neighbouring frames, 0 where chance explains it.
    """

    impacts: list[Impact]
    assumed: FilmAssumptions
    height: float
    height_sd: float = 0.0
    noise: Annotated[FloatArray, "2"] = field(default_factory=lambda: np.full(2, FIRST_NOISE))
    angle_noise: float = _FIRST_ANGLE_NOISE
    outliers: float = _FIRST_OUTLIERS
    angle_outliers: float = _FIRST_ANGLE_OUTLIERS
    gravity: Gravity = UNSEEN_GRAVITY
    correlation: float = 0.0

    @property
    def good(self) -> list[Impact]:
        """The impacts that have not failed."""
        return [impact for impact in self.impacts if not impact.failed]

    @property
    def vertical(self) -> bool:
        """Whether heights are the only coordinate of all tracks."""
        return all(impact.track.vertical for impact in self.impacts)


def session_of(
    impacts: list[Impact],
    assumed: FilmAssumptions,
    camera: CameraSection,
) -> Session:
    """A session of impacts with the height of its court: as stated, or with an sd the height at
    which the median time between the flights is the usual one.
    """
    session = Session(impacts, assumed, assumed.ball.radius)
    if camera.court is not None:
        court = camera.court.value if isinstance(camera.court, ValueWithSd) else camera.court
        session.height += -court if camera.y == "down" else court
        return session
    # The second lowest frame: the lowest may be an outlier.
    lowest = [np.sort(impact.position[:, 1])[:2].max() for impact in impacts]
    session.height = float(np.median(lowest)) + _FIRST_DEPTH
    usual, least, most = assumed.contact
    slope = _USUAL_SLOPE
    for _ in range(_HEIGHT_STEPS):
        fit_pass(session, 0)
        if not session.good:
            break
        p = np.array([impact.p for impact in session.good])
        slope = float(np.median(1.0 / p[:, VY2] - 1.0 / p[:, VY1]))
        # Of a higher court the flights end earlier and begin later.
        step = (usual - float(np.median(p[:, T2] - p[:, T1]))) / slope
        session.height += step
        if abs(step) < _HEIGHT_SETTLED:
            break
    session.height_sd = 0.25 * (most - least) / slope
    return session


def fit_pass(session: Session, number: int) -> None:
    """Fit all impacts of a session with the noise, drag and spins of the pass before, then renew
    these. Pass `number` 0 begins anew.
    """
    assumed = session.assumed
    first = number == 0
    for impact in session.impacts:
        if first:
            impact.failed = ""
            impact.pairs = ()
            start(impact, assumed, session.height)
            drag_sd = np.hypot(assumed.drag.sd, _DRAG_SHOT_SD)
            impact.set_prior(assumed, assumed.drag.value, drag_sd)
        if not impact.failed:
            fit(impact, assumed, session.height, session.outliers, _WIDENING if first else ())
    if not session.good:
        return
    _renew_noise(session)
    _renew_spins(session, number)
    if number + 1 == PASSES:
        return
    for impact, (drag, sd) in zip(session.good, _drags(session), strict=True):
        impact.set_prior(assumed, drag, sd)


def _renew_spins(session: Session, number: int) -> None:
    """Look for spins in a pass that does, then renew the noise of angles by those that are sure."""
    sure = list[Impact]()
    for impact in session.good:
        if number in _SPIN_PASSES and np.isfinite(impact.phi).any():
            impact.pairs = pairs_of(
                impact, session.assumed, session.angle_noise, session.angle_outliers
            )
            if impact.sure_pair:
                sure.append(impact)
    _renew_angle_noise(session, sure)


def _renew_noise(session: Session) -> None:
    """Renew the noise of a session and of each of its tracks, and the share of outliers. With s
    that of the session, the variance of a track is (n s^2 + sum w r^2)/(n + its degrees of
    freedom). How far tracks differ determines n (Smyth, Stat. Appl. Genet. Mol. Biol. 3 (2004) 3).
    """
    good = session.good
    weight = np.array([np.nansum(impact.weight) for impact in good])
    squares = np.array(
        [np.nansum(impact.weight[:, None] * impact.residual**2, axis=0) for impact in good]
    )
    spent = np.array([_freedom_spent(impact) for impact in good])
    free = np.maximum(weight[:, None] - spent, 0.0)
    mean = squares.sum(axis=0) / np.maximum(free.sum(axis=0), 1.0)
    pooled = np.maximum(mean, _LEAST_NOISE**2)
    for axis in (0, 1):
        count = _shared_frames(squares[:, axis], free[:, axis])
        variance = (count * pooled[axis] + squares[:, axis]) / (count + free[:, axis])
        for impact, of_track in zip(good, variance.tolist(), strict=True):
            impact.sigma[axis] = np.sqrt(of_track)
            if impact.track.vertical:
                # Heights alone decide which frames are outliers.
                impact.sigma[0] = impact.sigma[1]
    session.noise = np.sqrt(pooled)
    frames = sum(np.isfinite(impact.weight).sum() for impact in good)
    session.outliers = _share(frames - weight.sum(), frames, _FIRST_OUTLIERS)


def _freedom_spent(impact: Impact) -> list[float]:
    """Degrees of freedom that the fit of an impact takes from x and from y."""
    of_unknowns = impact.info[:, :UNKNOWNS, :UNKNOWNS]
    return [np.sum(impact.covariance * info) for info in of_unknowns]


def _share(outliers: float, frames: float, usual: float) -> float:
    """Share of outliers among frames, drawn to the usual one."""
    share = (outliers + _FRAMES_OF_FIRST_OUTLIERS * usual) / (frames + _FRAMES_OF_FIRST_OUTLIERS)
    return float(np.clip(share, *_OUTLIER_RANGE))


def _shared_frames(squares: FloatArray, free: FloatArray) -> float:
    """Degrees of freedom of the distribution of variances over tracks, by the moments of their
    logarithms, from sums of squares and degrees of freedom (tracks,).
    """
    from scipy.optimize import brentq
    from scipy.special import digamma, polygamma

    use = (free > _LEAST_FREEDOM) & (squares > 0.0)
    if use.sum() < _FEWEST_TRACKS:
        return _USUAL_SHARED_FRAMES
    half = free[use] / 2.0
    logs = np.log(squares[use] / free[use]) - digamma(half) + np.log(half)
    excess = float(np.var(logs, ddof=1) - np.mean(polygamma(1, half)))
    if excess <= polygamma(1, _MOST_SHARED_FRAMES / 2.0):
        return _MOST_SHARED_FRAMES
    # Trigamma falls; half a degree of freedom is the least.
    most_excess = min(excess, float(polygamma(1, 0.5)))
    root = brentq(lambda count: polygamma(1, count) - most_excess, 0.5, _MOST_SHARED_FRAMES / 2.0)
    return float(2.0 * root)


def _drags(session: Session) -> list[tuple[float, float]]:
    """Mean and sd of the prior of each impact's drag: the drag of the session by all other
    impacts.
    """
    good = session.good
    mean, sd = session.assumed.drag
    drag = np.array([impact.p[DRAG] for impact in good])
    variance = np.array([impact.covariance[DRAG, DRAG] for impact in good])
    prior = np.array([impact.prior[DRAG] for impact in good])
    prior_precision = np.array([impact.precision[DRAG, DRAG] for impact in good])
    # What the frames of each impact show of its drag, without its prior.
    precision = np.maximum(1.0 / variance - prior_precision, 1e-9)
    measured = (drag / variance - prior * prior_precision) / precision
    weight = 1.0 / (1.0 / precision + _DRAG_SHOT_SD**2)
    others = weight.sum() - weight + sd**-2.0
    means = (np.sum(weight * measured) - weight * measured + mean * sd**-2.0) / others
    sds = np.sqrt(1.0 / others + _DRAG_SHOT_SD**2)
    return [*zip(means.tolist(), sds.tolist(), strict=True)]


def _renew_angle_noise(session: Session, sure: Sequence[Impact]) -> None:
    """Renew the noise of angles, one for the session, and the share of their outliers, by impacts
    whose spins are sure; an impact has four fitted numbers.
    """
    weight = 0.0
    square = 0.0
    frames = 0.0
    for impact in sure:
        residuals = impact.angle_residuals()
        residuals = residuals[np.isfinite(residuals)]
        fold = impact.track.fold
        good, _ = weights(residuals, fold, session.angle_noise, session.angle_outliers)
        weight = weight + good.sum() - 4.0
        square = square + float(np.sum(good * residuals**2))
        frames = frames + residuals.size
    if weight >= 1.0:
        session.angle_noise = max(float(np.sqrt(square / weight)), _LEAST_ANGLE_NOISE)
        outliers = frames - weight - 4.0 * len(sure)
        session.angle_outliers = _share(outliers, frames, _FIRST_ANGLE_OUTLIERS)
