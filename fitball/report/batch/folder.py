"""The files of a whole batch: a table of all as CSV and Parquet, figures, a page."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from fitball.report.batch.figure import batch_figure
from fitball.report.batch.grouping import Over
from fitball.report.batch.page import batch_page
from fitball.report.batch.population_files import write_populations
from fitball.report.batch.populations import Populated, default_names, populations
from fitball.report.batch.rows import CSV_NAME, NAME, Row
from fitball.report.batch.series import Along, Series, all_series
from fitball.report.figures.save import save_figure
from fitball.report.form.atomic_write import remove, write_bytes, write_text
from fitball.report.form.csv import write_csv

PAGE_NAME, PARQUET_NAME = "batch.html", "batch.parquet"
PICTURE, DRIFT = "parameters.png", "drift.png"


@dataclass(frozen=True)
class Shown:
    """What the files of a batch show: quantities over the tables, and the populations of some of them."""

    series: tuple[Series, ...]
    populated: tuple[Populated, ...]


def write_results(
    rows: Sequence[Row],
    folder: Path,
    command: str | None = None,
    quantities: Sequence[str] = (),
    over: Over = None,
) -> Shown:
    """Write every file, each whole or not at all; `command` is the line that asked. Returns what they show.

    Populations are those of parameters that enough tables tell, and of `quantities`, `over` levels or not.
    Parquet needs pyarrow, and is left out without it. Raises ResultFolderError, ParameterError as `populations` does.
    """
    series = all_series(rows)
    populated = populations(rows, folder, [*default_names(series), *quantities], over)
    write_populations(populated, folder)
    write_csv(folder / CSV_NAME, rows)
    if find_spec("pyarrow") is not None:
        _write_parquet(rows, folder / PARQUET_NAME)
    figures = {}
    if series:
        names = [str(row[NAME]) for row in rows]
        figures[PICTURE] = batch_figure(series, names, populated=populated)
        along = most_told(series)
        if along is not None:
            figures[DRIFT] = batch_figure(_drifting(series, along), names, along)
    for name in {PICTURE, DRIFT} - set(figures):
        remove(folder / name)
    images = {name: save_figure(figure, folder / name) for name, figure in figures.items()}
    write_text(folder / PAGE_NAME, batch_page(rows, series, images, command, populated))
    return Shown(series, populated)


def most_told(series: Sequence[Series]) -> Along | None:
    """What most quantities drift along."""
    found = [along for one in series for along, _line in one.drifts]
    return max(found, key=lambda along: sum(other is along for other in found), default=None)


def _drifting(series: Sequence[Series], along: Along) -> list[Series]:
    return [one for one in series if any(item is along for item, _line in one.drifts)]


def _write_parquet(rows: Sequence[Row], place: Path) -> None:
    import pandas as pd

    made = io.BytesIO()
    pd.DataFrame(list(rows)).to_parquet(made, index=False)
    write_bytes(place, made.getvalue())
