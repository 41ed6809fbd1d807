"""The court in the picture, as a line of centres of a ball that touches it: of a ball that was
rolled along it, or through two points of the court. Tracks are turned and moved so that it is level
and at height zero.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace as changed

from fitball.base.display_units import DEG, MM
from fitball.base.errors import Fault, InputError, Note, ParameterError
from fitball.base.text import one_line
from fitball.base.values import FloatArray
from fitball.data.scene import CameraSection, ValueWithSd
from fitball.tracks.types import Track

# Fewest frames of a ball that rolls.
_FEWEST_ROLLED = 8
# A line is followed over at least so many radii of the ball: a ball that lies shows no slope.
_LEAST_WAY = 6.0
# The centre of a ball that rolls is within this share of its radius of a line.
_MOST_OFF_LINE = 0.25
# Frames whose errors count as one: felt and mark move the edge of a disc for as long.
_LASTING_FRAMES = 6.0
# The disc of a ball on the court, and of one in the air, may differ by so many pixels,
_DISC_SD_PX = 0.1
# and felt that carries the ball gives way by about so much [m].
_FELT_SD = 1e-4
# Balls fly and roll at distances from the camera that differ by this relative sd: the radius by
# which centres are above the court is larger or smaller in the picture by as much.
DISTANCE_SD = 0.01
# How far off [px] a point of the court in a picture is that people see.
_POINT_SD_PX = 1.0
# The same [m] where positions are in metres.
_POINT_SD = 1e-3
_NUMBER = r"\s*([-+]?[0-9]+(?:\.[0-9]*)?)\s*"
_POINTS = re.compile(",".join([_NUMBER] * 4))


class CourtLine(NamedTuple):
    """The line y = `height` + `slope` (x - `middle`), with their sds, in the unit of the positions,
    px or m, y up. `of_centres`: of the centres of a ball that touches the court, else of the court.
    """

    middle: float
    height: float
    slope: float
    height_sd: float
    slope_sd: float
    of_centres: bool


def line_of_points(text: str, camera: CameraSection, pixels: bool) -> CourtLine:
    """The court through two points X1,Y1,X2,Y2, as the positions of a film count them.

    Raises:
        ParameterError: the text is not four numbers, or the points are not beside each other
            (`court`).
    """
    match = _POINTS.fullmatch(text)
    points = np.array([float(number) for number in match.groups()]) if match else np.zeros(4)
    x_1, y_1, x_2, y_2 = points.tolist()
    if not abs(x_2 - x_1) > abs(y_2 - y_1):
        read = f"court: read '{one_line(text)}'"
        raise ParameterError(f"{read}; expected two points beside each other: X1,Y1,X2,Y2", "court")
    up = -1.0 if camera.y == "down" else 1.0
    sd = _POINT_SD_PX if pixels else _POINT_SD
    return CourtLine(
        middle=0.5 * (x_1 + x_2),
        height=up * 0.5 * (y_1 + y_2),
        slope=up * (y_2 - y_1) / (x_2 - x_1),
        height_sd=sd / 2.0**0.5,
        slope_sd=2.0**0.5 * sd / abs(x_2 - x_1),
        of_centres=False,
    )


def line_of_roll(tracks: Sequence[Track], source: str, radius: float) -> CourtLine:
    """The line of the centres of a ball of this `radius` [m] that rolls along the court; of several
    tracks that with most frames counts.

    Raises:
        InputError: no ball rolls along a line (`roll`).
    """
    # It takes half a second to import, which only tracks need.
    from scipy.stats import siegelslopes

    track = max(tracks, key=lambda each: each.time.size)
    unit = track.unit
    x = track.x / unit
    y = track.y / unit
    size = radius / unit
    if x.size < _FEWEST_ROLLED or not np.ptp(x) > _LEAST_WAY * size:
        read = f"{x.size} frames over {MM.number(np.ptp(x) * unit)} mm"
        words = f"{read}; expected a ball that rolls along the court, {_FEWEST_ROLLED} frames over"
        least = MM.number(_LEAST_WAY * radius)
        raise InputError(source, [Fault("roll", f"{words} {least} mm at least")])
    middle = float(np.median(x))
    slope, height = siegelslopes(y, x - middle)
    off = y - height - slope * (x - middle)
    noise = 1.4826 * float(np.median(np.abs(off)))
    good = np.abs(off) < np.maximum(4.0 * noise, 1e-9 * size)
    if noise > _MOST_OFF_LINE * size or 2 * good.sum() < x.size:
        words = "the ball leaves the line along which it rolls by"
        read = f"{words} {MM.number(noise * unit)} mm (median)"
        remedy = "expected a ball that rolls along the court, and does not bounce"
        raise InputError(source, [Fault("roll", f"{read}; {remedy}")])
    slope, height = np.polyfit(x[good] - middle, y[good], 1)
    count = max(good.sum() / _LASTING_FRAMES, 1.0)
    of_picture = 0.0
    if track.in_pixels:
        of_picture = float(np.hypot(_DISC_SD_PX, DISTANCE_SD * size))
    of_line = np.hypot(noise / np.sqrt(count), _FELT_SD / unit)
    spread = float(np.std(x[good]))
    return CourtLine(
        middle=middle,
        height=float(height),
        slope=float(slope),
        height_sd=float(np.hypot(of_line, of_picture)),
        slope_sd=float(noise / np.sqrt(count) / spread),
        of_centres=True,
    )


def levelled(tracks: Sequence[Track], line: CourtLine, radius: float) -> Iterator[Track]:
    """Tracks turned and moved so that a court, with this line, is level and at height zero; the
    ball has this `radius` [m].
    """
    length = np.hypot(1.0, line.slope)
    cosine = 1.0 / length
    sine = line.slope / length
    for track in tracks:
        x = track.x - line.middle * track.unit
        y = track.y - line.height * track.unit
        above = cosine * y - sine * x
        yield replace(
            track,
            x=cosine * x + sine * y,
            y=above + (radius if line.of_centres else 0.0),
            angle=track.angle - np.arctan2(sine, cosine),
        )


def near_court(tracks: Sequence[Track]) -> list[Track]:
    """Tracks moved so that the lowest ball is at height zero, by the median of those in pixels: a
    scale that is off, or another one in each, then hardly moves the court.
    """
    lowest = [float(track.y.min()) / track.unit for track in tracks if track.in_pixels]
    height = float(np.median(lowest))
    return [
        replace(track, y=track.y - height * track.unit) if track.in_pixels else track
        for track in tracks
    ]


def camera_of_line(camera: CameraSection, line: CourtLine, unit: float) -> CameraSection:
    """The camera of tracks that were levelled by a line, of which a unit is so many metres."""
    court = ValueWithSd(0.0, line.height_sd * unit)
    height = camera.court_height or ValueWithSd(0.0, court.sd)
    tilt = camera.tilt
    if not isinstance(tilt, ValueWithSd) or line.slope_sd < tilt.sd:
        tilt = ValueWithSd(0.0, line.slope_sd)
    return changed(camera, court=court, court_height=height, tilt=tilt)


def court_note(line: CourtLine, unit: float) -> Note:
    """The note on the height and the slope of a court that the picture shows."""
    how = "a ball that rolls on it" if line.of_centres else "two points"
    height = MM.with_unit(f"± {MM.number(line.height_sd * unit, 2)}")
    slope = DEG.with_unit(DEG.plus_minus(np.arctan(line.slope), line.slope_sd))
    words = f"The height of the court is known to {height} by {how}; it rises by {slope}"
    return Note("court-seen", f"{words} to the right in the picture.")


def unit_of(tracks: Sequence[Track]) -> float:
    """Metres for the unit of the positions of tracks, their median."""
    units: FloatArray = np.array([track.unit for track in tracks])
    return float(np.median(units))
