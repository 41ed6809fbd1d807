"""Files of `fitball bench`."""

from __future__ import annotations

import math
from pathlib import Path

import pandas as pd

from fitball.report.figures.canvas import save_figure
from fitball.report.form.files import write_text
from fitball.studies.bench.figure import figure, samplers_figure
from fitball.studies.bench.measure import Bench
from fitball.studies.bench.precision import FASTEST
from fitball.studies.bench.ratios import RATIO, TOLERATED, WORK

FIGURE, SAMPLERS = "speed_against_error.png", "samplers.png"
HEADS = {
    "densities": "The log posterior: errors are of the log density, against one by textbook formulas",
    "samplers": "Effective draws a CPU second (the least of bulk and tail over all parameters)",
    "batches": "Batches",
    "growth": "With rows",
    "whole": "`fitball calibrate` with rows, from the CSV file to the result folder",
    "tables": "Many tables of 20 rows through `fitball batch`: CPU since the line before, memory the most so far",
    "processes": "Fresh processes, one core",
    "ratios": "What `--check` compares",
}


def write(bench: Bench, folder: Path) -> None:
    """Write CSV files, figures and the tables in words. Raises ResultFolderError."""
    for name, frame in bench.frames.items():
        write_text(folder / f"{name}.csv", frame.to_csv(index=False, float_format="%.4g", lineterminator="\n"))
    save_figure(figure(bench), folder / FIGURE)
    save_figure(samplers_figure(bench), folder / SAMPLERS)
    write_text(folder / "summary.md", "\n".join(summary(bench)) + "\n")


def summary(bench: Bench) -> list[str]:
    """The figures people ask for, as Markdown."""
    precision = bench.frames["precision"]
    wang = precision[precision["scene"] == "Wang's 21"].drop(columns=["scene", "median error"])
    fastest = float(wang[wang["solver"] == FASTEST]["microseconds"].iloc[0])
    wang.insert(3, "times slower", wang["microseconds"] / fastest)
    exact = precision[precision["solver"] == "closed form, one by one"]
    largest = ", ".join(f"{row['scene']} {row['largest error']:.1e}" for row in exact.to_dict("records"))
    lines = [
        f"Measured by `fitball bench` on {bench.machine}; times are of CPU, the least of several rounds.", "",
        *_table(wang), "", f"Largest error of the closed form by scene: {largest}.", "",
    ]  # fmt: skip
    for name, head in HEADS.items():
        lines += [f"{head}:", "", *_table(bench.frames[name]), ""]
    return [*lines, *missing_words(bench)]


def missing_words(bench: Bench) -> list[str]:
    """What to do for rivals that are not installed; empty where all are."""
    if not bench.missing:
        return []
    names = ", ".join(bench.missing)
    return [f"Not measured, not installed: {names}; pip install {' '.join(bench.missing)} (or fitball[bench]).", ""]


def verdict(compared: pd.DataFrame) -> tuple[list[str], bool]:
    """Ratios now and then as Markdown, what has become slower in words, and whether nothing has."""
    slower = compared[compared["times"] > TOLERATED]
    lines = [*_table(compared), ""]
    lines += [
        f"{row[WORK]}: {row['times']:.2f} times slower than kept ({row['now']:.3g} {RATIO}, was {row['kept']:.3g})"
        for row in slower.to_dict("records")
    ]
    return lines, slower.empty


def _table(frame: pd.DataFrame) -> list[str]:
    lines = ["| " + " | ".join(frame.columns) + " |", "|" + "---|" * len(frame.columns)]
    lines += ["| " + " | ".join(map(_text, values)) + " |" for values in frame.itertuples(index=False)]
    return lines


def _text(value: object) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.3g}"
    return str(value)
