"""From workbooks, Parquet files and DataFrames to records of cells."""

from __future__ import annotations

import datetime
import io
import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from fitball.data.dialect.cells import Record, Vocabulary, refusal
from fitball.data.dialect.layout import find_header

if TYPE_CHECKING:
    import pandas

PARQUET_SUFFIXES = (".parquet", ".pq")
# Package that reads a workbook, and the name that pandas has for it.
WORKBOOKS: Mapping[str, tuple[str, Literal["openpyxl", "odf"]]] = {
    ".xlsx": ("openpyxl", "openpyxl"),
    ".xlsm": ("openpyxl", "openpyxl"),
    ".ods": ("odfpy", "odf"),
}
# How Excel shows a formula without a value, and a chart of missing points.
_NOT_AVAILABLE = ("#N/A", "#NV")
# Names by which a sheet is taken for a table of impacts.
_NAMES = 1.5


def workbook_records(path: Path, data: bytes, vocabulary: Vocabulary) -> tuple[list[Record], tuple[str, ...]]:
    """The cells of the one sheet that holds a table, with the sheet's rows as lines, and a note where there are more.

    Raises TableError where the package is missing, the file is damaged, or two sheets hold tables.
    """
    import pandas

    source, (package, engine) = str(path), WORKBOOKS[path.suffix.lower()]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of styles and extensions that are no part of a table
            sheets = pandas.read_excel(
                io.BytesIO(data), sheet_name=None, header=None, dtype=object, na_filter=False, engine=engine
            )
    except ImportError:
        raise refusal(
            source,
            f"reading {path.suffix} needs the package '{package}', which is not installed: "
            f"install it (pip install {package}) or save the table as CSV",
        ) from None
    except MemoryError:
        raise
    except Exception as error:  # what the readers of archives and XML raise for a damaged file is without end
        reason = f"{type(error).__name__}: {error}"[:200]
        raise refusal(
            source, f"not a workbook ({reason}); expected {path.suffix}, or CSV with the ending .csv"
        ) from None
    found = {str(name): _sheet(frame) for name, frame in sheets.items()}
    filled = {name: records for name, records in found.items() if any(any(cells) for _, cells in records)}
    if not filled:
        raise refusal(source, "every sheet is empty; expected a header and at least two rows")
    tables = [name for name, records in filled.items() if find_header(records, vocabulary).worth >= _NAMES]
    if len(tables) > 1:
        raise refusal(
            source,
            f"{len(tables)} sheets hold tables of impacts: {', '.join(tables[:8])}; expected one: save each as a "
            "file of its own (several files can be fitted together)",
        )
    name = tables[0] if tables else next(iter(filled))
    note = (f"sheet '{name}' of {len(found)} was read",) if len(found) > 1 else ()
    return filled[name], note


def _sheet(frame: pandas.DataFrame) -> list[Record]:
    return [
        (number, tuple(_text(cell) for cell in row))
        for number, row in enumerate(frame.itertuples(index=False, name=None), start=1)
    ]


def parquet_frame(path: Path, data: bytes) -> pandas.DataFrame:
    """The DataFrame in a Parquet file. Raises TableError where it is damaged or nothing installed reads it."""
    import pandas

    source = str(path)
    try:
        return pandas.read_parquet(io.BytesIO(data))
    except ImportError:
        raise refusal(
            source,
            "reading Parquet needs the package 'pyarrow', which is not installed: "
            "install it (pip install pyarrow) or save the table as CSV",
        ) from None
    # pyarrow.ArrowInvalid is a ValueError; what pandas notes of its columns in the file may be anything.
    except (ValueError, OSError, KeyError, TypeError) as error:
        raise refusal(
            source, f"not a Parquet file ({error}); expected Parquet, or CSV with the ending .csv"
        ) from None


def frame_records(frame: pandas.DataFrame) -> list[Record]:
    """Header and rows of a DataFrame; an index that has a name is a column."""
    if any(name is not None for name in frame.index.names):
        frame = frame.reset_index()
    header = tuple(" ".join(map(str, name)) for name in _levels(frame))
    columns = [
        ["" if gap else _text(value) for value, gap in zip(column, column.isna(), strict=True)]
        for column in (frame.iloc[:, k] for k in range(len(header)))
    ]
    return [(None, tuple(name.strip() for name in header)), *((None, row) for row in _rows(columns))]


def _levels(frame: pandas.DataFrame) -> list[tuple[object, ...]]:
    """The name of each column, level by level where it has several."""
    names: list[Any] = frame.columns.tolist()
    return [name if isinstance(name, tuple) else (name,) for name in names]


def _rows(columns: Sequence[Sequence[str]]) -> Iterable[tuple[str, ...]]:
    return zip(*columns, strict=True)


def _text(value: Any) -> str:
    """A cell as a person would write it: whole numbers without a point, dates so that they are known as such."""
    if isinstance(value, datetime.date | datetime.time):
        return f"{value.isoformat()} (a date or a time)"
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return str(int(value))
    text = str(value).strip()
    return "" if text in _NOT_AVAILABLE else text
