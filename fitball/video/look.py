"""The look of a ball over its disc: light, what stands still with it, and marks that turn."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from scipy.ndimage import map_coordinates

from fitball.base.values import BoolArray, FloatArray
from fitball.video import kernels
from fitball.video.disc import Disc
from fitball.video.marks import Marks

# Places of a look in each direction, and how far from the centre it is known [radii].
_SIZE = 41
_KNOWN = 0.88
_INNER = 0.85
# Fewest frames whose angles are known, by which marks are taken apart from light; how often.
_LEAST_ANGLES = 8
_TIMES = 3
_AXIS = np.linspace(-kernels.LOOK, kernels.LOOK, _SIZE)
_U, _V = np.meshgrid(_AXIS, _AXIS)
_RIM = np.hypot(_U, _V)


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
    height = np.sqrt(np.maximum(1.0 - _RIM**2, 0.0))
    plain = np.tensordot(light, np.stack([np.ones_like(_U), _U, _V, height]), 1)
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


def _left(disc: Disc, place: FloatArray, plain: FloatArray) -> Annotated[FloatArray, "n n"]:
    """What light does not explain of the brightness of a disc."""
    x, y, radius = place
    view = disc.view
    at = [y + radius * _V - view.top, x + radius * _U - view.left]
    seen = map_coordinates(view.image * disc.gain, at, order=1, mode="nearest")
    inner = _RIM < _INNER
    factor = float((seen * plain)[inner].sum() / (plain * plain)[inner].sum())
    return np.asarray((seen - plain * factor) * (_RIM < _KNOWN))


def _turned(look: FloatArray, angle: float) -> Annotated[FloatArray, "n n"]:
    """A look turned counterclockwise in the picture."""
    cos, sin = np.cos(angle), np.sin(angle)
    scale = (_SIZE - 1) / (2.0 * kernels.LOOK)
    u, v = cos * _U - sin * _V, sin * _U + cos * _V
    at = [(v + kernels.LOOK) * scale, (u + kernels.LOOK) * scale]
    return np.asarray(map_coordinates(look, at, order=1, mode="nearest"))
