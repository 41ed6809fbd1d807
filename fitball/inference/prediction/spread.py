"""Draws of one quantity as the value and the quantiles that it is told by."""

from __future__ import annotations

import numpy as np

from fitball.inference.results.pace_rating import Spread
from fitball.inference.results.quantiles import MEDIAN_FIRST, quantiles
from fitball.values import FloatArray


def spread_of(draws: FloatArray | None, point: float | None = None) -> Spread:
    """Quantiles of `draws` (draws,), NaN left out, around `point`, by default the median; without draws only that.

    Raises ValueError without either.
    """
    if draws is None:
        if point is None:
            raise ValueError("neither draws nor a point")
        return Spread(point, *[None] * len(MEDIAN_FIRST))
    found = quantiles(draws[np.isfinite(draws)], MEDIAN_FIRST)
    return Spread(found["median"] if point is None else point, **found)
