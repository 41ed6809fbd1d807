"""The bytes of a file -> records of cells: encodings, separators, sheets, sizes.

What is too large is refused with words before it takes 1 GB of memory, whatever a file declares of
itself.
"""

from __future__ import annotations

import codecs
import csv
import io
import re
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from itertools import islice
from math import isnan
from typing import TypeAlias

from fitball.base.errors import Fault, InputError, Note
from fitball.base.text import one_line

# What a cell is worth as one of a header: 1 for a name of a column, less for a text that may mean
# one, 0 for any other text.
NameWorth: TypeAlias = Callable[[str], float]
# The line on which a record starts, and its cells.
Record: TypeAlias = tuple[int, list[str]]

# Endings of workbooks.
WORKBOOKS = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")
# Most bytes of a file.
MOST_BYTES = 250_000_000
# Most rows of a table.
MOST_ROWS = 2_000_000
# Most columns of a table.
MOST_COLUMNS = 1_000
# Most cells of a table.
MOST_CELLS = 20_000_000
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
# Most characters of a record.
_MOST_CHARACTERS = 1_000_000
# Characters of the sample by which a separator is found.
_SAMPLE_CHARACTERS = 200_000
# Lines of that sample.
_SAMPLE_LINES = 200
# Bytes that are read at once.
_BYTES_AT_ONCE = 1 << 20
# Bytes of the piece before that are looked at again: a tag may be cut.
_OVERLAP_BYTES = 200
# Records among which the header is looked for.
HEADER_RECORDS = 60
# The least that a header must be worth: a single name that may be meant.
_LEAST_WORTH = 0.5
# The least that a header in a comment must be worth: two names, since a remark may have one.
_LEAST_COMMENT_WORTH = 2.0
# The least that a header must be worth where several sheets have one: more than a single name.
_LEAST_SHEET_WORTH = 1.5
# A share of zero bytes above this is UTF-16 without a mark.
_ZERO_SHARE = 0.2
# Larger whole numbers are written with an exponent.
_LARGEST_WHOLE = 1e15
# Sheets that are named in a message.
_NAMED_SHEETS = 8
# A spreadsheet's error is no comment, though it begins like one.
FORMULA_ERROR = re.compile(
    r"#(?:N/?A|NV|VALUE!|WERT!|DIV/0!|REF!|BEZUG!|NAME\?|NUM!|ZAHL!|NULL!)(?![\w!?])",
    re.IGNORECASE,
)


def refusal(source: str, code: str, message: str, line: int | None = None) -> InputError:
    """The error of a source that cannot be taken apart."""
    return InputError(source, [Fault(code, message, line=line)])


def too_large(source: str, what: str, most: str, line: int | None = None) -> InputError:
    """The refusal of a source of which `what` is more than `most`."""
    words = (
        f"{what}: too large to be read; expected at most {most}: keep the columns of impacts, "
        "or divide the table"
    )
    return refusal(source, "too-large", words, line)


def check_shape(source: str, rows: int, columns: int) -> None:
    """Refuse more rows, columns or cells than a table may have.

    Raises:
        InputError: The table is larger (`too-large`).
    """
    if rows > MOST_ROWS or columns > MOST_COLUMNS or rows * columns > MOST_CELLS:
        most = f"{MOST_ROWS:,} rows, {MOST_COLUMNS:,} columns and {MOST_CELLS:,} cells"
        raise too_large(source, f"{rows:,} rows of {columns:,} columns", most)


def is_comment(cells: Sequence[str]) -> bool:
    """Whether a record is a comment: its first cell begins with `#`, but is no `#` alone, which is
    a name of a column, and no error of a formula.
    """
    first = cells[0]
    return first.startswith("#") and len(first) > 1 and not FORMULA_ERROR.match(first)


def find_header(records: Sequence[Record], name_worth: NameWorth) -> tuple[int, float]:
    """The header among records: its index, and what its names are worth in all.

    It is the record whose names are worth most; a comment, as NumPy writes headers, only where no
    other record is worth enough. Without any it is the first record that is no comment.
    """
    for comments, least in ((False, _LEAST_WORTH), (True, _LEAST_COMMENT_WORTH)):
        worths = []
        for _, cells in records:
            worth = sum(name_worth(cell.lstrip("# ")) for cell in cells)
            worths.append(worth if is_comment(cells) == comments else 0.0)
        best = max(worths, default=0.0)
        if best >= least:
            return worths.index(best), best
    for index, (_, cells) in enumerate(records):
        if not is_comment(cells):
            return index, 0.0
    return 0, 0.0


def cell_text(value: object) -> str:
    """A cell as a person would write it: whole numbers without a point, NaN as nothing, half
    characters escaped.
    """
    if not isinstance(value, float):
        return str(value).encode(errors="backslashreplace").decode().strip()
    if isnan(value):
        return ""
    if value.is_integer() and abs(value) < _LARGEST_WHOLE:
        return f"{value:.0f}"
    return str(value)


# ---- text

# Letters of Windows-1252 and its signs that stand in tables.
_WESTERN = {*range(0xC0, 0x100), *"\u00a0§°±²³µ·¹\u2013—\u2018\u2019“”ŠšŽžŒœŸ".encode("cp1252")}
# A letter of UTF-8 beyond ASCII.
_UTF8_LETTER = re.compile(rb"[\xc3-\xf4][\x80-\xbf]|\xc2[\x80-\xbf]")
# Separators of cells.
_SEPARATORS = ",;\t| "
# Between spaces a unit in brackets stays with its name. A run of blanks is looked at once, from its
# start: a line may be all blanks.
_BRACKET = re.compile(r"(?<![ \t])[ \t]*+([\[({][^\[\](){}]*[\])}])")
# A deviation stays with its number, too.
_PLUS_MINUS = re.compile(r"(?<![ \t])[ \t]*+(±|\+/-|\+-)[ \t]*")
# Stands for a blank within a cell where blanks separate: no text has it.
_JOINED = "\ue000"


def text_records(
    source: str, data: bytes, name_worth: NameWorth, notes: list[Note]
) -> Iterator[Record]:
    """The records of a text, in its encoding and by its separator: the one by which a header has
    most names of columns and most rows have a cell for each.

    Raises:
        InputError: The text cannot be read (`encoding`, `too-large`; `quotes` as the records are
            read).
    """
    codec = _codec(source, data, notes)
    name_worth = cache(name_worth)
    sample = _sample(_text_lines(source, data, codec))

    def fitness(separator: str) -> tuple[float, float, int]:
        records = [*_records(source, sample, separator, strict=False)]
        header, worth = find_header(records[:HEADER_RECORDS], name_worth)
        widths = [len(cells) for _, cells in records[header:]] or [0]
        share = widths.count(widths[0]) / len(widths)
        return worth, share, 0 if separator == " " else widths[0]

    best = max(_SEPARATORS, key=fitness)
    return _records(source, _text_lines(source, data, codec), best, strict=True)


def _sample(lines: Iterator[str]) -> list[str]:
    """The first lines, as many as show the separator."""
    sample = list[str]()
    size = 0
    for line in lines:
        sample.append(line)
        size += len(line)
        if len(sample) >= _SAMPLE_LINES or size >= _SAMPLE_CHARACTERS:
            break
    return sample


def _codec(source: str, data: bytes, notes: list[Note]) -> str:
    """The encoding in which all of a text can be read; one that was guessed is noted. Raises
    InputError (`encoding`).
    """
    wide = _wide_codec(data)
    decoder = codecs.getincrementaldecoder(wide or "utf-8")()
    try:
        for start in range(0, len(data), _BYTES_AT_ONCE):
            decoder.decode(
                data[start : start + _BYTES_AT_ONCE], start + _BYTES_AT_ONCE >= len(data)
            )
    except UnicodeDecodeError as error:
        lines_before = data.count(b"\n", 0, start) + error.object.count(b"\n", 0, error.start)
        line = 1 + lines_before
        byte = error.object[error.start]
        beyond_ascii = data.translate(None, bytes(range(128)))
        is_western = {*beyond_ascii} <= _WESTERN
        if wide or not is_western or _UTF8_LETTER.search(data):
            words = (
                f"read byte 0x{byte:02x}, which is not {wide or 'UTF-8'}; expected text: save "
                "it as 'CSV UTF-8'"
            )
            raise refusal(source, "encoding", words, line) from None
        letter = bytes([byte]).decode("cp1252")
        words = (
            f"bytes that are not UTF-8 were read as Windows-1252, first '{letter}' in line {line}"
        )
        notes.append(Note("encoding", words))
        return "cp1252"
    return wide or "utf-8-sig"


def _wide_codec(data: bytes) -> str:
    """The codec of a text in UTF-16, by its mark or by zeros in every other byte; empty if the text
    is not in UTF-16.
    """
    if data[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        return "utf-16"
    even = data[:_BYTES_AT_ONCE:2].count(0)
    odd = data[1:_BYTES_AT_ONCE:2].count(0)
    many = _ZERO_SHARE * min(len(data), _BYTES_AT_ONCE)
    if odd > many and not even:
        return "utf-16-le"
    if even > many and not odd:
        return "utf-16-be"
    return ""


def _text_lines(source: str, data: bytes, codec: str) -> Iterator[str]:
    """Lines with their ends: a quoted cell may go over several. Raises InputError (`encoding`,
    `too-large`).
    """
    file = io.TextIOWrapper(io.BytesIO(data), codec, newline="")
    number = 0
    while line := file.readline(_MOST_CHARACTERS):
        number += 1
        if "\0" in line:
            words = "read a zero byte; expected text: save it as 'CSV UTF-8'"
            raise refusal(source, "encoding", words, number)
        if len(line) == _MOST_CHARACTERS or number > MOST_ROWS:
            most = f"{MOST_ROWS:,} lines of {_MOST_CHARACTERS:,} characters"
            raise too_large(source, "a longer line or more lines than a table has", most, number)
        yield line


def _records(source: str, lines: Iterable[str], separator: str, strict: bool) -> Iterator[Record]:
    """Records without blank lines; of a comment the first cell begins with `#`, whatever stands
    behind that. Raises InputError (`quotes`) if `strict`.
    """
    start = 0
    # Characters of the record that is read; less than zero between records.
    size = -1

    def lines_of_records() -> Iterator[str]:
        nonlocal start, size
        for number, line in enumerate(lines, 1):
            if size < 0:
                text = line.strip()
                if not text:
                    continue
                if text.startswith("#"):
                    line = "#" + text.lstrip("# \t").replace('"', "")
                start = number
                size = 0
            size += len(line)
            if size > _MOST_CHARACTERS:
                raise csv.Error(f"more than {_MOST_CHARACTERS:,} characters")
            yield _with_single_blanks(line) if separator == " " else line

    rows = csv.reader(lines_of_records(), delimiter=separator, skipinitialspace=True, strict=strict)
    try:
        for cells in rows:
            if separator == " ":
                yield start, [cell.replace(_JOINED, " ") for cell in cells]
            else:
                yield start, [cell.strip() for cell in cells]
            size = -1
    except csv.Error as error:
        if not strict:
            return
        words = (
            f"the record starting here is not CSV ({error}); expected double quotes in pairs, "
            "around whole cells"
        )
        raise refusal(source, "quotes", words, start) from None


def _with_single_blanks(line: str) -> str:
    """A line of cells between single blanks; those within a cell are replaced by `_JOINED`."""
    line = _BRACKET.sub(lambda bracket: bracket[1].replace(" ", _JOINED), line)
    line = _PLUS_MINUS.sub(r"\1", line)
    return " ".join(line.split())


# ---- workbooks

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
        notes.append(Note("sheet", f"sheet '{name}' of {len(sheets)} was read"))
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
