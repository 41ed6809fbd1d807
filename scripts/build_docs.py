"""Build the documentation: run every snippet of docs/, draw the figures, write static pages that open from disk.

Snippets run in `docs/_made/`, one folder a page; a page whose snippets and whose code have not changed since is not
run again. The pages go to `site/`; open `site/index.html`.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import matplotlib
from snippets import DOCS, ROOT, SharedFits, SnippetError, code_mark, is_current, make, pages, snippets
from sphinx.cmd.build import main as sphinx_build

MADE = DOCS / "_made"


def run_snippets(outputs: Path, *, again: bool, kept: bool) -> None:
    """Run the snippets of all pages that need it. Raises SnippetError."""
    code = code_mark()
    shell = SharedFits(outputs)
    for page, text in pages().items():
        if not any(item.runs for item in snippets(text)):
            continue
        if not again and is_current(outputs, page, text, None if kept else code):
            continue
        print(f"running the snippets of docs/{page}.md ...", file=sys.stderr)
        try:
            make(outputs, page, text, code, shell)
        except SnippetError as error:
            raise SnippetError(f"docs/{page}.md: {error}") from None


def build(outputs: Path, out: Path, work: Path) -> int:
    """Write the pages to `out`; a warning of Sphinx is an error. Returns the exit code."""
    return sphinx_build(
        ["-q", "-W", "--keep-going", "-b", "html", "-d", str(work), "-D", f"made={outputs}", str(DOCS), str(out)]
    )


def main() -> int:
    """Build; the exit code is 1 where a snippet or a link fails."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "site", help="where the pages go (default: site)")
    parser.add_argument("--again", action="store_true", help="run all snippets, changed or not")
    parser.add_argument(
        "--kept", action="store_true", help="take what unchanged snippets gave last, though the code changed"
    )
    options = parser.parse_args()
    matplotlib.use("agg")
    try:
        run_snippets(MADE, again=options.again, kept=options.kept)
    except SnippetError as error:
        print(f"scripts/docs: {error}", file=sys.stderr)
        return 1
    failed = build(MADE, options.out, MADE / "sphinx")
    if not failed:
        print(options.out / "index.html")
    return failed


if __name__ == "__main__":
    sys.exit(main())
