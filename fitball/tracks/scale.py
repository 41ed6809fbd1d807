"""Metres a pixel of a clip: as stated, or by the ball itself."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from fitball.base.display_units import MM
from fitball.base.text import one_line
from fitball.base.values import FloatArray, IntArray
from fitball.data.cells import TableCells
from fitball.data.scene import CameraSection, Scene, ValueWithSd

# Fewest frames with a radius of the ball that make a scale.
_FEWEST_RADII = 5
# Relative difference of a stated scale from that of the radii up to which no note is due.
_MOST_SCALE_DIFFERENCE = 0.02


class Clip(NamedTuple):
    """Numbers (frames,) of one clip by column; its `rows` among those of the file; `order`, the
    frames in which the ball was found, by time.
    """

    name: str
    rows: IntArray
    values: Mapping[str, FloatArray]
    order: IntArray

    def column(self, name: str, usual: float) -> FloatArray:
        """The numbers (frames,) of a column, or the usual number in all frames without one."""
        return self.values.get(name, np.full(self.rows.size, usual))


class Scale(NamedTuple):
    """The scale of a clip, and the radius of the ball [px] on which it rests, NaN where it is
    stated.
    """

    metres_per_px: float
    radius: float = np.nan


def scale_of_clip(cells: TableCells, scene: Scene, clip: Clip, pixels: set[str]) -> Scale:
    """The scale of a clip, as stated or by the radius of the ball in the picture; 1 where no
    column, of those in `pixels`, needs it. A missing scale is a fault.
    """
    camera = scene.camera or CameraSection()
    stated = 1e-3 * (camera.mm_per_px or 0.0)
    by_ball, radius = _scale_of_ball(scene, clip, pixels)
    if stated and by_ball and abs(stated / by_ball - 1.0) > _MOST_SCALE_DIFFERENCE:
        measured = f"{MM.number(by_ball)} mm/px"
        words = (
            f"the radius of the ball gives {measured}, the stated scale is "
            f"{MM.factor * stated:.3g} mm/px"
        )
        cells.note("scales-differ", f"{one_line(clip.name)}: {words}")
    if stated:
        return Scale(stated)
    if by_ball:
        return Scale(by_ball, radius)
    if "x" in pixels or "y" in pixels or row_time_of(camera):
        words = (
            "positions in pixels, and row_time, need a scale: expected --mm-per-px, "
            "mm_per_px in [camera], or --ball-diameter and a column radius [px]"
        )
        if all(fault.code != "no-scale" for fault in cells.faults):
            cells.fault("no-scale", words)
    return Scale(1.0)


def row_time_of(camera: CameraSection) -> float:
    """The time of a row [s/px] that is stated of a camera, 0 where none is."""
    stated = camera.row_time
    return (stated.value if isinstance(stated, ValueWithSd) else stated) or 0.0


def relative_sd_of_radius(clip: Clip, pixels: set[str], radius: float) -> float:
    """The sd, over the `radius` [px], of the radius in each frame of a clip: the median of a column
    in pixels; NaN without one.
    """
    if "radius_sd" not in pixels:
        return np.nan
    sds = clip.values["radius_sd"][clip.order]
    sds = sds[sds >= 0.0]
    return float(np.median(sds)) / radius if sds.size else np.nan


def _scale_of_ball(scene: Scene, clip: Clip, pixels: set[str]) -> Scale:
    """The scale by the radius of the ball, if the scene states it and enough frames show it; else
    0.
    """
    radius = scene.ball.radius
    if isinstance(radius, ValueWithSd):
        radius = radius.value
    scale = Scale(0.0)
    if radius is None:
        return scale
    for name, share in (("radius", 1.0), ("diameter", 0.5)):
        if name in pixels:
            sizes = clip.values[name][clip.order]
            sizes = sizes[sizes > 0.0]
            if sizes.size >= _FEWEST_RADII:
                in_px = share * float(np.median(sizes))
                scale = Scale(radius / in_px, in_px)
    return scale
