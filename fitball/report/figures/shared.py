"""What figures have in common: how series look, dots of few impacts and bins of many."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.lines import Line2D

from fitball.base.values import BoolArray, DataFrame, Figure, FloatArray
from fitball.report.quantities import plain, records
from fitball.report.style import MARKERS, MEASURED, MODEL, SERIES, legend_above

# Impacts of a panel that are drawn one by one; of more, the medians of so many bins of equal
# numbers.
DOTS = 600
BINS = 24


class Look(NamedTuple):
    """How a series is drawn: alone it needs no colour of its own."""

    dots: str
    marker: str
    line: str
    name: str


def looks(curves: DataFrame) -> dict[int, Look]:
    """By series; the speed is named where speeds differ."""
    first = records(curves.groupby("series").first())
    if len(first) == 1:
        return {int(first[0]["series"]): Look(MEASURED, "o", MODEL, "measured and model")}
    found = {}
    several = curves["speed"].nunique() > 1
    for k, row in enumerate(first):
        spin = (
            f"{row['spin'] + 0.0:+.3g} rad/s".replace("+0 ", "0 ")
            if np.isfinite(row["spin"])
            else ""
        )
        speed = f"{row['speed']:.3g} m/s" if several else ""
        words = ", ".join(filter(None, (plain(row["name"]), spin, speed)))
        colour = SERIES[k % len(SERIES)]
        found[int(row["series"])] = Look(colour, MARKERS[k % len(MARKERS)], colour, words)
    return found


def split(frame: DataFrame, styles: Mapping[int, Look]) -> list[tuple[Look, BoolArray]]:
    """Looks of a panel, and of which rows each is; many rows have one look."""
    if len(frame) > DOTS:
        return [(Look(MEASURED, "o", MODEL, ""), np.ones(len(frame), dtype=np.bool_))]
    return [(look, (frame["series"] == k).to_numpy(np.bool_)) for k, look in styles.items()]


def opacity(count: int) -> float:
    """Of so many dots in a panel."""
    return float(min(1.0, max(0.12, (150.0 / max(count, 1)) ** 0.7)))


def binned(place: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Medians of `place` (bins,), and quantiles 16, 50, 84 % of `values` (3, bins), of bins of
    equal numbers.
    """
    parts = np.array_split(np.argsort(place, kind="stable"), BINS)
    bands = np.stack([np.quantile(values[part], (0.16, 0.5, 0.84)) for part in parts], axis=1)
    return np.array([np.median(place[part]) for part in parts]), bands


def scattered(
    axis: Any,
    place: FloatArray,
    values: FloatArray,
    look: Look,
    sd: FloatArray | None = None,
) -> None:
    """Dots with bars of one `sd`, or medians of bins with the middle 68 % of their values; NaN are
    left out.
    """
    known = np.isfinite(place) & np.isfinite(values)
    place = place[known]
    values = values[known]
    shade = opacity(len(place))
    size = 5.0
    ends = None if sd is None else (values - sd[known], values + sd[known])
    if len(place) > DOTS:
        place, (low, values, high) = binned(place, values)
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
    shown: Sequence[tuple[Look, BoolArray]],
    more: Sequence[Any] = (),
) -> None:
    """Dots of the series, where there are several, and what else is drawn."""
    handles = [
        Line2D([], [], color=look.dots, marker=look.marker, linestyle="", label=look.name)
        for look, _ in shown
        if len(shown) > 1
    ]
    if handles or more:
        legend_above(figure, [*handles, *more])


def hide(axes: Any, count: int, across: str = "") -> None:
    """Hide the panels after the first `count`; what is `across` stands below the lowest of each
    column.
    """
    flat = axes.ravel()
    wide = axes.shape[1]
    for axis in flat[count:]:
        axis.set_visible(False)
    for axis in flat[max(count - wide, 0) : count] if across else ():
        axis.set_xlabel(across)
        axis.xaxis.set_tick_params(labelbottom=True)
