"""The corner plot: posterior draws, the prior on the diagonal, the point estimate marked."""

from __future__ import annotations

import corner
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from fitball.report.figures.arrays import HISTOGRAM_BINS, corner_data
from fitball.report.figures.drawable import Drawable
from fitball.report.figures.predictive import COLOURS, new_figure

PANEL = 1.55
# Inches of room for tick and axis labels; corner's own margins cut them off when there are many panels.
LABEL_MARGIN = 1.0


def corner_figure(fit: Drawable) -> Figure:
    """All pairs of free parameters."""
    data = corner_data(fit)
    count = len(data.labels)
    side = max(4.5, PANEL * count + 1.2)
    # corner lays its panels out itself.
    figure = new_figure(side, side, layout=None)
    corner.corner(
        data.draws,
        fig=figure,
        labels=list(data.labels),
        range=list(data.ranges),
        bins=HISTOGRAM_BINS,
        color=COLOURS[0],
        levels=(0.393, 0.865),
        smooth=1.0,
        plot_datapoints=False,
        fill_contours=True,
        max_n_ticks=3,
        label_kwargs={"fontsize": 11},
        labelpad=0.12 if count > 3 else 0.02,
        hist_kwargs={"density": True},
    )
    margin = LABEL_MARGIN / side
    figure.subplots_adjust(left=margin, bottom=margin, right=0.985, top=0.985)
    axes = np.array(figure.axes).reshape(count, count)
    for k in range(count):
        edges, density = data.prior[k]
        axes[k, k].stairs(density, edges, color=COLOURS[1], linewidth=1.2)
        axes[k, k].axvline(data.point[k], color="black", linestyle="--", linewidth=1.0)
        axes[k, k].set_ylim(0.0, 1.05 * max(axes[k, k].get_ylim()[1] / 1.1, float(density.max())))
        for row in range(k + 1, count):
            axes[row, k].plot(data.point[k], data.point[row], "k+", markersize=7)
        for column in range(k + 1):
            axes[k, column].tick_params(labelsize=8)
    legend = [
        Line2D([], [], color=COLOURS[0], label="posterior (contours: 39 and 86 %, one and two sd in two dimensions)"),
        Line2D([], [], color=COLOURS[1], label="prior"),
        Line2D([], [], color="black", linestyle="--", marker="+", label="point estimate (maximum of the posterior)"),
    ]
    figure.legend(handles=legend, loc="upper right", bbox_to_anchor=(0.985, 0.965), fontsize=11, frameon=False)
    figure.suptitle(f"{fit.problem.model.name} on {fit.problem.table.name}", x=0.98, y=0.985, ha="right", fontsize=13)
    return figure
