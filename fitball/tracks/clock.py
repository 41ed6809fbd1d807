"""The clock of a clip: frame rate, constant spacing against stamps as written, frames that repeat, playback for
capture rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from fitball.data.cells import refusal
from fitball.tracks.clips import PIXELS, Clip, Reading, frames_named
from fitball.tracks.motion import SURE, Kink, gravity, kink, noise
from fitball.values import FloatArray
from fitball.wording import option, spoken

# Constant spacing is taken where it lowers the noise by a tenth.
LOWER = 0.9
# A frame that moved less than this [px], or share of a usual step where there are no pixels, repeats the one before.
_STILL, _STILL_SHARE = 1e-3, 1e-3
MOST_REPEATED = 1.0 / 3.0
# Rates that agree within this are the same.
_SAME_RATE = 0.02
GRAVITY = 9.80665
# Gravity off by more than this factor is no air and no scale that a camera has.
_FACTOR = 2.5
# Lift coefficients of balls reach this (Cross and Lindsey 2014: 1 / 2.022 at large spin), drag coefficients and
# speeds [m/s] that.
_LIFT, _DRAG, _HIGHEST = 0.5, 0.7, 80.0
_RATES = (24.0, 25.0, 30.0, 50.0, 60.0, 100.0, 120.0, 180.0, 200.0, 240.0, 250.0, 480.0, 500.0, 960.0, 1000.0, 2000.0)


def timed(clips: Sequence[Clip], how: Reading) -> list[Clip]:
    """The clips of a session with times [s], by the stated rate, the stamps, or constant spacing.

    Raises TableError for frames without time or rate, and where a third of the frames repeat the one before.
    """
    return _spaced(_without_repeats([_with_time(clip, how) for clip in clips]))


def _rate(time: FloatArray) -> float:
    return 1.0 / float(np.median(np.diff(time))) if len(time) > 1 else float("nan")


def _with_time(clip: Clip, how: Reading) -> Clip:
    if clip.time is None:
        if how.fps is None:
            raise refusal(
                clip.source,
                f"clip '{clip.id}' has {frames_named(clip.frame)} and no time; expected the frame rate: pass "
                f"{spoken('--fps N', 'fps=N')}, or fps in [camera] of the scene",
            )
        return replace(clip, time=clip.frame / how.fps).noted(f"times are frames at {how.fps:g} frames/s")
    rate = _rate(clip.time)
    if how.fps is None or len(clip) < 2 or abs(how.fps / rate - 1.0) < _SAME_RATE:
        return clip
    count = np.round((clip.time - clip.time[0]) * rate)
    return replace(clip, time=count / how.fps).noted(
        f"times were replaced: {how.fps:g} frames/s as stated, in place of {rate:.4g} frames/s in the file"
    )


def _without_repeats(clips: Sequence[Clip]) -> list[Clip]:
    """The clips without frames that repeat the one before. Raises TableError where a third of all do."""
    repeats = [_repeats(clip) for clip in clips]
    total, count = sum(int(found.sum()) for found in repeats), sum(map(len, clips))
    if total >= MOST_REPEATED * count > 0.0:
        worst = max(range(len(clips)), key=lambda k: repeats[k].mean())
        raise refusal(
            clips[worst].source,
            f"{total} of {count} frames repeat the one before (clip '{clips[worst].id}': "
            f"{frames_named(clips[worst].frame[repeats[worst]])}); expected a new picture in each frame: the film "
            "was converted to a higher rate; export the original, and state its rate",
        )
    return [
        clip.take(~found).noted(f"{int(found.sum())} frames that repeat the one before left out")
        if found.any()
        else clip
        for clip, found in zip(clips, repeats, strict=True)
    ]


def _repeats(clip: Clip) -> NDArray[np.bool_]:
    """Which frames (frames,) repeat the one before. A ball so slow that rounding repeats it does not count."""
    steps = np.linalg.norm(np.diff(clip.position, axis=0), axis=1)
    moved = steps[steps > 0.0]
    if not len(moved):
        return np.zeros(len(clip), dtype=np.bool_)
    usual = float(np.median(moved))
    still = min(_STILL, _STILL_SHARE * usual) if clip.unit is PIXELS else _STILL_SHARE * usual
    levels = np.diff(np.unique(clip.position[:, 0]))
    quantum = float(levels[levels > 1e-9 * usual].min(initial=np.inf))
    if usual < 3.0 * quantum < np.inf:
        return np.zeros(len(clip), dtype=np.bool_)
    return np.concatenate([[False], steps <= still])


def _spaced(clips: Sequence[Clip]) -> list[Clip]:
    """The clips with constant spacing, if that lowers their noise by a tenth together."""
    even = [_constant(clip.time) for clip in clips if clip.time is not None]
    pairs = [
        (noise(clip.time, clip.position) ** 2, noise(time, clip.position) ** 2)
        for clip, time in zip(clips, even, strict=True)
        if clip.time is not None and time is not None
    ]
    both = np.array([pair for pair in pairs if np.isfinite(pair).all()])
    if not both.size:
        return [*clips]
    written, constant = np.sqrt(np.mean(both, axis=0))
    if constant > LOWER * written:
        return [*clips]
    spaced = []
    for clip, time in zip(clips, even, strict=True):
        if time is None:
            spaced.append(clip)
            continue
        factor, unit = (1.0, "px") if clip.unit is PIXELS else (1e3, "mm")
        spaced.append(
            replace(clip, time=time).noted(
                f"time stamps were replaced by constant spacing, {_rate(time):.5g} frames/s: the noise of all clips "
                f"together falls from {factor * written:.2g} to {factor * constant:.2g} {unit}"
            )
        )
    return spaced


def _constant(time: FloatArray) -> FloatArray | None:
    """Constantly spaced times nearest to stamps (frames,), with gaps where frames are missing; None where stamps are
    constant already, or are not those of frames.
    """
    if len(time) < 7:
        return None
    period = float(np.median(np.diff(time)))
    for _ in range(4):
        count = np.round((time - time[0]) / period)
        if np.any(np.diff(count) < 1.0):
            return None
        period, start = np.polyfit(count, time, 1)
    even = start + period * count
    off = float(np.abs(even - time).max())
    return None if off < 1e-6 * period or off > 0.6 * period else np.asarray(even, dtype=np.float64)


def check_rate(clips: Sequence[Clip], how: Reading) -> None:
    """Raise TableError where gravity of the clips (metres, y upwards) is off by more than any air or scale explains:
    the playback rate in place of the capture rate.
    """
    drag = how.air_density * pi * how.ball.radius**2 / (2.0 * how.ball.mass)
    lows, highs, values = list[float](), list[float](), list[float]()
    for clip in clips:
        if clip.time is None or len(clip) < 10:
            continue
        bend = kink(clip.time, clip.position)
        found, sd = gravity(clip.time, clip.position[:, 1], None if bend is None else bend.time)
        reach = SURE * sd + drag * (_LIFT + _DRAG) * _fastest(bend) ** 2
        lows, highs, values = [*lows, -found - reach], [*highs, -found + reach], [*values, -found]
    if not values or not np.isfinite(values).any():
        return
    low, high, value = (float(np.nanmedian(numbers)) for numbers in (lows, highs, values))
    if how.as_read or not (high < GRAVITY / _FACTOR or low > GRAVITY * _FACTOR):
        return
    clip = clips[0]
    rate = _rate(clip.time) if clip.time is not None else float("nan")
    if value <= 0.0:
        meant = "the frame rate is several times too low"
    else:
        wanted = rate * sqrt(GRAVITY / value)
        near = min(_RATES, key=lambda item: abs(np.log(item / wanted)))
        meant = f"the camera took about {near if abs(near / wanted - 1.0) < 0.15 else wanted:.3g} frames/s"
        meant += f", or lengths are off by a factor of {GRAVITY / value:.2g}"
    raise refusal(
        clip.source,
        f"g comes out as {value:.3g} m/s^2 at {rate:.4g} frames/s, expected 9.8: {meant}; state the rate of the "
        f"camera, not that of playback ({spoken('--fps N', 'fps=N')}), or the scale; if all is right, pass "
        + option("as_read"),
    )


def _fastest(bend: Kink | None) -> float:
    """The highest speed of a clip [m/s], no more than balls of games have: a wrong clock makes any."""
    return 0.0 if bend is None else min(_HIGHEST, *map(_norm, (bend.before, bend.after)))


def _norm(velocity: FloatArray) -> float:
    return float(np.linalg.norm(velocity))
