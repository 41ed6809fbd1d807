"""A step of a ball over a plane, as ports have it: flight, bounce with its gaps, rest and rolling.

Functions are in the kernels' restricted Python and are never run here; their names and docstrings
stand in the files that users see.
"""

import math
from typing import NamedTuple

from fitball.exports.ports.offered import (
    NOT_FINITE,
    Parameters,
    Vector,
    along,
    cross,
    dot,
    plus,
    rebound_3d,
)
from fitball.models.kernels.contact import OK

# Bounces in one step: a hop that is shorter than the step ends in rest, so two are the most.
MOST_BOUNCES = 4


class Plane(NamedTuple):
    """A plane: its normal towards the ball, of any length; the height of its surface along the
    normal from the origin [m]; its velocity [m/s].
    """

    normal: Vector
    height: float
    velocity: Vector


class Flight(NamedTuple):
    """A ball: position of its centre [m], velocity [m/s], spin [rad/s], the angles that it turned
    [rad]; the time [s] by which a contact took it ahead; bounces in the last step, the status of
    the last one and whether it was extrapolated.
    """

    position: Vector
    velocity: Vector
    spin: Vector
    turn: Vector
    ahead: float
    bounces: int
    status: int
    extrapolated: bool


def step(
    flight: Flight, acceleration: Vector, dt: float, plane: Plane, parameters: Parameters
) -> Flight:
    """The ball after the time `dt` with a constant acceleration, over a plane on which it bounces,
    rests and rolls; where a number is not finite, as it was with the status -1.
    """
    up = along(plane.normal, Vector(math.nan, math.nan, math.nan))
    surface = plane.height + parameters.ball_radius
    g = dot(acceleration, up)
    # All is relative to the plane.
    p = plus(flight.position, -flight.ahead, plane.velocity)
    v = plus(flight.velocity, -1.0, plane.velocity)
    w = flight.spin
    turn = flight.turn
    rest = dt - flight.ahead
    bounces = 0
    status = OK
    extrapolated = False
    on_plane = False
    for _ in range(MOST_BOUNCES):
        t = falls_in(dot(p, up) - surface, dot(v, up), g)
        if not t < rest:
            break
        p = plus(plus(p, t, v), 0.5 * t * t, acceleration)
        v = plus(v, t, acceleration)
        turn = plus(turn, t, w)
        rest = rest - t
        # Where it touches, its centre is a radius above the plane.
        p = plus(p, surface - dot(p, up), up)
        if not dot(v, up) < 0.0:
            on_plane = True
            break
        found = rebound_3d(v, w, up, parameters)
        bounces = bounces + 1
        status = found.status
        extrapolated = found.extrapolated
        v = found.velocity
        w = found.spin
        if found.gap_time > 0.0:
            p = plus(p, 1.0, found.gap_path)
            turn = plus(turn, 1.0, found.gap_turn)
            rest = rest - found.gap_time
        # A hop that does not last a step is no flight any more.
        if 2.0 * dot(v, up) < -g * dt:
            on_plane = True
            break
    if on_plane:
        v = plus(v, -dot(v, up), up)
    if on_plane and rest > 0.0:
        rolled = rolling(plus(v, rest, plus(acceleration, -g, up)), w, up, -g * rest, parameters)
        p = plus(plus(p, 0.5 * rest, v), 0.5 * rest, rolled.velocity)
        turn = plus(plus(turn, 0.5 * rest, w), 0.5 * rest, rolled.spin)
        v = rolled.velocity
        w = rolled.spin
        rest = 0.0
    if rest > 0.0:
        p = plus(plus(p, rest, v), 0.5 * rest * rest, acceleration)
        v = plus(v, rest, acceleration)
        turn = plus(turn, rest, w)
        rest = 0.0
    p = plus(p, dt - rest, plane.velocity)
    v = plus(v, 1.0, plane.velocity)
    # What is not finite, or is left out in JavaScript, reaches one of these. The height of a
    # surface does not reach the ball, which passes through a surface without one.
    size = abs(surface + g + rest) + size_of(p, v) + size_of(w, turn)
    if not size < math.inf:
        return unmoved(flight)
    return Flight(p, v, w, turn, -rest, bounces, status, extrapolated)


def size_of(a: Vector, b: Vector) -> float:
    """A number that is finite if two vectors are."""
    return abs(a.x + a.y + a.z + b.x + b.y + b.z)


def unmoved(flight: Flight) -> Flight:
    """A ball as it was, where a number is not finite."""
    return Flight(
        flight.position,
        flight.velocity,
        flight.spin,
        flight.turn,
        flight.ahead,
        0,
        NOT_FINITE,
        True,
    )


def falls_in(height: float, v: float, g: float) -> float:
    """The time in which a ball at a height over its contact, with the velocity `v` and acceleration
    `g` upwards, falls to it.
    """
    if height <= 0.0 and v <= 0.0:
        return 0.0 if v < 0.0 or g < 0.0 else math.inf
    square = v * v - 2.0 * g * height
    if square < 0.0:
        return math.inf
    root = math.sqrt(square)
    if v > 0.0:
        return (v + root) / -g if g < 0.0 else math.inf
    return 2.0 * height / (root - v) if root - v > 0.0 else math.inf


class Rolling(NamedTuple):
    """Velocity and spin of a ball on a plane."""

    velocity: Vector
    spin: Vector


def rolling(
    velocity: Vector, spin: Vector, up: Vector, pressed: float, parameters: Parameters
) -> Rolling:
    """A ball that lies on a plane: friction brakes its slip, by `mu` times what it was `pressed`
    with [m/s] at most, until it rolls.
    """
    w = cross(spin, up)
    slip = plus(velocity, -parameters.ball_radius, w)
    size = math.sqrt(dot(slip, slip))
    a = parameters.inertia_ratio
    braked = min(parameters.mu * pressed, size * a / (1.0 + a))
    way = along(slip, Vector(0.0, 0.0, 0.0))
    w = plus(w, braked / (a * parameters.ball_radius), way)
    about = dot(spin, up)
    return Rolling(plus(velocity, -braked, way), plus(cross(up, w), about, up))
