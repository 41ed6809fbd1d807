"""Tracks with a known truth: impacts and their rebounds as a camera would show them.

The bounce is the model's: its rebounds and the gaps between its flights. Flights are integrated with drag and lift
(`flight`). Between landing and release the centre follows a cubic with the velocities of both flights, so that frames
of the contact are on neither flight. Errors of the session are as a fit has them: `scale` and `clock` are true
lengths and times over measured ones, `tilt` is the angle by which the court rises along the flight in the picture,
and `court_height` how much higher the court is there than at zero. The picture turns about the place of landing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fitball.errors import ParameterError
from fitball.models.model import Model
from fitball.models.types import Rebound
from fitball.tracks.flight import fly, lift_of, resistance
from fitball.tracks.frames import NINE, Air, Track
from fitball.values import Ball, FloatArray, Impacts

# Sizes of outliers [m]: from what is barely one to another object nearby.
OUTLIER_SIZES = (5e-3, 50e-3)
# A shell that twists at release swings back within this time [s].
TWIST_DECAY = 1.5e-3
# Times at which the spin of the shell is taken over a contact.
TURN_NODES = 40
# Slow errors are sums of this many waves.
WAVES = 24
# Sweeps that find when a row of a rolling shutter sees the ball.
SHUTTER_SWEEPS = 4
# Clips are this long at most [s before and after the contact], and of this many frames.
LONGEST, MOST_FRAMES = 0.3, 200_000


@dataclass(frozen=True)
class Film:
    """A camera, what it sees, and how it errs; the defaults are those of a good film.

    `fps` [1/s]; `width` and `height` [m] of its view, centred on the landing, from the court upwards. `noise` [m] is
    the sd of each coordinate of a centre, `angle_noise` [rad] that of the mark, which looks the same after a turn
    over `fold` (None: no mark). `slow` is the sd of errors that last, over `noise`, and `slow_time` [s] how long they
    do. Of all frames the shares `outliers`, `angle_outliers`, `lost` and `repeated` are off, have a wrong angle, are
    missing, or show the frame before again. `radius_noise` [m] adds a column of the radius (None: none).

    `jitter` [s] is the sd of time stamps, `row_time` [s/px] the delay of a rolling shutter, with `metres_per_px`.
    `scale`, `clock`, `tilt` [rad] and `court_height` [m] are errors of the session. `drag` and `lift_sd` are those of
    the flights, `drag_sd` from shot to shot. `leftward` balls fly to the left.
    """

    fps: float = 1000.0
    width: float = 0.8
    height: float = 0.5
    noise: float = 1e-3
    angle_noise: float = math.radians(2.0)
    fold: int | None = 1
    slow: float = 0.0
    slow_time: float = 0.02
    outliers: float = 0.02
    angle_outliers: float = 0.05
    lost: float = 0.05
    repeated: float = 0.0
    radius_noise: float | None = None
    jitter: float = 0.0
    row_time: float = 0.0
    metres_per_px: float = 1e-3
    scale: float = 1.0
    clock: float = 1.0
    tilt: float = 0.0
    court_height: float = 0.0
    air: Air = field(default_factory=Air)
    lift_sd: float = 0.03
    leftward: bool = False

    def __post_init__(self) -> None:
        positive = ("fps", "width", "height", "metres_per_px", "scale", "clock", "slow_time")
        shares = ("outliers", "angle_outliers", "lost", "repeated")
        for name, value in vars(self).items():
            if not isinstance(value, float | int):
                continue
            wrong = not math.isfinite(value) or (name in positive and value <= 0.0)
            if wrong or (name.endswith(("noise", "sd", "slow", "jitter", "time")) and value < 0.0):
                kind = "a positive number" if name in positive else "a number of at least 0"
                raise ParameterError(f"film: {name} = {value!r}: expected {kind}")
            if name in shares and not 0.0 <= value < 1.0:
                raise ParameterError(f"film: {name} = {value!r}: expected a share of at least 0 and below 1")
        if self.fold is not None and self.fold not in range(1, 13):
            raise ParameterError(f"film: fold = {self.fold!r}: expected 1 (a dot), 2 (a stripe) up to 12, or none")


def truth(impacts: Impacts, rebound: Rebound) -> FloatArray:
    """The `NINE` of each impact, (impacts, 9)."""
    return np.stack([getattr(impacts if hasattr(impacts, name) else rebound, name) for name in NINE], axis=-1)


def simulated_tracks(
    impacts: Impacts,
    rebound: Rebound,
    film: Film,
    rng: np.random.Generator,
    *,
    ball: Ball | None = None,
    ids: Sequence[str] = (),
    session: str = "",
    twist: FloatArray | None = None,
) -> tuple[Track, ...]:
    """One track of each impact with this `rebound`, whose arrays are (impacts,), as the `film` shows it.

    `twist` (impacts,) [rad] is by how much the shell is ahead of its line when it leaves, which dies out. A track
    holds the frames about the contact between which the ball does not leave the view. Raises ParameterError where
    the model gives no gaps, or an impact has no rebound.
    """
    ball, values = ball or Ball(), truth(impacts, rebound)
    bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if bad.size:
        raise ParameterError(
            f"impact {bad[0] + 1} has no rebound with gaps: tracks need a model that gives them, such as two-mass"
        )
    names = ids or [f"{place + 1}" for place in range(len(impacts))]
    ends = np.where(np.isfinite(rebound.contact_time), rebound.contact_time, rebound.gap_time)
    twists = np.zeros(len(impacts)) if twist is None else twist
    tracks = []
    for nine, end, ahead, name in zip(values, ends, twists, names, strict=True):
        spread = film.air.drag_shot_sd * rng.standard_normal()
        extra = film.lift_sd * rng.standard_normal(2)
        course = Course(nine, float(end), float(ahead), film.air.drag + spread, extra, ball, film.air.density)
        tracks.append(_filmed(course, film, rng, name, session))
    return tuple(tracks)


def ahead_at_release(model: Model, parameters: Mapping[str, float], impacts: Impacts, rebound: Rebound) -> FloatArray:
    """By how much the shell is ahead of its line when it leaves (impacts,) [rad]: its own turn over the contact less
    that of the line through the turns of the flight after it. Raises as `Model.history` does.
    """
    nodes, weights = np.polynomial.legendre.leggauss(TURN_NODES)
    found = []
    for k, end in enumerate(rebound.contact_time):
        history = model.history(parameters, impacts.take(np.array([k])), 0.5 * end * (nodes + 1.0))
        turned = 0.5 * end * float(weights @ history.omega_2)
        line = rebound.gap_turn[k] - rebound.omega_2[k] * (rebound.gap_time[k] - end)
        found.append(turned - float(line))
    return np.array(found)


@dataclass(frozen=True)
class Course:
    """A ball from its landing at time 0, at place 0, a radius above the court: its `nine`, the `end` of the contact
    [s], by how much the shell is `ahead` then [rad], `drag`, and what lift has beyond that of spin (2,).
    """

    nine: FloatArray
    end: float
    ahead: float
    drag: float
    extra_lift: FloatArray
    ball: Ball
    density: float

    def at(self, times: FloatArray) -> FloatArray:
        """Place along the court, height of the centre above it [m], and turn, topspin positive [rad], (times, 3)."""
        v_x1, v_y1, omega_1 = self.nine[:3]
        before, after = times < 0.0, times >= self.end
        found = np.empty((times.size, 3))
        found[before, :2] = self._flown(times[before], 0.0, v_x1, -v_y1, omega_1, self.extra_lift[0])
        found[before, 2] = omega_1 * times[before]
        found[after] = self._released(times[after])
        # The contact: what has place and velocity of both flights at its ends.
        inside, step = ~before & ~after, 1e-6
        share = times[inside, None] / self.end
        starts, speeds = np.array([0.0, self.ball.radius, 0.0]), np.array([v_x1, -v_y1, omega_1]) * self.end
        last, sooner = self._released(np.array([self.end + step, self.end]))
        leaving = (last - sooner) / step * self.end
        found[inside] = (
            (1.0 + 2.0 * share) * (1.0 - share) ** 2 * starts
            + share * (1.0 - share) ** 2 * speeds
            + share**2 * (3.0 - 2.0 * share) * sooner
            + share**2 * (share - 1.0) * leaving
        )
        return found

    def _released(self, times: FloatArray) -> FloatArray:
        """After the contact, (times, 3)."""
        v_x2, v_y2, omega_2, late, path, turn = self.nine[3:]
        since = times - late
        places = self._flown(since, path, v_x2, v_y2, omega_2, self.extra_lift[1])
        swinging = self.ahead * np.exp(-(times - self.end) / TWIST_DECAY)
        return np.column_stack([places, turn + omega_2 * since + swinging])

    def _flown(self, times: FloatArray, x: float, v_x: float, v_y: float, omega: float, extra: float) -> FloatArray:
        """Flight through contact height at time 0, (times, 2)."""
        lift = float(lift_of(omega, math.hypot(v_x, v_y), self.ball.radius)) + extra
        start = (x, self.ball.radius, v_x, v_y)
        return fly(start, self.drag, lift, resistance(self.ball, self.density), times)[:, :2]


def _filmed(course: Course, film: Film, rng: np.random.Generator, name: str, session: str) -> Track:
    """What the film shows of a ball."""
    numbers = frame_numbers(film)
    # The camera's clock counts `time / clock`, so that it takes its frames at these true times.
    frames = np.asarray((numbers + rng.uniform()) * film.clock / film.fps, dtype=np.float64)
    times = frames
    places = on_film(course.at(times), film)
    rows = _rows(places, film)
    for _sweep in range(SHUTTER_SWEEPS if film.row_time > 0.0 else 0):
        times = frames + film.row_time * rows
        places = on_film(course.at(times), film)
        rows = _rows(places, film)
    kept = in_view(times, places, film)
    first = kept[0]
    kept = kept[rng.uniform(size=kept.size) >= film.lost]
    measured = places[kept, :2] + film.noise * rng.standard_normal((kept.size, 2))
    if film.slow > 0.0:
        measured += film.slow * film.noise * _waves(times[kept], film.slow_time, rng)
    off = rng.uniform(size=kept.size) < film.outliers
    signs, sizes = rng.choice([-1.0, 1.0], (kept.size, 2)), rng.uniform(*OUTLIER_SIZES, (kept.size, 2))
    measured[off] += (signs * sizes)[off]
    angle = _angles(places[kept, 2], film, rng)
    again = rng.uniform(size=kept.size) < film.repeated
    again[:1] = False
    latest = np.maximum.accumulate(np.where(again, 0, np.arange(kept.size)))
    radius = None
    if film.radius_noise is not None:
        radius = course.ball.radius / film.scale + film.radius_noise * rng.standard_normal(kept.size)
    # The clip begins before the ball is in the view.
    before = int(rng.integers(20, 200))
    frame = (before + numbers[kept] - numbers[first]).astype(np.int64)
    return Track(
        id=name,
        source="simulated",
        frame=frame,
        time=frame / film.fps + film.jitter * rng.standard_normal(kept.size),
        x=(-1.0 if film.leftward else 1.0) * measured[latest, 0],
        y=measured[latest, 1],
        angle=None if angle is None else angle[latest],
        fold=film.fold or 1,
        radius=None if radius is None else radius[latest],
        row=rows[kept] if film.row_time > 0.0 else None,
        metres_per_px=film.metres_per_px if film.row_time > 0.0 else None,
        session=session,
    )


def frame_numbers(film: Film) -> NDArray[np.int64]:
    """Numbers of the frames about a contact, which is after that of number 0. Raises ParameterError for too many."""
    count = int(LONGEST * film.fps / film.clock)
    if count > MOST_FRAMES:
        raise ParameterError(f"film: fps = {film.fps:g}: expected at most {MOST_FRAMES / LONGEST:g} frames/s")
    return np.arange(-count, count + 1)


def in_view(times: FloatArray, places: FloatArray, film: Film) -> NDArray[np.int64]:
    """Frames about the contact between which the ball does not leave the view, by number."""
    near = int(np.argmin(np.abs(times)))
    away = np.flatnonzero((np.abs(places[:, 0]) > 0.5 * film.width) | (places[:, 1] > film.height))
    first = int(max(away[away < near], default=-1)) + 1
    last = int(min(away[away > near], default=times.size))
    return np.arange(first, last)


def on_film(course: FloatArray, film: Film) -> FloatArray:
    """Places (times, 3) as the camera has them, flying to the right."""
    cosine, sine = math.cos(film.tilt), math.sin(film.tilt)
    x, y = course[:, 0] / film.scale, course[:, 1] / film.scale
    return np.column_stack([cosine * x - sine * y, sine * x + cosine * y + film.court_height, course[:, 2]])


def _rows(places: FloatArray, film: Film) -> FloatArray:
    """Rows of the picture, downwards from its upper edge [px]."""
    return np.asarray((film.height - places[:, 1]) / film.metres_per_px)


def _angles(turn: FloatArray, film: Film, rng: np.random.Generator) -> FloatArray | None:
    """Angles of the mark, counterclockwise, within a turn over the fold."""
    whole = 2.0 * math.pi / (film.fold or 1)
    start = rng.uniform(0.0, whole)
    noise, wrong = film.angle_noise * rng.standard_normal(turn.size), rng.uniform(size=turn.size)
    any_angle = rng.uniform(0.0, whole, turn.size)
    if film.fold is None:
        return None
    # Topspin turns clockwise where the ball flies to the right.
    angles = start + (turn if film.leftward else -turn) + noise
    return np.asarray(np.where(wrong < film.angle_outliers, any_angle, np.mod(angles, whole)))


def _waves(times: FloatArray, lasting: float, rng: np.random.Generator) -> FloatArray:
    """Errors (times, 2) of unit sd that are correlated over `lasting`, as exp(-t^2/2 lasting^2)."""
    rates, phases = rng.standard_normal((WAVES, 2)) / lasting, rng.uniform(0.0, 2.0 * math.pi, (WAVES, 2))
    return np.asarray(math.sqrt(2.0 / WAVES) * np.cos(times[:, None, None] * rates + phases).sum(axis=1))
