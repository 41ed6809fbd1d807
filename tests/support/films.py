"""Films with a known truth: flights integrated by scipy, seen by a camera that errs. Nothing of
fitball.

Errors of a session are as a fit has them: `scale` and `clock` are true lengths and times over
filmed ones, `tilt` is the angle by which the court rises along the flight in the picture, which
turns about the place of landing, `court_height` how much higher the court is there than at zero.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp

NINE = ("v_x1", "v_y1", "omega_1", "v_x2", "v_y2", "omega_2", "gap_time", "gap_path", "gap_turn")
UNITS = ("m/s", "m/s", "rad/s", "m/s", "m/s", "rad/s", "s", "m", "rad")
G = 9.80665
RADIUS = 0.03302
MASS = 0.0576
RATIO = 0.56
DENSITY = 1.2
DRAG = 0.507
DRAG_SHOT = 0.024
TWIST_DECAY = 1.5e-3
# Width and height of a view [m] by least frames a second: faster cameras see less.
VIEWS = {5000.0: (0.25, 0.35), 1500.0: (0.5, 0.35), 400.0: (0.8, 0.5), 0.0: (1.2, 0.8)}


@dataclass(frozen=True)
class Camera:
    """A camera and how it errs: `noise`, `lasting` [m], `lasting_time` [s], `row_time` [s/px],
    shares of frames.
    """

    fps: float = 1000.0
    noise: float = 1e-3
    outliers: float = 0.02
    fold: int = 1
    angle_noise: float = np.radians(2.0)
    angle_outliers: float = 0.05
    lost: float = 0.05
    lasting: float = 0.0
    lasting_time: float = 0.02
    row_time: float = 0.0
    mm_per_px: float = 1.0
    scale: float = 1.0
    clock: float = 1.0
    tilt: float = 0.0
    court_height: float = 0.0
    drag: float = DRAG
    lift_sd: float = 0.05
    leftward: bool = False


def bounces(count, rng):
    """The nine of impacts like Wang's (count, 9), by Walton's impulse on a round body with an
    offset of 2.4 mm.
    """
    speed = rng.uniform(12.0, 25.0, count)
    angle = np.radians(rng.uniform(16.0, 60.0, count))
    v_x = speed * np.cos(angle)
    v_y = np.clip(speed * np.sin(angle), 4.0, 16.0)
    omega = rng.uniform(-300, 400, count)
    cor = 0.775 - 0.014 * (v_y - 10.0)
    offset = 2.4e-3
    pressed = v_y * (1.0 + cor)
    slip = v_x - RADIUS * omega
    grip = RATIO / (1.0 + RATIO) * (1.1 * slip + offset * pressed / (RATIO * RADIUS))
    lost = np.clip(grip, -0.56 * pressed, 0.56 * pressed)
    v_x2 = v_x - lost
    spin = omega + (lost - offset * pressed / RADIUS) / (RATIO * RADIUS)
    time = 4.9e-3 + 1e-4 * rng.standard_normal(count)
    path = time * (0.45 * v_x + 0.55 * v_x2)
    turn = time * (omega + 0.6 * (spin - omega))
    return np.stack([v_x, v_y, omega, v_x2, cor * v_y, spin, time, path, turn], axis=1)


def flight(v_x, v_y, omega, drag, extra, until, air=1.0):
    """Path from zero by times up to `until` of either sign, with the lift that Cross and Lindsey
    (2014) found.
    """
    ratio = RADIUS * omega / np.hypot(v_x, v_y)
    lift = ratio / (0.981 + 2.022 * abs(ratio)) + extra
    k = air * DENSITY * np.pi * RADIUS**2 / (2.0 * MASS)

    def moves(_t, s):
        pull = k * np.hypot(s[2], s[3])
        return (
            s[2],
            s[3],
            -pull * (drag * s[2] - lift * s[3]),
            -G - pull * (drag * s[3] + lift * s[2]),
        )

    start = (0.0, 0.0, v_x, v_y)
    return solve_ivp(
        moves,
        (0.0, until),
        start,
        "DOP853",
        dense_output=True,
        rtol=1e-10,
        atol=1e-12,
    ).sol


def course(nine, drag, extra, end, ahead):
    """Places and turn (times, 3) of a ball that lands at time 0; of the contact a cubic between
    both flights.
    """
    v_x1, v_y1, omega_1, v_x2, v_y2, omega_2, late, way, turn = nine
    before = flight(v_x1, -v_y1, omega_1, drag, extra[0], -0.4)
    after = flight(v_x2, v_y2, omega_2, drag, extra[1], 0.4)
    early = flight(v_x2, v_y2, omega_2, drag, extra[1], -0.02)

    def released(t):
        since = t - late
        place = np.where(
            since < 0.0,
            early(np.clip(since, -0.02, 0.0)),
            after(np.clip(since, 0.0, 0.4)),
        )
        swing = ahead * np.exp(-(t - end) / TWIST_DECAY)
        return np.stack([way + place[0], place[1], turn + omega_2 * since + swing], axis=-1)

    def at(t):
        landing = before(np.clip(t, -0.4, 0.0))
        found = np.stack([landing[0], landing[1], omega_1 * t], axis=-1)
        s = np.clip(t / end, 0.0, 1.0)[:, None]
        ends = released(np.array([end, end + 1e-6]))
        cubic = (
            s * (1.0 - s) ** 2 * np.array([v_x1, -v_y1, omega_1]) * end
            + s**2 * (3.0 - 2.0 * s) * ends[0]
        )
        cubic = cubic + s**2 * (s - 1.0) * (ends[1] - ends[0]) * 1e6 * end
        found = np.where(
            t[:, None] < 0.0,
            found,
            np.where(t[:, None] < end, cubic, released(np.maximum(t, end))),
        )
        return found + np.array([0.0, RADIUS, 0.0])

    return at


def waves(t, lasting, rng):
    """Errors (times, 2) of unit sd with correlation exp(-t^2/(2 lasting^2))."""
    rates = rng.standard_normal((24, 2)) / lasting
    phases = rng.uniform(0.0, 2.0 * np.pi, (24, 2))
    return np.sqrt(2.0 / 24.0) * np.cos(t[:, None, None] * rates + phases).sum(axis=1)


def filmed(truth, camera, rng, contact=None, ahead=None):
    """The long table that a camera makes of impacts (impacts, 9): metres, or pixels with a rolling
    shutter.
    """
    width, height = next(size for least, size in VIEWS.items() if camera.fps >= least)
    pieces = []
    whole = 2.0 * np.pi / camera.fold
    for k, nine in enumerate(truth):
        drag = camera.drag + DRAG_SHOT * rng.standard_normal()
        end = nine[6] - 1e-4 if contact is None else contact[k]
        at = course(
            nine,
            drag,
            camera.lift_sd * rng.standard_normal(2),
            end,
            0.0 if ahead is None else ahead[k],
        )
        count = int(0.3 * camera.fps)
        number = np.arange(-count, count + 1)
        t = taken = (number + rng.uniform()) * camera.clock / camera.fps
        for _ in range(5 if camera.row_time else 1):
            places = at(t)
            x = places[:, 0] / camera.scale
            y = places[:, 1] / camera.scale
            cos = np.cos(camera.tilt)
            sin = np.sin(camera.tilt)
            x, y = cos * x - sin * y, sin * x + cos * y + camera.court_height
            # A row lower in the picture is read later.
            t = taken + camera.row_time * (height - y) / (1e-3 * camera.mm_per_px)
        near = np.argmin(np.abs(t))
        away = np.flatnonzero((np.abs(x) > 0.5 * width) | (y > height))
        first = max(away[away < near], default=-1) + 1
        last = min(away[away > near], default=t.size)
        kept = np.arange(first, last)
        kept = kept[rng.uniform(size=kept.size) >= camera.lost]
        seen = np.column_stack([x, y])[kept] + camera.noise * rng.standard_normal((kept.size, 2))
        seen += camera.lasting * waves(t[kept], camera.lasting_time, rng)
        off = rng.uniform(size=kept.size) < camera.outliers
        seen[off] += (
            rng.choice([-1.0, 1.0], (kept.size, 2)) * rng.uniform(5e-3, 50e-3, (kept.size, 2))
        )[off]
        # Topspin turns clockwise where the ball flies to the right.
        angle = (
            rng.uniform(0.0, whole)
            - places[kept, 2]
            + camera.angle_noise * rng.standard_normal(kept.size)
        )
        wrong = rng.uniform(size=kept.size) < camera.angle_outliers
        angle = np.where(wrong, rng.uniform(0.0, whole, kept.size), angle) % whole
        side = -1.0 if camera.leftward else 1.0
        unit, size = ("px", 1e-3 * camera.mm_per_px) if camera.row_time else ("m", 1.0)
        piece = {"id": str(k + 1), "frame": number[kept] - number[kept[0]] + 50}
        piece |= {f"x [{unit}]": side * seen[:, 0] / size, f"y [{unit}]": seen[:, 1] / size}
        piece |= {"angle [rad]": side * angle, "angle_fold": camera.fold}
        pieces.append(pd.DataFrame(piece))
    return pd.concat(pieces, ignore_index=True)


def scores(film, truth):
    """Errors of the nine of impacts found (impacts, 9) over their stated sds, NaN where not
    measured, and alone.
    """
    frame = film.impacts
    rows = truth[[int(name) - 1 for name in frame.index]]
    none = np.full(len(frame), np.nan)
    heads = [
        [f"{name}{end} [{unit}]" for name, unit in zip(NINE, UNITS, strict=True)]
        for end in ("", "_sd")
    ]
    values, sds = (np.column_stack([frame.get(head, none) for head in part]) for part in heads)
    return (values - rows) / sds, values - rows
