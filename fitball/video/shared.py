"""What the discs of one ball share: how far their radii are off, exposure, blur and light. All
frames are fitted together, since in one alone a radius and the light at the rim are hard to tell
apart: a disc that is too small with a rim that is too bright looks nearly the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.values import FloatArray
from fitball.video.disc import BLUR, EXPOSURE, Disc

# Places among the parameters of a disc in luma: those of each frame, those that all share.
_OWN = [0, 1]
_LIGHT = 7
_SHARED = [2, EXPOSURE, BLUR]
# The fit ends after so many steps, or if the sum of squares falls by less than this share.
_STEPS = 12
_CONVERGED = 1e-4
# Damping: at first, when a step was good, when it was not.
_DAMPING = 1e-3
_EASIER = 0.2
_HARDER = 8.0
_TRIALS = 5
# Shades that hardly differ are kept apart by this share of their weight.
_RIDGE = 1e-6


class Common(NamedTuple):
    """What discs share: by how much their radii are off [px], the sd of that, exposure [s], blur
    [px] and shades of luma.
    """

    radius: float
    radius_sd: float
    exposure: float
    blur: float
    light: Annotated[FloatArray, "shades"]


class _State(NamedTuple):
    """Discs as they are fitted: parameters and shades."""

    p: Annotated[FloatArray, "frames 7"]
    light: Annotated[FloatArray, "shades"]


class _Normal(NamedTuple):
    """Normal equations of what is shared, those of each frame's own place eliminated; what a step
    of the shared makes of the places; the sum of squares and of weights.
    """

    matrix: Annotated[FloatArray, "shared shared"]
    right: Annotated[FloatArray, "shared"]
    places: Annotated[FloatArray, "frames 2"]
    slopes: Annotated[FloatArray, "frames 2 shared"]
    cost: float
    weight: float


def common_of(
    discs: Sequence[Disc],
    p: Annotated[FloatArray, "frames 7"],
    light: Annotated[FloatArray, "shades"],
    brightness: Annotated[FloatArray, "frames"],
) -> Common:
    """What discs share, by least squares in luma from the discs `p` and a light on; `brightness` is
    that of each frame against the others. Radii keep their differences.
    """
    state = _State(p.copy(), light.copy())
    normal = _normal(discs, state, brightness)
    damping = _DAMPING
    for _ in range(_STEPS):
        for _ in range(_TRIALS):
            trial = _moved(discs, state, normal, damping)
            other = _normal(discs, trial, brightness)
            if other.cost < normal.cost:
                break
            damping *= _HARDER
        if not other.cost < normal.cost:
            break
        done = normal.cost - other.cost < _CONVERGED * normal.cost
        state, normal = trial, other
        damping *= _EASIER
        if done:
            break
    covariance = np.linalg.pinv(normal.matrix) * normal.cost / max(normal.weight, 1.0)
    radius = float((state.p[:, 2] - p[:, 2]).mean())
    sd = float(np.sqrt(max(covariance[0, 0], 0.0)))
    return Common(radius, sd, float(state.p[0, EXPOSURE]), float(state.p[0, BLUR]), state.light)


def _normal(discs: Sequence[Disc], state: _State, brightness: FloatArray) -> _Normal:
    """Normal equations of all discs."""
    count = len(_SHARED) + len(state.light)
    matrix, right = np.zeros((count, count)), np.zeros(count)
    places, slopes = np.zeros((len(discs), 2)), np.zeros((len(discs), 2, count))
    sums = np.zeros(3)
    shared = [*_SHARED, *range(_LIGHT, _LIGHT + len(state.light))]
    for k, disc in enumerate(discs):
        whole, side, of_frame = disc.luma_normal(state.p[k], brightness[k], state.light)
        own = whole[np.ix_(_OWN, _OWN)] + 1e-12 * np.eye(2)
        both = whole[np.ix_(_OWN, shared)]
        places[k] = np.linalg.solve(own, side[_OWN])
        slopes[k] = np.linalg.solve(own, both)
        matrix += whole[np.ix_(shared, shared)] - both.T @ slopes[k]
        right += side[shared] - both.T @ places[k]
        sums += of_frame
    return _Normal(matrix, right, places, slopes, float(sums[0]), float(sums[2]))


def _moved(discs: Sequence[Disc], state: _State, normal: _Normal, damping: float) -> _State:
    """The discs after a damped step."""
    damped = normal.matrix + np.diag((damping + _RIDGE) * normal.matrix.diagonal() + 1e-30)
    step = np.linalg.solve(damped, normal.right)
    p = state.p.copy()
    p[:, _OWN] += normal.places - normal.slopes @ step
    p[:, _SHARED] += step[: len(_SHARED)]
    for k, disc in enumerate(discs):
        p[k] = disc.bounded(p[k])
    return _State(p, state.light + step[len(_SHARED) :])
