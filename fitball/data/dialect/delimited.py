"""From text to records of cells, for each way in which cells can be divided."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import accumulate

from fitball.data.dialect.cells import FORMULA_ERROR, Record, refusal
from fitball.data.dialect.size import MOST_COLUMNS, check_shape, most_cells

# Lines by which a delimiter is told.
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


def is_comment(line: str) -> bool:
    """Whether a line is a comment: behind `#`, unless that begins the error of a formula."""
    text = line.lstrip()
    return text.startswith("#") and not FORMULA_ERROR.match(text)


class QuoteError(Exception):
    """Quotes that do not pair, in the record that starts on `line`."""

    def __init__(self, line: int, reason: str) -> None:
        super().__init__(reason)
        self.line = line


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
                if not line.strip() or is_comment(line):
                    continue
                self.record_start = self.count
                self.between_records = False
            yield line


def _by_sign(sign: str) -> Callable[[Iterable[str], bool], Iterator[Record]]:
    def records(lines: Iterable[str], strict: bool) -> Iterator[Record]:
        feed = _LineFeed(iter(lines))
        try:
            for record in csv.reader(feed, strict=strict, skipinitialspace=True, delimiter=sign):
                yield feed.record_start, tuple(cell.strip() for cell in record)
                feed.between_records = True
        except csv.Error as error:
            raise QuoteError(feed.record_start, str(error)) from None

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


def lines_of(text: str) -> list[str]:
    """The lines of a text, their ends kept as they are (a quoted cell may go over several)."""
    return list(io.StringIO(text, newline=""))


def sample(delimiter: Delimiter, lines: list[str]) -> list[Record]:
    """Records of the first lines; none where they cannot be divided so."""
    try:
        # Long lines are many cells in few of them; the first counts in any case.
        sizes = accumulate(map(len, lines[:SAMPLE]))
        return list(delimiter.records(lines[: max(1, sum(size <= SAMPLE_SIZE for size in sizes))], False))
    except QuoteError:
        return []


def all_records(source: str, delimiter: Delimiter, lines: list[str]) -> list[Record]:
    """The records of a file. Raises TableError for quotes that do not pair."""
    records, cells = list[Record](), 0
    try:
        for record in delimiter.records(lines, True):
            cells += len(record[1])
            if len(record[1]) > MOST_COLUMNS or cells > most_cells(len(lines)):
                check_shape(source, max(len(lines), 1), max(len(record[1]), -(-cells // len(lines))))
            records.append(record)
    except QuoteError as error:
        raise refusal(
            source,
            f"the record that starts here is not CSV ({error}); expected double quotes in pairs, around whole cells",
            error.line,
        ) from None
    return records


def comments(lines: list[str]) -> list[str]:
    """The comment lines above the first other line, without their marks; a blank line for each other."""
    found = []
    for line in lines[:SAMPLE]:
        if line.strip() and not is_comment(line):
            break
        found.append(line.strip().lstrip("#").strip())
    return found
