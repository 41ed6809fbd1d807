"""Measured against predicted rebounds, and residuals."""

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

from fitball.inference.problem.observables import Observable
from fitball.inference.results.results import Fit
from fitball.observables import OBSERVABLES
from fitball.report.figures.canvas import (
    MOST_POINTS,
    Margins,
    Styles,
    filled,
    fit_heading,
    group_handles,
    group_styles,
    inner,
    legend_below,
    panels,
    shown_rows,
    verbatim,
)
from fitball.report.figures.quantities import (
    bias,
    group_of,
    measured_part,
    measured_rows,
    noise_sd,
    output_label,
    prediction,
    prediction_of,
)
from fitball.report.form.numbers import output_scale
from fitball.report.form.palette import FAINT, GUIDE, MEASURED, MODEL, NOISE, TREND
from fitball.values import FloatArray
from fitball.wording import short

SHARE = 0.95
# Bins of a band that replaces more intervals than can be seen apart.
BAND_BINS = 24


@dataclass(frozen=True)
class Agreement:
    """One output at the impacts `rows` where it was measured, in the unit in which people read it.

    `predicted` is the posterior median without noise, or the point estimate; 95 % intervals (2, rows) of the `model`,
    from the uncertainty of its parameters (None for a point fit), and of a new `measurement`, with noise.
    """

    name: str
    rows: NDArray[np.int64]
    measured: FloatArray
    predicted: FloatArray
    model: FloatArray | None
    measurement: FloatArray

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Which measurements lie in the interval of a new one."""
        return np.asarray((self.measured >= self.measurement[0]) & (self.measured <= self.measurement[1]))

    @property
    def rms(self) -> float:
        """Root mean square difference of measured and predicted."""
        return float(np.sqrt(np.mean((self.measured - self.predicted) ** 2)))

    @property
    def words(self) -> str:
        """How many measurements lie inside."""
        return f"{np.count_nonzero(self.inside):,} of {self.inside.size:,} within 95 %"


def agreements(fit: Fit) -> tuple[Agreement, ...]:
    """Every fitted column."""
    return tuple(_agreement(fit, item) for item in fit.problem.observables)


def _agreement(fit: Fit, observable: Observable) -> Agreement:
    factor = output_scale(observable.name).factor

    def part(*arrays: FloatArray) -> FloatArray:
        return factor * measured_part(observable, np.stack(arrays))

    drawn, measured, model = prediction_of(fit, observable), part(observable.observed)[0], None
    predicted = part(prediction(fit, observable))[0]
    if drawn is not None:
        model, ends = part(drawn.mean_q025, drawn.mean_q975), part(drawn.data_q025, drawn.data_q975)
    else:
        away = fit.problem.noise.reach(SHARE, fit.point.values) * noise_sd(fit, observable)
        centre = measured_part(observable, prediction(fit, observable)) + bias(fit, observable)
        ends = factor * np.stack([centre - away, centre + away])
    return Agreement(observable.name, measured_rows(observable), measured, predicted, model, ends)


def interval_band(agreement: Agreement, interval: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places (bins,) and ends (2, bins) of the interval about the 1:1 line: medians over bins of equal count."""
    order = np.argsort(agreement.predicted, kind="stable")
    parts = [part for part in np.array_split(order, BAND_BINS) if part.size]
    places = np.array([np.median(agreement.predicted[part]) for part in parts])
    ends = np.stack([[np.median(side[part] - agreement.predicted[part]) for part in parts] for side in interval])
    return places, places + ends


COLUMNS = 3
# Impacts beyond which intervals become a band, and points small.
MOST_INTERVALS = 150


def predictive_figure(fit: Fit) -> Figure:
    """A panel for each output."""
    items = agreements(fit)
    columns, narrow = min(COLUMNS, len(items)), len(items) == 1
    groups = group_of(fit)
    styles = group_styles(groups)
    handles = {f"measured: {name}" if name else "measured": mark for name, mark in group_handles(styles).items()}
    if fit.predictive is not None:
        handles["model, 95 %"] = _bar(MODEL)
    handles["new measurement, 95 %"] = _bar(NOISE)
    # Labels of the axis and the lines of the legend.
    below = 0.62 + 0.19 * -(-len(handles) // min(columns, len(handles)))
    margins = Margins(across=0.8, down=0.85, top=0.85 if narrow else 0.65, bottom=below)
    figure, axes = filled(len(items), COLUMNS, (2.85, 2.85), margins)
    for axis, item in zip(axes.ravel(), items, strict=False):
        _draw_agreement(axis, item, groups, styles)
    legend_below(figure, handles, columns)
    shown = f" ({MOST_POINTS:,} of {len(groups):,} impacts)" if len(groups) > MOST_POINTS else ""
    fit_heading(figure, fit, f"measured against predicted{shown}", narrow)
    return figure


def _bar(colour: str) -> Line2D:
    return Line2D([], [], color=colour, linewidth=4, solid_capstyle="butt")


def _draw_agreement(axis: Axes, item: Agreement, groups: tuple[str, ...], styles: Styles) -> None:
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
    axis.set_title(OBSERVABLES[item.name].title)
    axis.set_xlabel(f"predicted {output_label(item.name)}")
    axis.set_ylabel(f"measured {output_label(item.name)}")
    axis.grid()


def predictive_words(fit: Fit) -> str:
    """The figure in words and numbers."""
    parts = [
        f"{item.name}: {np.count_nonzero(item.inside)} of {item.inside.size} measurements within the 95 % interval "
        f"of a new one, root mean square difference {item.rms:.2g} {output_scale(item.name).unit}"
        for item in agreements(fit)
    ]
    what = "posterior median" if fit.predictive is not None else "point estimate"
    return f"Measured rebounds against the {what}. " + "; ".join(parts) + "."


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
    """Residuals of every observable at the posterior median, or the point estimate, without biases of groups."""
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


# From how many impacts on means over bins are shown, and beyond how many the density of dots instead of dots.
MEANS_FROM, MOST_DOTS = 60, 500
TREND_BINS, PIXELS = 12, (36, 36)
GREYS = LinearSegmentedColormap.from_list("density", ["#ffffff", FAINT, GUIDE, MEASURED])
# Groups that fit side by side with their names.
MOST_GROUPS = 8


def residuals_figure(fit: Fit) -> Figure:
    """A row for each output, a column for each quantity, one for groups and one for quantiles."""
    data, quantities = residual_data(fit), incident_quantities(fit)
    groups = np.array(group_of(fit))
    styles = group_styles(tuple(groups))
    grouped = len(styles) > 1
    count = len(quantities) + grouped + 1
    few = count < 4
    figure, axes = panels(
        len(data),
        count,
        (2.6, 1.9) if few else (1.75, 1.6),
        Margins(left=0.8, top=0.7 if few else 0.5, bottom=1.15),
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
    _residual_legend(figure, fit, styles)
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
        found = trend(along, item.values, TREND_BINS)
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


def _residual_legend(figure: Figure, fit: Fit, styles: Styles) -> None:
    handles: dict[str, Any] = {**group_handles(styles)} if len(styles) > 1 else {}
    means = len(fit.problem.table) >= MEANS_FROM or len(styles) > 1
    handles["1 and 2 sd"] = Patch(color=GUIDE, alpha=0.15, linewidth=0)
    if means:
        handles["means with 95 % intervals"] = Line2D([], [], color=TREND, marker="o", markersize=3, linewidth=1.0)
    if len(fit.problem.table) > MOST_DOTS:
        handles["density of impacts"] = Patch(color=FAINT, linewidth=0)
    legend_below(figure, handles, 6 if figure.get_figwidth() > 7.0 else 3)


def residuals_words(fit: Fit) -> str:
    """The figure in words and numbers."""
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
