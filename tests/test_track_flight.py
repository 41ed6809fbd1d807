"""Flight of a ball against scipy's integration of the published equations."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fitball.tracks.flight import GRAVITY, SHORT, acceleration, expansion, fly, lift_of, resistance, series
from fitball.values import Ball

TENNIS = resistance(Ball(), 1.2)
TABLE_TENNIS = resistance(Ball(mass=0.0027, radius=0.02, inertia=0.66 * 0.0027 * 0.02**2), 1.2)
FLIGHTS = [
    (25.0, -12.0, 0.507, 0.25, TENNIS),
    (18.0, 7.0, 0.6, -0.2, TENNIS),
    (4.0, -3.0, 0.45, 0.1, TABLE_TENNIS),
    (-2.0, 5.0, 0.507, 0.0, TENNIS),
]


def published(_time: float, state: np.ndarray, drag: float, lift: float, k: float) -> list[float]:
    """Mehta, Alam and Subic 2008: drag against the velocity, lift across it, down for topspin towards +x."""
    _x, _y, v_x, v_y = state
    speed = np.hypot(v_x, v_y)
    size = k * speed**2
    along, across = np.array([v_x, v_y]) / speed, np.array([v_y, -v_x]) / speed
    force = -size * drag * along + size * lift * across - np.array([0.0, 9.80665])
    return [v_x, v_y, *force]


def oracle(v_x, v_y, drag, lift, k, time):
    made = solve_ivp(published, (0.0, time), [0.0, 0.0, v_x, v_y], args=(drag, lift, k), rtol=1e-11, atol=1e-12)
    return made.y[:, -1]


@pytest.mark.parametrize("flight", FLIGHTS)
def test_a_flight_is_that_of_scipy(flight):
    for time in (-0.6, -0.15, 0.003, 0.4, 1.0):
        x, y, v_x, v_y = fly([1.0, 2.0, *flight[:2]], *flight[2:], [time])[0]
        assert np.allclose([x - 1.0, y - 2.0, v_x, v_y], oracle(*flight, time), atol=2e-7)


@pytest.mark.parametrize("flight", FLIGHTS)
def test_the_series_holds_a_tenth_of_a_millimetre_while_it_is_used(flight):
    for time in (-SHORT, -0.05, 0.1, SHORT):
        x, y, v_x, v_y = series(*flight, time)
        exact = oracle(*flight, time)
        assert np.hypot(x - exact[0], y - exact[1]) < 1e-4
        assert np.hypot(v_x - exact[2], v_y - exact[3]) < 5e-3


@pytest.mark.parametrize("flight", FLIGHTS)
def test_the_expansion_is_made_of_derivatives_by_time(flight):
    """By differences of the acceleration along the flight."""
    step = 1e-3
    at = [
        np.array(acceleration(*fly([0, 0, *flight[:2]], *flight[2:], [d])[0, 2:], *flight[2:]))
        for d in (-step, 0.0, step)
    ]
    a_x, a_y, j_x, j_y, s_x, s_y = expansion(*flight)
    assert np.allclose([a_x, a_y], at[1], rtol=1e-12)
    assert np.allclose([j_x, j_y], (at[2] - at[0]) / (2 * step), rtol=1e-5, atol=1e-4)
    assert np.allclose([s_x, s_y], (at[2] - 2 * at[1] + at[0]) / step**2, rtol=1e-4, atol=1e-3)


def test_lift_is_that_of_cross_and_lindsey():
    speed, radius = 20.0, 0.033
    for omega in (-400.0, -30.0, 30.0, 400.0):
        spin_ratio = radius * abs(omega) / speed
        assert np.isclose(lift_of(omega, speed, radius), np.sign(omega) / (2.022 + 0.981 / spin_ratio), rtol=1e-12)
    assert lift_of(0.0, speed, radius) == 0.0
    assert np.allclose(lift_of(np.array([-50.0, 50.0]), np.array([9.0, 9.0]), radius) @ [1, 1], 0.0)


def test_topspin_turns_a_ball_down_and_without_air_it_falls():
    assert acceleration(20.0, 0.0, 0.5, 0.2, TENNIS)[1] < acceleration(20.0, 0.0, 0.5, 0.0, TENNIS)[1] == -GRAVITY
    assert np.allclose(
        fly([0, 0, 3.0, 4.0], 0.5, 0.2, 0.0, [0.5])[0], [1.5, 2.0 - GRAVITY / 8, 3.0, 4.0 - GRAVITY / 2]
    )
    assert np.isclose(TENNIS, 0.0357, atol=1e-4)
