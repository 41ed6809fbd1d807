"""The result folder of a comparison: may it be written, and the writing of it, `compare.json` last."""

from __future__ import annotations

from pathlib import Path

from fitball.files import all_or_none
from fitball.inference.comparison.results import Comparison
from fitball.report.compare.figure import compare_figure
from fitball.report.compare.forest import forest_figure, shown
from fitball.report.compare.page import compare_page
from fitball.report.compare.rows import csv_rows, json_content
from fitball.report.compare.text import render
from fitball.report.figures.save import save_figure
from fitball.report.form.atomic_write import write_text
from fitball.report.form.csv import csv_text
from fitball.report.form.json_text import json_text

JSON_NAME = "compare.json"
PAGE_NAME = "compare.html"
PICTURES = {"ranking": "compare.png", "forest": "forest.png"}


@all_or_none()
def write_all(comparison: Comparison, words: str, folder: Path, command: str | None = None) -> None:
    """Write every file, each whole or not at all; `command` is the line that asked for it.

    Raises ResultFolderError.
    """
    figures = {"ranking": compare_figure(comparison)}
    quantities, models = comparison.assumptions, [scored.name for scored in comparison.models]
    if shown(quantities):
        title = f"{comparison.table.name}: median, sd and 95 % interval under each model"
        figures["forest"] = forest_figure(quantities, models, title)
    images = {name: save_figure(figure, folder / PICTURES[name]) for name, figure in figures.items()}
    write_text(folder / PAGE_NAME, compare_page(comparison, images, command))
    write_text(folder / "compare.csv", csv_text(csv_rows(comparison)))
    write_text(folder / "compare.txt", render(comparison, words, folder) + "\n")
    write_text(folder / JSON_NAME, json_text(json_content(comparison, words)))
