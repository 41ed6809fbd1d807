"""Folders that results are written to: made, held by one run at a time, cleared of what is replaced."""

from __future__ import annotations

import errno
import getpass
import json
import os
import platform
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from fitball.errors import ResultFolderError
from fitball.files import LEFTOVERS, refusal, refuse_special
from fitball.report.form.files import remove
from fitball.wording import option

if TYPE_CHECKING:
    from filelock import FileLock

# While a run holds a folder this file says who does. The lock on it is the system's, and ends with the process.
LOCK_NAME = ".fitball.lock"
# What short work, such as drawing a figure, waits for the run that holds its folder [s].
PATIENCE = 60.0
# What file systems say that have no locks.
NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP)


@contextmanager
def held(folder: Path, patience: float = 0.0) -> Iterator[None]:
    """Hold a folder, which is made, so that no other run writes in it meanwhile. Files that killed runs left half
    written are removed. Network file systems pass the lock to other machines if they pass on `flock`; without locks
    there is a warning.

    Raises ResultFolderError when it cannot be made, or another run holds it for longer than `patience` seconds.
    """
    from filelock import FileLock, Timeout

    make_folder(folder)
    place = folder / LOCK_NAME
    refuse_special(place)
    # A link is refused by filelock itself.
    lock = FileLock(place, timeout=patience, on_acquired=_sign, fallback_to_soft=False)
    try:
        lock.acquire()
    except Timeout:
        raise ResultFolderError(
            f"{folder}: another run of fitball uses this folder: {_holder(place)}; wait until it ends, or name "
            "another folder"
        ) from None
    except PermissionError:
        raise ResultFolderError(
            f"{place}: cannot be locked: {_holder(place)}; remove this file if that run has ended"
        ) from None
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise ResultFolderError(refusal(place, error, 0)) from None
        warnings.warn(f"{folder}: this file system has no locks: do not start a second run here", stacklevel=3)
    try:
        clear_leftovers(folder)
        yield
    finally:
        _release(lock, place)


def _sign(file: int) -> None:
    """Say in the locked file who holds it; its first byte cannot be read by others on Windows."""
    try:
        user = getpass.getuser()
    except (KeyError, OSError, ImportError):
        user = "unknown"
    since = datetime.now().astimezone().isoformat(" ", "seconds")
    holder = {"pid": os.getpid(), "user": user, "host": platform.node(), "since": since}
    # Where the disk is full the first file that is written says so.
    with suppress(OSError):
        os.ftruncate(file, 0)
        os.write(file, b"\n" + json.dumps(holder).encode())


def _holder(place: Path) -> str:
    try:
        with place.open("rb", buffering=0) as file:
            file.seek(1)
            told = json.loads(file.read(1000))
        return f"process {told['pid']} of user {told['user']} on {told['host']}, since {told['since']}"
    except (OSError, ValueError, LookupError, TypeError):
        return "unknown process"


def _release(lock: FileLock, place: Path) -> None:
    # Who waited for the lock of a file that has gone looks for another; Windows removes no open file. One that stays
    # does no harm.
    if os.name == "posix":
        with suppress(OSError):
            place.unlink(missing_ok=True)
        lock.release()
    else:
        lock.release()
        with suppress(OSError):
            place.unlink(missing_ok=True)


def clear_leftovers(folder: Path) -> None:
    """Remove what killed runs left half written in a folder that is held. Raises ResultFolderError."""
    for leftover in folder.glob(LEFTOVERS):
        remove(leftover)


def clear_folder(folder: Path, record: str, *others: str, overwrite: bool) -> None:
    """Make a folder for a new `record`; with `overwrite` an older one is removed first, and the `others` (patterns)
    beside it, so that no mixture of two results can pass for one.

    Raises ResultFolderError when it cannot be made, or holds a record that may not be replaced.
    """
    make_folder(folder)
    refuse_older(folder, record, overwrite=overwrite)
    for pattern in (record, *others) if (folder / record).exists() else ():
        for place in folder.glob(pattern):
            remove(place)


def refuse_older(folder: Path, record: str, *, overwrite: bool) -> None:
    """Raise ResultFolderError for a folder that holds a record which may not be replaced."""
    if (folder / record).exists() and not overwrite:
        raise ResultFolderError(
            f"{folder}: has {record} of an older run; use {option('overwrite')} to replace it, or write to another "
            "folder"
        )


def make_folder(folder: Path) -> None:
    """Make a folder that can be written. Raises ResultFolderError."""
    if folder.exists() and not folder.is_dir():
        raise ResultFolderError(f"{folder}: is a file; name a folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResultFolderError(f"{folder}: cannot be created: {error.strerror}; name another") from None
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ResultFolderError(f"{folder}: not writable; name another folder")
