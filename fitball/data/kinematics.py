"""The one kinematics: components, speed and angle of a velocity from whichever two are known, with their deviations.

The angle is the one between the velocity and the court, 0 to pi, above pi/2 when the ball moves backwards: v_x = v
cos(theta), v_y = v sin(theta). Independent standard deviations propagate linearly: each number remembers how it
depends on the independent inputs (derivative times standard deviation, one array an input), so that an input used
twice, in a numerator and a denominator say, is not counted as two: Taylor expansion to first order, as in the Guide
to the Expression of Uncertainty in Measurement (JCGM 100:2008, Eq. 10).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fitball.values import FloatArray

# Silence for what has no finite result; it stays visible as inf or NaN.
_quiet = np.errstate(divide="ignore", invalid="ignore", over="ignore")


@dataclass(frozen=True)
class Uncertain:
    """Numbers `value` (impacts,) and, by input, their first-order deviations `parts` (impacts,).

    Where an operation has no finite result (a vanishing denominator) the numbers are inf or NaN,
    without a warning: whoever uses them looks at each and says why it is absent.
    """

    value: FloatArray
    parts: Mapping[str, FloatArray]

    @staticmethod
    def measured(name: str, value: FloatArray, sd: FloatArray) -> Uncertain:
        """An independent input."""
        return Uncertain(value, {name: sd})

    @staticmethod
    def exact(value: FloatArray) -> Uncertain:
        """Numbers without uncertainty."""
        return Uncertain(value, {})

    @property
    def sd(self) -> FloatArray:
        """One standard deviation, (impacts,)."""
        total = np.zeros_like(self.value)
        for part in self.parts.values():
            total = np.hypot(total, part)
        return total

    @property
    def reach(self) -> FloatArray:
        """What all deviations together make at most, as those of rounding may, (impacts,)."""
        return sum((np.abs(part) for part in self.parts.values()), np.zeros_like(self.value))

    @_quiet
    def __add__(self, other: Uncertain) -> Uncertain:
        return _derived(self.value + other.value, (self, 1.0), (other, 1.0))

    @_quiet
    def __sub__(self, other: Uncertain) -> Uncertain:
        return _derived(self.value - other.value, (self, 1.0), (other, -1.0))

    @_quiet
    def __mul__(self, other: Uncertain) -> Uncertain:
        return _derived(self.value * other.value, (self, other.value), (other, self.value))

    @_quiet
    def __truediv__(self, other: Uncertain) -> Uncertain:
        ratio = self.value / other.value
        return _derived(ratio, (self, 1.0 / other.value), (other, -ratio / other.value))

    @_quiet
    def scaled(self, factor: float) -> Uncertain:
        """`factor` times this."""
        return _derived(factor * self.value, (self, factor))

    @_quiet
    def sin(self) -> Uncertain:
        """The sine of an angle in radians."""
        return _derived(np.sin(self.value), (self, np.cos(self.value)))

    @_quiet
    def cos(self) -> Uncertain:
        """The cosine of an angle in radians."""
        return _derived(np.cos(self.value), (self, -np.sin(self.value)))

    @_quiet
    def sqrt(self) -> Uncertain:
        """The square root; NaN for negative numbers."""
        root = np.sqrt(self.value)
        return _derived(root, (self, 0.5 / root))

    @_quiet
    def over(self, along: Uncertain) -> Uncertain:
        """The angle to the court [rad] of a velocity with this across it and `along` it, 0 to pi."""
        square = self.value**2 + along.value**2
        angle = np.arctan2(self.value, along.value)
        return _derived(angle, (self, along.value / square), (along, -self.value / square))


def _derived(value: FloatArray, *terms: tuple[Uncertain, FloatArray | float]) -> Uncertain:
    """`value`, a function of each of the terms with that derivative."""
    parts: dict[str, FloatArray] = {}
    for term, slope in terms:
        for name, part in term.parts.items():
            parts[name] = parts[name] + slope * part if name in parts else slope * part
    return Uncertain(value, parts)


def covariance_matrix(items: Sequence[Uncertain | None], count: int) -> FloatArray:
    """Covariance (count, items, items) of numbers (count,) that may share inputs; zeros for an item that is None."""
    covariance = np.zeros((count, len(items), len(items)))
    for i, one in enumerate(items):
        for j, other in enumerate(items):
            if one is None or other is None:
                continue
            for name, part in one.parts.items():
                if name in other.parts:
                    covariance[:, i, j] += part * other.parts[name]
    return covariance


@dataclass(frozen=True)
class Velocity:
    """What is known of a velocity; None where the known columns do not determine it."""

    x: Uncertain | None
    y: Uncertain | None
    speed_squared: Uncertain | None

    def columns(self, end: str) -> dict[str, Uncertain]:
        """The columns of `end` that it determines, by name."""
        speed = None if self.speed_squared is None else self.speed_squared.sqrt()
        angle = None if self.x is None or self.y is None else self.y.over(self.x)
        told = {f"v_x{end}": self.x, f"v_y{end}": self.y, f"v_{end}": speed, f"theta_{end}": angle}
        return {name: item for name, item in told.items() if item is not None}


def velocity(known: Mapping[str, Uncertain], end: str) -> Velocity:
    """The velocity `end` ("1" incident, "2" rebound) from the columns in `known`; components come first.

    From v_y and the speed alone the sign of v_x stays open, so x is None then.
    """
    x, y = known.get(f"v_x{end}"), known.get(f"v_y{end}")
    speed, angle = known.get(f"v_{end}"), known.get(f"theta_{end}")
    squared = None
    if x is None or y is None:
        squared = None if speed is None else speed * speed
        if speed is not None and angle is not None:
            x, y = speed * angle.cos(), speed * angle.sin()
        elif x is not None and angle is not None:
            y = x * angle.sin() / angle.cos()
        elif y is not None and angle is not None:
            x = y * angle.cos() / angle.sin()
        elif x is not None and squared is not None:
            y = (squared - x * x).sqrt()
    if squared is None and x is not None and y is not None:
        squared = x * x + y * y
    return Velocity(x, y, squared)


def independent(names: Iterable[str], end: str) -> tuple[str, ...]:
    """The velocity columns of one `end` ("1" or "2") that count: at most two, components before polar.

    With one component and both polar columns the polar pair counts: it always determines the
    velocity, while a component and the angle or the speed need not.
    """
    present = set(names)
    components = [f"v_x{end}", f"v_y{end}"]
    polar = [f"v_{end}", f"theta_{end}"]
    for pair in (components, polar):
        if present.issuperset(pair):
            return tuple(pair)
    return tuple(name for name in components + polar if name in present)
