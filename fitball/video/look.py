"""The look of a ball over its disc: light, what stands still with it, and marks that turn."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from scipy.ndimage import map_coordinates

from fitball.base.values import BoolArray, FloatArray
from fitball.video import kernels
from fitball.video.disc import Disc
from fitball.video.marks import Marks

# Places of a look in each direction, and how far from the centre it is read [radii]; what is
# nearer to the rim looks like what is inside of it.
_SIZE = 41
_KNOWN = 0.9
# Fewest frames whose angles are known, by which marks are taken apart from light; how often.
_LEAST_ANGLES = 8
_TIMES = 3
_AXIS = np.linspace(-kernels.LOOK, kernels.LOOK, _SIZE)
_U, _V = np.meshgrid(_AXIS, _AXIS)
_NEAR = np.minimum(1.0, _KNOWN / np.maximum(np.hypot(_U, _V), 1e-9))
_INNER_U, _INNER_V = _NEAR * _U, _NEAR * _V
_HEIGHT = np.sqrt(1.0 - _INNER_U**2 - _INNER_V**2)


def dress(
    discs: list[Disc],
    places: Annotated[FloatArray, "frames 3"],
    marks: Marks,
    clear: Annotated[BoolArray, "frames"],
) -> None:
    """Give each disc the look of the ball, with marks turned by its angle, from the frames that
    show it clearly, at places (x, y, radius) [px].
    """
    rows = np.flatnonzero(clear)
    light = np.median([discs[k].colour for k in rows], axis=0)
    shades = np.stack([np.ones_like(_U), _INNER_U, _INNER_V, _HEIGHT])
    plain = np.tensordot(light, shades, 1)
    rest = np.array([_left(discs[k], places[k], plain) for k in rows])
    still = np.median(rest, axis=0)
    texture = np.zeros_like(still)
    angle = marks.angle[rows]
    known = np.flatnonzero(np.isfinite(angle))
    if len(known) >= _LEAST_ANGLES:
        for _ in range(_TIMES):
            texture = np.mean([_turned(rest[k] - still, -angle[k]) for k in known], axis=0)
            still = np.mean([rest[k] - _turned(texture, angle[k]) for k in known], axis=0)
    for disc, turn in zip(discs, marks.angle, strict=True):
        disc.dress(light, still + _turned(texture, turn) if np.isfinite(turn) else still)


def _left(
    disc: Disc,
    place: FloatArray,
    plain: Annotated[FloatArray, "channels n n"],
) -> Annotated[FloatArray, "channels n n"]:
    """What light does not explain of the brightness of a disc."""
    x, y, radius = place
    view = disc.view
    at = [y + radius * _INNER_V - view.top, x + radius * _INNER_U - view.left]
    seen = np.stack(
        [map_coordinates(channel, at, order=1, mode="nearest") for channel in view.image]
    )
    seen *= disc.gain
    factor = (seen * plain).sum((1, 2)) / (plain * plain).sum((1, 2))
    return np.asarray(seen - plain * factor[:, None, None])


def _turned(look: Annotated[FloatArray, "channels n n"], angle: float) -> FloatArray:
    """A look turned counterclockwise in the picture."""
    cos, sin = np.cos(angle), np.sin(angle)
    scale = (_SIZE - 1) / (2.0 * kernels.LOOK)
    u, v = cos * _U - sin * _V, sin * _U + cos * _V
    at = [(v + kernels.LOOK) * scale, (u + kernels.LOOK) * scale]
    turned = [map_coordinates(channel, at, order=1, mode="nearest") for channel in look]
    return np.stack(turned)
