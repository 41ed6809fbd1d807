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
from functools import cache, reduce
from itertools import islice
from math import isnan
from typing import Any, TypeAlias

from fitball.base.errors import Fault, InputError, Note
from fitball.base.text import one_line

# What a header cell is worth: 1 for a name that is known, less for one that may be meant, 0 for any
# other text.
Known: TypeAlias = Callable[[str], float]
# The line on which a record starts, and its cells.
Record: TypeAlias = tuple[int, list[str]]

WORKBOOKS = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")
BYTES = 250_000_000
ROWS = 2_000_000
COLUMNS = 1_000
CELLS = 20_000_000
# Of a workbook: bytes unpacked, what of these styles and texts may take besides 64 bytes a tag;
# tags; cells as far as the last one, which readers lay out whole (32 bytes each).
_UNPACKED = 500_000_000
_BESIDES = 64_000_000
_TAGS = 50_000_000
_SHEET_CELLS = 12_000_000
# Characters of a record, and of the sample by which a separator is found; bytes that are read at
# once.
_LONGEST = 1_000_000
_SAMPLE = 200_000
_PIECE = 1 << 20
# Records among which the header is looked for, and the least that one must be worth: elsewhere than
# in a comment, in a comment, and of a sheet that is one of several.
REACH = 60
_LEAST = 0.5
_COMMENTED = 2.0
_SHEET = 1.5
# A spreadsheet's error is no comment, though it begins like one.
ERROR = re.compile(
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
    """Refuse more rows, columns or cells than a table may have."""
    if rows > ROWS or columns > COLUMNS or rows * columns > CELLS:
        most = f"{ROWS:,} rows, {COLUMNS:,} columns and {CELLS:,} cells"
        raise too_large(source, f"{rows:,} rows of {columns:,} columns", most)


def is_comment(cells: Sequence[str]) -> bool:
    """Whether a record is a comment: behind `#`, unless that is a name or begins the error of a
    formula.
    """
    return cells[0].startswith("#") and len(cells[0]) > 1 and not ERROR.match(cells[0])


def find_header(records: Sequence[Record], known: Known) -> tuple[int, float]:
    """The place of the record whose names are worth most, and what they are worth; a comment, as
    NumPy writes one, only where there is no other.
    """
    for comments, least in ((False, _LEAST), (True, _COMMENTED)):
        worths = [
            sum(known(c.lstrip("# ")) for c in cells) * (is_comment(cells) == comments)
            for _, cells in records
        ]
        if max(worths, default=0.0) >= least:
            return worths.index(max(worths)), max(worths)
    return next((k for k, (_, cells) in enumerate(records) if not is_comment(cells)), 0), 0.0


def shown(value: Any) -> str:
    """A cell as a person would write it: whole numbers without a point, NaN as nothing, half
    characters escaped.
    """
    if isinstance(value, float):
        return (
            f"{value:.0f}"
            if value.is_integer() and abs(value) < 1e15
            else ""
            if isnan(value)
            else str(value)
        )
    return str(value).encode(errors="backslashreplace").decode().strip()


# ---- text

# Letters of Windows-1252 and its signs that stand in tables, and what is a letter of UTF-8.
_WESTERN = {*range(0xC0, 0x100), *"\u00a0§°±²³µ·¹\u2013—\u2018\u2019“”ŠšŽžŒœŸ".encode("cp1252")}
_UTF8_LETTER = re.compile(rb"[\xc3-\xf4][\x80-\xbf]|\xc2[\x80-\xbf]")
_SIGNS = ",;\t| "
# Between spaces a unit in brackets stays with its name, a deviation with its number. A run of
# blanks is looked at once, from its start: a line may be all blanks.
_BRACKET = re.compile(r"(?<![ \t])[ \t]*+([\[({][^\[\](){}]*[\])}])")
_PLUS_MINUS = re.compile(r"(?<![ \t])[ \t]*+(±|\+/-|\+-)[ \t]*")
_JOINED = "\ue000"


def text_records(source: str, data: bytes, known: Known, notes: list[Note]) -> Iterator[Record]:
    """The records of a text, in its encoding and with the separator by which a header has most
    names that are known and most rows have a cell for each.
    """
    codec = _codec(source, data, notes)
    known = cache(known)
    sample = list[str]()
    lines = _lines(source, data, codec)
    while len(sample) < 200 and sum(map(len, sample)) < _SAMPLE and (line := next(lines, "")):
        sample.append(line)

    def worth(sign: str) -> tuple[float, float, int]:
        found = [*_records(source, sample, sign, strict=False)]
        at, names = find_header(found[:REACH], known)
        widths = [len(cells) for _, cells in found[at:]] or [0]
        return names, widths.count(widths[0]) / len(widths), 0 if sign == " " else widths[0]

    best = max(_SIGNS, key=worth)
    return _records(source, _lines(source, data, codec), best, strict=True)


def _codec(source: str, data: bytes, notes: list[Note]) -> str:
    """The encoding in which all of a text can be read; one that was guessed is noted."""
    even = data[:_PIECE:2].count(0)
    odd = data[1:_PIECE:2].count(0)
    many = 0.2 * min(len(data), _PIECE)
    wide = "utf-16" if data[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE) else ""
    wide = wide or (
        "utf-16-le" if odd > many and not even else "utf-16-be" if even > many and not odd else ""
    )
    decoder = codecs.getincrementaldecoder(wide or "utf-8")()
    try:
        for at in range(0, len(data), _PIECE):
            decoder.decode(data[at : at + _PIECE], at + _PIECE >= len(data))
    except UnicodeDecodeError as error:
        line = 1 + data.count(b"\n", 0, at)
        byte = error.object[error.start]
        line += error.object.count(b"\n", 0, error.start)
        if (
            wide
            or not {*data.translate(None, bytes(range(128)))} <= _WESTERN
            or _UTF8_LETTER.search(data)
        ):
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


def _lines(source: str, data: bytes, codec: str) -> Iterator[str]:
    """Lines with their ends: a quoted cell may go over several."""
    file = io.TextIOWrapper(io.BytesIO(data), codec, newline="")
    number = 0
    while line := file.readline(_LONGEST):
        number += 1
        if "\0" in line:
            raise refusal(
                source,
                "encoding",
                "read a zero byte; expected text: save it as 'CSV UTF-8'",
                number,
            )
        if len(line) == _LONGEST or number > ROWS:
            most = f"{ROWS:,} lines of {_LONGEST:,} characters"
            raise too_large(source, "a longer line or more lines than a table has", most, number)
        yield line


def _records(source: str, lines: Iterable[str], sign: str, strict: bool) -> Iterator[Record]:
    """Records without blank lines; of a comment the first cell begins with `#`, whatever stands
    behind that.
    """
    start = 0
    size = -1

    def fed() -> Iterator[str]:
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
            if size > _LONGEST:
                raise csv.Error(f"more than {_LONGEST:,} characters")
            if sign == " ":
                line = _PLUS_MINUS.sub(
                    r"\1",
                    _BRACKET.sub(lambda found: found[1].replace(" ", _JOINED), line),
                )
                line = " ".join(line.split())
            yield line

    try:
        for cells in csv.reader(fed(), delimiter=sign, skipinitialspace=True, strict=strict):
            yield (
                start,
                [cell.strip() for cell in cells]
                if sign != " "
                else [c.replace(_JOINED, " ") for c in cells],
            )
            size = -1
    except csv.Error as error:
        if not strict:
            return
        words = (
            f"the record starting here is not CSV ({error}); expected double quotes in pairs, "
            "around whole cells"
        )
        raise refusal(source, "quotes", words, start) from None


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
# Where a cell with a value stands (.xlsx), how far a sheet reaches (.xlsb: BrtWsDim), what is
# repeated (.ods).
_PLACE = re.compile(rb'<(?:\w+:)?c\b[^>]*?\br="([A-Z]{1,3})([0-9]{1,7})"[^>]*(?<!/)>')
_REACHES = re.compile(rb"\x94\x01\x10.{4}(.{4}).{4}(.{4})", re.DOTALL)
_REPEATED = re.compile(
    rb'repeated="[0-9]{4,}"[^>]*(?:><[^>]*)?value-type|value-type[^>]*repeated="[0-9]{4,}"'
)


def workbook_records(
    source: str,
    data: bytes,
    suffix: str,
    wanted: str,
    known: Known,
    notes: list[Note],
) -> Iterator[Record]:
    """The rows of the sheet that is named, or of the one that holds a table."""
    import python_calamine

    try:
        if suffix != ".xls":
            # No sheet of that older format is larger than 65,536 rows of 256 columns.
            _check_archive(source, data)
        book = python_calamine.load_workbook(io.BytesIO(data))
        kind = python_calamine.SheetTypeEnum.WorkSheet
        sheets = {
            s.name: book.get_sheet_by_name(s.name) for s in book.sheets_metadata if s.typ == kind
        }
    except (python_calamine.CalamineError, *_DAMAGED) as error:
        words = (
            f"not a workbook ({one_line(str(error))}); expected {', '.join(WORKBOOKS)}, or "
            "CSV with the ending .csv"
        )
        raise refusal(source, "not-a-workbook", words) from None
    if wanted and wanted not in sheets:
        raise refusal(
            source,
            "no-sheet",
            f"there is no sheet '{wanted}'; sheets of this file: {', '.join(sheets)}",
        )

    def records(name: str) -> Iterator[Record]:
        return (
            (line, [shown(cell) for cell in row])
            for line, row in enumerate(sheets[name].iter_rows(), 1)
            if row
        )

    tables = [s for s in sheets if find_header([*islice(records(s), REACH)], known)[1] >= _SHEET]
    if len(tables) > 1 and not wanted:
        ways = ", ".join(f"'{source}#{name}'" for name in tables[:8])
        raise refusal(
            source,
            "several-sheets",
            f"{len(tables)} sheets have tables of impacts; choose one: {ways}",
        )
    name = wanted or next(iter(tables or sheets), "")
    if len(sheets) > 1 and not wanted:
        notes.append(Note("sheet", f"sheet '{name}' of {len(sheets)} was read"))
    return records(name) if sheets else iter(())


def _check_archive(source: str, data: bytes) -> None:
    """Refuse an archive that unpacks to too much, or whose sheets reach too far."""
    unpacked = tags = cells = 0
    with zipfile.ZipFile(io.BytesIO(data)) as book:
        for member in book.infolist():
            # What is declared may be less than what comes out.
            member.file_size = 2 * _UNPACKED
            rows = 0
            columns = 0
            piece = b""
            with book.open(member) as file:
                while read := file.read(_PIECE):
                    unpacked = unpacked + len(read)
                    tags = tags + read.count(b"<")
                    piece = piece[-200:] + read
                    places = _PLACE.findall(piece)
                    rows = max([rows, *(int(row) for _, row in places)])
                    for letters in {letters for letters, _ in places}:
                        columns = max(
                            columns,
                            reduce(lambda number, letter: 26 * number + letter - 64, letters, 0),
                        )
                    if member.filename.endswith(".bin") and (reach := _REACHES.search(piece)):
                        rows, columns = (
                            1 + int.from_bytes(number, "little") for number in reach.groups()
                        )
                    most = min(_UNPACKED, _BESIDES + 64 * tags)
                    if unpacked > most or tags > _TAGS or _REPEATED.search(piece):
                        words = (
                            "a sheet that unpacks to more than its cells take, or repeats one "
                            "a thousand times"
                        )
                        raise too_large(source, words, f"{_UNPACKED / 1e6:.0f} MB")
            cells += rows * columns
            if cells > _SHEET_CELLS:
                words = (
                    f"{rows:,} rows of {columns:,} columns as far as the last cell (delete "
                    "what is far away)"
                )
                raise too_large(source, words, f"{_SHEET_CELLS:,} cells")
