"""Bounces of a track and their frames; the check of gravity for rate, scale and direction."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import sqrt

import numpy as np

from fitball.base.itf import GRAVITY
from fitball.tracks.flight import C1, C2, DRAG, Impact
from fitball.tracks.types import Filming, Track

# How far [s] frames are used from an impact, over how long [s] heights are smoothed by medians to
# find it.
_REACH = 0.15
_SMOOTH = 4e-3
# A ball that bounces falls and rises again by so many radii at least, and comes within so many
# radii, and steps between frames, of the lowest place.
_DEEP = 0.3
_NEAR = 0.5
_NEAR_STEPS = 2.5
_FEWEST_FRAMES = 7
# Gravity off by this factor is no air and no scale that a camera has. Drag and lift coefficients
# reach so far beyond what is taken for them, over both sides; sds of the heights; how many medians
# outliers are off.
FACTOR = 2.5
_DRAG_OFF = 0.25
_LIFT_OFF = 0.35
_SDS = 3.0
_OUTLYING = 4.0


def impacts_of(track: Track, known: Filming) -> tuple[list[Impact], str]:
    """The impacts of a track, in order of time, or the reason why it has none."""
    # Half a second, which only tracks need.
    from scipy.ndimage import median_filter
    from scipy.signal import find_peaks

    t = track.time
    y = track.y
    radius = known.ball.radius
    if t.size < _FEWEST_FRAMES:
        return (
            [],
            f"{t.size} frames with a position; an impact needs at least {_FEWEST_FRAMES}, three "
            "on each side",
        )
    step = float(np.median(np.diff(t)))
    size = min(max(3, int(_SMOOTH / step) | 1), t.size | 1)
    smooth = median_filter(y, size=size, mode="nearest")
    # Outliers near a contact make more than one low place.
    lows, _ = find_peaks(
        -smooth,
        prominence=_DEEP * radius,
        distance=max(1.0, 2.0 * known.contact[2] / step),
    )
    near = _NEAR * radius + _NEAR_STEPS * float(np.median(np.abs(np.diff(smooth))))
    lows = lows[smooth[lows] < smooth.min() + near]
    if not lows.size:
        return (
            [],
            f"no bounce: the height has no minimum from frame {track.frame[0]} to frame "
            f"{track.frame[-1]}",
        )
    found = []
    for number, low in enumerate(lows.tolist()):
        ends = [-np.inf, *(t[lows] + known.contact[2]), np.inf]
        around = np.flatnonzero(
            (t > ends[number]) & (t < ends[number + 2] - 2.0 * known.contact[2])
        )
        rows = around[np.abs(t[around] - t[low]) < _REACH]
        early = track.x[rows[rows <= low]]
        # Most steps before the impact.
        lag = max(1, early.size // 2)
        sign = -1.0 if early.size > lag and np.median(early[lag:] - early[:-lag]) < 0.0 else 1.0
        name = track.id if lows.size == 1 else f"{track.id}-{number + 1}"
        place = np.column_stack([sign * track.x[rows], y[rows]])
        phi = -sign * track.angle[rows]
        found.append(
            Impact(name, track, rows, around, float(t[low]), t[rows] - t[low], place, phi, sign)
        )
    return found, ""


def wrong_gravity(impacts: Iterable[Impact], known: Filming) -> str:
    """What is wrong with rate, scale or direction of a film whose balls do not fall as on earth, by
    parabolas through heights away from the contact; "" where they may. Off by a factor only: a fit
    shows smaller errors.
    """
    seen: list[tuple[float, float, float, float]] = []
    for one in [one for one in impacts if one.around.size > _FEWEST_FRAMES]:
        # At a wrong rate a flight lasts longer, or shorter, than frames are used.
        time, x, y = (
            values[one.around] for values in (one.track.time - one.origin, one.track.x, one.track.y)
        )
        step = float(np.median(np.diff(time)))
        for length, sign in ((-time[0], -1.0), (time[-1], 1.0)):
            away = max(min(known.contact[2], length / 3.0), 3.5 * step)
            side = np.flatnonzero(sign * time > away)
            if side.size < _FEWEST_FRAMES:
                continue
            rest = np.abs(y[side] - np.polyval(np.polyfit(time[side], y[side], 2), time[side]))
            side = side[rest <= _OUTLYING * np.median(rest)]
            t = time[side] - time[side].mean()
            curve, covariance = np.polyfit(t, y[side], 2, cov=True)
            v_x = float(np.polyfit(t, x[side], 1)[0])
            v_y = float(curve[1])
            pull = known.k * float(np.hypot(v_x, v_y))
            value = -2.0 * float(curve[0]) - pull * known.drag[0] * v_y
            reach = 2.0 * _SDS * float(np.sqrt(covariance[0, 0])) + pull * (
                _LIFT_OFF * abs(v_x) + _DRAG_OFF * abs(v_y)
            )
            seen.append((value - reach, value + reach, value, 1.0 / step))
    if not seen:
        return ""
    low, high, value, rate = np.median(seen, axis=0).tolist()
    return "" if low < FACTOR * GRAVITY and high > GRAVITY / FACTOR else of_gravity(value, rate)


def of_gravity(value: float, rate: float) -> str:
    """What a gravity [m/s^2] that is off by a factor says of films at so many frames a second."""
    read = f"g comes out as {value:.3g} m/s^2 at {rate:.4g} frames/s, expected 9.8"
    if value <= 0.0:
        return (
            f'{read}: y may grow downwards (y = "down" in [camera]), or the track shows no flight'
        )
    meant = f"the camera took about {rate * sqrt(GRAVITY / value):.0f} frames/s"
    scale = f"lengths are off by a factor of {value / GRAVITY:.2g}"
    return (
        f"{read}: {meant}, or {scale}; state the rate of the camera, not that of playback "
        "(--fps), or the scale"
    )


def gravity(impacts: Sequence[Impact]) -> tuple[float, float]:
    """Gravity [m/s^2] that fitted flights show, and its sd: one step of Gauss and Newton from the
    usual value. What is unknown of lift and drag may be common to all impacts, and counts as such.
    """
    score = information = 0.0
    common = np.zeros(3)
    unknown = [C1, C2, DRAG]
    for one in impacts:
        info = one.info.sum(axis=0)
        falls = info[-1, :-1]
        matrix = info[:-1, :-1] + one.precision
        moved = np.linalg.solve(matrix, falls)
        score += one.pull
        information += info[-1, -1] - float(falls @ moved)
        prior = one.precision[np.ix_(unknown, unknown)]
        common += prior @ moved[unknown] * np.sqrt(np.diagonal(np.linalg.inv(prior)))
    if not information > 0.0:
        return float("nan"), float("nan")
    return GRAVITY + score / information, sqrt(
        1.0 / information + float(np.sum((common / information) ** 2))
    )
