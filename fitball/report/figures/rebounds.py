"""Figure of predicted rebounds."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from fitball.base.columns import COLUMNS
from fitball.base.selection import evenly_spread
from fitball.base.values import DataFrame, Figure, FloatArray
from fitball.report.quantities import (
    INCIDENT_UNITS,
    MOST_REBOUNDS,
    column_unit,
    figure_text,
    impact_rows,
    median_or_point,
)
from fitball.report.style import MEASURED_COLOUR, MODEL_COLOUR, axis_label, few_ticks, new_figure

# Impacts whose names have room at the axis.
_MOST_NAMES = 16
# Letters of a name at the axis.
_NAME_LETTERS = 18
# Letters of names that have room side by side.
_LETTERS_ABREAST = 2
# Impacts up to which lines are thick: those of more would touch.
_MOST_THICK = 60
# A quantity varies if its range exceeds this share of its size, which is more than rounding.
_VARIES = 1e-9


def draw_rebounds(frame: DataFrame) -> Figure:
    """Draw predicted rebounds, a panel a column, over the incident quantity that alone varies, else
    over the impacts in their order.
    """
    impacts = impact_rows(frame)
    columns = list(dict.fromkeys(frame["column"]))
    shown = evenly_spread(len(impacts), MOST_REBOUNDS)
    across = min(2, len(columns))
    down = -(-len(columns) // across)
    has_names = len(impacts) <= _MOST_NAMES
    x, x_label = _horizontal_axis(impacts)
    high = 0.8 + 1.9 * down + 0.4 * has_names
    figure, panels = new_figure(down, across, high=high, sharex=True)
    flat = panels.ravel()
    for axes, name in zip(flat, columns, strict=False):
        of_column = frame[frame["column"] == name].iloc[shown]
        _draw_column(axes, of_column, x[shown])
        axes.set_title(axis_label(COLUMNS[name].symbol, column_unit(name)))
        few_ticks(axes.yaxis)
    for axes in flat[len(columns) :]:
        axes.set_visible(False)
    lowest = max(len(columns) - across, 0)
    for axes in flat[lowest : len(columns)]:
        axes.xaxis.set_tick_params(labelbottom=True)
        axes.set_xlabel(x_label)
        if has_names and not x_label:
            names = [""]
            if len(impacts) > 1:
                names = [figure_text(str(name), _NAME_LETTERS) for name in impacts["id"]]
            rotation = 90 if max(map(len, names)) > _LETTERS_ABREAST else 0
            axes.set_xticks(x, names, rotation=rotation)
    return figure


def _horizontal_axis(impacts: DataFrame) -> tuple[FloatArray, str]:
    """Where impacts are along the horizontal axis (impacts,), and its label. Without a quantity
    that alone varies they are in their order; then the label is empty if their names are there.
    """
    states = {name: impacts[name].to_numpy(np.float64) for name in INCIDENT_UNITS}
    varying = []
    for name, values in states.items():
        if np.ptp(values) > _VARIES * np.abs(values).max():
            varying.append(name)
    if len(varying) == 1:
        name = varying[0]
        unit = INCIDENT_UNITS[name]
        if len(np.unique(states[name])) == len(impacts):
            return unit.factor * states[name], axis_label(COLUMNS[name].symbol, unit)
    return np.arange(1.0, len(impacts) + 1.0), "" if len(impacts) <= _MOST_NAMES else "impact"


def _draw_column(axes: Axes, of_column: DataFrame, x: FloatArray) -> None:
    """Draw the rebounds of one column: 95 and 68 % intervals, medians, measurements."""
    factor = column_unit(of_column["column"].iloc[0]).factor
    # Of the rebound itself where the error of a new measurement is not known.
    low = of_column["new_q025"].fillna(of_column["q025"]).to_numpy(np.float64)
    high = of_column["new_q975"].fillna(of_column["q975"]).to_numpy(np.float64)
    # Widths of the bars of 95 and 68 %, sizes of the dash of a median and of a measured dot.
    thin, thick, dash, dot = (0.6, 2.0, 4, 2)
    if len(of_column) <= _MOST_THICK:
        thin, thick, dash, dot = (1.2, 5.0, 8, 4)
    axes.vlines(x, factor * low, factor * high, color=MODEL_COLOUR, linewidth=thin)
    axes.vlines(
        x,
        factor * of_column["q16"],
        factor * of_column["q84"],
        color=MODEL_COLOUR,
        linewidth=thick,
        alpha=0.4,
    )
    medians = factor * median_or_point(of_column)
    axes.plot(x, medians, "_", color=MODEL_COLOUR, markersize=dash)
    observed = factor * of_column["observed"]
    axes.plot(x, observed, "o", color=MEASURED_COLOUR, markersize=dot)
