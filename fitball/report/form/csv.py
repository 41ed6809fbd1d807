"""Rows as CSV text or files."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from fitball.files import write_whole

# Letters that are written at once.
BLOCK = 1 << 16


def csv_text(rows: Iterable[Mapping[str, object]]) -> str:
    """Rows with equal keys as CSV text; what does not exist, None or NaN, becomes an empty cell."""
    return "".join(_blocks(rows))


def write_csv(path: Path, rows: Iterable[Mapping[str, object]]) -> None:
    """The same as a file, whole or not at all, without holding all rows in memory. Raises ResultFolderError."""
    write_whole(path, (block.encode() for block in _blocks(rows)))


def _blocks(rows: Iterable[Mapping[str, object]]) -> Iterator[str]:
    out = io.StringIO()
    writer: csv.DictWriter[str] | None = None
    for row in rows:
        if writer is None:
            writer = csv.DictWriter(out, fieldnames=list(row), lineterminator="\n")
            writer.writeheader()
        writer.writerow({key: "" if _absent(value) else value for key, value in row.items()})
        if out.tell() > BLOCK:
            yield out.getvalue()
            out.seek(0)
            out.truncate()
    yield out.getvalue()


def _absent(value: object) -> bool:
    return value is None or (isinstance(value, float) and math.isnan(value))
