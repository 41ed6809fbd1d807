"""Bounces of a track and their frames; the check of gravity for rate, scale and direction."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np

from fitball.base.itf import GRAVITY
from fitball.base.values import FloatArray, IntArray
from fitball.data.scene import CameraSection
from fitball.tracks.flight import (
    BEND,
    DRAG,
    FLIGHT_UNKNOWNS,
    GRAVITY_FITTED,
    LIFT_1,
    LIFT_2,
    ROW_DELAY,
    Impact,
)
from fitball.tracks.types import FilmAssumptions, Track

# How far [s] from an impact frames are used: beyond it the series of a flight is too coarse
# (`flight.path`).
_REACH_TIME = 0.15
# Heights are smoothed by medians over so long [s] to find an impact: about a contact.
_SMOOTHING_TIME = 4e-3
# A ball that bounces falls and rises again by at least so many radii; noise and a ball that rolls
# do not.
_LEAST_DEPTH = 0.3
# A bounce is at most so many radii, and so many steps of height between frames, above the lowest
# place of the track: all are on one court.
_NEAR_RADII = 0.5
_NEAR_STEPS = 2.5
# Fewest frames of a track with an impact: three on each side, and one in contact.
FEWEST_FRAMES = 7
# Gravity that is off by this factor is a mistake of rate or scale: neither air nor errors of a
# camera explain it.
GRAVITY_FACTOR = 2.5
# How far drag and lift coefficients may be off the values that are assumed, to either side.
_MOST_DRAG_ERROR = 0.25
_MOST_LIFT_ERROR = 0.35
# Standard errors by which the curvature of heights may be off.
_CURVATURE_SDS = 3.0
# Heights that are off a parabola by more than this many medians of residuals are outliers.
_OUTLYING_MEDIANS = 4.0


class Gravity(NamedTuple):
    """Gravity [m/s^2] as flights show it, with the sds of frames and of what all flights share."""

    value: float
    own_sd: float
    shared_sd: float

    @property
    def sd(self) -> float:
        """The sd of gravity."""
        return float(np.hypot(self.own_sd, self.shared_sd))


# Gravity that no flight shows.
UNSEEN_GRAVITY = Gravity(np.nan, np.nan, np.nan)


class _Fall(NamedTuple):
    """The least and most gravity [m/s^2] that a flight allows, its best value, and the rate of its
    frames [1/s].
    """

    low: float
    high: float
    value: float
    rate: float


def impacts_of_track(track: Track, assumed: FilmAssumptions) -> tuple[list[Impact], str]:
    """The impacts of a track in order of time, and the reason why it has none, "" where it has."""
    t = track.time
    if t.size < FEWEST_FRAMES:
        reason = (
            f"{t.size} frames with a position; an impact needs at least {FEWEST_FRAMES}, three "
            "on each side"
        )
        return [], reason
    lows = lowest_frames(track, assumed)
    if not lows.size:
        reason = (
            f"no bounce: the height has no minimum from frame {track.frame[0]} to frame "
            f"{track.frame[-1]}"
        )
        return [], reason
    longest = assumed.contact.most
    ends = [-np.inf, *(t[lows] + longest), np.inf]
    impacts = []
    for number, low in enumerate(lows.tolist()):
        name = track.id if lows.size == 1 else f"{track.id}-{number + 1}"
        within = (t > ends[number]) & (t < ends[number + 2] - 2.0 * longest)
        impacts.append(_impact_at(low, np.flatnonzero(within), name, track))
    return impacts, ""


def lowest_frames(track: Track, assumed: FilmAssumptions) -> IntArray:
    """Indices (impacts,) of the frames in which the ball is lowest."""
    # These take half a second to import, which only tracks need.
    from scipy.ndimage import median_filter
    from scipy.signal import find_peaks

    count = track.time.size
    radius = assumed.ball.radius
    step = float(np.median(np.diff(track.time)))
    size = min(max(3, int(_SMOOTHING_TIME / step) | 1), count | 1)
    smooth = median_filter(track.y, size=size, mode="nearest")
    # Outliers near a contact make more than one low place.
    apart = max(1.0, 2.0 * assumed.contact.most / step)
    lows, _ = find_peaks(-smooth, prominence=_LEAST_DEPTH * radius, distance=apart)
    near = _NEAR_RADII * radius + _NEAR_STEPS * float(np.median(np.abs(np.diff(smooth))))
    return np.asarray(lows[smooth[lows] < smooth.min() + near])


def _impact_at(low: int, around: IntArray, name: str, track: Track) -> Impact:
    """An impact, not yet fitted, at the lowest frame `low` of the flights `around` it."""
    t = track.time
    rows = around[np.abs(t[around] - t[low]) < _REACH_TIME]
    early = track.x[rows[rows <= low]]
    # The direction of most steps before the impact.
    lag = max(1, early.size // 2)
    leftward = early.size > lag and np.median(early[lag:] - early[:-lag]) < 0.0
    sign = -1.0 if leftward else 1.0
    return Impact(
        name,
        track,
        rows,
        around,
        origin=float(t[low]),
        t=t[rows] - t[low],
        position=np.column_stack([sign * track.x[rows], track.y[rows]]),
        phi=-sign * track.angle[rows],
        sign=sign,
    )


def wrong_gravity(
    impacts: Iterable[Impact],
    assumed: FilmAssumptions,
    camera: CameraSection,
) -> str:
    """What is wrong with rate, scale or direction of a film whose balls do not fall as on earth; ""
    where they may. Gravity is that of parabolas through heights away from the contact. Only errors
    by a factor are refused: a fit shows smaller ones.
    """
    falls = [fall for impact in impacts for fall in _falls_of(impact, assumed)]
    if not falls:
        return ""
    low, high, value, rate = np.median(falls, axis=0).tolist()
    if low < GRAVITY_FACTOR * GRAVITY and high > GRAVITY / GRAVITY_FACTOR:
        return ""
    return gravity_words(value, rate, camera)


def _falls_of(impact: Impact, assumed: FilmAssumptions) -> Iterator[_Fall]:
    """The gravity that both flights of an impact show, where they have frames enough."""
    around = impact.around
    if around.size <= FEWEST_FRAMES:
        return
    # At a wrong rate a flight lasts longer, or shorter, than frames are used.
    time = (impact.track.time - impact.origin)[around]
    x = impact.track.x[around]
    y = impact.track.y[around]
    step = float(np.median(np.diff(time)))
    for length, sign in ((-time[0], -1.0), (time[-1], 1.0)):
        away = max(min(assumed.contact.most, length / 3.0), 3.5 * step)
        side = np.flatnonzero(sign * time > away)
        if side.size >= FEWEST_FRAMES:
            yield _fall(time[side], x[side], y[side], step, assumed)


def _fall(
    time: FloatArray,
    x: FloatArray,
    y: FloatArray,
    step: float,
    assumed: FilmAssumptions,
) -> _Fall:
    """The gravity that one flight shows, from places (frames,) [m] at times [s] that are a `step`
    apart.
    """
    parabola = np.polyfit(time, y, 2)
    rest = np.abs(y - np.polyval(parabola, time))
    good = rest <= _OUTLYING_MEDIANS * np.median(rest)
    t = time[good] - time[good].mean()
    curve, covariance = np.polyfit(t, y[good], 2, cov=True)
    v_x = float(np.polyfit(t, x[good], 1)[0])
    v_y = float(curve[1])
    pull = assumed.k * float(np.hypot(v_x, v_y))
    value = -2.0 * float(curve[0]) - pull * assumed.drag.value * v_y
    by_air = pull * (_MOST_LIFT_ERROR * abs(v_x) + _MOST_DRAG_ERROR * abs(v_y))
    reach = 2.0 * _CURVATURE_SDS * float(np.sqrt(covariance[0, 0])) + by_air
    return _Fall(value - reach, value + reach, value, 1.0 / step)


def other_y(camera: CameraSection) -> str:
    """The direction in which y may grow besides the stated one, as the scene states it."""
    return "up" if camera.y == "down" else "down"


def gravity_words(value: float, rate: float, camera: CameraSection) -> str:
    """The sentence that refuses films with a gravity `value` [m/s^2] at `rate` [frames/s]."""
    read = f"g comes out as {value:.3g} m/s^2 at {rate:.4g} frames/s, expected 9.8"
    if GRAVITY / GRAVITY_FACTOR < -value < GRAVITY_FACTOR * GRAVITY:
        return f'{read}: state y = "{other_y(camera)}" in [camera]'
    if value <= 0.0:
        return f"{read}: the track shows no flight"
    meant = f"the camera took about {rate * sqrt(GRAVITY / value):.0f} frames/s"
    scale = f"lengths are off by a factor of {value / GRAVITY:.2g}"
    return (
        f"{read}: {meant}, or {scale}; state the rate of the camera, not that of playback "
        "(--fps), or the scale"
    )


def gravity_of(
    impacts: Sequence[Impact],
    widening: float = 1.0,
    row_delay_sd: float = 0.0,
) -> Gravity:
    """Gravity by fitted flights; NaN where no flight shows it. It is one step of Gauss and Newton
    from standard gravity. Errors of lift, drag and row delay, of the sd `row_delay_sd` [s/m], count
    as common to all impacts; those of frames are `widening` times as large as if they were
    independent.
    """
    score = 0.0
    information = 0.0
    by_delay = 0.0
    common = np.zeros(3)
    unknown = [LIFT_1, LIFT_2, DRAG]
    for impact in impacts:
        info = impact.info.sum(axis=0)
        flown = slice(FLIGHT_UNKNOWNS)
        falls = info[GRAVITY_FITTED, flown]
        matrix = info[flown, flown] + impact.precision[flown, flown]
        moved = np.linalg.solve(matrix, falls)
        # As if the paths had no bend of their own.
        bend = info[BEND, GRAVITY_FITTED] - float(moved @ info[flown, BEND])
        score += impact.pull + impact.p[BEND] * bend
        information += info[GRAVITY_FITTED, GRAVITY_FITTED] - float(falls @ moved)
        by_delay += info[GRAVITY_FITTED, ROW_DELAY] - float(moved @ info[flown, ROW_DELAY])
        prior = impact.precision[np.ix_(unknown, unknown)]
        prior_sds = np.sqrt(np.diagonal(np.linalg.inv(prior)))
        common += prior @ moved[unknown] * prior_sds
    if not information > 0.0:
        return UNSEEN_GRAVITY
    shared = np.append(common, by_delay * row_delay_sd) / information
    return Gravity(
        value=GRAVITY + score / information,
        own_sd=widening / sqrt(information),
        shared_sd=float(np.linalg.norm(shared)),
    )
