"""The fit of a blurred disc that moves before a background."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.values import FloatArray, IntArray
from fitball.video import kernels
from fitball.video.views import View

# Places of the parameters of a disc (`kernels.DISC`).
PLACE = (0, 1)
PLACE_AND_RADIUS = (0, 1, 2)
SHAPE = (0, 1, 2, 3, 4)
EXPOSURE, BLUR = 5, 6
# Pixels that are used of a large ball.
_MOST_PIXELS = 1200
# Noise of the camera is at least so large (that of half a level of 256 is more than 1e-3), and felt
# and marks are a share of the contrast.
LEAST_NOISE = 2e-3
_TEXTURE = 0.06
# Bounds of stretch, lean and blur.
_BOUNDS = ((-0.25, 0.25), (-0.35, 0.35), (0.0, np.inf), (0.35, 3.0))
_LEAST_RADIUS = 1.5
# Damping: at first, when a step was good, when it was not.
_DAMPING = 1e-3
_EASIER = 0.2
_HARDER = 8.0
_TRIALS = 5
# Shades of a ball whose light is not known yet: the first ones.
_FIRST_SHADES = 4
# The shades of a picture whose x and y are exchanged.
_TURNED = [0, 2, 1, 3, 4, 6, 5, 7, 8]
_TURNED_SIGN = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, -1.0, 1.0])
# Means of the shades over a disc.
_MEAN_SHADES = np.array([1.0, 0.0, 0.0, 2.0 / 3.0, 0.0, 0.0, 0.0, 0.0, 0.5])
# Shades that hardly differ are kept apart by this share of their weight.
_RIDGE = 1e-6
# The fit ends when the sum of squares falls by less than this share.
_CONVERGED = 5e-4


class Fitted(NamedTuple):
    """A disc: its parameters and their sds, and the share of the difference from the background
    that it explains, 0 to 1.
    """

    p: Annotated[FloatArray, "7"]
    sd: Annotated[FloatArray, "7"]
    quality: float


def turned_light(light: Annotated[FloatArray, "... 9"]) -> Annotated[FloatArray, "... 9"]:
    """Shades of a picture whose x and y are exchanged."""
    return np.asarray(light[..., _TURNED] * _TURNED_SIGN)


class Disc:
    """A view whose pixels are ready to be fitted; `near` (x, y) and `radius` [px] say where.

    Along the readout of the sensor's rows is y, across it x: with rows that are read along x
    (`turned`) both are exchanged.
    """

    def __init__(
        self,
        view: View,
        near: FloatArray,
        radius: float,
        turned: bool,
        least_frame: float,
    ) -> None:
        self.view = view
        self.turned = turned
        self.longest = least_frame
        channels, rows, columns = view.image.shape
        x = np.tile(view.left + np.arange(columns), rows)
        y = np.repeat(view.top + np.arange(rows), columns)
        far = np.hypot(x - near[0], y - near[1])
        image, back = view.image.reshape(channels, -1), view.back.reshape(channels, -1)
        outside = far > 1.25 * radius + 3.0 + 0.5e-3 * np.hypot(*view.velocity)
        noise = np.full(channels, 5e-3)
        # Brightness of the frame against that of the others.
        self.gain = 1.0
        if outside.sum() > 20:
            ratio = (back[0, outside] + 0.02) / (image[0, outside] + 0.02)
            self.gain = float(np.median(ratio))
            image = np.vstack([self.gain * image[:1], image[1:]])
            off = np.median(np.abs(image - back)[:, outside], axis=1)
            noise = np.maximum(1.48 * off, LEAST_NOISE)
        inside = far < 0.7 * radius
        if inside.any():
            contrast = np.percentile(np.abs(image - back)[:, inside], 80, axis=1)
            noise = np.hypot(noise, _TEXTURE * contrast)
        self.noise = noise
        self.softer = np.array([0.0, view.soft, view.soft])
        # Of the middle, where there is no edge, one pixel of four.
        grid = np.outer(np.arange(rows) % 2 == 0, np.arange(columns) % 2 == 0).ravel()
        keep = np.flatnonzero((far > 0.6 * radius) | grid)
        keep = keep[:: -(-len(keep) // _MOST_PIXELS)]
        self.image = np.ascontiguousarray(image[:, keep])
        self.back = np.ascontiguousarray(back[:, keep])
        x, y = x.astype(float), y.astype(float)
        self.x, self.y = (y[keep], x[keep]) if turned else (x[keep], y[keep])
        self.velocity = view.velocity[::-1].copy() if turned else view.velocity
        self.upper = 0.0
        # Brightness is any sum of the first shades until the ball's own light is known.
        self.colours = np.tile(np.eye(_FIRST_SHADES, kernels.SHADES), (channels, 1, 1))
        self.look = np.ones((channels, 2, 2))
        # Factors of the colours of the last fit.
        self.factors: FloatArray = np.zeros((channels, 0))
        # Shades of luma in the last fit, and their mean over the disc.
        self.shades = np.zeros(kernels.SHADES)
        self.brightness = 1.0
        # Residuals of each channel in the last fit over its noise.
        self.scatter: FloatArray = np.ones(channels)

    def dress(
        self,
        light: Annotated[FloatArray, "channels 9"],
        look: Annotated[FloatArray, "channels n n"],
    ) -> None:
        """Take the brightness of the ball as known but for a factor in each channel, and its look,
        marks turned, as known.
        """
        light = turned_light(light) if self.turned else light
        self.colours = np.ascontiguousarray(light[:, None, :])
        self.factors = np.zeros((len(light), 0))
        self.look = np.ascontiguousarray(np.swapaxes(look, 1, 2) if self.turned else look)

    def fit(self, start: FloatArray, free: Sequence[int], steps: int = 8) -> Fitted:
        """The disc of least squares from a start, with these parameters free."""
        p = self._turn(start)
        shape = self.colours.shape[:2]
        chosen = np.array([*free, *range(7, 7 + shape[0] * shape[1])])
        factors: FloatArray = self.factors.ravel()
        if not len(factors):
            # Brightness enters linearly: one step finds it.
            matrix, right, _ = self._normal(p, np.zeros(shape))
            factors = _solved(matrix, right, chosen[len(free) :], 0.0)
        matrix, right, sums = self._normal(p, factors.reshape(shape))
        damping = _DAMPING
        for _ in range(steps):
            for _ in range(_TRIALS):
                step = _solved(matrix, right, chosen, damping)
                trial = p.copy()
                trial[list(free)] += step[: len(free)]
                trial = self.bounded(trial)
                other = factors + step[len(free) :]
                normal = self._normal(trial, other.reshape(shape))
                if normal[2][0].sum() < sums[0].sum():
                    break
                damping *= _HARDER
            if not normal[2][0].sum() < sums[0].sum():
                break
            done = (sums[0] - normal[2][0]).sum() < _CONVERGED * sums[0].sum()
            p, factors = trial, other
            matrix, right, sums = normal
            damping *= _EASIER
            if done:
                break
        block = matrix[chosen[:, None], chosen]
        scale = sums[0].sum() / max(sums[2].sum() - len(chosen), 1.0)
        variance = np.diag(np.linalg.pinv(block))[: len(free)] * float(scale)
        sd = np.full(7, np.nan)
        sd[list(free)] = np.sqrt(np.maximum(variance, 0.0))
        rest, none, weights = sums.sum(1)
        quality = (none - rest) / max(none - min(0.95 * weights, rest), 0.3 * none)
        self.factors = factors.reshape(shape)
        self.scatter = np.sqrt(sums[0] / sums[2])
        self.shades = self.factors[0] @ self.colours[0]
        self.brightness = float(self.shades @ _MEAN_SHADES)
        return Fitted(self._turn(p), self._turn(sd), float(quality))

    def lit(
        self, fit: Annotated[FloatArray, "7"]
    ) -> tuple[Annotated[FloatArray, "channels pixels"], Annotated[FloatArray, "2 pixels"]]:
        """The share of each pixel that a disc covers, and the place (u, v) of it that is seen."""
        p = self._turn(fit)
        covers = np.empty((len(self.softer), self.x.size))
        places = np.empty((2, self.x.size))
        # Luma comes last: places are where it is seen.
        for cover, softer in zip(covers[::-1], self.softer[::-1], strict=True):
            kernels.lit(self.x, self.y, p, self.velocity, softer, cover, places)
        return covers, places[::-1] if self.turned else places

    def _normal(
        self, p: FloatArray, factors: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        normal: tuple[FloatArray, FloatArray, FloatArray] = kernels.disc(
            self.image,
            self.back,
            self.x,
            self.y,
            p,
            self.velocity,
            self.colours,
            factors,
            self.look,
            self.noise,
            self.softer,
            self.upper,
        )
        return normal

    def luma_normal(
        self,
        p: Annotated[FloatArray, "7"],
        brightness: float,
        light: Annotated[FloatArray, "9"],
    ) -> tuple[FloatArray, FloatArray, Annotated[FloatArray, "3"]]:
        """Normal equations of luma alone where all shades are free: matrix, right side, and sums of
        squares, of those of the background, of weights. The disc and its light are in the picture
        whose rows are read downwards (`levelled`).
        """
        shades = brightness * np.eye(kernels.SHADES)[None]
        matrix, right, sums = kernels.disc(
            self.image[:1],
            self.back[:1],
            self.x,
            self.y,
            p,
            self.velocity,
            shades,
            light[None],
            self.look[:1],
            self.noise[:1],
            self.softer[:1],
            self.upper,
        )
        return matrix, right, sums.sum(1)

    def bounded(self, p: FloatArray) -> FloatArray:
        """A disc within the bounds of its parameters."""
        p[2] = max(p[2], _LEAST_RADIUS)
        for place, (low, high) in zip(range(3, 7), _BOUNDS, strict=True):
            p[place] = min(max(p[place], low), high)
        p[EXPOSURE] = min(p[EXPOSURE], self.longest)
        return p

    def _turn(self, p: FloatArray) -> FloatArray:
        """Parameters with x and y exchanged if the rows are read along x."""
        return p[[1, 0, 2, 3, 4, 5, 6]] if self.turned else p.copy()


def _solved(
    matrix: FloatArray,
    right: FloatArray,
    chosen: IntArray,
    damping: float,
) -> FloatArray:
    """The step of these parameters, damped; shades that hardly matter stay."""
    block = matrix[chosen[:, None], chosen]
    diagonal = block.diagonal()
    block.flat[:: len(chosen) + 1] += (damping + _RIDGE) * diagonal + 1e-30
    return np.asarray(np.linalg.solve(block, right[chosen]))
