"""The figure of residuals: against every incident quantity, by group, and against normal quantiles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
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

from fitball.inference.results.results import Fit
from fitball.observables import OBSERVABLES
from fitball.report.figures.canvas import (
    Margins,
    Styles,
    fit_heading,
    group_handles,
    group_styles,
    inner,
    legend_below,
    panels,
    shown_rows,
    verbatim,
)
from fitball.report.figures.quantities import bias, group_of, measured_part, measured_rows, noise_sd, prediction
from fitball.report.form.palette import FAINT, GUIDE, MEASURED, TREND
from fitball.values import FloatArray
from fitball.wording import short

WITHIN = 1.959963984540054
# A quantity whose values lie as near to each other as this share of the largest does not differ.
ALIKE = 1e-3


@dataclass(frozen=True)
class Residuals:
    """Standardised residuals of one output, (measured - predicted)/sd, at the impacts `rows` of the table."""

    name: str
    rows: NDArray[np.int64]
    values: FloatArray


@dataclass(frozen=True)
class Incident:
    """One quantity of the incident state with its label, (impacts,) in the unit in which people read it."""

    label: str
    values: FloatArray


@dataclass(frozen=True)
class Trend:
    """Means of residuals over bins of equal count, with half of their 95 % intervals, all (bins,)."""

    along: FloatArray
    mean: FloatArray
    half: FloatArray


def residual_data(fit: Fit) -> tuple[Residuals, ...]:
    """Residuals of every observable at the posterior median, or the point estimate, biases of groups taken off."""
    found = []
    for item in fit.problem.observables:
        gap = measured_part(item, item.observed) - measured_part(item, prediction(fit, item)) - bias(fit, item)
        found.append(Residuals(item.name, measured_rows(item), gap / noise_sd(fit, item)))
    return tuple(found)


def incident_quantities(fit: Fit) -> Mapping[str, Incident]:
    """Components, speed, angle and spin by name, those that differ between impacts."""
    impacts = fit.problem.impacts
    everything = {
        "v_x1": Incident(r"$v_{x1}$ [m/s]", impacts.v_x1),
        "v_y1": Incident(r"$v_{y1}$ [m/s]", impacts.v_y1),
        "v_1": Incident(r"speed $v_1$ [m/s]", impacts.speed),
        "theta_1": Incident(r"angle $\theta_1$ [deg]", np.degrees(impacts.angle)),
        "omega_1": Incident(r"spin $\omega_1$ [rad/s]", impacts.omega_1),
    }
    if not fit.problem.table.has_tangential:
        everything = {name: everything[name] for name in ("v_y1", "omega_1")}
    return {
        name: item
        for name, item in everything.items()
        if np.ptp(item.values) > ALIKE * float(np.max(np.abs(item.values)))
    }


def trend(along: FloatArray, values: FloatArray, bins: int) -> Trend:
    """Means over `bins` of equal count along a quantity; equal values of it stay together."""
    order = np.argsort(along, kind="stable")
    first = np.searchsorted(along[order], along[order[np.arange(1, bins) * order.size // bins]])
    parts = [part for part in np.split(order, np.unique(first)) if part.size > 1]
    means = [float(values[part].mean()) for part in parts]
    halves = [WITHIN * float(values[part].std(ddof=1)) / float(np.sqrt(part.size)) for part in parts]
    return Trend(np.array([np.median(along[part]) for part in parts]), np.array(means), np.array(halves))


CELL = (1.75, 1.6)
# From how many impacts on means over bins are shown, and beyond how many the density of dots instead of dots.
MEANS_FROM, MOST_DOTS = 60, 500
BINS, PIXELS = 12, (36, 36)
GREYS = LinearSegmentedColormap.from_list("density", ["#ffffff", FAINT, GUIDE, MEASURED])
# Groups that fit side by side with their names.
MOST_GROUPS = 8


def figure(fit: Fit) -> Figure:
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
            _guides(axis, reach)
        row[0].set_ylabel(f"{OBSERVABLES[item.name].symbol}: residual / sd")
    labels = [quantity.label for quantity in quantities.values()]
    labels += [*([verbatim(fit.problem.grouped_by or "")] if grouped else []), "normal quantile"]
    for axis, label in zip(axes[-1], labels, strict=True):
        axis.set_xlabel(label)
    inner(axes, grid=False)
    _legend(figure, fit, styles)
    fit_heading(figure, fit, "residuals (measured - predicted) / sd", narrow=few)
    return figure


def _guides(axis: Axes, reach: float) -> None:
    bands = [[(0.0, -limit), (1.0, -limit), (1.0, limit), (0.0, limit)] for limit in (1.0, 2.0)]
    style: dict[str, Any] = {"transform": axis.get_yaxis_transform(), "facecolors": GUIDE, "linewidths": 0}
    axis.add_collection(PolyCollection(bands, alpha=0.09, zorder=0, **style), autolim=False)
    axis.axhline(0.0, color=GUIDE, linewidth=0.8, zorder=1)
    axis.set_ylim(-reach, reach)


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
    axis.set_xlim(-0.7, len(styles) - 0.3)
    shown = list(styles) if len(styles) <= MOST_GROUPS else []
    axis.set_xticks(range(len(shown)), [verbatim(short(name, 12)) for name in shown], rotation=30, ha="right")


def _draw_quantiles(axis: Axes, item: Residuals) -> None:
    order = np.sort(item.values)
    normal = ndtri((np.arange(order.size) + 0.5) / order.size)
    reach = 1.1 * float(np.max(np.abs(normal), initial=1.0))
    axis.plot([-reach, reach], [-reach, reach], color=GUIDE, linewidth=0.8)
    drawn = shown_rows(np.arange(order.size))
    axis.plot(normal[drawn], order[drawn], "o", color=MEASURED, markersize=3, markeredgewidth=0)
    axis.set_xlim(-reach, reach)
    axis.locator_params(axis="x", nbins=4)


def _legend(figure: Figure, fit: Fit, styles: Styles) -> None:
    handles: dict[str, Any] = {**group_handles(styles)} if len(styles) > 1 else {}
    means = len(fit.problem.table) >= MEANS_FROM or len(styles) > 1
    handles["1 and 2 sd"] = Patch(color=GUIDE, alpha=0.15, linewidth=0)
    if means:
        handles["means with 95 % intervals"] = Line2D([], [], color=TREND, marker="o", markersize=3, linewidth=1.0)
    if len(fit.problem.table) > MOST_DOTS:
        handles["density of impacts"] = Patch(color=FAINT, linewidth=0)
    legend_below(figure, handles, 6 if figure.get_figwidth() > 7.0 else 3)


def missing(_fit: Fit) -> str:
    """Every fit has this figure."""
    return ""


def words(fit: Fit) -> str:
    """The figure in words and numbers, for who does not see it."""
    parts = []
    for item in residual_data(fit):
        worst = int(np.argmax(np.abs(item.values)))
        beyond = int(np.sum(np.abs(item.values) > 2.0))
        parts.append(
            f"{item.name}: {beyond} of {item.values.size} beyond 2 sd, the largest {item.values[worst]:+.1f} sd at "
            f"impact {fit.problem.table.ids[item.rows[worst]]}"
        )
    against = ", ".join(incident_quantities(fit)) or "normal quantiles"
    return f"Standardised residuals, measured minus predicted, against {against}. " + "; ".join(parts) + "."
