"""From workbooks, Parquet files and DataFrames to records of cells. Tables that are too large are refused before
memory is used, by the size that a file declares and the places of its cells.

A table takes at most 1 GB up to 100,000 rows, and in proportion above (`docs/file-formats.md` has measurements). A
workbook is laid out as the rectangle of its cells: one blank cell far away makes it as large as one that is full.
"""

from __future__ import annotations

import datetime
import io
import lzma
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.parsers import expat

from fitball.data.bundled import SHEET_MARK, WORKBOOKS
from fitball.data.cells import Record, Vocabulary, find_header, refusal

if TYPE_CHECKING:
    import pandas


MOST_ROWS, MOST_COLUMNS, MOST_CELLS = 2_000_000, 10_000, 20_000_000
# Up to so many rows the limits are those of so many; then they grow with the rows.
ROWS, CELLS_A_ROW, BYTES_A_ROW = 100_000, 50, 640
# Of a workbook, unpacked: styles and texts, and what a cell takes with its tags.
SLACK, BYTES_A_CELL, MOST_UNPACKED = 64_000_000, 250, 4_000_000_000
_PIECE = 1 << 20


def most_cells(rows: int) -> int:
    """Cells that a table of so many rows may have."""
    return min(MOST_CELLS, CELLS_A_ROW * max(rows, ROWS))


def check_shape(source: str, rows: int, columns: int, where: str = "") -> None:
    """Raise TableError for more rows, columns or cells than a table may have."""
    if rows <= MOST_ROWS and columns <= MOST_COLUMNS and rows * columns <= most_cells(rows):
        return
    raise refusal(
        source,
        f"{rows:,} rows of {columns:,} columns{where}: too large to be read; expected at most {MOST_ROWS:,} rows, "
        f"{MOST_COLUMNS:,} columns and {most_cells(min(rows, MOST_ROWS)):,} cells: keep the columns of impacts, or "
        "divide the table",
    )


def check_text(source: str, data: bytes) -> None:
    """Raise TableError for a text of more lines, or of longer ones, than a table has."""
    lines = data.count(b"\n") + data.count(b"\r") - data.count(b"\r\n")
    most = BYTES_A_ROW * max(lines, ROWS)
    if lines > MOST_ROWS or len(data) > most:
        raise refusal(
            source,
            f"{lines:,} lines, {len(data) / 1e6:,.0f} MB: too large to be read; expected at most {MOST_ROWS:,} lines "
            f"and, of so many, {most / 1e6:,.0f} MB: keep the columns of impacts, or divide the table",
        )


# What a damaged archive raises: its directory, its members with their CRCs, what unpacks them, names not in UTF-8. An
# encrypted one is a RuntimeError to zipfile, and so is one that is packed by a method it does not know.
_ARCHIVE = (
    zipfile.BadZipFile, EOFError, zlib.error, lzma.LZMAError, struct.error, OSError, UnicodeDecodeError, RuntimeError
)  # fmt: skip
# What damaged XML raises: itself, an encoding that is none, and a cell whose place is no number.
_XML = (expat.ExpatError, LookupError, ValueError)


@contextmanager
def _whole(source: str, *errors: type[Exception]) -> Iterator[None]:
    """Raise TableError for those errors of what is read inside: the workbook is damaged."""
    try:
        yield
    except errors as error:
        message = f"not a workbook ({error}); expected {', '.join(WORKBOOKS)}, or CSV with the ending .csv"
        raise refusal(source, message) from None


def check_workbook(source: str, data: bytes, suffix: str) -> None:
    """Raise TableError for a workbook that is damaged, whose sheets together are larger than a table, or whose files
    are.
    """
    if suffix == ".xls":
        # No sheet of this format is larger than 65,536 rows of 256 columns; each is looked at once it is open.
        return
    boxes, cells, unpacked = list[tuple[int, int]](), 0, 0
    with _whole(source, *_ARCHIVE), zipfile.ZipFile(io.BytesIO(data)) as book:
        for member in book.infolist():
            reader = _reader(member.filename, suffix)
            if reader is None:
                continue
            # What is declared may be less than what comes out.
            member.file_size = MOST_UNPACKED
            with book.open(member) as file:
                while piece := file.read(_PIECE):
                    unpacked += len(piece)
                    if unpacked > min(MOST_UNPACKED, SLACK + BYTES_A_CELL * (cells + reader.cells)):
                        words = f"unpacks to more than {unpacked / 1e6:,.0f} MB, too large for its cells"
                        raise refusal(source, words)
                    with _whole(source, *_XML):
                        reader.feed(piece)
            with _whole(source, *_XML):
                reader.feed(b"", True)
            cells += reader.cells
            boxes += reader.boxes
    rows, columns = max((box[0] for box in boxes), default=0), max((box[1] for box in boxes), default=0)
    total = sum(box[0] * box[1] for box in boxes)
    words = " as far as its last cell (delete what is far away from the table: a blank counts)"
    check_shape(source, rows, columns, words)
    if total > most_cells(rows):
        check_shape(source, rows, -(-total // max(rows, 1)), f" in all sheets together,{words}")


class _Sheet:
    """The rectangles of the cells of sheets in XML, fed piece by piece: `boxes` as rows and columns."""

    def __init__(self, start: Callable[[_Sheet, str, Mapping[str, str]], None]) -> None:
        self.boxes: list[tuple[int, int]] = []
        self.cells = self.row = self.column = self.last_row = self.last_column = self.repeat = 0
        self._parser = expat.ParserCreate()
        self._parser.StartElementHandler = lambda name, found: start(self, name.rpartition(":")[2], found)

    def feed(self, piece: bytes, last: bool = False) -> None:
        """Take the next piece; with the `last` one the sheet is whole."""
        self._parser.Parse(piece, last)
        if last:
            self.end()

    def end(self) -> None:
        """A sheet is whole."""
        self.boxes.append((self.last_row, self.last_column))
        self.row = self.column = self.last_row = self.last_column = 0

    def reach(self, row: int, column: int) -> None:
        """There is a cell, both counted from 1."""
        self.last_row, self.last_column = max(self.last_row, row), max(self.last_column, column)


def _office_open(sheet: _Sheet, name: str, found: Mapping[str, str]) -> None:
    """An element of .xlsx: rows and cells say where they are, or are the next."""
    if name == "row":
        sheet.row, sheet.column = int(found.get("r", sheet.row + 1)), 0
    elif name == "c":
        sheet.cells += 1
        place = found.get("r")
        if place is None:
            sheet.column += 1
        else:
            letters = place.rstrip("0123456789")
            sheet.row, sheet.column = int(place[len(letters) :]), 0
            for letter in letters.upper():
                sheet.column = 26 * sheet.column + ord(letter) - 64
    # Values make a cell, formats do not.
    elif name in ("v", "is", "f"):
        sheet.reach(max(sheet.row, 1), sheet.column)


def _open_document(sheet: _Sheet, name: str, found: Mapping[str, str]) -> None:
    """An element of .ods: rows and cells may stand for many; empty ones at the end are none."""
    attributes = {key.rpartition(":")[2]: value for key, value in found.items()}
    if name == "table":
        sheet.end()
    elif name == "table-row":
        sheet.row, sheet.column = sheet.row + int(attributes.get("number-rows-repeated", 1)), 0
    elif name in ("table-cell", "covered-table-cell"):
        sheet.cells += 1
        sheet.column += int(attributes.get("number-columns-repeated", 1))
        if attributes.keys() & {"value-type", "formula"}:
            sheet.reach(sheet.row, sheet.column)
    elif name == "p":
        sheet.reach(sheet.row, sheet.column)


class _BinarySheet:
    """The rectangle of the cells of a sheet of .xlsb, whose records are [id, length, content]."""

    def __init__(self) -> None:
        self.boxes: list[tuple[int, int]] = []
        self.cells = self._row = self._last_row = self._last_column = 0
        self._rest = b""

    def feed(self, piece: bytes, last: bool = False) -> None:
        """Take the next piece; with the `last` one the sheet is whole."""
        data, at = self._rest + piece, 0
        while (record := _record(data, at)) is not None:
            kind, at, end = record
            if kind == 0:
                self._row = int.from_bytes(data[at : at + 4], "little") + 1
            # A blank (1) is a format only.
            elif 2 <= kind <= 11:
                self.cells += 1
                self._last_row = max(self._last_row, self._row)
                self._last_column = max(self._last_column, int.from_bytes(data[at : at + 4], "little") + 1)
            at = end
        self._rest = data[at:]
        if last:
            self.boxes.append((self._last_row, self._last_column))


def _record(data: bytes, at: int) -> tuple[int, int, int] | None:
    """Kind of the record that begins here, and where its content begins and ends; None where it is not whole."""
    numbers = []
    for size in (2, 4):
        number = 0
        for k in range(size):
            if at >= len(data):
                return None
            byte, at = data[at], at + 1
            number |= (byte & 0x7F if size == 4 else byte) << (7 * k if size == 4 else 8 * k)
            if byte < 0x80:
                break
        numbers.append(number)
    return (numbers[0], at, at + numbers[1]) if at + numbers[1] <= len(data) else None


def _reader(name: str, suffix: str) -> Any:
    """What reads a file of a workbook, None for one that holds no cells nor texts."""
    if suffix == ".ods":
        return _Sheet(_open_document) if name == "content.xml" else None
    if suffix == ".xlsb":
        return _BinarySheet() if name.startswith("xl/worksheets/") and name.endswith(".bin") else None
    return _Sheet(_office_open) if name.endswith(".xml") else None


# Names by which a sheet is taken for a table of impacts: one that is known and another that is probably meant, since
# one alone (`id`, `surface`, `speed`) stands in sheets of notes too.
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

    check_workbook(source, data, suffix)
    # What a reader of sheets still finds wrong, among it dates that are none.
    errors = (python_calamine.CalamineError, OSError, ValueError, OverflowError)
    with _whole(source, *errors), python_calamine.load_workbook(io.BytesIO(data)) as book:
        named = {
            sheet.name: cells(book.get_sheet_by_name(sheet.name))
            for sheet in book.sheets_metadata
            if sheet.typ == python_calamine.SheetTypeEnum.WorkSheet
        }
    found: dict[str, list[Record]] = {
        name: [(number, tuple(map(_text, row))) for number, row in enumerate(rows, start=1)]
        for name, rows in named.items()
    }
    if wanted is not None:
        if wanted not in found:
            raise refusal(source, f"there is no sheet '{wanted}'; sheets of this file: {', '.join(found)}")
        return found[wanted], ()
    filled = {name: records for name, records in found.items() if any(any(cells) for _, cells in records)}
    if not filled:
        raise refusal(source, "every sheet is empty; expected a header and at least two rows")
    tables = [name for name, records in filled.items() if find_header(records, vocabulary)[1] >= _NAMES]
    if len(tables) > 1:
        ways = ", ".join(f"'{source}{SHEET_MARK}{name}'" for name in tables[:8])
        raise refusal(source, f"{len(tables)} sheets have tables of impacts; choose one: {ways}")
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
        frame: pandas.DataFrame = pyarrow.Table.from_batches(batches, file.schema_arrow).to_pandas()
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
