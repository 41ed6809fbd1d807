"""From records of cells to columns of text: which record is the header, whether units are in the row below it, which
rows follow, and which of these are totals of others. The result has faults, for which a table is refused, and
notices.
"""

from __future__ import annotations

import re
import statistics
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite, nan

from fitball.data.table import Notice
from fitball.errors import Fault, TableError

# Cells, and the line they start on (None where there are no lines).
Record = tuple[int | None, tuple[str, ...]]
Texts = tuple[str, ...]

# What a spreadsheet shows where a formula has no value, in English and German: no comment, though it begins like one.
FORMULA_ERROR = re.compile(
    r"#(?:N/?A|NV|VALUE!|WERT!|DIV/0!|REF!|BEZUG!|NAME\?|NUM!|ZAHL!|NULL!)(?![\w!?])", re.IGNORECASE
)


@dataclass(frozen=True)
class Rows:
    """Where rows of a table stand: their `numbers` from 1, and the `lines` they start on (None without lines)."""

    numbers: tuple[int, ...]
    lines: tuple[int | None, ...]

    def __len__(self) -> int:
        return len(self.numbers)

    def take(self, places: Iterable[int]) -> Rows:
        """The rows at these places."""
        kept = list(places)
        return Rows(tuple(self.numbers[k] for k in kept), tuple(self.lines[k] for k in kept))


@dataclass(frozen=True)
class RawTable:
    """Header and columns as text, all as long as the `rows` and as many as the header. `data` is the file's bytes,
    `notes` say what was assumed or passed over.
    """

    header: Texts
    header_line: int | None
    rows: Rows
    columns: tuple[Texts, ...]
    data: bytes
    faults: tuple[Fault, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Vocabulary:
    """How a header is recognised: `worth` of a cell (1 for a known column, less for a possible one, 0
    for any other text), and whether a text `is_unit`.
    """

    worth: Callable[[str], float]
    is_unit: Callable[[str], bool]


def refusal(source: str, message: str, line: int | None = None) -> TableError:
    """The error of a file that cannot be taken apart."""
    return TableError(source, [Fault(message, line=line)])


# Faults that are kept one by one: a table of millions of cells may have one in each.
MOST_FAULTS = 100_000


@dataclass(frozen=True)
class Findings:
    """Faults and notices of a table, one check after the other adds to them. Places of rows count among `rows`, those
    that are left of it; `line` is that of its header, `more` counts faults beyond those that are kept.
    """

    rows: Rows
    line: int | None
    faults: list[Fault] = field(default_factory=list)
    notices: list[Notice] = field(default_factory=list)
    more: Counter[str] = field(default_factory=Counter)

    @staticmethod
    def from_raw(raw: RawTable) -> Findings:
        """What was found when the cells were read."""
        return Findings(raw.rows, raw.header_line, list(raw.faults), [Notice(text) for text in raw.notes])

    def among(self, places: Iterable[int]) -> Findings:
        """The same findings, where the rows at these places alone are left."""
        return replace(self, rows=self.rows.take(places))

    def fault(self, message: str, column: str | None = None, place: int | None = None) -> None:
        """Add a fault of the row at a `place`, or without one of the whole table."""
        if len(self.faults) >= MOST_FAULTS:
            self.more["faults"] += 1
            return
        number, line = (None, None) if place is None else (self.rows.numbers[place], self.rows.lines[place])
        self.faults.append(Fault(message, number, line, column))

    def header_fault(self, message: str, column: str | None = None) -> None:
        """Add a fault of the header."""
        self.faults.append(Fault(message, line=self.line, column=column))

    def notice(self, message: str, *columns: str, place: int | None = None, kind: str = "") -> None:
        """Add a notice about `columns`, or about them in the row at a `place`; for `kind` see `Notice`."""
        row = None if place is None else self.rows.numbers[place]
        self.notices.append(Notice(message, row, columns, kind))

    def refuse(self, source: str, hints: tuple[str, ...] = ()) -> None:
        """Raise TableError if there is a fault: header first, then row by row, as one works through a file."""
        untold = [Fault(f"{self.more['faults']:,} more faults, which are not listed")] if self.more else []
        if self.faults:
            raise TableError(source, sorted(self.faults + untold, key=lambda fault: fault.row or 0), hints)


# Records among which the header is looked for.
_REACH = 60
# What a name that is probably meant must be worth to make a header of a record.
_LEAST = 0.5
_NUMBER = re.compile(r"[+\-\u2212\u2013]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?")
_BLANKS = ("", "-", "--", "—", "1", "[-]", "(-)", "[]", "()")
_SHOWN = 60


def is_number(cell: str) -> bool:
    """Whether a cell looks like a number, whatever its decimal sign."""
    return _NUMBER.fullmatch(cell) is not None


def find_header(records: Sequence[Record], vocabulary: Vocabulary) -> tuple[int, float]:
    """The place of the first record whose names are worth most, and what they are; the first of all, worth nothing,
    where no record has any.
    """
    worths = [sum(map(vocabulary.worth, cells)) for _, cells in records[:_REACH]]
    best = max(worths, default=0.0)
    return (worths.index(best), best) if best >= _LEAST else (0, 0.0)


def laid_out(
    source: str, records: Sequence[Record], vocabulary: Vocabulary, data: bytes, notes: Sequence[str] = ()
) -> RawTable:
    """Header and columns of records; rows of another shape than the header's are faults, notes say what was ignored.

    Raises TableError if there are numbers above the header.
    """
    at, _worth = find_header(records, vocabulary)
    line, header = records[at]
    told = [*notes, *_above(source, records[:at], len(header))]
    rest, first = records[at + 1 :], 1
    faults: list[Fault] = []
    if rest and _is_units(rest[0][1], header, vocabulary):
        header = _with_units(header, rest[0], vocabulary, faults)
        rest = rest[1:]
        told.append("the units were read from the row below the header")
        # In a DataFrame, which has no lines, they are a row as any other.
        first += line is None
    width = _width(header, rest)
    numbers, lines, kept = list[int](), list[int | None](), list[Texts]()
    empty, again = 0, list[str]()
    summed = summaries([cells for _, cells in rest])
    for number, (place, cells) in enumerate(rest, start=first):
        fitted = _fitted(cells, width)
        if not any(cells):
            empty += 1
        elif cells == records[at][1]:
            again.append(f"in row {number}" if place is None else f"in line {place}")
        elif number - first in summed:
            word = summed[number - first]
            message = f"begins with '{word}', as a row below a table that sums it up; expected impacts: delete it"
            faults.append(Fault(message, row=number, line=place))
        elif len(fitted) != width:
            hint = "; if commas separate cells and decimals too, write decimal points" if len(fitted) > width else ""
            if len(fitted) == width + 1:
                hint += "; if the first column is the index of a data frame, name it 'id'"
            message = f"read {len(fitted)} cells, expected {width} as in the header{hint}"
            faults.append(Fault(message, row=number, line=place))
        else:
            numbers.append(number)
            lines.append(place)
            kept.append(fitted)
    if again:
        more = f" and {len(again) - 1} more times" if len(again) > 1 else ""
        told.append(f"the header is repeated {again[0]}{more}; ignored")
    if empty:
        told.append(f"{empty} empty row{'s' if empty > 1 else ''} ignored")
    columns = tuple(zip(*kept, strict=True)) or ((),) * width
    return RawTable(
        header[:width], line, Rows(tuple(numbers), tuple(lines)), columns, data, tuple(faults), tuple(told)
    )


def _width(header: tuple[str, ...], rest: Sequence[Record]) -> int:
    """Columns, those at the right end left out that have neither name nor cell."""
    width = len(header)
    while width > 1 and not header[width - 1] and not any(any(cells[width - 1 :]) for _, cells in rest):
        width -= 1
    return width


def _fitted(cells: tuple[str, ...], width: int) -> tuple[str, ...]:
    """Cells without empty ones beyond the header."""
    count = len(cells)
    while count > width and not cells[count - 1]:
        count -= 1
    return cells[:count]


def _above(source: str, records: Sequence[Record], width: int) -> list[str]:
    """A note on the lines above the header. Raises TableError where one looks like a row of the table."""
    told = []
    for line, cells in records:
        numbers = sum(map(is_number, cells))
        if numbers >= 2 and 2 * numbers > width:
            raise refusal(
                source,
                f"read a row of {numbers} numbers above the header; expected the header first: move it up, or "
                "delete rows that are not of this table",
                line,
            )
        text = " ".join(cell for cell in cells if cell)
        if text and not text.lower().startswith("sep="):
            told.append(f"'{text[:_SHOWN]}{'...' if len(text) > _SHOWN else ''}'")
    if not told:
        return []
    more = f" and {len(told) - 3} more" if len(told) > 3 else ""
    return [f"ignored above the header: {', '.join(told[:3])}{more}"]


def _is_units(cells: Sequence[str], header: Sequence[str], vocabulary: Vocabulary) -> bool:
    """Whether a row holds units: no number, units for at least half of what is filled in, one under a name."""
    filled = [cell for cell in cells if cell not in _BLANKS]
    if not filled or any(is_number(cell) for cell in filled):
        return False
    named = [cell for cell, name in zip(cells, header, strict=False) if vocabulary.worth(name) > 0.0]
    units = [cell for cell in filled if vocabulary.is_unit(_bare(cell))]
    return 2 * len(units) >= len(filled) and any(cell in units for cell in named)


def _bare(cell: str) -> str:
    """A unit without its brackets."""
    return cell[1:-1].strip() if cell[:1] in "[({" and cell[-1:] in "])}" and len(cell) > 1 else cell


def _with_units(
    header: tuple[str, ...], record: Record, vocabulary: Vocabulary, faults: list[Fault]
) -> tuple[str, ...]:
    """The header with the units of the row below it. A unit may be in both places."""
    line, units = record
    cells = list(header)
    for index, (name, unit) in enumerate(zip(header, units, strict=False)):
        if unit in _BLANKS or vocabulary.worth(name) == 0.0:
            continue
        if "[" not in name and "(" not in name:
            cells[index] = f"{name} [{_bare(unit)}]"
        elif _bare(unit) not in name:
            message = f"read the unit '{unit}' below '{name}'; expected one unit for each column: delete one of them"
            faults.append(Fault(message, line=line, column=name))
    return tuple(cells)


# How rows begin that sum up a table, in English, German and French, and what their numbers are.
_STATISTICS: Mapping[str, Callable[[Sequence[float]], float]] = {
    r"mean|average|avg|mittel(?:wert)?|durchschnitt|moyenne": statistics.fmean,
    r"median": statistics.median,
    r"std\.? ?dev\.?|stdev|std|sd|standardabweichung|[ée]cart[ -]type": statistics.stdev,
    r"sum|total|summe": sum,
    r"min|minimum": min,
    r"max|maximum": max,
    r"count|n": len,
}
# A group for each.
_STATISTIC = re.compile(f"(?:{'|'.join(f'({words})' for words in _STATISTICS)})[.:]?", re.IGNORECASE)
# Words that name people, balls and runs too: such a row is one of the table unless its numbers are the statistic.
_NAMES = re.compile(r"(?:min|max|n|sum|sd|std)[.:]?", re.IGNORECASE)

Numbers = Sequence[tuple[float, float]]


def summaries(rows: Sequence[Sequence[str]]) -> dict[int, str]:
    """Places of the rows that sum up the others, and the word by which each begins.

    Where that word may be a name, most numbers of the row are the statistic of their columns to the printed digits.
    """
    begun = {place: word for place, cells in enumerate(rows) if _statistic(word := next(filter(None, cells), ""))}
    if not any(map(_NAMES.fullmatch, begun.values())):
        return begun
    others = [cells for place, cells in enumerate(rows) if place not in begun]
    columns = [
        [number for cells in others if k < len(cells) and (number := printed_number(cells[k])) is not None]
        for k in range(max((len(rows[place]) for place in begun), default=0))
    ]
    values = {word.casefold(): [_value(word, column) for column in columns] for word in set(begun.values())}
    return {
        place: word
        for place, word in begun.items()
        if not _NAMES.fullmatch(word) or _agrees(rows[place], values[word.casefold()])
    }


def _statistic(word: str) -> Callable[[Sequence[float]], float] | None:
    found = _STATISTIC.fullmatch(word) if len(word) <= len("standardabweichung:") else None
    return None if found is None or found.lastindex is None else [*_STATISTICS.values()][found.lastindex - 1]


def _value(word: str, column: Numbers) -> tuple[float, float]:
    """The statistic of a column, and by how much rounding moves it at most."""
    statistic = _statistic(word)
    if statistic is None or len(column) < 2:
        return nan, 0.0
    numbers = [number for number, _half in column]
    terms = len(numbers) if statistic is sum else 1
    return statistic(numbers), terms * max(half for _number, half in column)


def _agrees(cells: Sequence[str], values: Numbers) -> bool:
    found = [(number, value) for cell, value in zip(cells, values, strict=False) if (number := printed_number(cell))]
    agree = sum(abs(number[0] - value[0]) <= number[1] + value[1] for number, value in found)
    return 2 * agree > len(found)


def printed_number(cell: str) -> tuple[float, float] | None:
    """A number with a decimal point or comma, and half a unit of its last digit; None for other text."""
    mantissa, _e, power = cell.replace(",", ".").replace("\u2212", "-").lower().partition("e")
    try:
        number = float(f"{mantissa}e{power or 0}")
        half = 0.5 * float(f"1e{int(power or 0) - len(mantissa.partition('.')[2])}")
    except ValueError:
        return None
    return (number, half) if isfinite(number) else None
