"""The look of a ball over its disc: light that stands still, times a texture that turns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from fitball.base.values import BoolArray, FloatArray, IntArray
from fitball.video import kernels
from fitball.video.disc import Disc
from fitball.video.marks import Marks

# Places of a look in each direction, and over how many of them it is smoothed.
_SIZE = 41
_PLACES_PER_RADIUS = (_SIZE - 1) / (2.0 * kernels.LOOK)
_SMOOTH = 0.7
_AXIS = np.linspace(-kernels.LOOK, kernels.LOOK, _SIZE)
_U, _V = np.meshgrid(_AXIS, _AXIS)
# Rings of places.
_RINGS = (np.hypot(_U, _V) * _PLACES_PER_RADIUS).astype(int)
# From 1 within to 0 at the rim.
_INNER = np.clip((1.0 - np.hypot(_U, _V)) / 0.1, 0.0, 1.0)
# Pixels of which the ball covers this share show it.
_COVERED = 0.3
# Fewest frames whose angles are known, by which texture is taken apart from light; how often.
_LEAST_ANGLES = 8
_TIMES = 4
# Where pixels of this weight show a place it is as they say, where fewer do as without texture.
_WEIGHT = 2.0
# Brightness below this share of the mean shows no texture.
_DARKEST = 0.1


class _Pixels(NamedTuple):
    """Pixels of several frames that show the ball: of each the `row` of its frame, its `place` on
    the disc, its weight, and its brightness if the ball covered all of it.
    """

    row: Annotated[IntArray, "pixels"]
    place: Annotated[FloatArray, "2 pixels"]
    weight: Annotated[FloatArray, "pixels"]
    brightness: Annotated[FloatArray, "channels pixels"]

    def chosen(self, use: Annotated[BoolArray, "pixels"]) -> _Pixels:
        """Some of the pixels."""
        return _Pixels(self.row[use], self.place[:, use], self.weight[use], self.brightness[:, use])


def _pixels(discs: Sequence[Disc], fits: Annotated[FloatArray, "frames 7"]) -> _Pixels:
    """The pixels that show the ball in frames where it is seen clearly."""
    channels = len(discs[0].noise) if discs else 0
    parts = [
        _Pixels(np.zeros(0, int), np.zeros((2, 0)), np.zeros(0), np.zeros((channels, 0))),
    ]
    for row, (disc, fit) in enumerate(zip(discs, fits, strict=True)):
        covers, place = disc.lit(fit)
        use = covers[0] > _COVERED
        if not use.any():
            continue
        covers = covers[:, use]
        image, back = disc.image[:, use], disc.back[:, use]
        seen = (image - (1.0 - covers) * back) / covers
        weight = covers[0] ** 2
        # Frames are as bright as each other.
        seen /= np.average(seen, axis=1, weights=weight)[:, None]
        parts.append(_Pixels(np.full(weight.size, row), place[:, use], weight, seen))
    return _Pixels(
        np.concatenate([part.row for part in parts]),
        np.concatenate([part.place for part in parts], axis=1),
        np.concatenate([part.weight for part in parts]),
        np.concatenate([part.brightness for part in parts], axis=1),
    )


def dress(
    discs: Sequence[Disc],
    fits: Annotated[FloatArray, "frames 7"],
    marks: Marks,
    clear: Annotated[BoolArray, "frames"],
    luma: Annotated[FloatArray, "9"],
    at_rim: bool,
) -> bool:
    """Give each disc the light and the look of the ball, with marks turned by its angle, from the
    frames that show it clearly as discs `fits`. `luma` are the shades of luma; what stands still
    differs from them at the rim only if it may, `at_rim`, where it can make up for a radius that is
    off. False where no frame shows the ball.
    """
    rows = np.flatnonzero(clear)
    pixels = _pixels([discs[k] for k in rows.tolist()], fits[rows])
    if not pixels.row.size:
        return False
    light = _light(pixels)
    plain = luma @ _shades(pixels.place)
    light[0] = luma * (pixels.brightness[0] @ plain) / (plain @ plain)
    bound = 1.0 if at_rim else _INNER
    still = _map(pixels.place, pixels, _shaded(light, pixels.place))
    still = 1.0 + bound * (still - 1.0)
    own = still
    texture = np.ones_like(still)
    angles = marks.angle[rows]
    if np.isfinite(angles).sum() >= _LEAST_ANGLES:
        pixels = pixels.chosen(np.isfinite(angles[pixels.row]))
        turned = _turned(pixels.place, angles[pixels.row])
        plain = _shaded(light, pixels.place)
        own = np.ones_like(still)
        for _ in range(_TIMES):
            texture = _even(_map(turned, pixels, plain * _sampled(own, pixels.place)))
            own = _map(pixels.place, pixels, plain * _sampled(texture, turned))
            own = 1.0 + bound * (own - 1.0)
    grid = np.stack([_U, _V])
    for disc, turn in zip(discs, marks.angle, strict=True):
        look = still
        if np.isfinite(turn):
            look = own * _sampled(texture, _turned(grid, turn))
        disc.dress(light, look)
    return True


def _turned(place: FloatArray, angle: FloatArray | float) -> FloatArray:
    """Places of the ball (2, ...) turned back by an angle counterclockwise in the picture."""
    cos, sin = np.cos(angle), np.sin(angle)
    u, v = place
    return np.stack([cos * u - sin * v, sin * u + cos * v])


def _shades(place: FloatArray) -> FloatArray:
    """The functions of brightness (9, ...) of the kernel (`kernels.SHADES`) at places (2, ...)."""
    u, v = place
    h = np.sqrt(np.maximum(1.0 - u * u - v * v, 0.0))
    return np.stack([np.ones_like(u), u, v, h, u * v, u * h, v * h, u * u - v * v, 3 * h * h - 1])


def _light(pixels: _Pixels) -> Annotated[FloatArray, "channels 9"]:
    """The shades that explain the brightness of a ball."""
    root = np.sqrt(pixels.weight)
    design = (_shades(pixels.place) * root).T
    return np.asarray(np.linalg.lstsq(design, (pixels.brightness * root).T, rcond=None)[0].T)


def _shaded(light: FloatArray, place: FloatArray) -> FloatArray:
    return np.maximum(light @ _shades(place), _DARKEST)


def _map(
    place: Annotated[FloatArray, "2 pixels"],
    pixels: _Pixels,
    plain: Annotated[FloatArray, "channels pixels"],
) -> Annotated[FloatArray, "channels n n"]:
    """By what factor pixels are brighter than `plain`, at each place of a look."""
    u, v = (place + kernels.LOOK) * _PLACES_PER_RADIUS
    column, row = u.astype(int), v.astype(int)
    right, low = u - column, v - row
    corners = [
        (row * _SIZE + column, (1.0 - right) * (1.0 - low)),
        (row * _SIZE + column + 1, right * (1.0 - low)),
        ((row + 1) * _SIZE + column, (1.0 - right) * low),
        ((row + 1) * _SIZE + column + 1, right * low),
    ]

    def gathered(values: Annotated[FloatArray, "pixels"]) -> Annotated[FloatArray, "n n"]:
        """Sums of values about each place."""
        flat = np.zeros(_SIZE**2)
        for at, share in corners:
            flat += np.bincount(at, share * values, minlength=_SIZE**2)
        return np.asarray(gaussian_filter(flat.reshape(_SIZE, _SIZE), _SMOOTH))

    factors = []
    for seen, base in zip(pixels.brightness, plain, strict=True):
        prior = _WEIGHT * float(np.mean(base * base))
        products = gathered(seen * base * pixels.weight) + prior
        squares = gathered(base * base * pixels.weight) + prior
        factors.append(np.maximum(products / squares, _DARKEST))
    return np.stack(factors)


def _even(look: Annotated[FloatArray, "channels n n"]) -> Annotated[FloatArray, "channels n n"]:
    """A look whose mean over each ring is 1: no more than marks."""
    means = [np.bincount(_RINGS.ravel(), channel.ravel()) for channel in look]
    counts = np.bincount(_RINGS.ravel())
    return np.stack(
        [channel / (mean / counts)[_RINGS] for channel, mean in zip(look, means, strict=True)]
    )


def _sampled(look: Annotated[FloatArray, "channels n n"], place: FloatArray) -> FloatArray:
    """A look (channels, ...) at places (2, ...) of the disc."""
    at = (place[::-1] + kernels.LOOK) * _PLACES_PER_RADIUS
    return np.stack([map_coordinates(channel, at, order=1, mode="nearest") for channel in look])
