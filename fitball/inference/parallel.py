"""Large batches of rebounds, draw by draw on several threads; the kernels hold no interpreter lock."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields

import numpy as np

from fitball.models.model import Model
from fitball.models.types import Rebound
from fitball.values import FloatArray, Impacts

# Impacts times draws above which splitting pays for the threads.
LARGE_BATCH = 100_000


def evaluate_in_parts(
    model: Model, names: Sequence[str], rows: FloatArray, impacts: Impacts, threads: int
) -> Rebound:
    """`model.evaluate`, the draws shared among threads; the same numbers whatever their count."""
    if threads == 1 or rows.shape[0] == 1:
        return model.evaluate(names, rows, impacts)
    parts = np.array_split(rows, min(rows.shape[0], 4 * threads))
    with ThreadPoolExecutor(threads) as pool:
        found = list(pool.map(lambda part: model.evaluate(names, part, impacts), parts))
    return Rebound(*(np.concatenate([getattr(item, field.name) for item in found]) for field in fields(Rebound)))
