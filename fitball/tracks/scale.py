"""From pixels to metres: by the scale that is stated, or by the ball's own picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fitball.data.cells import refusal
from fitball.data.units import Dimension, parse_unit
from fitball.tracks.clips import PIXELS, Clip, Reading
from fitball.wording import spoken

# Coordinates without a unit that reach further than this are no metres: nobody films a bounce that wide.
_WIDEST = 30.0
# Frames with a radius from which a clip has a scale of its own.
_LEAST = 5
_METRES = parse_unit("m", Dimension.LENGTH)


def in_metres(clips: Sequence[Clip], how: Reading) -> list[Clip]:
    """The clips with positions and radii in metres.

    A stated scale wins over that by radius, with a note on their difference. Raises TableError for pixels without
    either, and for numbers without a unit that are no metres.
    """
    return [_in_metres(_with_unit(clip, how), how) for clip in clips]


def _with_unit(clip: Clip, how: Reading) -> Clip:
    if clip.unit is not None:
        return clip
    reach = float(np.ptp(clip.position, axis=0).max())
    if reach <= _WIDEST:
        return replace(clip, unit=_METRES).noted("coordinates have no unit and were read as metres")
    if how.metres_per_px is not None or _ruler(clip, how) is not None:
        return replace(clip, unit=PIXELS).noted(
            f"coordinates have no unit and were read as pixels: they span {reach:.4g}, and a scale is known"
        )
    raise refusal(
        clip.source,
        f"coordinates of clip '{clip.id}' have no unit and span {reach:.4g}; expected a unit, such as 'x [px]' or "
        f"'x [mm]' in the header, or {spoken('--unit mm', 'unit=' + repr('mm'))}; pixels need a scale too",
    )


def _in_metres(clip: Clip, how: Reading) -> Clip:
    if clip.unit is not PIXELS:
        if how.metres_per_px is None or clip.position.shape[1] != 2:
            return clip
        return replace(clip, metres_per_px=how.metres_per_px)
    ruler, notes = _ruler(clip, how), []
    if how.metres_per_px is not None:
        scale = how.metres_per_px
        if ruler is not None:
            value, sd, frame_sd = ruler
            notes.append(
                f"the ball's radius gives {1e3 * value:.4g} ± {1e3 * sd:.2g} mm/px ({100.0 * frame_sd / value:.2g} % "
                f"a frame), the stated scale is {1e3 * scale:.4g} mm/px: {abs(value - scale) / sd:.1f} sd or "
                f"{100.0 * (scale / value - 1.0):+.1f} % apart"
            )
    elif ruler is not None:
        scale, sd, frame_sd = ruler
        notes.append(
            f"scale by the ball's radius, median of the clip: {1e3 * scale:.4g} ± {1e3 * sd:.2g} mm/px "
            f"({100.0 * frame_sd / scale:.2g} % a frame)"
        )
    else:
        raise refusal(
            clip.source,
            f"clip '{clip.id}' is in pixels; expected their size: pass {spoken('--scale 0.8mm/px', 'scale=0.0008')}, "
            f"or mm_per_px in [camera] of the scene, or a column 'radius [px]' with "
            f"{spoken('--ball-diameter 66mm', 'ball_diameter=0.066')}",
        )
    radius = None if clip.radius is None else scale * clip.radius
    return replace(clip, position=scale * clip.position, radius=radius, metres_per_px=scale).noted(*notes)


def _ruler(clip: Clip, how: Reading) -> tuple[float, float, float] | None:
    """Metres a pixel by the ball's radius: median, its standard error, and the sd of a frame; None without."""
    diameter = how.ball_diameter or (2.0 * how.ball.radius if how.states_ball else None)
    if clip.radius is None or diameter is None:
        return None
    radii = clip.radius[np.isfinite(clip.radius) & (clip.radius > 0.0)]
    if len(radii) < _LEAST:
        return None
    scales = 0.5 * diameter / radii
    middle = float(np.median(scales))
    frame_sd = max(1.4826 * float(np.median(np.abs(scales - middle))), 1e-6 * middle)
    return middle, 1.2533 * frame_sd / float(np.sqrt(len(scales))), frame_sd
