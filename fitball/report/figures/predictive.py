"""The figures of a fit; together with `figure_corner` the only importer of matplotlib and corner."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.special import ndtri

from fitball.observables import OBSERVABLES
from fitball.report.figures.arrays import axis_label, group_of, incidence, measured_points, residual_data, trace_data
from fitball.report.figures.drawable import Drawable, drawn, parameter
from fitball.report.figures.shown import ShownFigure
from fitball.report.form.display_units import handy, output_scale

# Colour-blind safe (Okabe and Ito).
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
MARKERS = ("o", "s", "^", "D", "v", "P")
# Impacts that a figure draws one by one: more are a blot, and cost more memory than the fit.
MOST_POINTS = 4000


def shown_rows(count: int) -> NDArray[np.int64]:
    """Of `count` impacts those that a figure draws, evenly spread; all of them if it can."""
    return np.unique(np.linspace(0, count - 1, min(count, MOST_POINTS)).round().astype(np.int64))


def _drawn(fit: Drawable) -> str:
    """Which impacts a figure shows, for its title; nothing when it shows all."""
    count = len(fit.problem.table)
    return f" ({MOST_POINTS:,} of {count:,} impacts)" if count > MOST_POINTS else ""


def new_figure(width: float, height: float, layout: Literal["constrained"] | None = "constrained") -> Figure:
    """An empty figure on the raster canvas, without any global state."""
    figure = ShownFigure(figsize=(width, height), layout=layout)
    FigureCanvasAgg(figure)
    return figure


def _output_label(name: str) -> str:
    return axis_label(OBSERVABLES[name].symbol, output_scale(name).unit)


def _styles(groups: Sequence[str]) -> dict[str, tuple[str, str]]:
    return {
        group: (COLOURS[k % len(COLOURS)], MARKERS[k % len(MARKERS)]) for k, group in enumerate(sorted(set(groups)))
    }


def predictive_figure(fit: Drawable) -> Figure:
    """Measured rebounds with error bars against the posterior band, along incidence angle."""
    points = measured_points(fit)
    names = list(points)
    rows = (len(names) + 1) // 2
    figure = new_figure(10.0, 0.6 + 3.6 * rows)
    axes = np.atleast_1d(figure.subplots(rows, 2 if len(names) > 1 else 1)).ravel()
    styles = _styles(group_of(fit))
    for axis, name in zip(axes, names, strict=False):
        _draw_predictive(axis, fit, name, styles)
    for axis in axes[len(names) :]:
        axis.set_visible(False)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(4, len(labels)), frameon=False)
    figure.suptitle(f"{fit.problem.model.name} on {fit.problem.table.name}: measured and predicted{_drawn(fit)}")
    return figure


def _draw_predictive(axis: Axes, fit: Drawable, name: str, styles: dict[str, tuple[str, str]]) -> None:
    points = measured_points(fit)[name]
    factor = handy(name, "").factor
    curves = fit.predictive.curves if fit.predictive is not None else {}
    for group, (colour, marker) in styles.items():
        if group in curves:
            curve = curves[group]
            along = np.degrees(curve.theta_1) if fit.problem.table.has_tangential else curve.impacts.v_y1
            bands = curve.outputs[name] * factor
            axis.fill_between(along, bands[0], bands[4], color=colour, alpha=0.15, linewidth=0)
            axis.fill_between(along, bands[1], bands[3], color=colour, alpha=0.3, linewidth=0)
            axis.plot(along, bands[2], color=colour, linewidth=1.3)
        rows = shown_rows(len(points.groups))
        mine = rows[[points.groups[k] == group for k in rows]]
        label = f"measured: {group}" if group else "measured"
        axis.errorbar(
            points.along[mine],
            points.values[mine],
            points.sd[mine],
            fmt=marker,
            color=colour,
            markersize=5,
            capsize=2,
            linewidth=1,
            label=label,
        )
    axis.set_title(OBSERVABLES[name].title, fontsize=11)
    axis.set_xlabel(incidence(fit)[0])
    axis.set_ylabel(_output_label(name))
    axis.grid(alpha=0.3)
    if curves:
        axis.plot([], [], color="0.3", linewidth=1.3, label="posterior median, 68 and 95 % bands")


def residual_figure(fit: Drawable) -> Figure:
    """Standardised residuals along incidence and against normal quantiles."""
    data = residual_data(fit)
    figure = new_figure(10.0, 0.8 + 2.5 * len(data))
    grid = np.atleast_2d(figure.subplots(len(data), 2, width_ratios=[2, 1]))
    styles = _styles(group_of(fit))
    rows = shown_rows(len(fit.problem.table))
    for row, item in zip(grid, data, strict=True):
        for limit, alpha in ((2.0, 0.12), (1.0, 0.12)):
            row[0].axhspan(-limit, limit, color="0.5", alpha=alpha, linewidth=0)
        row[0].axhline(0.0, color="0.3", linewidth=0.8)
        for group, (colour, marker) in styles.items():
            mine = rows[[item.groups[k] == group for k in rows]]
            row[0].plot(
                item.along[mine], item.values[mine], marker, color=colour, markersize=5, label=group or "impacts"
            )
        row[0].set_ylabel(f"{OBSERVABLES[item.name].symbol}: residual / sd")
        row[0].set_xlabel(incidence(fit)[0])
        row[0].grid(alpha=0.3)
        order = np.sort(item.values[np.isfinite(item.values)])
        normal = ndtri((np.arange(order.size) + 0.5) / order.size)
        reach = 1.1 * max(2.0, float(np.max(np.abs(order))))
        row[1].plot([-reach, reach], [-reach, reach], color="0.5", linewidth=0.8)
        some = shown_rows(order.size)
        row[1].plot(normal[some], order[some], "o", color="0.2", markersize=4)
        row[1].set_xlabel("normal quantile")
        row[1].set_ylabel("residual / sd")
        row[1].grid(alpha=0.3)
    if len(styles) > 1:
        handles, labels = grid[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    figure.suptitle(
        f"{fit.problem.model.name} on {fit.problem.table.name}: residuals (bands: 1 and 2 sd){_drawn(fit)}"
    )
    return figure


def trace_figure(fit: Drawable) -> Figure:
    """A few walkers of each ensemble after warm-up, and the marginal of each ensemble."""
    posterior = drawn(fit)
    data = trace_data(fit)
    figure = new_figure(11.0, 1.0 + 1.35 * len(data))
    grid = np.atleast_2d(figure.subplots(len(data), 2, width_ratios=[4, 1], sharex="col"))
    for k, (row, item) in enumerate(zip(grid, data, strict=True)):
        # Ensembles in turn, so that none hides the others; without smoothed edges the file is a third as large.
        for walkers in item.values.swapaxes(0, 1):
            for colour, walker in zip(cycle(COLOURS), walkers, strict=False):
                row[0].plot(item.steps, walker, color=colour, linewidth=0.5, antialiased=False)
        for ensemble in range(item.values.shape[0]):
            colour = COLOURS[ensemble % len(COLOURS)]
            draws = (
                posterior.values[ensemble, :, :, k].ravel()
                * handy(posterior.names[k], parameter(fit, posterior.names[k]).spec.unit).factor
            )
            low, high = np.quantile(draws, (0.001, 0.999))
            counts, edges = np.histogram(draws, bins=40, range=(low, high), density=True)
            row[1].stairs(
                counts / counts.max(), edges, orientation="horizontal", color=colour, label=f"ensemble {ensemble + 1}"
            )
        row[0].set_ylabel(item.label, fontsize=9)
        row[1].tick_params(labelleft=False, labelbottom=False)
        row[1].sharey(row[0])
    grid[-1][0].set_xlabel("step")
    grid[-1][1].set_xlabel("marginal, by ensemble")
    handles, labels = grid[0][1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    figure.suptitle(f"{fit.problem.model.name} on {fit.problem.table.name}: walkers after warm-up")
    return figure
