"""Figure of a comparison."""

from __future__ import annotations

import numpy as np

from fitball.base.columns import COLUMNS
from fitball.base.values import DataFrame, Figure
from fitball.report.frame_rows import frame_rows
from fitball.report.quantities import column_unit, figure_text, scored_columns
from fitball.report.style import GUIDE_COLOUR, MODEL_COLOUR, PALE, axis_label, few_ticks, new_figure

# Measured columns of which errors are drawn: more panels would be too narrow.
_MOST_COLUMNS = 3
# Letters of a model beside the panels.
_MODEL_LETTERS = 34


def draw_scores(models: DataFrame) -> Figure:
    """Draw a comparison, a row a model, best above: the score less that of the best, and errors of
    left-out impacts.
    """
    rows = frame_rows(models)
    columns = scored_columns(models)
    across = 1 + min(len(columns), _MOST_COLUMNS)
    high = 0.9 + 0.36 * len(rows)
    figure, panels = new_figure(1, across, high=high, wide=8.0, sharey=True)
    first = panels[0, 0]
    heights = np.arange(len(rows))
    colours = [PALE if row.flag("worse") else MODEL_COLOUR for row in rows]
    first.axvline(0.0, color=GUIDE_COLOUR, linewidth=0.8)
    for height, row, colour in zip(heights, rows, colours, strict=True):
        first.errorbar(
            row.number("difference"),
            height,
            xerr=row.number("error"),
            fmt="o",
            color=colour,
            markersize=5,
        )
    first.set_title("score")
    for axes, name in zip(panels[0, 1:], columns, strict=False):
        unit = column_unit(name)
        errors = unit.factor * models[f"rms_{name}"]
        axes.scatter(errors, heights, c=colours, s=25, zorder=3)
        axes.set_title(f"rms {axis_label(COLUMNS[name].symbol, unit)}")
        axes.set_xlim(0.0, 1.1 * float(errors.max()))
    for axes in panels[0]:
        few_ticks(axes.xaxis)
    names = [figure_text(row.text("model"), _MODEL_LETTERS).replace("+", "\n+", 1) for row in rows]
    first.set_yticks(heights, names)
    first.set_ylim(len(rows) - 0.5, -0.5)
    return figure
