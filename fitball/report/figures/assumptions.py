"""How results depend on model assumptions: a forest plot, a panel for each quantity that moves, a row for each model
variant that fits equally well, and for each constant of the ball.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from fitball.inference.results.assumptions import MOVED, PACE, Assumptions, Summary, reach
from fitball.inference.results.results import Fit
from fitball.report.figures.canvas import Margins, filled, fit_heading, legend_below, log_scale, verbatim
from fitball.report.figures.quantities import ParameterAxis, axis_label, parameter_axis
from fitball.report.form.numbers import handy, significant
from fitball.report.form.palette import GUIDE, MEASURED, MODEL, TREND, pale
from fitball.wording import short

# Quantities with a panel at most, and at least; those that shift by less than this many sds have one only to fill up.
MOST, LEAST, MOVES = 8, 4, 1.0
COLUMNS = 4


@dataclass(frozen=True)
class Row:
    """One model variant, or constant of the ball: `median` (None for a constant) and ends of the interval, in the
    unit of the panel; NaN where it has none. `moved` where median or an end outwards does by more than `MOVED`.
    """

    median: float | None
    low: float
    high: float
    moved: bool = False


@dataclass(frozen=True)
class ForestPanel:
    """One quantity with a row for this fit, for each variant and for each constant, in the order of `row_names`."""

    name: str
    axis: ParameterAxis
    shift: float
    rows: tuple[Row, ...]


def row_names(found: Assumptions) -> list[str]:
    """The fit itself, the variants that fit equally well, the constants of the ball."""
    constants = [
        f"{item.name} {significant(item.low * scale.factor)} to {significant(item.high * scale.factor)} {scale.unit}"
        for item in found.constants
        for scale in [handy(item.name, "")]
    ]
    return ["this fit", *(item.name for item in found.as_good), *(name.rstrip() for name in constants)]


def forest_panels(fit: Fit) -> tuple[ForestPanel, ...]:
    """The quantities that move most, in the order of the fit."""
    found = fit.assumptions
    assert found is not None
    scatter = {item.name for item in fit.scatter}
    own = {name: item for name, item in found.parameters.items() if name not in scatter}
    spans = {**own, **{pace_name(surface): item for surface, item in found.court_pace.items()}}
    order = sorted(spans, key=lambda name: -spans[name].shift)
    moving = sum(spans[name].shift > MOVES for name in order)
    kept = set(order[: min(max(moving, LEAST), MOST)])
    return tuple(_panel(fit, found, name, spans[name].own, spans[name].shift) for name in spans if name in kept)


def pace_name(surface: str) -> str:
    """How a panel names the court pace rating of a surface."""
    return f"{PACE} of {surface}" if surface else PACE


def _panel(fit: Fit, found: Assumptions, name: str, own: Summary, shift: float) -> ForestPanel:
    spec = next((item.spec for item in fit.problem.parameters if item.name == name), None)
    if spec is not None:
        axis = parameter_axis(spec)
    else:
        scale = handy(name, fit.derived[name].unit if name in fit.derived else "")
        axis = ParameterAxis(axis_label(verbatim(short(name, 22)), scale.unit), scale.factor, False)

    def row(values: Summary | None) -> Row:
        if values is None:
            return Row(None, np.nan, np.nan)
        ends = axis.factor * values.q025, axis.factor * values.q975
        return Row(axis.factor * values.median, *ends, moved=reach(own, values) > MOVED)

    rows = [row(own)]
    for item in found.as_good:
        known = {**item.parameters, **{pace_name(surface): pace for surface, pace in item.court_pace.items()}}
        rows.append(row(known.get(name)))
    for constant in found.constants:
        known_ends = {**constant.parameters, **{pace_name(one): pace for one, pace in constant.court_pace.items()}}
        low, high = sorted(known_ends.get(name, (np.nan, np.nan)))
        moved = name in constant.parameters
        rows.append(Row(None, axis.factor * low, axis.factor * high, moved))
    return ForestPanel(name, axis, shift, tuple(rows))


# Inches: a row, and a panel besides its rows; letters of the names of rows.
HIGH, ROUND, LETTERS = 0.19, 0.15, 30


def forest_figure(fit: Fit) -> Figure:
    """A panel for each quantity."""
    data = forest_panels(fit)
    assert fit.assumptions is not None
    names = row_names(fit.assumptions)
    cell = (1.62, ROUND + HIGH * len(names))
    margins = Margins(left=2.1, across=0.15, down=0.62, top=0.5, bottom=0.95)
    figure, axes = filled(len(data), COLUMNS, cell, margins)
    for first, row in zip(range(0, len(data), len(axes[0])), axes, strict=True):
        beside = data[first : first + len(row)]
        # A constant is left out beside panels that do not depend on it.
        kept = [k for k in range(len(names)) if any(np.isfinite(panel.rows[k].low) for panel in beside)]
        for axis, panel in zip(row, beside, strict=False):
            _draw(axis, panel, kept)
            axis.set_ylim(len(kept) - 0.4, -0.6)
            axis.set_yticks([])
        row[0].set_yticks(range(len(kept)), [verbatim(short(names[k], LETTERS)) for k in kept], fontsize=8)
    handles = {
        "this fit, 95 %": Line2D([], [], color=MODEL, marker="o", markersize=4),
        "variant, 95 %": Line2D([], [], color=MEASURED, marker="o", markersize=4),
        f"median or interval end moved by more than {MOVED:g} sd": Line2D(
            [], [], color=TREND, marker="o", markersize=4
        ),
    }
    if fit.assumptions.constants:
        handles["medians over the range of a constant"] = Line2D([], [], color=GUIDE, marker="|", markersize=6)
    legend_below(figure, handles, 4)
    fit_heading(figure, fit, "results under model variants", narrow=len(data) < COLUMNS)
    return figure


def _draw(axis: Axes, panel: ForestPanel, kept: Sequence[int]) -> None:
    own = panel.rows[0]
    axis.axvspan(own.low, own.high, color=pale(MODEL, 0.2), linewidth=0, zorder=0)
    known = [row for row in panel.rows if np.isfinite(row.low)]
    low, high = min(row.low for row in known), max(row.high for row in known)
    for k, row in enumerate(panel.rows[place] for place in kept):
        if row.median is None:
            axis.plot([row.low, row.high], [k, k], "|-", color=GUIDE, markersize=6, linewidth=1.0)
            continue
        colour = MODEL if k == 0 else TREND if row.moved else MEASURED
        axis.plot([row.low, row.high], [k, k], color=colour, linewidth=1.4)
        axis.plot([row.median], [k], "o", color=colour, markersize=4)
    ends = panel.axis.margins(low, high, 0.06)
    if panel.axis.logarithmic:
        log_scale(axis, *ends)
    else:
        axis.set_xlim(*ends)
        axis.locator_params(axis="x", nbins=4)
    axis.set_xlabel(panel.axis.label, fontsize=panel.axis.letters(9), labelpad=2)
    axis.set_title(f"median moved up to {panel.shift:.1f} sd", fontsize=7.5, pad=3)


def forest_words(fit: Fit) -> str:
    """The figure in words and numbers."""
    found = fit.assumptions
    assert found is not None
    parts = []
    for panel in forest_panels(fit):
        medians = [row.median for row in panel.rows if row.median is not None]
        unit = panel.axis.label.rpartition("[")[2].rstrip("]") if panel.axis.label.endswith("]") else ""
        ends = f"{significant(min(medians))} to {significant(max(medians))} {unit}".rstrip()
        parts.append(f"{panel.name} {ends}, moved by up to {panel.shift:.1f} sd")
    count = len(found.as_good)
    fits = f"this fit and {count} model variant{'s' * (count != 1)} that fit equally well"
    return f"Medians under {fits}: {'; '.join(parts)}."
