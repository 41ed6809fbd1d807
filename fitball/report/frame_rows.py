"""Rows of a frame for pages and figures, whose cells are read as text, number, count or flag."""

from __future__ import annotations

from collections.abc import Mapping
from typing import SupportsFloat, SupportsInt

from fitball.base.files import with_index
from fitball.base.values import DataFrame


class FrameRow:
    """A row of a frame. Its column decides what a cell is, and each reader asks for that."""

    def __init__(self, cells: Mapping[str, object]) -> None:
        self._cells = cells

    def __contains__(self, name: str) -> bool:
        return name in self._cells

    def names(self) -> list[str]:
        """Names of the columns in their order."""
        return list(self._cells)

    def text(self, name: str) -> str:
        """The cell of a column of texts."""
        return str(self._cells[name])

    def number(self, name: str) -> float:
        """The cell of a column of numbers, NaN where it is missing. Raises TypeError on a text."""
        cell = self._cells[name]
        if not isinstance(cell, SupportsFloat):
            raise _wrong_cell(name, cell, "a number")
        return float(cell)

    def numbers(self, *names: str) -> list[float]:
        """The cells of several columns of numbers. Raises TypeError on a text."""
        return [self.number(name) for name in names]

    def count(self, name: str) -> int:
        """The cell of a column of whole numbers. Raises TypeError on a text."""
        cell = self._cells[name]
        if not isinstance(cell, SupportsInt):
            raise _wrong_cell(name, cell, "a whole number")
        return int(cell)

    def flag(self, name: str) -> bool:
        """The cell of a column that says yes or no."""
        return bool(self._cells[name])


def _wrong_cell(name: str, cell: object, expected: str) -> TypeError:
    """The error of a reader who asks a column for what it does not have."""
    return TypeError(f"column {name} has {cell!r}, which is not {expected}")


def frame_rows(frame: DataFrame) -> list[FrameRow]:
    """The rows of a frame, with the index where that has a name."""
    rows = with_index(frame).to_dict("records")
    return [FrameRow({str(name): cell for name, cell in row.items()}) for row in rows]
