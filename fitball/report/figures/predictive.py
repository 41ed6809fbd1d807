"""The figure of measured against predicted: every measurement beside the 1:1 line, with its intervals."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from fitball.observables import OBSERVABLES
from fitball.report.figures.canvas import (
    MOST_NAMED,
    Margins,
    counted,
    group_styles,
    heading,
    legend_below,
    legend_room,
    panels,
    shown_rows,
)
from fitball.report.figures.drawable import Drawable
from fitball.report.figures.measured import group_of, output_label
from fitball.report.figures.predictive_arrays import Agreement, agreements, interval_band
from fitball.report.form.palette import GUIDE, MODEL, NOISE

COLUMNS = 3
CELL = (2.85, 2.85)
# Impacts beyond which intervals become a band, and points small.
MOST_INTERVALS = 150
Styles = Mapping[str, tuple[str, str]]


def predictive_figure(fit: Drawable) -> Figure:
    """A panel for each output."""
    items = agreements(fit)
    columns = min(COLUMNS, len(items))
    rows = -(-len(items) // columns)
    groups = group_of(fit)
    styles = group_styles(groups)
    entries = min(len(styles), MOST_NAMED) + 1 + (fit.predictive is not None)
    room = legend_room(entries, columns)
    figure, axes = panels(
        rows, columns, CELL, Margins(across=0.8, down=0.85, top=0.65 if columns > 1 else 0.85, bottom=room)
    )
    for axis, item in zip(axes.ravel(), items, strict=False):
        _draw(axis, item, groups, styles)
    for axis in axes.ravel()[len(items) :]:
        axis.set_visible(False)
    named = list(styles)[:MOST_NAMED]
    handles = [
        Line2D([], [], color=styles[name][0], marker=styles[name][1], linestyle="none", markersize=5)
        for name in named
    ]
    labels = [f"measured: {name}" if name else "measured" for name in named]
    if fit.predictive is not None:
        handles.append(Line2D([], [], color=MODEL, linewidth=4, solid_capstyle="butt"))
        labels.append("95 %: the model, by its parameters")
    handles.append(Line2D([], [], color=NOISE, linewidth=4, solid_capstyle="butt"))
    labels.append("95 %: a new measurement, with noise")
    legend_below(figure, handles, labels, columns)
    title = f"{fit.problem.model.name} on {fit.problem.table.name}:"
    words = f"measured against predicted{counted(len(groups))}"
    heading(figure, f"{title} {words}" if columns > 1 else f"{title}\n{words}")
    return figure


def _draw(axis: Axes, item: Agreement, groups: tuple[str, ...], styles: Styles) -> None:
    everything = np.concatenate([item.measured, item.predicted, item.measurement.ravel()])
    low, high = float(everything.min()), float(everything.max())
    room = 0.04 * ((high - low) or 1.0)
    ends = (low - room, high + room)
    axis.plot(ends, ends, color=GUIDE, linewidth=0.8, zorder=1)
    many = item.rows.size > MOST_INTERVALS
    for interval, colour, width in ((item.measurement, NOISE, 2.2), (item.model, MODEL, 4.0)):
        if interval is None:
            continue
        if many:
            places, sides = interval_band(item, interval)
            axis.fill_between(places, *sides, color=colour, alpha=0.9, linewidth=0, zorder=2)
        else:
            axis.vlines(item.predicted, *interval, color=colour, linewidth=width, zorder=2)
    label = np.array(groups)[item.rows]
    drawn = shown_rows(np.arange(item.rows.size))
    for group, (colour, marker) in styles.items():
        mine = drawn[label[drawn] == group]
        axis.plot(
            item.predicted[mine], item.measured[mine], marker, color=colour, markersize=2.0 if many else 4.5,
            alpha=0.2 if many else 1.0, markeredgewidth=0.0 if many else 0.5,
            markeredgecolor="white", zorder=3,
        )  # fmt: skip
    axis.set_xlim(*ends)
    axis.set_ylim(*ends)
    axis.set_aspect("equal")
    # Above the diagonal there is room.
    axis.text(0.03, 0.97, item.words, transform=axis.transAxes, va="top", fontsize=9)
    axis.locator_params(nbins=6)
    axis.set_title(OBSERVABLES[item.name].title, fontsize=10)
    axis.set_xlabel(f"predicted {output_label(item.name)}")
    axis.set_ylabel(f"measured {output_label(item.name)}")
    axis.grid(alpha=0.3)
    axis.tick_params(labelsize=8)
