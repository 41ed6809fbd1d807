"""Figure of predicted rebounds."""

from __future__ import annotations

from typing import Any

import numpy as np

from fitball.base.columns import COLUMNS
from fitball.base.selection import evenly_spread
from fitball.base.values import DataFrame, Figure, FloatArray
from fitball.report.quantities import (
    INCIDENT_UNITS,
    MOST_REBOUNDS,
    column_unit,
    figure_text,
    first_rows,
    median_or_point,
)
from fitball.report.style import MEASURED_COLOUR, MODEL_COLOUR, axis_label, few_ticks, new_figure

# Impacts whose names stand at the axis.
_NAMED = 16
# Letters of a name at the axis.
_NAME = 18
# Letters of names that stand side by side.
_FLAT = 2
# Impacts up to which lines are thick.
_FEW = 60


def draw_rebounds(frame: DataFrame) -> Figure:
    """A panel a column, over the incident quantity that alone varies, else over the impacts in
    their order.
    """
    first = first_rows(frame)
    columns = list(dict.fromkeys(frame["column"]))
    shown = evenly_spread(len(first), MOST_REBOUNDS)
    wide = min(2, len(columns))
    down = -(-len(columns) // wide)
    named = len(first) <= _NAMED
    place, across = _along(first)
    high = 0.8 + 1.9 * down + 0.4 * named
    figure, axes = new_figure(down, wide, high=high, sharex=True)
    panels = axes.ravel()
    for axis, name in zip(panels, columns, strict=False):
        mine = frame[frame["column"] == name].iloc[shown]
        _draw(axis, mine, place[shown])
        axis.set_title(axis_label(COLUMNS[name].symbol, column_unit(name)))
        few_ticks(axis.yaxis)
    for axis in panels[len(columns) :]:
        axis.set_visible(False)
    lowest = max(len(columns) - wide, 0)
    for axis in panels[lowest : len(columns)]:
        axis.xaxis.set_tick_params(labelbottom=True)
        axis.set_xlabel(across)
        if named and not across:
            names = [""]
            if len(first) > 1:
                names = [figure_text(str(name), _NAME) for name in first["id"]]
            rotation = 90 if max(map(len, names)) > _FLAT else 0
            axis.set_xticks(place, names, rotation=rotation)
    return figure


def _along(first: DataFrame) -> tuple[FloatArray, str]:
    """Where impacts stand (impacts,), and what that is; "" for their order."""
    states = {name: first[name].to_numpy(np.float64) for name in INCIDENT_UNITS}
    varying = [
        name for name, values in states.items() if np.ptp(values) > 1e-9 * np.abs(values).max()
    ]
    if len(varying) == 1 and len(np.unique(states[varying[0]])) == len(first):
        unit = INCIDENT_UNITS[varying[0]]
        return unit.factor * states[varying[0]], axis_label(COLUMNS[varying[0]].symbol, unit)
    return np.arange(1.0, len(first) + 1.0), "" if len(first) <= _NAMED else "impact"


def _draw(axis: Any, mine: DataFrame, place: FloatArray) -> None:
    """The rebounds of one column: 95 and 68 % intervals, medians, measurements."""
    factor = column_unit(mine["column"].iloc[0]).factor
    few = len(mine) <= _FEW
    # Of the rebound itself where the error of a new measurement is not known.
    low = mine["new_q025"].fillna(mine["q025"]).to_numpy(np.float64)
    high = mine["new_q975"].fillna(mine["q975"]).to_numpy(np.float64)
    thin, thick, dash, dot = (1.2, 5.0, 8, 4) if few else (0.6, 2.0, 4, 2)
    axis.vlines(place, factor * low, factor * high, color=MODEL_COLOUR, linewidth=thin)
    axis.vlines(
        place,
        factor * mine["q16"],
        factor * mine["q84"],
        color=MODEL_COLOUR,
        linewidth=thick,
        alpha=0.4,
    )
    axis.plot(place, factor * median_or_point(mine), "_", color=MODEL_COLOUR, markersize=dash)
    axis.plot(place, factor * mine["observed"], "o", color=MEASURED_COLOUR, markersize=dot)
