"""The quantiles that summarise a posterior, under their names in fields, files and columns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from fitball.values import FloatArray

QUANTILES: Mapping[str, float] = {
    "median": 0.5, "q025": 0.025, "q05": 0.05, "q16": 0.16, "q84": 0.84, "q95": 0.95, "q975": 0.975,
}  # fmt: skip
# The median between the ends of its 68 % and 95 % intervals, and the same as a band from low to high.
MEDIAN_FIRST = ("median", "q025", "q16", "q84", "q975")
BAND = ("q025", "q16", "median", "q84", "q975")
BAND_LEVELS = tuple(QUANTILES[name] for name in BAND)
# What a file says of a parameter: all, or the essentials.
SUMMARY = ("median", "sd", "q025", "q05", "q16", "q84", "q95", "q975")
ESSENTIALS = ("median", "sd", "q025", "q16", "q84", "q975")

# Share of draws that a model cannot evaluate above which quantiles of the rest say nothing of the posterior: the rest
# are then those that happen to have an answer.
MOST_UNSOLVED = 0.5


@dataclass(frozen=True)
class Spread:
    """A number at the point estimate and its posterior quantiles; these are None without a posterior."""

    point: float
    median: float | None
    q025: float | None
    q16: float | None
    q84: float | None
    q975: float | None


def quantiles(draws: FloatArray, names: Iterable[str] = QUANTILES) -> dict[str, float]:
    """Quantiles of the draws of one quantity, (draws,), by name."""
    return dict(zip(names, np.quantile(draws, [QUANTILES[name] for name in names]).tolist(), strict=True))


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


def bands(array: FloatArray) -> FloatArray:
    """Quantiles (5, points) of draws (draws, points), as `BAND` has them. Draws that the model cannot evaluate at a
    point are left out, NaN where none is left.
    """
    if not np.isnan(array).any():
        return np.asarray(np.quantile(array, BAND_LEVELS, axis=0))
    result = np.full((len(BAND_LEVELS), array.shape[1]), np.nan)
    known = ~np.all(np.isnan(array), axis=0)
    result[:, known] = np.nanquantile(array[:, known], BAND_LEVELS, axis=0)
    return result
