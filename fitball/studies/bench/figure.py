"""The figure of `fitball bench`: speed against error."""

from __future__ import annotations

from matplotlib.figure import Figure

from fitball.report.figures.canvas import new_figure
from fitball.report.form.palette import GUIDE, SERIES
from fitball.studies.bench.measure import Bench

# Errors below this are drawn at it: zero has no logarithm.
FLOOR = 1e-17
MARKS = ("D", "d", "*", "o", "s", "^", "v", "P")


def figure(bench: Bench) -> Figure:
    """Time per impact against largest error, one panel per scene, one curve per solver."""
    names = list(dict.fromkeys(bench.precision["scene"]))
    made = new_figure(13.0, 7.4)
    panels = made.subplots(2, 3, sharex=True, sharey=True).ravel()
    solvers = list(dict.fromkeys(bench.precision["solver"]))
    for panel, name in zip(panels, names, strict=False):
        mine = bench.precision[bench.precision["scene"] == name]
        for k, solver in enumerate(solvers):
            rows = mine[mine["solver"] == solver]
            if rows.empty:
                continue
            panel.loglog(
                rows["largest error"].clip(lower=FLOOR), rows["microseconds"], f"{MARKS[k % len(MARKS)]}-",
                color=SERIES[k % len(SERIES)] if k < len(SERIES) else GUIDE, markersize=6, linewidth=1,
                markerfacecolor=SERIES[k % len(SERIES)] if k < 3 else "none", label=solver,
            )  # fmt: skip
        panel.set_title(name, fontsize=11)
        panel.grid(alpha=0.3)
    for panel in panels[3:]:
        panel.set_xlabel("largest error / incident surface speed")
    for panel in panels[::3]:
        panel.set_ylabel("microseconds per impact")
    handles, labels = panels[1].get_legend_handles_labels()
    panels[-1].axis("off")
    panels[-1].legend(handles, labels, loc="center", frameon=False)
    made.suptitle(f"Speed against error ({bench.machine}, one thread)")
    return made
