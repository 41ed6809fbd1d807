"""Folders that results are written to."""

from __future__ import annotations

import os
from pathlib import Path

from fitball.errors import ResultFolderError
from fitball.report.form.atomic_write import remove
from fitball.wording import option


def clear_folder(folder: Path, record: str, *others: str, overwrite: bool) -> None:
    """Make a folder for a new `record`; with `overwrite` an older one is removed first, and the `others` (patterns)
    beside it, so that no mixture of two results can pass for one.

    Raises ResultFolderError when it cannot be made, or holds a record that may not be replaced.
    """
    make_folder(folder)
    if not (folder / record).exists():
        return
    if not overwrite:
        raise ResultFolderError(
            f"{folder}: holds {record} of an older run; use {option('overwrite')} to replace it, or write to another "
            "folder"
        )
    for pattern in (record, *others):
        for place in folder.glob(pattern):
            remove(place)


def make_folder(folder: Path) -> None:
    """Make a folder that can be written. Raises ResultFolderError."""
    if folder.exists() and not folder.is_dir():
        raise ResultFolderError(f"{folder}: is a file; name a folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResultFolderError(f"{folder}: cannot be made: {error.strerror}; name another") from None
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ResultFolderError(f"{folder}: not writable; name another")
