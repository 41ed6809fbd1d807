"""Clips of a bouncing ball with known truth, for tests of readers: flights by scipy's integrator with gravity, drag
and lift, a bounce that lasts, and files as tracking programs write them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

RADIUS, MASS, DENSITY, G = 0.03302, 0.0576, 1.2, 9.80665
K = DENSITY * np.pi * RADIUS**2 / (2.0 * MASS)
CONTACT, PATH = 4.6e-3, 0.04


@dataclass(frozen=True)
class Film:
    """Times [s] from landing, positions (frames, 2) [m] of the centre above the court, and the mark's angle [rad]."""

    time: np.ndarray
    place: np.ndarray
    angle: np.ndarray
    fps: float


def flown(time, start, velocity, lift=0.15, drag=0.507):
    """Positions (times, 2) of a flight that is at `start` at time 0; times of either sign."""

    def rates(_t, state):
        v_x, v_y = state[2:]
        speed = np.hypot(v_x, v_y)
        side = np.sign(velocity[0]) * lift
        return [v_x, v_y, K * speed * (-drag * v_x + side * v_y), -G + K * speed * (-drag * v_y - side * v_x)]

    places = np.zeros((len(time), 2))
    for part in (time < 0.0, time >= 0.0):
        if part.any():
            end = time[part][np.argmax(np.abs(time[part]))]
            found = solve_ivp(rates, (0.0, end), [*start, *velocity], rtol=1e-10, atol=1e-12, dense_output=True)
            places[part] = found.sol(time[part])[:2].T
    return places


def film(fps=240.0, seconds=0.1, v_1=(15.0, -7.0), v_2=(9.5, 5.4), spins=(40.0, 300.0), noise=0.0, seed=1, phase=0.3):
    """A bounce filmed from `seconds` before landing to as long after release."""
    count = int(seconds * fps)
    time = (np.arange(-count, count + 1) + phase) / fps
    place, angle = np.zeros((len(time), 2)), np.zeros(len(time))
    before, after = time < 0.0, time > CONTACT
    inside = ~before & ~after
    place[before] = flown(time[before], (0.0, RADIUS), v_1)
    place[after] = flown(time[after] - CONTACT, (np.sign(v_1[0]) * PATH, RADIUS), v_2)
    share = time[inside] / CONTACT
    place[inside] = np.column_stack([np.sign(v_1[0]) * PATH * share, RADIUS - 0.012 * np.sin(np.pi * share)])
    angle[before], angle[after] = -spins[0] * time[before], -0.8 - spins[1] * (time[after] - CONTACT)
    place += noise * np.random.default_rng(seed).standard_normal(place.shape)
    return Film(time, place, angle, fps)


def bouncing(fps=240.0, heights=(1.0, 0.55, 0.3), noise=0.0, seed=1):
    """A ball dropped, that bounces as often as there are heights: times and positions, without air."""
    fall = np.sqrt(2.0 * np.array(heights) / G)
    ends = np.cumsum([fall[0], *(2.0 * fall[1:])])
    time = np.arange(int((ends[-1] + 0.5 * fall[-1]) * fps)) / fps
    which = np.searchsorted(ends, time)
    tops = np.array([0.0, *(ends[:-1] + fall[1:]), ends[-1] + 0.5 * fall[-1]])
    peaks = np.array([*heights, heights[-1] / 4.0])
    height = RADIUS + peaks[which] - 0.5 * G * (time - tops[which]) ** 2
    place = np.column_stack([1.5 * time, height])
    return time, place + noise * np.random.default_rng(seed).standard_normal(place.shape)


def comma(number):
    return f"{number:.5f}".replace(".", ",")


def long_table(shot, **columns):
    """`id,t [s],x [m],y [m]` and more columns of arrays by name."""
    head = ",".join(["id", "t [s]", "x [m]", "y [m]", *columns])
    rows = [
        ",".join(["a", f"{t:.6f}", f"{x:.6f}", f"{y:.6f}", *(f"{column[k]:.5f}" for column in columns.values())])
        for k, (t, (x, y)) in enumerate(zip(shot.time + 1.0, shot.place, strict=True))
    ]
    return "\n".join([head, *rows]) + "\n"
