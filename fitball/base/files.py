"""Files and result folders, whole or not at all, one run at a time.

Owns: temporary name and rename, CSV and JSON text, the lock of a folder (filelock), the exchange of
an older result for a new one. Nobody else writes files.

A new result is written into a folder inside the old one. When it is whole, one rename makes that
folder `.fitball-next`: from there on the new result counts. Then its files are moved to their
places. Whatever stops the run, one of the two is whole: before the rename the old one, after it the
new one, of which readers take files from `.fitball-next` first (`content_of`) and whose move the
next run ends.
"""

from __future__ import annotations

import errno
import json
import os
import re
import secrets
import shutil
from collections.abc import Iterable, Iterator, Mapping
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
# A whole result whose files are being moved to their places.
_NEXT = ".fitball-next"
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
    """A folder whose lock this process holds; only `result_folder` makes one."""

    path: Path

    def write(self, name: str, content: bytes) -> Path:
        """Write a file whole or not at all beside what the folder has, and return its path.

        Raises:
            FolderError: it cannot be written (`not-written`).
        """
        path = self.path / name
        list_of_files = self.path / _WRITTEN
        try:
            # Files for other programs are put into any folder, which no result ever clears.
            if list_of_files.exists() or list_of_files.is_symlink():
                names = [*_names_in(list_of_files), name]
                _write(list_of_files, _lines(names))
            _write(path, content)
        except OSError as error:
            raise _refused(path, error, "not-written") from None
        return path

    def replace(self, contents: Mapping[str, bytes]) -> tuple[Path, ...]:
        """Write a whole result in place of the older one, of which nothing is left; other files
        stay. `contents` by name, the record last. Returns the paths.

        Raises:
            FolderError: it cannot be written (`not-written`); before all of it is, the older
                result stays as it was.
        """
        new = _partial_in(self.path)
        path = self.path
        try:
            new.mkdir()
            try:
                for name in contents:
                    path = self.path / name
                    # Found now: later, the new result would be whole but not in its place.
                    if path.is_dir() and not path.is_symlink():
                        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
                    _write(new / name, contents[name])
                _write(new / _WRITTEN, _lines(contents))
                new.rename(self.path / _NEXT)
            finally:
                _remove(new)
            path = self.path
            _move_next(self.path)
        except OSError as error:
            raise _refused(path, error, "not-written") from None
        return tuple(self.path / name for name in contents)

    def below(self, name: str) -> ResultFolder:
        """A folder in this one, under the same lock; it is made if it is not there.

        Raises:
            FolderError: it cannot be made (`no-folder`).
        """
        path = self.path / name
        try:
            path.mkdir(exist_ok=True)
            _settle(path)
        except OSError as error:
            raise _refused(path, error, "no-folder") from None
        return ResultFolder(path)


@contextmanager
def result_folder(
    path: Path,
    *,
    overwrite: bool = False,
    record: str = "",
    wait: float = 0.0,
) -> Iterator[ResultFolder]:
    """Make and lock a folder. An older result, which has the file `record` or is a fit, is refused
    unless `overwrite`, and stays until `replace` has all of the new one. `wait` is how long another
    run is waited for [s].

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
        try:
            _settle(path)
        except OSError as error:
            raise _refused(path, error, "not-written") from None
        older = [name for name in (record, FIT_FILE) if name and (path / name).exists()]
        if record and older and not overwrite:
            remedy = "replace it with --overwrite (overwrite=True), or name another folder (--out)"
            raise FolderError(f"{path}: has {older[0]} of an older run; {remedy}", "older-result")
        yield ResultFolder(path)
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


def content_of(file: Path) -> bytes:
    """The bytes of a file of a result, of the new one where a run was stopped while it replaced an
    older one. Raises OSError.
    """
    with suppress(FileNotFoundError, NotADirectoryError):
        return (file.parent / _NEXT / file.name).read_bytes()
    return file.read_bytes()


def _write(path: Path, content: bytes) -> None:
    """Write a file whole or not at all. Raises OSError."""
    partial = _partial_in(path.parent)
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


def _partial_in(folder: Path) -> Path:
    """A name in a folder for what is not whole yet."""
    return folder / f".fitball-{secrets.token_hex(8)}.partial"


def _settle(folder: Path) -> None:
    """End what a stopped run left: a whole new result is moved to its place, parts of one are
    removed. Raises OSError.
    """
    for partial in folder.glob(_PARTIAL):
        _remove(partial)
    if (folder / _NEXT).is_symlink() or not (folder / _NEXT / _WRITTEN).exists():
        # No run leaves such a thing, but the end of one that has moved all.
        _remove(folder / _NEXT)
    else:
        _move_next(folder)


def _move_next(folder: Path) -> None:
    """Move the files of a new result, which is whole, to their places, and remove what else the
    older one has. Raises OSError; another call goes on then.
    """
    new = folder / _NEXT
    names = _names_in(new / _WRITTEN)
    older = {*_names_in(folder / _WRITTEN)} - {*names}
    for path in folder.iterdir():
        if path.name in older and (path.is_symlink() or not path.is_dir()):
            path.unlink(missing_ok=True)
    # The list is last: by it another call knows what is to be moved.
    for name in (*names, _WRITTEN):
        # One that is not there has been moved.
        with suppress(FileNotFoundError):
            (new / name).replace(folder / name)
    _remove(new)


def _remove(path: Path) -> None:
    """Remove a file, a link or a folder, if there is one. Raises OSError."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _lines(names: Iterable[str]) -> bytes:
    """The content of a list of files."""
    return "".join(f"{name}\n" for name in dict.fromkeys(names)).encode()


def _names_in(list_of_files: Path) -> list[str]:
    """The names in a list of files, none if there is no list or a link in its place."""
    if list_of_files.is_symlink() or not list_of_files.is_file():
        return []
    # A last line that is cut off names no file.
    names = list_of_files.read_text(encoding="utf-8", errors="replace").split("\n")[:-1]
    # The list may come from anywhere: names of this folder only.
    return [name for name in names if name == PurePosixPath(name).name and name not in ("", "..")]


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
