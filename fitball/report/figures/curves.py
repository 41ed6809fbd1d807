"""The figure of predictions over incidence: at one speed and spin in each column, with the impacts near it."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from fitball.report.figures.canvas import (
    MOST_NAMED,
    Margins,
    group_styles,
    heading,
    inner,
    legend_below,
    panels,
    shown_rows,
)
from fitball.report.figures.curve_arrays import CurveColumn, along_label, curve_columns, impacts_along
from fitball.report.figures.drawable import Drawable
from fitball.report.figures.measured import Measured, group_of, measured_outputs, output_label
from fitball.report.form.palette import FAINT, MEASURED, MODEL
from fitball.values import FloatArray

CELL = (3.1, 1.65)
# Bars on more points than this would hide the curve.
MOST_BARS = 60
# Impacts near a curve that are drawn one by one, bins that stand for more, impacts of a bin at least; and how many of
# the others are then drawn.
BINNED, BINS, LEAST_IN_BIN, MOST_FAR = 200, 24, 5, 300


def curves_figure(fit: Drawable) -> Figure:
    """A column for each speed and spin, a row for each output."""
    columns = curve_columns(fit)
    points = measured_outputs(fit)
    wide = CELL if len(columns) > 1 else (5.0, 1.9)
    figure, axes = panels(len(points), len(columns), wide, Margins(top=0.7, bottom=1.15 if len(columns) > 1 else 1.6))
    place, groups = impacts_along(fit), np.array(group_of(fit))
    for k, column in enumerate(columns):
        for axis, (name, item) in zip(axes[:, k], points.items(), strict=True):
            _draw_model(axis, column, column.bands[name])
            _draw_measured(axis, column, item, place, groups)
        axes[0, k].set_title(column.title, fontsize=10)
        axes[-1, k].set_xlabel(along_label(fit))
    for row, name in zip(axes, points, strict=True):
        row[0].set_ylabel(output_label(name))
        _same_height(row, points[name], [column.bands[name] for column in columns])
        row[0].tick_params(labelsize=8)
    for axis in axes[-1]:
        axis.tick_params(labelsize=8)
    inner(axes)
    _legend(figure, fit, groups, binned=any(column.rows.size > BINNED for column in columns))
    heading(figure, _title(fit, len(columns)))
    return figure


def _title(fit: Drawable, columns: int) -> str:
    over = "incidence at stated speed and spin" if fit.problem.table.has_tangential else "speed"
    mark = ":\n" if columns == 1 else ": "
    return f"{fit.problem.model.name} on {fit.problem.table.name}{mark}rebound over {over}"


def _draw_model(axis: Axes, column: CurveColumn, bands: FloatArray) -> None:
    inside = (column.along >= column.within[0]) & (column.along <= column.within[1])
    if len(bands) > 1:
        for lower, upper, alpha in ((bands[0], bands[4], 0.2), (bands[1], bands[3], 0.3)):
            axis.fill_between(column.along, lower, upper, color=MODEL, alpha=alpha, linewidth=0)
    middle = bands[len(bands) // 2]
    axis.plot(column.along, middle, color=MODEL, linewidth=1.0, linestyle=":")
    axis.plot(column.along[inside], middle[inside], color=MODEL, linewidth=1.4)
    axis.set_xlim(*_margins(column.along[[0, -1]], 0.03))


def _draw_measured(
    axis: Axes, column: CurveColumn, item: Measured, place: FloatArray, groups: NDArray[np.str_]
) -> None:
    near = np.isin(item.rows, column.rows)
    many = np.count_nonzero(near) > BINNED
    far = shown_rows(np.flatnonzero(~near), MOST_FAR if many else None)
    if far.size:
        axis.plot(place[item.rows[far]], item.values[far], ".", color=FAINT, markersize=4, zorder=1)
    if many:
        _draw_bins(axis, column, place[item.rows[near]], item.values[near])
        return
    strong = shown_rows(np.flatnonzero(near))
    for group, (colour, marker) in group_styles(tuple(groups)).items():
        mine = strong[groups[item.rows[strong]] == group]
        if not mine.size:
            continue
        where, crowded = place[item.rows[mine]], strong.size > MOST_BARS
        if not crowded:
            ends = item.values[mine] - item.sd[mine], item.values[mine] + item.sd[mine]
            axis.vlines(where, *ends, color=colour, linewidth=1.0, zorder=3)
        axis.plot(where, item.values[mine], marker, color=colour, markersize=2.0 if crowded else 4.0, zorder=3)


def _draw_bins(axis: Axes, column: CurveColumn, place: FloatArray, values: FloatArray) -> None:
    """Mean and sd of the measurements near a curve, bin by bin: dots would hide it."""
    edges = np.linspace(*column.within, BINS + 1)
    which = np.clip(np.digitize(place, edges) - 1, 0, BINS - 1)
    count = np.bincount(which, minlength=BINS)
    full = count >= LEAST_IN_BIN
    mean, middle, square = (np.bincount(which, what, BINS)[full] / count[full] for what in (values, place, values**2))
    sd = np.sqrt(np.maximum(square - mean**2, 0.0))
    axis.vlines(middle, mean - sd, mean + sd, color=MEASURED, linewidth=1.0, zorder=3)
    axis.plot(middle, mean, "o", color=MEASURED, markersize=3.0, zorder=3)


def _margins(ends: FloatArray, share: float) -> tuple[float, float]:
    low, high = float(np.min(ends)), float(np.max(ends))
    return low - share * (high - low), high + share * (high - low)


def _same_height(row: NDArray[Any], item: Measured, bands: list[FloatArray]) -> None:
    """One vertical range for all speeds and spins."""
    seen = [item.values - item.sd, item.values + item.sd, *(band.ravel() for band in bands)]
    known = np.concatenate([part[np.isfinite(part)] for part in seen])
    for axis in row:
        axis.set_ylim(*_margins(known, 0.06))
    row[0].locator_params(axis="y", nbins=5)


def _legend(figure: Figure, fit: Drawable, groups: NDArray[np.str_], *, binned: bool) -> None:
    styles = group_styles(tuple(groups))
    handles: list[Any] = [Line2D([], [], color=MODEL, linewidth=1.4)]
    labels = ["model (dotted: beyond the impacts near)" if fit.problem.table.has_tangential else "model"]
    if fit.predictive is not None:
        handles.append(Patch(color=MODEL, alpha=0.3, linewidth=0))
        labels.append("its 68 and 95 % bands, without noise")
    measured = "measured, with noise"
    if binned:
        styles, measured = {"": (MEASURED, "o")}, "measured near it, mean and sd in bins"
    for name in list(styles)[:MOST_NAMED]:
        colour, marker = styles[name]
        handles.append(Line2D([], [], color=colour, marker=marker, markersize=4.5, linewidth=1.0))
        labels.append(f"measured, with noise: {name}" if name else measured)
    if fit.problem.table.has_tangential:
        handles.append(Line2D([], [], color=FAINT, marker=".", linestyle="none", markersize=6))
        labels.append("other impacts")
    legend_below(figure, handles, labels, 1 if figure.get_figwidth() < 6.5 else 3)
