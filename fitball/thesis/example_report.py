"""What a user reads of an example: the list, inputs with what was assumed, claims beside the exact solution."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

from fitball.report.form.text_table import WIDTH, columns
from fitball.thesis.example_claims import Finding, remarks
from fitball.thesis.simulate_examples import EXAMPLES, Example


def list_text() -> str:
    """All examples, one per line."""
    return "\n".join(
        columns([["example", "what it shows"], *([example.name, example.title] for example in EXAMPLES)], left=2)
    )


def list_json() -> list[dict[str, str]]:
    """All examples: name and title."""
    return [{"name": example.name, "title": example.title} for example in EXAMPLES]


def example_text(example: Example, results: Sequence[Finding]) -> str:
    """Title, inputs, and each claim with its finding."""
    head = f"{example.name}: {example.title} (Jafri 2004)"
    lines = [head, "=" * len(head), *_wrapped("Stated: ", example.stated)]
    for text in example.assumed:
        lines += _wrapped("Assumed: ", text)
    for text in remarks(example):
        lines += _wrapped("Note: ", text)
    rows = [["the thesis says", "printed", "exact", "exact - printed", "thesis's computation"]]
    rows += [[finding.claim.said, *_cells(finding)] for finding in results]
    notes = [line for finding in results if finding.note for line in _wrapped("* ", finding.note)]
    return "\n".join([*lines, "", *columns(rows), *notes])


def example_json(example: Example, results: Sequence[Finding]) -> dict[str, Any]:
    """The record of an example: what was stated, assumed, claimed and found."""
    return {
        "name": example.name,
        "title": example.title,
        "stated": example.stated,
        "assumed": list(example.assumed),
        "remarks": list(remarks(example)),
        "claims": [
            {
                "said": finding.claim.said,
                "curve": example.curves[finding.claim.curve].label,
                "unit": finding.claim.unit,
                "printed": finding.claim.printed,
                "exact": finding.found,
                "difference": finding.difference,
                "thesis_computation": finding.computed,
                "note": finding.note,
            }
            for finding in results
        ],
    }


def _wrapped(head: str, text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=head, subsequent_indent=" " * len(head))


def _cells(finding: Finding) -> list[str]:
    unit = f" {finding.claim.unit}" if finding.claim.unit else ""
    numbers = (finding.claim.printed, finding.found, finding.difference, finding.computed)
    printed, exact, difference, computed = (
        "" if number is None or isinstance(number, bool) else f"{number:.5g}{unit}" for number in numbers
    )
    if isinstance(finding.found, bool):
        exact = "so it is" if finding.found else "not so"
    elif finding.found is None:
        exact = "never"
    return [f"{printed} *" if finding.note else printed, exact, difference, computed]
