"""Replicates of a study over processes. Each is written when it ends, so that a study that was
stopped goes on where it was.
"""

from __future__ import annotations

import json
import traceback
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from scipy.stats import beta

from fitball.base.errors import FitballError
from fitball.base.scheduling import as_completed

Record = dict[str, Any]


class Rate(NamedTuple):
    """A number of hits in a number of trials."""

    hits: int
    total: int

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the rate, by Clopper and Pearson."""
        k = self.hits
        n = self.total
        low = float(beta.ppf(0.025, k, n - k + 1)) if k else 0.0
        return low, float(beta.ppf(0.975, k + 1, n - k)) if k < n else 1.0

    def __str__(self) -> str:
        low, high = self.interval
        return f"{self.hits} of {self.total} ({low:.3f} to {high:.3f})"


def record_of(make: Callable[[int], Record], number: int) -> Record:
    """The record of replicate `number`; of one that failed, with the error as `failed`."""
    try:
        return {"number": number, **make(number)}
    except FitballError as error:
        return {"number": number, "failed": str(error)}
    except Exception:
        # A defect of the program must be seen in the study, but must not end it.
        return {"number": number, "failed": traceback.format_exc()}


def replicates(
    name: str,
    make: Callable[[int], Record],
    numbers: Sequence[int],
    folder: Path,
) -> list[Record]:
    """The record of `make` for each number. Those that `NAME.jsonl` in the folder has already are
    read, others are added to it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    records = {record["number"]: record for record in map(json.loads, lines)}
    missing = [number for number in numbers if number not in records]
    with path.open("a", encoding="utf-8") as file:
        for k, result in as_completed(partial(record_of, make), missing):
            number = missing[k]
            # A process that died has an error for its result.
            is_record = isinstance(result, dict)
            record = result if is_record else {"number": number, "failed": str(result)}
            records[number] = record
            file.write(json.dumps(record) + "\n")
            file.flush()
    return [records[number] for number in numbers]
