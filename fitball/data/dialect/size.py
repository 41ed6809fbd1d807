"""How large a table may be: said before memory is used, by what a file declares and by where its cells are.

A table takes at most 1 GB up to 100,000 rows, and in proportion above (`docs/file-formats.md` has measurements).
A workbook is laid out as the rectangle of its cells: one blank cell far away makes it as large as one that is full.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Callable, Mapping
from typing import Any
from xml.parsers import expat

from fitball.data.dialect.cells import refusal

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


def check_workbook(source: str, data: bytes, suffix: str) -> None:
    """Raise TableError for a workbook whose sheets together are larger than a table, or whose files are.

    Raises ValueError, BadZipFile or the errors of damaged XML for what is no workbook.
    """
    if suffix == ".xls":
        # No sheet of this format is larger than 65,536 rows of 256 columns; each is looked at once it is open.
        return
    boxes, cells, unpacked = list[tuple[int, int]](), 0, 0
    with zipfile.ZipFile(io.BytesIO(data)) as book:
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
                        raise refusal(
                            source, f"unpacks to more than {unpacked / 1e6:,.0f} MB, too large for its cells"
                        )
                    reader.feed(piece)
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


# What reading a damaged archive or damaged XML raises.
DAMAGED = (zipfile.BadZipFile, zlib.error, expat.ExpatError, ValueError, EOFError, NotImplementedError, RuntimeError)
