"""Rows as CSV text or files."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from fitball.files import write_whole
from fitball.visible import guarded

# Letters that are written at once.
BLOCK = 1 << 16


def csv_text(rows: Iterable[Mapping[str, object]]) -> str:
    """Rows with equal keys as CSV text; what does not exist, None or NaN, becomes an empty cell, and
    no text is a formula (see `guarded`).
    """
    return "".join(_blocks(rows))


def write_csv(path: Path, rows: Iterable[Mapping[str, object]]) -> None:
    """The same as a file, whole or not at all, without holding all rows in memory. Raises ResultFolderError."""
    write_whole(path, (block.encode() for block in _blocks(rows)))


def _blocks(rows: Iterable[Mapping[str, object]]) -> Iterator[str]:
    out = io.StringIO()
    writer: csv.DictWriter[str] | None = None
    for row in rows:
        if writer is None:
            writer = csv.DictWriter(_Lines(out), fieldnames=list(row), lineterminator="\r\n")
            writer.writerow({key: guarded(key) for key in row})
        writer.writerow({key: _cell(value) for key, value in row.items()})
        if out.tell() > BLOCK:
            yield out.getvalue()
            out.seek(0)
            out.truncate()
    yield out.getvalue()


@dataclass(frozen=True)
class _Lines:
    """Takes lines that end with CR LF, so that a CR within a cell is quoted, and writes them ending with LF."""

    out: TextIO

    def write(self, line: str) -> int:
        """One row, as `csv` hands it over."""
        return self.out.write(line.removesuffix("\r\n") + "\n")


def _cell(value: object) -> object:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return guarded(value) if isinstance(value, str) else value
