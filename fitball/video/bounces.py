"""Balls among flights: a flight that falls as on earth ends where the next one begins."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from fitball.base.itf import GRAVITY
from fitball.video.flights import End, Flight, gravity_px

# Flights of one ball, by time.
Chain: TypeAlias = tuple[Flight, ...]
# Spots know radii and places roughly: a fall may be off by these shares of that of a ball of its
# size beside its own error, and places by a share of the diameter.
_LEAST_FALL = 0.62
_MOST_FALL = 1.6
_FALL_SDS = 3.0
_PLACE_ERROR = 0.05
# Deceleration by air over the square of velocity [1/m]: a tennis ball, twice over.
_AIR = 0.03
# Between the flights of a bounce there are at most so many seconds or frames.
_MOST_TIME = 0.07
_MOST_FRAMES = 3.3
# Radii of both flights differ by less than this factor; their paths meet to within so many radii.
_SAME_RADIUS = 1.5
_MEETING = 1.2
# A bounce turns a ball upwards by at least so many times what it gains between the flights. Errors
# of their ends make a bounce of the top of one flight, but a slow one.
_LEAST_TURN = 1.5
# A ball rises at most so much faster than it fell.
_MOST_RISE = 1.15


def balls_of(flights: Sequence[Flight], diameter: float) -> list[Chain]:
    """Chains of at least two flights, the longest first, of balls of this diameter [m]."""
    rest = [flight for flight in flights if falls(flight, diameter)]
    rest.sort(key=lambda flight: flight.times[0])
    chains: list[Chain] = []
    while rest:
        chain: Chain = (rest.pop(0),)
        while True:
            fits = (k for k, later in enumerate(rest) if _bounces(chain[-1], later, diameter))
            next_one = next(fits, None)
            if next_one is None:
                break
            chain = (*chain, rest.pop(next_one))
        chains.append(chain)
    bounced = [chain for chain in chains if len(chain) > 1]
    return sorted(bounced, key=lambda chain: -frames_of(chain))


def frames_of(chain: Chain) -> int:
    """In how many frames the spots of a chain are."""
    return sum(len(flight.frames) for flight in chain)


def falls(flight: Flight, diameter: float) -> bool:
    """Whether a flight may be that of a ball of its size; one that is known not to fall so is
    none.
    """
    fall, sd = flight.fall()
    if not np.isfinite(fall):
        return True
    metre = 2.0 * flight.radius / diameter
    gravity = GRAVITY * metre
    x, y = flight.curve
    speed = np.hypot(x[0], y[-2]) / metre
    slack = _FALL_SDS * sd / gravity
    slack += (_AIR * speed**2 + 8.0 * _PLACE_ERROR * diameter / flight.span**2) / GRAVITY
    return bool(_LEAST_FALL - slack < fall / gravity < _MOST_FALL + slack)


def _bounces(before: Flight, after: Flight, diameter: float) -> bool:
    """Whether a flight begins where the one before ends, that falling, this rising, and not
    faster.
    """
    gap = after.times[0] - before.times[-1]
    if not 0.0 < gap < max(_MOST_TIME, _MOST_FRAMES * min(before.step, after.step)):
        return False
    ratio = before.radius / after.radius
    if not 1.0 / _SAME_RADIUS < ratio < _SAME_RADIUS:
        return False
    gravity = gravity_px(float(np.sqrt(before.radius * after.radius)), diameter)
    return meets(before.end(True, gravity), after.end(False, gravity), before.radius)


def meets(end: End, start: End, radius: float) -> bool:
    """Whether a ball that comes from `end` may leave as `start`: at the time at which both are at
    one height they are at one place, and the court sends it up.
    """
    times = np.linspace(end.time, start.time, 41)
    apart = np.array([end.at(time) - start.at(time) for time in times])
    best = int(np.argmin(np.abs(apart[:, 1])))
    down = end.velocity_at(times[best])
    up = start.velocity_at(times[best])
    if not (down[1] > 0.0 > up[1] and -up[1] < _MOST_RISE * down[1]):
        return False
    gained = end.gravity * (start.time - end.time)
    if down[1] - up[1] < _LEAST_TURN * gained:
        return False
    backwards = down[0] * up[0] < -0.2 * down[1] ** 2
    return bool(not backwards and np.hypot(*apart[best]) < _MEETING * radius + 3.0)
