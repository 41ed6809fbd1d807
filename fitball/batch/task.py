"""The tables of a batch: found, named, each with its folder."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from fitball.api.calibrating import PathLike, Table
from fitball.data.written import in_memory
from fitball.errors import ParameterError

# Endings of tables; a pattern such as `courts/*` meets scenes and notes too.
TABLES = (".csv", ".tsv", ".txt", ".xlsx", ".ods", ".parquet")


@dataclass(frozen=True)
class Task:
    """One table under the `name` that its folder and its row have."""

    name: str
    table: Table


def tasks_of(
    tables: Mapping[str, Table] | Sequence[Table] | PathLike, results: Path | None = None
) -> tuple[Task, ...]:
    """The tasks of named tables, or of paths, patterns (`courts/*.csv`, `**` for folders at any depth), folders and
    names of bundled tables, sorted by name. Files are named by their path below the folder that all have in common.
    What lies in the folder of `results` is none of them: a pattern may meet what an earlier run wrote.

    Raises ParameterError for a pattern or folder without a table, and for tables without a name.
    """
    if isinstance(tables, Mapping):
        if not tables:
            raise ParameterError("no table was named")
        return tuple(Task(_folder_name(name), table) for name, table in tables.items())
    given: list[Any] = [tables]
    if isinstance(tables, Iterable) and not isinstance(tables, (str, os.PathLike)) and not in_memory(tables):
        given = list(tables)
    found: dict[Path, str] = {}
    for item in given:
        if not isinstance(item, (str, os.PathLike)):
            raise ParameterError("tables that are no files have no names: pass a mapping, {name: table}")
        # `courts/a.csv` and `./courts/a.csv` are one table.
        found |= {Path(path).absolute(): path for path in _files(os.fspath(item)) if not _within(path, results)}
    if not found:
        raise ParameterError("no table was named")
    return tuple(Task(name, path) for name, path in sorted(zip(_names(list(found)), found.values(), strict=True)))


def _within(path: str, folder: Path | None) -> bool:
    return folder is not None and Path(path).absolute().is_relative_to(folder.absolute())


def _files(text: str) -> list[str]:
    """The tables that a path, a folder or a pattern stands for."""
    if Path(text).is_file():
        return [text]
    if Path(text).is_dir():
        inside = sorted(str(place) for place in Path(text).iterdir() if place.suffix.lower() in TABLES)
        if not inside:
            raise ParameterError(f"{text}: no table in this folder; tables end in {', '.join(TABLES)}")
        return inside
    if not glob.has_magic(text):
        # A bundled table, or a fault of its own that its row will tell.
        return [text]
    # As a shell reads it: pathlib takes no absolute patterns.
    matches = sorted(glob.glob(text, recursive=True))  # noqa: PTH207
    inside = [place for place in matches if Path(place).is_file()]
    # `*` takes scenes beside their tables too; who writes an ending means it.
    if Path(text).suffix == "" or "*" in Path(text).suffix:
        inside = [place for place in inside if Path(place).suffix.lower() in TABLES]
    if not inside:
        raise ParameterError(f"{text}: no file matches this pattern")
    return inside


def _names(paths: Sequence[Path]) -> list[str]:
    """Absolute paths below their common folder without endings; with them where two would be the same."""
    common = Path(os.path.commonpath([path.parent for path in paths]))
    below = [path.relative_to(common) for path in paths]
    bare = [path.with_suffix("").as_posix() for path in below]
    return [path.as_posix() if bare.count(name) > 1 else name for name, path in zip(bare, below, strict=True)]


def _folder_name(name: object) -> str:
    """A name that a folder below another can have, in one spelling. Raises ParameterError for another."""
    if isinstance(name, str) and name.strip() and "\0" not in name:
        place = PurePosixPath(name)
        if place.as_posix() == name and not place.is_absolute() and not {"..", "."} & {*place.parts, name}:
            return name
    raise ParameterError(f"table {name!r}: expected a text that a folder can be called, such as 'court 3'")
