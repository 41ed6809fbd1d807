"""The corner plot: posterior draws, the prior on the diagonal, the point estimate marked."""

from __future__ import annotations

from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, NullLocator

from fitball.report.figures.canvas import log_scale, new_figure
from fitball.report.figures.corner_arrays import CornerData, corner_data, pair_density
from fitball.report.figures.drawable import Drawable
from fitball.report.form.palette import MEASURED, MODEL, PRIOR, pale

PANEL, GAP = 1.55, 0.08
# Inches of room for tick and axis labels.
LABEL_MARGIN = 0.95
# Between the contours and within the inner one: opaque, which draws faster than what shines through.
SHADES = [pale(MODEL, 0.35), pale(MODEL, 0.7)]


def corner_figure(fit: Drawable) -> Figure:
    """All pairs of free parameters."""
    data = corner_data(fit)
    count = len(data.axes)
    side = max(5.2, PANEL * count + LABEL_MARGIN + 0.1)
    figure = new_figure(side, side, layout=None)
    low, high = LABEL_MARGIN / side, 1.0 - 0.1 / side
    grid = figure.add_gridspec(count, count, left=low, bottom=low, right=high, top=high, wspace=GAP, hspace=GAP)
    for row in range(count):
        for column in range(row + 1):
            axis = figure.add_subplot(grid[row, column])
            _scales(axis, data, column, row)
            if row == column:
                _draw_one(axis, data, row)
            else:
                _draw_pair(axis, data, column, row)
    handles = [
        Line2D([], [], color=MODEL, label="posterior (contours: 39 and 86 % of it)"),
        Line2D([], [], color=PRIOR, label="prior"),
        Line2D([], [], color=MEASURED, linestyle="--", marker="+", label="point estimate"),
    ]
    small = count < 4
    figure.legend(
        handles=handles, loc="upper right", bbox_to_anchor=(0.995, 1.0 - 0.3 / side), fontsize=8 if small else 11,
        frameon=False, title=f"{fit.problem.model.name} on {fit.problem.table.name}",
        title_fontsize=9 if small else 13, alignment="right",
    )  # fmt: skip
    return figure


def _scales(axis: Axes, data: CornerData, column: int, row: int) -> None:
    """Limits, and ticks at the lower and left edge alone: most of the time of a drawing is spent on ticks."""
    last, first = row == len(data.axes) - 1, column == 0 and row > 0
    _scale(axis, data, column, "x", last)
    if row == column:
        axis.set_yticks([])
    else:
        _scale(axis, data, row, "y", first)
    axis.tick_params(which="both", labelsize=8, labelrotation=45)
    if last:
        axis.set_xlabel(data.axes[column].label, fontsize=11)
        axis.xaxis.set_label_coords(0.5, -0.42)
    if first:
        axis.set_ylabel(data.axes[row].label, fontsize=11)
        axis.yaxis.set_label_coords(-0.42, 0.5)


def _scale(axis: Axes, data: CornerData, k: int, which: Literal["x", "y"], ticks: bool) -> None:
    low, high = float(data.edges[k][0]), float(data.edges[k][-1])
    side = axis.xaxis if which == "x" else axis.yaxis
    if data.axes[k].logarithmic:
        log_scale(axis, low, high, which)
    else:
        (axis.set_xlim if which == "x" else axis.set_ylim)(low, high)
        side.set_major_locator(MaxNLocator(3, prune="lower"))
    if not ticks:
        side.set_major_locator(NullLocator())
        side.set_minor_locator(NullLocator())


def _draw_one(axis: Axes, data: CornerData, k: int) -> None:
    axis.stairs(data.posterior[k], data.edges[k], color=SHADES[0], fill=True)
    axis.stairs(data.posterior[k], data.edges[k], color=MODEL, linewidth=1.0)
    axis.stairs(data.prior[k], data.edges[k], color=PRIOR, linewidth=1.3, baseline=None)
    axis.axvline(data.point[k], color=MEASURED, linestyle="--", linewidth=1.0)
    axis.set_ylim(0.0, 1.06 * max(float(data.posterior[k].max()), float(data.prior[k].max())))


def _draw_pair(axis: Axes, data: CornerData, column: int, row: int) -> None:
    density, levels = pair_density(data, column, row)
    x, y = (_middles(data, k) for k in (column, row))
    if levels[0] < levels[1]:
        axis.contourf(x, y, density, [*levels, density.max() * 1.01], colors=SHADES)
        axis.contour(x, y, density, levels, colors=[MODEL], linewidths=0.9)
    axis.plot(data.point[column], data.point[row], "+", color=MEASURED, markersize=7)


def _middles(data: CornerData, k: int) -> np.ndarray:
    edges = data.edges[k]
    return np.sqrt(edges[1:] * edges[:-1]) if data.axes[k].logarithmic else 0.5 * (edges[1:] + edges[:-1])
