"""A ball that falls and rises straight through still air, which brakes it by the square of speed.

With the terminal speed V, V^2 = 2 m g/(rho C_d pi R^2), a ball that falls from rest by a height h
lands at v, v^2 = V^2 (1 - exp(-2 g h/V^2)); one that leaves the ground at v rises to r, v^2 = V^2
(exp(2 g r/V^2) - 1). Both follow from v dv/dh = g - g v^2/V^2, or + on the way up. Here s = 2 g/V^2
= C_d rho pi R^2/m [1/m] is the `braking`; for s -> 0 both are v^2 = 2 g h.

A ball that leaves the ground at v with u = v/V is up for a time arctan(u) V/g and falls for a time
arsinh(u) V/g, by dv/dt = -g -+ g v^2/V^2; it lands at v/sqrt(1 + u^2). For s -> 0 the time of the
flight is 2 v/g.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fitball.base.itf import GRAVITY
from fitball.base.values import Ball, FloatArray

# Twice the acceleration of free fall [m/s^2]: v^2 = 2 g h.
_TWICE_G = 2.0 * GRAVITY
# Gas constant of dry air [J/(kg K)].
_GAS_CONSTANT = 287.05
# Zero degrees Celsius [K].
_ZERO_CELSIUS = 273.15
# Temperature [degrees Celsius] where only the pressure is stated.
_USUAL_TEMPERATURE = 20.0
# Pressure at sea level [Pa], where only the temperature is stated.
_USUAL_PRESSURE = 101_325.0
# Steps by which Newton's method finds a speed from a time: enough for all digits of a flight of
# 6 s, be it of a table tennis ball.
_STEPS = 8
# Density of the air [kg/m^3] where nothing is stated: dry air at 20 degrees and sea level.
_USUAL_DENSITY = 1.2


class Coefficient(NamedTuple):
    """A coefficient of the air on the ball and its standard deviation, both without unit."""

    value: float
    sd: float


# Drag of a ball below 15 m/s. No measurement of tennis balls at such speeds was found. The sd spans
# a smooth sphere (0.47), flights above 15 m/s (0.507, Cross and Lindsey 2014), the textbook of
# Brody, Cross and Lindsey (0.55) and wind tunnels (0.6 to 0.7, Mehta, Alam and Subic 2008).
SLOW_DRAG = Coefficient(0.55, 0.08)


def density(air: Mapping[str, float]) -> float:
    """Density of the air [kg/m^3]: as stated, or that of dry air at the stated pressure [Pa] and
    temperature [degrees Celsius].
    """
    if not air:
        return _USUAL_DENSITY
    celsius = air.get("temperature", _USUAL_TEMPERATURE)
    pressure = air.get("pressure", _USUAL_PRESSURE)
    kelvin = celsius + _ZERO_CELSIUS
    dry = pressure / (_GAS_CONSTANT * kelvin)
    return air.get("density", dry)


def braking_per_drag(ball: Ball, air: Mapping[str, float]) -> float:
    """What a drag coefficient of one brakes: s/C_d = rho pi R^2/m [1/m]."""
    area = pi * ball.radius**2
    return density(air) * area / ball.mass


def _numbers(values: ArrayLike) -> FloatArray:
    """The values as an array, complex ones too: derivatives are taken by complex steps."""
    return np.asarray(values)


def landing_speed(
    height: ArrayLike,
    braking: ArrayLike,
) -> Annotated[FloatArray, "..."]:
    """Speed [m/s] at which a ball lands that falls from rest by a height [m]; shapes broadcast."""
    s = _numbers(braking)
    sh = s * _numbers(height)
    squares = -_TWICE_G * np.expm1(-sh) / s
    return _numbers(np.sqrt(squares))


def drop_height(
    speed: ArrayLike,
    braking: ArrayLike,
) -> Annotated[FloatArray, "..."]:
    """Height [m] from which a ball falls that lands at a speed [m/s], below the terminal one;
    shapes broadcast.
    """
    s = _numbers(braking)
    squared_share = s * np.square(speed) / _TWICE_G
    sh = -np.log1p(-squared_share)
    return _numbers(sh / s)


def launch_speed(
    height: ArrayLike,
    braking: ArrayLike,
) -> Annotated[FloatArray, "..."]:
    """Speed [m/s] at which a ball leaves the ground that rises to a height [m]; shapes
    broadcast.
    """
    s = _numbers(braking)
    sh = s * _numbers(height)
    squares = _TWICE_G * np.expm1(sh) / s
    return _numbers(np.sqrt(squares))


def rebound_height(
    speed: ArrayLike,
    braking: ArrayLike,
) -> Annotated[FloatArray, "..."]:
    """Height [m] to which a ball rises that leaves the ground at a speed [m/s]; shapes
    broadcast.
    """
    s = _numbers(braking)
    squared_share = s * np.square(speed) / _TWICE_G
    sh = np.log1p(squared_share)
    return _numbers(sh / s)


def flight_time(speed: ArrayLike, braking: ArrayLike) -> FloatArray:
    """Time [s] from leaving the ground at a speed [m/s] until the ball is back on it; shapes
    broadcast.
    """
    s = _numbers(braking)
    u = _numbers(speed) * np.sqrt(s / _TWICE_G)
    # Of the terminal speed V: V/g.
    unit = np.sqrt(2.0 / (GRAVITY * s))
    up = np.arctan(u)
    down = np.arcsinh(u)
    return _numbers(unit * (up + down))


def launch_of_flight(time: ArrayLike, braking: ArrayLike) -> FloatArray:
    """Speed [m/s] at which a ball leaves the ground that is back on it after a time [s]; shapes
    broadcast. No formula has it: arctan(u) + arsinh(u) = t g/V is solved by Newton's method, which
    comes to the solution from below, since the left side grows ever more slowly.
    """
    s = _numbers(braking)
    wanted = _numbers(time) * np.sqrt(0.5 * GRAVITY * s)
    u = 0.5 * wanted
    for _ in range(_STEPS):
        left = np.arctan(u) + np.arcsinh(u)
        squares = 1.0 + u**2
        slope = 1.0 / squares + 1.0 / np.sqrt(squares)
        u = u + (wanted - left) / slope
    terminal = np.sqrt(_TWICE_G / s)
    return _numbers(u * terminal)


def landing_of_launch(speed: ArrayLike, braking: ArrayLike) -> FloatArray:
    """Speed [m/s] at which a ball lands that left the ground at a speed [m/s]; shapes broadcast."""
    s = _numbers(braking)
    v = _numbers(speed)
    squared_share = s * v**2 / _TWICE_G
    return _numbers(v / np.sqrt(1.0 + squared_share))


def launch_of_landing(speed: ArrayLike, braking: ArrayLike) -> FloatArray:
    """Speed [m/s] at which a ball left the ground that lands at a speed [m/s], below the terminal
    one; shapes broadcast.
    """
    s = _numbers(braking)
    v = _numbers(speed)
    squared_share = s * v**2 / _TWICE_G
    return _numbers(v / np.sqrt(1.0 - squared_share))


def landing_of_same_time(
    speed: ArrayLike,
    usual: ArrayLike,
    braking: ArrayLike,
) -> FloatArray:
    """Landing speed [m/s] with a `braking` of a flight that lasts as long as one that lands at a
    speed [m/s] with the `usual` braking; shapes broadcast.
    """
    usual_launch = launch_of_landing(speed, usual)
    time = flight_time(usual_launch, usual)
    launch = launch_of_flight(time, braking)
    return landing_of_launch(launch, braking)


def launch_of_same_time(
    speed: ArrayLike,
    usual: ArrayLike,
    braking: ArrayLike,
) -> FloatArray:
    """Speed [m/s] at which a flight with a `braking` starts that lasts as long as one that starts
    at a speed [m/s] with the `usual` braking; shapes broadcast.
    """
    time = flight_time(speed, usual)
    return launch_of_flight(time, braking)
