"""One door for every kind of file: `read_raw`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from fitball.data.dialect.cells import RawTable, Record, Vocabulary, refusal
from fitball.data.dialect.delimited import DELIMITERS, Delimiter, all_records, comments, lines_of, sample
from fitball.data.dialect.encoding import decode
from fitball.data.dialect.frames import PARQUET_SUFFIXES, WORKBOOKS, frame_records, parquet_frame, workbook_records
from fitball.data.dialect.layout import find_header, laid_out

if TYPE_CHECKING:
    import pandas

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
        records, notes = workbook_records(source, data, vocabulary, sheet)
        return laid_out(source, [record for record in records if any(record[1])], vocabulary, data, notes)
    text, notes = decode(source, data)
    return _text_table(source, text, vocabulary, data, notes)


def frame_table(source: str, frame: pandas.DataFrame, vocabulary: Vocabulary, data: bytes) -> RawTable:
    """The cells of a DataFrame, of which `data` are the bytes. Raises TableError where it has no columns."""
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
    if delimiter is not DELIMITERS[0]:
        notes = (*notes, f"cells are divided by {delimiter.name}")
    if commented is not None:
        records = [commented, *records]
        notes = (*notes, f"the header was read from the comment in line {commented[0]}")
    return laid_out(source, records, vocabulary, data, notes)


def _delimiter(lines: list[str], vocabulary: Vocabulary) -> Delimiter | None:
    """What divides the cells: that by which a header has most names that are known; None where there is no header."""
    worths = {item: find_header(sample(item, lines), vocabulary)[1] for item in DELIMITERS}
    best = max(DELIMITERS, key=lambda item: worths[item])
    return best if worths[best] > 0.0 else None


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
