"""Types that rooms share on films: `Clip` and its `Frame`s, the `Look` at them, `Seen` and its
`Sightings`.

`films.open_film` makes clips, `find.find_balls(clip, look, progress)` what is seen in them.
Pictures are upright: turned as the file says. Pixels count from 0 at the centre of the one at the
upper left; x to the right, y down.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from fitball.base.errors import Note
from fitball.base.values import BoolArray, FloatArray, IntArray

# A plane of a picture, 0 to 255.
Plane: TypeAlias = NDArray[np.uint8]


class Estimate(NamedTuple):
    """A number with its sd."""

    value: float
    sd: float


class Frame(NamedTuple):
    """One frame of a film, upright. `number` counts the frames of the whole file from 0, `time` [s]
    is its stamp as played. `chroma` has the two colour differences (blue, red) as they are stored,
    often on half of the rows and columns.
    """

    number: int
    time: float
    luma: Annotated[Plane, "rows columns"]
    chroma: Annotated[Plane, "some_rows some_columns 2"]


@dataclass(frozen=True, eq=False)
class Clip:
    """A film, or the part of it that is asked for. `frames()` decodes its frames in order, again at
    each call, one at a time: what is to be kept is to be copied from them.

    `played_rate` [1/s] is one over the median step of the stamps, `camera_rate` [1/s] that of the
    camera, from what `rate_source` says: "option", "android tag", "apple tag" or "stamps". Time as
    filmed is the stamp over `stretch`. `readout` is the direction (x, y) in the upright picture in
    which the rows of the sensor are read, (0, 1) unless the picture was turned. `black` and `white`
    are the levels of luma. `count` is the number of frames, `byte_count` what all of their planes
    take.
    """

    name: str
    width: int
    height: int
    count: int
    times: Annotated[FloatArray, "frames"]
    played_rate: float
    camera_rate: float
    rate_source: str
    stretch: float
    readout: tuple[int, int]
    black: float
    white: float
    byte_count: int
    notes: tuple[Note, ...]
    frames: Callable[[], Iterator[Frame]]

    def filmed(self, stamps: Annotated[FloatArray, "any"]) -> Annotated[FloatArray, "any"]:
        """Times as filmed [s] of stamps [s], from the first frame of the clip."""
        return np.asarray((stamps - self.times[0]) / self.stretch)


@dataclass(frozen=True)
class Look:
    """What is looked for: a ball of this `diameter` [m], within the `region` (x, y, width, height)
    [px] if there is one; a ball that rolls along the court instead of one that bounces, if
    `rolling`. `tilt` [rad], by which the court rises to the right, and `row_time` [s/px] are stated
    or, where None, found in the picture.
    """

    diameter: float = 0.066
    region: tuple[int, int, int, int] | None = None
    rolling: bool = False
    tilt: float | None = None
    row_time: float | None = None


@dataclass(frozen=True, eq=False)
class Sightings:
    """One ball in the frames of a clip, by time; arrays (frames,). `frame` is the number in the
    film, `time` [s] as filmed, by the frame's stamp: the rows of a rolling shutter are not taken
    into account. Centres and radii with their sds [px] are in the upright picture as it is, not
    turned level. `angle` [rad] of a mark grows counterclockwise in that picture, modulo a turn over
    `fold`, and is NaN where it is not seen. `quality` is 0 to 1; frames that are not `used` are
    drawn and left out. `crops` are cut out of frames to be drawn.
    """

    id: str
    frame: IntArray
    time: FloatArray
    x: FloatArray
    y: FloatArray
    x_sd: FloatArray
    y_sd: FloatArray
    radius: FloatArray
    radius_sd: FloatArray
    angle: FloatArray
    fold: int
    quality: FloatArray
    used: BoolArray
    crops: tuple[Crop, ...] = ()


class Crop(NamedTuple):
    """A part of a frame: its number in the film, column and row of its upper left pixel, luma."""

    frame: int
    column: int
    row: int
    luma: Annotated[Plane, "rows columns"]


@dataclass(frozen=True, eq=False)
class Seen:
    """What is seen in a clip: its `balls`, and of the camera `row_time` [s/px], `tilt` [rad] by
    which level lines rise to the right (counterclockwise), `shake` [px] that was taken out, and
    `exposure` [s], NaN where it is not known. `background` is the median picture. `nothing` says
    why there is no ball, empty with one.
    """

    clip: Clip
    balls: tuple[Sightings, ...]
    row_time: Estimate
    tilt: Estimate
    shake: float
    exposure: float
    background: Annotated[Plane, "rows columns"]
    notes: tuple[Note, ...] = ()
    nothing: str = ""
