"""Films and recordings as PyAV reads them: the one module that knows it.

A file is opened as a file of Python, and only as one of the formats that cameras and phones write:
no list of other files is followed, nothing is fetched, no other program is started.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from fitball.base.environment import install_command
from fitball.base.errors import Fault, FolderError, InputError
from fitball.base.text import one_line
from fitball.video.types import Plane

# Endings of films, and of recordings of sound.
FILMS = ("mp4", "mov", "m4v", "mkv", "avi", "webm", "3gp", "mts", "m2ts", "mpg", "mpeg", "wmv")
SOUNDS = ("wav", "mp3", "m4a", "aac", "flac", "ogg", "opus", "aif", "aiff", "caf", "amr", "wma")
# Demuxers that may be used; each opens the one file only.
_FORMATS = "mov,matroska,avi,mpegts,mpeg,asf,wav,w64,mp3,aac,flac,ogg,aiff,caf,amr"
# Pictures whose planes are used as they are; others are converted to the first.
_PLANAR = ("yuv420p", "yuvj420p", "yuv422p", "yuvj422p", "yuv444p", "yuvj444p")
# Levels of black and white: of films, and where all levels are used (ITU-R BT.709 and JFIF).
_STUDIO = (16.0, 235.0)
_FULL = (0.0, 255.0)
# `color_range` of frames that use all levels.
_ALL_LEVELS = 2


def is_film(source: object) -> bool:
    """Whether a source is named as films are."""
    return _ending(source) in FILMS


def is_sound(source: object) -> bool:
    """Whether a source is named as recordings of sound are."""
    return _ending(source) in SOUNDS


def _ending(source: object) -> str:
    """The ending of a path, in small letters without the dot; empty of a table in memory."""
    return Path(source).suffix.lower()[1:] if isinstance(source, str | Path) else ""


def refusal(path: Path, code: str, words: str) -> InputError:
    """A file that cannot be used: the code, and what is wrong with it."""
    return InputError(path.name, [Fault(code, words)])


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """The container of a film or a recording.

    Raises:
        FolderError: no such file (`not-found`).
        InputError: PyAV is not installed (`no-pyav`), the file is no film and no recording
            (`not-a-film`), or it is damaged (`broken-film`), now or when it is read.
    """
    try:
        import av
    except ImportError:
        command = install_command("fitball[film]")
        words = f"needs the package that reads films and sound: {command}"
        raise refusal(path, "no-pyav", words) from None
    # Its own messages would come between the lines of fitball.
    av.logging.set_level(None)
    try:
        file = path.open("rb")
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        words = f"{one_line(str(path))}: cannot be opened: {why}; expected a film"
        raise FolderError(words, "not-found") from None
    with file:
        options = {"format_whitelist": _FORMATS, "protocol_whitelist": "file"}
        try:
            container = av.open(file, options=options)
        except (av.FFmpegError, OSError, ValueError) as error:
            words = f"is no film or recording that can be read ({_why(error)}); copy it again"
            raise refusal(path, "not-a-film", words) from None
        with container:
            try:
                yield container
            except av.FFmpegError as error:
                words = f"is damaged ({_why(error)}): copy it again from the camera"
                raise refusal(path, "broken-film", words) from None


def _why(error: Exception) -> str:
    """What PyAV says of a fault, without numbers and file names."""
    return one_line(str(getattr(error, "strerror", None) or error))


def planes_of(frame: Any) -> tuple[Plane, Plane]:
    """Luma (rows, columns) and chroma (some rows, some columns, 2) of a frame, turned upright."""
    if frame.format.name not in _PLANAR:
        frame = frame.reformat(format=_PLANAR[0])
    luma, blue, red = (_plane(plane) for plane in frame.planes)
    turns = quarter_turns(frame)
    chroma = np.stack([blue, red], axis=-1)
    return np.ascontiguousarray(np.rot90(luma, turns)), np.rot90(chroma, turns)


def luma_of(frame: Any) -> Plane:
    """Luma of a frame as it is stored, not turned; valid as long as the frame is."""
    if frame.format.name not in _PLANAR:
        frame = frame.reformat(format=_PLANAR[0])
    return _plane(frame.planes[0])


def _plane(plane: Any) -> Plane:
    """A plane without the bytes that fill its lines."""
    lines = np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)
    return lines[: plane.height, : plane.width]


def quarter_turns(frame: Any) -> int:
    """How often a frame is to be turned counterclockwise by a quarter to be upright."""
    return int(round(frame.rotation / 90.0) % 4)


def levels_of(frame: Any) -> tuple[float, float]:
    """Luma of black and of white of a frame."""
    name = frame.format.name
    if name.startswith("yuvj"):
        return _FULL
    # What is converted is converted to the levels of films.
    return _FULL if name in _PLANAR and frame.color_range == _ALL_LEVELS else _STUDIO
