"""Files of `fitball bench`: tables, a figure of speed against error, what became slower in words."""

from __future__ import annotations

import math
from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fitball.bench.errors import FASTEST, OURS
from fitball.bench.measure import Bench
from fitball.bench.problems import HARD
from fitball.bench.ratios import RATIO, TOLERATED, WORK
from fitball.report.figures.canvas import new_figure, own_style, save_figure
from fitball.report.form.document import markdown_table
from fitball.report.form.files import write_text
from fitball.report.form.palette import SERIES

FIGURE = "speed_against_error.png"
# Errors below this are drawn at it: zero has no logarithm.
FLOOR = 1e-17
MARKS = "D*dos^vPX"
HEADS = {
    "densities": "The log posterior: errors are of the log density, against one by textbook formulas",
    "batches": "Batches",
    "ratios": "What `--check` compares",
}


def write(bench: Bench, folder: Path) -> None:
    """Write CSV files, the figure and the tables in words. Raises ResultFolderError."""
    for name, frame in bench.frames.items():
        write_text(folder / f"{name}.csv", frame.to_csv(index=False, float_format="%.4g", lineterminator="\n"))
    save_figure(figure(bench), folder / FIGURE)
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
        *markdown(wang), "", f"Largest error of the closed form by scene: {largest}.", "",
    ]  # fmt: skip
    for name, head in HEADS.items():
        lines += [f"{head}:", "", *markdown(bench.frames[name]), ""]
    return lines


def verdict(compared: pd.DataFrame) -> tuple[list[str], bool]:
    """Ratios now and then as Markdown, what has become slower in words, and whether nothing has."""
    slower = compared[compared["times"] > TOLERATED]
    lines = [*markdown(compared), ""]
    lines += [
        f"{row[WORK]}: {row['times']:.2f} times slower than kept ({row['now']:.3g} {RATIO}, was {row['kept']:.3g})"
        for row in slower.to_dict("records")
    ]
    return lines, slower.empty


def markdown(frame: pd.DataFrame) -> list[str]:
    """A table as lines of Markdown."""
    rows = [list(map(_cell, values)) for values in frame.itertuples(index=False)]
    return markdown_table([list(frame.columns), *rows]).splitlines()


def _cell(value: object) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.3g}"
    return str(value)


@own_style()
def figure(bench: Bench) -> Figure:
    """Time per impact against largest error, one panel a scene, and time a log posterior, one curve a solver."""
    precision, densities = bench.frames["precision"], bench.frames["densities"]
    names = [name for name in dict.fromkeys(precision["scene"]) if name != HARD]
    made = new_figure(13.0, 8.2)
    panels = made.subplots(2, 3).ravel()
    for panel, name in zip(panels, names, strict=False):
        _curves(panel, precision[precision["scene"] == name], "solver", name)
        panel.set_xlabel("largest error / incident surface speed")
        panel.set_ylabel("CPU microseconds an impact")
    _curves(panels[4], densities, "log posterior", "Log posterior of five tables")
    panels[4].set_xlabel("largest error of the log density")
    panels[4].set_ylabel("CPU microseconds a density")
    panels[5].axis("off")
    shared = {"frameon": False, "fontsize": 9, "labelspacing": 0.3}
    panels[5].add_artist(
        panels[5].legend(*panels[0].get_legend_handles_labels(), title="Bounce", loc="upper left", **shared)
    )
    panels[5].legend(*panels[4].get_legend_handles_labels(), title="Log posterior", loc="lower left", **shared)
    made.suptitle("Speed against error: lower left is better", fontsize=12)
    return made


def _curves(panel: Axes, rows: pd.DataFrame, by: str, title: str) -> None:
    for k, (name, mine) in enumerate(rows.groupby(by, sort=False)):
        ours = str(name).startswith(("closed form", OURS))
        color, line = SERIES[k % len(SERIES)], "-" if by == "solver" else ""
        panel.loglog(
            mine["largest error"].clip(lower=FLOOR), mine["microseconds"], MARKS[k % len(MARKS)] + line,
            color=color, markersize=8 if ours else 5, linewidth=1, label=str(name),
            markerfacecolor=color if ours else "none",
        )  # fmt: skip
    panel.set_title(title, fontsize=11)
    panel.grid(alpha=0.3)
