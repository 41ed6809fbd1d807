"""Measure the numbers of README.md and of the paper anew: `python scripts/readme.py`.

They stand between marks, `<!-- measured: NAME -->` and `<!-- end -->`. The script needs fitball
installed (the environment of scripts/test) and a quiet machine, and takes some two minutes.
"""

import argparse
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
# A block of measured numbers, with its name.
MARKED = re.compile(r"(<!-- measured: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def printed(work: str, *words: str) -> str:
    """What a verb prints, run in the folder `work`."""
    command = [str(Path(sys.executable).with_name("fitball")), *words]
    return subprocess.run(
        command,
        cwd=work,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    ).stdout.strip()


def paragraph(text: str) -> str:
    """The first paragraph below the title of a report, a line for each sentence."""
    return re.sub(r"(?<=\.) (?=[A-Z])", "\n", " ".join(text.split("\n\n")[1].split()))


def measured_blocks(work: str) -> dict[str, str]:
    """The text of each block by its name; verbs are run in the folder `work`."""
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


def main() -> None:
    """Measure, and write the blocks of both pages and the figure anew."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        blocks = measured_blocks(folder)
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        text = MARKED.sub(lambda match: f"{match[1]}{blocks[match[2]]}\n{match[3]}", text)
        page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
