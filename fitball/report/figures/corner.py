"""The corner plot: posterior draws, the prior on the diagonal, the point estimate marked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from contourpy import FillType, LineType, contour_generator
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.path import Path
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from fitball.inference.results.results import Fit
from fitball.report.figures.canvas import new_figure, own_style, verbatim
from fitball.report.figures.quantities import ParameterAxis, drawn, no_posterior, parameter, parameter_axis
from fitball.report.figures.sheet import Panel, Sheet, Side
from fitball.report.form.numbers import parameter_row
from fitball.report.form.palette import MEASURED, MODEL, PRIOR, pale
from fitball.values import FloatArray

CORNER_DRAWS = 12_000
# Quantile range of the posterior a corner axis spans.
SPAN = (0.002, 0.998)
HISTOGRAM_BINS = 32
# Shares of the draws within the contours: one and two standard deviations of a normal distribution of two dimensions.
LEVELS = (0.393, 0.865)
# A Gaussian of one bin, mirrored at the edges, as a matrix: what scipy.ndimage would do takes longer to import.
_REACH = np.arange(-4, 5)
_WINDOWS = sliding_window_view(np.pad(np.eye(HISTOGRAM_BINS), ((4, 4), (0, 0)), "symmetric"), _REACH.size, axis=0)
SMOOTHING: FloatArray = _WINDOWS @ np.exp(-0.5 * _REACH**2) / np.exp(-0.5 * _REACH**2).sum()


@dataclass(frozen=True)
class CornerData:
    """The point estimate in the units of its `axes`; the `edges` (bins + 1,) of each axis, evenly spaced on it; the
    `bins` of some draws (parameters, draws), HISTOGRAM_BINS where one lies beyond; and the densities (bins,) of
    posterior and prior per length of the axis: per value, or on a logarithmic axis per natural logarithm.
    """

    axes: tuple[ParameterAxis, ...]
    point: FloatArray
    edges: tuple[FloatArray, ...]
    bins: NDArray[np.int64]
    posterior: tuple[FloatArray, ...]
    prior: tuple[FloatArray, ...]

    def middles(self, k: int) -> FloatArray:
        """The middles of the bins of an axis (bins,)."""
        return self.axes[k].middles(self.edges[k])


def corner_data(fit: Fit) -> CornerData:
    """Everything the corner plot shows."""
    axes, every, point = in_units(fit)
    rows = np.linspace(0, every.shape[0] - 1, min(CORNER_DRAWS, every.shape[0])).astype(int)
    draws = every[rows]
    ends = np.quantile(draws, SPAN, axis=0)
    # The point estimate is part of the picture even where it lies at the edge of the draws.
    low, high = np.minimum(ends[0], point), np.maximum(ends[1], point)
    edges = tuple(
        axis.between(*axis.margins(float(low[k]), float(high[k]), 0.03), HISTOGRAM_BINS + 1)
        for k, axis in enumerate(axes)
    )
    along = tuple(zip(axes, edges, strict=True))
    bins = np.stack([_bins(axis, draws[:, k], edges[k]) for k, axis in enumerate(axes)])
    densities = tuple(_density(axis, bins[k], edges[k]) for k, axis in enumerate(axes))
    prior = tuple(_prior_density(fit, name, *on) for name, on in zip(drawn(fit).names, along, strict=True))
    return CornerData(axes, point, edges, bins, densities, prior)


def in_units(fit: Fit) -> tuple[tuple[ParameterAxis, ...], FloatArray, FloatArray]:
    """The axis of each free parameter, all draws (draws, parameters) and the point estimate in their units."""
    posterior = drawn(fit)
    axes = tuple(parameter_axis(parameter(fit, name).spec) for name in posterior.names)
    factors = np.array([axis.factor for axis in axes])
    point = np.array([fit.point.values[name] for name in posterior.names])
    return axes, posterior.draws * factors, point * factors


def _bins(axis: ParameterAxis, draws: FloatArray, edges: FloatArray) -> NDArray[np.int64]:
    """The bin of each draw: the edges are evenly spaced, so that nothing is searched."""
    low, high = axis.lengths(edges[[0, -1]])
    share = (axis.lengths(draws) - low) / (high - low)
    return np.where((share >= 0.0) & (share < 1.0), (share * HISTOGRAM_BINS).astype(np.int64), HISTOGRAM_BINS)


def _density(axis: ParameterAxis, bins: NDArray[np.int64], edges: FloatArray) -> FloatArray:
    counts = np.bincount(bins, minlength=HISTOGRAM_BINS + 1)[:HISTOGRAM_BINS]
    return np.asarray(counts / (bins.size * np.diff(axis.lengths(edges))))


def _prior_density(fit: Fit, name: str, axis: ParameterAxis, edges: FloatArray) -> FloatArray:
    """Mean density of the prior itself between `edges`, (bins,)."""
    prior = parameter(fit, name).prior
    low, high = prior.quantile(np.array([0.0, 1.0])) * axis.factor
    middle = axis.middles(edges)
    inside = (middle > low) & (middle < high)
    safe = np.where(inside, middle, 0.5 * (low + high)) / axis.factor
    density = np.exp(prior.log_density(prior.coordinate(safe)))
    # From the density of ln x to that of x, and from that of x to that of the axis.
    per_value = density / safe if prior.log else density
    per_length = per_value * safe if axis.logarithmic else per_value / axis.factor
    return np.where(inside, per_length, 0.0)


def pair_density(data: CornerData, across: int, up: int) -> tuple[FloatArray, FloatArray]:
    """Smoothed density of two parameters on their axes (bins, bins), rows upwards, and its values at the contours,
    lowest first.
    """
    # One row and column more for the draws beyond, which are left out.
    side = HISTOGRAM_BINS + 1
    counts = np.bincount(data.bins[up] * side + data.bins[across], minlength=side * side).reshape(side, side)
    density = SMOOTHING @ counts[:-1, :-1] @ SMOOTHING.T
    order = np.sort(density.ravel())[::-1]
    shares = np.cumsum(order) / order.sum()
    return density, np.array([order[np.searchsorted(shares, level)] for level in LEVELS[::-1]])


# Inches: a panel, smaller where many would make a sheet too large to look at; between panels; for labels, and where
# they stand in it.
PANEL, WIDEST, LEAST, GAP, LABEL_MARGIN, LABELS = 1.55, 10.8, 0.75, 0.12, 0.95, 0.25
# Between the contours and within the inner one: opaque, which draws faster than what shines through.
SHADES = [pale(MODEL, 0.35), pale(MODEL, 0.7)]


def figure(fit: Fit) -> Figure:
    """All pairs of free parameters."""
    data = corner_data(fit)
    count = len(data.axes)
    size = max(LEAST, min(PANEL, WIDEST / count - GAP))
    whole = max(5.2, LABEL_MARGIN + count * (size + GAP))
    sheet = Sheet(whole, whole)
    across = [_side(data, k, LABEL_MARGIN + k * (size + GAP), size) for k in range(count)]
    up = [_side(data, k, LABEL_MARGIN + (count - 1 - k) * (size + GAP), size) for k in range(count)]
    tallest = [1.06 * max(float(data.posterior[k].max()), float(data.prior[k].max())) for k in range(count)]
    diagonal = [Panel(across[k], Side(0.0, tallest[k], False, up[k].start, size)) for k in range(count)]
    pairs = {(row, column): Panel(across[column], up[row]) for row in range(count) for column in range(row)}
    _draw_diagonal(sheet, data, diagonal)
    _draw_pairs(sheet, data, pairs)
    left, lowest = [pairs[row, 0] for row in range(1, count)], [Panel(side, up[-1]) for side in across]
    sheet.frames([*diagonal, *pairs.values()])
    sheet.ticks(lowest, "x", rotation=45)
    sheet.ticks(left, "y", rotation=45)
    letters = 10.0 if count < 12 else 8.0
    for k, axis in enumerate(data.axes):
        own = axis.letters(letters)
        sheet.text(across[k].start + 0.5 * size, LABELS, axis.label, own, ha="center", va="center")
        if k:
            sheet.text(LABELS, up[k].start + 0.5 * size, axis.label, own, ha="center", va="center", rotation=90)
    _legend(sheet, verbatim(f"{fit.problem.model.name} on {fit.problem.table.name}"), count < 4)
    return sheet.figure


def _side(data: CornerData, k: int, start: float, size: float) -> Side:
    edges = data.edges[k]
    return Side(float(edges[0]), float(edges[-1]), data.axes[k].logarithmic, start, size)


def _draw_diagonal(sheet: Sheet, data: CornerData, panels: list[Panel]) -> None:
    outlines = [panel.steps(data.edges[k], data.posterior[k]) for k, panel in enumerate(panels)]
    sheet.areas([Path(outline) for outline in outlines], SHADES[0], 1.0)
    sheet.lines(outlines, MODEL, 1.0)
    # The prior has no ends within the panel.
    sheet.lines([panel.steps(data.edges[k], data.prior[k])[1:-1] for k, panel in enumerate(panels)], PRIOR, 1.3)
    points = [panel.path(data.point[k], np.array([0.0, panel.up.high])) for k, panel in enumerate(panels)]
    sheet.lines(points, MEASURED, 1.0, linestyles="--")


def _draw_pairs(sheet: Sheet, data: CornerData, panels: dict[tuple[int, int], Panel]) -> None:
    """Areas within the contours, and the contours; a flat density has none."""
    areas: tuple[list[Path], list[Path]] = ([], [])
    lines: list[FloatArray] = []
    for (row, column), panel in panels.items():
        density, levels = pair_density(data, column, row)
        if not levels[0] < levels[1]:
            continue
        x, y = (side.place(data.middles(k)) for side, k in ((panel.across, column), (panel.up, row)))
        # What it returns is of a type that depends on the arguments.
        found: Any = contour_generator(x, y, density, fill_type=FillType.OuterCode, line_type=LineType.Separate)
        for within, level in zip(areas, levels, strict=True):
            within += map(Path, *found.filled(float(level), 1.01 * float(density.max())))
            lines += found.lines(float(level))
    for within, shade, order in zip(areas, SHADES, (1.0, 1.1), strict=True):
        sheet.areas(within, shade, order)
    sheet.lines(lines, MODEL, 0.9)
    marks = np.array([panel.path(data.point[j], data.point[k]) for (k, j), panel in panels.items()])
    if marks.size:
        sheet.axes.plot(*marks.T, "+", color=MEASURED, markersize=7, scalex=False, scaley=False)


def _legend(sheet: Sheet, title: str, small: bool) -> None:
    handles = [
        Line2D([], [], color=MODEL, label="posterior (contours: 39 and 86 % of it)"),
        Line2D([], [], color=PRIOR, label="prior"),
        Line2D([], [], color=MEASURED, linestyle="--", marker="+", label="point estimate"),
    ]
    sheet.figure.legend(
        handles=handles, loc="upper right", bbox_to_anchor=(0.995, 1.0 - 0.3 / sheet.figure.get_figheight()),
        fontsize=8 if small else 11, frameon=False, title=title, title_fontsize=9 if small else 13, alignment="right",
    )  # fmt: skip


def missing(fit: Fit) -> str:
    """Why a fit has no such figure, "" where it has."""
    return no_posterior(fit)


# Correlations that the words name, the strongest first.
NAMED = 3


def words(fit: Fit) -> str:
    """The figure in words and numbers, for who does not see it."""
    names, matrix = fit.problem.free_names, fit.correlation
    medians = "; ".join(
        f"{row.name} {row.median} {row.interval_95} {row.unit}".rstrip()
        for row in map(parameter_row, fit.estimates)
        if row.name in names
    )
    text = f"Posterior of {len(names)} parameters, median and 95 % interval: {medians}."
    if matrix is None or len(names) < 2:
        return text
    above = [(abs(matrix[i, j]), i, j) for i in range(len(names)) for j in range(i)]
    strongest = sorted(above, reverse=True)[:NAMED]
    pairs = ", ".join(f"{names[j]} with {names[i]} {matrix[i, j]:+.2f}" for _size_of, i, j in strongest)
    return f"{text} Strongest correlations: {pairs}."


# Inches: a panel, and what surrounds them.
PACKAGE_PANEL, ROUND = 1.6, 1.2


@own_style()
def package_corner_figure(fit: Fit) -> Figure:
    """Draws and point estimate in the units of our own corner plot, on its axes; `corner.overplot_points` and the
    like take the figure.
    """
    # What it imports takes longer than our own plot takes to draw.
    from corner import corner

    axes, draws, point = in_units(fit)
    side = PACKAGE_PANEL * len(axes) + ROUND
    made: Figure = corner(
        draws,
        labels=[axis.label for axis in axes],
        axes_scale=["log" if axis.logarithmic else "linear" for axis in axes],
        truths=point,
        max_n_ticks=3,
        labelpad=0.12,
        fig=new_figure(side, side, layout=None),
    )
    return made
