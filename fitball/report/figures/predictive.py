"""The figure of measured against predicted: every measurement beside the 1:1 line, with its intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

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
    legend_below,
    shown_rows,
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
from fitball.report.form.palette import GUIDE, MODEL, NOISE
from fitball.values import FloatArray

SHARE = 0.95
# Bins of a band that stands for more intervals than can be told apart.
BINS = 24


@dataclass(frozen=True)
class Agreement:
    """One output at the impacts `rows` where it was measured, in the unit in which people read it.

    `predicted` is the posterior median without noise, or the point estimate; 95 % intervals (2, rows) of the model,
    which is what its parameters leave open (None for a point fit), and of a new `measurement`, which noise widens.
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
    """Every measured column that the fit answers for."""
    return tuple(_agreement(fit, item) for item in fit.problem.observables)


def _agreement(fit: Fit, observable: Observable) -> Agreement:
    factor = output_scale(observable.name).factor

    def part(*arrays: FloatArray) -> FloatArray:
        return factor * measured_part(observable, np.stack(arrays))

    told, measured, model = prediction_of(fit, observable), part(observable.observed)[0], None
    predicted = part(prediction(fit, observable))[0]
    if told is not None:
        model, ends = part(told.mean_q025, told.mean_q975), part(told.data_q025, told.data_q975)
    else:
        away = fit.problem.noise.reach(SHARE, fit.point.values) * noise_sd(fit, observable)
        centre = measured_part(observable, prediction(fit, observable)) + bias(fit, observable)
        ends = factor * np.stack([centre - away, centre + away])
    return Agreement(observable.name, measured_rows(observable), measured, predicted, model, ends)


def interval_band(item: Agreement, interval: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places (bins,) and ends (2, bins) of the interval about the 1:1 line: medians over bins of equal count."""
    order = np.argsort(item.predicted, kind="stable")
    parts = [part for part in np.array_split(order, BINS) if part.size]
    places = np.array([np.median(item.predicted[part]) for part in parts])
    ends = np.stack([[np.median(side[part] - item.predicted[part]) for part in parts] for side in interval])
    return places, places + ends


COLUMNS = 3
CELL = (2.85, 2.85)
# Impacts beyond which intervals become a band, and points small.
MOST_INTERVALS = 150


def figure(fit: Fit) -> Figure:
    """A panel for each output."""
    items = agreements(fit)
    columns, narrow = min(COLUMNS, len(items)), len(items) == 1
    groups = group_of(fit)
    styles = group_styles(groups)
    handles = {f"measured: {name}" if name else "measured": mark for name, mark in group_handles(styles).items()}
    if fit.predictive is not None:
        handles["95 %: the model, by its parameters"] = _bar(MODEL)
    handles["95 %: a new measurement, with noise"] = _bar(NOISE)
    # Labels of the axis and the lines of the legend.
    below = 0.62 + 0.19 * -(-len(handles) // min(columns, len(handles)))
    margins = Margins(across=0.8, down=0.85, top=0.85 if narrow else 0.65, bottom=below)
    figure, axes = filled(len(items), COLUMNS, CELL, margins)
    for axis, item in zip(axes.ravel(), items, strict=False):
        _draw(axis, item, groups, styles)
    legend_below(figure, handles, columns)
    shown = f" ({MOST_POINTS:,} of {len(groups):,} impacts)" if len(groups) > MOST_POINTS else ""
    fit_heading(figure, fit, f"measured against predicted{shown}", narrow)
    return figure


def _bar(colour: str) -> Line2D:
    return Line2D([], [], color=colour, linewidth=4, solid_capstyle="butt")


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
    axis.set_title(OBSERVABLES[item.name].title)
    axis.set_xlabel(f"predicted {output_label(item.name)}")
    axis.set_ylabel(f"measured {output_label(item.name)}")
    axis.grid()


def missing(_fit: Fit) -> str:
    """Every fit has this figure."""
    return ""


def words(fit: Fit) -> str:
    """The figure in words and numbers, for who does not see it."""
    parts = [
        f"{item.name}: {np.count_nonzero(item.inside)} of {item.inside.size} measurements within the 95 % range of a "
        f"new one, root mean square difference {item.rms:.2g} {output_scale(item.name).unit}"
        for item in agreements(fit)
    ]
    what = "posterior median" if fit.predictive is not None else "point estimate"
    return f"Measured rebounds against the {what}. " + "; ".join(parts) + "."
