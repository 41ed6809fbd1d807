"""Pages read by Sphinx with what their snippets gave: outputs, tables, pictures, files, from the folder `made`. Of a
tutorial there is a notebook too.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from notebooks import notebook
from snippets import figures, files, outcomes_of, snippets, woven
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError


def _beside(page: str) -> str:
    """Name of the folder beside a built page in which the files lie that it links to."""
    return f"{Path(page).name}-files"


def _is_notebook(page: str) -> bool:
    return page.startswith("tutorials/")


def _link(page: str) -> str:
    """A link to the notebook of a page, below its title."""
    words = "This page as a notebook, with its outputs"
    return f'```{{raw}} html\n<p><a class="reference" href="{Path(page).name}.ipynb" download>{words}</a></p>\n```'


def _weave(app: Sphinx, page: str, source: list[str]) -> None:
    text = source[0]
    if not (any(item.runs or item.file for item in snippets(text)) or figures(text)):
        return
    made = Path(app.config.made)
    outcomes = outcomes_of(made, page)
    if outcomes is None and any(item.runs for item in snippets(text)):
        raise ExtensionError(f"the snippets of {page} have not been run: build with scripts/docs")
    folder = os.path.relpath(made / page, (Path(app.srcdir) / page).parent)
    text = woven(text, outcomes or [], Path(folder).as_posix(), _beside(page))
    if _is_notebook(page):
        title, rest = text.split("\n", 1)
        text = f"{title}\n\n{_link(page)}\n{rest}"
    source[0] = text


def _copy(app: Sphinx, failed: Exception | None) -> None:
    if failed is not None:
        return
    for page in app.env.found_docs:
        text = Path(app.env.doc2path(page)).read_text(encoding="utf-8")
        if _is_notebook(page):
            made = Path(app.config.made)
            target = Path(app.outdir) / f"{page}.ipynb"
            target.write_text(notebook(text, outcomes_of(made, page) or [], made / page), encoding="utf-8")
        for file in files(text):
            target = Path(app.outdir) / Path(page).parent / _beside(page) / file
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(Path(app.config.made) / page / file, target)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the setting `made`, the weaving, and the copying of files that pages link to."""
    app.add_config_value("made", "", "env", str)
    app.connect("source-read", _weave)
    app.connect("build-finished", _copy)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
