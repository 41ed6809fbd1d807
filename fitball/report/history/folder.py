"""The result folder of a simulation: may it be written, and the writing of it, `simulate.json` last."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from fitball.report.figures.save import save_figure
from fitball.report.form.atomic_write import write_text
from fitball.report.form.folders import holds_older

JSON_NAME = "simulate.json"
CSV_NAME = "history.csv"
FIGURE_STEM = "history"


def prepare(folder: Path, *, overwrite: bool) -> None:
    """Make the folder, or refuse one that holds an older simulation.

    Raises ResultFolderError. With `overwrite` the old files are removed first, the figure in whatever format, so that
    no mixture of two results can pass for one.
    """
    if not holds_older(folder, JSON_NAME, overwrite=overwrite):
        return
    for place in (folder / JSON_NAME, folder / CSV_NAME, *sorted(folder.glob(f"{FIGURE_STEM}.*"))):
        place.unlink(missing_ok=True)


def json_text(content: Mapping[str, Any]) -> str:
    """`simulate.json` as text."""
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def write_all(folder: Path, content: Mapping[str, Any], csv: str, figure: Figure, form: str) -> tuple[Path, ...]:
    """Write every file, each whole or not at all; returns their places. Raises ResultFolderError."""
    picture, table, record = folder / f"{FIGURE_STEM}.{form}", folder / CSV_NAME, folder / JSON_NAME
    save_figure(figure, picture, form)
    write_text(table, csv)
    write_text(record, json_text(content))
    return picture, table, record
