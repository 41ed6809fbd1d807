"""The bytes of a text -> records of cells: encodings, separators, headers of measuring programs."""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Iterable, Iterator, Sequence

from fitball.base.errors import Note
from fitball.data.records import (
    HEADER_RECORDS,
    MOST_ROWS,
    NameWorth,
    Record,
    find_header,
    is_comment,
    is_wider_by_blanks,
    refusal,
    too_large,
)

# Most characters of a record.
_MOST_CHARACTERS = 1_000_000
# Characters of the sample by which a separator is found.
_SAMPLE_CHARACTERS = 200_000
# Lines of that sample.
_SAMPLE_LINES = 200
# Bytes that are read at once.
_BYTES_AT_ONCE = 1 << 20
# A share of zero bytes above this is UTF-16 without a mark.
_ZERO_SHARE = 0.2
# Letters of Windows-1252 and its signs that stand in tables.
_WESTERN = {*range(0xC0, 0x100), *"\u00a0§°±²³µ·¹\u2013—\u2018\u2019“”ŠšŽžŒœŸ".encode("cp1252")}
# A letter of UTF-8 beyond ASCII.
_UTF8_LETTER = re.compile(rb"[\xc3-\xf4][\x80-\xbf]|\xc2[\x80-\xbf]")
# Stands for two blanks or more, which separate names of several words: no text has it.
_WIDE = "\ue001"
# Separators of cells; of those that fit equally well the first counts.
_SEPARATORS = (",", ";", "\t", "|", " ", _WIDE)
# Two blanks or more, or tabs.
_WIDE_BLANKS = re.compile(r"[ \t]{2,}|\t")
# A header of fewer cells shows no separator.
_LEAST_CELLS = 2
# Share of the rows that must have as many cells as the header.
_LEAST_FITTING = 0.5
# A line that ends the header of a measuring program: LabVIEW, OpenSim.
_END_OF_HEADER = re.compile(r"[\W_]*end[ _]?(?:of[ _]?)?header[\W_]*", re.IGNORECASE)
# How a file of measurements of LabVIEW begins. It has a header, and one more above each segment.
_LABVIEW = "LabVIEW Measurement"
# Ctrl-Z, by which DOS ended a text, and what filled the rest of its last block.
_PADDING = b"\x1a\0\r\n\t "
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
    data = _without_end_mark(data, codec)
    skipped = _lines_of_program(source, data, codec, notes)
    sample = _sample(_table_lines(source, data, codec, skipped))

    def fitness(separator: str) -> tuple[bool, float, float, int]:
        records = [*_records(source, sample, separator, strict=False)]
        header, worth = find_header(records[:HEADER_RECORDS], name_worth)
        fitting = _share_of_header(records[header:])
        width = 0
        if separator.strip() and separator != _WIDE and records:
            width = len(records[header][1])
        return fitting > _LEAST_FITTING, worth, fitting, width

    best = max(_SEPARATORS, key=fitness)
    lines = _table_lines(source, data, codec, skipped)
    return _records(source, lines, best, strict=True)


def _share_of_header(records: Sequence[Record]) -> float:
    """Share of the records below the first, the header, that have a cell for each of its names;
    rows that all have one cell more begin with names of rows. 0 for a header of one name.
    """
    if not records or len(records[0][1]) < _LEAST_CELLS:
        return 0.0
    width = len(records[0][1])
    rows = [cells for _, cells in records[1:] if not is_comment(cells)]
    if not rows:
        return 0.0
    fitting = [len(cells) == width or is_wider_by_blanks(cells, width) for cells in rows]
    named = [len(cells) == width + 1 for cells in rows]
    return 1.0 if all(named) else sum(fitting) / len(rows)


def _without_end_mark(data: bytes, codec: str) -> bytes:
    """The bytes of a text without the Ctrl-Z behind it."""
    text = data.rstrip(_PADDING)
    if b"\x1a" not in data[len(text) :]:
        return data
    end = data.index(b"\x1a", len(text))
    if codec.startswith("utf-16"):
        # Half a letter before the mark belongs to it.
        end -= end % 2
    return data[:end]


def _lines_of_program(source: str, data: bytes, codec: str, notes: list[Note]) -> int:
    """Lines of headers that a measuring program writes above the table, which are noted. Raises
    InputError (`several-tables`) for a file of several segments.
    """
    sample = _sample(_text_lines(source, data, codec))
    ends = [k + 1 for k, line in enumerate(sample) if _END_OF_HEADER.fullmatch(line.strip())]
    if not ends:
        return 0
    if sample[0].startswith(_LABVIEW):
        lines = _text_lines(source, data, codec)
        ends = [k for k, line in enumerate(lines, 1) if _END_OF_HEADER.fullmatch(line.strip())]
        segments = len(ends) - 1
        if segments > 1:
            words = (
                f"{segments} segments of measurements, the second from here; expected one: save "
                "each as a file, with the header above it"
            )
            raise refusal(source, "several-tables", words, ends[2])
    words = f"ignored above the header: lines 1 to {ends[-1]}, the header of a program"
    notes.append(Note("above-header", words))
    return ends[-1]


def _table_lines(source: str, data: bytes, codec: str, skipped: int) -> Iterator[str]:
    """The lines of a text, the first `skipped` of them empty. Raises what `_text_lines` raises."""
    for number, line in enumerate(_text_lines(source, data, codec), 1):
        yield "\n" if number <= skipped else line


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
            yield _separated(line, separator)

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


def _separated(line: str, separator: str) -> str:
    """A line with a single sign between cells where blanks separate them."""
    if separator == " ":
        return _with_single_blanks(line)
    if separator == _WIDE:
        return _WIDE_BLANKS.sub(_WIDE, line.strip())
    return line


def _with_single_blanks(line: str) -> str:
    """A line of cells between single blanks; those within a cell are replaced by `_JOINED`."""
    line = _BRACKET.sub(lambda bracket: bracket[1].replace(" ", _JOINED), line)
    line = _PLUS_MINUS.sub(r"\1", line)
    return " ".join(line.split())
