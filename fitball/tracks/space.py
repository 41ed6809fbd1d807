"""Three coordinates of a ball that flies in a plane, reduced to x along the court and y upwards.

Recordings of markers have three coordinates, of which another one may be vertical. A bounce shows
which: there that velocity turns around, while the others keep their sign. Gravity would not: drag
brakes a fast ball as much.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fitball.base.values import FloatArray

# A coordinate that moves by less than this share of the largest motion is none: the length of the
# path in the plane of the others is right to 0.1 %.
MOST_FLAT = 0.05
# Fewest frames with positions that show a plane.
_FEWEST_FRAMES = 12
# The vertical velocity turns around by so many times more than each of the others.
_LEAST_TURN = 3.0
# Velocities before and after a bounce are medians over this share of the frames.
_SHARE_OF_FLIGHT = 0.125
# Quantiles between which a motion is measured: a few positions may be wrong.
_INNER = (0.02, 0.98)


class InPlane(NamedTuple):
    """Positions (rows,) in the plane of flight: along the court and upwards, and by which share of
    the motion along they leave the plane.
    """

    x: FloatArray
    y: FloatArray
    off_plane: float


def is_flat(x: FloatArray, y: FloatArray, z: FloatArray) -> bool:
    """Whether the third coordinate hardly moves, or was never measured."""
    extents = [_extent(values) for values in (x, y, z)]
    return extents[2] <= MOST_FLAT * max(extents[:2])


def in_plane(
    positions: Annotated[FloatArray, "rows 3"], time: Annotated[FloatArray, "rows"]
) -> InPlane | None:
    """The positions of a ball in its plane of flight, by time in any unit; None where no coordinate
    is vertical.
    """
    measured = np.flatnonzero(np.isfinite(positions).all(axis=1) & np.isfinite(time))
    measured = measured[np.argsort(time[measured], kind="stable")]
    if measured.size < _FEWEST_FRAMES:
        return None
    places = positions[measured]
    turns = np.array([_turn(places[:, axis], time[measured]) for axis in range(3)])
    vertical = int(turns.argmax())
    across = [axis for axis in range(3) if axis != vertical]
    if not turns[vertical] > _LEAST_TURN * turns[across].max():
        return None
    level = positions[:, across]
    middle = level[measured].mean(axis=0)
    _, _, directions = np.linalg.svd(level[measured] - middle, full_matrices=False)
    # Along the court as the ball goes.
    forward = directions[0] * np.sign(directions[0] @ (places[-1] - places[0])[across] or 1.0)
    along = (level - middle) @ forward
    off = (level - middle) @ directions[1]
    share = _extent(off) / max(_extent(along), 1e-300)
    return InPlane(along, positions[:, vertical], share)


def _extent(values: FloatArray) -> float:
    """How far values (rows,) reach, 0 without any; a few outer ones do not count."""
    finite = values[np.isfinite(values)]
    return float(np.ptp(np.quantile(finite, _INNER))) if finite.size else 0.0


def _turn(values: FloatArray, time: FloatArray) -> float:
    """By how much the slope of values (frames,) over time turns around where it changes most: the
    lesser of both slopes there, 0 where they have one sign.
    """
    slopes = np.diff(values) / np.maximum(np.diff(time), 1e-300)
    width = max(int(_SHARE_OF_FLIGHT * slopes.size), 3)
    windows = np.median(sliding_window_view(slopes, width), axis=1)
    before = windows[:-width]
    after = windows[width:]
    sharpest = np.abs(after - before).argmax()
    if before[sharpest] * after[sharpest] >= 0.0:
        return 0.0
    return float(min(abs(before[sharpest]), abs(after[sharpest])))
