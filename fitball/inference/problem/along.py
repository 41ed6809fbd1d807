"""Derivatives at many incident states on a line, from those at a few of them.

Within a regime the rebound is smooth: where some neighbours on the line have the same one, derivatives at the first,
the middle and the last of them determine those between, by the parabola through the three.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitball.values import FloatArray

# What a place has that takes part in nothing: no packed regime is negative.
APART = -1


@dataclass(frozen=True)
class Runs:
    """Places on lines (lines, places), evenly spaced, of which neighbours of one `kind` make a run: the first, the
    middle and the last `ends` (3, lines, places) of that of each place, and their `weights` there.
    """

    ends: NDArray[np.int64]
    weights: FloatArray

    def interpolated(self, compute: Callable[[NDArray[np.int64], NDArray[np.int64]], FloatArray]) -> FloatArray:
        """What `compute(lines, places)` gives (asked, ...) at the ends, and between them, (lines, places, ...)."""
        lines = np.broadcast_to(np.arange(self.ends.shape[1])[:, None], self.ends.shape[1:])
        asked = np.zeros(self.ends.shape[1:], dtype=bool)
        asked[lines, self.ends] = True
        number = np.cumsum(asked).reshape(asked.shape) - 1
        found = compute(*np.nonzero(asked))
        beside = (..., *[None] * (found.ndim - 1))
        parts = [
            weight[beside] * found[number[lines, end]] for weight, end in zip(self.weights, self.ends, strict=True)
        ]
        return np.asarray(parts[0] + parts[1] + parts[2])


def runs(kind: NDArray[np.int64]) -> Runs:
    """The runs of lines whose places (lines, places) are of a `kind`."""
    every = np.broadcast_to(np.arange(kind.shape[1]), kind.shape)
    changes = kind[:, 1:] != kind[:, :-1]
    edge = np.ones((kind.shape[0], 1), dtype=bool)
    first = np.maximum.accumulate(np.where(np.hstack([edge, changes]), every, 0), axis=1)
    latest = np.where(np.hstack([changes, edge]), every, kind.shape[1])
    last = np.minimum.accumulate(latest[:, ::-1], axis=1)[:, ::-1]
    middle = (first + last) // 2
    # Of two the first is the middle too, and nothing is left for it.
    alone, pair = last == first, last == first + 1
    whole = np.where(alone, 1, last - first)
    half = np.where(alone | pair, 1, middle - first)
    rest = np.where(alone, 1, last - middle)
    at_first = np.where(pair, last - every, (every - middle) * (every - last) / (half * whole))
    at_middle = np.where(pair, 0.0, (every - first) * (last - every) / (half * rest))
    at_last = np.where(pair, every - first, (every - first) * (every - middle) / (whole * rest))
    weights = np.stack(
        [np.where(alone, 1.0, at_first), np.where(alone, 0.0, at_middle), np.where(alone, 0.0, at_last)]
    )
    return Runs(np.stack([first, middle, last]), weights)
