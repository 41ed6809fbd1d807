"""Falls and rises through air: against an independent integration, limits and inverses."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.near import assert_near

from fitball.base import air
from fitball.base.itf import GRAVITY
from fitball.base.values import Ball

TWICE_G = 2.0 * GRAVITY
TENNIS_BALL = Ball()
TABLE_TENNIS_BALL = Ball(0.0027, 0.02, 2.0 / 3.0)
# Of balls with the drag of a tennis ball and of a smooth sphere [1/m].
TENNIS = 0.55 * air.braking_per_drag(TENNIS_BALL, {})
TABLE_TENNIS = 0.445 * air.braking_per_drag(TABLE_TENNIS_BALL, {})
BALLS = pytest.mark.parametrize("braking", [TENNIS, TABLE_TENNIS])


def speed_after(start, end, speed, braking, sign):
    """The speed at a height `end` of a ball that had a `speed` at the height `start`: by v dv/dh =
    -g - sign s v^2/2, upwards with the sign 1 and downwards with -1.
    """

    def slope(_, squares):
        return -TWICE_G - sign * braking * squares

    solution = solve_ivp(
        slope,
        (start, end),
        [speed**2],
        rtol=1e-11,
        atol=1e-12,
    )
    return np.sqrt(solution.y[0, -1])


@BALLS
@pytest.mark.parametrize("height", [0.3, 1.0, 2.54, 10.0])
def test_falls_are_those_of_an_integration(height, braking):
    landing = air.landing_speed(height, braking)
    integrated = speed_after(height, 0.0, 0.0, braking, -1.0)
    assert_near(landing, integrated, 1e-9)


@BALLS
@pytest.mark.parametrize("height", [0.3, 1.0, 2.54, 10.0])
def test_rises_are_those_of_an_integration(height, braking):
    """Just below the top a ball is as fast as one that has only the rest to rise."""
    nearly = 0.999 * height
    launch = float(air.launch_speed(height, braking))
    integrated = speed_after(0.0, nearly, launch, braking, 1.0)
    of_the_rest = air.launch_speed(0.001 * height, braking)
    assert_near(integrated, of_the_rest, 1e-6)


@BALLS
def test_heights_and_speeds_are_inverse(braking):
    heights = np.array([0.01, 0.5, 2.54, 12.0])
    landing = air.landing_speed(heights, braking)
    dropped = air.drop_height(landing, braking)
    assert_near(dropped, heights, 1e-12)
    launch = air.launch_speed(heights, braking)
    risen = air.rebound_height(launch, braking)
    assert_near(risen, heights, 1e-12)


def test_without_air_speeds_are_those_of_free_fall():
    free = np.sqrt(TWICE_G * 2.54)
    landing = air.landing_speed(2.54, 1e-12)
    launch = air.launch_speed(2.54, 1e-12)
    assert_near(landing, free, 1e-12)
    assert_near(launch, free, 1e-12)


def test_a_little_air_counts_to_first_order():
    """From 1 m v^2 = 2 g h (1 -+ s h/2)."""
    half = 0.5e-3
    landing = air.landing_speed(1.0, 1e-3)
    launch = air.launch_speed(1.0, 1e-3)
    assert_near(landing**2, TWICE_G * (1.0 - half), 1e-6)
    assert_near(launch**2, TWICE_G * (1.0 + half), 1e-6)


def flown(speed, braking):
    """Time and landing speed of a ball thrown up at a speed, by dv/dt = -g - s |v| v/2."""

    def slope(_, state):
        _, v = state
        pull = 0.5 * braking * abs(v) * v
        return [v, -GRAVITY - pull]

    def lands(_, state):
        return state[0]

    lands.terminal = True
    lands.direction = -1.0
    flight = solve_ivp(
        slope,
        (0.0, 20.0),
        [0.0, speed],
        events=lands,
        rtol=1e-11,
        atol=1e-13,
    )
    (times,) = flight.t_events
    (states,) = flight.y_events
    _, velocity = states[-1]
    return times[-1], -velocity


@BALLS
@pytest.mark.parametrize("speed", [0.5, 2.7, 7.0, 25.0])
def test_flights_are_those_of_an_integration(speed, braking):
    time, landing = flown(speed, braking)
    time_of_launch = air.flight_time(speed, braking)
    landing_of_launch = air.landing_of_launch(speed, braking)
    launch_of_time = air.launch_of_flight(time, braking)
    launch_of_landing = air.launch_of_landing(landing, braking)
    assert_near(time_of_launch, time, 1e-8)
    assert_near(landing_of_launch, landing, 1e-8)
    assert_near(launch_of_time, speed, 1e-8)
    assert_near(launch_of_landing, speed, 1e-7)


def test_flights_agree_with_heights():
    """A flight is a rise to a height and a fall from there."""
    speeds = np.array([1.0, 5.0, 15.0])
    tops = air.rebound_height(speeds, TABLE_TENNIS)
    fallen = air.landing_speed(tops, TABLE_TENNIS)
    flown_through = air.landing_of_launch(speeds, TABLE_TENNIS)
    assert_near(flown_through, fallen, 1e-12)


@pytest.mark.parametrize("time", [0.01, 0.5, 3.0, 6.0])
@pytest.mark.parametrize("braking", [TENNIS, TABLE_TENNIS, 1e-9])
def test_speeds_of_flights_are_inverse(time, braking):
    speed = air.launch_of_flight(time, braking)
    again = air.flight_time(speed, braking)
    assert_near(again, time, 1e-12)


@pytest.mark.parametrize("time", [0.01, 0.5, 3.0, 6.0])
def test_flights_without_air_begin_at_half_of_g_t(time):
    speed = air.launch_of_flight(time, 1e-9)
    assert_near(speed, 0.5 * GRAVITY * time, 1e-6)


def test_no_ball_lands_faster_than_it_can_fall():
    terminal = np.sqrt(TWICE_G / TABLE_TENNIS)
    landing = air.landing_speed(50.0, TABLE_TENNIS)
    assert landing < terminal
    assert_near(landing, terminal, 1e-3)


def test_the_density_of_dry_air():
    """ISO 2533: 1.225 kg/m^3 at 15 degrees Celsius and sea level."""
    at_15_degrees = air.density({"temperature": 15.0})
    assert_near(at_15_degrees, 1.225, 1e-3)
    stated = {"density": 0.9, "temperature": 15.0}
    assert air.density(stated) == 0.9


@BALLS
def test_derivatives_may_be_taken_by_complex_steps(braking):
    """As predictions of heights take them: against differences."""
    step = 1e-6
    for function in (air.landing_speed, air.rebound_height, air.launch_of_flight):
        slope = function(1.5 + 1e-20j, braking).imag / 1e-20
        change = function(1.5 + step, braking) - function(1.5 - step, braking)
        assert_near(slope, change / (2.0 * step), 1e-7)
