"""What positions show without a model of flight: velocities before and after a bounce, acceleration between, noise.

Windows of frames are fitted by lines and parabolas. Nothing here is an estimate of an impact: it says which way is
up, whether the clock is right, and where a ball bounces.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fitball.values import FloatArray

# Frames are averaged in blocks of about this time [s], and this long around a bounce left out on either side.
_BLOCK, _CONTACT = 1.4e-3, 3.0e-3
_WINDOW = 6
# Frames over which noise is estimated, and how many windows of a clip are.
_SPAN, _WINDOWS = 7, 400
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


def gravity(time: FloatArray, height: FloatArray, bounce: float | None) -> tuple[float, float]:
    """Acceleration [m/s^2] along `height` and its standard error, by parabolas before and after `bounce` [s]; NaN and
    infinite where neither side has five frames.
    """
    sides = [time >= -np.inf] if bounce is None else [time < bounce - _CONTACT, time > bounce + _CONTACT]
    values, weights = list[float](), list[float]()
    for side in sides:
        t = time[side]
        if len(t) < 5:
            continue
        # The flight nearest to the bounce: further away a clip may hold another.
        near = np.abs(t - (t[0] if bounce is None else bounce)) < 0.3
        if near.sum() < 5:
            continue
        d = t[near] - t[near].mean()
        matrix = np.stack([np.ones_like(d), d, 0.5 * d**2], axis=1)
        found, _rest, rank, _ = np.linalg.lstsq(matrix, height[side][near], rcond=None)
        if rank < 3:
            continue
        rest = height[side][near] - matrix @ found
        variance = max(float(rest @ rest) / max(len(d) - 3, 1), 1e-14) * np.linalg.inv(matrix.T @ matrix)[2, 2]
        values.append(float(found[2]))
        weights.append(1.0 / float(variance))
    if not values:
        return float("nan"), float("inf")
    total = sum(weights)
    return float(np.average(values, weights=weights)), total**-0.5


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
