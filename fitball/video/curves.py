"""Smooth curves of flights, and how far places are off them. Discs know the error of their own
edge, not what felt, marks and light do to it over several frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np

from fitball.base.values import BoolArray, FloatArray, IntArray
from fitball.video.shape import SEEN, Discs

# A curve has at most so many coefficients, and so many places for each: air bends a parabola.
_MOST_COEFFICIENTS = 4
_PLACES_EACH = 4
# Places that are off by more than so many sds count less; how often that is repeated.
_HUBER = 2.0
_TIMES = 5
# Least sd of places [px], far below what is seen.
_LEAST_SD = 1e-3


def smoothed(
    times: Annotated[FloatArray, "frames"],
    places: Annotated[FloatArray, "frames 2"],
    flights: Sequence[IntArray],
    good: Annotated[BoolArray, "frames"],
) -> Annotated[FloatArray, "frames 2"]:
    """Places on curves through the good ones of each flight (rows); of short flights as they
    are.
    """
    out = places.copy()
    for rows in flights:
        use = rows[good[rows]]
        if len(use) >= 2 * _PLACES_EACH:
            out[rows] = _on_curve(times, places, rows, use)
    return out


def _on_curve(
    times: FloatArray, places: FloatArray, rows: IntArray, use: IntArray
) -> Annotated[FloatArray, "rows 2"]:
    """Places of rows on the curve through some of them."""
    start, span = times[use[0]], np.ptp(times[use])
    count = _coefficients(len(use))
    design = np.vander(2.0 * (times[use] - start) / span - 1.0, count)
    wanted = np.vander(2.0 * (times[rows] - start) / span - 1.0, count)
    columns = []
    for seen in places[use].T:
        weight = np.ones(len(use))
        for _ in range(_TIMES):
            curve = np.linalg.lstsq(design * weight[:, None], seen * weight, rcond=None)[0]
            off = seen - design @ curve
            scale = 1.48 * float(np.median(np.abs(off))) + _LEAST_SD
            weight = 1.0 / np.sqrt(1.0 + (off / (_HUBER * scale)) ** 2)
        columns.append(wanted @ curve)
    return np.stack(columns, 1)


def _coefficients(count: int) -> int:
    """How many coefficients the curve through so many places has."""
    return min(_MOST_COEFFICIENTS, count // _PLACES_EACH)


def with_scatter(discs: Discs, flights: Sequence[IntArray]) -> Discs:
    """Discs whose places have the sds that their scatter about smooth flights shows, in each
    direction the same in all frames, beside those of their edges.
    """
    good = discs.quality > SEEN
    off = discs.p[:, :2] - smoothed(discs.times, discs.p[:, :2], flights, good)
    squares = np.zeros(2)
    edges = np.zeros(2)
    freedom = 0.0
    for rows in flights:
        use = rows[good[rows]]
        count = _coefficients(len(use))
        if count < 2:
            continue
        # A few frames that are far off are outliers, which are found later.
        size = 1.48 * np.median(np.abs(off[use]), axis=0) * np.sqrt(len(use) / (len(use) - count))
        squares += len(use) * size**2
        edges += len(use) * np.median(discs.sd[use, :2] ** 2, axis=0)
        freedom += len(use)
    if not freedom:
        return discs
    rest = np.maximum(squares - edges, 0.0) / freedom
    sd = discs.sd.copy()
    sd[:, :2] = np.sqrt(sd[:, :2] ** 2 + rest)
    return replace(discs, sd=sd)
