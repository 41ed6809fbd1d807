"""The strip of a ball: one picture by which people see whether the right thing was followed."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection

from fitball.base.values import Figure, FloatArray, IntArray
from fitball.report.style import DPI, new_figure
from fitball.video.types import Crop, Plane, Seen, Sightings

# The longer side of the picture of a film on the page [px].
_LONG_SIDE = 1280.0
# The ball of every so many frames is pasted into the background.
_EVERY = 6
# How much of its surroundings comes with it [radii].
_PASTED = 1.25
# Balls below the picture, and how much of their surroundings they show [radii].
_CROPS = 16
_SHOWN = 1.5
# Colours on a picture in shades of grey: of frames that are used, left out, of angles, the court.
_USED = "#50ff50"
_LEFT_OUT = "#ff3c3c"
_ANGLE = "#ffc800"
_LEVEL = "#40c0ff"


def draw_strip(seen: Seen, ball: Sightings) -> Figure:
    """Draw the background with the ball of every sixth frame, a circle of each frame, a stroke for
    each angle, the level line through the lowest ball; below it balls with their circles.
    """
    height, width = seen.background.shape
    cell = width / _CROPS
    scale = _LONG_SIDE / max(width, height) / DPI
    figure, panels = new_figure(1, 1, high=(height + cell) * scale, wide=width * scale)
    figure.set_layout_engine("none")
    axes = panels[0, 0]
    axes.set_position((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    levels = {"cmap": "gray", "vmin": seen.clip.black, "vmax": seen.clip.white}
    axes.imshow(_pasted(seen, ball), extent=_extent(0.0, 0.0, width, height), **levels)
    _draw_circles(axes, ball)
    _draw_level(axes, seen, ball)
    frames = ball.frame.tolist()
    for place, number in enumerate(_spread(len(ball.crops))):
        crop = ball.crops[number]
        row = frames.index(crop.frame)
        part = _around(crop, ball.x[row], ball.y[row], _SHOWN * ball.radius[row])
        left = place * cell
        axes.imshow(part, extent=_extent(left, height, left + cell, height + cell), **levels)
        size = cell / _SHOWN
        middle = np.array([[left + 0.5 * cell, height + 0.5 * cell]])
        _circles(axes, middle - 0.5, np.array([size]), _colour(bool(ball.used[row])))
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height + cell - 0.5, -0.5))
    return figure


def _spread(count: int) -> list[int]:
    """Numbers of crops that are shown, evenly spread among so many."""
    numbers = np.linspace(0, count - 1, min(count, _CROPS))
    return [int(number) for number in numbers.round()]


def _extent(left: float, top: float, right: float, bottom: float) -> tuple[float, ...]:
    """Where a picture is, in pixels that count from the centre of the first."""
    return (left - 0.5, right - 0.5, bottom - 0.5, top - 0.5)


def _colour(used: bool) -> str:
    """The colour of a circle."""
    return _USED if used else _LEFT_OUT


def _pasted(seen: Seen, ball: Sightings) -> Annotated[Plane, "rows columns"]:
    """The background with the ball of every sixth frame."""
    picture = seen.background.copy()
    row_of = {int(frame): row for row, frame in enumerate(ball.frame)}
    for crop in ball.crops[::_EVERY]:
        row = row_of[crop.frame]
        rows, columns = crop.luma.shape
        y, x = np.mgrid[:rows, :columns]
        off = np.hypot(x + crop.column - ball.x[row], y + crop.row - ball.y[row])
        near = off < _PASTED * ball.radius[row]
        part = picture[crop.row : crop.row + rows, crop.column : crop.column + columns]
        part[near] = crop.luma[near]
    return picture


def _around(crop: Crop, x: float, y: float, reach: float) -> Annotated[FloatArray, "rows columns"]:
    """The part of a crop that reaches so far from a place [px], resampled; edges are repeated."""
    from scipy.ndimage import map_coordinates

    count = max(int(np.ceil(2.0 * reach)), 2)
    steps = (np.arange(count) + 0.5) / count * 2.0 * reach - reach
    rows, columns = np.meshgrid(y + steps - crop.row, x + steps - crop.column, indexing="ij")
    luma = crop.luma.astype(np.float64)
    return np.asarray(map_coordinates(luma, [rows, columns], order=1, mode="nearest"))


def _circles(axes: Axes, middle: FloatArray, width: FloatArray, colour: str) -> None:
    """Draw circles of these widths [px] around places (circles, 2)."""
    circles = EllipseCollection(
        width,
        width,
        np.zeros(width.size),
        units="xy",
        offsets=middle,
        offset_transform=axes.transData,
        facecolors="none",
        edgecolors=colour,
        linewidths=0.8,
    )
    axes.add_collection(circles)


def _draw_circles(axes: Axes, ball: Sightings) -> None:
    """Draw the circle of each frame, and a stroke where the angle of the mark was seen."""
    places = np.column_stack([ball.x, ball.y])
    for used in (False, True):
        rows: IntArray = np.flatnonzero(ball.used == used)
        if rows.size:
            _circles(axes, places[rows], 2.0 * ball.radius[rows], _colour(used))
    marked = np.flatnonzero(np.isfinite(ball.angle))
    stroke = np.column_stack([np.cos(ball.angle), -np.sin(ball.angle)]) * ball.radius[:, None]
    strokes = [(places[row], places[row] + stroke[row]) for row in marked]
    axes.add_collection(LineCollection(strokes, colors=_ANGLE, linewidths=0.8))


def _draw_level(axes: Axes, seen: Seen, ball: Sightings) -> None:
    """Draw the level line below the lowest ball."""
    used = np.flatnonzero(ball.used)
    slope = -np.tan(seen.tilt.value)
    lowest = used[np.argmax(ball.y[used] - slope * ball.x[used])]
    ends = np.array([0.0, seen.background.shape[1] - 1.0])
    below = ball.y[lowest] + ball.radius[lowest] + slope * (ends - ball.x[lowest])
    axes.plot(ends, below, color=_LEVEL, linewidth=0.8, linestyle=(0, (8, 6)))
