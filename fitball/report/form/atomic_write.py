"""Contents as files, whole or not at all (see `fitball.files`), and whether a user's file may be written."""

from __future__ import annotations

from pathlib import Path

from fitball.errors import ResultFolderError
from fitball.files import is_stream, linked, refuse_special, write_whole
from fitball.wording import option

# Files of a result folder: what is derived from them never takes their place.
OWN_FILES = ("fit.json", "data.nc", "posterior.nc", "posterior.h5")


def write_bytes(path: Path, content: bytes | memoryview, *, named: bool = False) -> None:
    """Write a file, `named` by the user or ours. Raises ResultFolderError as `write_whole` does."""
    write_whole(path, [content], named=named)


def write_text(path: Path, text: str, *, named: bool = False) -> None:
    """Write UTF-8 text with plain newlines. Raises ResultFolderError as `write_whole` does."""
    write_bytes(path, text.encode("utf-8"), named=named)


def remove(path: Path) -> None:
    """Remove a file or a symbolic link, if there is one. Raises ResultFolderError for anything else, and when the
    system refuses.
    """
    refuse_special(path)
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise ResultFolderError(f"{path}: cannot be removed: {error.strerror}; move it away") from None


def refuse_existing(place: Path, overwrite: bool) -> None:
    """Raise ResultFolderError for a file that is there, unless it may be replaced, for anything else that cannot be
    written, and for a missing folder. What is a stream (`files.is_stream`) holds nothing to replace.
    """
    target = linked(place)
    if {place.name, target.name} & {*OWN_FILES}:
        raise ResultFolderError(f"{place}: this name belongs to the result of a calibration; choose another")
    if is_stream(place):
        return
    refuse_special(target)
    if target.is_symlink():
        raise ResultFolderError(f"{place}: a symbolic link that leads nowhere; name another file")
    if target.exists() and not overwrite:
        raise ResultFolderError(
            f"{place}: exists already; choose another name, or allow it with {option('overwrite')}"
        )
    if not target.parent.is_dir():
        raise ResultFolderError(f"{place}: there is no folder {target.parent}; make it first")
