"""How much the camera is tilted, by the strongest nearly level edges of a picture."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from scipy.ndimage import gaussian_filter

from fitball.base.values import FloatArray
from fitball.video.types import Estimate, Plane

# Slopes that are tried [rad], and how far they are then refined.
_STEEPEST = np.radians(6.0)
_COARSE = np.radians(0.25)
_FINE = np.radians(0.025)
# Stronger steps than this between rows count as much as this [levels].
_STRONGEST = 20.0
# Parts of the picture's width, each of which is moved as a whole.
_BANDS = 64
# Edges are level lines of the scene if they stand out against other slopes by so much: of rendered
# scenes they do by more than 5 times; of a film without any, 2 times, and were off by 4 degrees.
_CLEAR = 5.0
# The error of such edges, and of a camera without them that was held or put up level [rad].
_EDGE_SD = np.radians(0.1)
_LEVEL_SD = np.radians(0.3)


def tilt_of(picture: Annotated[Plane, "rows columns"]) -> Estimate:
    """The tilt [rad] by which level lines rise to the right: that of the picture's edges if they
    stand out, else none with the error of a camera that looks level.
    """
    slope, clearness = _edges(picture)
    return Estimate(slope, _EDGE_SD) if clearness > _CLEAR else Estimate(0.0, _LEVEL_SD)


def _edges(picture: Plane) -> tuple[float, float]:
    """Slope of the strongest edges that are nearly level, and how much they stand out."""
    rows, columns = (size // 2 * 2 for size in picture.shape)
    half = picture[:rows, :columns].reshape(rows // 2, 2, columns // 2, 2).mean((1, 3))
    steps = np.clip(np.diff(gaussian_filter(half, 1.0), axis=0), -_STRONGEST, _STRONGEST)
    parts = np.array_split(np.arange(steps.shape[1]), min(_BANDS, steps.shape[1]))
    bands = np.array([steps[:, part].mean(1) for part in parts])
    middles = np.array([part.mean() for part in parts]) - steps.shape[1] / 2.0
    coarse = np.arange(-_STEEPEST, _STEEPEST + _COARSE / 2.0, _COARSE)
    strength = _strength(bands, middles, coarse)
    near = coarse[int(np.argmax(strength))]
    fine = np.arange(near - _COARSE, near + _COARSE + _FINE / 2.0, _FINE)
    finer = _strength(bands, middles, fine)
    best = int(np.clip(np.argmax(finer), 1, len(fine) - 2))
    before, top, after = finer[best - 1 : best + 2]
    bend = before - 2.0 * top + after
    slope = fine[best] + (0.5 * (before - after) / bend * _FINE if bend < 0.0 else 0.0)
    usual = float(np.median(strength))
    return float(slope), float(top / usual) if usual > 0.0 else 0.0


def _strength(bands: FloatArray, middles: FloatArray, slopes: FloatArray) -> FloatArray:
    """How strong the edges of each slope are: bands moved by their share of it agree."""
    rows = np.arange(bands.shape[1], dtype=float)
    out = []
    for slope in slopes:
        moved = [
            np.interp(rows - np.tan(slope) * middle, rows, band)
            for band, middle in zip(bands, middles, strict=True)
        ]
        out.append(float((np.mean(moved, axis=0) ** 2).sum()))
    return np.array(out)
