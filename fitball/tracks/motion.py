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
_WINDOW = 6
# Frames over which noise is estimated, and how many windows of a clip are.
_SPAN, _WINDOWS = 7, 400
# A bounce is deeper than so many standard deviations of the noise, and than this share of the heights of a clip.
_DEEP, _SHARE = 8.0, 0.01
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
    if len(time) < 7:
        return None
    t, r = thinned(time, position)
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
    t, y = thinned(time, height[:, None])
    spread = noise(t, y)
    smooth = median_filter(y[:, 0], size=3, mode="nearest")
    deep = max(_DEEP * spread if isfinite(spread) else 0.0, _SHARE * float(np.ptp(smooth)))
    peaks, _ = find_peaks(-smooth, prominence=max(deep, 1e-9))
    return np.array([int(np.argmin(np.abs(time - t[peak]))) for peak in peaks], dtype=np.int64)


def gravity(time: FloatArray, height: FloatArray, breaks: Sequence[float]) -> tuple[float, float]:
    """Acceleration [m/s^2] along `height` and its standard error, by parabolas through the flights between `breaks`
    [s]; NaN and infinite where no flight has five frames. Times and heights are (frames,).
    """
    gap = max(_CONTACT, _GAP * float(np.median(np.diff(time)))) if len(time) > 1 else _CONTACT
    values, weights = list[float](), list[float]()
    for first, last in pairwise([-np.inf, *breaks, np.inf]):
        flight = (time > first + gap) & (time < last - gap)
        if flight.sum() < 5:
            continue
        d = time[flight] - time[flight].mean()
        matrix = np.stack([np.ones_like(d), d, 0.5 * d**2], axis=1)
        found, _rest, rank, _ = np.linalg.lstsq(matrix, height[flight], rcond=None)
        if rank < 3:
            continue
        rest = height[flight] - matrix @ found
        variance = max(float(rest @ rest) / max(len(d) - 3, 1), 1e-14) * np.linalg.inv(matrix.T @ matrix)[2, 2]
        values.append(float(found[2]))
        weights.append(1.0 / float(variance))
    if not values:
        return float("nan"), float("inf")
    return float(np.average(values, weights=weights)), sum(weights) ** -0.5


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
