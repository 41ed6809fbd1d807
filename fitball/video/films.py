"""Opening a film: which frames it has, when each was taken, and whether they can be measured.

A film is decoded twice, frame by frame: here, to be judged, and where the ball is looked for. No
frames are kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitball.base.errors import Note, ParameterError
from fitball.base.numbers import counted, percent
from fitball.base.progress import Progress
from fitball.base.values import BoolArray
from fitball.video.media import levels_of, luma_of, opened, planes_of, quarter_turns, refusal
from fitball.video.stamps import Stamps, rate_of, read_stamps, usual_rate
from fitball.video.types import Clip, Frame

# Largest side of a picture [px].
_MOST_PIXELS = 4096
# Fewest frames of a film, which no two flights are shorter than.
_FEWEST_FRAMES = 8
# Rates that a camera may have [1/s], as in scenes.
_LEAST_RATE = 1.0
_MOST_RATE = 1e7
# Every so many rows and columns are compared to find frames that repeat the one before.
_SPARSE = 2
# Levels of luma by which pixels differ at least where something moves, be it by a tenth of a pixel;
# coding changes a repeated frame less.
_MOVED_LEVELS = 3
# Pixels of a sparse picture that differ where something moves.
_MOVED_PIXELS = 2
# Most frames in a row that repeat one: of longer rests nothing moved.
_MOST_REPEATS = 10
# Share of repeated frames that is noted.
_REPEATED_SHARE = 0.2
# Direction (x, y) in which rows are read, after so many quarter turns counterclockwise.
_READOUT = ((0, 1), (1, 0), (0, -1), (-1, 0))
# So long after the end of the part [s] no frame of it follows, in whatever order they come.
_MARGIN = 1.0
# Bytes of chroma are at most twice those of luma; usual films have half.
_BYTES_PER_PIXEL = 1.5


@dataclass
class _Survey:
    """What a first reading of frames shows: stamps [s] as they come, NaN without one; whether each
    moved against the one before; the first frame's shape, turns and levels.
    """

    stamps: list[float] = field(default_factory=list)
    moved: list[bool] = field(default_factory=list)
    packets: int = 0
    interlaced: int = 0
    corrupt: int = 0
    shape: tuple[int, int] = (0, 0)
    turns: int = 0
    levels: tuple[float, float] = (0.0, 0.0)
    before: NDArray[np.int16] | None = None

    def add(self, frame: Any) -> None:
        """Take note of a frame."""
        luma = luma_of(frame)
        if not self.stamps:
            self.shape = (frame.height, frame.width)
            self.turns = quarter_turns(frame)
            self.levels = levels_of(frame)
        sparse = luma[::_SPARSE, ::_SPARSE].astype(np.int16)
        before = self.before
        changed = before is None or before.shape != sparse.shape
        if before is not None and not changed:
            changed = int((np.abs(sparse - before) > _MOVED_LEVELS).sum()) > _MOVED_PIXELS
        self.before = sparse
        self.moved.append(changed)
        stamp = np.nan if frame.pts is None else float(frame.pts * frame.time_base)
        self.stamps.append(stamp)
        self.interlaced += bool(frame.interlaced_frame)
        self.corrupt += bool(frame.is_corrupt)


def open_film(
    path: Path,
    fps: float = 0.0,
    begin: float = 0.0,
    end: float = np.inf,
    progress: Progress = lambda _stage, _share: None,
) -> Clip:
    """A film, or its part from `begin` to `end` [s as played]. `fps` [1/s] is the rate of the
    camera where it is stated, else 0.

    Raises:
        ParameterError: no camera has the rate (`out-of-bounds`), or the part ends before it begins
            (`film-part`).
        FolderError: no such file (`not-found`).
        InputError: PyAV is not installed (`no-pyav`); the file is no film (`not-a-film`) or
            damaged (`broken-film`); its rows are of two times (`interlaced`), its pixels no squares
            (`no-square-pixels`), its pictures too large (`large-picture`) or too few
            (`few-frames`); it has neither stamps nor a rate (`no-rate`).
    """
    if fps and not _LEAST_RATE <= fps <= _MOST_RATE:
        limits = f"expected {_LEAST_RATE:g} to {_MOST_RATE:g} frames/s"
        raise ParameterError(f"fps: read {fps:g}; {limits}", "out-of-bounds")
    if not 0.0 <= begin < end:
        words = f"from {begin:g} s to {end:g} s of the film is no part; expected times as played"
        raise ParameterError(words, "film-part")
    with opened(path) as container:
        stream = _stream(path, container)
        survey = _Survey()
        expected = stream.frames
        tags = {**container.metadata, **stream.metadata}
        tick = float(stream.time_base)
        nominal = float(stream.average_rate or 0.0)
        for packet in container.demux(stream):
            survey.packets += packet.size > 0
            for frame in packet.decode():
                survey.add(frame)
            if expected:
                progress(f"Reading {path.name}", min(survey.packets / expected, 1.0))
            if survey.stamps and survey.stamps[-1] - survey.stamps[0] > end + _MARGIN:
                break
        else:
            _refuse_short(path, survey, expected)
    _refuse_unfit(path, survey)
    stamps = _stamps(path, survey.stamps, tick, nominal)
    first, last = np.searchsorted(stamps.times, [begin, end])
    if last - first < _FEWEST_FRAMES:
        total = f"of {counted(stamps.times.size, 'frame')}, {stamps.times[-1]:.3g} s as played"
        words = f"has {counted(int(last - first), 'frame')} to look at, {total}; 8 are needed"
        raise refusal(path, "few-frames", words)
    rate = rate_of(stamps.rate, tags, fps)
    repeated = _repeated(np.array(survey.moved))[first:last]
    notes = (*stamps.notes, *rate.notes, *_note_of_repeats(repeated, survey.moved[first:last]))
    rows, columns = survey.shape if survey.turns % 2 == 0 else survey.shape[::-1]
    numbers = first + np.flatnonzero(~repeated)
    return Clip(
        name=path.stem,
        width=columns,
        height=rows,
        count=numbers.size,
        times=stamps.times[numbers],
        played_rate=stamps.rate,
        camera_rate=rate.camera,
        rate_source=rate.source,
        stretch=rate.stretch,
        readout=_READOUT[survey.turns],
        black=survey.levels[0],
        white=survey.levels[1],
        byte_count=int(_BYTES_PER_PIXEL * rows * columns * numbers.size),
        notes=notes,
        frames=_reader(path, numbers.tolist(), stamps.times.tolist()),
    )


def _stream(path: Path, container: Any) -> Any:
    """The stream of pictures, decoded on all cores. Raises InputError (`not-a-film`,
    `no-square-pixels`, `large-picture`).
    """
    streams = [
        stream
        for stream in container.streams.video
        # The cover of a recording is no film.
        if "attached_pic" not in (stream.disposition.name or "")
    ]
    if not streams:
        raise refusal(path, "not-a-film", "has no moving pictures; expected a film")
    stream = streams[0]
    context = stream.codec_context
    if context is None:
        raise refusal(path, "not-a-film", "has pictures in a code that cannot be read")
    ratio = stream.sample_aspect_ratio
    if ratio and ratio != 1:
        words = f"has pixels {float(ratio):.3g} times as wide as high; export it with square pixels"
        raise refusal(path, "no-square-pixels", words)
    if max(context.width, context.height) > _MOST_PIXELS:
        size = f"{context.width} x {context.height} px"
        words = f"has pictures of {size}; at most {_MOST_PIXELS} px are read: export it smaller"
        raise refusal(path, "large-picture", words)
    stream.thread_type = "AUTO"
    return stream


def _refuse_short(path: Path, survey: _Survey, expected: int) -> None:
    """Refuse a file without frames, or one that ends before those that its head counts. Raises
    InputError (`not-a-film`, `broken-film`).
    """
    if survey.packets < expected:
        words = f"ends after {survey.packets:,} of {counted(expected, 'frame')}: copy it again"
        raise refusal(path, "broken-film", words)
    if not survey.stamps:
        raise refusal(path, "not-a-film", "has no frames; copy it again from the camera")


def _refuse_unfit(path: Path, survey: _Survey) -> None:
    """Refuse frames that cannot be measured. Raises InputError (`interlaced`, `broken-film`)."""
    if survey.interlaced:
        words = "is interlaced: every second row is half a frame late; film progressively (1080p)"
        raise refusal(path, "interlaced", words)
    if survey.corrupt:
        of = counted(len(survey.stamps), "frame")
        words = f"has {survey.corrupt} damaged of {of}: copy it again from the camera"
        raise refusal(path, "broken-film", words)


def _stamps(path: Path, raw: list[float], tick: float, nominal: float) -> Stamps:
    """Times from the first frame on: by stamps, or where they do not increase by counted frames at
    the rate of the container, with a note. Raises InputError (`no-rate`).
    """
    stamps = np.array(raw)
    if stamps.size < _FEWEST_FRAMES:
        words = f"has {counted(stamps.size, 'frame')}; 8 are needed"
        raise refusal(path, "few-frames", words)
    if np.isfinite(stamps).all() and (np.diff(stamps) > 0.0).all():
        return read_stamps(stamps - stamps[0], tick, nominal)
    wrong = int((~(np.diff(stamps) > 0.0)).sum())
    sorted_stamps = np.unique(stamps[np.isfinite(stamps)])
    # The same stamps in another order still have the rate.
    rate = usual_rate(sorted_stamps) if sorted_stamps.size > 0.5 * stamps.size else nominal
    if not rate:
        words = "has no stamps of its frames: expected the rate of the camera, as in --fps 240"
        raise refusal(path, "no-rate", words)
    words = f"stamps go back or are missing {wrong} times: frames are counted, at {rate:.4g}/s"
    return Stamps(np.arange(stamps.size) / rate, rate, (Note("stamps-go-back", words),))


def _repeated(moved: BoolArray) -> BoolArray:
    """Which frames repeat the one before, amid motion. Where nothing moves for long, frames are
    alike and no repeats.
    """
    repeated = np.zeros(moved.size, dtype=bool)
    changes = np.flatnonzero(moved)
    for begin, end in pairwise(changes.tolist()):
        if 1 < end - begin <= _MOST_REPEATS:
            repeated[begin + 1 : end] = True
    return repeated


def _note_of_repeats(repeated: BoolArray, moved: list[bool]) -> tuple[Note, ...]:
    """A note where many frames repeat the one before."""
    count = int(repeated.sum())
    share = count / max(count + sum(moved), 1)
    if share <= _REPEATED_SHARE:
        return ()
    words = (
        f"{percent(share)} of the frames repeat the one before: it was made at another rate, and "
        "times are rough. Use the film as the camera wrote it"
    )
    return (Note("repeated-frames", words),)


def _reader(path: Path, numbers: list[int], times: list[float]) -> Callable[[], Iterator[Frame]]:
    """A function that decodes the frames with these numbers, in order, at each call."""

    def frames() -> Iterator[Frame]:
        wanted = iter(numbers)
        number = next(wanted)
        with opened(path) as container:
            for k, frame in enumerate(container.decode(_stream(path, container))):
                if k != number:
                    continue
                yield Frame(k, times[k], *planes_of(frame))
                number = next(wanted, -1)
                if number < 0:
                    return
        if number >= 0:
            raise refusal(path, "broken-film", "changed while it was read")

    return frames
