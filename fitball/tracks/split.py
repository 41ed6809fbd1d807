"""From clips to bounces: one track for each bounce, and in words why there is none."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitball.errors import TrackError
from fitball.tracks.clips import frames_named
from fitball.tracks.frames import Refused, Track
from fitball.tracks.motion import bounces
from fitball.values import FloatArray

# Frames that a flight needs on either side of a bounce.
LEAST = 3
# A ball is where it was within its usual speed times this and so many metres; what is elsewhere for so many frames is
# no outlier.
_REACH, _AWAY, _ELSEWHERE = 4.0, 0.1, 5
# Frames of a piece that the next is compared with, so that an outlier ends none; the share that may be left out.
_BACK, _MOST_LEFT = 3, 0.25
# A radius larger or smaller by this factor, in so many frames running, is that of another object.
_RADIUS, _RUNNING = 2.0, 3


def split_bounces(track: Track) -> tuple[Track, ...]:
    """The bounces of a track, one each; several are called `id-1`, `id-2`, ... Frames between two bounces go to the
    nearer one.

    Raises TrackError with frame numbers where there is no bounce that can be used.
    """
    tracks, refused = bounces_of([track])
    if not tracks:
        raise TrackError(f"{track.source}, clip '{track.id}': {refused[0].reason}")
    return tuple(replace(one, notes=(*one.notes, *(f"{it.id}: {it.reason}" for it in refused))) for one in tracks)


def bounces_of(tracks: Iterable[Track]) -> tuple[tuple[Track, ...], tuple[Refused, ...]]:
    """The bounces of all tracks, and those that cannot be used, with reasons."""
    found, refused = list[Track](), list[Refused]()
    for track in tracks:
        try:
            _check_radius(track)
            one_object(track.frame, track.time, np.column_stack([track.x, track.y]))
        except TrackError as error:
            refused.append(Refused(track.id, track.source, str(error)))
            continue
        lowest = bounces(track.time, track.y)
        if not lowest.size:
            refused.append(Refused(track.id, track.source, _no_bounce(track)))
        for k, (first, last) in enumerate(stretches(track.time, lowest)):
            one = _part(track, first, last, f"{track.id}-{k + 1}" if len(lowest) > 1 else track.id)
            few = _too_few(one, int(lowest[k]) - first)
            if few is None:
                found.append(one)
            else:
                refused.append(Refused(one.id, one.source, few))
    return tuple(found), tuple(refused)


def stretches(time: FloatArray, lowest: NDArray[np.int64]) -> list[tuple[int, int]]:
    """First frame of each bounce and the one after its last, from the frames in which the ball is lowest: as far as
    halfway. Times are (frames,) [s].
    """
    halves = np.searchsorted(time, 0.5 * (time[lowest[1:]] + time[lowest[:-1]])).tolist()
    return [*pairwise([0, *halves, len(time)])] if lowest.size else []


def _part(track: Track, first: int, last: int, name: str) -> Track:
    """The frames of a stretch."""
    arrays: dict[str, Any] = {
        key: value[first:last] for key, value in vars(track).items() if isinstance(value, np.ndarray)
    }
    return replace(track, id=name, **arrays)


def _too_few(track: Track, lowest: int) -> str | None:
    before, after = lowest, len(track.time) - lowest - 1
    if min(before, after) >= LEAST:
        return None
    return (
        f"{before} frames before the lowest, frame {track.frame[lowest]}, and {after} after it; expected at least "
        f"{LEAST} on either side: film a longer stretch, or at a higher rate"
    )


def _no_bounce(track: Track) -> str:
    frames = f"frames {track.frame[0]} to {track.frame[-1]}"
    lowest = int(np.argmin(track.y))
    if len(track.time) < 2 * LEAST + 1:
        return (
            f"no bounce: {len(track.time)} frames ({frames}); expected {LEAST} before and {LEAST} after the contact"
        )
    if 0 < lowest < len(track.time) - 1 and (few := _too_few(track, lowest)) is not None:
        return few
    if lowest in (0, len(track.time) - 1):
        way = "rises from the first frame on" if lowest == 0 else "falls until the last frame"
        return f"no bounce: the ball {way} ({frames}); expected frames before and after the contact"
    return f"no bounce: the height has no minimum with a fall before and a rise after ({frames})"


def one_object(frame: NDArray[np.int64], time: FloatArray, place: FloatArray) -> tuple[NDArray[np.bool_], str | None]:
    """Which frames (frames,) one moving object can have passed, and a note on others before or after it; `place` is
    (frames, axes) [m].

    Raises TrackError where the frames of two objects are mixed.
    """
    pieces = _pieces(time, place)
    main = np.array(max(pieces, key=len))
    others = [np.array(piece) for piece in pieces if piece[0] != main[0] and len(piece) >= _ELSEWHERE]
    kept, left = np.ones(len(time), dtype=np.bool_), sum(map(len, others))
    for other in others:
        mixed = main[0] < other[-1] and other[0] < main[-1]
        if mixed or left > _MOST_LEFT * len(time):
            near = main[[int(np.argmin(np.abs(main - k))) for k in other]]
            far = float(np.median(np.linalg.norm(place[other] - place[near], axis=1)))
            raise TrackError(
                f"two objects: {frames_named(frame[other])} are {far:.2g} m from the other frames; expected one "
                "ball in a clip: give each ball its own id, or delete these frames"
            )
        # Single frames on that side belong to what was tracked there.
        kept[main[-1] + 1 :] &= other[0] < main[-1]
        kept[: main[0]] &= other[0] > main[-1]
    if kept.all():
        return kept, None
    return kept, f"{frames_named(frame[~kept])} left out: the positions jump there, to another object or a lost ball"


def _pieces(time: FloatArray, place: FloatArray) -> list[list[int]]:
    """Frames that one moving object can have passed, in pieces."""
    if len(time) < 2 * _ELSEWHERE:
        return [[*range(len(time))]]
    # Of two balls in turn every second frame shows one.
    speeds = [
        float(np.median(np.linalg.norm(place[k:] - place[:-k], axis=1) / (time[k:] - time[:-k]))) for k in (1, 2)
    ]
    reach = _REACH * max(min(speeds), 1e-9)
    if np.all(np.linalg.norm(np.diff(place, axis=0), axis=1) <= _AWAY + reach * np.diff(time)):
        return [[*range(len(time))]]
    pieces: list[list[int]] = []
    for k in range(len(time)):
        best: list[int] | None = None
        for piece in pieces:
            # What was elsewhere for so long has ended.
            if k - piece[-1] > _ELSEWHERE:
                continue
            last = np.array(piece[-_BACK:])
            near = np.linalg.norm(place[k] - place[last], axis=1) < _AWAY + reach * (time[k] - time[last])
            # The longest: an outlier nearby begins no object.
            if near.any() and (best is None or len(piece) > len(best)):
                best = piece
        if best is None:
            pieces.append([k])
        else:
            best.append(k)
    return pieces


def _check_radius(track: Track) -> None:
    if track.radius is None or not np.isfinite(track.radius).any():
        return
    ratio = track.radius / np.nanmedian(track.radius)
    with np.errstate(invalid="ignore"):
        wrong = (ratio > _RADIUS) | (ratio < 1.0 / _RADIUS)
    runs = np.convolve(wrong, np.ones(_RUNNING), mode="valid") >= _RUNNING
    if runs.any():
        factor = float(np.nanmedian(ratio[wrong]))
        raise TrackError(
            f"another object: the radius is {factor:.2g} times the usual one in {frames_named(track.frame[wrong])}; "
            "expected one ball in a clip: delete these frames"
        )
