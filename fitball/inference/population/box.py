"""A density of a few numbers on a grid that covers it closely: boxes are cut down until little of them is empty."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce

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
    """`sides` of a grid, each (points,), and the `shares` (points, points, ...) of the mass that its points stand
    for; `log_mass` is the logarithm of all of it.
    """

    sides: tuple[FloatArray, ...]
    shares: FloatArray
    log_mass: float

    @property
    def points(self) -> FloatArray:
        """All points, (all points, sides), in the order of the shares."""
        return _mesh(self.sides)


def covering_grid(
    roughly: Callable[[FloatArray], FloatArray],
    exactly: Callable[[FloatArray], FloatArray],
    low: FloatArray,
    high: FloatArray,
    points: int = POINTS,
    empty: float = EMPTY,
) -> Grid:
    """The density whose logarithm at places (places, sides) is `exactly`, (places,), on a grid of so many `points` a
    side within the box of these ends (sides,), which is cut down as far as the cheaper `roughly` falls off by
    `empty`. It has one peak, or several that the first box shows.
    """
    shape = (points,) * len(low)
    for _ in range(MOST_CUTS):
        sides = _sides(low, high, points)
        low, high, narrower = _cut(sides, roughly(_mesh(sides)).reshape(shape), empty)
        if not narrower:
            break
    sides = _sides(low, high, points)
    density = exactly(_mesh(sides)).reshape(shape)
    top = float(density.max())
    mass = np.exp(density - top) * reduce(np.multiply.outer, map(_trapezoid, sides))
    return Grid(sides, mass / mass.sum(), top + float(np.log(mass.sum())))


def _sides(low: FloatArray, high: FloatArray, points: int) -> tuple[FloatArray, ...]:
    return tuple(np.linspace(*ends, points) for ends in zip(low, high, strict=True))


def _mesh(sides: tuple[FloatArray, ...]) -> FloatArray:
    return np.stack([side.ravel() for side in np.meshgrid(*sides, indexing="ij")], axis=1)


def _trapezoid(side: FloatArray) -> FloatArray:
    widths = np.full(len(side), side[1] - side[0])
    widths[[0, -1]] *= 0.5
    return widths


def _cut(sides: tuple[FloatArray, ...], table: FloatArray, empty: float) -> tuple[FloatArray, FloatArray, bool]:
    """Ends of the box in which the table is not empty, one point wider, and whether that is narrower by much."""
    full = table > table.max() - empty
    ends = []
    for axis, side in enumerate(sides):
        where = np.flatnonzero(np.moveaxis(full, axis, 0).reshape(len(side), -1).any(axis=1))
        ends.append((side[max(where[0] - 1, 0)], side[min(where[-1] + 1, len(side) - 1)]))
    low, high = np.array(ends).T
    shares = (high - low) / [side[-1] - side[0] for side in sides]
    return low, high, bool(np.min(shares) < 0.8)
