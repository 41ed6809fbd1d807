"""What a user reads of an example: the list, inputs with what was assumed, claims beside the exact solution."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

from fitball.report.form.text_table import WIDTH, columns
from fitball.studies.thesis.example_claims import Finding, remarks
from fitball.studies.thesis.simulate_examples import EXAMPLES, Example


def list_text() -> str:
    """All examples, one per line."""
    return "\n".join(columns([["example", "what it shows"], *([item.name, item.title] for item in EXAMPLES)], left=2))


def example_text(example: Example, found: Sequence[Finding]) -> str:
    """Title, inputs, and each claim with its finding."""
    head = f"{example.name}: {example.title} (Jafri 2004)"
    lines = [head, "=" * len(head), *_wrapped("Stated: ", example.stated)]
    for text in example.assumed:
        lines += _wrapped("Assumed: ", text)
    for text in remarks(example):
        lines += _wrapped("Note: ", text)
    rows = [["the thesis says", "printed", "exact", "exact - printed", "thesis's computation"]]
    rows += [[item.claim.said, *_cells(item)] for item in found]
    notes = [line for item in found if item.note for line in _wrapped("* ", item.note)]
    return "\n".join([*lines, "", *columns(rows), *notes])


def example_json(example: Example, found: Sequence[Finding]) -> dict[str, Any]:
    """The record of an example: what was stated, assumed, claimed and found."""
    return {
        "name": example.name,
        "title": example.title,
        "stated": example.stated,
        "assumed": list(example.assumed),
        "remarks": list(remarks(example)),
        "claims": [
            {
                "said": item.claim.said,
                "curve": example.curves[item.claim.curve].label,
                "unit": item.claim.unit,
                "printed": item.claim.printed,
                "exact": item.found,
                "difference": item.difference,
                "thesis_computation": item.computed,
                "note": item.note,
            }
            for item in found
        ],
    }


def _wrapped(head: str, text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=head, subsequent_indent=" " * len(head))


def _cells(item: Finding) -> list[str]:
    unit = f" {item.claim.unit}" if item.claim.unit else ""
    numbers = (item.claim.printed, item.found, item.difference, item.computed)
    printed, exact, difference, computed = (
        "" if number is None or isinstance(number, bool) else f"{number:.5g}{unit}" for number in numbers
    )
    if isinstance(item.found, bool):
        exact = "so it is" if item.found else "not so"
    elif item.found is None:
        exact = "never"
    return [f"{printed} *" if item.note else printed, exact, difference, computed]
