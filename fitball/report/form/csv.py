"""Rows as CSV text or files."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TextIO

from fitball.report.form.atomic_write import write_whole


def csv_text(rows: Iterable[Mapping[str, object]]) -> str:
    """Rows with equal keys as CSV text; what does not exist, None or NaN, becomes an empty cell."""
    out = io.StringIO()
    _write_rows(out, rows)
    return out.getvalue()


def write_csv(path: Path, rows: Iterable[Mapping[str, object]]) -> None:
    """The same as a file, whole or not at all, without holding all rows in memory. Raises ResultFolderError."""

    def write(place: Path) -> None:
        with place.open("w", encoding="utf-8", newline="") as out:
            _write_rows(out, rows)

    write_whole(path, write)


def _write_rows(out: TextIO, rows: Iterable[Mapping[str, object]]) -> None:
    writer: csv.DictWriter[str] | None = None
    for row in rows:
        if writer is None:
            writer = csv.DictWriter(out, fieldnames=list(row), lineterminator="\n")
            writer.writeheader()
        writer.writerow({key: "" if _absent(value) else value for key, value in row.items()})


def _absent(value: object) -> bool:
    return value is None or (isinstance(value, float) and math.isnan(value))
