"""The figure of force records against the posterior prediction."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from fitball.report.figures.drawable import Drawable
from fitball.report.figures.force_arrays import force_panels
from fitball.report.figures.predictive import COLOURS, new_figure

COLUMNS = 3


def force_figure(fit: Drawable) -> Figure:
    """Measured means with the sensor's noise, the model's force, and what a record is expected to show."""
    panels = force_panels(fit)
    columns = min(COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    figure = new_figure(3.4 * columns + 0.4, 2.7 * rows + 1.1)
    axes = np.atleast_1d(figure.subplots(rows, columns)).ravel()
    for axis, panel in zip(axes, panels, strict=False):
        axis.fill_between(
            panel.times, *panel.expected, color=COLOURS[0], alpha=0.15, linewidth=0,
            label="95 % of a record (noise and misfit)",
        )  # fmt: skip
        axis.fill_between(panel.along, panel.course[0], panel.course[2], color=COLOURS[0], alpha=0.4, linewidth=0)
        axis.plot(panel.along, panel.course[1], color=COLOURS[0], linewidth=1.2, label="model's force, 95 % band")
        axis.errorbar(
            panel.times, panel.means, panel.sd, fmt="o", color=COLOURS[1], markersize=3, linewidth=0.8,
            label="measured (means of samples)",
        )  # fmt: skip
        axis.set_title(panel.title, fontsize=10)
        axis.set_xlabel("time after landing [ms]")
        axis.grid(alpha=0.3)
    for axis in axes[len(panels) :]:
        axis.set_visible(False)
    for axis in axes[::columns]:
        axis.set_ylabel("force on the court [N]")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(3, columns), frameon=False, fontsize=9)
    figure.suptitle(f"{fit.problem.model.name} on {fit.problem.table.name}: force records")
    return figure
