"""Files written whole or not at all: to a temporary name beside the place, then renamed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from fitball.errors import ResultFolderError


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


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text with plain newlines. Raises ResultFolderError."""

    def write(place: Path) -> None:
        place.write_bytes(text.encode("utf-8"))

    write_whole(path, write)
