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

UNITS = {
    "v_x1": "m/s",
    "v_y1": "m/s",
    "omega_1": "rad/s",
    "v_x2": "m/s",
    "v_y2": "m/s",
    "omega_2": "rad/s",
    "gap_time": "s",
    "gap_path": "m",
    "gap_turn": "rad",
}
TRACKED_NAMES = tuple(UNITS)
# Standard gravity [m/s^2].
G = 9.80665
# A tennis ball: radius [m], mass [kg], moment of inertia over m r^2.
RADIUS = 0.03302
MASS = 0.0576
RATIO = 0.56
# Air [kg/m^3], the drag coefficient in it, and the sd of that coefficient from shot to shot.
DENSITY = 1.2
DRAG = 0.507
DRAG_SHOT = 0.024
# The turn of the shell ahead of the core decays with this time constant after release [s].
TWIST_DECAY = 1.5e-3
# How long both flights are followed from the contact [s].
LONGEST = 0.4
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
    """The quantities of `UNITS` of impacts like Wang's, (count, 9), SI, by Walton's impulse on a
    round body with an offset of 2.4 mm.
    """
    speed = rng.uniform(12.0, 25.0, count)
    angle = np.radians(rng.uniform(16.0, 60.0, count))
    v_x = speed * np.cos(angle)
    v_y = np.clip(speed * np.sin(angle), 4.0, 16.0)
    omega = rng.uniform(-300, 400, count)
    cor = 0.775 - 0.014 * (v_y - 10.0)
    offset = 2.4e-3
    normal_impulse = v_y * (1.0 + cor)
    moment = offset * normal_impulse / RADIUS
    slip = v_x - RADIUS * omega
    grip = RATIO / (1.0 + RATIO) * (1.1 * slip + moment / RATIO)
    most = 0.56 * normal_impulse
    friction_impulse = np.clip(grip, -most, most)
    v_x2 = v_x - friction_impulse
    v_y2 = cor * v_y
    omega_2 = omega + (friction_impulse - moment) / (RATIO * RADIUS)
    time = 4.9e-3 + 1e-4 * rng.standard_normal(count)
    path = time * (0.45 * v_x + 0.55 * v_x2)
    turn = time * (omega + 0.6 * (omega_2 - omega))
    return np.stack([v_x, v_y, omega, v_x2, v_y2, omega_2, time, path, turn], axis=1)


def flight(v_x, v_y, omega, drag, extra, until, air=1.0):
    """A flight from (0, 0) as a function of times up to `until` [s] of either sign, with the lift
    of Cross and Lindsey (2014) and an extra: x, y [m] and their velocities (4, times).
    """
    ratio = RADIUS * omega / np.hypot(v_x, v_y)
    lift = ratio / (0.981 + 2.022 * abs(ratio)) + extra
    k = air * DENSITY * np.pi * RADIUS**2 / (2.0 * MASS)

    def rates(_time, state):
        _, _, forward, upward = state
        pull = k * np.hypot(forward, upward)
        return (
            forward,
            upward,
            -pull * (drag * forward - lift * upward),
            -G - pull * (drag * upward + lift * forward),
        )

    solution = solve_ivp(
        rates,
        (0.0, until),
        (0.0, 0.0, v_x, v_y),
        "DOP853",
        dense_output=True,
        rtol=1e-10,
        atol=1e-12,
    )
    return solution.sol


def course(tracked, drag, extra, end, ahead):
    """The function of times [s] to positions [m] and turn [rad], (times, 3), of a ball that lands
    at time 0. During the contact, until `end`, it is a cubic between both flights.
    """
    v_x1, v_y1, omega_1, v_x2, v_y2, omega_2, gap_time, gap_path, gap_turn = tracked
    before = flight(v_x1, -v_y1, omega_1, drag, extra[0], -LONGEST)
    after = flight(v_x2, v_y2, omega_2, drag, extra[1], LONGEST)
    # The flight after, carried back into the contact.
    carried_back = flight(v_x2, v_y2, omega_2, drag, extra[1], -0.02)

    def incident(t):
        x, y, *_ = before(np.clip(t, -LONGEST, 0.0))
        return np.stack([x, y, omega_1 * t], axis=-1)

    def released(t):
        since = t - gap_time
        x, y, *_ = np.where(
            since < 0.0,
            carried_back(np.clip(since, -0.02, 0.0)),
            after(np.clip(since, 0.0, LONGEST)),
        )
        swing = ahead * np.exp(-(t - end) / TWIST_DECAY)
        turn = gap_turn + omega_2 * since + swing
        return np.stack([gap_path + x, y, turn], axis=-1)

    def in_contact(t):
        s = np.clip(t / end, 0.0, 1.0)[:, None]
        first, second = released(np.array([end, end + 1e-6]))
        rate_of_landing = np.array([v_x1, -v_y1, omega_1])
        rate_of_release = (second - first) * 1e6
        leaving = s * (1.0 - s) ** 2 * rate_of_landing * end
        arriving = s**2 * (s - 1.0) * rate_of_release * end
        return leaving + s**2 * (3.0 - 2.0 * s) * first + arriving

    def position_and_turn(t):
        t_column = t[:, None]
        rebounding = released(np.maximum(t, end))
        from_landing = np.where(t_column < end, in_contact(t), rebounding)
        of_centre = np.where(t_column < 0.0, incident(t), from_landing)
        return of_centre + np.array([0.0, RADIUS, 0.0])

    return position_and_turn


def waves(t, lasting, rng):
    """Errors (times, 2) of unit sd with correlation exp(-t^2/(2 lasting^2))."""
    rates = rng.standard_normal((24, 2)) / lasting
    phases = rng.uniform(0.0, 2.0 * np.pi, (24, 2))
    angles = t[:, None, None] * rates + phases
    return np.sqrt(2.0 / 24.0) * np.cos(angles).sum(axis=1)


def in_picture(camera, number, phase, of_ball, height):
    """Times (frames,) [s], x and y in the picture [m], and positions of the ball, by frame."""
    taken = (number + phase) * camera.clock / camera.fps
    t = taken
    cos = np.cos(camera.tilt)
    sin = np.sin(camera.tilt)
    # A row lower in the picture is read later: times and places are found in turns.
    for _ in range(5 if camera.row_time else 1):
        places = of_ball(t)
        along = places[:, 0] / camera.scale
        above = places[:, 1] / camera.scale
        x = cos * along - sin * above
        y = sin * along + cos * above + camera.court_height
        rows_below_top = (height - y) / (1e-3 * camera.mm_per_px)
        t = taken + camera.row_time * rows_below_top
    return t, x, y, places


def frames_in_view(t, x, y, width, height):
    """Numbers of the frames around the impact of which each shows the ball."""
    near = np.argmin(np.abs(t))
    away = np.flatnonzero((np.abs(x) > 0.5 * width) | (y > height))
    first = max(away[away < near], default=-1) + 1
    last = min(away[away > near], default=t.size)
    return np.arange(first, last)


def filmed(truth, camera, rng, contact=None, ahead=None):
    """The long table that a camera makes of impacts (impacts, 9): metres, or pixels with a rolling
    shutter.
    """
    width, height = next(size for least, size in VIEWS.items() if camera.fps >= least)
    # Angles of which the marks on the ball look alike.
    period = 2.0 * np.pi / camera.fold
    count = int(0.3 * camera.fps)
    number = np.arange(-count, count + 1)
    pieces = []
    for k, tracked in enumerate(truth):
        drag = camera.drag + DRAG_SHOT * rng.standard_normal()
        extra_lift = camera.lift_sd * rng.standard_normal(2)
        end = tracked[6] - 1e-4 if contact is None else contact[k]
        swing = 0.0 if ahead is None else ahead[k]
        of_ball = course(tracked, drag, extra_lift, end, swing)
        t, x, y, places = in_picture(camera, number, rng.uniform(), of_ball, height)
        rows = frames_in_view(t, x, y, width, height)
        rows = rows[rng.uniform(size=rows.size) >= camera.lost]
        both = (rows.size, 2)
        seen = np.column_stack([x, y])[rows] + camera.noise * rng.standard_normal(both)
        seen += camera.lasting * waves(t[rows], camera.lasting_time, rng)
        off = rng.uniform(size=rows.size) < camera.outliers
        sides = rng.choice([-1.0, 1.0], both)
        distances = sides * rng.uniform(5e-3, 50e-3, both)
        seen[off] += distances[off]
        # Topspin turns clockwise where the ball flies to the right.
        angle = rng.uniform(0.0, period) - places[rows, 2]
        angle += camera.angle_noise * rng.standard_normal(rows.size)
        wrong = rng.uniform(size=rows.size) < camera.angle_outliers
        anywhere = rng.uniform(0.0, period, rows.size)
        angle = np.where(wrong, anywhere, angle) % period
        side = -1.0 if camera.leftward else 1.0
        unit = "px" if camera.row_time else "m"
        size = 1e-3 * camera.mm_per_px if camera.row_time else 1.0
        piece = {
            "id": str(k + 1),
            "frame": number[rows] - number[rows[0]] + 50,
            f"x [{unit}]": side * seen[:, 0] / size,
            f"y [{unit}]": seen[:, 1] / size,
            "angle [rad]": side * angle,
            "angle_fold": camera.fold,
        }
        pieces.append(pd.DataFrame(piece))
    return pd.concat(pieces, ignore_index=True)


def scores(film, truth):
    """Errors (impacts, 9) of the impacts of a film over their stated sds, and the errors
    themselves, SI; NaN where not measured.
    """
    frame = film.impacts
    rows = truth[[int(name) - 1 for name in frame.index]]
    missing = np.full(len(frame), np.nan)
    values = []
    sds = []
    for name, unit in UNITS.items():
        values.append(frame.get(f"{name} [{unit}]", missing))
        sds.append(frame.get(f"{name}_sd [{unit}]", missing))
    errors = np.column_stack(values) - rows
    return errors / np.column_stack(sds), errors
