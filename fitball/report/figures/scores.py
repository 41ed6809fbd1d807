"""Figure of a comparison."""

from __future__ import annotations

import numpy as np

from fitball.base.columns import COLUMNS
from fitball.base.values import DataFrame, Figure
from fitball.report.frame_rows import frame_rows
from fitball.report.quantities import column_unit, figure_text, scored_columns
from fitball.report.style import GUIDE_COLOUR, MODEL_COLOUR, PALE, axis_label, few_ticks, new_figure


def draw_scores(models: DataFrame) -> Figure:
    """A row a model, best above: the score less that of the best, and errors of left-out
    impacts.
    """
    rows = frame_rows(models)
    columns = scored_columns(models)
    panels = 1 + min(len(columns), 3)
    high = 0.9 + 0.36 * len(rows)
    figure, axes = new_figure(1, panels, high=high, wide=8.0, sharey=True)
    first = axes[0, 0]
    places = np.arange(len(rows))
    colours = [PALE if row.flag("worse") else MODEL_COLOUR for row in rows]
    first.axvline(0.0, color=GUIDE_COLOUR, linewidth=0.8)
    for place, row, colour in zip(places, rows, colours, strict=True):
        first.errorbar(
            row.number("difference"),
            place,
            xerr=row.number("error"),
            fmt="o",
            color=colour,
            markersize=5,
        )
    first.set_title("score")
    for axis, name in zip(axes[0, 1:], columns, strict=False):
        unit = column_unit(name)
        errors = unit.factor * models[f"rms_{name}"]
        axis.scatter(errors, places, c=colours, s=25, zorder=3)
        axis.set_title(f"rms {axis_label(COLUMNS[name].symbol, unit)}")
        axis.set_xlim(0.0, 1.1 * float(errors.max()))
    for axis in axes[0]:
        few_ticks(axis.xaxis)
    names = [figure_text(row.text("model"), 34).replace("+", "\n+", 1) for row in rows]
    first.set_yticks(places, names)
    first.set_ylim(len(rows) - 0.5, -0.5)
    return figure
