"""From recordings to impacts: times of bounces become flights, and these speeds.

Between two bounces the ball is in the air from the end of a contact to the begin of the next. With
the times of both begins, less the time of the contact, the air decides the speeds at both ends
(`base.air`): v = g T/2 and a little more or less.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from msgspec.structs import replace as changed

from fitball.base import air
from fitball.base.display_units import MS
from fitball.base.errors import Fault, InputError, Note
from fitball.base.numbers import counted
from fitball.base.progress import Progress
from fitball.base.text import listed, one_line
from fitball.base.values import DataFrame, FloatArray
from fitball.data.heights import usual_braking
from fitball.data.scene import Scene, ValueWithSd
from fitball.video.onsets import Bounces, bounces_in
from fitball.video.sound import Recording, read_sound

# Time of contact of a tennis ball [s] where the scene states none, and its sd.
_CONTACT = ValueWithSd(4.7e-3, 0.5e-3)
# What is said of a recording without bounces.
_WITHOUT = (
    "no bounces of a ball that is left to itself: expected four sudden sounds or more, each "
    "interval a like share of that before. Record closer, without voices, until the ball rests"
)
# Step of a relative change that gives a derivative.
_STEP = 1e-4


@dataclass(frozen=True, eq=False)
class Heard:
    """Bounces in recordings: `impacts`, a row a bounce as `calibrate` reads series; `bounces`, with
    times as heard, intervals, speeds and restitution; the recordings and their series of bounces.
    """

    impacts: DataFrame
    bounces: DataFrame
    scene: Scene
    recordings: tuple[tuple[Recording, tuple[Bounces, ...]], ...]
    refused: dict[str, str]
    notes: tuple[Note, ...]


def hear(paths: Sequence[Path], scene: Scene, progress: Progress) -> Heard:
    """The bounces of balls in recordings or in the sound of films.

    Raises:
        InputError: no recording has a series of bounces (`no-bounces`), or the faults of
            `read_sound`.
        FolderError: a recording is not there (`not-found`).
    """
    import pandas as pd

    recordings = list[tuple[Recording, tuple[Bounces, ...]]]()
    faults = dict[str, Fault]()
    for number, path in enumerate(paths):
        progress(f"Listening to {path.name}", number / len(paths))
        try:
            recording = read_sound(path)
        except InputError as error:
            faults[path.name] = error.faults[0]
            continue
        series = bounces_in(recording.signal, recording.rate)
        if series:
            recordings.append((recording, tuple(series)))
        else:
            faults[path.name] = Fault("no-bounces", _WITHOUT)
    if not recordings:
        names = listed((one_line(name) for name in faults), most=3)
        raise InputError(names, list(faults.values()))
    contact = scene.contact_time or _CONTACT
    runs = [*_runs(recordings)]
    bounces = pd.DataFrame(
        [row for run, series in runs for row in _bounce_rows(run, series, contact, scene)]
    )
    impacts = pd.DataFrame([row for run, series in runs for row in _rows(run, series, contact)])
    impacts.attrs["name"] = "sound"
    names = listed((recording.name for recording, _ in recordings), most=3)
    count = counted(len(bounces), "bounce")
    source = {"description": f"{count} heard in {names}"} | scene.source
    refused = {name: fault.message for name, fault in faults.items()}
    return Heard(
        impacts,
        bounces,
        changed(scene, camera=None, columns={}, source=source),
        tuple(recordings),
        refused,
        (*_notes(recordings), _note_of_contact(contact)),
    )


def _runs(
    recordings: Sequence[tuple[Recording, tuple[Bounces, ...]]],
) -> Iterator[tuple[str, Bounces]]:
    """The series of all recordings, by names that are their own."""
    for recording, series in recordings:
        for number, of_drop in enumerate(series, 1):
            yield f"{recording.name}-{number}" if len(series) > 1 else recording.name, of_drop


def _rows(run: str, series: Bounces, contact: ValueWithSd) -> Iterator[dict[str, object]]:
    """The rows of a series as a table of bounces has them. Times are less the contacts before, so
    that intervals are flights.
    """
    first = series.number[0]
    for k, number in enumerate(series.number.tolist()):
        yield {
            "run": run,
            "bounce": number,
            "bounce_time [s]": series.time[k] - (number - first) * contact.value,
            "bounce_time_sd [s]": series.sd[k],
        }


def _bounce_rows(
    run: str, series: Bounces, contact: ValueWithSd, scene: Scene
) -> Iterator[dict[str, object]]:
    """The rows of a series for people: time, interval to the next bounce, speeds before and after,
    restitution; sds have errors of times, of the contact time and of the drag.
    """
    braking = usual_braking(scene)
    drag = scene.slow_drag()

    def speeds(time: FloatArray, contact_time: float, share: float) -> FloatArray:
        """Speeds before and after, and their ratio (3, bounces), of bounces at times [s], with a
        drag of this share of the usual.
        """
        follows = np.diff(series.number) == 1
        flights = np.where(follows, np.diff(time) - contact_time, np.nan)
        launch = air.launch_of_flight(flights, share * braking)
        landing = air.landing_of_launch(launch, share * braking)
        none = np.array([np.nan])
        before = np.concatenate([none, landing])
        after = np.concatenate([launch, none])
        return np.array([before, after, after / before])

    values = speeds(series.time, contact.value, 1.0)
    variance = np.square(_change(lambda c: speeds(series.time, c, 1.0), contact.value) * contact.sd)
    relative = drag.sd / drag.value
    variance += np.square(
        _change(lambda share: speeds(series.time, contact.value, share), 1.0) * relative
    )
    for k, sd in enumerate(series.sd):
        moved = series.time.copy()
        moved[k] += sd
        variance += np.square(speeds(moved, contact.value, 1.0) - values)
    sds = np.sqrt(variance)
    intervals = np.append(np.diff(series.time), np.nan)
    intervals[:-1][np.diff(series.number) != 1] = np.nan
    interval_sds = np.append(np.hypot(series.sd[1:], series.sd[:-1]), np.nan)
    for k, number in enumerate(series.number.tolist()):
        yield {
            "run": run,
            "bounce": number,
            "time [s]": series.time[k],
            "time_sd [s]": series.sd[k],
            "interval [s]": intervals[k],
            "interval_sd [s]": interval_sds[k] if np.isfinite(intervals[k]) else np.nan,
            "v_y1 [m/s]": values[0, k],
            "v_y1_sd [m/s]": sds[0, k],
            "v_y2 [m/s]": values[1, k],
            "v_y2_sd [m/s]": sds[1, k],
            "cor": values[2, k],
            "cor_sd": sds[2, k],
        }


def _change(function: Callable[[float], FloatArray], at: float) -> FloatArray:
    """The derivative of a function by central differences."""
    step = _STEP * at
    return np.asarray((function(at + step) - function(at - step)) / (2.0 * step))


def _notes(
    recordings: Sequence[tuple[Recording, tuple[Bounces, ...]]],
) -> Iterator[Note]:
    """Notes on recordings: what is wrong with them, bounces that were not heard, other sounds."""
    for recording, series in recordings:
        name = one_line(recording.name)
        for note in recording.notes:
            yield Note(note.code, f"{name}: {note.text}")
        for of_drop in series:
            missed = sorted({*range(1, int(of_drop.number[-1]))} - {*of_drop.number.tolist()})
            if missed:
                words = f"bounce {listed(map(str, missed))} was not heard, or not clearly"
                yield Note("bounce-missed", f"{name}: {words}; its neighbours have no interval")
            if of_drop.others.size:
                times = listed((f"{time:.3f}" for time in of_drop.others), most=4)
                words = f"sudden sounds at {times} s are no bounces of the series: left out"
                yield Note("other-sounds", f"{name}: {words}")


def _note_of_contact(contact: ValueWithSd) -> Note:
    """The note on the time of contact, by which intervals are longer than flights."""
    words = (
        f"intervals are {MS.plus_minus(contact.value, contact.sd)} ms of contact longer than "
        "flights; `contact_time` in the scene states it"
    )
    return Note("contact-time", words)
