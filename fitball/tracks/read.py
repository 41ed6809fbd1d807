"""Files of positions as tracks: every dialect, then clock, scale, and the direction upwards, with a note on each
decision.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from fitball.data.bundled import resolve_tracks, split_sheet
from fitball.data.cells import refusal
from fitball.data.read import FRAME, PATHS
from fitball.data.text import checked_records, read_records
from fitball.errors import ParameterError, TrackError
from fitball.tracks.arrays import SUFFIXES, hdf5_clips
from fitball.tracks.axes import in_plane, upright
from fitball.tracks.clips import Clip, Reading
from fitball.tracks.clock import check_rate, timed
from fitball.tracks.dialects import clips_of, positions_vocabulary
from fitball.tracks.frames import Track
from fitball.tracks.motion import bounces
from fitball.tracks.scale import in_metres
from fitball.tracks.split import LEAST, one_object, stretches

if TYPE_CHECKING:
    import pandas

# What positions may be read from: a path or bundled name, or a DataFrame.
Source: TypeAlias = "str | os.PathLike[str] | pandas.DataFrame"


# Shots of a clip are divided where no ball was seen for so many seconds and frames.
_LOST, _LOST_FRAMES = 0.15, 10.0
# Files that people have beside their tables of positions, and what to do with them.
_EXPORT = "expected positions of the ball in its frames: open it in {}, and export the table"
_OTHERS = {
    **dict.fromkeys(
        (".mp4", ".mov", ".avi", ".mkv", ".m4v", ".wmv", ".webm", ".mts", ".mpg", ".mpeg", ".cine", ".gif"),
        "is a film; " + _EXPORT.format("a tracking program, such as Tracker, Kinovea or DLTdv"),
    ),
    **dict.fromkeys((".trk", ".trz"), "is a project of Tracker; " + _EXPORT.format("Tracker")),
    ".kva": "is a project of Kinovea; " + _EXPORT.format("Kinovea"),
}


def read_tracks(paths: Sequence[Source], how: Reading | None = None) -> tuple[Track, ...]:
    """Tracks of files of positions, or of DataFrames with the same columns, in metres and seconds, y upwards.

    Dialects are recognised (see `dialects` and `arrays`). A track is a whole clip, and may hold many bounces or none;
    `split.split_bounces` divides it. Only a clip in three dimensions is divided here, since each bounce has a plane.
    Raises TableError with file, row, column or frames for what cannot be read, for pixels without a scale, frames
    without a rate, gravity that is off by far, and for a direction upwards that the motion contradicts.
    """
    how = how or Reading()
    if not paths:
        raise ParameterError("no files of positions; expected at least one")
    clips = _distinct([clip for source in paths for clip in _clips(source, how)])
    sessions: dict[str, list[Clip]] = {}
    for clip in clips:
        sessions.setdefault(clip.session, []).append(clip)
    return tuple(_track(clip, how) for members in sessions.values() for clip in _settled(members, how))


def _clips(source: Source, how: Reading) -> list[Clip]:
    vocabulary = positions_vocabulary(how)
    if not isinstance(source, PATHS):
        name = str(source.attrs.get("name", FRAME))
        return clips_of(checked_records(name, source), b"", (), name, how)
    path, sheet = resolve_tracks(source), split_sheet(source)[1]
    if path.suffix.lower() in _OTHERS and path.is_file():
        raise refusal(str(path), _OTHERS[path.suffix.lower()])
    if path.suffix.lower() in SUFFIXES:
        return hdf5_clips(path, how)
    records, data, notes = read_records(path, vocabulary, sheet)
    return clips_of(records, data, notes, str(path), how)


def _distinct(clips: Sequence[Clip]) -> list[Clip]:
    """The clips with ids of their own: where files share one it is preceded by the file's name, and by its folder's
    where that is shared too; then numbered.
    """
    counts = Counter(clip.id for clip in clips)
    stems = Counter(Path(source).stem for source in {clip.source for clip in clips})

    def file(source: Path) -> str:
        return source.stem if stems[source.stem] == 1 else f"{source.parent.name}-{source.stem}"

    named = [
        clip if counts[clip.id] == 1 else replace(clip, id=f"{file(Path(clip.source))}-{clip.id}") for clip in clips
    ]
    seen, again = Counter[str](), []
    for clip in named:
        seen[clip.id] += 1
        again.append(clip if seen[clip.id] == 1 else replace(clip, id=f"{clip.id} ({seen[clip.id]})"))
    return again


def _settled(clips: Sequence[Clip], how: Reading) -> list[Clip]:
    """The clips of a session in metres and seconds, (frames, 2)."""
    measured, mixed = list[Clip](), set[str]()
    for clip in in_metres([shot for whole in timed(clips, how) for shot in _shots(whole)], how):
        assert clip.time is not None
        try:
            kept, note = one_object(clip.frame, clip.time, clip.position)
        except TrackError:
            # Refused where bounces are divided, with the others of its session.
            mixed.add(clip.id)
            kept, note = np.ones(len(clip), dtype=np.bool_), None
        measured.append(clip if note is None else clip.take(kept).noted(note))
    placed = upright(measured, mixed, how)
    flat = [part for clip in placed for part in ([clip] if clip.position.shape[1] == 2 else _planes(clip))]
    check_rate([clip for clip in flat if clip.id not in mixed], how)
    return flat


def _shots(clip: Clip) -> list[Clip]:
    """The shots of a clip that has several, one after the other: no ball was seen for long between them."""
    assert clip.time is not None
    steps = np.diff(clip.time)
    longest = max(_LOST, _LOST_FRAMES * float(np.median(steps))) if len(steps) else _LOST
    parts = np.split(np.arange(len(clip)), np.flatnonzero(steps > longest) + 1)
    if sum(len(part) > 2 * LEAST for part in parts) < 2:
        return [clip]
    note = f"clip '{clip.id}' was divided into {len(parts)}, where no ball was seen for more than {longest:.2g} s"
    return [replace(clip.take(part), id=f"{clip.id}-{k}").noted(note) for k, part in enumerate(parts, 1)]


def _planes(clip: Clip) -> list[Clip]:
    """The bounces of a clip in three dimensions, each in the plane of its incident flight."""
    assert clip.time is not None
    parts = stretches(clip.time, bounces(clip.time, clip.position[:, 2]))
    if len(parts) < 2:
        return [in_plane(clip)]
    return [in_plane(replace(clip.take(np.arange(*part)), id=f"{clip.id}-{k}")) for k, part in enumerate(parts, 1)]


def _track(clip: Clip, how: Reading) -> Track:
    assert clip.time is not None
    angle = None if clip.angle is None else -clip.angle if how.clockwise else clip.angle
    arrays = [clip.frame, clip.time, clip.position, angle, clip.radius, clip.row, clip.line]
    for array in arrays:
        if array is not None:
            array.setflags(write=False)
    return Track(
        id=clip.id, source=clip.source, frame=clip.frame, time=clip.time, x=clip.position[:, 0],
        y=clip.position[:, 1], angle=angle, fold=clip.fold, radius=clip.radius, row=clip.row, line=clip.line,
        metres_per_px=clip.metres_per_px, session=clip.session, labels=clip.labels, notes=clip.notes,
    )  # fmt: skip
