"""Pages read by Sphinx with what their snippets gave: outputs, tables, pictures, from the folder `made`."""

from __future__ import annotations

import os
from pathlib import Path

from made import outcomes_of
from snippets import figures, snippets, woven
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError


def _weave(app: Sphinx, page: str, source: list[str]) -> None:
    text = source[0]
    if not (any(item.runs or item.file for item in snippets(text)) or figures(text)):
        return
    made = Path(app.config.made)
    outcomes = outcomes_of(made, page)
    if outcomes is None and any(item.runs for item in snippets(text)):
        raise ExtensionError(f"the snippets of {page} have not been run: build with scripts/docs")
    folder = os.path.relpath(made / page, (Path(app.srcdir) / page).parent)
    source[0] = woven(text, outcomes or [], Path(folder).as_posix())


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the setting `made`, and the weaving."""
    app.add_config_value("made", "", "env", str)
    app.connect("source-read", _weave)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
