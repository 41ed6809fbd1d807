"""Replicates of a study over processes, kept as they are made: a study that was stopped goes on
where it was.
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
    """How many of how many, with the 95 % interval of Clopper and Pearson."""

    hits: int
    total: int

    @property
    def interval(self) -> tuple[float, float]:
        """Its ends."""
        k = self.hits
        n = self.total
        low = float(beta.ppf(0.025, k, n - k + 1)) if k else 0.0
        return low, float(beta.ppf(0.975, k + 1, n - k)) if k < n else 1.0

    def __str__(self) -> str:
        low, high = self.interval
        return f"{self.hits} of {self.total} ({low:.3f} to {high:.3f})"


def tried(make: Callable[[int], Record], number: int) -> Record:
    """A replicate, or why there is none."""
    try:
        return {"number": number, **make(number)}
    except FitballError as error:
        return {"number": number, "failed": str(error)}
    except Exception:
        # A defect of the program is to be seen in the study, and must not end it.
        return {"number": number, "failed": traceback.format_exc()}


def replicates(
    name: str,
    make: Callable[[int], Record],
    numbers: Sequence[int],
    folder: Path,
) -> list[Record]:
    """`make` of each number, those that are in the folder already as they are there."""
    folder.mkdir(parents=True, exist_ok=True)
    place = folder / f"{name}.jsonl"
    lines = place.read_text(encoding="utf-8").splitlines() if place.exists() else []
    found = {one["number"]: one for one in map(json.loads, lines)}
    missing = [number for number in numbers if number not in found]
    with place.open("a", encoding="utf-8") as file:
        for k, made in as_completed(partial(tried, make), missing):
            one = made if isinstance(made, dict) else {"number": missing[k], "failed": str(made)}
            found[missing[k]] = one
            file.write(json.dumps(one) + "\n")
            file.flush()
    return [found[number] for number in numbers]
