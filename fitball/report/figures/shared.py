"""What figures have in common: how series look, dots of few impacts and bins of many."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.lines import Line2D

from fitball.base.values import BoolArray, DataFrame, Figure, FloatArray
from fitball.report.frame_rows import frame_rows
from fitball.report.quantities import figure_text
from fitball.report.style import (
    MEASURED_COLOUR,
    MODEL_COLOUR,
    SERIES_COLOURS,
    SERIES_MARKERS,
    legend_above,
)

# Impacts of a panel that are drawn one by one; more would be a cloud.
MOST_DOTS = 600
# Bins of equal numbers of more impacts, of which medians are drawn.
BINS = 24
# Quantiles of a bin: the median, and the ends of the middle 68 %.
_QUANTILES = (0.16, 0.5, 0.84)


class SeriesStyle(NamedTuple):
    """How a series is drawn: alone it needs no colour of its own."""

    dots: str
    marker: str
    line: str
    name: str


def series_styles(curves: DataFrame) -> dict[int, SeriesStyle]:
    """Looks by series; the speed is named where speeds differ."""
    rows = frame_rows(curves.groupby("series").first())
    if len(rows) == 1:
        return {
            int(rows[0].count("series")): SeriesStyle(
                MEASURED_COLOUR, "o", MODEL_COLOUR, "measured and model"
            )
        }
    by_series = {}
    several = curves["speed"].nunique() > 1
    for k, row in enumerate(rows):
        words = [figure_text(row.text("name"))]
        if np.isfinite(row.number("spin")):
            # A zero without a sign.
            words.append(f"{row.number('spin') + 0.0:+.3g} rad/s".replace("+0 ", "0 "))
        if several:
            words.append(f"{row.number('speed'):.3g} m/s")
        name = ", ".join(filter(None, words))
        colour = SERIES_COLOURS[k % len(SERIES_COLOURS)]
        marker = SERIES_MARKERS[k % len(SERIES_MARKERS)]
        by_series[row.count("series")] = SeriesStyle(colour, marker, colour, name)
    return by_series


def split_by_series(
    frame: DataFrame, styles: Mapping[int, SeriesStyle]
) -> list[tuple[SeriesStyle, BoolArray]]:
    """Looks of a panel, and which rows (rows,) have each; more than DOTS rows have one look."""
    if len(frame) > MOST_DOTS:
        return [
            (
                SeriesStyle(MEASURED_COLOUR, "o", MODEL_COLOUR, ""),
                np.ones(len(frame), dtype=np.bool_),
            )
        ]
    return [(look, (frame["series"] == k).to_numpy(np.bool_)) for k, look in styles.items()]


def opacity(count: int) -> float:
    """Opacity of each of so many dots in a panel: many may cover each other."""
    shade = (150.0 / max(count, 1)) ** 0.7
    return float(min(1.0, max(0.12, shade)))


def bin_medians(place: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Medians of `place` (bins,), and quantiles 16, 50, 84 % of `values` (3, bins), in BINS bins of
    equal numbers along `place`; both arguments are (rows,).
    """
    bins = np.array_split(np.argsort(place, kind="stable"), BINS)
    middles = np.array([np.median(place[rows]) for rows in bins])
    bands = np.stack([np.quantile(values[rows], _QUANTILES) for rows in bins], axis=1)
    return middles, bands


def draw_dots(
    axis: Any,
    place: FloatArray,
    values: FloatArray,
    look: SeriesStyle,
    sd: FloatArray | None = None,
) -> None:
    """Draw dots (rows,) with bars of one `sd`, or of more than DOTS the medians of bins with the
    middle 68 % of their values; NaN are not drawn.
    """
    finite = np.isfinite(place) & np.isfinite(values)
    place = place[finite]
    values = values[finite]
    shade = opacity(len(place))
    size = 5.0
    ends = None
    if sd is not None:
        ends = (values - sd[finite], values + sd[finite])
    if len(place) > MOST_DOTS:
        place, (low, values, high) = bin_medians(place, values)
        shade = 1.0
        size = 3.5
        ends = (low, high)
    if ends is not None:
        axis.vlines(place, *ends, color=look.dots, linewidth=1.0, alpha=0.55 * shade)
    axis.plot(
        place,
        values,
        look.marker,
        color=look.dots,
        markersize=size,
        markeredgewidth=0.6,
        markeredgecolor="white",
        alpha=shade,
        zorder=3,
    )


def series_legend(
    figure: Figure,
    shown: Sequence[tuple[SeriesStyle, BoolArray]],
    more: Sequence[Any] = (),
) -> None:
    """Draw a legend with the dots of the series, where there are several, and handles of what else
    is drawn.
    """
    handles = list[Any]()
    if len(shown) > 1:
        for look, _ in shown:
            handles.append(
                Line2D([], [], color=look.dots, marker=look.marker, linestyle="", label=look.name)
            )
    handles += more
    if handles:
        legend_above(figure, handles)


def hide_unused(axes: Any, count: int, across: str = "") -> None:
    """Hide the panels after the first `count`; the label `across` is below the lowest of each
    column.
    """
    flat = axes.ravel()
    wide = axes.shape[1]
    for axis in flat[count:]:
        axis.set_visible(False)
    if not across:
        return
    for axis in flat[max(count - wide, 0) : count]:
        axis.set_xlabel(across)
        axis.xaxis.set_tick_params(labelbottom=True)
