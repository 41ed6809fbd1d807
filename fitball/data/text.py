"""From the bytes of any file to the cells of a table, by `read_raw`. Encodings (UTF-8, UTF-16, and Windows-1252 if
nothing else fits) and separators of cells are found here.
"""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, takewhile
from pathlib import Path
from typing import TYPE_CHECKING

from fitball.data.bundled import PARQUET_SUFFIXES, WORKBOOKS
from fitball.data.cells import FORMULA_ERROR, RawTable, Record, Vocabulary, find_header, is_number, laid_out, refusal
from fitball.data.workbooks import (
    MOST_COLUMNS,
    check_shape,
    check_text,
    frame_records,
    most_cells,
    parquet_frame,
    workbook_records,
)

if TYPE_CHECKING:
    import pandas


# Signs and letters of Windows-1252 (and of Latin-1, its part) that stand in tables.
_WESTERN = frozenset(
    "\u00a0§°±²³µ·¹×–—‘’“”ŠšŽžŒœŸÀÁÂÃÄÅÆÇÈÉÊËÌÍÎÏÐÑÒÓÔÕÖØÙÚÛÜÝÞßàáâãäåæçèéêëìíîïðñòóôõöøùúûüýþÿ".encode("cp1252")
)
_UTF8_LETTER = re.compile(rb"[\xc3-\xf4][\x80-\xbf]|\xc2[\x80-\xbf]")
# Share of zero bytes at even or odd places above which text is UTF-16: of ASCII every second byte is zero.
_ZEROS = 0.4


def decode(source: str, data: bytes) -> tuple[str, tuple[str, ...]]:
    """The text of a file, and a note where its encoding was guessed.

    Raises TableError where bytes are left that no encoding explains, and for zero bytes.
    """
    wide = _utf_16(data)
    notes: tuple[str, ...] = ("the file was read as UTF-16",) if wide else ()
    try:
        text = data.decode(wide).removeprefix("\ufeff") if wide else data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if wide:
            words = f"the bytes at offset {error.start} are not valid UTF-16, the encoding of the rest; expected text"
            raise refusal(source, f"{words}: save the file as 'CSV UTF-8'") from None
        text, notes = _western(source, data, error.start)
    if "\0" in text:
        line = text[: text.index("\0")].count("\n") + 1
        raise refusal(
            source, "read a zero byte, which text files do not have; expected text: save it as 'CSV UTF-8'", line
        )
    return text, notes


def _utf_16(data: bytes) -> str | None:
    """The codec of UTF-16 text, with a byte order mark or known by its zero bytes; None for other text."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    even, odd, least = data[::2].count(0), data[1::2].count(0), _ZEROS * (len(data) // 2)
    if odd > least and even == 0:
        return "utf-16-le"
    return "utf-16-be" if even > least > 0.0 and odd == 0 else None


def _western(source: str, data: bytes, start: int) -> tuple[str, tuple[str, ...]]:
    """Text that is no UTF-8 from a byte on, as Windows-1252 where that explains all; TableError otherwise."""
    marked = data.startswith(codecs.BOM_UTF8)
    # A byte order mark is stripped before decoding, so the position counts from behind it.
    place = start + len(codecs.BOM_UTF8) * marked
    line = data[:place].count(b"\n") + 1
    if not marked and {byte for byte in data if byte > 0x7F} <= _WESTERN and not _UTF8_LETTER.search(data):
        text = data.decode("cp1252")
        return text, (f"bytes that are not UTF-8 were read as Windows-1252, first '{text[place]}' in line {line}",)
    words = f"read byte 0x{data[place]:02x} at offset {place}, which is not UTF-8; expected UTF-8 text"
    raise refusal(source, f"{words}: save the file as 'CSV UTF-8'", line)


# Lines by which a delimiter is found.
SAMPLE, SAMPLE_SIZE = 200, 1_000_000
# A letter for private use: no text has it, and no pattern takes it for a space.
_JOINED = "\ue000"
# A run of blanks is looked at once, from its start: a line may be all blanks.
_BLANKS = r"(?<![ \t])[ \t]"
_BRACKET = re.compile(_BLANKS + r"*+([\[({][^\[\](){}]*[\])}])")
_SLASH = re.compile(_BLANKS + r"++/[ \t]+")
_PLUS_MINUS = re.compile(_BLANKS + r"*+(±|\+/-|\+-)[ \t]*")


@dataclass(frozen=True)
class Delimiter:
    """One way to divide cells: its `name`, and `records` of lines (raises QuoteError, if strict)."""

    name: str
    records: Callable[[Iterable[str], bool], Iterator[Record]]


class QuoteError(Exception):
    """Quotes that do not pair, in the record that starts on `line`."""

    def __init__(self, line: int, reason: str) -> None:
        super().__init__(reason)
        self.line = line


def is_comment(line: str) -> bool:
    """Whether a line is a comment: behind `#`, unless that begins the error of a formula."""
    text = line.lstrip()
    return text.startswith("#") and not FORMULA_ERROR.match(text)


def _by_sign(sign: str) -> Callable[[Iterable[str], bool], Iterator[Record]]:
    """Blank and comment lines between records count as lines only; a quoted cell may go over several."""

    def records(lines: Iterable[str], strict: bool) -> Iterator[Record]:
        start, between = 0, True

        def fed() -> Iterator[str]:
            nonlocal start, between
            for number, line in enumerate(lines, start=1):
                if between:
                    if not line.strip() or is_comment(line):
                        continue
                    start, between = number, False
                yield line

        try:
            for record in csv.reader(fed(), strict=strict, skipinitialspace=True, delimiter=sign):
                yield start, tuple(cell.strip() for cell in record)
                between = True
        except csv.Error as error:
            raise QuoteError(start, str(error)) from None

    return records


def _by_spaces(gap: re.Pattern[str]) -> Callable[[Iterable[str], bool], Iterator[Record]]:
    """A unit in brackets stays with its name, a deviation with its number."""

    def records(lines: Iterable[str], _strict: bool) -> Iterator[Record]:
        for number, line in enumerate(lines, start=1):
            text = line.strip()
            if not text or is_comment(text):
                continue
            text = _PLUS_MINUS.sub(_JOINED + r"\1" + _JOINED, _SLASH.sub(f"{_JOINED}/{_JOINED}", text))
            text = _BRACKET.sub(lambda found: _JOINED + found[1].replace(" ", _JOINED), text)
            cells = (cell.replace(_JOINED, " ").strip().strip('"') for cell in gap.split(text))
            yield number, tuple(cells)

    return records


# In the order in which they are preferred where two divide a header equally well.
DELIMITERS = (
    Delimiter("commas", _by_sign(",")),
    Delimiter("semicolons", _by_sign(";")),
    Delimiter("tabs", _by_sign("\t")),
    Delimiter("vertical bars", _by_sign("|")),
    Delimiter("runs of spaces", _by_spaces(re.compile(r"\s{2,}|\t"))),
    Delimiter("spaces", _by_spaces(re.compile(r"\s+"))),
)
# A row of these may begin with the index of a data frame that was printed.
SPACES = DELIMITERS[4:]


def _sample(delimiter: Delimiter, lines: Sequence[str]) -> list[Record]:
    """Records of the first lines; none where they cannot be divided so."""
    # Long lines are many cells in few of them; the first counts in any case.
    sizes = accumulate(map(len, lines[:SAMPLE]))
    try:
        return list(delimiter.records(lines[: max(1, sum(size <= SAMPLE_SIZE for size in sizes))], False))
    except QuoteError:
        return []


def _all_records(source: str, delimiter: Delimiter, lines: Sequence[str]) -> list[Record]:
    """The records of a file. Raises TableError for quotes that do not pair."""
    records, cells = list[Record](), 0
    try:
        for record in delimiter.records(lines, True):
            cells += len(record[1])
            if len(record[1]) > MOST_COLUMNS or cells > most_cells(len(lines)):
                check_shape(source, max(len(lines), 1), max(len(record[1]), -(-cells // len(lines))))
            records.append(record)
    except QuoteError as error:
        words = f"the record starting here is not CSV ({error}); expected double quotes in pairs"
        raise refusal(source, f"{words}, around whole cells", error.line) from None
    return records


# How pandas marks lines that go on further down, and rows or columns that it left out.
_CUT = frozenset(("\\", "..", "..."))
# Names that make a header of a comment.
_COMMENTED = 2.0


def read_raw(path: Path, vocabulary: Vocabulary, sheet: str | None = None) -> RawTable:
    """The cells of a text file (CSV and its like), of a workbook (its `sheet`) or a Parquet file.

    Raises TableError when the file cannot be opened or taken apart at all; faults that leave the rest
    readable are returned in `faults`.
    """
    records, data, notes = read_records(path, vocabulary, sheet)
    return laid_out(str(path), records, vocabulary, data, notes)


def read_records(
    path: Path, vocabulary: Vocabulary, sheet: str | None = None
) -> tuple[list[Record], bytes, tuple[str, ...]]:
    """The records of a file with all that is above its header, its bytes, and notes. Raises as `read_raw` does."""
    source, suffix = str(path), path.suffix.lower()
    if any("\ud800" <= letter <= "\udfff" for letter in str(path.resolve())):
        raise refusal(
            source, "the name of this file or its folder is not UTF-8, and result files contain it: rename it"
        )
    try:
        data = path.read_bytes()
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise refusal(source, f"cannot be opened: {reason}; expected a readable table") from None
    if not data.strip():
        raise refusal(source, "the file is empty; expected a header line and at least two rows")
    if suffix in PARQUET_SUFFIXES:
        return checked_records(source, parquet_frame(path, data)), data, ()
    if suffix in WORKBOOKS:
        records, notes = workbook_records(source, data, suffix, vocabulary, sheet)
        return [record for record in records if any(record[1])], data, notes
    check_text(source, data)
    text, notes = decode(source, data)
    # Ends of lines are kept: a quoted cell may go over several.
    records, told = _text_records(source, list(io.StringIO(text, newline="")), vocabulary)
    return records, data, (*notes, *told)


def checked_records(source: str, frame: pandas.DataFrame) -> list[Record]:
    """Header and rows of a DataFrame. Raises TableError where it has no columns or is too large."""
    check_shape(source, *frame.shape)
    records = frame_records(frame)
    if not records[0][1]:
        raise refusal(source, "the table has no columns; expected a header and at least two rows")
    return records


def frame_table(source: str, frame: pandas.DataFrame, vocabulary: Vocabulary, data: bytes) -> RawTable:
    """The cells of a DataFrame, of which `data` are the bytes. Raises TableError as `checked_records` does."""
    return laid_out(source, checked_records(source, frame), vocabulary, data)


def _text_records(source: str, lines: Sequence[str], vocabulary: Vocabulary) -> tuple[list[Record], tuple[str, ...]]:
    delimiter, commented = _delimiter(lines, vocabulary), None
    notes: tuple[str, ...] = ()
    if delimiter is None:
        delimiter, commented = _commented_header(lines, vocabulary) or (_most_cells(lines), None)
    records = _all_records(source, delimiter, lines)
    if not records:
        raise refusal(source, "only blank and comment lines were read; expected a header line and at least two rows")
    if delimiter in SPACES:
        for number, cells in records[:SAMPLE]:
            for mark in filter(_CUT.__contains__, cells):
                words = (
                    f"read '{mark}', the mark of a data frame printed in part; expected all of it: df.to_csv(FILE)"
                )
                raise refusal(source, words, number)
        records, told = _indexed(records, vocabulary)
        notes = (*notes, *told)
    if delimiter is not DELIMITERS[0]:
        notes = (*notes, f"cells are separated by {delimiter.name}")
    if commented is not None:
        records = [commented, *records]
        notes = (*notes, f"the header was read from the comment in line {commented[0]}")
    return records, notes


def _delimiter(lines: Sequence[str], vocabulary: Vocabulary) -> Delimiter | None:
    """What divides the cells: that by which a header has most names that are known, and most rows a cell for each of
    them; None where there is no header.
    """

    def worth(delimiter: Delimiter) -> tuple[float, float]:
        records = _sample(delimiter, lines)
        at, names = find_header(records, vocabulary)
        widths = [len(cells) - len(records[at][1]) for _, cells in records[at + 1 :]]
        return names, max(map(widths.count, (0, 1))) / max(len(widths), 1)

    worths = {item: worth(item) for item in DELIMITERS}
    best = max(DELIMITERS, key=lambda item: worths[item])
    return best if worths[best][0] > 0.0 else None


def _indexed(records: list[Record], vocabulary: Vocabulary) -> tuple[list[Record], tuple[str, ...]]:
    """Records with a name above the first column, and a note, where a data frame was printed with its index: each row
    has a cell more than the header, the first of which counts rows or is a name. The index's own name, if it has one,
    is alone in the row below the header.
    """
    at, _worth = find_header(records, vocabulary)
    line, header = records[at]
    rest, name = records[at + 1 :], "index" if "id" in header else "id"
    if rest and len(rest[0][1]) == 1 and not is_number(rest[0][1][0]):
        name, rest = rest[0][1][0], rest[1:]
    firsts = [cells[0] for _, cells in rest]
    if not rest or any(len(cells) != len(header) + 1 for _, cells in rest):
        return records, ()
    # pandas counts from 0, R from 1.
    counted = any(firsts == [str(k + start) for k in range(len(rest))] for start in (0, 1))
    if any(map(is_number, firsts)) and not counted:
        return records, ()
    note = f"the first column has no name and was read as {name}"
    return [*records[:at], (line, (name, *header)), *rest], (note,)


def _commented_header(lines: Sequence[str], vocabulary: Vocabulary) -> tuple[Delimiter, Record] | None:
    """A header behind a comment mark above the first other line, as NumPy writes it, and what divides it."""
    best: tuple[float, Delimiter, Record] | None = None
    above = list(takewhile(lambda line: not line.strip() or is_comment(line), lines[:SAMPLE]))
    for delimiter in DELIMITERS:
        for number, line in enumerate(above, start=1):
            for _, cells in _sample(delimiter, [line.strip().lstrip("#").strip()]):
                worth = sum(map(vocabulary.worth, cells))
                if worth >= _COMMENTED and (best is None or worth > best[0]):
                    best = worth, delimiter, (number, cells)
    return None if best is None else best[1:]


def _most_cells(lines: Sequence[str]) -> Delimiter:
    """What divides the first line into most cells."""
    firsts = {item: _sample(item, lines)[:1] for item in DELIMITERS[:4]}
    return max(DELIMITERS[:4], key=lambda item: len(firsts[item][0][1]) if firsts[item] else 0)
