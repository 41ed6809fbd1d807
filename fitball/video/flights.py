"""Flights among spots: paths without a kink of things of one size. Pieces of one flight are
joined.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated

import numpy as np

from fitball.base.itf import GRAVITY
from fitball.base.values import BoolArray, FloatArray, IntArray

# A column of spots: x, y, radius, strength.
X, Y, RADIUS = 0, 1, 2
# Radii of one ball in two frames, and along a path, differ by less than these factors.
_NEXT_RADIUS = 1.65
_SAME_RADIUS = 1.75
# A ball that is seen to fly moves in a frame by so many radii, at least and at most.
_LEAST_STEP = 0.15
_MOST_STEP = 60.0
# Three spots may be off a flight by so many radii and pixels; a further one by these.
_SEED_RADII = 0.35
_SEED_PX = 1.0
_NEXT_RADII = 0.45
_NEXT_PX = 1.5
# Frames in which a ball that is followed may not be found.
_MOST_MISSED = 4
# Points by which it is followed, and how far off the fall of a ball of its size may be, since
# radii of spots are rough (share).
_POINTS = 10
_FALL_SD = 0.3
# A path has so many frames, and is so many radii long.
_LEAST_FRAMES = 4
_LEAST_LENGTH = 2.0
# More threes than these, the best of them, do not begin a path.
_MOST_SEEDS = 3000
# A path is cut at a kink if both sides together fit so much better, also within so many rows on
# each side. Squares of the errors of spots [px^2] count as noise.
_LEAST_KINKED = 12
_LEAST_SIDE = 5
_SIDES = (40, 20)
_KINK_GAIN = 0.25
_KINK_NOISE = 0.3
# So many paths, the longest, are looked at: leaves and people in the wind make many.
_MOST_FLIGHTS = 120
# Pieces of one flight whose lines are this many times a radius apart are not looked at.
_ACROSS = 2.0
# Pieces of one flight lie at most so far apart [s] and have so many frames together; one parabola
# goes through their ends to within so many radii and pixels.
_MOST_GAP = 0.2
_LEAST_JOINED = 10
_PARABOLA_RADII = 0.1
_PARABOLA_PX = 0.7


@dataclass(frozen=True, eq=False)
class Flight:
    """A path of a thing: indices of its frames, times [s], and its spots (frames, 4)."""

    frames: Annotated[IntArray, "frames"]
    times: Annotated[FloatArray, "frames"]
    spots: Annotated[FloatArray, "frames 4"]
    curve: tuple[FloatArray, FloatArray] = field(init=False)

    def __post_init__(self) -> None:
        degree = 2 if len(self.frames) > _LEAST_FRAMES else 1
        t = self.times - self.times[0]
        x = np.polyfit(t, self.spots[:, X], 1)
        object.__setattr__(self, "curve", (x, np.polyfit(t, self.spots[:, Y], degree)))

    @cached_property
    def radius(self) -> float:
        """The median radius of its spots [px]."""
        return float(np.median(self.spots[:, RADIUS]))

    @cached_property
    def step(self) -> float:
        """The least time between its frames [s]."""
        return float(np.diff(self.times).min())

    @property
    def span(self) -> float:
        """How long it is seen [s]."""
        return float(self.times[-1] - self.times[0])

    def across(self, time: float) -> float:
        """Its column at a time, by the line through all of its spots [px]."""
        slope, start = self.curve[0]
        return float(slope * (time - self.times[0]) + start)

    def fall(self) -> tuple[float, float]:
        """How fast it falls faster [px/s^2], and the sd of that; infinite of a few frames."""
        if len(self.frames) < _LEAST_FRAMES + 2:
            return float("nan"), float("inf")
        t = self.times - self.times.mean()
        curve, covariance = np.polyfit(t, self.spots[:, Y], 2, cov=True)
        return 2.0 * float(curve[0]), 2.0 * float(np.sqrt(covariance[0, 0]))

    def end(self, last: bool, gravity: float) -> End:
        """Where it is and how fast at an end, if it falls with this gravity [px/s^2]."""
        rows = slice(-8, None) if last else slice(None, 8)
        at = self.times[-1 if last else 0]
        t = self.times[rows] - at
        fallen = np.zeros((t.size, 2))
        fallen[:, 1] = 0.5 * gravity * t**2
        velocity, place = np.polyfit(t, self.spots[rows, :2] - fallen, 1)
        return End(place, velocity, gravity, float(at))


@dataclass(frozen=True, eq=False)
class End:
    """Place [px], velocity [px/s] and time [s] at an end of a flight."""

    place: FloatArray
    velocity: FloatArray
    gravity: float
    time: float

    def at(self, time: float) -> Annotated[FloatArray, "2"]:
        """The place at another time."""
        t = time - self.time
        return np.asarray(
            self.place + self.velocity * t + np.array([0.0, 0.5 * self.gravity * t * t])
        )

    def velocity_at(self, time: float) -> Annotated[FloatArray, "2"]:
        """The velocity at another time."""
        return np.asarray(self.velocity + np.array([0.0, self.gravity * (time - self.time)]))


def gravity_px(radius: float, diameter: float) -> float:
    """Gravity [px/s^2] where a ball of this diameter [m] has this radius [px]."""
    return GRAVITY * 2.0 * radius / diameter


def flights_of(
    found: Sequence[Annotated[FloatArray, "spots 4"]],
    times: Annotated[FloatArray, "frames"],
    diameter: float,
    rolling: bool = False,
) -> list[Flight]:
    """All flights, those of many frames and large things first. A thing that is `rolling` does not
    fall.
    """
    search = _Search(found, times, 0.0 if rolling else 1.0 / diameter)
    flights = [piece for path in search.paths() for piece in _cut(path)]
    flights.sort(key=lambda flight: -len(flight.frames))
    flights = _joined(flights[:_MOST_FLIGHTS], diameter)
    return sorted(flights, key=lambda flight: -len(flight.frames) * min(1.0, flight.radius / 4.0))


class _Search:
    """Paths grown from three spots that follow each other as those of a ball do."""

    def __init__(
        self,
        found: Sequence[FloatArray],
        times: FloatArray,
        fall: float,
    ) -> None:
        self.found = found
        self.times = times
        # Times a radius [px] it is gravity [px/s^2].
        self.fall = 2.0 * GRAVITY * fall
        self.used: list[BoolArray] = [np.zeros(len(spots), bool) for spots in found]

    def paths(self) -> Iterator[Flight]:
        """All paths, from the most likely beginnings."""
        seeds = sorted(self._seeds())[:_MOST_SEEDS]
        for _, k, *chosen in seeds:
            if any(self.used[k + i][one] for i, one in enumerate(chosen)):
                continue
            path = [(k + i, one) for i, one in enumerate(chosen)]
            path = self._grown(path, 1)
            path = self._grown(path[::-1], -1)[::-1]
            flight = self._flight(path)
            spots = flight.spots
            length = np.hypot(*np.ptp(spots[:, :2], axis=0))
            if len(path) < _LEAST_FRAMES or length < _LEAST_LENGTH * flight.radius:
                continue
            for number, one in path:
                self.used[number][one] = True
            yield flight

    def _flight(self, path: Sequence[tuple[int, int]]) -> Flight:
        frames = np.array([number for number, _ in path])
        spots = np.array([self.found[number][one] for number, one in path])
        return Flight(frames, self.times[frames], spots)

    def _seeds(self) -> Iterator[tuple[float, int, int, int, int]]:
        """Threes of spots in frames that follow each other, with how unlikely they are a ball."""
        for k in range(len(self.found) - 2):
            a, b, c = self.found[k : k + 3]
            if not (len(a) and len(b) and len(c)):
                continue
            first, second = np.diff(self.times[k : k + 3])
            step = b[None, :, :2] - a[:, None, :2]
            radius = np.sqrt(a[:, None, RADIUS] * b[None, :, RADIUS])
            length = np.hypot(step[..., 0], step[..., 1])
            likely = (length > _LEAST_STEP * radius) & (length < _MOST_STEP * radius)
            likely &= _alike(a[:, None, RADIUS], b[None, :, RADIUS], _NEXT_RADIUS)
            for i, j in np.argwhere(likely):
                r = radius[i, j]
                there = b[j, :2] + step[i, j] * second / first
                there[1] += 0.5 * self.fall * r * second * (first + second)
                off = np.hypot(c[:, X] - there[0], c[:, Y] - there[1])
                off[~_alike(c[:, RADIUS], b[j, RADIUS], _NEXT_RADIUS)] = np.inf
                m = int(np.argmin(off))
                if off[m] < _SEED_RADII * r + _SEED_PX:
                    yield float(off[m] / r - 0.2 * np.log(r)), k, int(i), int(j), m

    def _grown(self, path: list[tuple[int, int]], step: int) -> list[tuple[int, int]]:
        """The path, longer at its last end."""
        spots = [self.found[number][one] for number, one in path]
        k = path[-1][0] + step
        missed = 0
        while 0 <= k < len(self.found) and missed < _MOST_MISSED:
            here = self.found[k]
            if len(here):
                radius = float(np.median([spot[RADIUS] for spot in spots]))
                place = self._next(path, spots, k, radius)
                off = np.hypot(here[:, X] - place[0], here[:, Y] - place[1])
                off /= (_NEXT_RADII + 0.3 * missed) * radius + _NEXT_PX
                off[~_alike(here[:, RADIUS], radius, _SAME_RADIUS) | self.used[k]] = np.inf
                best = int(np.argmin(off))
                if off[best] < 1.0:
                    path = [*path, (k, best)]
                    spots.append(here[best])
                    missed = -1
            k += step
            missed += 1
        return path

    def _next(
        self,
        path: Sequence[tuple[int, int]],
        spots: Sequence[FloatArray],
        k: int,
        radius: float,
    ) -> Annotated[FloatArray, "2"]:
        """Where the path is in frame k: a line across, a parabola down with the fall of a ball of
        its size, unless its own points say otherwise.
        """
        numbers = [number for number, _ in path[-_POINTS:]]
        t = self.times[numbers] - self.times[k]
        recent = np.array(spots[-_POINTS:])
        fall = self.fall * radius
        x = np.polyfit(t, recent[:, X], 1)[1]
        design = np.stack([np.ones_like(t), t, 0.5 * t * t], 1)
        # One more row: the fall that is expected, in sds of it over those of a spot.
        sd = 0.15 * radius / max(_FALL_SD * fall, 1e-9)
        design = np.vstack([design, [0.0, 0.0, sd]])
        y = np.linalg.lstsq(design, np.append(recent[:, Y], sd * fall), rcond=None)[0][0]
        return np.array([x, y])


def _alike(a: FloatArray, b: FloatArray | float, factor: float) -> BoolArray:
    return np.asarray((a < factor * b) & (b < factor * a))


def _cut(path: Flight) -> Iterator[Flight]:
    """The path, or both sides of a kink that is too blunt to end it. A path over several bounces
    shows each best in its neighbourhood.
    """
    n = len(path.frames)
    for side in (n, *_SIDES):
        cut = _kink(path, side) if n >= _LEAST_KINKED and side <= n else 0
        if cut:
            for part in (slice(0, cut - 1), slice(cut + 1, n)):
                if part.stop - part.start >= _LEAST_FRAMES:
                    yield from _cut(_part(path, part))
            return
    yield path


def _kink(path: Flight, side: int) -> int:
    """The row of a path with the worst kink, of so many rows on each side; 0 without one."""
    rows = range(_LEAST_SIDE, len(path.frames) - _LEAST_SIDE + 1)
    straight, cut = min((_straightness(path, row, side), row) for row in rows)
    return cut if straight < 1.0 else 0


def _straightness(path: Flight, row: int, side: int) -> float:
    """How well one parabola goes through so many rows on each side of a row against one through
    each side; below 1 there is a kink.
    """
    start, stop = max(row - side, 0), min(row + side, len(path.frames))
    noise = _KINK_NOISE * (stop - start)
    whole = _rest(path, slice(start, stop))
    if _KINK_GAIN * whole <= noise:
        return np.inf
    parts = _rest(path, slice(start, row)) + _rest(path, slice(row, stop))
    return (parts + noise) / (_KINK_GAIN * whole)


def _part(path: Flight, rows: slice) -> Flight:
    return Flight(path.frames[rows], path.times[rows], path.spots[rows])


def _rest(path: Flight, rows: slice) -> float:
    """Squares of what a parabola leaves of a part of a path."""
    t = path.times[rows] - path.times[rows].mean()
    places = path.spots[rows, :2]
    design = np.stack([np.ones_like(t), t, t * t], 1)
    return float(np.linalg.lstsq(design, places, rcond=None)[1].sum()) if t.size > 3 else 0.0


def _joined(flights: list[Flight], diameter: float) -> list[Flight]:
    """The flights, pieces of one put together: each goes on with the first one that fits."""
    rest = sorted(flights, key=lambda flight: flight.frames[0])
    whole = []
    while rest:
        flight = rest.pop(0)
        while True:
            fits = (k for k, later in enumerate(rest) if _is_one(flight, later, diameter))
            next_one = next(fits, None)
            if next_one is None:
                break
            flight = _both(flight, rest.pop(next_one))
        whole.append(flight)
    return whole


def _both(a: Flight, b: Flight) -> Flight:
    """Two flights as one."""
    return Flight(
        np.concatenate([a.frames, b.frames]),
        np.concatenate([a.times, b.times]),
        np.concatenate([a.spots, b.spots]),
    )


def _is_one(a: Flight, b: Flight, diameter: float) -> bool:
    """Whether one flight goes through the end of a and the start of b: no bounce between them."""
    gap = b.times[0] - a.times[-1]
    if not 0.0 < gap < _MOST_GAP or len(a.frames) + len(b.frames) < _LEAST_JOINED:
        return False
    radius = np.sqrt(a.radius * b.radius)
    if not _alike(np.array(a.radius), b.radius, 1.42):
        return False
    # Most pieces are far apart across, which is quickly seen.
    middle = 0.5 * (a.times[-1] + b.times[0])
    if abs(a.across(middle) - b.across(middle)) > _ACROSS * (radius + 3.0):
        return False
    gravity = gravity_px(float(radius), diameter)
    end, start = a.end(True, gravity), b.end(False, gravity)
    apart = np.hypot(*(end.at(middle) - start.at(middle)))
    turned = np.hypot(*(end.velocity_at(start.time) - start.velocity)) * gap
    if apart > 0.7 * radius + 2.0 or turned > 1.2 * radius + 3.0:
        return False
    t = np.concatenate([a.times[-12:], b.times[:12]])
    places = np.concatenate([a.spots[-12:, :2], b.spots[:12, :2]])
    t = t - t.mean()
    rest = places - np.stack([np.ones_like(t), t, t * t], 1) @ np.polyfit(t, places, 2)[::-1]
    if np.sqrt((rest**2).mean()) > _PARABOLA_RADII * radius + _PARABOLA_PX:
        return False
    whole = _both(a, b)
    return all(_straightness(whole, len(a.frames), side) >= 1.0 for side in _SIDES)
