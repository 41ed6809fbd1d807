"""The tables of a batch: found, named, each with its folder."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fitball.api.calibrating import PathLike, Table
from fitball.batch.names import faults, names_of
from fitball.data.read import in_memory
from fitball.errors import ParameterError
from fitball.visible import one_line

# Endings of tables; a pattern such as `courts/*` meets scenes and notes too.
TABLES = (".csv", ".tsv", ".txt", ".xlsx", ".ods", ".parquet")


@dataclass(frozen=True)
class Task:
    """One table under the `name` that its folder and its row have; `fault` says why no folder can be called so."""

    name: str
    table: Table
    fault: str = ""


def tasks_of(
    tables: Mapping[str, Table] | Sequence[Table] | PathLike, results: Path | None = None
) -> tuple[Task, ...]:
    """The tasks of named tables, or of paths, patterns (`courts/*.csv`, `**` for folders at any depth), folders and
    names of bundled tables, sorted by name. Files are named by their path below the folder that all have in common.
    What lies in the folder of `results` is none of them: a pattern may meet what an earlier run wrote.

    Raises ParameterError for a pattern or folder without a table, and for tables without a name. Files may have names
    that are not of their user's choice: one whose name no folder can have is a task with a fault.
    """
    if isinstance(tables, Mapping):
        if not tables:
            raise ParameterError("no table was named")
        for name, fault in faults(map(_text, tables)).items():
            raise ParameterError(f"table {name!r}: {fault}")
        return tuple(Task(name, table) for name, table in tables.items())
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
    names = names_of(list(found), Path(os.path.commonpath([path.parent for path in found])))
    bad = faults(names)
    return tuple(
        Task(one_line(name) if name in bad else name, path, bad.get(name, ""))
        for name, path in sorted(zip(names, found.values(), strict=True))
    )


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


def _text(name: object) -> str:
    if not isinstance(name, str):
        raise ParameterError(f"table {name!r}: expected a text that a folder can be called, such as 'court 3'")
    return name
