"""A fit made again and compared; what that found, as a person reads it and as JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import shorten
from typing import Any

from fitball.api.calibrating import begin
from fitball.api.reading import Report
from fitball.errors import ResultFolderError
from fitball.repeat.compare import (
    FALSE_ALARM,
    Finding,
    Kept,
    Outcome,
    Repetition,
    check_rows,
    compared,
    read_kept,
    write_numbers,
)
from fitball.report.fit.folder import older_result, write_all
from fitball.report.form.document import columns
from fitball.report.form.folders import held
from fitball.report.form.numbers import significant
from fitball.report.saved.run_file import find_records, find_tables, read_run, record_problem
from fitball.report.saved.structure import OlderFileError

# Rows of the table that are printed; JSON holds all.
SHOWN = 20
# Characters of a text that are printed; JSON holds all.
WIDEST = 40


@dataclass(frozen=True)
class Repeated:
    """A fit made again: what was found beside the `original`, and the folder `out` that the new one is kept in."""

    repetition: Repetition
    original: Kept
    out: Path | None

    @property
    def exit_code(self) -> int:
        """0 where the results do not contradict each other, else 1."""
        return 1 if self.repetition.outcome is Outcome.DIFFERENT else 0

    def report(self) -> str:
        """All of it as text."""
        kept = [] if self.out is None else [str(self.out)]
        return "\n".join([render(self.repetition, self.original), *kept])

    def json(self) -> dict[str, Any]:
        """All of it for machines, in SI."""
        return repetition_json(self.repetition, self.original.content)


def repeat(
    fit: Path, tables: Sequence[str], force: str | None, out: Path | None, cores: int, report: Report
) -> Repeated | None:
    """Make the fit of a folder or of a `run.toml` again and compare; None for one of an older fitball, which is only
    made again. `tables` and `force` say where its files are now; the new result is kept in the folder `out`.

    Raises ResultFolderError, and as `calibrate` does; KeyboardInterrupt with nothing compared.
    """
    record = read_run(fit)
    try:
        original = read_kept(record.folder)
    except OlderFileError:
        # It cannot be compared with, and is the reason for many to make it again.
        if out is None:
            raise
        original = None
    problem = record_problem(record, find_tables(record, tables), find_records(record, force))
    if original is not None:
        check_rows(problem, original)
    if out is not None and (older := older_result(out)):
        raise ResultFolderError(
            f"{out}: holds {' and '.join(older)} of an older run, which is never replaced here; name another folder "
            "with --out"
        )
    place = nullcontext(out) if out is not None else TemporaryDirectory(prefix="fitball-repeat-")
    with place as name, held(Path(name)):
        made = begin(problem, replace(record.effort, cores=cores), Path(name)).fit(report)
        report("comparison", None)
        (write_numbers if out is None else write_all)(made, Path(name))
        return (
            None if original is None else Repeated(compared(problem, original, read_kept(Path(name))), original, out)
        )


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
