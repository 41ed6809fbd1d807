"""Any source -> header and columns: files by their ending, frames, Parquet."""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fitball.base.environment import install_command
from fitball.base.errors import Note
from fitball.base.text import one_line
from fitball.base.values import DataFrame
from fitball.data import records
from fitball.data.cells import CellArray, TableCells, texts_of
from fitball.data.foreign import refuse_film, refuse_foreign
from fitball.data.layout import cells_of_records, without_nameless
from fitball.data.records import NameWorth, cell_text, refusal
from fitball.data.texts import text_records
from fitball.data.workbooks import WORKBOOKS, workbook_records

if TYPE_CHECKING:
    from pandas import Series

# Endings of Parquet files.
PARQUET = (".parquet", ".pq")
# Rows of Parquet that are unpacked at once.
_ROWS_AT_ONCE = 256


def file_and_sheet(source: str) -> tuple[str, str]:
    """The file that a source names, and the sheet behind `#`, empty where none is named. A file
    whose own name has a `#` is itself meant.
    """
    # Unlike that of Path, this answers for a name too long for the system.
    if os.path.isfile(source):  # noqa: PTH113
        return source, ""
    file, _, sheet = source.partition("#")
    return file, sheet


def read_cells(
    source: object,
    name_worth: NameWorth,
    name: str = "",
    name_of_index: str = "",
) -> TableCells:
    """The cells of a file, a DataFrame or a mapping of columns.

    A file is text with any separator, in UTF-8, UTF-16 or Windows-1252, a workbook, of which
    `book.xlsx#sheet` chooses a sheet, or Parquet. The index of a DataFrame is a column if it has a
    name. An index or first column without a name is called `name_of_index`; where that is empty it
    is left out. Faults call what is in memory by `name`. `name_worth` says what a cell is worth as
    one of a header (`Naming.worth`).

    Faults that leave the rest readable are in `faults` of the result: `row-length`, `summary-row`.

    Raises:
        InputError: The source cannot be taken apart (`not-found`, `empty`, `too-large`, `encoding`,
            `quotes`, `above-header`, `factor`, `not-a-workbook`, `no-sheet`, `several-sheets`,
            `not-parquet`, `no-pyarrow`, `not-a-table`, `film`, `other-format`,
            `several-tables`).
    """
    if isinstance(source, Mapping) or hasattr(source, "iloc"):
        return _cells_of_frame(name or type(source).__name__, source, name_of_index)
    path, sheet = file_and_sheet(str(source))
    refuse_film(path)
    data = bytes_of(str(source), path)
    suffix = Path(path).suffix.lower()
    if not data.strip():
        words = "the file is empty; expected a header line and at least two rows"
        raise refusal(path, "empty", words)
    if sheet and suffix not in WORKBOOKS:
        words = f"'#{sheet}' names a sheet, which {suffix[1:] or 'text'} has not; leave it out"
        raise refusal(str(source), "no-sheet", words)
    if suffix not in (*PARQUET, *WORKBOOKS):
        refuse_foreign(path, data)
    sha256 = hashlib.sha256(data).hexdigest()
    if suffix in PARQUET:
        return _cells_of_frame(path, _parquet(path, data), name_of_index, sha256)
    notes = list[Note]()
    name_worth = cache(name_worth)
    if suffix in WORKBOOKS:
        rows = workbook_records(path, data, suffix, sheet, name_worth, notes)
    else:
        rows = text_records(path, data, name_worth, notes)
    return cells_of_records(str(source), sha256, rows, name_worth, notes, name_of_index)


def bytes_of(source: str, path: str) -> bytes:
    """The bytes of a file, called `source` in faults. Raises InputError (`not-found`,
    `too-large`).
    """
    try:
        # Names that are not UTF-8 cannot be written into results.
        utf8 = path.encode().decode()
        with Path(utf8).open("rb") as file:
            data = file.read(records.MOST_BYTES + 1)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        words = f"cannot be opened: {why}; expected a readable table"
        raise refusal(source, "not-found", words) from None
    if len(data) > records.MOST_BYTES:
        raise records.too_large(path, "a larger file", f"{records.MOST_BYTES / 1e6:.0f} MB")
    return data


# ---- memory, Parquet


def _cells_of_frame(
    source: str,
    table: Any,
    name_of_index: str = "",
    sha256: str = "",
) -> TableCells:
    """The cells of a DataFrame, or of what pandas makes one of; numbers stay numbers. The last of
    several levels of names is the header, the others are above it. Raises InputError
    (`not-a-table`, `too-large`).
    """
    import pandas

    try:
        frame = pandas.DataFrame(table)
    except (ValueError, TypeError) as error:
        words = f"expected columns of one length, by name ({error})"
        raise refusal(source, "not-a-table", words) from None
    index = _index_columns(frame, name_of_index)
    records.check_shape(source, len(frame), len(index) + len(frame.columns))
    columns = [*map(_array, index.values())]
    columns += [_array(frame.iloc[:, k]) for k in range(len(frame.columns))]
    levels = []
    for k, level in enumerate(frame.columns.names):
        name_of_level = "" if level is None else cell_text(level)
        of_index = [name_of_level] * len(index)
        levels.append([*of_index, *map(cell_text, frame.columns.get_level_values(k))])
    *above, names = levels
    if not above:
        names[: len(index)] = index
    sha256 = sha256 or _digest(names, columns)
    rows = np.arange(len(frame)) + 1
    return without_nameless(TableCells(source, sha256, names, columns, rows, above=above))


def _index_columns(frame: DataFrame, name_of_index: str) -> dict[str, Series[Any]]:
    """The columns of the index of a DataFrame by name; none of an index without a name that gets
    none.
    """
    if not name_of_index and all(name is None for name in frame.index.names):
        return {}
    index = frame.index.to_frame(index=False)
    columns = {}
    for k, name in enumerate(frame.index.names):
        unnamed = name_of_index if frame.index.nlevels == 1 else f"level_{k}"
        columns[unnamed if name is None else cell_text(name)] = index.iloc[:, k]
    return columns


def _digest(names: Sequence[str], columns: Sequence[CellArray]) -> str:
    """The SHA-256 of a table in memory."""
    digest = hashlib.sha256("\0".join(names).encode())
    for column in columns:
        if column.dtype.kind == "T":
            texts = "\0".join(column.tolist())
            digest.update(texts.encode())
        else:
            digest.update(column.tobytes())
    return digest.hexdigest()


def _array(column: Series[Any]) -> CellArray:
    """The cells (rows,) of a column of a DataFrame, as numbers or texts; gaps are NaN or empty."""
    if column.dtype.kind in "iuf":
        numbers_of_column = column.to_numpy(np.float64, na_value=np.nan)
        return np.asarray(numbers_of_column)
    texts = []
    for value, is_gap in zip(column, column.isna(), strict=True):
        texts.append("" if is_gap else cell_text(value))
    return texts_of(texts)


def _parquet(source: str, data: bytes) -> DataFrame:
    """The DataFrame of a Parquet file. Raises InputError (`no-pyarrow`, `not-parquet`,
    `too-large`).
    """
    try:
        import pyarrow.parquet
    except ImportError:
        words = (
            "reading Parquet needs the package 'pyarrow': install it "
            f"({install_command('pyarrow')}), or save as CSV"
        )
        raise refusal(source, "no-pyarrow", words) from None
    try:
        file = pyarrow.parquet.ParquetFile(io.BytesIO(data))
        declared = file.metadata
        records.check_shape(source, declared.num_rows, declared.num_columns)
        # A text that stands in the file once may be that of all rows: what is unpacked is counted
        # in pieces first.
        unpacked = sum(batch.nbytes for batch in file.iter_batches(_ROWS_AT_ONCE))
        if unpacked > records.MOST_BYTES:
            raise records.too_large(
                source, "a column", f"{records.MOST_BYTES / 1e6:.0f} MB unpacked"
            )
        frame: DataFrame = file.read().to_pandas()
    # What pandas notes of its columns in the file may be anything.
    except (pyarrow.ArrowException, ValueError, OSError, KeyError, TypeError) as error:
        words = (
            f"not a Parquet file ({one_line(str(error))}); expected Parquet, or CSV with the "
            "ending .csv"
        )
        raise refusal(source, "not-parquet", words) from None
    return frame
