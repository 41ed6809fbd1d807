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
from fitball.tracks.clips import PIXELS, Clip, Reading, frames_named, some_of
from fitball.tracks.motion import SURE, bounces, gravity, kink, noise
from fitball.values import FloatArray
from fitball.wording import option, spoken

# Constant spacing is taken where it lowers the noise by a tenth.
LOWER = 0.9
# A frame that moved less than this [px], or share of a usual step where there are no pixels, repeats the one before.
_STILL, _STILL_SHARE = 1e-3, 1e-3
# Steps of fewer rounding units than this may be zero; multiples of that unit are whole within this.
_COARSE, _WHOLE = 3.0, 0.01
MOST_REPEATED = 1.0 / 3.0
# Rates that agree within this are the same.
_SAME_RATE = 0.02
GRAVITY = 9.80665
# Gravity off by more than this factor is no air and no scale that a camera has.
_FACTOR = 2.5
# Lift coefficients of balls reach this (Cross and Lindsey 2014, S up to 0.7); drag coefficients are that or near.
_LIFT, _DRAG, _DRAG_OFF = 0.35, 0.5, 0.25
# Frames that a clip needs for a count, and for gravity; stamps this near to even ones [periods] are even.
_FEW, _LONG, _EVEN = 7, 10, 1e-6
# A step shorter than this many usual ones misses no frame.
_ONE_STEP = 1.5
# Stamps of arrival are late by up to 0.65 of a frame, or early by 0.35.
_LATE = 0.35
# Share of a stamp's deviation by which a clock follows it.
_FOLLOWING = 0.3
_RATES = (24.0, 25.0, 30.0, 50.0, 60.0, 100.0, 120.0, 180.0, 200.0, 240.0, 250.0, 480.0, 500.0, 960.0, 1000.0, 2000.0)


def timed(clips: Sequence[Clip], how: Reading) -> list[Clip]:
    """The clips of a session with times [s], by the stated rate, the stamps, or constant spacing.

    Raises TableError for frames without time or rate, and where a third of the frames repeat the one before.
    """
    return _spaced(_without_repeats([_with_time(clip, how) for clip in clips]), how)


def _period(time: FloatArray) -> float:
    """The usual time between frames: the mean of the steps without missing frames, which rounding does not shift."""
    steps = np.diff(time)
    return float(np.mean(steps[steps < _ONE_STEP * np.median(steps)])) if len(steps) else float("nan")


def _with_time(clip: Clip, how: Reading) -> Clip:
    if clip.time is None:
        if how.fps is None:
            raise refusal(
                clip.source,
                f"clip '{clip.id}' has {frames_named(clip.frame)} and no time; expected the frame rate: pass "
                f"{spoken('--fps N', 'fps=N')}, or fps in [camera] of the scene",
            )
        return replace(clip, time=clip.frame / how.fps).noted(f"times are frames at {how.fps:g} frames/s")
    rate = 1.0 / _period(clip.time)
    if how.fps is None or len(clip) < 2 or abs(how.fps / rate - 1.0) < _SAME_RATE:
        return clip
    counted = _counted(clip.time)
    count = np.round((clip.time - clip.time[0]) * rate) if counted is None else counted
    if np.any(np.diff(count) < 1.0):
        k = int(np.argmax(np.diff(count) < 1.0))
        raise refusal(
            clip.source,
            f"times of clip '{clip.id}' are not those of frames: {clip.time[k + 1]:g} s follows {clip.time[k]:g} s, "
            f"at about {rate:.4g} frames/s; expected even steps, or frame numbers, where another rate is stated",
        )
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
    if usual < _COARSE * _quantum(clip.position):
        return np.zeros(len(clip), dtype=np.bool_)
    return np.concatenate([[False], steps <= still])


def _quantum(position: FloatArray) -> float:
    """The step to which coordinates are rounded, as whole pixels are; 0 where they are not."""
    levels = np.diff(np.unique(position))
    levels = levels[levels > 1e-9 * np.abs(position).max()]
    smallest = float(levels.min(initial=np.inf))
    whole = np.abs(levels / smallest - np.round(levels / smallest)) < _WHOLE
    return smallest if len(levels) and whole.all() else 0.0


def _spaced(clips: Sequence[Clip], how: Reading) -> list[Clip]:
    """The clips with constant spacing, if that lowers their noise by a tenth together."""
    counts = [None if clip.time is None else _counted(clip.time) for clip in clips]
    known = [(count, clip.time) for clip, count in zip(clips, counts, strict=True) if count is not None]
    if not known:
        return [*clips]
    # One camera has one rate.
    periods = [np.polyfit(count, time, 1)[0] for count, time in known if time is not None]
    period = float(np.average(periods, weights=[count[-1] for count, _ in known]))
    if how.fps is not None and abs(how.fps * period - 1.0) < _SAME_RATE:
        period = 1.0 / how.fps
    even = [None if count is None else _even(clip, count, period) for clip, count in zip(clips, counts, strict=True)]
    pairs = [(clip, clip.time, time) for clip, time in zip(clips, even, strict=True) if clip.time is not None]
    uneven = [
        (clip, time, other) for clip, time, other in pairs if other is not None and _differ(time, other, period)
    ]
    noises = np.array([[noise(time, clip.position), noise(other, clip.position)] for clip, time, other in uneven])
    noises = noises[np.isfinite(noises).all(axis=1)] if uneven else noises
    if not noises.size:
        return [*clips]
    written, constant = np.sqrt(np.mean(noises**2, axis=0))
    if constant > LOWER * written:
        return [*clips]
    factor, unit = (1.0, "px") if clips[0].unit is PIXELS else (1e3, "mm")
    note = (
        f"time stamps were replaced by constant spacing, {1.0 / period:.5g} frames/s: the noise of all clips "
        f"together falls from {factor * written:.2g} to {factor * constant:.2g} {unit}"
    )
    return [
        clip if time is None else replace(clip, time=time).noted(note) for clip, time in zip(clips, even, strict=True)
    ]


def _counted(time: FloatArray) -> FloatArray | None:
    """Counts (frames,) of the frames to which stamps belong, those that are missing among them; None where stamps are
    not those of frames.
    """
    if len(time) < _FEW:
        return None
    period = _period(time)
    # From frame to frame first, as a clock that follows the stamps slowly: a period that is off by a hundredth is off
    # by a frame after fifty.
    count, now = np.zeros(len(time)), float(time[0])
    for k, stamp in enumerate(time[1:].tolist(), start=1):
        steps = max(int((stamp - now) / period + _LATE), 1)
        count[k], now = count[k - 1] + steps, now + steps * period
        now += _FOLLOWING * (stamp - now)
    for _ in range(3):
        period, start = np.polyfit(count, time, 1)
        count = np.floor((time - start) / period + _LATE)
        count -= count[0]
        if np.any(np.diff(count) < 1.0):
            return None
    return np.asarray(count, dtype=np.float64)


def _differ(time: FloatArray, even: FloatArray, period: float) -> bool:
    return bool(np.abs(time - even).max() > _EVEN * period)


def _even(clip: Clip, count: FloatArray, period: float) -> FloatArray:
    assert clip.time is not None
    return np.asarray(float(np.mean(clip.time - period * count)) + period * count, dtype=np.float64)


def check_rate(clips: Sequence[Clip], how: Reading) -> None:
    """Raise TableError where gravity of the clips (metres, y upwards) is off by more than any air or scale explains:
    the playback rate in place of the capture rate.
    """
    air = how.air_density * pi * how.ball.radius**2 / (2.0 * how.ball.mass)
    lows, highs, values = list[float](), list[float](), list[float]()
    for clip in some_of(clips):
        assert clip.time is not None
        if len(clip) < _LONG:
            continue
        height, bend = clip.position[:, 1], kink(clip.time, clip.position)
        lowest = bounces(clip.time, height)
        if not len(lowest) and bend is not None and bend.score > SURE:
            # Some bounce there is, whose place is not known.
            continue
        found, sd = gravity(clip.time, height, clip.time[lowest].tolist())
        sides = [] if bend is None else [bend.before, bend.after]
        # Drag of both sides, which nearly cancels, is known; lift may have either sign.
        drags = [air * _norm(velocity) * float(velocity[1]) for velocity in sides]
        value = -found - _DRAG * float(np.mean(drags or [0.0]))
        reach = SURE * sd + _LIFT * air * max([_norm(velocity) ** 2 for velocity in sides], default=0.0)
        reach += _DRAG_OFF * float(np.max(np.abs(drags), initial=0.0))
        lows, highs, values = [*lows, value - reach], [*highs, value + reach], [*values, value]
    if not values or not np.isfinite(values).any():
        return
    low, high, value = (float(np.nanmedian(numbers)) for numbers in (lows, highs, values))
    if how.as_read or not (high < GRAVITY / _FACTOR or low > GRAVITY * _FACTOR):
        return
    clip = clips[0]
    rate = 1.0 / _period(clip.time) if clip.time is not None else float("nan")
    if value <= 0.0:
        meant = "the frame rate is several times too low"
    else:
        wanted = rate * sqrt(GRAVITY / value)
        near = min(_RATES, key=lambda item: abs(np.log(item / wanted)))
        meant = f"the camera took about {near if abs(near / wanted - 1.0) < 0.15 else wanted:.0f} frames/s"
        meant += f", or lengths are off by a factor of {GRAVITY / value:.2g}"
    raise refusal(
        clip.source,
        f"g comes out as {value:.3g} m/s^2 at {rate:.4g} frames/s, expected 9.8: {meant}; state the rate of the "
        f"camera, not that of playback ({spoken('--fps N', 'fps=N')}), or the scale; if all is right, pass "
        + option("as_read")
        + "".join(f". How it was read: {note}" for note in clip.notes if note.startswith("times")),
    )


def _norm(velocity: FloatArray) -> float:
    return float(np.linalg.norm(velocity))
