"""From a file to its cells as text, each with its place; nothing is interpreted here."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from fitball.errors import Fault, TableError

PARQUET_SUFFIXES = (".parquet", ".pq")
SPREADSHEET_SUFFIXES = (".xlsx", ".xls", ".ods")
_DECIMAL_COMMA = re.compile(r"(?<![0-9,])[0-9]+,[0-9]+(?![0-9,])")
_DELIMITER_WORDS = {";": "semicolons", "\t": "tabs", "|": "vertical bars"}


@dataclass(frozen=True)
class RawRow:
    """One data row: its `number` from 1, the `line` of the file it starts on (None in Parquet), its cells."""

    number: int
    line: int | None
    cells: tuple[str, ...]


@dataclass(frozen=True)
class RawTable:
    """Header and rows as text; every row has as many cells as the header. `data` is the file's bytes."""

    header: tuple[str, ...]
    header_line: int | None
    rows: tuple[RawRow, ...]
    data: bytes
    faults: tuple[Fault, ...]


@dataclass
class _LineFeed:
    """Hands lines to the csv reader, leaves out blank and comment lines between records, counts them all."""

    lines: Iterator[str]
    count: int = 0
    record_start: int = 0
    between_records: bool = field(default=True)

    def __iter__(self) -> Iterator[str]:
        for line in self.lines:
            self.count += 1
            if self.between_records:
                if not line.strip() or line.lstrip().startswith("#"):
                    continue
                self.record_start = self.count
                self.between_records = False
            yield line


def read_raw(path: Path) -> RawTable:
    """The cells of a CSV or Parquet file.

    Raises TableError when the file cannot be opened or taken apart at all; faults that leave the rest
    readable are returned in `faults`.
    """
    source = str(path)
    if path.suffix.lower() in SPREADSHEET_SUFFIXES:
        raise _single(source, f"read a spreadsheet ({path.suffix}); expected CSV or Parquet: save it as 'CSV UTF-8'")
    if any("\ud800" <= letter <= "\udfff" for letter in str(path.resolve())):
        raise _single(
            source, "the name of this file or of its folder is no UTF-8, and result files name it: rename it"
        )
    try:
        data = path.read_bytes()
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise _single(source, f"cannot be opened: {reason}; expected a readable CSV or Parquet file") from None
    if not data.strip():
        raise _single(source, "the file is empty; expected a header line and at least two rows")
    if path.suffix.lower() in PARQUET_SUFFIXES:
        return _read_parquet(path, data)
    return _read_csv(source, data)


def _single(source: str, message: str, line: int | None = None) -> TableError:
    return TableError(source, [Fault(message, line=line)])


def _decode(source: str, data: bytes) -> str:
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        # A byte order mark is stripped before decoding, so the position counts from behind it.
        place = error.start + (3 if data.startswith(b"\xef\xbb\xbf") else 0)
        line = data[:place].count(b"\n") + 1
        guess = " (it looks like UTF-16)" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else ""
        raise _single(
            source,
            f"read byte 0x{data[place]:02x} at offset {place}, which is not UTF-8{guess}; "
            "expected UTF-8 text: save the file as 'CSV UTF-8'",
            line,
        ) from None
    if "\0" in text:
        line = text[: text.index("\0")].count("\n") + 1
        raise _single(
            source,
            "read a zero byte (UTF-16, or not text at all?); expected UTF-8 text: save it as 'CSV UTF-8'",
            line,
        )
    return text


def _read_csv(source: str, data: bytes) -> RawTable:
    text = _decode(source, data)
    feed = _LineFeed(iter(io.StringIO(text, newline="")))
    records: list[tuple[int, tuple[str, ...]]] = []
    reader = csv.reader(feed, strict=True, skipinitialspace=True)
    try:
        for record in reader:
            records.append((feed.record_start, tuple(cell.strip() for cell in record)))
            feed.between_records = True
            if len(records) == 1:
                _refuse_other_delimiters(source, text, feed.record_start)
    except csv.Error as error:
        raise _single(
            source,
            f"the record that starts here is not CSV ({error}); expected double quotes in pairs, around whole cells",
            feed.record_start,
        ) from None
    if not records:
        raise _single(source, "only blank and comment lines were read; expected a header line and at least two rows")
    header_line, header = records[0]
    faults: list[Fault] = []
    rows = []
    for number, (line, cells) in enumerate(records[1:], start=1):
        fault = _shape_fault(cells, len(header))
        if fault is None:
            rows.append(RawRow(number, line, cells))
        else:
            faults.append(Fault(fault, row=number, line=line))
    return RawTable(header, header_line, tuple(rows), data, tuple(faults))


def _shape_fault(cells: tuple[str, ...], expected: int) -> str | None:
    if len(cells) != expected:
        hint = "; decimal commas? write decimal points" if len(cells) > expected else ""
        return f"read {len(cells)} cells, expected {expected} as in the header{hint}"
    if not any(cells):
        return "every cell is empty; expected numbers: delete the row"
    return None


def _refuse_other_delimiters(source: str, text: str, header_line: int) -> None:
    """Raise TableError when the header is divided by something else than commas."""
    lines = re.split(r"\r\n|\r|\n", text)
    header = re.sub(r'"[^"]*"', "", lines[header_line - 1])
    delimiter = max(_DELIMITER_WORDS, key=header.count)
    if header.count(delimiter) <= header.count(","):
        return
    message = f"columns are divided by {_DELIMITER_WORDS[delimiter]} ('{delimiter}'); expected commas"
    for number, line in enumerate(lines[header_line:], start=header_line + 1):
        decimal = _DECIMAL_COMMA.search(line)
        if decimal and not line.lstrip().startswith("#"):
            message += f", and numbers have decimal commas (line {number}: '{decimal[0]}'); expected decimal points"
            break
    message += ": replace the decimal signs first, then the delimiters, or export as comma-separated CSV"
    raise _single(source, message, header_line)


def _read_parquet(path: Path, data: bytes) -> RawTable:
    """Cells of a Parquet file; needs pandas with one of its Parquet engines."""
    import pandas

    source = str(path)
    try:
        frame = pandas.read_parquet(io.BytesIO(data))
    except ImportError:
        raise _single(
            source,
            "reading Parquet needs the package 'pyarrow', which is not installed: "
            "install it (pip install pyarrow) or save the table as CSV",
        ) from None
    # pyarrow.ArrowInvalid is a ValueError; what pandas notes of its columns in the file may be anything.
    except (ValueError, OSError, KeyError, TypeError) as error:
        raise _single(
            source, f"not a Parquet file ({error}); expected Parquet, or CSV with the ending .csv"
        ) from None
    header = tuple(str(name).strip() for name in frame.columns)
    columns: list[list[str]] = [
        [
            "" if missing else str(value).strip()
            for value, missing in zip(frame.iloc[:, i], frame.iloc[:, i].isna(), strict=True)
        ]
        for i in range(len(header))
    ]
    rows = tuple(RawRow(i, None, cells) for i, cells in enumerate(zip(*columns, strict=True), start=1))
    return RawTable(header, None, rows, data, ())
