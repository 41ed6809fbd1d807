"""Tracked impacts as an estimator would have found them, made from simulated ones: for tests of files and pages."""

import dataclasses

import numpy as np

import fitball
from fitball.data.scene import Camera, Quantity
from fitball.tracks.flight import fly, lift_of, resistance
from fitball.tracks.frames import (
    AFTER,
    BEFORE,
    CONTACT,
    NINE,
    Check,
    Filmed,
    Flight,
    Refused,
    SessionNoise,
    SpinPair,
    TrackedImpact,
    Tracks,
)
from fitball.tracks.simulate import Film, simulated_tracks, truth

VALUES = {
    "mass_ratio": 0.883, "k_y": 2.0e4, "k_theta": 19.0, "mu": 0.568, "eps_10": 2.38e-3, "eps_slope": 0.0,
    "cor_10": 0.774, "cor_slope": -0.0151,
}  # fmt: skip
SDS = np.array([0.025, 0.025, 0.8, 0.02, 0.02, 0.6, 8e-5, 1.2e-3, 0.03])


def incident(count, seed=1):
    """Incident states as a machine makes them."""
    rng = np.random.default_rng(seed)
    speed, angle = rng.uniform(12.0, 25.0, count), np.radians(rng.uniform(16.0, 60.0, count))
    v_y = np.clip(speed * np.sin(angle), 4.0, 16.0)
    return fitball.impacts(speed * np.cos(angle), v_y, rng.uniform(-300.0, 400.0, count))


def covariance():
    """One with the correlation that landing places have with speeds."""
    correlation = np.eye(len(NINE))
    for one, other, size in ((1, 6, 0.6), (4, 6, -0.5), (0, 7, 0.5), (2, 8, 0.4), (0, 1, -0.2)):
        correlation[one, other] = correlation[other, one] = size
    return correlation * SDS * SDS[:, None]


def tracks_of(count=6, film=None, seed=1, unsure=(), unmarked=(), sessions=("",), camera=None):
    """Impacts with errors drawn from their covariance; ids are 1, 2, ..."""
    film = film or Film()
    rng, impacts = np.random.default_rng(seed), incident(count, seed)
    rebound = fitball.model("two-mass").rebound(VALUES, impacts)
    made = []
    names = [sessions[k % len(sessions)] for k in range(count)]
    for k, (track, true) in enumerate(
        zip(simulated_tracks(impacts, rebound, film, rng), truth(impacts, rebound), strict=True)
    ):
        values = true + rng.multivariate_normal(np.zeros(len(NINE)), covariance())
        made.append(
            _impact(dataclasses.replace(track, session=names[k]), values, true, k not in unsure, k in unmarked)
        )
    noise = {name: SessionNoise(1e-3, 9e-4, 0.035, 0.02, 1.2, count) for name in dict.fromkeys(names)}
    return Tracks(
        Filmed(),
        tuple(made),
        (Refused("99", "clip.csv", "2 frames after the contact; 3 on a side are needed"),),
        noise,
        dict.fromkeys(noise, Check(9.9, 0.2)),
        dict.fromkeys(noise, Check(1.004, 0.01)),
        camera or Camera(Quantity(1.0, 0.01), None, Quantity(0.0, 0.005), Quantity(0.0, 0.003), film.fps),
    )  # fmt: skip


def _impact(track, values, true, sure, unmarked):
    landing, x = float(track.time[np.argmin(track.y)]) - 0.5 * true[6], float(track.x[np.argmin(track.y)])
    mirrored = bool(track.x[-1] < track.x[0])
    turned = (1.0 if mirrored else -1.0) * (track.angle if track.angle is not None else np.nan)
    role = np.where(track.time < landing, BEFORE, np.where(track.time > landing + true[6], AFTER, CONTACT))
    ball = fitball.Ball()
    k = resistance(ball, 1.2)
    residual, flights = np.full((track.time.size, 2), np.nan), []
    for side, (at, place, v_x, v_y, omega) in enumerate(
        ((landing, x, true[0], -true[1], true[2]), (landing + true[6], x + true[7], true[3], true[4], true[5]))
    ):
        lift = float(lift_of(omega, np.hypot(v_x, v_y), ball.radius))
        own = role == (BEFORE, AFTER)[side]
        seen = np.column_stack([(-1.0 if mirrored else 1.0) * track.x[own], track.y[own]])
        for _ in range(12):
            # When and where the flight passes: by the medians of its frames.
            path = fly((place, ball.radius, v_x, v_y), 0.507, lift, k, track.time[own] - at)[:, :2]
            at -= float(np.median(seen[:, 1] - path[:, 1])) / v_y
            place += float(np.median(seen[:, 0] - path[:, 0]))
        residual[own] = seen - fly((place, ball.radius, v_x, v_y), 0.507, lift, k, track.time[own] - at)[:, :2]
        start = np.nan
        if track.angle is not None:
            start = float(np.angle(np.exp(1j * (turned[own] - omega * (track.time[own] - at))).mean()))
        flights.append(Flight(at, place, ball.radius, v_x, v_y, 0.507, lift, start, omega))
    matrix, spins = covariance(), [2, 5, 8]
    pairs = () if unmarked else (
        SpinPair(values[2], values[5], values[8], 0.9995 if sure else 0.8, matrix[np.ix_(spins, spins)]),
        SpinPair(
            values[2] - 754.0, values[5] - 754.0, values[8] - 3.0, 0.0005 if sure else 0.2,
            matrix[np.ix_(spins, spins)],
        ),
    )  # fmt: skip
    if not sure or unmarked:
        values = values.copy()
        values[spins] = np.nan
        matrix[spins] = matrix[:, spins] = 0.0
    weight = np.where(np.abs(residual).max(axis=1) > 4e-3, 0.01, 0.99)
    return TrackedImpact(
        track.id, track, values, matrix, *flights, role, weight, residual, np.full(track.time.size, np.nan), pairs,
        sure and not unmarked, mirrored, () if sure else ("two pairs of spins are possible: 0.80 and 0.20",),
    )  # fmt: skip
