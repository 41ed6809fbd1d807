"""Tables on a terminal: plain text in columns."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from typing import TypeAlias

from fitball.visible import one_line

# A row of a table as text, by the heads of its columns, in their order: what terminal, page and certificate show.
Row: TypeAlias = dict[str, str]
WIDTH = 100
# Rows of a table that a person reads on a terminal.
MOST_LINES = 40
# A cell that is longer than the texts of this program is a label of the user's: a few words of it tell which.
WIDEST = 80


def columns(rows: Sequence[Sequence[str]], left: int | Sequence[bool] = 1) -> list[str]:
    """Rows of cells as lines: the first `left` columns, or those it names, flush left, the others right. A cell stays
    in its line.
    """
    aligned = [k < left for k in range(len(rows[0]))] if isinstance(left, int) else left
    rows = [[one_line(cell, WIDEST) for cell in row] for row in rows]
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [
            cell.ljust(width) if flush else cell.rjust(width)
            for cell, width, flush in zip(row, widths, aligned, strict=True)
        ]
        lines.append("  ".join(cells).rstrip())
    return lines


def listed_rows(rows: Sequence[Row], left: int = 1, without: str | None = None) -> list[str]:
    """Rows under their heads, as lines; one column may be left out."""
    heads = [head for head in rows[0] if head != without]
    return columns([heads, *([row[head] for head in heads] for row in rows)], left)


def wrapped(texts: Iterable[str], first: str = "", others: str = "") -> list[str]:
    """Texts as lines of `WIDTH`, the first line of each indented by `first`, its others by `others`."""
    return [
        line
        for text in texts
        for line in textwrap.wrap(text, WIDTH, initial_indent=first, subsequent_indent=others, break_on_hyphens=False)
    ]


def more(count: int, where: str) -> list[str]:
    """A line that says how many of `count` rows are not shown, and where they are; nothing when all are."""
    return [f"... and {count - MOST_LINES:,} more: {where}"] if count > MOST_LINES else []
