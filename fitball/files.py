"""Files written whole or not at all: under a random name in their folder, opened exclusively, then renamed.

A reader sees the old file or the new one. What a file holds is made before it is opened, HDF5 too: that library ends
the process where it cannot write.
"""

from __future__ import annotations

import errno
import os
import re
import secrets
import shutil
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from fitball.errors import ResultFolderError

# Files that a killed run leaves behind; whoever writes in the folder next removes them (`report.form.folders`).
LEFTOVERS = ".fitball-*.partial"
FULL = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the quota of this user is used up",
    errno.EFBIG: "larger than the limit for files (ulimit -f)",
}
KINDS = ((stat.S_ISDIR, "a folder"), (stat.S_ISFIFO, "a pipe"), (stat.S_ISSOCK, "a socket"))
# The descriptors that a path names: a file that one leads to is written on, not replaced.
STREAMS = {"/dev/stdout": 1, "/dev/stderr": 2}
DESCRIPTOR = re.compile(r"/(?:dev|proc/self)/fd/(\d+)")

_WRITTEN: ContextVar[list[Path] | None] = ContextVar("_WRITTEN", default=None)


def write_whole(path: Path, parts: Iterable[bytes | memoryview], *, named: bool = False) -> None:
    """Write a file of these parts, in place of a regular file or a symbolic link, with the permissions of the umask.

    A path that the user `named` is taken as a shell does: the file that a link leads to is replaced, pipes and
    character devices are written into. Raises ResultFolderError when the system refuses, or where something lies that
    is no file; BrokenPipeError when the reader of a pipe has left.
    """
    if named and is_stream(path):
        _write_stream(path, parts)
        return
    place = linked(path) if named else path
    refuse_special(place)
    temporary, asked = place.with_name(f".fitball-{secrets.token_hex(8)}.partial"), 0
    try:
        # Exclusive: what lies there by that name, a link too, is not touched.
        file = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o666)
        try:
            for part in parts:
                asked += len(part)
                _write(file, part)
        finally:
            os.close(file)
        temporary.replace(place)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise ResultFolderError(refusal(path, error, asked)) from None
        raise
    written = _WRITTEN.get()
    if written is not None:
        written.append(place)


@contextmanager
def all_or_none() -> Iterator[None]:
    """Files written meanwhile are removed again when not all can be: no part of a result is left."""
    outer = _WRITTEN.get()
    written: list[Path] = []
    before = _WRITTEN.set(written)
    try:
        yield
    except BaseException:
        for place in written:
            place.unlink(missing_ok=True)
        raise
    finally:
        _WRITTEN.reset(before)
    if outer is not None:
        outer.extend(written)


def linked(path: Path) -> Path:
    """Where a symbolic link leads; any other path as it is."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def refuse_special(path: Path) -> None:
    """Raise ResultFolderError where something lies that is neither a regular file nor a symbolic link."""
    try:
        mode = path.lstat().st_mode
    except OSError:
        # Nothing is there, or whoever opens it is told why it cannot be.
        return
    if not stat.S_ISREG(mode) and not stat.S_ISLNK(mode):
        kind = next((words for is_kind, words in KINDS if is_kind(mode)), "a device")
        raise ResultFolderError(f"{path}: is {kind}; only regular files are replaced: name another, or move it away")


def is_stream(path: Path) -> bool:
    """Whether a path that a user named is written into and holds nothing to replace: a pipe, a terminal or another
    character device, a descriptor of this process such as `/dev/stdout`.
    """
    if _descriptor(path) is not None:
        return True
    try:
        mode = path.stat().st_mode
    except OSError:
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISCHR(mode)


def refusal(path: Path, error: OSError, asked: int) -> str:
    """Why a file of (at least) so many bytes was not written."""
    if error.errno not in FULL:
        return f"{path}: cannot be written: {error.strerror or error}"
    needed = f"it needs at least {asked:,} bytes" if asked else "there is no space for another file"
    free = f", {shutil.disk_usage(path.parent).free:,} are free" if error.errno == errno.ENOSPC and asked else ""
    return f"{path}: {FULL[error.errno]}: {needed}{free}; it was not written: free some space, or name another place"


def _write(file: int, part: bytes | memoryview) -> None:
    rest = memoryview(part).cast("B")
    while rest:
        rest = rest[os.write(file, rest) :]


def _descriptor(path: Path) -> int | None:
    text = os.fspath(path)
    found = DESCRIPTOR.fullmatch(text)
    return int(found[1]) if found else STREAMS.get(text) if os.name == "posix" else None


def _write_stream(path: Path, parts: Iterable[bytes | memoryview]) -> None:
    """All parts, once all are made."""
    parts, number = list(parts), _descriptor(path)
    # What was printed stands before it.
    print(end="", flush=True)
    try:
        # A pipe without a reader waits for one, as everywhere.
        file = os.open(path, os.O_WRONLY | getattr(os, "O_NOCTTY", 0)) if number is None else os.dup(number)
        try:
            for part in parts:
                _write(file, part)
        finally:
            os.close(file)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise ResultFolderError(refusal(path, error, sum(map(len, parts)))) from None
