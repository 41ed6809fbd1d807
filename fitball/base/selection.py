"""Places of some of many: evenly spread, or in proportion to weights."""

from typing import Annotated

import numpy as np

from fitball.base.values import FloatArray, IntArray


def evenly_spread(count: int, most: int, *, down: bool = False) -> Annotated[IntArray, "chosen"]:
    """Places of at most `most` of `count`, evenly spread, the first and the last among them:
    rounded to the nearest place, or `down` to the one before.
    """
    places = np.linspace(0, count - 1, min(count, most))
    return (places if down else places.round()).astype(np.int64)


def evenly_begun(count: int, size: int) -> Annotated[IntArray, "chosen"]:
    """Places at which `size` equal pieces of `count` begin; of fewer than `size` each comes
    several times.
    """
    return (np.arange(size) * count) // size


def systematic(
    weights: Annotated[FloatArray, "draws"], size: int, offset: float
) -> Annotated[IntArray, "chosen"]:
    """`size` places drawn in proportion to weights of any sum, by one `offset` (0 to 1) for all:
    each comes as often as its share says, rounded up or down (Carpenter, Clifford and Fearnhead,
    IEE Proc. Radar, Sonar Navig. 146 (1999) 2).
    """
    shares = np.cumsum(weights)
    return np.searchsorted(shares / shares[-1], (np.arange(size) + offset) / size)
