"""Files written whole or not at all: to a temporary name beside the place, then renamed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from fitball.errors import ResultFolderError
from fitball.wording import option

# Files of a result folder: what is derived from them never takes their place.
OWN_FILES = ("fit.json", "data.nc", "posterior.nc", "posterior.h5")


def write_whole(path: Path, write: Callable[[Path], None]) -> None:
    """Let `write` fill a temporary file and rename it to `path`; the temporary one never stays behind.

    Raises ResultFolderError when the system refuses.
    """
    temporary = path.with_name(f".{path.stem}.partial{path.suffix}")
    try:
        write(temporary)
        temporary.replace(path)
    except OSError as error:
        raise ResultFolderError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        temporary.unlink(missing_ok=True)


def remove(path: Path) -> None:
    """Remove a file, if there is one. Raises ResultFolderError when the system refuses, as for a folder."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise ResultFolderError(f"{path}: cannot be removed: {error.strerror}; move it away") from None


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file. Raises ResultFolderError."""

    def write(place: Path) -> None:
        place.write_bytes(content)

    write_whole(path, write)


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text with plain newlines. Raises ResultFolderError."""
    write_bytes(path, text.encode("utf-8"))


def refuse_existing(place: Path, overwrite: bool) -> None:
    """Raise ResultFolderError for a file that is there, unless it may be replaced, and for a missing folder."""
    if place.name in OWN_FILES:
        raise ResultFolderError(f"{place}: this name belongs to the result of a calibration; choose another")
    if place.exists() and not overwrite:
        raise ResultFolderError(
            f"{place}: exists already; choose another name, or allow it with {option('overwrite')}"
        )
    if not place.parent.is_dir():
        raise ResultFolderError(f"{place}: there is no folder {place.parent}; make it first")
