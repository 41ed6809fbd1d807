"""What a batch keeps of one fit: a row of plain values in SI, the same columns for the same model."""

from __future__ import annotations

import csv
import io

from fitball.inference.results.quantiles import Spread
from fitball.inference.results.results import Fit
from fitball.visible import unguarded

Row = dict[str, str | float | int | None]
CSV_NAME = "batch.csv"
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


def row_of(name: str, fit: Fit) -> Row:
    """The row of a fit: outcome, adequacy, labels that the whole table has in common or its scene states, each
    parameter, court pace and what a drop test tells.
    """
    adequacy = fit.adequacy
    row: Row = {
        NAME: name,
        "outcome": DONE,
        "reason": "",
        "impacts": len(fit.problem.table),
        "model": fit.problem.model.name,
        "status": str(fit.status),
        "adequacy": None if adequacy is None else str(adequacy.answer),
        "described": None if adequacy is None else adequacy.sentence,
    }
    scene, labels = fit.problem.scene, fit.problem.table.labels
    for column, cells in labels.items():
        if len(set(cells)) == 1 and cells[0]:
            row[f"{LABEL}{column}"] = cells[0]
    stated = {"surface": scene.surface, "ball_type": scene.ball_type}
    row |= {f"{LABEL}{name}": text for name, text in stated.items() if text is not None and name not in labels}
    for estimate in fit.estimates:
        head = f"{estimate.name}{f' [{estimate.unit}]' if estimate.unit else ''}"
        row[head] = estimate.point if estimate.median is None else estimate.median
        row |= {f"{estimate.name}_{kind}": getattr(estimate, kind) for kind in ("sd", "q025", "q975")}
        row[f"{estimate.name}_verdict"] = estimate.verdict_words
    if fit.court_pace is not None and len(fit.court_pace.ratings) == 1:
        row |= _spread("court_pace", fit.court_pace.ratings[0].rating)
    if fit.drop_test is not None:
        for tested in fit.drop_test.speeds:
            row |= _spread(f"cor_at_{tested.speed:.3g}_m/s", tested.cor)
    return row


def read_rows(text: str) -> tuple[Row, ...]:
    """The rows of a `batch.csv`; ValueError where it is none."""
    rows = list(csv.DictReader(io.StringIO(text, newline="")))
    if not rows or not set(HEAD) <= set(rows[0]):
        raise ValueError(f"expected rows with the columns {', '.join(HEAD)}")
    return tuple({head: _cell(head, cell) for head, cell in row.items()} for row in rows)


def _cell(head: str, cell: str | None) -> str | float | int | None:
    if head in TEXTS or head.startswith(LABEL) or head.endswith("_verdict"):
        return unguarded([cell or ""])[0] or ("" if head == "reason" else None)
    if head == "impacts":
        return int(cell) if cell else None
    return float(cell) if cell else None


def _spread(name: str, spread: Spread) -> Row:
    value = spread.point if spread.median is None else spread.median
    return {name: value, f"{name}_q025": spread.q025, f"{name}_q975": spread.q975}
