"""Small compact things that move, in each frame of a film that is read once: made smaller, compared
with the background about that time and with earlier and later frames.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from fitball.base.progress import Progress
from fitball.base.values import FloatArray, IntArray
from fitball.video import kernels
from fitball.video.shake import Steadying
from fitball.video.types import Clip, Frame, Look, Plane

# Columns of a picture in which balls are looked for: at least so many, and less than twice that.
_COLUMNS = 350
# Time over which the background is seen, before and after [s]; it is renewed more often.
_MEMORY = 0.6
_RENEWAL = 0.15
# Frames that are kept on each side, and those of which the background is the median, at most.
_MOST_KEPT = 160
_MEDIAN_OF = 15
# Times between which a ball moves by a part of its width and by several [s].
_LAGS = (0.009, 0.028, 0.085)
# Differences are in units of so many sds of the noise; so many units are a change.
_NOISE_UNITS = 1.5
_LEAST_CHANGE = 5.0
# Strength that counts at most at the shortest lag: outlines of what moves slowly, two pixels wide,
# are no change then, and do not join a ball before them.
_LEAST_SOLID = 7.1
# Things of a frame that are measured, and those that are kept, at most.
_MOST_THINGS = 400
_MOST_SPOTS = 40
# Two spots in one place are one thing if their radii differ by less than this factor.
_ALIKE = 1.6
# Pixels from which gains and noise are estimated: one of so many in each direction.
_SPARSE = 7
# Shifts of the camera below this [px of the smaller picture] leave the picture as it is.
_STILL = 0.1
# Share of frames whose shift is not that of the background, up to which shifts are known.
_MOST_UNCONFIRMED = 0.2
# Frames of which the picture of the page is the median.
_SHOWN = 15


@dataclass(frozen=True, eq=False)
class Spots:
    """What is found in the frames of a clip: of each an array (spots, 4) of x, y, radius across the
    motion [px] and strength. `shifts` (frames, 2) are those of the camera [px], `background` is the
    median picture, `known` whether it has structure enough to know shifts; else they are 0.
    """

    numbers: IntArray
    times: FloatArray
    found: list[Annotated[FloatArray, "spots 4"]]
    shifts: Annotated[FloatArray, "frames 2"]
    known: bool
    background: Annotated[Plane, "rows columns"]


def spots_of(clip: Clip, look: Look, progress: Progress) -> Spots:
    """All spots of a clip, in one reading of it."""
    window = _Window(clip, look)
    wanted = set(np.linspace(0, clip.count - 1, min(clip.count, _SHOWN)).astype(int).tolist())
    shown = []
    numbers, times, shifts = [], [], []
    found: list[FloatArray] = []
    for k, frame in enumerate(clip.frames()):
        progress("finding the ball", k / max(clip.count, 1))
        if k in wanted:
            shown.append(frame.luma.copy())
        numbers.append(frame.number)
        times.append(frame.time)
        shifts.append(window.add(frame))
        found.extend(window.ready())
    found.extend(window.rest())
    background = np.empty_like(shown[0])
    kernels.median(np.array(shown), background)
    known = window.knows_shifts
    return Spots(
        np.array(numbers),
        clip.filmed(np.array(times)),
        found,
        np.array(shifts) * window.unit * known,
        known,
        background,
    )


class _Window:
    """The frames about the one in which spots are looked for: smaller, steadied, three planes."""

    def __init__(self, clip: Clip, look: Look) -> None:
        self.unit = max(1, clip.width // _COLUMNS)
        self.shape = (clip.height // self.unit, clip.width // self.unit)
        rate = clip.camera_rate
        lags = sorted({max(1, round(lag * rate)) for lag in _LAGS})
        self.lags = np.array(lags)
        self.side = int(min(max(_MEMORY * rate, lags[-1] + 1, 8), _MOST_KEPT))
        self.renewal = max(1, round(_RENEWAL * rate))
        self.look = look
        size = self.shape[0] * self.shape[1]
        self.slots = 2 * self.side + 1
        self.frames = np.zeros((self.slots, 3, size), np.uint8)
        self.change = np.zeros((3, size), np.float32)
        self.labels = np.zeros(self.shape, np.int32)
        self.gains = np.zeros((self.slots, 3), np.float32)
        self.rated: deque[tuple[int, int]] = deque(maxlen=self.slots)
        self.back = np.zeros((3, size), np.uint8)
        self.weights = np.ones(3, np.float32)
        self.renewed = -1
        self.added = 0
        self.done = 0
        self.steadying: Steadying | None = None
        self.unconfirmed = 0
        self.sparse = _sparse(self.shape)

    def add(self, frame: Frame) -> Annotated[FloatArray, "2"]:
        """Take a frame in; how far the camera had moved [px of the smaller picture]."""
        luma = np.empty(self.shape, np.uint8)
        kernels.reduced(np.ascontiguousarray(frame.luma), self.unit, luma)
        if self.steadying is None:
            self.steadying = Steadying(luma)
        moved = self._moved(self.steadying, luma)
        planes = [luma, *_colours(frame, self.shape)]
        slot = self.frames[self.added % self.slots]
        for plane, out in zip(planes, slot, strict=True):
            if np.abs(moved).max() > _STILL:
                kernels.moved(plane, float(moved[0]), float(moved[1]), out.reshape(self.shape))
            else:
                out[:] = plane.ravel()
        self.added += 1
        return moved

    def _moved(self, steadying: Steadying, luma: Plane) -> Annotated[FloatArray, "2"]:
        """How far the camera had moved, 0 where that does not lead back to the first picture."""
        shift = steadying.shift(luma)
        if 2.0 * np.abs(shift).max() <= _STILL or steadying.confirms(luma, shift):
            return 2.0 * shift
        steadying.last = np.zeros(2)
        self.unconfirmed += 1
        return np.zeros(2)

    @property
    def knows_shifts(self) -> bool:
        """Whether shifts of the camera are those of the background."""
        if self.steadying is None or not self.steadying.known:
            return False
        return self.unconfirmed <= _MOST_UNCONFIRMED * self.added

    def ready(self) -> Iterator[FloatArray]:
        """Spots of the frames of which enough later ones are there."""
        while self.done + self.side < self.added:
            yield self._spots()

    def rest(self) -> Iterator[FloatArray]:
        """Spots of the last frames."""
        while self.done < self.added:
            yield self._spots()

    def _spots(self) -> Annotated[FloatArray, "spots 4"]:
        now = self.done
        self.done += 1
        if self.renewed < 0 or now - self.renewed >= self.renewal:
            self._renew(now)
        pairs = np.full((len(self.lags), 2), -1)
        for row, lag in zip(pairs, self.lags, strict=True):
            for side, then in enumerate((now - lag, now + lag)):
                if 0 <= then < self.added and then > self.added - 1 - self.slots:
                    row[side] = then % self.slots
                    self._rate(then)
        self._rate(now)
        kernels.changes(
            self.frames,
            self.gains,
            now % self.slots,
            pairs,
            self.back,
            self.weights,
            self.change,
        )
        spots: list[tuple[float, float, float, float]] = []
        for which in (1, 2, 0):
            change = self.change[which].reshape(self.shape)
            cap = _LEAST_SOLID if which == 2 else np.inf
            things = kernels.things(change, _LEAST_CHANGE, cap, self.labels, _MOST_THINGS)
            for spot in _compact(things, self.shape, self.unit, self.look):
                if all(_apart(spot, other) for other in spots):
                    spots.append(spot)
        spots.sort(key=lambda spot: -spot[3] * spot[2])
        return np.array(spots[:_MOST_SPOTS]).reshape(-1, 4)

    def _renew(self, now: int) -> None:
        """The background about this frame, and the noise of the planes."""
        self.renewed = now
        first, last = max(0, self.added - self.slots), self.added - 1
        count = min(_MEDIAN_OF, last - first + 1)
        numbers = np.linspace(first, last, count).astype(int) % self.slots
        few = self.frames[numbers]
        kernels.median(few, self.back)
        self.rated.clear()
        off = np.abs(few[:, :, self.sparse].astype(np.int16) - self.back[:, self.sparse])
        sd = 1.48 * np.median(off, axis=(0, 2))
        self.weights = (1.0 / (_NOISE_UNITS * np.maximum(sd, 1.0))).astype(np.float32)

    def _rate(self, number: int) -> None:
        """How much brighter than the background a frame is."""
        if (number, self.renewed) in self.rated:
            return
        frame = self.frames[number % self.slots][:, self.sparse].astype(np.int16)
        self.gains[number % self.slots] = np.median(frame - self.back[:, self.sparse], axis=1)
        self.rated.append((number, self.renewed))


def _sparse(shape: tuple[int, int]) -> IntArray:
    grid = np.arange(shape[0] * shape[1]).reshape(shape)
    return grid[::_SPARSE, ::_SPARSE].ravel()


def _colours(frame: Frame, shape: tuple[int, int]) -> list[Plane]:
    """The colour differences at the pixels of the smaller picture."""
    planes = []
    for which in (0, 1):
        small = np.empty(shape, np.uint8)
        kernels.nearest(frame.chroma[..., which], small)
        planes.append(small)
    return planes


def _compact(
    things: Annotated[FloatArray, "things 11"],
    shape: tuple[int, int],
    unit: int,
    look: Look,
) -> Iterator[tuple[float, float, float, float]]:
    """x, y, radius [px] and strength of the things that may be a ball, smeared by its motion."""
    if not len(things):
        return
    area = things[:, kernels.AREA]
    wide = things[:, kernels.RIGHT] - things[:, kernels.LEFT] + 1
    high = things[:, kernels.BOTTOM] - things[:, kernels.TOP] + 1
    shorter, longer = np.minimum(wide, high), np.maximum(wide, high)
    likely = (shorter >= 3) & (longer <= 0.3 * min(shape) + 12) & (area >= 9)
    likely &= (area >= 0.3 * wide * high) & (longer <= 4 * shorter)
    things, area = things[likely], area[likely]
    x, y = things[:, kernels.X] / area, things[:, kernels.Y] / area
    xx = things[:, kernels.XX] / area - x * x + 1 / 12
    yy = things[:, kernels.YY] / area - y * y + 1 / 12
    xy = things[:, kernels.XY] / area - x * y
    # Across its motion a smeared ball keeps its width.
    across = 0.5 * (xx + yy) - np.hypot(0.5 * (xx - yy), xy)
    radius = np.maximum(2.0 * np.sqrt(across) - 1.2, 1.0)
    for k in range(len(things)):
        at = (float((x[k] + 0.5) * unit - 0.5), float((y[k] + 0.5) * unit - 0.5))
        if look.region is None or _within(at, look.region):
            yield *at, float(radius[k] * unit), float(things[k, kernels.STRENGTH] / area[k])


def _within(at: tuple[float, float], region: tuple[int, int, int, int]) -> bool:
    left, top, wide, high = region
    return left <= at[0] < left + wide and top <= at[1] < top + high


def _apart(spot: tuple[float, ...], other: tuple[float, ...]) -> bool:
    """Whether two spots are not one thing found twice."""
    gap = np.hypot(spot[0] - other[0], spot[1] - other[1])
    alike = max(spot[2], other[2]) < _ALIKE * min(spot[2], other[2])
    return bool(gap > 0.7 * max(spot[2], other[2])) or not alike
