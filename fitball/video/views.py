"""What is cut out of a film about a ball: its part of each frame, in linear light, and the same
part of the nearest frames in which it is elsewhere. Frames are read once more and not kept.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from fitball.base.progress import Progress
from fitball.base.values import FloatArray, IntArray
from fitball.video import kernels
from fitball.video.flights import Flight, gravity_px
from fitball.video.spots import Spots
from fitball.video.types import Clip, Crop, Frame

# Exponent by which a camera's levels become light.
GAMMA = 2.2
# Frames beside those in which spots were found, in which the ball is looked for: of a flight of so
# many frames, and of a shorter one.
_OUTER = 40
_LONG = 8
_OUTER_SHORT = 6
# A part reaches so many radii and pixels from the centre, and further where the place is a guess.
_REACH_RADII = 1.35
_REACH_PX = 5.0
_GUESS_RADII = 0.5
# Colour differences of half as many pixels are softer by so much [px], by what codes leave of them:
# of films rendered with a blur of 0.8 px luma then has one of 0.9 to 1.4 px.
_SOFT = 1.6
# The background is the median of so many frames, and of so many at least.
_BACKGROUNDS = 9
_LEAST_BACKGROUNDS = 3


@dataclass(frozen=True, eq=False)
class Course:
    """Where a ball is: of each frame (index into the film's) its place [px] and velocity [px/s],
    steadied; `seen` are the frames in which spots were found.
    """

    frames: Annotated[IntArray, "frames"]
    places: Annotated[FloatArray, "frames 2"]
    velocities: Annotated[FloatArray, "frames 2"]
    seen: frozenset[int]


@dataclass(frozen=True, eq=False)
class View:
    """The part of a frame about the ball: channels of the `image` and of the `back`ground at
    steadied coordinates, light [share of white] and two colour differences, which are softer by
    `soft` [px]. `crop` is what is drawn, `colours` are the means of both colour
    differences about the middle of the ball, less those of the background.
    """

    index: int
    time: float
    left: float
    top: float
    image: Annotated[FloatArray, "3 rows columns"]
    back: Annotated[FloatArray, "3 rows columns"]
    velocity: Annotated[FloatArray, "2"]
    shift: Annotated[FloatArray, "2"]
    soft: float
    crop: Crop
    colours: Annotated[kernels.Singles, "3 rows columns"]


def course_of(flights: Sequence[Flight], times: FloatArray, diameter: float) -> Course:
    """The course of a ball through all frames of its flights, and some before and after."""
    frames, places, velocities = [], [], []
    last = len(times) - 1
    for number, flight in enumerate(flights):
        outer = _OUTER if len(flight.frames) >= _LONG else _OUTER_SHORT
        start, stop = (
            max(int(flight.frames[0]) - outer, 0),
            min(int(flight.frames[-1]) + outer, last),
        )
        if number:
            start = int(flights[number - 1].frames[-1] + flight.frames[0]) // 2 + 1
        if number + 1 < len(flights):
            stop = int(flight.frames[-1] + flights[number + 1].frames[0]) // 2
        within = np.arange(start, stop + 1)
        place, velocity = _along(flight, times[within], gravity_px(flight.radius, diameter))
        frames.append(within)
        places.append(place)
        velocities.append(velocity)
    seen = {k for q in flights for k in range(int(q.frames[0]), int(q.frames[-1]) + 1)}
    return Course(
        np.concatenate(frames),
        np.concatenate(places),
        np.concatenate(velocities),
        frozenset(seen),
    )


def _along(
    flight: Flight,
    times: FloatArray,
    gravity: float,
) -> tuple[Annotated[FloatArray, "times 2"], Annotated[FloatArray, "times 2"]]:
    """Places and velocities of a flight; beyond what was seen it falls as on earth."""
    x, y = flight.curve
    t = times - flight.times[0]
    inner = np.clip(t, 0.0, flight.span)
    beyond = t - inner
    slope = np.polyder(y)
    places = np.stack([np.polyval(x, t), np.polyval(y, inner)], 1)
    places[:, 1] += np.polyval(slope, inner) * beyond + 0.5 * gravity * beyond**2
    velocities = np.stack([np.full_like(t, x[0]), np.polyval(slope, inner) + gravity * beyond], 1)
    return places, velocities


@dataclass(frozen=True)
class _Part:
    """The part of a frame that is cut out, and the frames of its background."""

    index: int
    left: int
    top: int
    columns: int
    rows: int
    backgrounds: tuple[int, ...]


def views_of(
    clip: Clip,
    spots: Spots,
    course: Course,
    radius: float,
    progress: Progress,
) -> dict[int, View]:
    """The views of a ball of this radius [px] by index of frame, where it is within the picture."""
    parts = {part.index: part for part in _parts(clip, spots, course, radius)}
    wanted: dict[int, list[int]] = defaultdict(list)
    for part in parts.values():
        for k in (part.index, *part.backgrounds):
            wanted[k].append(part.index)
    cut: dict[int, dict[int, kernels.Singles]] = defaultdict(dict)
    views = {}
    soft = 0.0
    velocities = dict(zip(course.frames.tolist(), course.velocities, strict=True))
    last = max(wanted, default=-1)
    for k, frame in enumerate(clip.frames()):
        if k > last:
            break
        progress("measuring the ball", k / (last + 1))
        soft = _SOFT * (frame.luma.shape[1] / frame.chroma.shape[1] - 1.0)
        for index in wanted.get(k, ()):
            part = parts[index]
            cut[index][k] = _planes(frame, part, spots.shifts[k] - spots.shifts[index])
            if len(cut[index]) == len(part.backgrounds) + 1:
                planes = cut.pop(index)
                views[index] = _view(clip, spots, part, planes, velocities[index], soft)
    return views


def _parts(clip: Clip, spots: Spots, course: Course, radius: float) -> list[_Part]:
    count = len(spots.times)
    path = np.full((count, 2), -1e6)
    path[course.frames] = course.places
    parts = []
    numbers = np.arange(count)
    for k, place, velocity in zip(
        course.frames.tolist(), course.places, course.velocities, strict=True
    ):
        raw = place + spots.shifts[k]
        margin = 0.6 * radius
        if not (margin < raw[0] < clip.width - margin and margin < raw[1] < clip.height - margin):
            continue
        smear = min(float(np.hypot(*velocity)) / clip.camera_rate, 1.5 * radius)
        reach = _REACH_RADII * radius + _REACH_PX + 0.5 * smear
        away = np.hypot(*(path - place).T) > 1.2 * reach + radius
        order = numbers[away][np.argsort(np.abs(numbers[away] - k), kind="stable")]
        if len(order) < _LEAST_BACKGROUNDS:
            continue
        reach += 0.0 if k in course.seen else _GUESS_RADII * radius
        left, top = (max(int(at - reach), 0) for at in raw)
        right = min(int(raw[0] + reach) + 2, clip.width)
        bottom = min(int(raw[1] + reach) + 2, clip.height)
        nearest = tuple(order[:_BACKGROUNDS].tolist())
        parts.append(_Part(k, left, top, right - left, bottom - top, nearest))
    return parts


def _planes(
    frame: Frame,
    part: _Part,
    shift: Annotated[FloatArray, "2"],
) -> Annotated[kernels.Singles, "3 rows columns"]:
    """Luma and both colour differences of a part, moved by a shift [px] of the camera."""
    out = np.empty((3, part.rows, part.columns), np.float32)
    row, column = part.top + float(shift[1]), part.left + float(shift[0])
    kernels.between(frame.luma, (row, column), (1.0, 1.0), out[0])
    # Colour differences are of pixels as large as several of luma.
    down, across = (frame.chroma.shape[k] / frame.luma.shape[k] for k in (0, 1))
    first = (row + 0.5) * down - 0.5, (column + 0.5) * across - 0.5
    for k in (0, 1):
        kernels.between(frame.chroma[..., k], first, (down, across), out[k + 1])
    return out


def _view(
    clip: Clip,
    spots: Spots,
    part: _Part,
    planes: Mapping[int, kernels.Singles],
    velocity: FloatArray,
    soft: float,
) -> View:
    own = planes[part.index]
    background = np.empty_like(own)
    kernels.median(np.stack([planes[k] for k in part.backgrounds]), background)
    shift = spots.shifts[part.index]
    crop = Crop(int(spots.numbers[part.index]), part.left, part.top, own[0].astype(np.uint8))
    return View(
        part.index,
        float(spots.times[part.index]),
        part.left - float(shift[0]),
        part.top - float(shift[1]),
        _channels(own, clip),
        _channels(background, clip),
        velocity,
        shift,
        soft,
        crop,
        own,
    )


def _channels(planes: Annotated[kernels.Singles, "3 rows columns"], clip: Clip) -> FloatArray:
    """Light of luma, as a share of white, and colour differences, 0.5 without colour. Red, green
    and blue would have the soft edges of the colour differences, which films have less sharp.
    """
    luma = (planes[0].astype(float) - clip.black) / (clip.white - clip.black)
    return np.stack([np.clip(luma, 0.0, 1.0) ** GAMMA, *(planes[1:].astype(float) / 256.0)])
