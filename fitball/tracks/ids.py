"""Tracks of one ball to which a tracker gave a new id on the way, joined again.

Motion models lose a ball that bounces: one id falls, the next one rises. Both are of one ball where
their flights, straight lines once gravity is taken off, cross at one place along the court between
the two. Parts of one flight are continued alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.errors import Note
from fitball.base.itf import GRAVITY
from fitball.base.text import listed
from fitball.base.values import BoolArray, FloatArray
from fitball.tracks.find import lowest_frames
from fitball.tracks.types import FilmAssumptions, Track

# Fewest frames of a flight that show where it leads: as many as its fit needs.
_FEWEST_FRAMES = 3
# Most frames by which a flight is carried on: more would bend by drag and lift.
_MOST_FRAMES = 8
# Longest time [s] between a track and the one that follows it, and by which both may overlap, where
# a motion model goes on without a ball: about as long as flights are used.
_LONGEST_TIME = 0.15
# Where the flights cross they may be this far apart along the court, in radii.
_MOST_APART = 1.0
# Velocities of two parts of one flight may differ by this share of the speed: parts may be short.
_MOST_CHANGE = 0.15
# Rounds in which the time of a crossing and the frames on both sides of it settle.
_ROUNDS = 3
# Joined tracks that a note names.
_NAMED = 4


class _Line(NamedTuple):
    """A flight at a time: place [m] and velocity [m/s], along and up."""

    place: Annotated[FloatArray, "2"]
    velocity: Annotated[FloatArray, "2"]


class _Passage(NamedTuple):
    """The time [s] at which a track goes over into another one, and the height [m] at which both
    flights cross there; all of a ball that bounces is above it, a motion model may go on below.
    """

    time: float
    height: float


def joined(
    tracks: Sequence[Track],
    assumed: FilmAssumptions,
) -> tuple[list[Track], list[Note]]:
    """The same tracks, of which those without a bounce that follow each other through one are one
    track, and a note on these.
    """
    parts = [track for track in tracks if not _has_bounce(track, assumed)]
    parts.sort(key=lambda track: float(track.time[0]))
    passages = _passages(parts, assumed)
    followers = {next_one for next_one, _ in passages.values()}
    first_of = dict[int, Track]()
    gone = set[int]()
    for number, part in enumerate(parts):
        if number in followers or number not in passages:
            continue
        chain, whole = [part], part
        while number in passages:
            number, passage = passages[number]
            chain.append(parts[number])
            whole = _joined(whole, parts[number], passage)
        if _has_bounce(whole, assumed):
            first_of[id(part)] = whole
            gone |= {id(other) for other in chain[1:]}
    if not first_of:
        return [*tracks], []
    ids = listed((track.id for track in first_of.values()), most=_NAMED)
    words = f"Ids that change at a bounce were joined, as the ball goes on in time and place: {ids}"
    kept_tracks = [first_of.get(id(track), track) for track in tracks if id(track) not in gone]
    return kept_tracks, [Note("ids-joined", f"{words}.")]


def _has_bounce(track: Track, assumed: FilmAssumptions) -> bool:
    """Whether a track has a lowest place with enough frames before and after it."""
    t = track.time
    if t.size < _FEWEST_FRAMES:
        return False
    for low in lowest_frames(track, assumed):
        before = np.sum(t < t[low] - assumed.contact.usual)
        after = np.sum(t > t[low] + assumed.contact.usual)
        if min(before, after) >= _FEWEST_FRAMES:
            return True
    return False


def _passages(
    parts: Sequence[Track],
    assumed: FilmAssumptions,
) -> Mapping[int, tuple[int, _Passage]]:
    """By number of each of the tracks, in order of their beginning, that goes over into another
    one: the number of that one, which follows no other, and the passage.
    """
    passages = dict[int, tuple[int, _Passage]]()
    taken = set[int]()
    for number, first in enumerate(parts):
        for other in range(number + 1, len(parts)):
            passage = None if other in taken else _passage(first, parts[other], assumed)
            if passage is not None:
                passages[number] = (other, passage)
                taken.add(other)
                break
    return passages


def _passage(first: Track, second: Track, assumed: FilmAssumptions) -> _Passage | None:
    """Where a track goes over into the second one, in flight or in a bounce; None where it does
    not.
    """
    is_later = first.time[0] < second.time[0] and first.time[-1] < second.time[-1]
    apart = float(second.time[0] - first.time[-1])
    if not is_later or abs(apart) > _LONGEST_TIME:
        return None
    if first.labels != second.labels or first.fold != second.fold:
        return None
    middle = float(first.time[-1]) + 0.5 * apart
    if _is_one_flight(first, second, middle, assumed):
        return _Passage(middle, -np.inf)
    return _bounce_between(first, second, middle, assumed)


def _is_one_flight(
    first: Track,
    second: Track,
    time: float,
    assumed: FilmAssumptions,
) -> bool:
    """Whether two tracks are at one place with one velocity at a time [s] between them."""
    early = _line(first, first.time < time, time)
    late = _line(second, second.time > time, time)
    if early is None or late is None:
        return False
    change = np.hypot(*(late.velocity - early.velocity))
    miss = np.hypot(*(late.place - early.place))
    most = _MOST_CHANGE * np.hypot(*early.velocity)
    return bool(change < most and miss < _MOST_APART * assumed.ball.radius)


def _bounce_between(
    first: Track,
    second: Track,
    middle: float,
    assumed: FilmAssumptions,
) -> _Passage | None:
    """Where the ball of a track bounces to go on as the second one, near to the time [s] in the
    `middle` of both; None where it does not.
    """
    # Where the id changes in contact, frames at the ends are of the other flight.
    end = first.time > first.time[-1] - _LONGEST_TIME
    begin = second.time < second.time[0] + _LONGEST_TIME
    falls = first.time <= first.time[np.where(end, first.y, np.inf).argmin()]
    rises = second.time >= second.time[np.where(begin, second.y, np.inf).argmin()]
    half = 0.5 * assumed.contact.usual
    time = middle
    for _ in range(_ROUNDS):
        fall = _line(first, falls, time)
        rise = _line(second, rises, time)
        if fall is None or rise is None or not fall.velocity[1] < 0.0 < rise.velocity[1]:
            return None
        # Gravity is the same of both: the flights cross as straight lines do.
        ahead = fall.place - rise.place
        change = rise.velocity - fall.velocity
        step = float(ahead[1] / change[1])
        miss = float(ahead[0] - change[0] * step)
        height = float(fall.place[1] + fall.velocity[1] * step - 0.5 * GRAVITY * step**2)
        time += step
        falls = first.time < time - half
        rises = second.time > time + half
    is_far = abs(time - middle) > _LONGEST_TIME or abs(miss) > _MOST_APART * assumed.ball.radius
    return None if is_far else _Passage(time, height)


def _line(track: Track, use: BoolArray, time: float) -> _Line | None:
    """The flight of the frames in `use` (frames,) nearest to a time [s], there; None of too few."""
    from scipy.stats import siegelslopes

    rows = np.flatnonzero(use)
    rows = rows[np.argsort(np.abs(track.time[rows] - time), kind="stable")[:_MOST_FRAMES]]
    if rows.size < _FEWEST_FRAMES:
        return None
    t = track.time[rows] - time
    v_x, x = siegelslopes(track.x[rows], t)
    v_y, y = siegelslopes(track.y[rows] + 0.5 * GRAVITY * t**2, t)
    return _Line(np.array([x, y]), np.array([v_x, v_y]))


def _joined(first: Track, second: Track, passage: _Passage) -> Track:
    """One track of the frames of two that follow each other, without those of a motion model that
    went on; where both have frames at a time, that of the passage parts them.
    """
    early = (first.time < passage.time) | (first.y > passage.height)
    late = (second.time > passage.time) | (second.y > passage.height)
    if not first.time[early][-1] < second.time[late][0]:
        early = first.time < passage.time
        late = second.time > passage.time

    def of_both(column: FloatArray, following: FloatArray) -> FloatArray:
        """The numbers of the frames that stay."""
        return np.concatenate([column[early], following[late]])

    return replace(
        first,
        id=f"{first.id}+{second.id}",
        frame=np.concatenate([first.frame[early], second.frame[late]]),
        time=of_both(first.time, second.time),
        x=of_both(first.x, second.x),
        y=of_both(first.y, second.y),
        angle=of_both(first.angle, second.angle),
    )
