"""Components and speed of a velocity from whichever two of v_x, v_y, speed and angle are known.

The angle is the one between the velocity and the court, 0 to pi, above pi/2 when the ball moves
backwards: v_x = v cos(theta), v_y = v sin(theta).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fitball.data.propagation import Uncertain


@dataclass(frozen=True)
class Velocity:
    """What is known of a velocity; None where the known columns do not determine it."""

    x: Uncertain | None
    y: Uncertain | None
    speed_squared: Uncertain | None


def velocity(known: Mapping[str, Uncertain], end: str) -> Velocity:
    """The velocity `end` ("1" incident, "2" rebound) from the columns in `known`; components come first.

    From v_y and the speed alone the sign of v_x stays open, so x is None then.
    """
    x, y = known.get(f"v_x{end}"), known.get(f"v_y{end}")
    speed, angle = known.get(f"v_{end}"), known.get(f"theta_{end}")
    if x is not None and y is not None:
        return Velocity(x, y, x * x + y * y)
    if speed is not None and angle is not None:
        return Velocity(speed * angle.cos(), speed * angle.sin(), speed * speed)
    if x is not None and angle is not None:
        y = x * angle.sin() / angle.cos()
        return Velocity(x, y, x * x + y * y)
    if y is not None and angle is not None:
        x = y * angle.cos() / angle.sin()
        return Velocity(x, y, x * x + y * y)
    if speed is not None:
        squared = speed * speed
        if x is not None:
            y = (squared - x * x).sqrt()
        return Velocity(x, y, squared)
    return Velocity(x, y, None)
