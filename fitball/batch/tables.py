"""The tables of a batch: found, named, each with its folder, whatever file system that comes to lie on."""

from __future__ import annotations

import glob
import os
import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from fitball.api.reading import PathLike, Table
from fitball.data.bundled import COVARIANCE_ENDING
from fitball.data.read import in_memory
from fitball.errors import ParameterError
from fitball.report.batch import document as files_of_all
from fitball.report.batch.populations import POPULATION_CSV, POPULATION_JSON
from fitball.report.batch.rows import CSV_NAME, ROW_NAME
from fitball.report.figures.registry import FIGURES
from fitball.report.fit.folder import CHAIN_NAME, DERIVED
from fitball.report.saved.netcdf_files import DATA_NAME, POSTERIOR_NAME
from fitball.report.saved.run_file import RUN_NAME
from fitball.report.saved.structure import FIT_NAME
from fitball.visible import one_line

# What marks a folder as that of a batch.
RECORD_NAME = "batch.json"
# What fitball writes into the folder of a batch or of a table, besides names that begin with a dot.
OWN_NAMES = frozenset(
    (
        RECORD_NAME, ROW_NAME, CSV_NAME, files_of_all.PAGE_NAME, files_of_all.PARQUET_NAME, files_of_all.PICTURE,
        files_of_all.DRIFT, POPULATION_JSON, POPULATION_CSV, FIT_NAME, CHAIN_NAME, DATA_NAME,
        POSTERIOR_NAME, RUN_NAME, *DERIVED, *(f"{name}.png" for name in FIGURES),
    )
)  # fmt: skip
# What Windows keeps for devices, whatever follows after a dot (learn.microsoft.com: Naming Files, Paths, Namespaces).
_DEVICE = re.compile(r"(con|prn|aux|nul|conin\$|conout\$|(com|lpt)[0-9¹²³]) *(\..*)?", re.IGNORECASE | re.DOTALL)
_NOWHERE = re.compile(r'[<>:"|?*\\]')
# Bytes of a name that every file system takes.
LONGEST = 240


def fault_of(name: str) -> str:
    """Why no folder can have the name of a table; empty where one can."""
    place = PurePosixPath(name)
    if not name.strip() or place.as_posix() != name or place.is_absolute() or {"..", "."} & {*place.parts, name}:
        return "expected a name that a folder can have, such as 'court 3'"
    return next(filter(None, map(_fault_of_part, place.parts)), "")


def _fault_of_part(part: str) -> str:
    kept = same_key(part)
    if kept in OWN_NAMES:
        return f"fitball uses the name {part} itself"
    if part.startswith("."):
        return "a name with a dot at its beginning is that of a hidden file"
    if len(part.encode("utf-8", "surrogatepass")) > LONGEST:
        return f"the name has more than {LONGEST} bytes"
    if one_line(part) != part:
        return "the name has an invisible or invalid character"
    if _DEVICE.fullmatch(part):
        return f"{part} is a device on Windows"
    if part[-1] in ". ":
        return "Windows removes a dot or blank at the end of a name"
    found = _NOWHERE.search(part)
    return "" if found is None else f"not every file system allows {found[0]} in a name"


def same_key(name: str) -> str:
    """Equal for names that some file system takes for one. They differ only in case, or in how an accent is
    written (Unicode Standard, definition D145: canonical caseless matching).
    """
    return unicodedata.normalize("NFD", unicodedata.normalize("NFD", name).casefold())


def faults(names: Iterable[str]) -> dict[str, str]:
    """Why tables cannot have these names beside each other, by name."""
    names = list(names)
    keys = Counter(map(same_key, names))
    clash = "the name of another table differs only in case or in the encoding of an accent"
    found = {name: fault_of(name) or (clash if keys[same_key(name)] > 1 else "") for name in names}
    return {name: f"{why}; rename the table" for name, why in found.items() if why}


def names_of(paths: Sequence[Path], common: Path) -> list[str]:
    """Paths below a folder that they have in common without endings; with them where two would be the same."""
    whole = [path.relative_to(common).as_posix() for path in paths]
    names = [path.relative_to(common).with_suffix("").as_posix() for path in paths]
    for _ in names:
        keys = Counter(map(same_key, names))
        # A name with its ending may in turn be that of another without: x.csv.
        longer = [full if keys[same_key(name)] > 1 else name for name, full in zip(names, whole, strict=True)]
        if longer == names:
            break
        names = longer
    return names


# Endings of tables; a pattern such as `courts/*` matches scenes and notes too.
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
            raise ParameterError("no table was given")
        for name, fault in faults(map(_text, tables)).items():
            raise ParameterError(f"table {name!r}: {fault}")
        return tuple(Task(name, table) for name, table in tables.items())
    given: list[Any] = [tables]
    if isinstance(tables, Iterable) and not isinstance(tables, (str, os.PathLike)) and not in_memory(tables):
        given = list(tables)
    found: dict[Path, str] = {}
    for item in given:
        if not isinstance(item, (str, os.PathLike)):
            raise ParameterError("tables in memory have no names: pass a mapping, {name: table}")
        # `courts/a.csv` and `./courts/a.csv` are one table.
        found |= {Path(path).absolute(): path for path in _files(os.fspath(item)) if not _within(path, results)}
    if not found:
        raise ParameterError("no table was given")
    names = names_of(list(found), Path(os.path.commonpath([path.parent for path in found])))
    bad = faults(names)
    return tuple(
        Task(one_line(name) if name in bad else name, path, bad.get(name, ""))
        for name, path in sorted(zip(names, found.values(), strict=True))
    )


def _within(path: str, folder: Path | None) -> bool:
    return folder is not None and Path(path).absolute().is_relative_to(folder.absolute())


def _files(text: str) -> list[str]:
    """The tables of a path, a folder or a pattern."""
    if Path(text).is_file():
        return [text]
    if Path(text).is_dir():
        inside = _alone(str(place) for place in Path(text).iterdir() if place.suffix.lower() in TABLES)
        if not inside:
            raise ParameterError(f"{text}: no table in this folder; names of tables end with {', '.join(TABLES)}")
        return inside
    if not glob.has_magic(text):
        # A bundled table, or a fault that its row will report.
        return [text]
    # As a shell reads it: pathlib takes no absolute patterns.
    matches = sorted(glob.glob(text, recursive=True))  # noqa: PTH207
    inside = [place for place in matches if Path(place).is_file()]
    # `*` takes scenes beside their tables too; who writes an ending means it.
    if Path(text).suffix == "" or "*" in Path(text).suffix:
        inside = [place for place in inside if Path(place).suffix.lower() in TABLES]
    if not inside:
        raise ParameterError(f"{text}: no file matches this pattern")
    return _alone(inside)


def _alone(places: Iterable[str]) -> list[str]:
    """The files that are no covariances of another one's rows, sorted."""
    found = sorted(places)
    stems = {str(Path(place).with_suffix("")) + COVARIANCE_ENDING for place in found}
    return [place for place in found if str(Path(place).with_suffix("")) not in stems]


def _text(name: object) -> str:
    if not isinstance(name, str):
        raise ParameterError(f"table {name!r}: expected a name that a folder can have, such as 'court 3'")
    return name
