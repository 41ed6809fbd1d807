"""Discs of one ball in all frames: what they share (exposure, blur, radius) and the row time, by
which a ball that moves is longer and leans.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from fitball.base.values import FloatArray, IntArray
from fitball.video.disc import (
    BLUR,
    EXPOSURE,
    LEAST_NOISE,
    PLACE,
    PLACE_AND_RADIUS,
    SHAPE,
    Disc,
    Fitted,
    turned_light,
)
from fitball.video.shared import common_of
from fitball.video.shutter import Shapes, Shutter, shutter_of
from fitball.video.types import Clip, Estimate
from fitball.video.views import Course, View

# A disc is seen if it explains so much of the difference from the background.
SEEN = 0.4
CLEAR = 0.5
# Fewest frames in which it is.
LEAST_FRAMES = 6
# Exposure [share of the time between frames] and blur [px] from which fits start.
_USUAL_EXPOSURE = 0.3
_USUAL_BLUR = 0.9
# Frames by which exposure and blur are found.
_CLEAR_FRAMES = 24
# A disc beyond what was seen is this near where its flight goes on, in radii and pixels; after so
# many that are not the ball is gone.
_NEAR_RADII = 0.35
_NEAR_PX = 1.0
_MOST_LOST = 2
# Radii are smoothed over so many frames on each side.
_SMOOTH = 15


@dataclass(frozen=True, eq=False)
class Discs:
    """The ball in its frames: discs `p` (frames, 7) and their sds, `quality`, and `radius_free`
    where the radius of each frame was free. What it says of the camera: exposure [s], blur [px] and
    row time [s/px].
    """

    frames: Annotated[IntArray, "frames"]
    times: Annotated[FloatArray, "frames"]
    p: Annotated[FloatArray, "frames 7"]
    sd: Annotated[FloatArray, "frames 7"]
    quality: Annotated[FloatArray, "frames"]
    radius_free: Annotated[FloatArray, "frames"]
    exposure: float
    blur: float
    row_time: Estimate
    views: Mapping[int, View]

    @property
    def radius(self) -> float:
        """The median radius [px]."""
        return float(np.median(self.p[self.quality > SEEN, 2]))


class Fitting:
    """Fits of all frames of a ball that was seen on its course with about this radius [px], one
    step after the other.
    """

    def __init__(
        self,
        clip: Clip,
        course: Course,
        views: Mapping[int, View],
        radius: float,
    ) -> None:
        self.course = course
        self.radius = radius
        self.turned = clip.readout[0] != 0
        self.direction = float(sum(clip.readout))
        self.longest = 1.0 / clip.camera_rate
        self.shared = np.array([_USUAL_EXPOSURE * self.longest, _USUAL_BLUR])
        self.views = views
        places = dict(zip(course.frames.tolist(), course.places, strict=True))
        self.places = {k: places[k] for k in views}
        self.discs: dict[int, Disc] = {}
        self.fits: dict[int, Fitted] = {}
        self.radius_sd = np.nan
        self.light: FloatArray = np.zeros(0)

    def begin(self) -> None:
        """First discs: of frames with spots, then outwards as long as they follow the flight."""
        seen = sorted(k for k in self.views if k in self.course.seen)
        for k in seen:
            self._first(k, np.zeros(2), PLACE_AND_RADIUS)
        clear = self.clear()
        if not clear:
            return
        self.radius = float(np.median([self.fits[k].p[2] for k in clear]))
        before = [k for k in sorted(self.views, reverse=True) if k < seen[0]]
        after = [k for k in sorted(self.views) if k > seen[-1]]
        for side, inner in ((before, clear[0]), (after, clear[-1])):
            off = self.fits[inner].p[:2] - self.places[inner]
            lost = 0
            for k in side:
                fit = self._first(k, off, PLACE_AND_RADIUS)
                moved = fit.p[:2] - self.places[k]
                limit = _NEAR_RADII * self.radius + _NEAR_PX
                near = np.hypot(*(moved - off)) < limit
                if fit.quality > SEEN and near and abs(np.log(fit.p[2] / self.radius)) < 0.2:
                    off = moved
                    lost = 0
                    continue
                del self.fits[k]
                lost += 1
                if lost > _MOST_LOST:
                    break

    def _first(self, k: int, off: FloatArray, free: Sequence[int]) -> Fitted:
        near = self.places[k] + off
        view = self.views[k]
        self.discs[k] = Disc(view, near, self.radius, self.turned, self.longest)
        start = np.array([*near, self.radius, 0.0, 0.0, *self.shared])
        self.fits[k] = self.discs[k].fit(start, free)
        return self.fits[k]

    def clear(self, quality: float = SEEN) -> list[int]:
        """The frames whose disc is seen."""
        return [k for k in sorted(self.fits) if self.fits[k].quality > quality]

    def weigh(self) -> None:
        """The noise of each channel by what the ball's discs leave of it."""
        scatter = np.median([self.discs[k].scatter for k in self.clear()], axis=0)
        for disc in self.discs.values():
            disc.noise = np.maximum(disc.noise * scatter, LEAST_NOISE)

    def share(self) -> None:
        """Exposure, blur, light and the radius of the ball by frames all over its flights."""
        clear = self.clear()
        usual = float(np.median([self.fits[k].quality for k in clear]))
        best = [k for k in clear if self.fits[k].quality >= usual]
        places = np.linspace(0, len(best) - 1, min(len(best), _CLEAR_FRAMES)).astype(int)
        chosen = [best[place] for place in places]
        radii = self._smooth_radii()
        starts = np.array([self.fits[k].p for k in chosen])
        starts[:, 2] = [radii[k] for k in chosen]
        starts[:, 3:5] = 0.0
        starts[:, EXPOSURE:] = self.shared
        if self.turned:
            starts[:, :2] = starts[:, 1::-1]
        discs = [self.discs[k] for k in chosen]
        brightness = np.array([disc.brightness for disc in discs])
        brightness /= np.median(brightness)
        if not self.light.size:
            self.light = np.mean([disc.shades for disc in discs], axis=0)
        common = common_of(discs, starts, self.light, brightness)
        self.radius = float(np.median([radii[k] for k in clear])) + common.radius
        self.radius_sd = common.radius_sd
        self.shared = np.array([common.exposure, common.blur])
        self.light = common.light

    def upright_light(self) -> Annotated[FloatArray, "9"]:
        """The shades of luma that all discs share, in the upright picture."""
        return turned_light(self.light) if self.turned else self.light

    def radii(self) -> dict[int, float]:
        """The radius of each frame [px]: that of the ball, as far off as the disc is there."""
        radii = self._smooth_radii()
        larger = self.radius / float(np.median([radii[k] for k in self.clear()]))
        return {k: larger * radius for k, radius in radii.items()}

    def _smooth_radii(self) -> dict[int, float]:
        """The radius of each frame [px], by those about it."""
        frames = np.array(sorted(self.fits))
        free = np.array([self.fits[k].p[2] for k in frames])
        clear = np.array([self.fits[k].quality > SEEN for k in frames])
        radii = {}
        for k in frames.tolist():
            near = clear & (np.abs(frames - k) <= _SMOOTH)
            radii[k] = float(np.median(free[near])) if near.any() else self.radius
        return radii

    def free_radii(self) -> None:
        """Radii anew with what is shared, and the radius of the ball."""
        for k, fit in self.fits.items():
            start = fit.p.copy()
            start[EXPOSURE:] = self.shared
            self.fits[k] = self.discs[k].fit(start, PLACE_AND_RADIUS)

    def shutter(
        self, flights: Sequence[IntArray], angle: Annotated[FloatArray, "frames"]
    ) -> Shutter:
        """The row time, by the shapes of discs. `flights` are the rows of each among all frames,
        `angle` is how far the ball is turned there [rad, counterclockwise in the picture], NaN
        where that is not seen.
        """
        clear = self.clear()
        rows = np.searchsorted(sorted(self.fits), clear)
        flight = np.zeros(len(self.fits), int)
        for number, of_flight in enumerate(flights):
            flight[of_flight] = number
        fits = [self.discs[k].fit(self.fits[k].p, SHAPE) for k in clear]
        # Rows count downwards, or to the right: another sense of turning.
        sense = 1.0 if self.turned else -1.0
        shapes = Shapes(
            radius=self.radius,
            frames=np.array(clear),
            flight=flight[rows],
            velocity=np.array([self._velocity(k) for k in clear]),
            angle=sense * angle[rows],
            shape=np.array([fit.p[3:5] for fit in fits]),
            sd=np.array([fit.sd[3:5] for fit in fits]),
        )
        return shutter_of(shapes)

    def _velocity(self, k: int) -> tuple[float, float]:
        """Velocity along the readout of rows and across it [px/s]."""
        x, y = self.views[k].velocity
        along, across = (x, y) if self.turned else (y, x)
        return self.direction * float(along), self.direction * float(across)

    def sized(self) -> bool:
        """Exposure, blur and radii anew; whether enough frames show the disc."""
        if len(self.clear()) < LEAST_FRAMES:
            return False
        self.weigh()
        self.share()
        self.free_radii()
        return len(self.clear()) >= LEAST_FRAMES

    def placed_again(self) -> bool:
        """Places anew, with what is shared and radii as they are; whether enough frames show the
        disc.
        """
        self.weigh()
        radii = self.radii()
        for k, fit in self.fits.items():
            start = fit.p.copy()
            start[2] = radii[k]
            again = self.discs[k].fit(start, PLACE)
            again.p[2] = fit.p[2]
            again.sd[2] = fit.sd[2]
            self.fits[k] = again
        return len(self.clear()) >= LEAST_FRAMES

    def measured(
        self, flights: Sequence[IntArray], angle: Annotated[FloatArray, "frames"]
    ) -> Discs:
        """The discs of all frames, with what they share; `flights` and `angle` as of `shutter`."""
        return self.placed(self.shutter(flights, angle))

    def rough(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """Frames, discs (frames, 7) and qualities as they were fitted last."""
        frames = np.array(sorted(self.fits))
        fits = [self.fits[k] for k in frames.tolist()]
        return frames, np.array([fit.p for fit in fits]), np.array([fit.quality for fit in fits])

    def placed(self, shutter: Shutter) -> Discs:
        """Places of all frames, with radii smoothed and shapes as the row time makes them."""
        frames = np.array(sorted(self.fits))
        free = np.array([self.fits[k].p[2] for k in frames])
        radii = self.radii()
        last = []
        for k in frames.tolist():
            start = self.fits[k].p.copy()
            start[2] = radii[k]
            velocity = np.array(self._velocity(k))
            start[3:5] = shutter.light + shutter.row_time.value * velocity
            start[EXPOSURE:] = self.shared
            last.append(self.discs[k].fit(start, PLACE))
        sd = np.array([fit.sd for fit in last])
        sd[:, 2] = [self.fits[k].sd[2] for k in frames.tolist()]
        return Discs(
            frames,
            np.array([self.views[k].time for k in frames.tolist()]),
            np.array([fit.p for fit in last]),
            sd,
            np.array([fit.quality for fit in last]),
            free,
            float(self.shared[0]),
            float(self.shared[BLUR - EXPOSURE]),
            shutter.row_time,
            self.views,
        )
