"""Which impacts of a long table files list one by one."""

from __future__ import annotations

import numpy as np

# Impacts that are listed; data.nc holds the measurements of all.
LISTED = 20_000


def listed_places(count: int) -> list[int]:
    """Which of so many impacts the files list: all, or `LISTED` of them, evenly spread."""
    return [round(place) for place in np.linspace(0, count - 1, min(count, LISTED))]


def file_words(name: str, count: int) -> str:
    """Where so many impacts are listed, and how many of them."""
    return name if count <= LISTED else f"{name}, which lists {LISTED:,} of all {count:,}, evenly spread"
