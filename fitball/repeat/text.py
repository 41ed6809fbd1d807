"""What a repetition found, as a person reads it and as JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from textwrap import shorten
from typing import Any

from fitball.repeat.compare import FALSE_ALARM, Finding, Kept, Outcome, Repetition
from fitball.report.form.document import columns
from fitball.report.form.numbers import significant

# Rows of the table that are printed; JSON holds all.
SHOWN = 20
# Characters of a text that are printed; JSON holds all.
WIDEST = 40


def render(repetition: Repetition, original: Kept) -> str:
    """The outcome, what it rests on, and the numbers."""
    lines = [f"{original.folder} repeated: {repetition.outcome}", ""]
    if repetition.outcome is Outcome.BIT_EQUAL:
        return "\n".join([*lines, f"  {_bytes(original)}: the same bytes."])
    same = [name for name, equal in repetition.same.items() if equal]
    if same:
        lines += [f"  The same bytes: {', '.join(same)}.", ""]
    usual = [finding for finding in repetition.findings if finding.what.endswith((" median", " point"))]
    lines += _table(repetition.different or usual, repetition.limit)
    largest = repetition.largest
    if largest is not None:
        lines += ["", f"  Largest difference: {largest.what}, {largest.ratio or 0.0:.2g} standard errors."]
        lines.append(
            f"  Up to {repetition.limit:.2g} count as equal: of a thousand true repetitions one has a number beyond."
        )
    return "\n".join(lines)


def _bytes(original: Kept) -> str:
    if original.posterior is None:
        return "all numbers of fit.json (a point fit)"
    ensembles, steps, walkers, free = original.posterior.values.shape
    return (
        f"all numbers of fit.json and the draws ({ensembles} ensembles, {steps} steps, {walkers} walkers, "
        f"{free} parameters)"
    )


def _table(findings: Sequence[Finding], limit: float) -> list[str]:
    rows = [["", "original", "repeated", "difference", "allowed", "standard errors"]]
    rows += [_row(item) for item in findings[:SHOWN]]
    lines = [f"  {line}" for line in columns(rows)]
    reasons = dict.fromkeys(finding.basis for finding in findings)
    named = {"Monte Carlo error": f"Monte Carlo error ({limit:.2g} standard errors)"}
    lines += ["", "  Compared by: " + "; ".join(named.get(item, item) for item in reasons) + "."]
    if len(findings) > SHOWN:
        lines.append(f"  and {len(findings) - SHOWN} more: see --json")
    return lines


def _row(finding: Finding) -> list[str]:
    gap = finding.difference
    return [
        finding.what,
        _shown(finding.original),
        _shown(finding.repeated),
        "-" if gap is None else significant(gap),
        "-" if finding.allowed is None or math.isnan(finding.allowed) else significant(finding.allowed),
        "-" if finding.ratio is None else f"{finding.ratio:.2g}",
    ]


def _shown(value: float | str) -> str:
    return shorten(value, WIDEST, placeholder=" ...") if isinstance(value, str) else f"{value:.7g}"


def repetition_json(repetition: Repetition, original: Mapping[str, Any]) -> dict[str, Any]:
    """All of it; SI units."""
    largest = repetition.largest
    return {
        "kind": "fitball repetition",
        "outcome": str(repetition.outcome),
        "model": original["fitted"]["model_name"],
        "table": original["source"]["name"],
        "same_bytes": dict(repetition.same),
        "limit": repetition.limit,
        "false_alarm": FALSE_ALARM,
        "largest": None if largest is None else _entry(largest),
        "different": [_entry(finding) for finding in repetition.different],
        "compared": [_entry(finding) for finding in repetition.findings],
        "notes": list(repetition.notes),
    }


def _entry(finding: Finding) -> dict[str, Any]:
    def number(value: float | None) -> float | None:
        return None if value is None or not math.isfinite(value) else value

    return {
        "what": finding.what,
        "original": finding.original,
        "repeated": finding.repeated,
        "difference": finding.difference,
        "allowed": number(finding.allowed),
        "standard_error": number(finding.standard_error),
        "ratio": number(finding.ratio),
        "basis": finding.basis,
        "differs": finding.differs,
    }
