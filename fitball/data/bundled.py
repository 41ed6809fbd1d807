"""The tables and films that come with the package, and how a name becomes a file."""

from __future__ import annotations

import os
import re
import tomllib
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from fitball.errors import Fault, TableError, suggestion

PARQUET_SUFFIXES = (".parquet", ".pq")
WORKBOOKS = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")
# What divides a workbook from the sheet that is meant: `book.xlsx#clay`.
SHEET_MARK = "#"
# Force records of `<table>.csv` lie beside it as `<table>_force.csv`, covariances of its rows as
# `<table>_covariance.csv`.
FORCE_ENDING, COVARIANCE_ENDING = "_force", "_covariance"
_OF_BOOK = re.compile(
    rf"(?P<book>.+?({'|'.join(map(re.escape, WORKBOOKS))})){SHEET_MARK}(?P<sheet>.+)", re.DOTALL | re.IGNORECASE
)


@dataclass(frozen=True)
class BundledTable:
    """A table of the package: `name` as users write it, `path`, and a one-line `description`."""

    name: str
    path: Path
    description: str


def bundled_folder() -> Path:
    """Where the bundled tables are: inside the installed package, or beside it in a checkout."""
    data_room = Path(str(files(__name__.rpartition(".")[0])))
    installed = data_room.parent / "_datasets"
    return installed if installed.is_dir() else data_room.parents[1] / "datasets"


def bundled_names() -> tuple[str, ...]:
    """File names of the bundled tables, sorted; force records and covariances beside a table are none."""
    stems = {path.stem for path in bundled_folder().glob("*.csv")}
    beside = {name + ending for name in stems for ending in (FORCE_ENDING, COVARIANCE_ENDING)}
    return tuple(f"{name}.csv" for name in sorted(stems - beside))


def bundled_tables() -> tuple[BundledTable, ...]:
    """All bundled tables; the description is that of the scene beside the table."""
    folder = bundled_folder()
    tables = []
    for name in bundled_names():
        scene = tomllib.loads((folder / name).with_suffix(".toml").read_text(encoding="utf-8"))
        tables.append(BundledTable(name, folder / name, scene["source"]["description"]))
    return tuple(tables)


def bundled_tracks() -> tuple[str, ...]:
    """Names of the bundled files of positions, sorted; each has a scene and the licence of its source beside it."""
    return tuple(sorted(path.stem for path in (bundled_folder() / "tracks").glob("*.hdf5")))


def resolve_tracks(source: str | os.PathLike[str]) -> Path:
    """The file of positions that `source` means: a path, or the name of a bundled one (its ending may be left out).

    A path that exists wins. Raises TableError when there is neither.
    """
    path, names = Path(split_sheet(source)[0]), bundled_tracks()
    if os.path.isfile(path):  # noqa: PTH113
        return path
    if path.parent == Path() and path.name.removesuffix(".hdf5") in names:
        return bundled_folder() / "tracks" / f"{path.name.removesuffix('.hdf5')}.hdf5"
    if os.path.isdir(path):  # noqa: PTH112
        raise TableError(str(path), [Fault("is a folder; expected files of positions")])
    words = f"no such file, and no bundled positions of this name (bundled: {', '.join(names)})"
    raise TableError(str(path), [Fault(words)])


def split_sheet(source: str | os.PathLike[str]) -> tuple[str, str | None]:
    """A source without the sheet that it names, and that sheet: `book.xlsx#clay` is clay of `book.xlsx`."""
    text = os.fspath(source)
    named = _OF_BOOK.fullmatch(text)
    # Unlike that of Path, this answers for a name too long for the system.
    if named is None or os.path.isfile(text):  # noqa: PTH113
        return text, None
    return named["book"], named["sheet"]


def resolve_table(source: str | os.PathLike[str]) -> Path:
    """The file that `source` means: a path, with a sheet or without, or the name of a bundled table (`.csv` may be
    left out).

    A path that exists wins. Raises TableError when there is neither.
    """
    wanted, _sheet = split_sheet(source)
    path = Path(wanted)
    if os.path.isfile(path):  # noqa: PTH113
        return path
    names = bundled_names()
    for name in (wanted, f"{wanted}.csv"):
        if name in names:
            return bundled_folder() / name
    if os.path.isdir(path):  # noqa: PTH112
        raise TableError(wanted, [Fault("is a folder; expected a file with a table")])
    hint = suggestion(wanted.removesuffix(".csv"), [name.removesuffix(".csv") for name in names])
    near = f"; {hint}" if hint.startswith("did") else ""
    message = f"no such file, and no bundled table of this name{near} (bundled: {', '.join(names)})"
    raise TableError(wanted, [Fault(message)])
