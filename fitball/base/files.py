"""Files and result folders, whole or not at all, one run at a time.

Owns: temporary name and rename, CSV and JSON text, the lock of a folder (filelock). Nobody else
writes files.
"""

from __future__ import annotations

import json
import os
import re
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from fitball.base.errors import FolderError
from fitball.base.text import one_line

if TYPE_CHECKING:
    from pandas import DataFrame

# The page of a result. Of all but fits it is written last, and says that the result is complete.
REPORT_FILE = "report.html"
# The record of a fit, which is written last.
FIT_FILE = "fit.json"
# A folder has this file while a run holds it.
_LOCK = ".fitball.lock"
# What fitball wrote into a folder, so that no file of an older result is taken for one of the next.
_WRITTEN = ".fitball-files"
# What a killed run leaves.
_PARTIAL = ".fitball-*.partial"
# How long figures wait for a run that writes into the folder of their fit [s].
WAIT = 60.0
# How cells begin that spreadsheets compute (OWASP, "CSV Injection").
_FORMULA = re.compile(r"'*[=+\-@\t\r\n\uff1d\uff0b\uff0d\uff20]")
# The numbers among these, which are no formula.
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


@dataclass(frozen=True)
class ResultFolder:
    """A folder whose lock this process holds; only `result_folder` makes one. `record` ends a
    result.
    """

    path: Path
    record: str = ""

    def write(self, name: str, content: bytes) -> Path:
        """Write a file whole or not at all, and return its path.

        Raises:
            FolderError: it cannot be written (`not-written`).
        """
        path = self.path / name
        partial = path.with_name(f".fitball-{secrets.token_hex(8)}.partial")
        try:
            # Files for other programs are put into any folder, which no result ever clears.
            if self.record or (self.path / _WRITTEN).exists():
                with (self.path / _WRITTEN).open("a", encoding="utf-8") as written:
                    written.write(f"{name}\n")
            try:
                # Exclusive: what lies there by that name, a link too, is not touched.
                with partial.open("xb") as file:
                    file.write(content)
                    file.flush()
                    # Else a machine that loses power may keep the name and lose the content.
                    os.fsync(file.fileno())
                partial.replace(path)
            finally:
                partial.unlink(missing_ok=True)
        except OSError as error:
            raise _refused(path, error, "not-written") from None
        return path

    def below(self, name: str) -> ResultFolder:
        """A folder in this one, under the same lock; it is made if it is not there.

        Raises:
            FolderError: it cannot be made (`no-folder`).
        """
        path = self.path / name
        try:
            path.mkdir(exist_ok=True)
            for partial in path.glob(_PARTIAL):
                partial.unlink(missing_ok=True)
        except OSError as error:
            raise _refused(path, error, "no-folder") from None
        return ResultFolder(path)

    def clear(self) -> None:
        """Remove the older result, nothing without `record`; other files stay.

        Raises:
            FolderError: a file cannot be removed (`not-written`).
        """
        if not self.record:
            return
        try:
            # The record first: without it nothing passes for a result.
            (self.path / self.record).unlink(missing_ok=True)
            # A last line that is cut off names no file.
            names = (self.path / _WRITTEN).read_text(encoding="utf-8").split("\n")[:-1]
            for name in dict.fromkeys([*names, _WRITTEN]):
                # The list may come from anywhere: names of this folder only.
                if name == PurePosixPath(name).name and name not in ("", ".."):
                    (self.path / name).unlink(missing_ok=True)
        except FileNotFoundError:
            return
        except OSError as error:
            raise _refused(self.path, error, "not-written") from None


@contextmanager
def result_folder(
    path: Path,
    *,
    overwrite: bool = False,
    record: str = "",
    wait: float = 0.0,
) -> Iterator[ResultFolder]:
    """Make and lock a folder. An older result, with `record` as the file written last, is refused
    unless `overwrite` and stays until `clear`, so that a run that fails loses nothing. `wait` is
    how long another run is waited for [s].

    Raises:
        FolderError: another run holds the folder (`folder-in-use`), it has an older result
            (`older-result`), or it cannot be made (`no-folder`).
    """
    from filelock import FileLock, Timeout

    lock = FileLock(path / _LOCK, timeout=wait)
    try:
        missing = [folder for folder in (path, *path.parents) if not folder.exists()]
        path.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        text = (
            f"{path}: another run of fitball writes into this folder; wait until it ends, or "
            "name another folder"
        )
        raise FolderError(text, "folder-in-use") from None
    except (OSError, ValueError) as error:
        # A zero byte in the name is a ValueError.
        raise _refused(path, error, "no-folder") from None
    try:
        for partial in path.glob(_PARTIAL):
            partial.unlink(missing_ok=True)
        if record and (path / record).exists() and not overwrite:
            remedy = "replace it with --overwrite (overwrite=True), or name another folder"
            raise FolderError(f"{path}: has {record} of an older run; {remedy}", "older-result")
        yield ResultFolder(path, record)
    finally:
        # Before the release: who waits for a lock that is unlinked looks again. Windows removes no
        # open file.
        if os.name == "posix":
            (path / _LOCK).unlink(missing_ok=True)
        lock.release()
        # Folders that were made for nothing; those that hold something stay.
        with suppress(OSError):
            for folder in missing:
                folder.rmdir()


def _refused(path: Path, error: Exception, code: str) -> FolderError:
    """Why a file or folder cannot be written, with the remedy."""
    what = "be written" if code == "not-written" else "be a result folder"
    why = getattr(error, "strerror", "") or error
    text = f"{one_line(str(path))}: cannot {what}: {why}; change that, or name another folder"
    return FolderError(text, code)


def with_index(frame: DataFrame) -> DataFrame:
    """A frame with its index as first column, where that has a name."""
    return frame.reset_index() if frame.index.names != [None] else frame


def csv_bytes(frame: DataFrame) -> bytes:
    """A frame as CSV, its index where that has a name: every digit of a number, empty cells for
    what is missing, and no text that a spreadsheet would compute.
    """
    table = with_index(frame).rename(columns=_guarded)
    texts = table.columns[[kind.kind not in "biuf" for kind in table.dtypes]]
    table[texts] = table[texts].map(_guarded)
    return table.to_csv(index=False, lineterminator="\n").encode()


def _guarded(cell: object) -> object:
    """A text that a spreadsheet would compute, guards aside, with one guard more."""
    if isinstance(cell, str) and _FORMULA.match(cell) and not _NUMBER.fullmatch(cell):
        return f"'{cell}"
    return cell


def json_bytes(content: object) -> bytes:
    """Values that JSON has, as lines of it, the last one ended.

    Raises:
        ValueError: a number is NaN or infinite, which JSON has not.
    """
    return (json.dumps(content, indent=1, allow_nan=False) + "\n").encode()
