"""Names in sentences."""

from __future__ import annotations

from collections.abc import Sequence


def listed(words: Sequence[str]) -> str:
    """Words with commas and an `and` before the last."""
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))
