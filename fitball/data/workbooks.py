"""The bytes of a workbook -> records of cells: sheets, sizes as they are declared and unpacked."""

from __future__ import annotations

import io
import re
import zipfile
import zlib
from collections.abc import Iterator
from itertools import islice

from fitball.base.errors import Note
from fitball.base.text import listed, one_line
from fitball.data.records import (
    HEADER_RECORDS,
    NameWorth,
    Record,
    cell_text,
    find_header,
    refusal,
    too_large,
)

# Most bytes of a workbook, unpacked.
_MOST_UNPACKED = 500_000_000
# What styles and texts of a workbook may take besides `_TAG_BYTES` a tag.
_UNTAGGED_BYTES = 64_000_000
# Bytes that a tag takes with its text.
_TAG_BYTES = 64
# Most tags of a workbook.
_MOST_TAGS = 50_000_000
# Most cells of a workbook as far as the last one, which readers lay out whole (32 bytes each).
_MOST_SHEET_CELLS = 12_000_000
# Bytes that are read at once.
_BYTES_AT_ONCE = 1 << 20
# Bytes of the piece before that are looked at again: a tag may be cut.
_OVERLAP_BYTES = 200
# The least that a header must be worth where several sheets have one: more than a single name.
_LEAST_SHEET_WORTH = 1.5
# Sheets that are named in a message.
_NAMED_SHEETS = 8
# Endings of workbooks.
WORKBOOKS = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")
# What a damaged archive or sheet raises; an encrypted archive is a RuntimeError.
_DAMAGED = (
    zipfile.BadZipFile,
    EOFError,
    zlib.error,
    OSError,
    ValueError,
    OverflowError,
    RuntimeError,
)
# The reference of a cell with a value (.xlsx).
_CELL_REFERENCE = re.compile(rb'<(?:\w+:)?c\b[^>]*?\br="([A-Z]{1,3})([0-9]{1,7})"[^>]*(?<!/)>')
# How far a sheet reaches (.xlsb: BrtWsDim).
_SHEET_EXTENT = re.compile(rb"\x94\x01\x10.{4}(.{4}).{4}(.{4})", re.DOTALL)
# A cell that is repeated a thousand times (.ods).
_REPEATED = re.compile(
    rb'repeated="[0-9]{4,}"[^>]*(?:><[^>]*)?value-type|value-type[^>]*repeated="[0-9]{4,}"'
)


def workbook_records(
    source: str,
    data: bytes,
    suffix: str,
    sheet: str,
    name_worth: NameWorth,
    notes: list[Note],
) -> Iterator[Record]:
    """The rows of the sheet of this name, or, if the name is empty, of the only sheet with a table
    of impacts.

    Raises:
        InputError: The workbook, or a sheet of it, cannot be read (`not-a-workbook`, `no-sheet`,
            `several-sheets`, `too-large`).
    """
    import python_calamine

    try:
        if suffix != ".xls":
            # No sheet of that older format is larger than 65,536 rows of 256 columns.
            _check_archive(source, data)
        book = python_calamine.load_workbook(io.BytesIO(data))
        kind = python_calamine.SheetTypeEnum.WorkSheet
        names = [entry.name for entry in book.sheets_metadata if entry.typ == kind]
        sheets = {name: book.get_sheet_by_name(name) for name in names}
    except (python_calamine.CalamineError, *_DAMAGED) as error:
        words = (
            f"not a workbook ({one_line(str(error))}); expected {', '.join(WORKBOOKS)}, or "
            "CSV with the ending .csv"
        )
        raise refusal(source, "not-a-workbook", words) from None
    if sheet and sheet not in sheets:
        words = f"there is no sheet '{sheet}'; sheets of this file: {', '.join(sheets)}"
        raise refusal(source, "no-sheet", words)

    def records(name: str) -> Iterator[Record]:
        for line, row in enumerate(sheets[name].iter_rows(), 1):
            if row:
                yield line, [cell_text(cell) for cell in row]

    def worth(name: str) -> float:
        first = [*islice(records(name), HEADER_RECORDS)]
        return find_header(first, name_worth)[1]

    tables = [name for name in sheets if worth(name) >= _LEAST_SHEET_WORTH]
    if len(tables) > 1 and not sheet:
        ways = ", ".join(f"'{source}#{name}'" for name in tables[:_NAMED_SHEETS])
        words = f"{len(tables)} sheets have tables of impacts; choose one: {ways}"
        raise refusal(source, "several-sheets", words)
    if not sheets:
        return iter(())
    name = sheet or next(iter(tables or sheets))
    if len(sheets) > 1 and not sheet:
        others = listed([f"'{other}'" for other in sheets if other != name], most=_NAMED_SHEETS)
        words = f"sheet '{name}' was read; others: {others} (choose one with '{source}#SHEET')"
        notes.append(Note("sheet", words))
    return records(name)


def _check_archive(source: str, data: bytes) -> None:
    """Refuse an archive that unpacks to too much, or whose sheets reach too far. Raises InputError
    (`too-large`), and what a damaged archive raises.
    """
    unpacked = 0
    tags = 0
    cells = 0
    with zipfile.ZipFile(io.BytesIO(data)) as book:
        for member in book.infolist():
            # What is declared may be less than what comes out.
            member.file_size = 2 * _MOST_UNPACKED
            rows = 0
            columns = 0
            piece = b""
            with book.open(member) as file:
                while read := file.read(_BYTES_AT_ONCE):
                    unpacked += len(read)
                    tags += read.count(b"<")
                    piece = piece[-_OVERLAP_BYTES:] + read
                    most = min(_MOST_UNPACKED, _UNTAGGED_BYTES + _TAG_BYTES * tags)
                    if unpacked > most or tags > _MOST_TAGS or _REPEATED.search(piece):
                        words = (
                            "a sheet that unpacks to more than its cells take, or repeats one "
                            "a thousand times"
                        )
                        raise too_large(source, words, f"{_MOST_UNPACKED / 1e6:.0f} MB")
                    is_binary = member.filename.endswith(".bin")
                    rows, columns = _extent(piece, is_binary, rows, columns)
            cells += rows * columns
            if cells > _MOST_SHEET_CELLS:
                words = (
                    f"{rows:,} rows of {columns:,} columns as far as the last cell (delete "
                    "what is far away)"
                )
                raise too_large(source, words, f"{_MOST_SHEET_CELLS:,} cells")


def _extent(piece: bytes, is_binary: bool, rows: int, columns: int) -> tuple[int, int]:
    """Rows and columns as far as the last cell of a sheet, by a piece of it and what the pieces
    before have shown; of a binary sheet what it declares.
    """
    references = _CELL_REFERENCE.findall(piece)
    row_numbers = [int(row) for _, row in references]
    # A piece has many cells of few columns.
    column_numbers = [_column_number(letters) for letters in {letters for letters, _ in references}]
    rows = max([rows, *row_numbers])
    columns = max([columns, *column_numbers])
    if is_binary and (declared := _SHEET_EXTENT.search(piece)):
        last_row, last_column = declared.groups()
        rows = 1 + int.from_bytes(last_row, "little")
        columns = 1 + int.from_bytes(last_column, "little")
    return rows, columns


def _column_number(letters: bytes) -> int:
    """The number of a column by its letters: A is 1, AA is 27."""
    number = 0
    for letter in letters:
        number = 26 * number + letter - 64
    return number
