"""Contents as files, whole or not at all (see `fitball.files`); rows as CSV, content as JSON; files read bounded."""

from __future__ import annotations

import csv
import io
import json
import math
import stat
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from fitball.errors import ResultFolderError
from fitball.files import is_stream, linked, refuse_special, write_whole
from fitball.visible import guarded
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
        raise ResultFolderError(f"{place}: this name is reserved for results of calibrate; choose another")
    if is_stream(place):
        return
    refuse_special(target)
    if target.is_symlink():
        raise ResultFolderError(f"{place}: a broken symbolic link; name another file")
    if target.exists() and not overwrite:
        raise ResultFolderError(f"{place}: exists already; choose another name, or use {option('overwrite')}")
    if not target.parent.is_dir():
        raise ResultFolderError(f"{place}: there is no folder {target.parent}; create it first")


# No fit.json of a thousand tables' parameters came near this; its values take ten times as much in memory.
MOST_BYTES = 64 * 2**20


def read_bounded(place: Path, most: int = MOST_BYTES) -> bytes:
    """The content of a regular file. Raises OSError, ResultFolderError for what is no file or has more bytes."""
    if not stat.S_ISREG(place.stat().st_mode):
        raise ResultFolderError(f"{place}: not a file; put back the file that fitball wrote, or run it again")
    with place.open("rb") as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise ResultFolderError(f"{place}: more than {most:,} bytes, so fitball did not write it")
    return content


# Letters that are written at once.
BLOCK = 1 << 16


def csv_text(rows: Iterable[Mapping[str, object]]) -> str:
    """Rows with equal keys as CSV text; what does not exist, None or NaN, becomes an empty cell, and
    no text is a formula (see `guarded`).
    """
    return "".join(_blocks(rows))


def write_csv(path: Path, rows: Iterable[Mapping[str, object]]) -> None:
    """The same as a file, whole or not at all, without holding all rows in memory. Raises ResultFolderError."""
    write_whole(path, (block.encode() for block in _blocks(rows)))


def _blocks(rows: Iterable[Mapping[str, object]]) -> Iterator[str]:
    out = io.StringIO()
    writer: csv.DictWriter[str] | None = None
    for row in rows:
        if writer is None:
            writer = csv.DictWriter(_Lines(out), fieldnames=list(row), lineterminator="\r\n")
            writer.writerow({key: guarded(key) for key in row})
        writer.writerow({key: _cell(value) for key, value in row.items()})
        if out.tell() > BLOCK:
            yield out.getvalue()
            out.seek(0)
            out.truncate()
    yield out.getvalue()


@dataclass(frozen=True)
class _Lines:
    """Takes lines that end with CR LF, so that a CR within a cell is quoted, and writes them ending with LF."""

    out: TextIO

    def write(self, line: str) -> int:
        """One row, as `csv` hands it over."""
        return self.out.write(line.removesuffix("\r\n") + "\n")


def _cell(value: object) -> object:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return guarded(value) if isinstance(value, str) else value


def json_text(content: object) -> str:
    """`content` as lines of JSON, the last one ended; NaN and infinity cannot occur."""
    return json.dumps(content, indent=1, allow_nan=False) + "\n"
