"""The figure of predictions over incidence: at one speed and spin in each column, with the impacts near it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from fitball.inference.prediction.posterior_predictive import curves
from fitball.inference.results.results import Curve, Fit
from fitball.report.figures.canvas import (
    MOST_NAMED,
    Margins,
    fit_heading,
    group_styles,
    inner,
    legend_below,
    panels,
    shown_rows,
    verbatim,
)
from fitball.report.figures.quantities import Measured, group_of, measured_outputs, output_label
from fitball.report.form.numbers import output_scale
from fitball.report.form.palette import FAINT, MEASURED, MODEL
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
    """Where impacts stand on the axis of the curves (impacts,)."""
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


CELL = (3.1, 1.65)
# Letters of a title that a panel has room for.
MOST_IN_TITLE = 36
# Bars on more points than this would hide the curve.
MOST_BARS = 60
# Impacts near a curve that are drawn one by one, bins that stand for more, impacts of a bin at least; and how many of
# the others are then drawn.
BINNED, BINS, LEAST_IN_BIN, MOST_FAR = 200, 24, 5, 300


def figure(fit: Fit) -> Figure:
    """A column for each speed and spin, a row for each output."""
    columns = curve_columns(fit)
    points = measured_outputs(fit)
    narrow = len(columns) == 1
    size, margins = (5.0, 1.9) if narrow else CELL, Margins(top=0.7, bottom=1.6 if narrow else 1.15)
    figure, axes = panels(len(points), len(columns), size, margins)
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
    _legend(figure, fit, groups, columns)
    over = "incidence at stated speed and spin" if fit.problem.table.has_tangential else "speed"
    fit_heading(figure, fit, f"rebound over {over}", narrow)
    return figure


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


def _legend(figure: Figure, fit: Fit, groups: NDArray[np.str_], columns: Sequence[CurveColumn]) -> None:
    along = fit.problem.table.has_tangential
    model = "model (dotted: beyond the impacts near)" if along else "model"
    handles: dict[str, Any] = {model: Line2D([], [], color=MODEL, linewidth=1.4)}
    if fit.predictive is not None:
        handles["its 68 and 95 % bands, without noise"] = Patch(color=MODEL, alpha=0.3, linewidth=0)
    shown = {groups[row] for column in columns for row in column.rows}
    styles, measured = group_styles(tuple(groups)), "measured, with noise"
    if any(column.rows.size > BINNED for column in columns):
        styles, measured = group_styles([""]), "measured near it, mean and sd in bins"
    seen = [item for item in styles.items() if item[0] in shown or not item[0]]
    for name, (colour, marker) in seen[:MOST_NAMED]:
        mark = Line2D([], [], color=colour, marker=marker, markersize=4.5, linewidth=1.0)
        handles[f"{measured}: {name}" if name else measured] = mark
    if any(column.rows.size < groups.size for column in columns):
        handles["other impacts"] = Line2D([], [], color=FAINT, marker=".", linestyle="none", markersize=6)
    legend_below(figure, handles, 1 if figure.get_figwidth() < 6.5 else 3)


def missing(_fit: Fit) -> str:
    """Every fit has this figure."""
    return ""


def words(fit: Fit) -> str:
    """The figure in words and numbers, for who does not see it."""
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
