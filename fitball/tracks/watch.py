"""From films to positions: what is seen in each, as the table and the scene that `track` reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot
from pathlib import Path
from typing import NoReturn

import numpy as np
from msgspec.structs import replace as changed

from fitball.base.errors import Fault, InputError, Note, ParameterError
from fitball.base.progress import Progress
from fitball.base.text import listed, one_line
from fitball.base.values import DataFrame, FloatArray
from fitball.data.scene import CameraSection, Scene, ValueWithSd
from fitball.tracks.types import FilmOptions
from fitball.video.films import open_film
from fitball.video.find import find_balls
from fitball.video.types import Clip, Estimate, Look, Seen, Sightings

# The radius of a ball whose size is not stated [m]: the usual diameter of 66 mm.
_USUAL_RADIUS = 0.033
# Relative sd of the clock of a camera whose film states none.
_CLOCK_SD = 1e-3
# Confidence of frames that are left out, and the least of the others.
_UNUSED = 0.0
_LEAST_USED = 0.01


@dataclass(frozen=True, eq=False)
class Watched:
    """What was seen in films: their `positions` as a table [px, s], the `scene` that goes with it,
    and the reasons why other films have none, by name.
    """

    seen: tuple[Seen, ...]
    positions: DataFrame
    scene: Scene
    refused: Mapping[str, str]
    notes: tuple[Note, ...]


def watch(
    paths: Sequence[Path],
    scene: Scene,
    options: FilmOptions,
    progress: Progress,
) -> Watched:
    """The positions of the balls in films. Times are those of frames; the rows of a rolling shutter
    are taken into account by `row_time` of the scene.

    Raises:
        InputError: no film can be measured: the faults of each (`no-ball`, and codes of
            `open_film`).
        FolderError: a film is not there (`not-found`).
        ParameterError: a film is passed twice (`film-twice`), or an option is none (codes of
            `open_film`).
    """
    import pandas as pd

    _refuse_repeats(paths)
    scene = _with_radius(scene)
    camera = scene.camera or CameraSection()
    stated = camera.row_time
    look = Look(
        diameter=2.0 * scene.ball_value().radius,
        region=options.region,
        rolling=options.rolling,
        tilt=options.tilt,
        row_time=stated.value if isinstance(stated, ValueWithSd) else stated,
    )
    seen = list[Seen]()
    faults = dict[str, Fault]()
    for path in paths:
        try:
            clip = open_film(path, camera.fps or 0.0, options.begin, options.end, progress)
            seen.append(_balls(path, clip, look, progress))
        except InputError as error:
            faults[path.name] = error.faults[0]
    if not seen:
        _refuse_all(faults)
    row_time = _mean([of_film.row_time for of_film in seen])
    scene = _with_camera(scene, seen, row_time)
    level = options.level
    tables = [
        _rows(of_film, ball, row_time.value, level) for of_film in seen for ball in of_film.balls
    ]
    positions = pd.concat(tables, ignore_index=True)
    positions.attrs["name"] = listed((of_film.clip.name for of_film in seen), most=3)
    notes = [
        Note(note.code, f"{one_line(of_film.clip.name)}: {note.text}")
        for of_film in seen
        for note in (*of_film.clip.notes, *of_film.notes)
    ]
    refused = {name: fault.message for name, fault in faults.items()}
    return Watched(tuple(seen), positions, scene, refused, tuple(notes))


def _refuse_repeats(paths: Sequence[Path]) -> None:
    """Refuse a film that is passed twice. Raises ParameterError (`film-twice`)."""
    places = [path.resolve() for path in paths]
    for k, place in enumerate(places):
        if place in places[:k]:
            words = f"{one_line(paths[k].name)} was passed twice; give each film once"
            raise ParameterError(words, "film-twice")


def _with_radius(scene: Scene) -> Scene:
    """A scene that states the radius of the ball, which is the ruler of films."""
    if scene.ball.radius is not None:
        return scene
    return changed(scene, ball=changed(scene.ball, radius=_USUAL_RADIUS))


def _balls(path: Path, clip: Clip, look: Look, progress: Progress) -> Seen:
    """What is seen in a clip. Raises InputError: there is no ball (`no-ball`)."""
    seen = find_balls(clip, look, progress)
    if not seen.balls:
        raise InputError(path.name, [Fault("no-ball", seen.nothing)])
    return seen


def _refuse_all(faults: Mapping[str, Fault]) -> NoReturn:
    """Refuse films of which none can be measured. Raises InputError."""
    if len(faults) == 1:
        [(name, fault)] = faults.items()
        raise InputError(name, [fault])
    named = [
        Fault(fault.code, f"{one_line(name)}: {fault.message}") for name, fault in faults.items()
    ]
    raise InputError(f"{len(faults)} films", named)


def _with_camera(scene: Scene, seen: Sequence[Seen], row_time: Estimate) -> Scene:
    """A scene whose camera has what the pictures show of it: the time of a row, and the sds of tilt
    and clock. What the scene states itself stays.
    """
    camera = scene.camera or CameraSection()
    found: dict[str, object] = {
        "row_time": _with_sd(_read_down(seen) * row_time.value, row_time.sd),
        "tilt": _with_sd(0.0, max(of_film.tilt.sd for of_film in seen)),
    }
    if not _read_down(seen):
        # Rows are read across: a ball that flies with them has another clock.
        across = max(abs(_speed_across(of_film)) for of_film in seen)
        sd = hypot(_CLOCK_SD, row_time.sd * across)
        found |= {"row_time": None, "clock": ValueWithSd(1.0, float(sd))}
    for name in ("tilt", "clock"):
        if getattr(camera, name) is not None:
            found.pop(name, None)
    if isinstance(camera.row_time, ValueWithSd) and isinstance(found["row_time"], ValueWithSd):
        found["row_time"] = changed(found["row_time"], sd=camera.row_time.sd)
    found |= {
        "y": "down",
        "angles": "counterclockwise",
        "fps": None,
        "min_confidence": _LEAST_USED,
    }
    return changed(scene, camera=changed(camera, **found))


def _with_sd(value: float, sd: float) -> float | ValueWithSd:
    """A value with its sd, the value alone where that is stated without one."""
    return ValueWithSd(float(value), float(sd)) if sd > 0.0 else float(value)


def _read_down(seen: Sequence[Seen]) -> int:
    """1 where the rows of all cameras are read downwards in the upright picture, -1 upwards, else
    0.
    """
    down = {of_film.clip.readout[1] for of_film in seen}
    return down.pop() if len(down) == 1 else 0


def _mean(estimates: Sequence[Estimate]) -> Estimate:
    """The mean of estimates by their variances; of values without an sd that of the values."""
    values, sds = np.array(estimates).T
    if not (sds > 0.0).all():
        return Estimate(float(values.mean()), 0.0)
    weights = sds**-2.0
    return Estimate(float(np.average(values, weights=weights)), float(weights.sum() ** -0.5))


def _speed_across(seen: Seen) -> float:
    """The median speed [px/s] of balls along the direction in which rows are read."""
    speeds = list[float]()
    for ball in seen.balls:
        used = ball.used
        along = _readout_row(seen, ball)[used]
        speeds.append(float(np.median(np.diff(along) / np.diff(ball.time[used]))))
    return float(np.median(speeds))


def _readout_row(seen: Seen, ball: Sightings) -> FloatArray:
    """The row of the sensor (frames,) [px] that has the centre of a ball, from any origin."""
    across, down = seen.clip.readout
    return np.asarray(across * ball.x + down * ball.y)


def _rows(seen: Seen, ball: Sightings, row_time: float, level: bool) -> DataFrame:
    """The rows of a ball in the table of positions: the time of its frame and its centre, in the
    picture turned `level`, or as it is.
    """
    import pandas as pd

    tilt = seen.tilt.value if level else 0.0
    cosine = np.cos(tilt)
    sine = np.sin(tilt)
    x = cosine * ball.x - sine * ball.y
    y = sine * ball.x + cosine * ball.y
    # Who reads the table takes the row of the level picture for that of the sensor.
    off_row = _readout_row(seen, ball) - seen.clip.readout[1] * y
    used = np.where(ball.used, np.maximum(ball.quality, _LEAST_USED), _UNUSED)
    return pd.DataFrame(
        {
            "id": ball.id,
            "frame": ball.frame,
            "t [s]": ball.time + row_time * off_row,
            "x [px]": x,
            "y [px]": y,
            "x_sd [px]": ball.x_sd,
            "y_sd [px]": ball.y_sd,
            "radius [px]": ball.radius,
            "radius_sd [px]": ball.radius_sd,
            "angle [rad]": ball.angle - tilt,
            "angle_fold": ball.fold,
            "quality": used,
        }
    )
