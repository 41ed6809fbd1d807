"""From workbooks, Parquet files and DataFrames to records of cells."""

from __future__ import annotations

import datetime
import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fitball.data.dialect.cells import Record, Vocabulary, refusal
from fitball.data.dialect.layout import find_header
from fitball.data.dialect.size import BYTES_A_ROW, DAMAGED, ROWS, check_shape, check_workbook

if TYPE_CHECKING:
    import pandas

PARQUET_SUFFIXES = (".parquet", ".pq")
WORKBOOKS = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")
# What divides a workbook from the sheet that is meant: `book.xlsx#clay`.
SHEET_MARK = "#"
# Names by which a sheet is taken for a table of impacts.
_NAMES = 1.5


def workbook_records(
    source: str, data: bytes, suffix: str, vocabulary: Vocabulary, wanted: str | None
) -> tuple[list[Record], tuple[str, ...]]:
    """The cells of a sheet, with the sheet's rows as lines, and a note where there are more sheets: the sheet called
    `wanted`, else the one that holds a table.

    Raises TableError where the file is damaged, there is no such sheet, or two sheets hold tables and none is named.
    """
    import python_calamine

    def cells(sheet: python_calamine.CalamineSheet) -> list[list[Any]]:
        check_shape(source, sheet.total_height, sheet.total_width)
        return sheet.to_python(skip_empty_area=False)

    try:
        check_workbook(source, data, suffix)
        with python_calamine.load_workbook(io.BytesIO(data)) as book:
            named = {
                sheet.name: cells(book.get_sheet_by_name(sheet.name))
                for sheet in book.sheets_metadata
                if sheet.typ == python_calamine.SheetTypeEnum.WorkSheet
            }
    except (python_calamine.CalamineError, OSError, OverflowError, *DAMAGED) as error:
        message = f"not a workbook ({error}); expected {', '.join(WORKBOOKS)}, or CSV with the ending .csv"
        raise refusal(source, message) from None
    found: dict[str, list[Record]] = {
        name: [(number, tuple(map(_text, row))) for number, row in enumerate(rows, start=1)]
        for name, rows in named.items()
    }
    if wanted is not None:
        if wanted not in found:
            raise refusal(source, f"there is no sheet '{wanted}'; its sheets: {', '.join(found)}")
        return found[wanted], ()
    filled = {name: records for name, records in found.items() if any(any(cells) for _, cells in records)}
    if not filled:
        raise refusal(source, "every sheet is empty; expected a header and at least two rows")
    tables = [name for name, records in filled.items() if find_header(records, vocabulary)[1] >= _NAMES]
    if len(tables) > 1:
        ways = ", ".join(f"'{source}{SHEET_MARK}{name}'" for name in tables[:8])
        raise refusal(source, f"{len(tables)} sheets hold tables of impacts; name the one that is meant: {ways}")
    name = tables[0] if tables else next(iter(filled))
    note = (f"sheet '{name}' of {len(found)} was read",) if len(found) > 1 else ()
    return filled[name], note


def parquet_frame(path: Path, data: bytes) -> pandas.DataFrame:
    """The DataFrame in a Parquet file. Raises TableError where it is damaged or nothing installed reads it."""
    source = str(path)
    try:
        import pyarrow.parquet

        file = pyarrow.parquet.ParquetFile(io.BytesIO(data))
        check_shape(source, file.metadata.num_rows, file.metadata.num_columns)
        # A text that stands in the file once may be that of all rows.
        most, batches, size = 4 * BYTES_A_ROW * max(file.metadata.num_rows, ROWS), [], 0
        for batch in file.iter_batches(1024):
            size += batch.nbytes
            if size > most:
                raise refusal(source, f"unpacks to more than {size / 1e6:,.0f} MB; expected numbers and short texts")
            batches.append(batch)
        return _frame_of(pyarrow.Table.from_batches(batches, file.schema_arrow))
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


def _frame_of(table: Any) -> pandas.DataFrame:
    frame: pandas.DataFrame = table.to_pandas()
    return frame


def frame_records(frame: pandas.DataFrame) -> list[Record]:
    """Header and rows of a DataFrame; an index that has a name is a column."""
    if any(name is not None for name in frame.index.names):
        frame = frame.reset_index(allow_duplicates=True)
    names: list[Any] = frame.columns.tolist()
    # A name may have several levels.
    header = tuple(" ".join(map(str, name if isinstance(name, tuple) else (name,))).strip() for name in names)
    columns = [
        ["" if gap else _text(value) for value, gap in zip(column, column.isna(), strict=True)]
        for column in (frame.iloc[:, k] for k in range(len(header)))
    ]
    return [(None, header), *((None, row) for row in zip(*columns, strict=True))]


def _text(value: Any) -> str:
    """A cell as a person would write it: whole numbers without a point, dates so that they are known as such."""
    if isinstance(value, datetime.date | datetime.time):
        return f"{value.isoformat()} (a date or a time)"
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return str(int(value))
    return str(value).strip()
