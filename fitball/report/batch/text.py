"""A batch on a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fitball.report.batch.populations import Populated
from fitball.report.batch.rows import Row
from fitball.report.batch.series import Series
from fitball.report.batch.words import LEVEL_HEADS, centre_heads, centre_rows, level_rows, told
from fitball.report.form.text_table import MOST_LINES, columns, more


def render(rows: Sequence[Row], series: Sequence[Series], folder: Path, populated: Sequence[Populated] = ()) -> str:
    """What a batch found: outcome, what stands out, centres, who failed, where the files are."""
    said = told(rows, series, populated)
    lines = [said.headline[0].upper() + said.headline[1:], *said.points]
    if series:
        lines += ["", *columns([centre_heads(populated), *centre_rows(series, populated)], 2)]
    levels = level_rows(populated)
    if levels:
        lines += [
            "",
            *columns([LEVEL_HEADS, *levels[:MOST_LINES]], 3),
            *more(len(levels), str(folder / "batch.html")),
        ]
    if said.failed:
        lines += ["", "failed:", *(f"  {name}: {reason}" for name, reason in said.failed[:MOST_LINES])]
        lines += more(len(said.failed), str(folder / "batch.csv"))
    return "\n".join([*lines, "", f"{folder / 'batch.html'}, batch.csv; each table has its folder beside them"])
