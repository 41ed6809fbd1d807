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
from fitball.tracks.split import one_object, stretches

if TYPE_CHECKING:
    import pandas

# What positions may be read from: a path or bundled name, or a DataFrame.
Source: TypeAlias = "str | os.PathLike[str] | pandas.DataFrame"


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
    return tuple(_track(clip) for members in sessions.values() for clip in _settled(members, how))


def _clips(source: Source, how: Reading) -> list[Clip]:
    vocabulary = positions_vocabulary(how)
    if not isinstance(source, PATHS):
        name = str(source.attrs.get("name", FRAME))
        return clips_of(checked_records(name, source), b"", (), name, how)
    path, sheet = resolve_tracks(source), split_sheet(source)[1]
    if path.suffix.lower() in SUFFIXES:
        return hdf5_clips(path, how)
    records, data, notes = read_records(path, vocabulary, sheet)
    return clips_of(records, data, notes, str(path), how)


def _distinct(clips: Sequence[Clip]) -> list[Clip]:
    """The clips with ids of their own: where files share one it is preceded by the file's name, then numbered."""
    counts = Counter(clip.id for clip in clips)
    named = [
        clip if counts[clip.id] == 1 else replace(clip, id=f"{Path(clip.source).stem}-{clip.id}") for clip in clips
    ]
    seen, again = Counter[str](), []
    for clip in named:
        seen[clip.id] += 1
        again.append(clip if seen[clip.id] == 1 else replace(clip, id=f"{clip.id} ({seen[clip.id]})"))
    return again


def _settled(clips: Sequence[Clip], how: Reading) -> list[Clip]:
    """The clips of a session in metres and seconds, (frames, 2)."""
    measured, mixed = list[Clip](), set[str]()
    for clip in in_metres(timed(clips, how), how):
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


def _planes(clip: Clip) -> list[Clip]:
    """The bounces of a clip in three dimensions, each in the plane of its incident flight."""
    assert clip.time is not None
    parts = stretches(clip.time, bounces(clip.time, clip.position[:, 2]))
    if len(parts) < 2:
        return [in_plane(clip)]
    return [in_plane(replace(clip.take(np.arange(*part)), id=f"{clip.id}-{k}")) for k, part in enumerate(parts, 1)]


def _track(clip: Clip) -> Track:
    assert clip.time is not None
    arrays = [clip.frame, clip.time, clip.position, clip.angle, clip.radius, clip.row, clip.line]
    for array in arrays:
        if array is not None:
            array.setflags(write=False)
    return Track(
        id=clip.id, source=clip.source, frame=clip.frame, time=clip.time, x=clip.position[:, 0],
        y=clip.position[:, 1], angle=clip.angle, fold=clip.fold, radius=clip.radius, row=clip.row, line=clip.line,
        metres_per_px=clip.metres_per_px, session=clip.session, notes=clip.notes,
    )  # fmt: skip
