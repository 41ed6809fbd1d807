"""Files of `fitball bench`."""

from __future__ import annotations

import math
from pathlib import Path

import pandas as pd

from fitball.errors import ResultFolderError
from fitball.report.figures.save import save_figure
from fitball.report.form.atomic_write import write_text
from fitball.studies.bench.figure import figure
from fitball.studies.bench.measure import Bench

FIGURE = "speed_against_error.png"


def write(bench: Bench, folder: Path) -> None:
    """Write CSV files, figure and the table in words. Raises ResultFolderError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResultFolderError(f"{folder}: cannot be made: {error.strerror}; name another with --out") from None
    for name in ("precision", "batches", "growth", "start_up", "stages"):
        frame: pd.DataFrame = getattr(bench, name)
        write_text(folder / f"{name}.csv", frame.to_csv(index=False, float_format="%.4g", lineterminator="\n"))
    save_figure(figure(bench), folder / FIGURE)
    write_text(folder / "summary.md", "\n".join(summary(bench)) + "\n")


def summary(bench: Bench) -> list[str]:
    """The figures people ask for, as Markdown."""
    lines = [f"Measured by `fitball bench` on {bench.machine}.", ""]
    wang = bench.precision[bench.precision["scene"] == "Wang's 21"]
    fastest = float(wang[wang["solver"] == "closed form, batch"]["microseconds"].iloc[0])
    lines += ["| solver on Wang's 21 impacts | setting | us an impact | times slower | largest error |",
              "|---|---|---|---|---|"]  # fmt: skip
    for row in wang.to_dict("records"):
        lines.append(
            f"| {row['solver']} | {row['setting']} | {row['microseconds']:.3g} | "
            f"{row['microseconds'] / fastest:.3g} | {row['largest error']:.1e} |"
        )
    lines += ["", "Largest error of the closed form by scene: " + ", ".join(
        f"{row['scene']} {row['largest error']:.1e}"
        for row in bench.precision.to_dict("records") if row["solver"] == "closed form, one by one"
    ) + ".", ""]  # fmt: skip
    for frame in (bench.batches, bench.growth, bench.start_up, bench.stages):
        lines += ["| " + " | ".join(frame.columns) + " |", "|" + "---|" * len(frame.columns)]
        for values in frame.itertuples(index=False):
            lines.append("| " + " | ".join(_text(value) for value in values) + " |")
        lines.append("")
    return lines


def _text(value: object) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.3g}"
    return str(value)
