"""Angles and radii beside positions that are not the ball's: polar coordinates of its position, and
the direction of its motion, as programs of analysis write them into the same table.

An angle a of the position about a point p0 obeys (p - p0) . (-sin a, cos a) = 0 in all frames,
which is linear in p0; a mark on a ball does not. Angles may grow either way, from either axis.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Annotated

import numpy as np

from fitball.base.values import FloatArray

# Fewest frames that show what an angle is.
_FEWEST_FRAMES = 7
# Positions may be off the rays of their angles by this share of their spread: that of angles
# rounded to whole degrees.
_MOST_OFF_RAYS = 0.02
# Directions of motion may be off the angles by this [rad], in the median.
_MOST_OFF_MOTION = 0.03
# Angles must explain positions, or motion, so many times better than any constant angle does: a
# ball that does not turn has marks at a constant one.
_LEAST_GAIN = 5.0
# Frames between which a direction of motion is taken, as numbers of the first and the second:
# forward, backward and central differences.
_DIFFERENCES = ((0, 1), (-1, 0), (-1, 1))


def polar_columns(columns: Mapping[str, FloatArray]) -> dict[str, str]:
    """What columns (frames,) of a table with x and y are in words, by name, where they are none of
    the ball: `angle` [rad] and `radius`.
    """
    x, y = columns["x"], columns["y"]
    found = dict[str, str]()
    origin = np.zeros(2)
    angle = columns.get("angle", np.full(x.size, np.nan))
    measured = np.isfinite(x + y + angle)
    places = np.column_stack([x, y])[measured]
    if len(places) >= _FEWEST_FRAMES:
        for a in _readings(angle[measured]):
            centre = _centre(places, a)
            if centre is not None:
                origin = centre
                found["angle"] = "the polar angle of the position"
            elif _is_direction(places, a):
                found["angle"] = "the direction of motion"
    radius = columns.get("radius", np.full(x.size, np.nan))
    if any(_is_distance(x - x_0, y - y_0, radius) for x_0, y_0 in (np.zeros(2), origin)):
        found["radius"] = "the distance of the position from the origin"
    return found


def _readings(angle: FloatArray) -> list[FloatArray]:
    """Angles (frames,) [rad] from the x axis, counterclockwise, as which they may be meant: in
    radians or degrees, since headers may lack the unit, either way, from either axis.
    """
    units = (angle, np.degrees(angle), np.radians(angle))
    return [start + sign * a for a, start, sign in product(units, (0.0, np.pi / 2.0), (1.0, -1.0))]


def _centre(
    places: Annotated[FloatArray, "frames 2"],
    angle: Annotated[FloatArray, "frames"],
) -> Annotated[FloatArray, "2"] | None:
    """The point about which angles [rad] are those of the positions; None where there is none."""
    across = np.column_stack([-np.sin(angle), np.cos(angle)])
    from_middle = places - places.mean(axis=0)
    distance = np.sum(across * from_middle, axis=1)
    centre, *_ = np.linalg.lstsq(across, distance, rcond=None)
    off = float(np.sqrt(np.mean((distance - across @ centre) ** 2)))
    # With a constant angle, the best one, positions are off by their spread across their motion.
    variances = np.linalg.eigvalsh(np.cov(from_middle.T))
    constant, spread = np.sqrt(np.maximum(variances, 0.0))
    if off < _MOST_OFF_RAYS * spread and _LEAST_GAIN * off < constant:
        return np.asarray(places.mean(axis=0) + centre)
    return None


def _is_direction(
    places: Annotated[FloatArray, "frames 2"],
    angle: Annotated[FloatArray, "frames"],
) -> bool:
    """Whether angles [rad] are the directions in which the positions move, of either sense."""
    for first, second in _DIFFERENCES:
        inner = np.arange(1, len(places) - 1)
        d_x, d_y = (places[inner + second] - places[inner + first]).T
        direction = np.arctan2(d_y, d_x)
        off = _median_off(angle[inner] - direction)
        middle = 0.5 * np.angle(np.exp(2j * direction).sum())
        if off < _MOST_OFF_MOTION and _LEAST_GAIN * off < _median_off(direction - middle):
            return True
    return False


def _median_off(angle: FloatArray) -> float:
    """The median of how far angles (frames,) [rad] are from whole half turns."""
    return float(np.median(np.abs(angle - np.pi * np.round(angle / np.pi))))


def _is_distance(x: FloatArray, y: FloatArray, radius: FloatArray) -> bool:
    """Whether radii (frames,) are distances of positions from a point, in whatever unit."""
    distance = np.hypot(x, y)
    measured = np.isfinite(distance + radius)
    if measured.sum() < _FEWEST_FRAMES:
        return False
    distance, radius = distance[measured], radius[measured]
    spread = float(np.std(radius))
    factor = float(distance @ radius) / max(float(distance @ distance), 1e-300)
    off = float(np.sqrt(np.mean((radius - factor * distance) ** 2)))
    return off < _MOST_OFF_RAYS * spread
