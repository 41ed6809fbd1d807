"""How far the camera moved from frame to frame, by the background."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from scipy.ndimage import gaussian_filter, shift

from fitball.base.values import FloatArray, IntArray
from fitball.video.types import Plane

# Sides of the squares that vote [px of the smaller picture], and how soft that is made.
_SIDE = 24
_SOFT = 1.2
# A square tells of a direction if its gradients there are so large on average [levels/px],
_LEAST_GRADIENT = 1.0
# and the picture if so many squares do: one person who walks past outvotes seven.
_LEAST_SQUARES = 12
# An estimate is repeated at the place found until it moves by less [px], or so many times.
_CLOSE = 0.05
_TIMES = 5
# The camera moved if the shift found brings so large a share of the squares that tell of shifts
# nearer to the first picture. A hand that leaves takes those with it that saw it.
_CONFIRMING = 0.67


class Steadying:
    """Shifts of later pictures against a first one: luma of each square against its gradients; what
    moves by itself is outvoted. `known` says whether the picture has structure enough.
    """

    def __init__(self, first: Annotated[Plane, "rows columns"]) -> None:
        self.reference = _soft(first)
        self.last = np.zeros(2)
        slope_y, slope_x = (np.gradient(self.reference, axis=axis) for axis in (0, 1))
        self.votes: list[tuple[IntArray, FloatArray]] = []
        design = np.stack([_squares(slope_x), _squares(slope_y)], -1)
        design = design - design.mean(1, keepdims=True)
        normal = np.swapaxes(design, 1, 2) @ design
        for axis in (0, 1):
            other = np.maximum(normal[:, 1 - axis, 1 - axis], 1e-9)
            free = normal[:, axis, axis] - normal[:, 0, 1] ** 2 / other
            rows = np.flatnonzero(free > _LEAST_GRADIENT * _SIDE**2)
            inverse = (
                np.linalg.pinv(design[rows])[:, axis] if len(rows) else np.zeros((0, _SIDE**2))
            )
            self.votes.append((rows, inverse))
        self.known = min(len(rows) for rows, _ in self.votes) >= _LEAST_SQUARES
        self.voting = np.unique(np.concatenate([rows for rows, _ in self.votes]))

    def shift(self, picture: Annotated[Plane, "rows columns"]) -> Annotated[FloatArray, "2"]:
        """How far the camera's picture moved (x, y) [px of this picture] against the first one."""
        if not self.known:
            return np.zeros(2)
        soft = _soft(picture)
        total = self.last.copy()
        for _ in range(_TIMES):
            there = soft if not total.any() else shift(soft, -total[::-1], order=1, mode="nearest")
            squares = _squares(there - self.reference)
            step = np.array(
                [-np.median((squares[rows] * inverse).sum(1)) for rows, inverse in self.votes]
            )
            total += np.clip(step, -1.5, 1.5)
            if np.abs(step).max() < _CLOSE:
                break
        self.last = total
        return total.copy()

    def confirms(
        self, picture: Annotated[Plane, "rows columns"], total: Annotated[FloatArray, "2"]
    ) -> bool:
        """Whether a shift (x, y) [px of this picture] makes the picture more like the first one in
        most squares that tell of shifts.
        """
        soft = _soft(picture)
        back = shift(soft, -total[::-1], order=1, mode="nearest")
        rest = [
            np.square(squares - squares.mean(1, keepdims=True)).sum(1)
            for squares in (_squares(there - self.reference)[self.voting] for there in (soft, back))
        ]
        return bool(np.mean(rest[1] < rest[0]) > _CONFIRMING)


def _soft(picture: Plane) -> FloatArray:
    rows, columns = (size // 2 * 2 for size in picture.shape)
    whole = picture[:rows, :columns].astype(np.float32)
    half = whole[::2, ::2] + whole[1::2, ::2] + whole[::2, 1::2] + whole[1::2, 1::2]
    return np.asarray(gaussian_filter(half / 4.0, _SOFT))


def _squares(picture: FloatArray) -> Annotated[FloatArray, "squares pixels"]:
    """The picture cut into squares, what is left over at the edges left out."""
    down, across = (size // _SIDE for size in picture.shape)
    part = picture[: down * _SIDE, : across * _SIDE]
    blocks = part.reshape(down, _SIDE, across, _SIDE).swapaxes(1, 2)
    return np.asarray(blocks.reshape(down * across, _SIDE**2))
