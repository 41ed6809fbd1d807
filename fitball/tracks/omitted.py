"""Frames of a clip in which no ball was found, or none for sure: codes in place of positions,
visibility, confidence.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitball.base.values import BoolArray, FloatArray, IntArray
from fitball.data.scene import CameraSection

# Least confidence of a frame that is used, where none is stated: below it programs guess the
# position.
LEAST_CONFIDENCE = 0.9
# Codes that programs write for both coordinates of a frame in which they found no ball, where no
# ball is in reach.
_FAR_CODES = (-99.0, -999.0, -9999.0, -99999.0)
# Codes that may be positions too: they are none where the ball jumps there and back.
_NEAR_CODES = (0.0, -1.0)
# A ball that jumps goes this many times as far as in a usual step.
_JUMP_STEPS = 3.0
# Fewest frames besides codes that show usual steps.
_FEWEST_FRAMES = 3
# Words for a ball that is not seen.
_UNSEEN = frozenset(["0", "0.0", "false", "f", "no", "n", "nein", "non", "unseen", "invisible"])
# A confidence is at most 1; more counts something else, or percent.
_MOST_CONFIDENCE = 1.0
# A limit of the confidence that is proposed keeps this share of the frames.
_KEPT_SHARE = 0.9


def least_confidence(camera: CameraSection) -> float:
    """The least confidence of a frame that is used."""
    stated = camera.min_confidence
    return LEAST_CONFIDENCE if stated is None else stated


def proposed_confidence(confidence: FloatArray) -> float:
    """A limit with two digits that keeps most frames (frames,)."""
    kept = float(np.nanquantile(confidence, 1.0 - _KEPT_SHARE, method="lower"))
    return float(np.floor(100.0 * kept + 1e-6) / 100.0)


def is_share(confidence: FloatArray) -> bool:
    """Whether numbers (rows,) may be confidences, from 0 to 1."""
    measured = confidence[np.isfinite(confidence)]
    return bool((measured <= _MOST_CONFIDENCE).all() and (measured >= 0.0).all())


def unseen(texts: Sequence[str]) -> BoolArray:
    """In which rows (rows,) the ball is not seen, by words for its visibility; nowhere where it
    never is.
    """
    rows = np.array([text.casefold() in _UNSEEN for text in texts], dtype=np.bool_)
    return rows & (not rows.all())


def coded(x: FloatArray, y: FloatArray, group: IntArray) -> BoolArray:
    """In which rows (rows,) both coordinates are a code for a ball that was not found. `group` has
    the number of the clip of each row.
    """
    lost = np.zeros(x.size, dtype=np.bool_)
    for code in _FAR_CODES:
        lost |= np.isclose(x, code) & np.isclose(y, code)
    for code in _NEAR_CODES:
        is_code = (x == code) & (y == code)
        for number in np.unique(group[is_code]):
            rows = np.flatnonzero(group == number)
            lost[rows] |= _off_path(x[rows], y[rows], is_code[rows])
    return lost


def _off_path(x: FloatArray, y: FloatArray, is_code: BoolArray) -> BoolArray:
    """Which of the frames (frames,) of a clip at the place of a code are away from the path of the
    ball: they repeat, or the path jumps there.
    """
    positions = np.column_stack([x, y])
    on_path = np.flatnonzero(np.isfinite(x + y) & ~is_code)
    away = np.zeros(x.size, dtype=np.bool_)
    if on_path.size < _FEWEST_FRAMES:
        return away
    lengths = np.hypot(*np.diff(positions[on_path], axis=0).T) / np.diff(on_path)
    usual = float(np.median(lengths))
    for k in np.flatnonzero(is_code):
        neighbours = is_code[max(k - 1, 0) : k + 2].sum()
        before = on_path[on_path < k][-1:]
        after = on_path[on_path > k][:1]
        nearest = np.concatenate([before, after])
        rates = np.hypot(*(positions[nearest] - positions[k]).T) / np.abs(nearest - k)
        away[k] = neighbours > 1 or rates.min() > _JUMP_STEPS * usual
    return away
