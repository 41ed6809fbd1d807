"""A density of two numbers on a grid that covers it closely: boxes are cut down until little of them is empty."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fitball.values import FloatArray

# Points along each side of the box. A density that falls off as a normal one does has some six of its sds to either
# side in such a box, and where points lie half an sd apart the trapezoidal rule is exact to many digits.
POINTS = 24
# Log density below the peak that counts as empty.
EMPTY = 18.0
MOST_CUTS = 12


@dataclass(frozen=True)
class Grid:
    """`sides` of a grid, each (POINTS,), and the `shares` (POINTS, POINTS) of the mass that its points stand for."""

    sides: tuple[FloatArray, FloatArray]
    shares: FloatArray

    @property
    def points(self) -> FloatArray:
        """All points, (points, 2), in the order of the shares."""
        return _mesh(self.sides)


def covering_grid(
    roughly: Callable[[FloatArray], FloatArray],
    exactly: Callable[[FloatArray], FloatArray],
    low: FloatArray,
    high: FloatArray,
) -> Grid:
    """The density whose logarithm at points (points, 2) is `exactly`, (points,), on a grid within the box of these
    ends (2,), which is cut down as far as the cheaper `roughly` falls off. It has one peak, or several that the first
    box shows.
    """
    for _ in range(MOST_CUTS):
        sides = _sides(low, high)
        low, high, narrower = _cut(sides, roughly(_mesh(sides)).reshape(POINTS, POINTS))
        if not narrower:
            break
    sides = _sides(low, high)
    density = exactly(_mesh(sides)).reshape(POINTS, POINTS)
    shares = np.exp(density - density.max()) * np.outer(*(_trapezoid(side) for side in sides))
    return Grid(sides, shares / shares.sum())


def _sides(low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    first, second = (np.linspace(*ends, POINTS) for ends in zip(low, high, strict=True))
    return first, second


def _mesh(sides: tuple[FloatArray, FloatArray]) -> FloatArray:
    return np.stack([side.ravel() for side in np.meshgrid(*sides, indexing="ij")], axis=1)


def _trapezoid(side: FloatArray) -> FloatArray:
    widths = np.full(len(side), side[1] - side[0])
    widths[[0, -1]] *= 0.5
    return widths


def _cut(sides: tuple[FloatArray, FloatArray], table: FloatArray) -> tuple[FloatArray, FloatArray, bool]:
    """Ends of the box in which the table is not empty, one point wider, and whether that is narrower by much."""
    full = table > table.max() - EMPTY
    ends = []
    for side, where in zip(sides, (np.flatnonzero(full.any(axis=1)), np.flatnonzero(full.any(axis=0))), strict=True):
        ends.append((side[max(where[0] - 1, 0)], side[min(where[-1] + 1, POINTS - 1)]))
    low, high = np.array(ends).T
    shares = (high - low) / [side[-1] - side[0] for side in sides]
    return low, high, bool(np.min(shares) < 0.8)
