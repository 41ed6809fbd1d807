"""How far the texture of a ball is turned in each frame: light stands still, texture turns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from fitball.base.values import FloatArray, IntArray
from fitball.video.views import GAMMA, View

ComplexArray = NDArray[np.complex128]
# Rings on which brightness is read [radii], points on each, and orders of its waves.
_RINGS = np.linspace(0.2, 0.85, 12)
_POINTS = 180
_ORDERS = 25
# Up to this order light makes waves too.
_LIGHT_ORDERS = 3
# Spins that are tried [rad/s]; a flight of fewer frames shows none.
_FASTEST = 900.0
_LEAST_FRAMES = 5
# Other spins that explain this share of what the best one does are candidates.
_CANDIDATE = 0.6
_MOST_CANDIDATES = 4
# A spin is seen if it explains this share of what changes.
_SEEN = 0.5
# An angle is one if texture agrees with that of the others so well.
_AGREEMENT = 0.5
# Places in a turn at which texture is compared; it has a fold if it agrees so well with itself
# turned by a part of a turn.
_TURN = 3600
_FOLDED = 0.85
_FOLDS = (4, 3, 2)


class Spin(NamedTuple):
    """A spin in the picture [rad/s, counterclockwise], and the share of the changes of brightness
    that it explains.
    """

    value: float
    share: float


class Marks(NamedTuple):
    """Angles [rad, counterclockwise in the picture] (frames,) modulo a turn over `fold`, NaN where
    none is seen, how well texture agrees there, and the likely spins of each flight.
    """

    angle: FloatArray
    agreement: FloatArray
    fold: int
    spins: tuple[tuple[Spin, ...], ...]


def marks_of(
    views: Sequence[View],
    places: Annotated[FloatArray, "frames 3"],
    times: Annotated[FloatArray, "frames"],
    flights: Sequence[IntArray],
    rate: float,
) -> Marks:
    """The marks of a ball in its views, at places (x, y, radius) [px]; `flights` are the rows of
    each flight. Angles start from the mean texture of the flight that shows it best.
    """
    waves = _waves(views, places)
    angle = np.full(len(views), np.nan)
    agreement = np.zeros(len(views))
    able = [k for k, rows in enumerate(flights) if len(rows) >= _LEAST_FRAMES]
    spins: list[tuple[Spin, ...]] = [()] * len(flights)
    for k in able:
        spins[k] = _Turning(waves[flights[k]], times[flights[k]], None).spins(rate)

    def clearness(k: int) -> float:
        """How well a flight shows texture apart from light: turned far, and well explained."""
        if not spins[k]:
            return 0.0
        turned = abs(spins[k][0].value) * float(np.ptp(times[flights[k]]))
        return spins[k][0].share * min(turned, 6.0)

    light: ComplexArray | None = None
    texture: ComplexArray | None = None
    for k in sorted(able, key=clearness, reverse=True):
        turning = _Turning(waves[flights[k]], times[flights[k]], light)
        if light is not None:
            spins[k] = turning.spins(rate)
        if not spins[k] or spins[k][0].share < _SEEN:
            continue
        if light is None or texture is None:
            texture, light = turning.parts(spins[k][0].value)
        for row in flights[k]:
            angle[row], agreement[row] = _angle(waves[row] - light, texture)
    angle[agreement < _AGREEMENT] = np.nan
    return Marks(angle, agreement, 1 if texture is None else _fold(texture), tuple(spins))


def _waves(
    views: Sequence[View],
    places: FloatArray,
) -> Annotated[ComplexArray, "frames rings orders"]:
    """Waves of brightness about the centre on each ring, counterclockwise in the picture."""
    theta = np.arange(_POINTS) * 2.0 * np.pi / _POINTS
    rings = []
    for view, (x, y, radius) in zip(views, places, strict=True):
        across = x - view.left + radius * np.outer(_RINGS, np.cos(theta))
        down = y - view.top - radius * np.outer(_RINGS, np.sin(theta))
        light = map_coordinates(view.image[0], [down, across], order=1, mode="nearest")
        level = light ** (1.0 / GAMMA)
        rings.append(level / level.mean() * np.sqrt(_RINGS / _RINGS[-1])[:, None])
    waves = np.fft.rfft(np.array(rings), axis=2)[:, :, :_ORDERS]
    waves[:, :, 0] = 0.0
    return np.asarray(waves)


class _Turning:
    """The waves of one flight as texture that turns and light that stands still; the `light` of
    another flight is known, or None.
    """

    def __init__(
        self,
        waves: Annotated[ComplexArray, "frames rings orders"],
        times: FloatArray,
        light: ComplexArray | None,
    ) -> None:
        self.light = light
        self.waves = waves if light is None else waves - light
        self.times = times - times.mean()
        self.orders = np.arange(waves.shape[2])
        self.low = self.orders <= _LIGHT_ORDERS
        self.mean = self.waves.mean(0)
        power = (np.abs(self.waves) ** 2).sum(0)
        spread = (np.abs(self.waves - self.mean) ** 2).sum(0)
        self.total = float(np.where(self.low & (light is None), spread, power).sum())

    def spins(self, rate: float) -> tuple[Spin, ...]:
        """The likely spins, the best first."""
        fine = 0.5 / float(np.ptp(self.times))
        fastest = min(np.pi * rate, _FASTEST)
        grid = np.arange(-fastest, fastest, fine)
        share = self._share(grid)
        peaks = np.flatnonzero((share > np.roll(share, 1)) & (share >= np.roll(share, -1)))
        best = []
        for peak in peaks[np.argsort(-share[peaks])][:_MOST_CANDIDATES]:
            near = grid[peak] + np.linspace(-fine, fine, 21)
            values = self._share(near)
            top = int(np.argmax(values))
            best.append(Spin(float(near[top]), float(values[top])))
        best.sort(key=lambda spin: -spin.share)
        return tuple(spin for spin in best if spin.share > _CANDIDATE * best[0].share)

    def _share(self, spins: Annotated[FloatArray, "spins"]) -> Annotated[FloatArray, "spins"]:
        """The share of the changes that texture of each spin explains."""
        gain = np.zeros(len(spins))
        count = len(self.times)
        first = np.exp(1j * np.outer(spins, self.times))
        turn = np.ones_like(first)
        for order in self.orders[1:]:
            turn *= first
            texture = turn @ self.waves[:, :, order] / count
            if self.low[order] and self.light is None:
                mean = turn.mean(1)
                left = 1.0 - np.abs(mean) ** 2 + 0.05
                apart = texture - mean[:, None] * self.mean[:, order]
                gain += (np.abs(apart) ** 2).sum(1) / left
            else:
                gain += (np.abs(texture) ** 2).sum(1)
        return np.asarray(count * gain / max(self.total, 1e-12))

    def parts(self, spin: float) -> tuple[ComplexArray, ComplexArray]:
        """Texture at the middle of the flight, and light, of this spin (rings, orders)."""
        turn = np.exp(1j * spin * np.outer(self.times, self.orders))
        texture = np.einsum("ko,kro->ro", turn, self.waves) / len(self.times)
        if self.light is not None:
            return texture, self.light
        mean = turn.mean(0)
        left = 1.0 - np.abs(mean) ** 2 + 0.05
        texture = np.where(self.low, (texture - mean * self.mean) / left, texture)
        still = np.where(self.low, self.mean - np.conj(mean) * texture, 0.0)
        return texture, still


def _angle(waves: ComplexArray, texture: ComplexArray) -> tuple[float, float]:
    """By how much waves are turned against the texture, and how well they agree then."""
    agreement = _turned(waves, texture)
    size = np.sqrt((np.abs(waves) ** 2).sum() * (np.abs(texture) ** 2).sum())
    best = int(np.argmax(agreement))
    return 2.0 * np.pi * best / _TURN, float(agreement[best] / max(size, 1e-12))


def _turned(waves: ComplexArray, texture: ComplexArray) -> Annotated[FloatArray, "turn"]:
    """How well waves agree with the texture, turned by each part of a turn."""
    cross = (waves * np.conj(texture)).sum(0)
    padded = np.pad(cross, (0, _TURN // 2 + 1 - cross.size))
    return np.asarray(np.fft.irfft(padded, _TURN) * _TURN / 2)


def _fold(texture: ComplexArray) -> int:
    """How often texture looks the same in a turn."""
    agreement = _turned(texture, texture)
    for fold in _FOLDS:
        if agreement[_TURN // fold] > _FOLDED * agreement[0]:
            return fold
    return 1
