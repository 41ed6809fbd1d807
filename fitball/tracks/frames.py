"""Positions of a ball on film, and the impacts found among them: frozen values that readers, estimator,
simulation and reports share.

Lengths are in metres and times in seconds. `x` grows to the right of the picture and `y` upwards, and angles grow
counterclockwise there. Impacts are in the frame of the tables: `v_x1 >= 0`, topspin positive. A ball that flies to
the left is mirrored.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fitball.data.scene import Camera
from fitball.data.table import FrozenMapping
from fitball.values import Ball, FloatArray

# What a track determines, in the order of all arrays of nine.
NINE = ("v_x1", "v_y1", "omega_1", "v_x2", "v_y2", "omega_2", "gap_time", "gap_path", "gap_turn")
# Of each frame: part of the flight before, of the contact, of the flight after, or of neither (repeated frames, other
# impacts, what is too far away).
UNUSED, BEFORE, CONTACT, AFTER = 0, 1, 2, 3


@dataclass(frozen=True)
class Track:
    """One ball in one clip; arrays are (frames,), sorted by time, NaN where nothing was measured.

    `frame` and `line` say where a frame is in the film and in the file `source`, for messages. `angle` is that of a
    mark on the ball, known modulo a turn over `fold` (1: a dot, 2: a stripe). `radius` is that of the ball in the
    picture, in the same unit as `x` and `y`: metres, or pixels where `metres_per_px` is None and `in_px` is true.
    `row` [px, downwards] is where a rolling shutter saw the ball. Tracks of one `session` share a camera.
    `labels` are texts that impacts of the track have too, such as the surface.
    """

    id: str
    source: str
    frame: NDArray[np.int64]
    time: FloatArray
    x: FloatArray
    y: FloatArray
    angle: FloatArray | None = None
    fold: int = 1
    radius: FloatArray | None = None
    row: FloatArray | None = None
    line: NDArray[np.int64] | None = None
    in_px: bool = False
    metres_per_px: float | None = None
    session: str = ""
    labels: Mapping[str, str] = field(default_factory=FrozenMapping)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Air:
    """What acts on the ball in flight: `density` [kg/m^3], `drag` and `lift` coefficients with the sds of a session
    and of a shot (see `flight` for their sources).
    """

    density: float = 1.2
    drag: float = 0.507
    drag_sd: float = 0.05
    drag_shot_sd: float = 0.024
    lift_sd: float = 0.05
    # Offset of the lift coefficient from its law, that of a session.
    lift: float = 0.0
    # Of balls without marks, whose spin is not measured.
    lift_unmarked_sd: float = 0.2


@dataclass(frozen=True)
class Filmed:
    """What is known about a film besides its positions: ball, air, and what its impacts share.

    `court` [m] is the height of the court in the coordinates of the tracks; None where it is not stated.
    `contact_time` [s] is the mean and range (lowest, highest) that are plausible for this ball.
    `spin_sd` [rad/s] is the spread of incident spins. `row_time` [s/px] belongs to a rolling shutter.
    """

    ball: Ball = field(default_factory=Ball)
    air: Air = field(default_factory=Air)
    camera: Camera = field(default_factory=Camera)
    court: float | None = 0.0
    contact_time: tuple[float, float, float] = (4.7e-3, 2e-3, 9e-3)
    spin_sd: float = 250.0
    row_time: float | None = None


@dataclass(frozen=True)
class Flight:
    """One side of an impact, at `time` [s], when the centre is a radius above the court: position, velocity (in the
    picture: `v_y` upwards, mirrored so that balls fly to the right), coefficients, and the line of its angle there
    (NaN without marks), topspin positive.
    """

    time: float
    x: float
    y: float
    v_x: float
    v_y: float
    drag: float
    lift: float
    angle: float
    omega: float


@dataclass(frozen=True)
class SpinPair:
    """Spins of both sides that the marks allow, with the turn over the contact and their probability; `covariance`
    (3, 3) is that of (omega_1, omega_2, gap_turn) by the marks alone. `phi_1` [rad] is the angle of the mark at
    landing, topspin positive; at release it is `phi_1 + turn`.
    """

    omega_1: float
    omega_2: float
    turn: float
    probability: float
    covariance: FloatArray
    phi_1: float = float("nan")


@dataclass(frozen=True)
class TrackedImpact:
    """What one track determines: `values` and `covariance` of the `NINE`, without what the session shares. Spins and
    turn are NaN, with zero covariance, where there are no marks or where no pair of spins is `sure`.

    `role` is one of UNUSED, BEFORE, CONTACT, AFTER for each frame; `weight` its probability of being no outlier;
    `residual` (frames, 2) measured less fitted [m], and `angle_residual` [rad], modulo the fold; NaN where unused.
    `track` has metres, as it was read; `mirrored` says that balls flew to the left.
    """

    id: str
    track: Track
    values: FloatArray
    covariance: FloatArray
    before: Flight
    after: Flight
    role: NDArray[np.int64]
    weight: FloatArray
    residual: FloatArray
    angle_residual: FloatArray
    pairs: tuple[SpinPair, ...] = ()
    sure: bool = False
    mirrored: bool = False
    notes: tuple[str, ...] = ()

    def sd(self, name: str) -> float:
        """Standard error of one of the `NINE`."""
        k = NINE.index(name)
        return float(np.sqrt(self.covariance[k, k]))


@dataclass(frozen=True)
class Refused:
    """A track, or part of one, in which no impact was found, and why."""

    id: str
    source: str
    reason: str


@dataclass(frozen=True)
class SessionNoise:
    """Noise of a frame, pooled over the session: `x`, `y` [m], `angle` [rad]; `outliers`, their share; `slow`, the
    factor by which errors that last over frames widen all sds, from `pairs` of near and far frames.
    """

    x: float
    y: float
    angle: float
    outliers: float
    slow: float
    pairs: int


@dataclass(frozen=True)
class Check:
    """A quantity that the tracks determine beside the impacts, with its sd: gravity, or the scale by the radius."""

    value: float
    sd: float


@dataclass(frozen=True)
class Tracks:
    """All impacts of the files, by session: noise, checks and what goes into `[camera]`; `filmed` is what was taken
    as known.
    """

    filmed: Filmed
    impacts: tuple[TrackedImpact, ...]
    refused: tuple[Refused, ...] = ()
    noise: Mapping[str, SessionNoise] = field(default_factory=FrozenMapping)
    gravity: Mapping[str, Check] = field(default_factory=FrozenMapping)
    scale: Mapping[str, Check] = field(default_factory=FrozenMapping)
    camera: Camera = field(default_factory=Camera)
    notes: tuple[str, ...] = ()
