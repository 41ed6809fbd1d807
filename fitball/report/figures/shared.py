"""What figures have in common: how series look, dots of few impacts and bins of many."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from fitball.base.columns import MIRRORED_DEVIATIONS, STATE
from fitball.base.values import BoolArray, DataFrame, Figure, FloatArray, Impacts
from fitball.report.frame_rows import frame_rows
from fitball.report.quantities import figure_text
from fitball.report.style import (
    MEASURED_COLOUR,
    MODEL_COLOUR,
    SERIES_COLOURS,
    SERIES_MARKERS,
    Panels,
    canvas,
    legend_above,
)

# Impacts of a panel that are drawn one by one; more would be a cloud.
MOST_DOTS = 600
# Bins of equal numbers of more impacts, of which medians are drawn.
BINS = 24
# Quantiles of a bin: the median, and the ends of the middle 68 %.
_QUANTILES = (0.16, 0.5, 0.84)
# Size of a dot [pt], and of the median of a bin.
_DOT_SIZE = 5.0
_BIN_SIZE = 3.5


class SeriesStyle(NamedTuple):
    """How a series is drawn: the colour of its `dots`, their `marker`, the colour of its `line`,
    and its `name` in the legend.
    """

    dots: str
    marker: str
    line: str
    name: str


def series_styles(curves: DataFrame) -> dict[int, SeriesStyle]:
    """Styles of the series of a fit's curves, by number of the series. A series that is alone needs
    no colour of its own; the speed is named where speeds differ.
    """
    rows = frame_rows(curves.groupby("series").first())
    if len(rows) == 1:
        style = SeriesStyle(MEASURED_COLOUR, "o", MODEL_COLOUR, "measured and model")
        return {rows[0].count("series"): style}
    by_series = {}
    speeds_differ = curves["speed"].nunique() > 1
    # Where lines are of surfaces alone, the label of the axis has the spin.
    spins_differ = curves["spin"].nunique() > 1 or curves["name"].nunique() < len(rows)
    for k, row in enumerate(rows):
        words = [figure_text(row.text("name"))]
        speed, spin = row.numbers("speed", "spin")
        if np.isfinite(spin) and spins_differ:
            # A zero without a sign.
            words.append(f"{spin + 0.0:+.3g} rad/s".replace("+0 ", "0 "))
        if speeds_differ:
            words.append(f"{speed:.3g} m/s")
        name = ", ".join(filter(None, words))
        colour = SERIES_COLOURS[k % len(SERIES_COLOURS)]
        marker = SERIES_MARKERS[k % len(SERIES_MARKERS)]
        by_series[row.count("series")] = SeriesStyle(colour, marker, colour, name)
    return by_series


def to_one_side(frame: DataFrame) -> DataFrame:
    """Rows of the frame `predictions` as if all balls flew towards positive v_x: incident state,
    `observed`, `point`, `median` and `z`.
    """
    states = Impacts(*(frame[name].to_numpy(np.float64) for name in STATE))
    side = states.side
    angle = frame["theta_1"].to_numpy(np.float64)
    turned = {**vars(states.forwards), "theta_1": np.where(side < 0.0, np.pi - angle, angle)}
    is_angle = (frame["column"] == "theta_2").to_numpy(np.bool_)
    turns = (side < 0.0) & frame["column"].isin(MIRRORED_DEVIATIONS).to_numpy(np.bool_)
    for name in ("observed", "point", "median", "z"):
        values = frame[name].to_numpy(np.float64)
        opposite = np.pi * (is_angle & (name != "z")) - values
        turned[name] = np.where(turns, opposite, values)
    return frame.assign(**turned)


def split_by_series(
    frame: DataFrame, styles: Mapping[int, SeriesStyle]
) -> list[tuple[SeriesStyle, BoolArray]]:
    """The styles of a panel, each with which rows of the frame have it; more than MOST_DOTS rows
    have one style.
    """
    if len(frame) > MOST_DOTS:
        style = SeriesStyle(MEASURED_COLOUR, "o", MODEL_COLOUR, "")
        return [(style, np.ones(len(frame), dtype=np.bool_))]
    return [(style, (frame["series"] == k).to_numpy(np.bool_)) for k, style in styles.items()]


def opacity(count: int) -> float:
    """Opacity of each of so many dots in a panel: many may cover each other."""
    shade = (150.0 / max(count, 1)) ** 0.7
    return float(min(1.0, max(0.12, shade)))


def bin_medians(
    x: Annotated[FloatArray, "rows"], y: Annotated[FloatArray, "rows"]
) -> tuple[Annotated[FloatArray, "bins"], Annotated[FloatArray, "3 bins"]]:
    """Medians of `x` in BINS bins of equal numbers along it, and quantiles 16, 50 and 84 % of `y`
    in each bin.
    """
    bins = np.array_split(np.argsort(x, kind="stable"), BINS)
    middles = np.array([np.median(x[rows]) for rows in bins])
    bands = np.stack([np.quantile(y[rows], _QUANTILES) for rows in bins], axis=1)
    return middles, bands


def draw_dots(
    axes: Axes,
    x: Annotated[FloatArray, "rows"],
    y: Annotated[FloatArray, "rows"],
    style: SeriesStyle,
    sd: Annotated[FloatArray, "rows"] | None = None,
) -> None:
    """Draw a dot at each `x` and `y` with a bar of one `sd`. Of more than MOST_DOTS rows medians of
    bins are drawn, with the middle 68 % of their values; NaN are not drawn.
    """
    finite = np.isfinite(x) & np.isfinite(y)
    x = x[finite]
    y = y[finite]
    shade = opacity(len(x))
    size = _DOT_SIZE
    ends = None
    if sd is not None:
        ends = (y - sd[finite], y + sd[finite])
    if len(x) > MOST_DOTS:
        x, (low, y, high) = bin_medians(x, y)
        shade = 1.0
        size = _BIN_SIZE
        ends = (low, high)
    if ends is not None:
        axes.vlines(x, *ends, color=style.dots, linewidth=1.0, alpha=0.55 * shade)
    axes.plot(
        x,
        y,
        style.marker,
        color=style.dots,
        markersize=size * canvas().letters,
        markeredgewidth=0.6,
        markeredgecolor="white",
        alpha=shade,
        zorder=3,
    )


def series_legend(
    figure: Figure,
    styles: Sequence[SeriesStyle],
    others: Sequence[Artist] = (),
) -> None:
    """Draw a legend with the dots of the series, where there are several, and handles of what
    `others` are drawn.
    """
    handles = list[Artist]()
    if len(styles) > 1:
        for style in styles:
            handles.append(
                Line2D(
                    [], [], color=style.dots, marker=style.marker, linestyle="", label=style.name
                )
            )
    handles += others
    if handles:
        legend_above(figure, handles)


def hide_unused(panels: Panels, count: int, label: str = "") -> None:
    """Hide the panels after the first `count`. The `label` of the horizontal axis is below the
    lowest panel of each column.
    """
    flat = panels.ravel()
    columns = panels.shape[1]
    for axes in flat[count:]:
        axes.set_visible(False)
    if not label:
        return
    for axes in flat[max(count - columns, 0) : count]:
        axes.set_xlabel(label)
        axes.xaxis.set_tick_params(labelbottom=True)
