"""Falls and rises through air: against an independent integration, limits and inverses."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fitball.base import air
from fitball.base.itf import GRAVITY
from fitball.base.values import Ball

TENNIS = 0.55 * air.braking_per_drag(Ball(), {})
TABLE_TENNIS = 0.445 * air.braking_per_drag(Ball(0.0027, 0.02, 2.0 / 3.0), {})


def integrated(start, end, braking, sign):
    """The speed after moving from one height to another, by v dv/dh = -g - sign s v^2/2 upwards."""

    def slope(_, squares):
        return -2.0 * GRAVITY - sign * braking * squares

    solution = solve_ivp(slope, *start, t_eval=[end], rtol=1e-11, atol=1e-12)
    return float(np.sqrt(solution.y[0, -1]))


@pytest.mark.parametrize("braking", [TENNIS, TABLE_TENNIS])
@pytest.mark.parametrize("height", [0.3, 1.0, 2.54, 10.0])
def test_falls_and_rises_are_those_of_an_integration(height, braking):
    landing = integrated(((height, 0.0), [0.0]), 0.0, braking, -1.0)
    assert air.landing_speed(height, braking) == pytest.approx(landing, rel=1e-9)
    start = float(air.launch_speed(height, braking))
    top = integrated(((0.0, 0.999 * height), [start**2]), 0.999 * height, braking, 1.0)
    left = air.launch_speed(0.001 * height, braking)
    assert top == pytest.approx(float(left), rel=1e-6)


@pytest.mark.parametrize("braking", [TENNIS, TABLE_TENNIS])
def test_heights_and_speeds_are_inverse(braking):
    heights = np.array([0.01, 0.5, 2.54, 12.0])
    back = air.drop_height(air.landing_speed(heights, braking), braking)
    assert back == pytest.approx(heights, rel=1e-12)
    back = air.rebound_height(air.launch_speed(heights, braking), braking)
    assert back == pytest.approx(heights, rel=1e-12)


def test_without_air_speeds_are_those_of_free_fall():
    free = np.sqrt(2.0 * GRAVITY * 2.54)
    assert air.landing_speed(2.54, 1e-12) == pytest.approx(free, rel=1e-12)
    assert air.launch_speed(2.54, 1e-12) == pytest.approx(free, rel=1e-12)
    # Half of the first order: v^2 = 2 g h (1 -+ s h/2).
    assert air.landing_speed(1.0, 1e-3) ** 2 == pytest.approx(2.0 * GRAVITY * (1 - 5e-4), rel=1e-6)
    assert air.launch_speed(1.0, 1e-3) ** 2 == pytest.approx(2.0 * GRAVITY * (1 + 5e-4), rel=1e-6)


def flown(speed, braking):
    """Time and landing speed of a ball thrown up at a speed, by dv/dt = -g - s |v| v/2."""

    def slope(_, state):
        return [state[1], -GRAVITY - 0.5 * braking * abs(state[1]) * state[1]]

    def lands(_, state):
        return state[0]

    lands.terminal = True
    lands.direction = -1.0
    flight = solve_ivp(slope, (0.0, 20.0), [0.0, speed], events=lands, rtol=1e-11, atol=1e-13)
    return flight.t_events[0][-1], -flight.y_events[0][-1, 1]


@pytest.mark.parametrize("braking", [TENNIS, TABLE_TENNIS])
@pytest.mark.parametrize("speed", [0.5, 2.7, 7.0, 25.0])
def test_flights_are_those_of_an_integration(speed, braking):
    time, landing = flown(speed, braking)
    assert air.flight_time(speed, braking) == pytest.approx(time, rel=1e-8)
    assert air.landing_of_launch(speed, braking) == pytest.approx(landing, rel=1e-8)
    assert air.launch_of_flight(time, braking) == pytest.approx(speed, rel=1e-8)
    assert air.launch_of_landing(landing, braking) == pytest.approx(speed, rel=1e-7)


def test_flights_agree_with_heights():
    """A flight is a rise to a height and a fall from there."""
    speeds = np.array([1.0, 5.0, 15.0])
    tops = air.rebound_height(speeds, TABLE_TENNIS)
    landing = air.landing_speed(tops, TABLE_TENNIS)
    assert air.landing_of_launch(speeds, TABLE_TENNIS) == pytest.approx(landing, rel=1e-12)


@pytest.mark.parametrize("time", [0.01, 0.5, 3.0, 6.0])
def test_speeds_of_flights_are_inverse(time):
    for braking in (TENNIS, TABLE_TENNIS, 1e-9):
        speed = air.launch_of_flight(time, braking)
        assert air.flight_time(speed, braking) == pytest.approx(time, rel=1e-12)
    assert air.launch_of_flight(time, 1e-9) == pytest.approx(0.5 * GRAVITY * time, rel=1e-6)


def test_no_ball_lands_faster_than_it_can_fall():
    terminal = np.sqrt(2.0 * GRAVITY / TABLE_TENNIS)
    assert air.landing_speed(50.0, TABLE_TENNIS) == pytest.approx(terminal, rel=1e-3)
    assert air.landing_speed(50.0, TABLE_TENNIS) < terminal


def test_the_density_of_dry_air():
    """ISO 2533: 1.225 kg/m^3 at 15 degrees Celsius and sea level."""
    assert air.density({"temperature": 15.0}) == pytest.approx(1.225, rel=1e-3)
    assert air.density({"density": 0.9, "temperature": 15.0}) == 0.9
