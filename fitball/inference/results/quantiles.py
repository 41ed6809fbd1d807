"""The quantiles that a posterior is told by, under the names that fields, files and columns have for them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

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


def quantiles(draws: FloatArray, names: Iterable[str] = QUANTILES) -> dict[str, float]:
    """Quantiles of the draws of one quantity, (draws,), by name."""
    return dict(zip(names, np.quantile(draws, [QUANTILES[name] for name in names]).tolist(), strict=True))
