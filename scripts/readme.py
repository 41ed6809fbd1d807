"""Measure the numbers of README.md and the paper anew between their marks: `python
scripts/readme.py`.

Needs fitball installed (the environment of scripts/test) and a quiet machine; takes some two
minutes.
"""

import re
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGES = (ROOT / "README.md", ROOT / "docs/paper/paper.md")
FIGURE = ROOT / "docs/curves.png"
MARKED = re.compile(r"(<!-- measured: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def printed(work: str, *words: str) -> str:
    """What a verb prints."""
    command = [str(Path(sys.executable).with_name("fitball")), *words]
    return subprocess.run(
        command,
        cwd=work,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    ).stdout.strip()


def paragraph(text: str) -> str:
    """The answer below a report's title, a line each sentence."""
    return re.sub(r"(?<=\.) (?=[A-Z])", "\n", " ".join(text.split("\n\n")[1].split()))


def measured(work: str) -> dict[str, str]:
    """Every block by its name."""
    wang = printed(work, "calibrate", "wang_all.csv")
    shutil.copy(Path(work, "fits/wang_all/default/curves.png"), FIGURE)
    before = sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
    printed(work, "calibrate", "wang_zero_spin.csv")
    spent = sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2]) - before
    return {
        "wang": f"```text\n{wang}\n```",
        "first": f"`fitball calibrate wang_zero_spin.csv` takes {spent:.0f} s of CPU, figures and "
        "page included.",
        "bench": paragraph(printed(work, "bench")),
        "thesis": paragraph(printed(work, "rederive")),
    }


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        found = measured(folder)
    for page in PAGES:
        old = page.read_text(encoding="utf-8")
        page.write_text(
            MARKED.sub(lambda one: f"{one[1]}{found[one[2]]}\n{one[3]}", old),
            encoding="utf-8",
        )
