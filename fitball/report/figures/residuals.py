"""The figure of residuals: against every incident quantity, by group, and against normal quantiles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray
from scipy.special import ndtri

from fitball.observables import OBSERVABLES
from fitball.report.figures.canvas import MOST_NAMED, Margins, group_styles, heading, legend_below, panels, shown_rows
from fitball.report.figures.drawable import Drawable
from fitball.report.figures.measured import group_of
from fitball.report.figures.residual_arrays import WITHIN, Residuals, incident_quantities, residual_data, trend
from fitball.report.form.palette import FAINT, GUIDE, MEASURED, TREND
from fitball.values import FloatArray

CELL = (1.75, 1.6)
# From how many impacts on means over bins are shown, and beyond how many the density of dots instead of dots.
MEANS_FROM, MOST_DOTS = 60, 500
BINS, PIXELS = 12, (36, 36)
GREYS = LinearSegmentedColormap.from_list("density", ["#ffffff", FAINT, GUIDE, MEASURED])
# Groups that fit side by side with their names.
MOST_GROUPS = 8
Styles = Mapping[str, tuple[str, str]]


def residuals_figure(fit: Drawable) -> Figure:
    """A row for each output, a column for each quantity, one for groups and one for quantiles."""
    data, quantities = residual_data(fit), incident_quantities(fit)
    groups = np.array(group_of(fit))
    styles = group_styles(tuple(groups))
    grouped = len(styles) > 1
    count = len(quantities) + grouped + 1
    few = count < 4
    figure, axes = panels(
        len(data), count, (2.6, 1.9) if few else CELL, Margins(left=0.8, top=0.7 if few else 0.5, bottom=1.15)
    )
    for row, item in zip(axes, data, strict=True):
        reach = 1.12 * max(2.5, float(np.max(np.abs(item.values), initial=0.0)))
        for axis, quantity in zip(row, quantities.values(), strict=False):
            _draw_along(axis, quantity.values[item.rows], item, groups, styles, reach)
        if grouped:
            _draw_groups(row[-2], item, groups, styles)
        _draw_quantiles(row[-1], item)
        for axis in row:
            _guides(axis, reach, leftmost=axis is row[0])
        row[0].set_ylabel(f"{OBSERVABLES[item.name].symbol}: residual / sd")
    labels = [
        *(quantity.label for quantity in quantities.values()),
        *([fit.problem.grouped_by or ""] if grouped else []),
        "normal quantile",
    ]
    for axis, label in zip(axes[-1], labels, strict=True):
        axis.set_xlabel(label)
    for axis in axes[:-1].ravel():
        axis.set_xticks([])
    for axis in axes[-1]:
        axis.tick_params(labelsize=8)
    _legend(figure, fit, styles)
    heading(
        figure,
        f"{fit.problem.model.name} on {fit.problem.table.name}:{chr(10) if few else ' '}residuals "
        f"(measured - predicted) / sd",
    )
    return figure


def _guides(axis: Axes, reach: float, leftmost: bool) -> None:
    bands = [[(0.0, -limit), (1.0, -limit), (1.0, limit), (0.0, limit)] for limit in (1.0, 2.0)]
    style: dict[str, Any] = {"transform": axis.get_yaxis_transform(), "facecolors": GUIDE, "linewidths": 0}
    axis.add_collection(PolyCollection(bands, alpha=0.09, zorder=0, **style), autolim=False)
    axis.axhline(0.0, color=GUIDE, linewidth=0.8, zorder=1)
    axis.set_ylim(-reach, reach)
    if leftmost:
        axis.tick_params(labelsize=8)
    else:
        axis.set_yticks([])


def _draw_along(
    axis: Axes, along: FloatArray, item: Residuals, groups: NDArray[np.str_], styles: Styles, reach: float
) -> None:
    """Dots by group, or how dense they are; with means over bins where there are enough."""
    if item.rows.size > MOST_DOTS:
        span = [[float(along.min()), float(along.max())], [-reach, reach]]
        density, x_edges, y_edges = np.histogram2d(along, item.values, PIXELS, span)
        axis.pcolormesh(x_edges, y_edges, np.sqrt(density.T), cmap=GREYS, rasterized=True, zorder=0.5)
    else:
        _dots(axis, along, item, groups, styles)
    if item.rows.size >= MEANS_FROM:
        found = trend(along, item.values, BINS)
        axis.errorbar(
            found.along, found.mean, found.half, fmt="o-", color=TREND, markersize=2.5, linewidth=1.0, zorder=4
        )
    axis.locator_params(axis="x", nbins=4)


def _dots(axis: Axes, along: FloatArray, item: Residuals, groups: NDArray[np.str_], styles: Styles) -> None:
    mine = groups[item.rows]
    size, alpha = (4.5, 1.0) if item.rows.size < MEANS_FROM else (3.0, 0.45)
    for group, (colour, marker) in styles.items():
        chosen = mine == group
        axis.plot(
            along[chosen], item.values[chosen], marker, color=colour, markersize=size, alpha=alpha, markeredgewidth=0,
            zorder=2,
        )  # fmt: skip


def _draw_groups(axis: Axes, item: Residuals, groups: NDArray[np.str_], styles: Styles) -> None:
    """Each group's residuals side by side: dots, or the range of 95 % of them, and their mean with its interval."""
    mine = groups[item.rows]
    for k, (group, (colour, marker)) in enumerate(styles.items()):
        values = item.values[mine == group]
        if not values.size:
            continue
        if values.size > MEANS_FROM:
            axis.vlines(k, *np.quantile(values, (0.025, 0.975)), color=colour, linewidth=5, alpha=0.6)
        else:
            # Side by side in the order of the table, so that equal residuals do not cover each other.
            places = k + 0.5 * (np.arange(values.size) / max(values.size - 1, 1) - 0.5)
            axis.plot(places, values, marker, color=colour, markersize=3.0, alpha=0.6, markeredgewidth=0)
        if values.size > 1:
            half = WITHIN * float(values.std(ddof=1)) / float(np.sqrt(values.size))
            axis.errorbar([k], [values.mean()], [half], fmt="o", color=TREND, markersize=3, linewidth=1.4, zorder=4)
    names = list(styles)
    axis.set_xlim(-0.7, len(names) - 0.3)
    shown = len(names) <= MOST_GROUPS
    axis.set_xticks(
        range(len(names)) if shown else [], [name[:12] for name in names] if shown else [], rotation=30, ha="right"
    )


def _draw_quantiles(axis: Axes, item: Residuals) -> None:
    order = np.sort(item.values)
    normal = ndtri((np.arange(order.size) + 0.5) / order.size)
    reach = 1.1 * float(np.max(np.abs(normal), initial=1.0))
    axis.plot([-reach, reach], [-reach, reach], color=GUIDE, linewidth=0.8)
    drawn = shown_rows(np.arange(order.size))
    axis.plot(normal[drawn], order[drawn], "o", color=MEASURED, markersize=3, markeredgewidth=0)
    axis.set_xlim(-reach, reach)
    axis.locator_params(axis="x", nbins=4)


def _legend(figure: Figure, fit: Drawable, styles: Styles) -> None:
    named = list(styles)[:MOST_NAMED] if len(styles) > 1 else []
    handles: list[Any] = [
        Line2D([], [], color=styles[name][0], marker=styles[name][1], linestyle="none", markersize=5)
        for name in named
    ]
    labels = list(named)
    handles.append(Patch(color=GUIDE, alpha=0.15, linewidth=0))
    labels.append("1 and 2 sd")
    if len(fit.problem.table) >= MEANS_FROM or named:
        handles.append(Line2D([], [], color=TREND, marker="o", markersize=3, linewidth=1.0))
        labels.append("means with 95 % intervals")
    if len(fit.problem.table) > MOST_DOTS:
        handles.append(Patch(color=FAINT, linewidth=0))
        labels.append("density of impacts")
    legend_below(figure, handles, labels, 6 if figure.get_figwidth() > 7.0 else 3)
