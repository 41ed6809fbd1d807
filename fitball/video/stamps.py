"""Times of frames by their stamps, and the rate of the camera.

A stamp says when a frame is shown. A film of slow motion shows frames later than they were taken:
its stamps are stretched.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.errors import Note
from fitball.base.numbers import counted
from fitball.base.values import FloatArray, IntArray

# The rate of the sensor that Android writes. Media3, MdtaMetadataEntry, calls it the capture rate.
_ANDROID_TAG = "com.android.capture.fps"
# How the names of tags of Apple begin.
_APPLE_TAGS = "com.apple.quicktime."
# Steps between stamps beyond so many usual ones have frames between them that are not there.
_LONG_STEP = 1.6
# Stamps are evenly spaced and rounded if all are within so many ticks of an even spacing.
_MOST_TICKS = 1.5
# Within this share of a tick they are not rounded at all.
_EXACT = 0.01
# Below this share of a step a tick is too fine to matter.
_FINE_TICK = 0.005
# Relative difference from a whole number up to which stamps are stretched by it.
_NEAR_WHOLE = 0.03
# Relative scatter of steps from which the rate is called variable.
_VARIABLE = 0.05
# Fastest playback [1/s] of films that an iPhone has stretched; what plays faster is as filmed.
_APPLE_PLAYBACK = 61.0


class Stamps(NamedTuple):
    """Times [s] of frames as played, and their rate [1/s]."""

    times: Annotated[FloatArray, "frames"]
    rate: float
    notes: tuple[Note, ...]


class Rate(NamedTuple):
    """The rate of the camera [1/s], what says so, and by how much stamps are stretched."""

    camera: float
    source: str
    stretch: float
    notes: tuple[Note, ...]


def usual_rate(stamps: Annotated[FloatArray, "frames"]) -> float:
    """One over the step between stamps [s] that increase, where no frame was dropped."""
    steps = np.diff(stamps)
    return 1.0 / float(steps[steps < _LONG_STEP * np.median(steps)].mean())


def read_stamps(
    stamps: Annotated[FloatArray, "frames"], tick: float, nominal: float = 0.0
) -> Stamps:
    """Times by stamps [s] that increase and that the file has in steps of `tick` [s]. Stamps that
    are evenly spaced but for the rounding to ticks are spaced evenly, by the `nominal` rate [1/s]
    of the file if that is as near; others are kept.
    """
    notes = list[Note]()
    number = _numbers(stamps)
    rate, start = _line(number, stamps)
    if nominal and np.ptp(stamps - number / nominal) <= _MOST_TICKS * tick:
        rate = nominal
        start = float((stamps - number / rate).mean())
    even = start + number / rate
    rest = stamps - even
    if _EXACT * tick < np.ptp(rest) <= _MOST_TICKS * tick and tick * rate > _FINE_TICK:
        words = f"the file rounds stamps to {1e3 * tick:.3g} ms: evenly spaced times are used"
        notes.append(Note("rounded-stamps", words))
        stamps = even
    steps = np.diff(stamps) / np.diff(number)
    if steps.std() > _VARIABLE * steps.mean():
        low, high = 1e3 * np.quantile(steps, [0.02, 0.98])
        words = f"the rate varies: {low:.3g} to {high:.3g} ms a frame; each has its own stamp"
        notes.append(Note("variable-rate", words))
    dropped = int(number[-1]) + 1 - stamps.size
    if dropped:
        words = f"the camera dropped {counted(dropped, 'frame')}; the others keep their stamps"
        notes.append(Note("dropped-frames", words))
    return Stamps(stamps, rate, tuple(notes))


def _numbers(stamps: Annotated[FloatArray, "frames"]) -> Annotated[IntArray, "frames"]:
    """Numbers of frames from 0, with those that were dropped."""
    steps = np.diff(stamps) * usual_rate(stamps)
    whole = np.maximum(np.round(steps), 1.0).astype(np.int64)
    return np.concatenate([[0], np.cumsum(whole)])


def _line(
    number: Annotated[IntArray, "frames"], stamps: Annotated[FloatArray, "frames"]
) -> tuple[float, float]:
    """The rate and the first time of the even spacing that is nearest by least squares."""
    step, start = np.polynomial.polynomial.Polynomial.fit(number, stamps, 1).convert().coef[::-1]
    return 1.0 / float(step), float(start)


def rate_of(played: float, tags: Mapping[str, str], stated: float) -> Rate:
    """The rate of a camera: as `stated`, where it is not 0; by the tag of Android, which does not
    say whether stamps are stretched; else that of the stamps, `played`. All in 1/s.
    """
    if stated:
        return Rate(stated, "option", stated / played, ())
    tagged = _number(tags.get(_ANDROID_TAG, ""))
    if tagged > 0.0:
        return _tagged(played, tagged)
    notes = tuple[Note, ...]()
    is_apple = any(name.startswith(_APPLE_TAGS) for name in tags)
    if is_apple and played < _APPLE_PLAYBACK:
        words = (
            f"an iPhone wrote it, plays at {played:.4g}/s, and no tag has the rate of the camera: "
            "of slow motion pass it, as in --fps 240"
        )
        notes = (Note("no-rate-tag", words),)
    return Rate(played, "stamps", 1.0, notes)


def _number(text: str) -> float:
    """The number that a tag has, 0 where it has none."""
    try:
        number = float(text)
    except ValueError:
        return 0.0
    return number if np.isfinite(number) else 0.0


def _tagged(played: float, tagged: float) -> Rate:
    """The rate by a tag. Stamps that are stretched are so by a whole number."""
    ratio = tagged / played
    whole = max(round(ratio), 1)
    if abs(ratio / whole - 1.0) > _NEAR_WHOLE:
        words = (
            f"its tag says {tagged:.4g}/s and its stamps {played:.4g}/s, which is no whole factor: "
            "the tag is used; if that is wrong pass the rate, as in --fps 240"
        )
        return Rate(tagged, "android tag", ratio, (Note("rates-differ", words),))
    # Stamps are finer than the tag, which has the rate that was asked for.
    return Rate(whole * played, "android tag", float(whole), ())
