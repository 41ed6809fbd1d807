"""What positions show without a model of flight: velocities before and after a bounce, acceleration between, noise.

Windows of frames are fitted by lines and parabolas. Nothing here is an estimate of an impact: it says which way is
up, whether the clock is right, and where a ball bounces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, isfinite

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.signal import find_peaks

from fitball.values import FloatArray

# Frames are averaged in blocks of about this time [s], and this long around a bounce left out on either side.
_BLOCK, _CONTACT = 1.4e-3, 3.0e-3
# Frames on either side of a bounce that may show it: a film that is played slowly shows long contacts.
_GAP = 2.5
# Frames beyond those that parabolas take, from which the noise of an acceleration is known.
_FREE = 8
_WINDOW = 6
# Frames over which noise is estimated, and how many windows of a clip are.
_SPAN, _WINDOWS = 7, 400
# Frames by which a frame is judged, and how many sds off it is an outlier; less than this share of a step is none.
_PAIRS, _OUTLYING, _BENT = ((-1, 1), (-2, 2), (-2, -1), (1, 2)), 6.0, 0.25
# A bounce is deeper than so many standard deviations of the noise, and than a share of the heights of a clip.
_DEEP, _SHARE, _SHARE_ENOUGH = 8.0, 0.01, 0.1
# Velocities this many standard errors from zero are known in sign.
SURE = 4.0


@dataclass(frozen=True)
class Kink:
    """Where velocity changes most: `time` [s], velocities (axes,) before and after, and their standard errors."""

    time: float
    before: FloatArray
    after: FloatArray
    before_sd: FloatArray
    after_sd: FloatArray

    @property
    def jump(self) -> FloatArray:
        """Change of velocity (axes,)."""
        return self.after - self.before

    @property
    def score(self) -> float:
        """The largest change in its standard errors."""
        return float(np.max(np.abs(self.jump) / np.hypot(self.before_sd, self.after_sd)))


def regular(time: FloatArray, position: FloatArray) -> NDArray[np.bool_]:
    """Which frames (frames,) are no outliers: near one of the lines through neighbours before, after, or around."""
    count = len(time)
    good = np.ones(count, dtype=np.bool_)
    if count < _SPAN:
        return good
    guesses = np.full((len(_PAIRS), *position.shape), np.nan)
    for guess, (one, other) in zip(guesses, _PAIRS, strict=True):
        inside = np.arange(max(0, -one), count - max(0, other))
        a, b = inside + one, inside + other
        share = (time[inside] - time[a]) / (time[b] - time[a])
        guess[inside] = position[a] + share[:, None] * (position[b] - position[a])
    usual = 1.4826 * np.median(np.abs(position - guesses[0])[1:-1], axis=0)
    step = float(np.median(np.linalg.norm(np.diff(position, axis=0), axis=1)))
    off = np.abs(position - guesses) / np.maximum(_OUTLYING * usual, max(_BENT * step, 1e-9))
    # At the ends there is one line, and that may cross a bounce.
    alone = np.isfinite(guesses[:, :, 0]).sum(axis=0) < 2
    good = (np.nanmin(off.max(axis=2), axis=0) <= 1.0) | alone
    # Where that is a third of all, noise has another shape, and none is an outlier.
    return good if good.mean() > 2.0 / 3.0 else np.ones(count, dtype=np.bool_)


def thinned(time: FloatArray, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Means of blocks of frames, about 1.4 ms long: times (blocks,) and positions (blocks, axes)."""
    size = max(1, int(_BLOCK / max(float(np.median(np.diff(time))), 1e-9)))
    count = len(time) // size * size
    return time[:count].reshape(-1, size).mean(axis=1), position[:count].reshape(-1, size, position.shape[1]).mean(
        axis=1
    )


def kink(time: FloatArray, position: FloatArray) -> Kink | None:
    """The strongest change of velocity of a clip; None for fewer than seven frames. Times (frames,) rise, positions
    are (frames, axes).
    """
    if len(time) < _SPAN:
        return None
    good = regular(time, position)
    t, r = thinned(time[good], position[good])
    if len(t) < _SPAN:
        return None
    gap = max(1, ceil(_CONTACT / float(np.median(np.diff(t)))))
    width = min(_WINDOW, (len(t) - 2 * gap + 1) // 2)
    if width < 3:
        return None
    velocity, sd = _slopes(t, r, width)
    reach = 2 * gap + width - 1
    before, after = slice(0, len(velocity) - reach), slice(reach, None)
    change = np.abs(velocity[after] - velocity[before]) / np.hypot(sd[after], sd[before])
    best = int(np.argmax(change.max(axis=1)))
    middle = float(t[best + width - 1 + gap])
    return Kink(middle, velocity[best], velocity[best + reach], sd[best], sd[best + reach])


def _slopes(t: FloatArray, r: FloatArray, width: int) -> tuple[FloatArray, FloatArray]:
    """Slopes of lines through windows of frames and their standard errors, (windows, axes) each."""
    times = sliding_window_view(t, width)
    places = sliding_window_view(r, width, axis=0)
    d = (times - times.mean(axis=1, keepdims=True))[:, None, :]
    spread = (d**2).sum(axis=2)
    slope = (d * places).sum(axis=2) / spread
    rest = places - places.mean(axis=2, keepdims=True) - slope[..., None] * d
    variance = (rest**2).sum(axis=2) / (width - 2) / spread
    # Positions without noise have no residuals; a thousandth of the speed is nobody's precision.
    floor = 1e-3 * np.abs(slope).max(initial=1e-12)
    return slope, np.sqrt(variance + floor**2)


def bounces(time: FloatArray, height: FloatArray) -> NDArray[np.int64]:
    """Frames at which a ball is lowest between falling and rising, outliers of a frame aside."""
    if len(time) < 3:
        return np.array([], dtype=np.int64)
    good = regular(time, height[:, None])
    t, y = thinned(time[good], height[good][:, None])
    spread = noise(t, y)
    smooth = median_filter(y[:, 0], size=3, mode="nearest")
    reach = float(np.ptp(smooth))
    # In a short clip a bounce is in every window, and no noise.
    deep = min(max(_DEEP * spread if isfinite(spread) else 0.0, _SHARE * reach), _SHARE_ENOUGH * reach)
    peaks, _ = find_peaks(-smooth, prominence=max(deep, 1e-9))
    lands = [_crossing(t, y[:, 0], int(peak)) for peak in peaks]
    return np.unique(np.array([int(np.argmin(np.abs(time - land))) for land in lands], dtype=np.int64))


def _crossing(t: FloatArray, y: FloatArray, lowest: int) -> float:
    """Where lines through the heights before and after the lowest cross [s]; the lowest itself, if nowhere near."""
    gap = max(1, ceil(_CONTACT / float(np.median(np.diff(t)))))
    sides = [slice(max(0, lowest - gap - 3), lowest - gap + 1), slice(lowest + gap, lowest + gap + 4)]
    if lowest < gap or any(len(t[side]) < 2 for side in sides):
        return float(t[lowest])
    (fall, high), (rise, low) = (np.polyfit(t[side] - t[lowest], y[side], 1) for side in sides)
    away = (high - low) / (rise - fall) if rise - fall > 1e-9 else np.inf
    return float(t[lowest]) + (float(away) if abs(away) <= t[lowest + gap] - t[lowest - gap] else 0.0)


def gravity(time: FloatArray, height: FloatArray, breaks: Sequence[float]) -> tuple[float, float]:
    """Acceleration [m/s^2] along `height` and its standard error, by parabolas through the flights between `breaks`
    [s]; NaN and infinite where flights have too few frames. Times and heights are (frames,).
    """
    good = regular(time, height[:, None])
    gap = max(_CONTACT, _GAP * float(np.median(np.diff(time)))) if len(time) > 1 else _CONTACT
    values, spreads, squares, free = list[float](), list[float](), 0.0, 0
    for first, last in pairwise([-np.inf, *breaks, np.inf]):
        flight = good & (time > first + gap) & (time < last - gap)
        if flight.sum() < 5:
            continue
        d = time[flight] - time[flight].mean()
        matrix = np.stack([np.ones_like(d), d, 0.5 * d**2], axis=1)
        found, _rest, rank, _ = np.linalg.lstsq(matrix, height[flight], rcond=None)
        if rank < 3:
            continue
        rest = height[flight] - matrix @ found
        values.append(float(found[2]))
        spreads.append(float(np.linalg.inv(matrix.T @ matrix)[2, 2]))
        squares, free = squares + float(rest @ rest), free + len(d) - 3
    if free < _FREE:
        return float("nan"), float("inf")
    weights = 1.0 / np.array(spreads)
    return float(np.average(values, weights=weights)), (max(squares / free, 1e-14) / float(weights.sum())) ** 0.5


def noise(time: FloatArray, position: FloatArray) -> float:
    """Standard deviation of a coordinate about parabolas through seven frames: the median over such windows; NaN for
    fewer frames.
    """
    if len(time) < _SPAN:
        return float("nan")
    step = max(1, (len(time) - _SPAN + 1) // _WINDOWS)
    times = sliding_window_view(time, _SPAN)[::step]
    places = sliding_window_view(position, _SPAN, axis=0)[::step]
    d = times - times.mean(axis=1, keepdims=True)
    d = d / np.abs(d).max(axis=1, keepdims=True)
    base, _ = np.linalg.qr(np.stack([np.ones_like(d), d, d**2], axis=2))
    rest = places - np.einsum("wik,wjk,waj->wai", base, base, places)
    variances = (rest**2).sum(axis=(1, 2)) / ((_SPAN - 3) * position.shape[1])
    return float(np.sqrt(np.median(variances)))
