"""The time of each frame of a clip: by stamps, by numbers of frames, or by rows where neither is
known.

Rows are not frames where some were dropped: a lost frame among forty makes a speed 2.5 % too large.
So rows are counted only where no column shows gaps, and stamps are compared with numbers.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from datetime import datetime
from shlex import quote
from typing import Literal, NamedTuple

import numpy as np

from fitball.base.text import one_line
from fitball.base.values import BoolArray, FloatArray, IntArray
from fitball.data.cells import TableCells
from fitball.tracks.names import INDEX

# A step in time of fewer than this many usual ones misses no frame.
_MOST_STEPS_APART = 1.5
# Steps of stamps and of numbers differ by so many frames where they part: rounded, and those of a
# camera with a varying rate, differ by less.
_LEAST_PARTING = 0.5
# Stamps show single frames if they are this many times finer.
_LEAST_FINER = 4.0
# Most decimals of a stamp; of others the resolution is finer.
_MOST_DECIMALS = 9
# Steps of a column that counts are whole multiples of the usual one, up to this share of it.
_MOST_OFF_STEP = 0.2
# Numbers that grow evenly by more than this are times, whose rows lack none.
_MOST_SKIPPED = 16.0
# Fewest rows of a column that shows how it counts.
_FEWEST_ROWS = 7
# A number in the name of a file: `clip1/frame_0012.png`.
_DIGITS = re.compile(r"[0-9]{1,15}")
# An ending of the name of a picture.
_PICTURE = re.compile(r"\.(?:jpe?g|png|tiff?|bmp|webp|gif|pgm|npy|json|txt)$", re.IGNORECASE)
# A time in hours, minutes and seconds.
_HOURS = re.compile(r"(?:(?P<h>\d{1,2}):)?(?P<m>\d{1,2}):(?P<s>\d{1,2}(?:[.,]\d+)?)")

# Columns that are clocks, in words.
_CLOCKS = {"t": "the time", "frame": "the number of the frame"}

# What counts the frames of a clip.
Counter = Literal["t", "frame", "rows"]


class Parting(NamedTuple):
    """Where stamps and numbers of frames part: the index of the first such row, and which of them
    has the gaps; neither, where both have some that the other one has not.
    """

    first: int
    gaps_in: Literal["t", "frame", "both"]


def frame_numbers(time: FloatArray) -> FloatArray:
    """Numbers (frames,), from 0, of the frames to which time stamps belong, in any unit; missing
    frames count.
    """
    if time.size < 2:
        return np.zeros(time.size)
    frames = np.maximum(np.round(np.diff(time) / usual_step(time)), 1.0)
    return np.concatenate([[0.0], np.cumsum(frames)])


def is_idle(clock: FloatArray) -> bool:
    """Whether a clock (frames,) orders nothing: it is empty, or the same in all frames."""
    measured = clock[np.isfinite(clock)]
    return clock.size > 1 and np.unique(measured).size < 2


def _orders_all(clock: FloatArray) -> bool:
    """Whether a clock (frames,) has another number in each frame."""
    return bool(np.isfinite(clock).all()) and np.unique(clock).size == clock.size


def usual_step(time: FloatArray) -> float:
    """The step of time stamps (frames,) that misses no frame, in their unit."""
    steps = np.diff(time)
    return float(steps[steps < _MOST_STEPS_APART * np.median(steps)].mean())


def parting(time: FloatArray, frame: FloatArray) -> Parting | None:
    """Where steps of stamps (rows,) are not those of the numbers of frames, by order of these, but
    for one factor; None where they agree, or where stamps are too coarse to show it.
    """
    order = np.argsort(frame, kind="stable")
    steps = np.diff(time[order])
    counts = np.diff(frame[order])
    apart = counts > 0.0
    if apart.sum() < _FEWEST_ROWS:
        return None
    usual = float(np.median(steps[apart] / counts[apart]))
    if usual <= 0.0 or _resolution(time) * _LEAST_FINER > usual:
        return None
    more = np.where(apart, steps / usual - counts, 0.0)
    parted = np.flatnonzero(np.abs(more) > _LEAST_PARTING)
    if not parted.size:
        return None
    first = int(order[parted[0] + 1])
    if (more[parted] > 0.0).all():
        return Parting(first, "t")
    if (more[parted] < 0.0).all():
        return Parting(first, "frame")
    return Parting(first, "both")


def _resolution(time: FloatArray) -> float:
    """The least digit of stamps, 0 where it is very small."""
    for decimals in range(_MOST_DECIMALS + 1):
        digits = time * 10.0**decimals
        if np.allclose(digits, np.round(digits), rtol=0.0, atol=1e-4):
            return float(10.0**-decimals)
    return 0.0


def counts_with_gaps(numbers: FloatArray) -> Literal["", "whole", "time"]:
    """Whether a column (rows,) may be a clock that shows missing rows: `whole` numbers that grow
    with gaps, or others, such as a `time`, whose steps are multiples of the usual one; "" if not.
    """
    measured = numbers[np.isfinite(numbers)]
    steps = np.diff(measured)
    if measured.size < _FEWEST_ROWS or not (steps > 0.0).all():
        return ""
    usual = float(np.median(steps))
    is_even = usual <= _MOST_SKIPPED and (steps == usual).all()
    if (measured % 1.0 == 0.0).all() and (usual == 1.0 or is_even):
        return "whole" if (steps > 1.0).any() else ""
    usual = usual_step(measured)
    multiples = np.round(steps / usual)
    is_regular = (np.abs(steps / usual - multiples) < _MOST_OFF_STEP).all()
    return "time" if is_regular and (multiples > 1.0).any() else ""


def unread_clocks(
    cells: TableCells,
    read: Collection[int],
    rows: IntArray,
) -> list[tuple[int, Literal["whole", "time"]]]:
    """Columns that are not read and may be clocks of these rows: their index, and how they
    count.
    """
    clocks = list[tuple[int, Literal["whole", "time"]]]()
    for index in range(len(cells.names)):
        if index not in read and (kind := counts_with_gaps(cells.plain_numbers(index)[rows])):
            clocks.append((index, kind))
    return clocks


def numbers_in_names(texts: Sequence[str], clips: Sequence[str]) -> FloatArray | None:
    """Numbers (rows,) of frames in the names of their files, such as `0012.jpg`: the last ones that
    all differ within each of the `clips` (rows,). None where texts are no such names.
    """
    filled = [k for k, text in enumerate(texts) if text]
    runs = [_DIGITS.findall(_PICTURE.sub("", texts[k])) for k in filled]
    numbers = np.full(len(texts), np.nan)
    for of_texts in reversed([*zip(*runs, strict=False)]):
        frames = {*zip((clips[k] for k in filled), map(int, of_texts), strict=True)}
        if len(frames) == len(filled):
            numbers[filled] = [*map(float, of_texts)]
            return numbers
    return None


def seconds_of_texts(texts: Sequence[str]) -> FloatArray | None:
    """Seconds (rows,) of times of day such as `0:00:01.25`, or of dates with one; None where texts
    are none.
    """
    seconds = np.full(len(texts), np.nan)
    for k, text in enumerate(texts):
        if not text:
            continue
        if match := _HOURS.fullmatch(text):
            hours = 60.0 * float(match["h"] or 0.0) + float(match["m"])
            seconds[k] = 60.0 * hours + float(match["s"].replace(",", "."))
            continue
        try:
            seconds[k] = datetime.fromisoformat(text).timestamp()
        except ValueError:
            return None
    return seconds


class ClipClock(NamedTuple):
    """The clock of a clip: `clock` (frames,) orders its frames, `frame` (frames,) has their numbers
    in the film. Stamps are seconds, or have the `rate` [1/s] of their frames, NaN where it is not
    known; numbers of frames have it always.
    """

    counter: Counter
    clock: FloatArray
    frame: FloatArray
    rate: float

    def seconds(self, order: IntArray) -> FloatArray:
        """The times [s] of frames in this order."""
        if self.counter != "t":
            return np.asarray(self.clock[order] / self.rate)
        if np.isnan(self.rate):
            return self.clock[order]
        return np.asarray(frame_numbers(self.clock[order]) / self.rate)


def clock_of_clip(
    cells: TableCells,
    name: str,
    values: Mapping[str, FloatArray],
    rows: IntArray,
    fps: float | None,
    read: Collection[int],
) -> ClipClock:
    """The clock of a clip, whose `rows` (frames,) of the file have these numbers by column. `fps`
    is the stated rate; `read` are the indices of columns that have a meaning. Faults: stamps and
    numbers contradict (`clocks-differ`), a column that is not read shows that rows are missing
    (`unread-clock`), the only clock is empty or stands still (`idle-clock`), or the rate is not
    stated (`no-rate`). What was assumed is noted.
    """
    count = np.arange(1.0, rows.size + 1.0)
    seen = np.isfinite(values["x"] + values["y"])
    idle = _idle_clocks(values, seen)
    clocks = {ours: values[ours] for ours in _CLOCKS if ours in values and ours not in idle}
    if idle:
        words = " and ".join(idle.values())
        cells.note("idle-clock", f"{name}: {words}, and therefore not used")
    frame = clocks.get("frame", count)
    counter: Counter = "rows"
    rate = np.nan if fps is None else fps
    if {"t", "frame"} <= {*clocks}:
        counter, by_stamps = _counter_of_both(cells, name, clocks, rows, seen, fps)
        if counter == "frame" and fps is None:
            rate = 1.0 / by_stamps
    elif "t" in clocks:
        counter = "t"
    elif "frame" in clocks:
        counter = "frame"
    else:
        frame = _numbers_of_rows(cells, name, rows, read, [*idle.values()])
    if counter == "t":
        number = frame if _orders_all(frame[seen]) else count
        return ClipClock(counter, clocks["t"], number, rate)
    codes = {fault.code for fault in cells.faults}
    if np.isnan(rate) and codes.isdisjoint({"no-rate", "idle-clock"}):
        why = idle.get("t", "frames have no time")
        cells.fault("no-rate", f"{why}; expected the camera's rate: --fps, or fps in [camera]")
    return ClipClock(counter, frame, frame, rate)


def _idle_clocks(values: Mapping[str, FloatArray], seen: BoolArray) -> dict[str, str]:
    """What is wrong with the stamps and numbers of a clip that order none of the frames (frames,)
    in which the ball is `seen`.
    """
    idle = dict[str, str]()
    for ours, title in _CLOCKS.items():
        if ours in values and is_idle(values[ours][seen]):
            empty = np.isnan(values[ours][seen]).all()
            idle[ours] = f"{title} is {'empty' if empty else 'the same in all frames'}"
    return idle


def _counter_of_both(
    cells: TableCells,
    name: str,
    clocks: Mapping[str, FloatArray],
    rows: IntArray,
    seen: BoolArray,
    fps: float | None,
) -> tuple[Counter, float]:
    """Whether stamps or numbers of frames count, where a clip has both, and the step [s] of a
    number by the stamps, NaN where they do not show it. Where both part, those with gaps count; but
    first those that order all frames, where the others are missing or repeat.
    """
    time, frame = clocks["t"], clocks["frame"]
    measured = np.flatnonzero(np.isfinite(time + frame) & seen)
    order = measured[np.argsort(frame[measured], kind="stable")]
    if not order.size:
        return "t" if fps is None else "frame", np.nan
    if _orders_all(time[seen]) and not _orders_all(frame[seen]):
        words = f"{name}: frame is missing or repeats in some frames: t is used"
        cells.note("clocks-differ", words)
        return "t", np.nan
    if (np.diff(time[order]) <= 0.0).any() and (np.diff(frame[order]) > 0.0).all():
        # Stamps that are too coarse order nothing.
        return "frame", np.nan
    parted = parting(time[measured], frame[measured])
    if parted is None:
        return "t" if fps is None else "frame", np.nan
    first = measured[parted.first]
    where = f"steps of t and frame part at frame {frame[first]:g}"
    if parted.gaps_in == "both":
        words = f"{where}, and both have gaps; expected one clock: keep one of these columns"
        cells.fault("clocks-differ", words, None, int(rows[first]))
        return "t", np.nan
    other = "frame" if parted.gaps_in == "t" else "t"
    words = f"{name}: {where}: {parted.gaps_in} is used, since {other} does not count lost frames"
    cells.note("clocks-differ", words)
    return parted.gaps_in, usual_step(time[order])


def _numbers_of_rows(
    cells: TableCells,
    name: str,
    rows: IntArray,
    read: Collection[int],
    idle: Sequence[str],
) -> FloatArray:
    """Numbers (frames,) of the frames of a clip without time and numbers: those of an index that
    has gaps, else of the rows, which is noted. Faults: another column has gaps, or a clock is there
    that is `idle`, as these words say.
    """
    if INDEX in cells.names:
        index = cells.plain_numbers(cells.names.index(INDEX))[rows]
        if counts_with_gaps(index) == "whole":
            words = f"{name}: the first column has no name, and is read as the number of the frame"
            cells.note("index-as-frame", words)
            return index
    for column, kind in unread_clocks(cells, read, rows):
        head = one_line(cells.names[column])
        ours = "frame" if kind == "whole" else "t"
        words = (
            f"there is no time or frame, and '{head}' grows with gaps: rows are missing, so they "
            f"cannot be counted; expected --columns {quote(f'{ours}={head}')}"
        )
        if all(fault.code != "unread-clock" or fault.column != head for fault in cells.faults):
            cells.fault("unread-clock", words, head)
    if idle:
        remedy = "expected the time or number of each frame, or no such column if no row is missing"
        if all(fault.code not in ("unread-clock", "idle-clock") for fault in cells.faults):
            cells.fault("idle-clock", f"'{name}': {' and '.join(idle)}; {remedy}")
        return np.arange(1.0, rows.size + 1.0)
    words = (
        f"{name}: no column of time or frame was found: rows were counted as frames, so that no "
        "row may be missing"
    )
    cells.note("rows-counted", words)
    return np.arange(1.0, rows.size + 1.0)
