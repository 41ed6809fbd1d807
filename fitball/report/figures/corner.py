"""The corner plot: posterior draws, the prior on the diagonal, the point estimate marked."""

from __future__ import annotations

from typing import Any

import numpy as np
from contourpy import FillType, LineType, contour_generator
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.path import Path

from fitball.report.figures.corner_arrays import CornerData, corner_data, pair_density
from fitball.report.figures.drawable import Drawable
from fitball.report.figures.sheet import Panel, Sheet, Side
from fitball.report.form.palette import MEASURED, MODEL, PRIOR, pale
from fitball.values import FloatArray

# Inches: a panel, smaller where many would make a sheet too large to look at; between panels; for labels, and where
# they stand in it.
PANEL, WIDEST, LEAST, GAP, LABEL_MARGIN, LABELS = 1.55, 10.8, 0.75, 0.12, 0.95, 0.25
# Between the contours and within the inner one: opaque, which draws faster than what shines through.
SHADES = [pale(MODEL, 0.35), pale(MODEL, 0.7)]


def corner_figure(fit: Drawable) -> Figure:
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
        sheet.text(across[k].start + 0.5 * size, LABELS, axis.label, letters, ha="center", va="center")
        if k:
            sheet.text(LABELS, up[k].start + 0.5 * size, axis.label, letters, ha="center", va="center", rotation=90)
    _legend(sheet, f"{fit.problem.model.name} on {fit.problem.table.name}", count < 4)
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
