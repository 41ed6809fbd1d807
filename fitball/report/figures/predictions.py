"""Predictions: curves over incidence or speed, force over time, and the regimes of each impact."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from fitball.inference.likelihood.force import MISFIT, SD, aligned, mean_forces
from fitball.inference.prediction.posterior_predictive import curves
from fitball.inference.results.results import Curve, Fit, Predictive, thinned
from fitball.report.figures.canvas import (
    MOST_NAMED,
    Margins,
    drawn_handles,
    filled,
    fit_heading,
    group_styles,
    inner,
    legend_below,
    new_figure,
    panels,
    shown_rows,
    verbatim,
)
from fitball.report.figures.quantities import Measured, group_of, measured_outputs, output_label
from fitball.report.form.numbers import output_scale
from fitball.report.form.palette import FAINT, MEASURED, MODEL, NOISE, REGIMES
from fitball.values import FloatArray
from fitball.wording import short


@dataclass(frozen=True)
class CurveColumn:
    """Predictions at one speed and spin, in the units in which people read them.

    `along` (points,) is the angle of incidence [deg], or the speed of a drop test [m/s]; `bands` hold by output
    quantiles (2.5, 16, 50, 84, 97.5 %) of shape (5, points), or (1, points) of a point fit. `rows` are the impacts
    near that speed and spin, and `within` the range of `along` that they span.
    """

    title: str
    along: FloatArray
    bands: Mapping[str, FloatArray]
    rows: NDArray[np.int64]
    within: tuple[float, float]


def impacts_along(fit: Fit) -> FloatArray:
    """Places of impacts along the axis of the curves (impacts,)."""
    impacts = fit.problem.impacts
    if fit.problem.table.has_tangential:
        return np.degrees(impacts.angle)
    return impacts.v_y1


def along_label(fit: Fit) -> str:
    """What is on that axis."""
    return r"incidence $\theta_1$ [deg]" if fit.problem.table.has_tangential else "vertical incident speed [m/s]"


def curve_columns(fit: Fit) -> tuple[CurveColumn, ...]:
    """A column for each curve of the fit, with the outputs that were measured or follow from such."""
    if fit.predictive is not None:
        found = fit.predictive.curves
    else:
        found = curves(fit.problem, np.array([[fit.point.values[name] for name in fit.problem.free_names]]))
    names = list(measured_outputs(fit))
    place = impacts_along(fit)
    return tuple(_column(fit, item, names, place) for item in found)


def _column(fit: Fit, item: Curve, names: list[str], place: FloatArray) -> CurveColumn:
    kept = slice(None) if fit.predictive is not None else slice(0, 1)
    near = place[item.rows]
    return CurveColumn(
        title=_title(item, fit.problem.model.needs_cor),
        along=item.along if item.speed is None else np.degrees(item.along),
        bands={name: item.outputs[name][kept] * output_scale(name).factor for name in names},
        rows=item.rows,
        within=(float(near.min()), float(near.max())),
    )


def _title(item: Curve, needs_cor: bool) -> str:
    if item.speed is None:
        return item.label
    words = f"{item.speed:g} m/s, {item.spin:+g} rad/s".replace("+0 ", "0 ").replace("-0 ", "0 ")
    cor = item.impacts.cor
    given = f", COR {cor[0]:.2f}" if needs_cor and cor is not None else ""
    return f"{item.label}: {words}{given}" if item.label else f"{words}{given}"


# Letters of a title that a panel has room for.
MOST_IN_TITLE = 30
# Inches: the panels in all, so that the figure has room beside a table; a row of them at least and at most.
CURVES_WIDE, CURVES_HIGH, LOWEST_ROW, HIGHEST_ROW = 6.5, 4.5, 0.9, 1.7
# Bars on more points than this would hide the curve.
MOST_ERRORS = 60
# Impacts near a curve that are drawn one by one, bins that stand for more, impacts of a bin at least; and how many of
# the others are then drawn.
BINNED, BINS, LEAST_IN_BIN, MOST_FAR = 200, 24, 5, 300


def curves_figure(fit: Fit) -> Figure:
    """A column for each speed and spin, a row for each output."""
    columns = curve_columns(fit)
    points = measured_outputs(fit)
    high = min(max(CURVES_HIGH / len(points), LOWEST_ROW), HIGHEST_ROW)
    margins = Margins(top=0.55, bottom=0.9)
    figure, axes = panels(len(points), len(columns), (CURVES_WIDE / len(columns), high), margins)
    place, groups = impacts_along(fit), np.array(group_of(fit))
    for k, column in enumerate(columns):
        for axis, (name, item) in zip(axes[:, k], points.items(), strict=True):
            _draw_model(axis, column, column.bands[name])
            _draw_measured(axis, column, item, place, groups)
        label, colon, where = column.title.rpartition(": ")
        axes[0, k].set_title(verbatim(short(label, MOST_IN_TITLE - len(where)) + colon + where))
        axes[-1, k].set_xlabel(along_label(fit))
    for row, name in zip(axes, points, strict=True):
        row[0].set_ylabel(output_label(name))
        _same_height(row, points[name], [column.bands[name] for column in columns])
    inner(axes)
    _curve_legend(figure, fit, groups, columns)
    over = "incidence at stated speed and spin" if fit.problem.table.has_tangential else "speed"
    fit_heading(figure, fit, f"rebound over {over}")
    return figure


def _draw_model(axis: Axes, column: CurveColumn, bands: FloatArray) -> None:
    inside = (column.along >= column.within[0]) & (column.along <= column.within[1])
    if len(bands) > 1:
        for lower, upper, alpha in ((bands[0], bands[4], 0.2), (bands[1], bands[3], 0.3)):
            axis.fill_between(column.along, lower, upper, color=MODEL, alpha=alpha, linewidth=0)
    middle = bands[len(bands) // 2]
    axis.plot(column.along, middle, color=MODEL, linewidth=1.0, linestyle=":")
    axis.plot(column.along[inside], middle[inside], color=MODEL, linewidth=1.4)
    axis.set_xlim(*_widened(column.along[[0, -1]], 0.03))


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
        where, crowded = place[item.rows[mine]], strong.size > MOST_ERRORS
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


def _widened(ends: FloatArray, share: float) -> tuple[float, float]:
    low, high = float(np.min(ends)), float(np.max(ends))
    return low - share * (high - low), high + share * (high - low)


def _same_height(row: NDArray[Any], item: Measured, bands: list[FloatArray]) -> None:
    """One vertical range for all speeds and spins."""
    seen = [item.values - item.sd, item.values + item.sd, *(band.ravel() for band in bands)]
    known = np.concatenate([part[np.isfinite(part)] for part in seen])
    for axis in row:
        axis.set_ylim(*_widened(known, 0.06))
    row[0].locator_params(axis="y", nbins=5)


def _curve_legend(figure: Figure, fit: Fit, groups: NDArray[np.str_], columns: Sequence[CurveColumn]) -> None:
    along = fit.problem.table.has_tangential
    model = "model (dotted: extrapolated)" if along else "model"
    handles: dict[str, Any] = {model: Line2D([], [], color=MODEL, linewidth=1.4)}
    if fit.predictive is not None:
        handles["its 68 and 95 % bands"] = Patch(color=MODEL, alpha=0.3, linewidth=0)
    shown = {groups[row] for column in columns for row in column.rows}
    styles, measured = group_styles(tuple(groups)), "measured ± sd"
    if any(column.rows.size > BINNED for column in columns):
        styles, measured = group_styles([""]), "measured, mean ± sd in bins"
    seen = [item for item in styles.items() if item[0] in shown or not item[0]]
    for name, (colour, marker) in seen[:MOST_NAMED]:
        mark = Line2D([], [], color=colour, marker=marker, markersize=4.5, linewidth=1.0)
        handles[f"{measured}: {name}" if name else measured] = mark
    if any(column.rows.size < groups.size for column in columns):
        handles["other impacts"] = Line2D([], [], color=FAINT, marker=".", linestyle="none", markersize=6)
    legend_below(figure, handles, 3)


def curves_words(fit: Fit) -> str:
    """The figure in words and numbers."""
    along = "incidence angle" if fit.problem.table.has_tangential else "vertical speed"
    parts = []
    for column in curve_columns(fit):
        ends = [
            f"{name} from {band[len(band) // 2, 0]:.3g} to {band[len(band) // 2, -1]:.3g} {output_scale(name).unit}"
            for name, band in column.bands.items()
        ]
        where = f"at {column.title}" if column.title else "over all"
        parts.append(f"{where}, near {column.rows.size} impact{'s' * (column.rows.size != 1)}, {', '.join(ends)}")
    return f"Predicted rebounds along {along}: " + "; ".join(parts) + "."


FORCE_DRAWS = 200
RECORDS = 6
# Points of the model's curve between two means.
FINE = 4
WITHIN = 1.959963984540054


@dataclass(frozen=True)
class ForcePanel:
    """One record: `times` [ms after the start of contact] and `means` [N] with their noise `sd`; the model's force
    `course` (3, points: 2.5, 50, 97.5 %) at `along`, and `expected` (2, means), 95 % of what a record would show.
    """

    title: str
    times: FloatArray
    means: FloatArray
    sd: FloatArray
    along: FloatArray
    course: FloatArray
    expected: FloatArray


def force_panels(fit: Fit) -> tuple[ForcePanel, ...]:
    """Some records from the slowest impact to the fastest, over draws of the posterior or at the point estimate."""
    problem = fit.problem
    records = problem.force
    assert records is not None
    values = np.array([[fit.point.values[name] for name in problem.free_names]])
    if fit.posterior is not None:
        values = thinned(fit.posterior, FORCE_DRAWS)
    columns = problem.all_values(values)
    alignments = aligned(problem, records, columns)
    start = alignments.start + alignments.move
    middle = np.median(start, axis=0)
    first = records.first - start
    force, _rate = mean_forces(problem, columns, records.rows, first, records.spacing, records.nodes)
    count = FINE * (records.nodes - 1) + 1
    fine, _rate = mean_forces(problem, columns, records.rows, first, records.spacing / FINE, count)
    sensor = float(np.median(columns[SD])) * np.sqrt(records.variances[0])
    slow = float(np.median(columns[MISFIT])) * records.peak[:, None] * np.sqrt(records.variances[1])
    reach = WITHIN * np.sqrt(np.var(force, axis=0) + sensor**2 + slow**2)
    order = np.argsort(problem.impacts.v_y1[records.rows], kind="stable")
    chosen = order[np.linspace(0, order.size - 1, min(RECORDS, order.size)).round().astype(int)]
    panels = []
    for k in chosen:
        mine = records.mask[k]
        times = 1e3 * (records.first[k] + records.spacing[k] * np.arange(records.nodes) - middle[k])
        row = int(records.rows[k])
        centre = np.median(force[:, k], axis=0)
        panels.append(
            ForcePanel(
                title=f"{problem.table.ids[row]}: {problem.impacts.v_y1[row]:.3g} m/s",
                times=times[mine],
                means=records.means[k][mine],
                sd=sensor[k][mine],
                along=np.linspace(times[0], times[mine][-1], FINE * (int(mine.sum()) - 1) + 1),
                course=np.quantile(fine[:, k, : FINE * (int(mine.sum()) - 1) + 1], (0.025, 0.5, 0.975), axis=0),
                expected=np.stack([centre - reach[k], centre + reach[k]])[:, mine],
            )
        )
    return tuple(panels)


def force_figure(fit: Fit) -> Figure:
    """Measured means with the sensor's noise, the model's force, and the 95 % interval of a record."""
    shown = force_panels(fit)
    figure, axes = filled(len(shown), 3, (2.9, 2.1), Margins(across=0.6, down=0.75, top=0.75, bottom=1.15))
    for axis, panel in zip(axes.ravel(), shown, strict=False):
        axis.fill_between(
            panel.times, *panel.expected, color=NOISE, alpha=0.45, linewidth=0, label="95 % of a record, with noise"
        )
        axis.fill_between(panel.along, panel.course[0], panel.course[2], color=MODEL, alpha=0.4, linewidth=0)
        axis.plot(panel.along, panel.course[1], color=MODEL, linewidth=1.2, label="model's force, 95 % band")
        axis.errorbar(
            panel.times, panel.means, panel.sd, fmt="o", color=MEASURED, markersize=2.5, linewidth=0.8,
            label="measured (means of samples)",
        )  # fmt: skip
        axis.set_title(verbatim(panel.title))
        axis.set_xlabel("time after landing [ms]")
        axis.grid()
    for axis in axes[:, 0]:
        axis.set_ylabel("force on the court [N]")
    legend_below(figure, drawn_handles(axes[0, 0]), min(3, len(shown)))
    fit_heading(figure, fit, "force records", narrow=len(shown) == 1)
    return figure


def force_words(fit: Fit) -> str:
    """The figure in words and numbers."""
    parts = []
    for panel in force_panels(fit):
        inside = np.sum((panel.means >= panel.expected[0]) & (panel.means <= panel.expected[1]))
        parts.append(
            f"{panel.title}: measured up to {panel.means.max():.0f} N, "
            f"the model up to {panel.course[1].max():.0f} N, "
            f"{inside} of {panel.means.size} means within the 95 % interval of a record"
        )
    return "Force records and the model's force. " + "; ".join(parts) + "."


# Inches: the figure, one bar, what surrounds them in all, below them, and left of them besides their labels.
BARS_WIDTH, BAR_HEIGHT, BARS_ROUND, BARS_BELOW, BARS_LEFT = 8.5, 0.27, 1.6, 1.05, 0.5
# Bars that one picture has room for at least, and can show at most.
FEWEST = 6
MOST_BARS = 40
# Sequences with less than this at every impact are shown as one.
RARE = 0.02
OTHERS = "others"
# Sequences that most tables show, in the order of their colours.
USUAL = ("slide", "slide-grip-slide back", "slide-grip-slide", "grip", "slide-grip")


@dataclass(frozen=True)
class RegimeBars:
    """Impacts by group and rising angle: their `labels`, the `regimes`, and `shares` (impacts, regimes)."""

    labels: tuple[str, ...]
    regimes: tuple[str, ...]
    shares: FloatArray


def regime_bars(fit: Fit, predictive: Predictive) -> RegimeBars:
    """The bars of the figure; of many impacts MOST_BARS, evenly spread."""
    impacts = fit.problem.impacts
    angle = np.degrees(impacts.angle)
    groups = group_of(fit)
    along = angle if fit.problem.table.has_tangential else impacts.v_y1
    place = {group: k for k, group in enumerate(dict.fromkeys(groups))}
    order = sorted(range(len(impacts)), key=lambda k: (place[groups[k]], float(along[k])))
    if len(order) > MOST_BARS:
        order = [order[k] for k in np.linspace(0, len(order) - 1, MOST_BARS).round().astype(int)]
    peaks: dict[str, float] = {}
    for k in order:
        for name, share in predictive.regimes[k].items():
            peaks[name] = max(peaks.get(name, 0.0), share)
    named = [name for name in sorted(peaks, key=lambda name: (-peaks[name], name)) if peaks[name] >= RARE]
    # Beyond the colours there are, the rest shares one.
    named = named[: len(REGIMES) - 1] if len(named) > len(REGIMES) - 1 else named
    columns = [[predictive.regimes[k].get(name, 0.0) for k in order] for name in named]
    shares = np.array(columns).T.reshape(len(order), len(named))
    rest = 1.0 - shares.sum(axis=1)
    if np.any(rest > 1e-9):
        named, shares = [*named, OTHERS], np.column_stack([shares, np.maximum(rest, 0.0)])
    labels = tuple(
        "  ".join(filter(None, (fit.problem.table.ids[k], short(groups[k]), f"{impacts.v_y1[k]:.1f} m/s")))
        + (f", {angle[k]:.0f}°" if fit.problem.table.has_tangential else "")
        for k in order
    )
    return RegimeBars(labels, tuple(named), shares)


def regime_colours(regimes: Sequence[str]) -> list[str]:
    """A colour for each sequence; the usual ones keep theirs from figure to figure."""
    spare = [colour for k, colour in enumerate(REGIMES) if k >= len(USUAL) or USUAL[k] not in regimes]
    colours = []
    for name in regimes:
        if name == OTHERS:
            colours.append(FAINT)
        else:
            colours.append(REGIMES[USUAL.index(name)] if name in USUAL else spare.pop(0))
    return colours


def regimes_figure(fit: Fit) -> Figure:
    """One bar per impact, one colour per phase sequence."""
    assert fit.predictive is not None
    data = regime_bars(fit, fit.predictive)
    high = BARS_ROUND + BAR_HEIGHT * max(FEWEST, len(data.labels))
    figure = new_figure(BARS_WIDTH, high, layout=None)
    axis = figure.add_axes((0.0, BARS_BELOW / high, 1.0, 1.0 - BARS_ROUND / high))
    places = np.arange(len(data.labels))
    left = np.zeros(len(data.labels))
    colours = regime_colours(data.regimes)
    for k, name in enumerate(data.regimes):
        axis.barh(places, data.shares[:, k], left=left, color=colours[k], height=0.8, label=name)
        left = left + data.shares[:, k]
    axis.set_yticks(places, [*map(verbatim, data.labels)], fontsize=8)
    axis.set_ylim(len(data.labels) - 0.4, -0.6)
    axis.set_xlim(0.0, 1.0)
    axis.set_xlabel("posterior probability of the phase sequence")
    group = f", {fit.problem.grouped_by}" if fit.problem.grouped_by else ""
    speed = "normal speed, incidence" if fit.problem.table.has_tangential else "speed"
    axis.set_ylabel(verbatim(f"impact{group}, {speed}"))
    # Identifiers are the user's: as wide as they are.
    widest = max(float(label.get_window_extent().width) for label in axis.get_yticklabels()) / figure.dpi
    room = min(widest + BARS_LEFT, 0.6 * BARS_WIDTH)
    axis.set_position(
        (room / BARS_WIDTH, BARS_BELOW / high, 1.0 - (room + 0.2) / BARS_WIDTH, 1.0 - BARS_ROUND / high)
    )
    legend_below(figure, drawn_handles(axis), 3)
    fit_heading(figure, fit, "regimes")
    return figure


# A sequence less probable than this may be another one.
SURE = 0.95


def regimes_words(fit: Fit) -> str:
    """The figure in words and numbers."""
    if fit.predictive is None:
        return ""
    first = [next(iter(shares.items())) for shares in fit.predictive.regimes]
    counts = Counter(name for name, _share in first).most_common()
    doubtful = sum(share < SURE for _name, share in first)
    parts = ", ".join(f"{name} at {count}" for name, count in counts)
    sure = "all certain" if doubtful == 0 else f"{doubtful} with a probability below {100.0 * SURE:.0f} %"
    return f"Most probable sequence of slip and grip of {len(first)} impacts: {parts}; {sure}."
