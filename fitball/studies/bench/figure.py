"""Figures of `fitball bench`: speed against error, and effective draws a second."""

from __future__ import annotations

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fitball.report.figures.canvas import new_figure, own_style
from fitball.report.form.palette import GUIDE, SERIES
from fitball.studies.bench.densities import OURS
from fitball.studies.bench.measure import Bench
from fitball.studies.bench.scenes import HARD

# Errors below this are drawn at it: zero has no logarithm.
FLOOR = 1e-17
MARKS = "D*dos^vPX"


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


@own_style()
def samplers_figure(bench: Bench) -> Figure:
    """Effective draws a CPU second by sampler, one mark a table."""
    frame = bench.frames["samplers"]
    samplers = list(dict.fromkeys(frame["sampler"]))[::-1]
    made = new_figure(8.5, 1.4 + 0.42 * len(samplers))
    panel = made.subplots()
    for k, (table, mine) in enumerate(frame.groupby("table", sort=False)):
        panel.semilogx(
            mine["draws a CPU second"], [samplers.index(name) for name in mine["sampler"]], MARKS[k % len(MARKS)],
            color=SERIES[k % len(SERIES)], label=str(table), alpha=0.85,
        )  # fmt: skip
    panel.set_yticks(range(len(samplers)), samplers)
    panel.set_ylim(-0.5, len(samplers) - 0.5)
    panel.hlines(range(len(samplers)), *panel.get_xlim(), color=GUIDE, linewidth=0.5, alpha=0.5)
    panel.set_xlabel("effective draws a CPU second")
    panel.grid(alpha=0.3, axis="x")
    panel.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return made
