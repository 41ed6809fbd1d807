"""Folders that results are written to."""

from __future__ import annotations

import os
from pathlib import Path

from fitball.errors import ResultFolderError


def holds_older(folder: Path, record: str, *, overwrite: bool) -> bool:
    """Make a folder that can be written; whether it holds an older `record` that is to be replaced.

    Raises ResultFolderError when it cannot be made, or holds one that may not.
    """
    make_folder(folder)
    if not (folder / record).exists():
        return False
    if not overwrite:
        raise ResultFolderError(
            f"{folder}: holds {record} of an older run; use --overwrite to replace it, or --out to write elsewhere"
        )
    return True


def make_folder(folder: Path) -> None:
    """Make a folder that can be written. Raises ResultFolderError."""
    if folder.exists() and not folder.is_dir():
        raise ResultFolderError(f"{folder}: is a file; name a folder with --out")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResultFolderError(f"{folder}: cannot be made: {error.strerror}; name another with --out") from None
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ResultFolderError(f"{folder}: not writable; name another with --out")
