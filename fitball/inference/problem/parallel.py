"""Large batches of rebounds on several threads, by draws or by impacts; the kernels hold no interpreter lock."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from fitball.models.model import Model
from fitball.models.types import Rebound
from fitball.values import FloatArray, Impacts, OwnImpacts

# Impacts times draws above which splitting pays for the threads.
LARGE_BATCH = 100_000


def evaluate_in_parts(
    model: Model, names: Sequence[str], rows: FloatArray, impacts: Impacts | OwnImpacts, threads: int
) -> Rebound:
    """`model.evaluate`, the work shared among threads; the same numbers whatever their count."""
    if threads == 1:
        return model.evaluate(names, rows, impacts)
    if rows.shape[0] >= threads:
        split = np.array_split(np.arange(rows.shape[0]), min(rows.shape[0], 4 * threads))
        parts = [(rows[part], impacts if isinstance(impacts, Impacts) else impacts.of_draws(part)) for part in split]
        axis = 0
    else:
        parts = [(rows, impacts.take(part)) for part in np.array_split(np.arange(len(impacts)), 4 * threads)]
        axis = 1
    with ThreadPoolExecutor(threads) as pool:
        rebounds = list(pool.map(lambda part: model.evaluate(names, *part), parts))
    return Rebound.joined(rebounds, axis)
