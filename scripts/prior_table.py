"""Write the table of default priors into README.md, from the code that uses them."""

from __future__ import annotations

import sys
from pathlib import Path

from fitball.inference.parameters import NOISE_SPECS
from fitball.models.specs import SPECS

README = Path(__file__).resolve().parent.parent / "README.md"
BEGIN, END = "<!-- priors: written by scripts/prior_table.py -->", "<!-- end of priors -->"


def table() -> str:
    """The table as Markdown."""
    rows = ["| parameter | unit | bounds | default prior | meaning |", "|---|---|---|---|---|"]
    rows += [
        f"| `{spec.name}` | {spec.unit or '-'} | {spec.lower:g} to {spec.upper:g} | `{spec.prior}` | {spec.meaning} |"
        for spec in (*SPECS.values(), *NOISE_SPECS.values())
    ]
    return "\n".join(rows)


def updated(text: str) -> str:
    """README text with the table between its marks."""
    head, _, rest = text.partition(BEGIN)
    _, _, tail = rest.partition(END)
    return f"{head}{BEGIN}\n{table()}\n{END}{tail}"


if __name__ == "__main__":
    before = README.read_text(encoding="utf-8")
    after = updated(before)
    README.write_text(after, encoding="utf-8")
    sys.exit(0)
