"""Numbers and mappings that cannot change; the latter, unlike `types.MappingProxyType`, can be pickled and copied."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from fitball.values import FloatArray

Value = TypeVar("Value")


class FrozenMapping(Mapping[str, Value]):
    """An unchangeable mapping from names to values; keeps the order in which it was given."""

    __slots__ = ("_items",)

    def __init__(self, items: Mapping[str, Value] | None = None) -> None:
        self._items = dict(items or {})

    def __getitem__(self, key: str) -> Value:
        return self._items[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __repr__(self) -> str:
        return f"FrozenMapping({self._items!r})"


def frozen(values: ArrayLike) -> FloatArray:
    """A copy of numbers that cannot change."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array
