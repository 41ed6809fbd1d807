"""An empty figure with panels in a grid, and what all figures draw alike: groups, log axes, legends."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, NullFormatter, NullLocator, StrMethodFormatter
from numpy.typing import NDArray

from fitball.inference.results.results import Fit
from fitball.report.figures.shown import ShownFigure
from fitball.report.form.palette import MEASURED, series_style

# Impacts that a figure draws one by one: more are a blot, and cost more memory than the fit.
MOST_POINTS = 4000
# Digits of a decade that may stand at a log axis, from few to many.
DIGITS = (
    (1.0,), (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 5.0, 7.0), tuple(0.5 * k for k in range(2, 20)),
    tuple(0.1 * k for k in range(10, 100)), tuple(0.02 * k for k in range(50, 500)),
)  # fmt: skip
LEAST_TICKS, MOST_TICKS, MOST_UNNAMED = 3, 5, 40
# Groups named in a legend.
MOST_NAMED = 12
# Colour and marker of each group.
Styles: TypeAlias = Mapping[str, tuple[str, str]]


def new_figure(width: float, height: float, layout: Literal["constrained"] | None = "constrained") -> Figure:
    """An empty figure on the raster canvas, without any global state."""
    figure = ShownFigure(figsize=(width, height), layout=layout)
    FigureCanvasAgg(figure)
    return figure


@dataclass(frozen=True)
class Margins:
    """Inches left of, right of, above and below a grid of panels, and between its columns and rows."""

    left: float = 0.75
    right: float = 0.15
    top: float = 0.55
    bottom: float = 0.95
    across: float = 0.15
    down: float = 0.15


def panels(
    rows: int, columns: int, cell: tuple[float, float], margins: Margins, widths: Sequence[float] = ()
) -> tuple[Figure, NDArray[Any]]:
    """A figure with axes (rows, columns), each `cell` inches wide and high; `widths` are shares of the columns.

    Places are set once: letting a layout engine search for them takes longer than all drawing.
    """
    width = cell[0] * columns + margins.across * (columns - 1)
    height = cell[1] * rows + margins.down * (rows - 1)
    whole = (width + margins.left + margins.right, height + margins.top + margins.bottom)
    figure = new_figure(*whole, layout=None)
    axes = figure.subplots(
        rows, columns, squeeze=False, width_ratios=list(widths) or None,
        gridspec_kw={
            "left": margins.left / whole[0], "right": 1.0 - margins.right / whole[0],
            "bottom": margins.bottom / whole[1], "top": 1.0 - margins.top / whole[1],
            "wspace": margins.across / cell[0], "hspace": margins.down / cell[1],
        },
    )  # fmt: skip
    return figure, axes


def inner(axes: NDArray[Any], grid: bool = True) -> None:
    """Ticks at the left and lower edge of a grid of panels alone, whose rows and columns show the same ranges; lines
    of a `grid` in all of them. To be called when the ranges are set: most of a drawing's time goes into ticks.
    """
    for row in axes:
        row[0].yaxis.set_major_locator(FixedLocator(_within_view(row[0].yaxis)))
    for column in axes.T:
        column[-1].xaxis.set_major_locator(FixedLocator(_within_view(column[-1].xaxis)))
    for (j, k), axis in np.ndenumerate(axes):
        if grid:
            _grid(axis, axes[-1, k].xaxis.get_majorticklocs(), axes[j, 0].yaxis.get_majorticklocs())
        if k:
            axis.yaxis.set_major_locator(NullLocator())
        if axis is not axes[-1, k]:
            axis.xaxis.set_major_locator(NullLocator())


def _within_view(side: Axis) -> list[float]:
    low, high = sorted(side.get_view_interval())
    return [float(tick) for tick in side.get_majorticklocs() if low <= tick <= high]


def _grid(axis: Axes, across: NDArray[Any], up: NDArray[Any]) -> None:
    for places, transform, upright in (
        (across, axis.get_xaxis_transform(), True),
        (up, axis.get_yaxis_transform(), False),
    ):
        ends = [[(place, 0.0), (place, 1.0)] if upright else [(0.0, place), (1.0, place)] for place in places]
        lines = LineCollection(ends, colors="#b0b0b0", linewidths=0.8, alpha=0.3, transform=transform, zorder=0.5)
        axis.add_collection(lines, autolim=False)


def filled(count: int, most: int, cell: tuple[float, float], margins: Margins) -> tuple[Figure, NDArray[Any]]:
    """As `panels`, for `count` of them, at most `most` side by side; places left over stay empty."""
    columns = min(most, count)
    figure, axes = panels(-(-count // columns), columns, cell, margins)
    for spare in axes.ravel()[count:]:
        spare.set_visible(False)
    return figure, axes


def other_scale(axis: Axes, side: Literal["top", "right"], factor: float, label: str) -> Any:
    """A scale on the other `side` that shows `factor` times what the axis does."""
    make: Any = axis.secondary_xaxis if side == "top" else axis.secondary_yaxis

    def there(value: Any) -> Any:
        return value * factor

    def back(value: Any) -> Any:
        return value / factor

    scale = make(side, functions=(there, back))
    (scale.set_xlabel if side == "top" else scale.set_ylabel)(label)
    return scale


def verbatim(text: str) -> str:
    """A text of the user's, such as a label or the name of a table: a dollar sign in it begins no formula."""
    return text.replace("$", r"\$")


def heading(figure: Figure, text: str) -> None:
    """A title a little below the upper edge."""
    figure.suptitle(verbatim(text), y=1.0 - 0.08 / figure.get_figheight(), va="top", fontsize=12)


def fit_heading(figure: Figure, fit: Fit, words: str, narrow: bool = False) -> None:
    """What was fitted to what, and what is shown of it; over two lines where the figure is `narrow`."""
    heading(figure, f"{fit.problem.model.name} on {fit.problem.table.name}:{chr(10) if narrow else ' '}{words}")


def legend_below(figure: Figure, handles: Mapping[str, Any], columns: int) -> None:
    """A legend at the lower edge: what stands for each label, in as many columns, `columns` at most, as there is room
    for. Where it would reach into a grid of panels the figure grows downwards.
    """
    for count in range(max(1, min(columns, len(handles))), 0, -1):
        legend = figure.legend(
            handles.values(), map(verbatim, handles), loc="lower center", frameon=False, fontsize=9, ncols=count
        )
        box = legend.get_window_extent()
        if box.width <= figure.bbox.width or count == 1:
            break
        legend.remove()
    lowest = [
        part.y0
        for axis in figure.axes
        if axis.get_position().y0 > 0.0 and (part := axis.xaxis.get_tightbbox()) is not None
    ]
    _grow_downwards(figure, (box.y1 - min(lowest, default=box.y1)) / figure.dpi)
    legend.set_bbox_to_anchor((0.5, 0.03 / figure.get_figheight()), figure.transFigure)


def _grow_downwards(figure: Figure, inches: float) -> None:
    """More room below the panels, which keep their sizes; none for a number that is not positive."""
    if inches <= 0.0:
        return
    before = figure.get_figheight()
    height = before + inches + 0.05
    figure.set_figheight(height)
    for axis in figure.axes:
        x, y, width, high = axis.get_position().bounds
        above = (1.0 - y - high) * before
        axis.set_position((x, 1.0 - (above + high * before) / height, width, high * before / height))


def drawn_handles(*axes: Axes) -> dict[str, Any]:
    """What was drawn with a label, by label."""
    return {label: handle for axis in axes for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)}


def shown_rows(rows: NDArray[np.int64], most: int | None = None) -> NDArray[np.int64]:
    """Of `rows` those that a figure draws, `MOST_POINTS` or as `most` fewer, evenly spread; all of them if it can."""
    count = min(len(rows), MOST_POINTS, len(rows) if most is None else most)
    return np.asarray(rows[np.unique(np.linspace(0, len(rows) - 1, count).round().astype(np.int64))])


def group_styles(groups: Sequence[str]) -> Styles:
    """Colour and marker of each group; impacts without groups are all `MEASURED` dots."""
    names = sorted(set(groups))
    return {"": (MEASURED, "o")} if names == [""] else {name: series_style(k) for k, name in enumerate(names)}


def group_handles(styles: Styles) -> dict[str, Line2D]:
    """What a legend shows of the first `MOST_NAMED` groups, by name, and how many it leaves out."""
    handles = {
        name: Line2D([], [], color=colour, marker=marker, linestyle="none", markersize=5)
        for name, (colour, marker) in [*styles.items()][:MOST_NAMED]
    }
    left_out = len(styles) - len(handles)
    return handles | ({f"{left_out} others": Line2D([], [], linestyle="none")} if left_out else {})


def log_ticks(low: float, high: float) -> tuple[list[float], list[float]]:
    """Round numbers between two positive ones, three to five, and finer ones between which nothing is written."""
    found = [_within(low, high, digits) for digits in DIGITS]
    k = next((k for k, ticks in enumerate(found) if len(ticks) >= LEAST_TICKS), len(found) - 1)
    named = found[k]
    while len(named) > MOST_TICKS:
        named = named[::2]
    finer = found[max(k, 1) + 1 :]
    unnamed = next((ticks for ticks in finer if len(ticks) > 2 * len(named)), found[-1])
    return named, _apart(unnamed, named, (high / low) ** (1.0 / MOST_UNNAMED))


def _apart(ticks: Sequence[float], named: Sequence[float], ratio: float) -> list[float]:
    """Those of `ticks` that keep a distance from each other and from those `named`."""
    kept: list[float] = []
    for tick in ticks:
        if all(max(tick / other, other / tick) >= ratio for other in (*kept[-1:], *named)):
            kept.append(tick)
    return kept


def _within(low: float, high: float, digits: Sequence[float]) -> list[float]:
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    return [
        float(f"{digit * 10.0**decade:.6g}")
        for decade in decades
        for digit in digits
        if low <= digit * 10.0**decade <= high
    ]


def log_scale(axis: Axes, low: float, high: float, which: Literal["x", "y"] = "x") -> None:
    """Make an axis from `low` to `high` logarithmic and let it look so: unevenly spaced ticks, few of them named."""
    named, unnamed = log_ticks(low, high)
    if which == "x":
        axis.set_xscale("log")
    else:
        axis.set_yscale("log")
    side = axis.xaxis if which == "x" else axis.yaxis
    side.set_major_locator(FixedLocator(named))
    side.set_minor_locator(FixedLocator(unnamed))
    side.set_major_formatter(StrMethodFormatter("{x:g}"))
    side.set_minor_formatter(NullFormatter())
    (axis.set_xlim if which == "x" else axis.set_ylim)(low, high)
