"""One door for every kind of file: `read_raw`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from fitball.data.dialect.cells import RawTable, Record, Vocabulary, refusal
from fitball.data.dialect.delimited import (
    DELIMITERS,
    SAMPLE,
    SPACES,
    Delimiter,
    all_records,
    comments,
    lines_of,
    sample,
)
from fitball.data.dialect.encoding import decode
from fitball.data.dialect.frames import PARQUET_SUFFIXES, WORKBOOKS, frame_records, parquet_frame, workbook_records
from fitball.data.dialect.layout import find_header, is_number, laid_out
from fitball.data.dialect.size import check_shape, check_text

if TYPE_CHECKING:
    import pandas

# How pandas marks lines that go on further down, and rows or columns that it left out.
_CUT = frozenset(("\\", "..", "..."))
# Names that make a header of a comment.
_COMMENTED = 2.0


def read_raw(path: Path, vocabulary: Vocabulary, sheet: str | None = None) -> RawTable:
    """The cells of a text file (CSV and its like), of a workbook (its `sheet`) or a Parquet file.

    Raises TableError when the file cannot be opened or taken apart at all; faults that leave the rest
    readable are returned in `faults`.
    """
    source, suffix = str(path), path.suffix.lower()
    if any("\ud800" <= letter <= "\udfff" for letter in str(path.resolve())):
        raise refusal(source, "the name of this file or its folder is no UTF-8, and result files name it: rename it")
    try:
        data = path.read_bytes()
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise refusal(source, f"cannot be opened: {reason}; expected a readable table") from None
    if not data.strip():
        raise refusal(source, "the file is empty; expected a header line and at least two rows")
    if suffix in PARQUET_SUFFIXES:
        return frame_table(source, parquet_frame(path, data), vocabulary, data)
    if suffix in WORKBOOKS:
        records, notes = workbook_records(source, data, suffix, vocabulary, sheet)
        return laid_out(source, [record for record in records if any(record[1])], vocabulary, data, notes)
    check_text(source, data)
    text, notes = decode(source, data)
    return _text_table(source, text, vocabulary, data, notes)


def frame_table(source: str, frame: pandas.DataFrame, vocabulary: Vocabulary, data: bytes) -> RawTable:
    """The cells of a DataFrame, of which `data` are the bytes. Raises TableError where it has no columns or is
    too large.
    """
    check_shape(source, *frame.shape)
    records = frame_records(frame)
    if not records[0][1]:
        raise refusal(source, "the table has no columns; expected a header and at least two rows")
    return laid_out(source, records, vocabulary, data)


def _text_table(source: str, text: str, vocabulary: Vocabulary, data: bytes, notes: tuple[str, ...]) -> RawTable:
    lines = lines_of(text)
    delimiter, commented = _delimiter(lines, vocabulary), None
    if delimiter is None:
        delimiter, commented = _commented_header(lines, vocabulary) or (_most_cells(lines), None)
    records = all_records(source, delimiter, lines)
    if not records:
        raise refusal(source, "only blank and comment lines were read; expected a header line and at least two rows")
    if delimiter in SPACES:
        for number, cells in records[:SAMPLE]:
            for mark in filter(_CUT.__contains__, cells):
                words = f"read '{mark}', as of a data frame printed in parts; expected all of it: df.to_csv(FILE)"
                raise refusal(source, words, number)
        records, told = _indexed(records, vocabulary)
        notes = (*notes, *told)
    if delimiter is not DELIMITERS[0]:
        notes = (*notes, f"cells are divided by {delimiter.name}")
    if commented is not None:
        records = [commented, *records]
        notes = (*notes, f"the header was read from the comment in line {commented[0]}")
    return laid_out(source, records, vocabulary, data, notes)


def _delimiter(lines: list[str], vocabulary: Vocabulary) -> Delimiter | None:
    """What divides the cells: that by which a header has most names that are known, and most rows a cell for each of
    them; None where there is no header.
    """

    def worth(delimiter: Delimiter) -> tuple[float, float]:
        records = sample(delimiter, lines)
        at, names = find_header(records, vocabulary)
        widths = [len(cells) - len(records[at][1]) for _, cells in records[at + 1 :]]
        return names, max(map(widths.count, (0, 1))) / max(len(widths), 1)

    worths = {item: worth(item) for item in DELIMITERS}
    best = max(DELIMITERS, key=lambda item: worths[item])
    return best if worths[best][0] > 0.0 else None


def _indexed(records: list[Record], vocabulary: Vocabulary) -> tuple[list[Record], tuple[str, ...]]:
    """Records with a name above the first column, and a note, where a data frame was printed with its index: each row
    has a cell more than the header, the first of which counts rows or is a name. The index's own name, if it has one,
    stands alone beneath the header.
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
    note = f"the first cell of each row, above which there is no name, was read as {name}"
    return [*records[:at], (line, (name, *header)), *rest], (note,)


def _commented_header(lines: list[str], vocabulary: Vocabulary) -> tuple[Delimiter, Record] | None:
    """A header behind a comment mark, as NumPy writes it, and what divides it."""
    best: tuple[float, Delimiter, Record] | None = None
    for delimiter in DELIMITERS:
        for number, text in enumerate(comments(lines), start=1):
            for _, cells in sample(delimiter, [text]):
                worth = sum(map(vocabulary.worth, cells))
                if worth >= _COMMENTED and (best is None or worth > best[0]):
                    best = worth, delimiter, (number, cells)
    return None if best is None else best[1:]


def _most_cells(lines: list[str]) -> Delimiter:
    """What divides the first line into most cells."""
    firsts = {item: sample(item, lines)[:1] for item in DELIMITERS[:4]}
    return max(DELIMITERS[:4], key=lambda item: len(firsts[item][0][1]) if firsts[item] else 0)
