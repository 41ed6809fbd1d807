"""From what stands in a file, or in a DataFrame, to header and rows in our names and our way of writing numbers."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from typing import TYPE_CHECKING, Any, TypeAlias

from fitball.data.bundled import resolve_table, split_sheet
from fitball.data.columns import SD_SUFFIX, Column, Header, read_header, vocabulary
from fitball.data.dialect.cells import RawTable
from fitball.data.dialect.files import frame_table, read_raw
from fitball.data.dialect.frames import SHEET_MARK
from fitball.data.dialect.numbers import plain_numbers, split_deviations
from fitball.data.findings import Findings
from fitball.data.naming import Naming
from fitball.errors import ParameterError

if TYPE_CHECKING:
    import pandas

# What a table may be read from: a path or bundled name, a DataFrame, or columns by name.
Source: TypeAlias = "str | os.PathLike[str] | pandas.DataFrame | Mapping[str, Sequence[Any]]"

# What a DataFrame is called in reports and messages, unless its `attrs["name"]` says.
FRAME = "DataFrame"
# What names a file; any other source is a DataFrame.
PATHS = (str, os.PathLike)


@dataclass(frozen=True)
class Written:
    """A table before its numbers are looked at: `name`, where it is from, the SHA-256 of its bytes, what was read,
    and what was found so far; `files` are those it came from, none for a DataFrame.
    """

    name: str
    source: str
    digest: str
    files: tuple[tuple[str, str], ...]
    raw: RawTable
    header: Header
    found: Findings


def in_memory(source: object) -> bool:
    """Whether a source is a DataFrame or a mapping of columns, and no file."""
    return isinstance(source, Mapping) or (hasattr(source, "iloc") and hasattr(source, "columns"))


def check_source(source: object) -> None:
    """Raise ParameterError for what is no source of a table."""
    if not (isinstance(source, PATHS) or in_memory(source)):
        raise ParameterError(
            f"read a table of type {type(source).__name__}, expected a data frame, a path, the name of a bundled "
            "table, or columns by name"
        )


def framed(source: Any) -> str | os.PathLike[str] | pandas.DataFrame:
    """A source, columns by name as a DataFrame. Raises ParameterError for columns of unequal length, and as
    `check_source` does.
    """
    check_source(source)
    if not isinstance(source, Mapping):
        return source  # type: ignore[no-any-return]
    import pandas

    try:
        return pandas.DataFrame(source)
    except ValueError as error:
        raise ParameterError(f"these columns make no table: {error}") from None


def name_of(source: str | os.PathLike[str] | pandas.DataFrame) -> str:
    """What the table of a source is called. Raises TableError where there is no such file."""
    if not isinstance(source, PATHS):
        return str(source.attrs.get("name", FRAME))
    sheet = split_sheet(source)[1]
    return resolve_table(source).stem + ("" if sheet is None else f"-{sheet}")


def written_table(source: str | os.PathLike[str] | pandas.DataFrame, naming: Naming) -> Written:
    """Header and rows of a table, its numbers with decimal points, deviations in columns of their own.

    Raises TableError where it cannot be taken apart at all.
    """
    known = vocabulary(naming)
    files: tuple[tuple[str, str], ...] = ()
    if isinstance(source, PATHS):
        path = resolve_table(source)
        sheet = split_sheet(source)[1]
        raw = read_raw(path, known, sheet)
        of_it = "" if sheet is None else SHEET_MARK + sheet
        place, files = f"{path}{of_it}", ((f"{path.resolve()}{of_it}", sha256(raw.data).hexdigest()),)
    else:
        place = name_of(source)
        raw = frame_table(place, source, known, source.to_csv().encode("utf-8", "backslashreplace"))
    found = Findings.of(raw)
    header = _plain(read_header(raw.header, found, naming), found)
    return Written(name_of(source), place, sha256(raw.data).hexdigest(), files, raw, header, found)


def _plain(header: Header, found: Findings) -> Header:
    """The header, with a column `<name>_sd` for each whose cells state their deviations; the rows that were found get
    plain numbers.
    """
    names = {column.index: name for name, column in header.numbers.items()}
    rows, notes = plain_numbers(found.rows, tuple(names))
    found.rows, added = split_deviations(rows, tuple(names))
    numbers, taken = dict(header.numbers), list[str]()
    for place, index in added.items():
        name, sd = names[place], names[place] + SD_SUFFIX
        if name.endswith(SD_SUFFIX) or sd in numbers:
            found.header_fault(
                f"states deviations (±) in its cells, and {sd} is a column too; expected them once", name
            )
            continue
        numbers[sd] = Column(index, sd, numbers[name].unit)
        taken.append(name)
    if taken:
        notes = (*notes, f"what stands behind ± in {', '.join(taken)} is taken as one standard deviation")
    for note in notes:
        found.notice(note)
    return replace(header, numbers=numbers)
