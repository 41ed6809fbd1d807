"""A fit on a terminal: plain text in columns, and the same as JSON for machines."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

from fitball.inference.results.quantiles import ESSENTIALS
from fitball.inference.results.results import Estimate, Fit
from fitball.report.fit.adequacy_rows import adequacy_lines
from fitball.report.fit.assumption_rows import assumption_lines
from fitball.report.fit.balance_table import balance_table
from fitball.report.fit.drop_rows import drop_remarks, lead_lines
from fitball.report.fit.evidence_rows import evidence_remarks
from fitball.report.fit.pace_rows import pace_lines
from fitball.report.fit.summary import (
    diagnosis_lines,
    level_rows,
    measured_lines,
    notes,
    parameter_rows,
    prediction_table,
    thesis_rows,
)
from fitball.report.form.listed import file_words
from fitball.report.form.text_table import MOST_LINES, columns, listed_rows, more, wrapped


def _listed(texts: Iterable[str]) -> list[str]:
    return wrapped(texts, "  ", " " * 6)


def render(fit: Fit, folder: Path) -> str:
    """The end of a calibration as a person reads it."""
    table = fit.problem.table
    head = f"{fit.problem.model.name} fitted to {table.name} ({len(table)} impacts)"
    parts = [head, "=" * len(head)]
    first = wrapped((*lead_lines(fit.drop_test), *measured_lines(fit)), others="  ")
    parts += [*first, *([""] if first else []), *wrapped([fit.verdict]), *_listed(adequacy_lines(fit))]
    # The notes of the problem stood there before the fit began.
    known = (*fit.problem.table.remarks, *fit.problem.notes)
    parts += [*_listed(f"note: {note}" for note in fit.notes if note not in known), ""]
    rows = parameter_rows(fit)
    heads = ["parameter", "unit", "median", "68 %", "95 %", "point", "prior (SI)", "verdict"]
    body = [
        # Which assumptions is said below: a line of the table has no room for it.
        [row.name, row.unit, row.median, row.interval_68, row.interval_95, row.point, row.prior, estimate.verdict]
        for row, estimate in zip(rows, (*fit.estimates, *fit.derived.values()), strict=True)
    ]
    parts += columns([heads, *body], left=2)
    thesis = thesis_rows(fit)
    also = " In the thesis's units:" if thesis else ""
    parts += ["", f"Point: maximum of the posterior density.{also}", ""]
    if thesis:
        lines = [[row.name, row.unit, row.median, row.interval_68, row.interval_95, row.point] for row in thesis]
        parts += columns([heads[:6], *lines], left=2)
        parts.append("")
    levels = level_rows(fit)
    if levels:
        parts += ["Level by level, pooled in part:", "", *listed_rows(levels, left=2), ""]
    if fit.drop_test is not None and not fit.drop_test.missing:
        parts += ["What the drop test rests on:", *_listed(drop_remarks(fit.drop_test)), ""]
    for line in pace_lines(fit):
        parts += [*wrapped([line], others="  "), ""]
    assumed = assumption_lines(fit)
    if assumed:
        parts += ["What rests on assumptions:", *_listed(assumed), ""]
    parts.append("What the table says of each parameter:")
    parts += _listed(f"{row.name}: {row.verdict}; {row.reason}" for row in rows)
    parts += _listed(f"note: {remark}" for remark in evidence_remarks(fit))
    parts += ["", "Measured | predicted (median +- half of the 68 % interval, without noise):", ""]
    parts += listed_rows(prediction_table(fit, MOST_LINES), without="speed [m/s]")
    parts += more(len(table), file_words("predictions.csv", len(table)))
    balances = balance_table(fit.balances, MOST_LINES)
    parts += ["", "Model-free, from the measurements alone:", "", *columns([balances.heads, *balances.rows])]
    parts += more(len(table), file_words("balances.csv", len(table)))
    known = (*fit.problem.table.remarks, *fit.problem.notes)
    parts += [*_listed(balances.legend), "", *wrapped(diagnosis_lines(fit), others="  ")]
    times = ", ".join(f"{timing.stage} {timing.seconds:.1f} s" for timing in fit.timings)
    parts += ["", f"Time: {times}.", f"Results: {folder}"]
    parts += [f"  {item.name}" for item in sorted(folder.iterdir())] if folder.is_dir() else []
    return "\n".join(parts)


def render_json(fit: Fit, folder: Path) -> str:
    """The summary for machines: everything but draws; the full parameter set is in `fit.json`."""
    content = {
        "status": fit.status,
        "verdict": fit.verdict,
        "drop_test": None if fit.drop_test is None else asdict(fit.drop_test),
        "adequacy": None if fit.adequacy is None else asdict(fit.adequacy),
        "model": fit.problem.model.name,
        "table": fit.problem.table.name,
        "folder": str(folder),
        "parameters": {estimate.name: _numbers(estimate) for estimate in fit.estimates},
        "derived": {estimate.name: _numbers(estimate) for estimate in fit.derived.values()},
        "rms": dict(fit.point.rms),
        "court_pace": None if fit.court_pace is None else asdict(fit.court_pace),
        "assumptions": None if fit.assumptions is None else asdict(fit.assumptions),
        "notes": notes(fit),
        "seconds": {timing.stage: timing.seconds for timing in fit.timings},
    }
    return json.dumps(content, indent=2, allow_nan=False)


def _numbers(estimate: Estimate) -> dict[str, object]:
    names = ("unit", *ESSENTIALS, "point", "verdict", "given", "reason")
    return {name: getattr(estimate, name) for name in names}
