"""An empty figure with panels in a grid, what all figures share (groups, log axes, legends), and its file."""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, Literal, TypeAlias

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure as Figure
from matplotlib.lines import Line2D
from matplotlib.markers import TICKDOWN, TICKLEFT
from matplotlib.ticker import FixedLocator, MaxNLocator, NullLocator, StrMethodFormatter
from numpy.typing import NDArray
from PIL import Image

from fitball.inference.results.results import Fit
from fitball.report.form.document import DPI
from fitball.report.form.files import write_bytes
from fitball.report.form.palette import MEASURED, series_style

# Impacts that a figure draws one by one: more are a blot, and cost more memory than the fit.
MOST_POINTS = 4000
# Digits of a decade that may stand at a log axis, from few to many.
DIGITS = (
    (1.0,), (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 5.0, 7.0), tuple(0.5 * k for k in range(2, 20)),
    tuple(0.1 * k for k in range(10, 100)), tuple(0.02 * k for k in range(50, 500)),
)  # fmt: skip
LEAST_TICKS, MOST_TICKS, MOST_UNNAMED = 3, 5, 40
# What ticks without a number are known by.
UNNAMED = "unnamed ticks"
# Groups named in a legend.
MOST_NAMED = 12
# Colour and marker of each group.
Styles: TypeAlias = Mapping[str, tuple[str, str]]


def new_figure(width: float, height: float, layout: Literal["constrained"] | None = "constrained") -> Figure:
    """An empty figure on the raster canvas, without any global state."""
    # At the dots that files have: words that are measured for the layout are not measured again for the file.
    figure = ShownFigure(figsize=(width, height), dpi=DPI, layout=layout)
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
    figure.suptitle(verbatim(text), y=1.0 - 0.08 / figure.get_figheight(), va="top")


def fit_heading(figure: Figure, fit: Fit, words: str, narrow: bool = False) -> None:
    """What was fitted to what, and what is shown of it; over two lines where the figure is `narrow`."""
    heading(figure, f"{fit.problem.model.name} on {fit.problem.table.name}:{chr(10) if narrow else ' '}{words}")


def legend_below(figure: Figure, handles: Mapping[str, Any], columns: int) -> None:
    """A legend at the lower edge: what stands for each label, in as many columns, `columns` at most, as there is room
    for. Where it would reach into a grid of panels the figure grows downwards.
    """
    for count in range(max(1, min(columns, len(handles))), 0, -1):
        legend = figure.legend(handles.values(), map(verbatim, handles), loc="lower center", ncols=count)
        box = legend.get_window_extent()
        if box.width <= figure.bbox.width or count == 1:
            break
        legend.remove()
    # Panels of the lowest row; the one of a sheet fills the whole figure.
    above = [axis for axis in figure.axes if axis.get_position().y0 > 0.0]
    edge = min((axis.get_position().y0 for axis in above), default=0.0)
    lowest = [
        part.y0
        for axis in above
        if axis.get_position().y0 <= edge + 1e-6 and (part := axis.xaxis.get_tightbbox()) is not None
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
    if len(named) < 2:
        # Over a range of some percent a logarithmic axis is all but even.
        named = [tick for tick in MaxNLocator(MOST_TICKS - 1).tick_values(low, high) if low <= tick <= high]
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
    """Make an axis from `low` to `high` logarithmic and let it look so: unevenly spaced ticks, few of them named; the
    others are one artist, since a tick of matplotlib's is five.
    """
    named, unnamed = log_ticks(low, high)
    along, edge = np.array(unnamed), np.zeros(len(unnamed))
    side: Axis
    if which == "x":
        axis.set_xscale("log")
        side, places, marker, within = axis.xaxis, (along, edge), TICKDOWN, axis.get_xaxis_transform()
    else:
        axis.set_yscale("log")
        side, places, marker, within = axis.yaxis, (edge, along), TICKLEFT, axis.get_yaxis_transform()
    side.set_major_locator(FixedLocator(named))
    side.set_minor_locator(NullLocator())
    side.set_major_formatter(StrMethodFormatter("{x:g}"))
    # The box of a line without points is a corner of the figure: the layout would make room down to there.
    if unnamed:
        axis.plot(
            *places, linestyle="none", marker=marker, markersize=2.0, markeredgewidth=0.6, color="black",
            clip_on=False, transform=within, gid=UNNAMED,
        )  # fmt: skip
    (axis.set_xlim if which == "x" else axis.set_ylim)(low, high)


# How all figures look; names in SVG files are the same for equal figures. Where titles stand is set: to search for it
# would lay out all ticks once more.
STYLE: dict[Any, Any] = {
    "figure.titlesize": 12, "axes.titlesize": 10, "axes.titley": 1.0, "xtick.labelsize": 8, "ytick.labelsize": 8,
    "grid.alpha": 0.3, "legend.fontsize": 9, "legend.frameon": False, "svg.hashsalt": "fitball",
}  # fmt: skip
# Settings that are the user's: what shows windows (nothing here does), and where ffmpeg lies.
_KEPT = ("backend", "interactive", "animation.ffmpeg_path", "animation.ffmpeg_args")


@contextmanager
def own_style() -> Iterator[None]:
    """In here, or in a function decorated so, matplotlib's own defaults hold with our `STYLE`; afterwards what held
    before.
    """
    defaults: dict[Any, Any] = {name: value for name, value in mpl.rcParamsDefault.items() if name not in _KEPT}
    with mpl.rc_context({**defaults, **STYLE}):
        yield


# Dots an inch on a screen.
SCREEN_DPI = 100


class ShownFigure(Figure):
    """A matplotlib Figure with the picture that notebooks ask objects for."""

    @own_style()
    def _repr_png_(self) -> bytes:
        """The figure as PNG."""
        out = BytesIO()
        self.savefig(out, format="png", dpi=SCREEN_DPI)
        return out.getvalue()


# What would make equal figures unequal files: stamps of time and version.
STAMPS: Mapping[str, dict[str, Any]] = {
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
# As many as a drawing with smoothed edges needs: a third of the bytes that all colours take, and less time.
PNG_COLOURS = 128


def save_figure(figure: Figure, place: Path, form: str = "png", dpi: int = DPI) -> bytes:
    """Write a figure as png, svg or pdf, and return what was written. Raises ResultFolderError."""
    content = rendered(figure, form, dpi)
    write_bytes(place, content)
    return content


@own_style()
def rendered(figure: Figure, form: str, dpi: int) -> bytes:
    """A figure as the content of a png, svg or pdf file."""
    with warnings.catch_warnings():
        # A letter of a user's name that no font here has is seen as a box; the name stands in tables and alt texts.
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        if form == "png":
            return _png(figure, dpi)
        made = io.BytesIO()
        figure.savefig(made, format=form, dpi=dpi, metadata=STAMPS[form])
    return made.getvalue()


def _png(figure: Figure, dpi: int) -> bytes:
    canvas: Any = FigureCanvasAgg(figure)
    before = figure.dpi
    figure.set_dpi(dpi)
    try:
        canvas.draw()
        picture = few_colours(np.asarray(canvas.buffer_rgba()))
    finally:
        figure.set_dpi(before)
    made = io.BytesIO()
    picture.save(made, "png", dpi=(dpi, dpi))
    return made.getvalue()


def few_colours(pixels: NDArray[np.uint8]) -> Image.Image:
    """A picture (height, width, 4) on opaque paper in its `PNG_COLOURS` most frequent colours, six bits of each
    channel kept, and of colours that differ in the last of these one: areas keep theirs, smoothed edges the nearest.
    """
    packed = pixels.view("<u4")[..., 0]
    code = ((packed >> 2) & 0x3F) | ((packed >> 4) & 0xFC0) | ((packed >> 6) & 0x3F000)
    counts = np.bincount(code.ravel(), minlength=1 << 18)
    seen = np.flatnonzero(counts)
    seen = seen[np.argsort(-counts[seen], kind="stable")]
    six = np.stack([seen & 0x3F, (seen >> 6) & 0x3F, seen >> 12], axis=1)
    _, first = np.unique((six >> 1) @ (1, 1 << 5, 1 << 10), return_index=True)
    colours = (six << 2) | (six >> 4)
    palette = colours[np.sort(first)[:PNG_COLOURS]]
    # Squares of distances, less what is the same for the whole palette.
    nearest = np.argmin((palette**2).sum(axis=1) - 2 * colours @ palette.T, axis=1)
    places = np.zeros(1 << 18, dtype=np.uint8)
    places[seen] = nearest
    picture = Image.fromarray(places[code])
    picture.putpalette(palette.astype(np.uint8).tobytes())
    return picture
