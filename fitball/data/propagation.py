"""Linear propagation of independent standard deviations through arithmetic.

Each number remembers how it depends on the independent inputs (derivative times standard deviation, one
array an input), so that an input used twice, in a numerator and a denominator say, is not counted
as two: Taylor expansion to first order, as in the Guide to the Expression of Uncertainty in
Measurement (JCGM 100:2008, Eq. 10).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fitball.values import FloatArray


def _quiet() -> np.errstate:
    """Silence for what has no finite result; it stays visible as inf or NaN."""
    return np.errstate(divide="ignore", invalid="ignore", over="ignore")


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

    def _with(self, other: Uncertain, value: FloatArray, mine: FloatArray, others: FloatArray) -> Uncertain:
        """`value` whose derivatives by self and other are `mine` and `others`."""
        parts = {name: mine * part for name, part in self.parts.items()}
        for name, part in other.parts.items():
            parts[name] = parts[name] + others * part if name in parts else others * part
        return Uncertain(value, parts)

    def __add__(self, other: Uncertain) -> Uncertain:
        one = np.ones_like(self.value)
        with _quiet():
            return self._with(other, self.value + other.value, one, one)

    def __sub__(self, other: Uncertain) -> Uncertain:
        one = np.ones_like(self.value)
        with _quiet():
            return self._with(other, self.value - other.value, one, -one)

    def __mul__(self, other: Uncertain) -> Uncertain:
        with _quiet():
            return self._with(other, self.value * other.value, other.value, self.value)

    def __truediv__(self, other: Uncertain) -> Uncertain:
        with _quiet():
            ratio = self.value / other.value
            return self._with(other, ratio, 1.0 / other.value, -ratio / other.value)

    def scaled(self, factor: float) -> Uncertain:
        """`factor` times this."""
        with _quiet():
            return self._through(factor * self.value, np.full_like(self.value, factor))

    def sin(self) -> Uncertain:
        """The sine of an angle in radians."""
        with _quiet():
            return self._through(np.sin(self.value), np.cos(self.value))

    def cos(self) -> Uncertain:
        """The cosine of an angle in radians."""
        with _quiet():
            return self._through(np.cos(self.value), -np.sin(self.value))

    def sqrt(self) -> Uncertain:
        """The square root; NaN for negative numbers."""
        with _quiet():
            root = np.sqrt(self.value)
            return self._through(root, 0.5 / root)

    def _through(self, value: FloatArray, slope: FloatArray) -> Uncertain:
        """`value`, a function of this alone whose derivative is `slope`."""
        return Uncertain(value, {name: slope * part for name, part in self.parts.items()})


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
