"""The result folder of a simulation: may it be written, and the writing of it, `simulate.json` last."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from fitball.files import all_or_none
from fitball.report.figures.save import save_figure
from fitball.report.form.atomic_write import write_text
from fitball.report.form.json_text import json_text

JSON_NAME = "simulate.json"
CSV_NAME = "history.csv"
FIGURE_STEM = "history"


@all_or_none()
def write_all(folder: Path, content: Mapping[str, Any], csv: str, figure: Figure, form: str) -> tuple[Path, ...]:
    """Write every file, each whole or not at all; returns their places. Raises ResultFolderError."""
    picture, table, record = folder / f"{FIGURE_STEM}.{form}", folder / CSV_NAME, folder / JSON_NAME
    save_figure(figure, picture, form)
    write_text(table, csv)
    write_text(record, json_text(content))
    return picture, table, record
