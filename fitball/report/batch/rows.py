"""What a batch keeps of one fit: a row of plain values in SI, the same columns for the same model."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path

from fitball.inference.problem.problem import Problem
from fitball.inference.results.quantiles import Spread
from fitball.inference.results.results import Fit
from fitball.report.saved.structure import damaged
from fitball.visible import unguarded

Row = dict[str, str | float | int | None]
CSV_NAME = "batch.csv"
# What marks the folder of a table that is done.
ROW_NAME = "row.json"
NAME = "table"
DONE, FAILED = "done", "failed"
# Before the names of label columns.
LABEL = "label:"
# Columns that every row begins with.
TEXTS = (NAME, "outcome", "reason", "model", "status", "adequacy", "described")
HEAD = (NAME, "outcome", "reason", "impacts", "model", "status", "adequacy", "described")


def failed_row(name: str, reason: str) -> Row:
    """The row of a table that could not be fitted."""
    return {**dict.fromkeys(HEAD), NAME: name, "outcome": FAILED, "reason": reason}


def row_of(name: str, saved: Fit, problem: Problem) -> Row:
    """The row of a fit: outcome, adequacy, labels that the whole table has in common or its scene states, each
    parameter, court pace and restitution of a drop test.
    """
    found = _found(name, saved)
    scene, labels = problem.scene, problem.table.labels
    named = {f"{LABEL}{column}": cells[0] for column, cells in labels.items() if len(set(cells)) == 1 and cells[0]}
    stated = {"surface": scene.surface, "ball_type": scene.ball_type}
    named |= {f"{LABEL}{key}": text for key, text in stated.items() if text is not None and key not in labels}
    return {**dict(list(found.items())[: len(HEAD)]), **named, **found}


def _found(name: str, saved: Fit) -> Row:
    """The row of a fit without its labels."""
    row: Row = {
        NAME: name,
        "outcome": DONE,
        "reason": "",
        "impacts": saved.source.impacts,
        "model": saved.fitted.model_name,
        "status": str(saved.status),
        "adequacy": None if saved.adequacy is None else str(saved.adequacy.answer),
        "described": None if saved.adequacy is None else saved.adequacy.sentence,
    }
    for estimate in saved.parameters.values():
        head = f"{estimate.name}{f' [{estimate.unit}]' if estimate.unit else ''}"
        row[head] = estimate.point if estimate.median is None else estimate.median
        row |= {f"{estimate.name}_{kind}": getattr(estimate, kind) for kind in ("sd", "q025", "q975")}
        row[f"{estimate.name}_verdict"] = estimate.verdict_words
    if saved.court_pace is not None and len(saved.court_pace.ratings) == 1:
        row |= _spread("court_pace", saved.court_pace.ratings[0].rating)
    if saved.drop_test is not None:
        for tested in saved.drop_test.speeds:
            row |= _spread(f"cor_at_{tested.speed:.3g}_m/s", tested.cor)
    return row


def check_row(row: Row, saved: Fit, place: Path) -> None:
    """Raise ResultFolderError where a row that was read at `place` differs from its fit."""
    found = _found(str(row[NAME]), saved)
    for head, cell in row.items():
        if not head.startswith(LABEL) and cell != found.get(head):
            own = f"its fit.json says {found.get(head)!r}"
            raise damaged(place, f"table {row[NAME]!r}: {head} is {cell!r}, but {own}")


def read_rows(text: str) -> tuple[Row, ...]:
    """The rows of a `batch.csv`; ValueError where it is none."""
    try:
        heads, *lines = csv.reader(io.StringIO(text, newline=""), strict=True)
    except csv.Error as error:
        raise ValueError(str(error)) from None
    if not lines or not set(HEAD) <= set(heads) or len(set(heads)) < len(heads):
        raise ValueError(f"expected rows with the columns {', '.join(HEAD)}, none of them twice")
    rows = []
    for number, cells in enumerate(lines, start=1):
        if len(cells) != len(heads):
            raise ValueError(f"row {number}: {len(cells)} cells under {len(heads)} columns")
        row = {head: _cell(head, cell, number) for head, cell in zip(heads, cells, strict=True)}
        if row["outcome"] not in (DONE, FAILED):
            raise ValueError(f"row {number}, column 'outcome': read {row['outcome']!r}, expected {DONE} or {FAILED}")
        rows.append(row)
    names = [row[NAME] for row in rows]
    if len(set(names)) < len(names) or None in names:
        raise ValueError(f"column '{NAME}': a name is missing or comes twice")
    return tuple(rows)


def _cell(head: str, cell: str, number: int) -> str | float | int | None:
    if head in TEXTS or head.startswith(LABEL) or head.endswith("_verdict"):
        return unguarded([cell])[0] or ("" if head == "reason" else None)
    try:
        value = None if not cell else int(cell) if head == "impacts" else float(cell)
    except ValueError:
        value = math.nan
    if value is not None and not math.isfinite(value):
        raise ValueError(f"row {number}, column {head!r}: read {cell[:40]!r}, expected a finite number")
    return value


def _spread(name: str, spread: Spread) -> Row:
    value = spread.point if spread.median is None else spread.median
    return {name: value, f"{name}_q025": spread.q025, f"{name}_q975": spread.q975}
