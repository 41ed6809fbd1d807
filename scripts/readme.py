"""Write the numbers and tables of README.md and docs/ between their marks, from the code and from what `fits/` keeps.

`python scripts/readme.py` renders; with `--measure` it first fits Wang's tables, compares the models and re-derives
the thesis (some minutes), and keeps the figures in `fits/readme/`. Speed comes from `fitball bench`, coverage from
`scripts/validate`; both keep what they found in `fits/`.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path

import quoted
from measured import ROOT, kept, measure

MARKED = re.compile(
    r"<!-- (?P<name>[\w-]+): written by scripts/readme.py -->\n(?P<old>.*?)<!-- end of (?P=name) -->", re.DOTALL
)


def blocks() -> dict[str, str]:
    """Every block by the name in its marks."""
    numbers = kept()
    quoting = (
        *(quoted.wang, quoted.wang_short, quoted.compared, quoted.together, quoted.stiffness, quoted.film),
        quoted.thesis,
    )
    others = (
        *(quoted.references, quoted.trust_line, quoted.tracks_line),
        *(quoted.validation, quoted.trust, quoted.faults, quoted.plan, quoted.population, quoted.few, quoted.gaps),
        *(
            quoted.tracks,
            quoted.priors,
            quoted.speed,
            quoted.speed_line,
            quoted.densities,
            quoted.samplers,
            quoted.tables,
        ),
    )
    written = {block.__name__: block(numbers) for block in quoting} | {block.__name__: block() for block in others}
    return {name.replace("_", "-"): text for name, text in written.items()}


def pages() -> list[Path]:
    """Every file that may hold blocks."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def updated(text: str, content: dict[str, str]) -> str:
    """A page with every block between its marks. Raises KeyError of a block that nobody writes."""
    return MARKED.sub(
        lambda found: (
            f"<!-- {found['name']}: written by scripts/readme.py -->\n{content[found['name']]}\n"
            f"<!-- end of {found['name']} -->"
        ),
        text,
    )


def main() -> None:
    """Measure, if asked to, and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--measure", action="store_true", help="measure again first")
    if parser.parse_args().measure:
        measure()
    content = blocks()
    for page in pages():
        page.write_text(updated(page.read_text(encoding="utf-8"), content), encoding="utf-8")


if __name__ == "__main__":
    main()
