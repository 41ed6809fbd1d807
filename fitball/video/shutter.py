"""Row time of a rolling shutter by the shapes of discs: rows that are read later stretch what moves
along them and make lean what moves across.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.values import FloatArray, IntArray
from fitball.video.types import Estimate

# Light makes a ball look longer or leaning by so much (sd), always alike; and so do marks, which
# turn with it.
_LIGHT_SD = 0.03
_MARKS_SD = 0.03
# Compression and background move the edge of a disc by so much (sd) [px], alike in all frames of a
# flight: that makes row times of ten balls of seven films differ from the truth as their sds say.
_FLIGHT_SD_PX = 0.05
# Errors of shapes last over at most so many frames, while felt and marks turn.
_LASTING = 12.0
# Residuals of shapes beyond so many sds count less; how often that is repeated.
_HUBER = 2.0
_TIMES = 8


class Shapes(NamedTuple):
    """Shapes of a ball in its frames: `shape` has how much longer the disc is along the readout of
    the rows and how much it leans, `sd` the sds of both, `velocity` those along the readout and
    across it [px/s]; `flight` is the number of its flight; `angle` is how far the ball is turned,
    from across towards along [rad], NaN where no mark shows it; `radius` is that of the ball [px].
    """

    radius: float
    frames: Annotated[IntArray, "frames"]
    flight: Annotated[IntArray, "frames"]
    velocity: Annotated[FloatArray, "frames 2"]
    angle: Annotated[FloatArray, "frames"]
    shape: Annotated[FloatArray, "frames 2"]
    sd: Annotated[FloatArray, "frames 2"]


class Shutter(NamedTuple):
    """The row time [s/px], and the stretch and lean that light makes."""

    row_time: Estimate
    light: Annotated[FloatArray, "2"]


def shutter_of(shapes: Shapes) -> Shutter:
    """The row time of shapes. What changes with velocity is the shutter's, what stands still the
    light's, and what turns with the ball that of its marks; besides, each flight has its own error.
    """
    design, prior_sd = _design(shapes)
    frames, _, count = design.shape
    prior = np.diag(1.0 / prior_sd)[1:]
    seen = shapes.shape.ravel()
    sd = np.maximum(shapes.sd, np.median(shapes.sd)).ravel()
    rows = design.reshape(2 * frames, count)
    weight = 1.0 / sd
    for _ in range(_TIMES):
        weighted = np.vstack([rows * weight[:, None], prior])
        right = np.append(seen * weight, np.zeros(len(prior)))
        found = np.linalg.lstsq(weighted, right, rcond=None)[0]
        off = (seen - rows @ found) / sd
        scale = max(1.48 * float(np.median(np.abs(off))), 1e-9)
        weight = 1.0 / (sd * scale) / np.sqrt(1.0 + (off / (_HUBER * scale)) ** 2)
    weighted = np.vstack([rows * weight[:, None], prior])
    inverse = np.linalg.inv(weighted.T @ weighted)
    pulls = weighted[: 2 * frames] * (weight * (seen - rows @ found))[:, None]
    wider = _lasting(pulls.reshape(frames, 2, count).sum(1) @ inverse[0], shapes.frames)
    row_time = Estimate(float(found[0]), float(np.sqrt(inverse[0, 0])) * wider)
    return Shutter(row_time, np.asarray(found[1:3], dtype=np.float64))


def _design(
    shapes: Shapes,
) -> tuple[Annotated[FloatArray, "frames 2 parts"], Annotated[FloatArray, "parts"]]:
    """What a row time, light (2), marks (2) and each flight (2) make of stretch and lean; sds of
    their priors. An ellipse that is turned by an angle is seen longer and leaning by twice the
    angle.
    """
    known = np.isfinite(shapes.angle)
    cos = np.where(known, np.cos(2.0 * shapes.angle), 0.0)
    sin = np.where(known, np.sin(2.0 * shapes.angle), 0.0)
    always = np.broadcast_to(np.eye(2), (len(known), 2, 2))
    turning = np.stack([np.stack([cos, sin], 1), np.stack([-sin, cos], 1)], 1)
    flights = np.unique(shapes.flight)
    of_flights = [(shapes.flight == k)[:, None, None] * always for k in flights]
    design = np.concatenate([shapes.velocity[..., None], always, turning, *of_flights], 2)
    flight_sd = _FLIGHT_SD_PX / shapes.radius
    sds = [np.inf, *[_LIGHT_SD] * 2, *[_MARKS_SD] * 2, *[flight_sd] * 2 * len(flights)]
    return design, np.array(sds)


def together(estimates: Sequence[Estimate]) -> Estimate:
    """The mean of estimates by their variances. If they scatter more than their sds say, its sd is
    as much larger.
    """
    values, sds = np.array(estimates).T
    weights = sds**-2.0
    mean = float(np.average(values, weights=weights))
    freedom = max(len(values) - 1, 1)
    ratio = float(weights @ (values - mean) ** 2) / freedom
    return Estimate(mean, float(np.sqrt(max(ratio, 1.0) / weights.sum())))


def _lasting(pulls: Annotated[FloatArray, "frames"], frames: IntArray) -> float:
    """By how much an sd is larger since pulls of frames near each other are alike (Newey and West,
    Econometrica 55 (1987) 703); 1 at least.
    """
    apart = np.abs(np.subtract.outer(frames, frames))
    share = np.maximum(1.0 - apart / _LASTING, 0.0)
    ratio = float(pulls @ share @ pulls / (pulls @ pulls))
    return float(max(ratio, 1.0) ** 0.5)
