"""Records of a file -> header and columns: titles above, units below the header, rows of data."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import chain, islice, takewhile
from typing import TypeAlias

import numpy as np

from fitball.base.errors import Fault, Note
from fitball.base.text import listed, one_line
from fitball.base.units import symbol_of
from fitball.data import records
from fitball.data.cells import TableCells, texts_of
from fitball.data.records import NUMBER, NameWorth, Record, refusal
from fitball.data.summaries import summary_fault, sums_up, take_out

# The number of a row of data, its line, and its cells.
_Row: TypeAlias = tuple[int, int, list[str]]

# Cells of a row of units for a column that has no unit.
_NO_UNITS = ("", "-", "--", "—", "1", "[-]", "(-)", "[]", "()")
# Pixels are a unit of positions.
_PIXELS = ("px", "pixel", "pixels")
# A row below a header with names worth so much is the same header in other words.
_LEAST_WORTH_AGAIN = 2.0
# How rows above a header begin that name the parts of each column, with numbers too.
_LEVELS = ("scorer", "individuals", "bodyparts")
# The name of a column of names of rows, which has none in the header.
ROW_NAMES = "row names"
# A line that is a factor of all numbers: `1.0e+03 *`, `x 10^3`.
_FACTOR = re.compile(
    r"(?P<before>[x×*])?\s*(?:1(?:[.,]0*)?[ed](?P<exponent>[+-]?\d{1,2})"
    r"|10\s*(?:(?:\^|\*\*)\s*(?P<power>[+-]?\d{1,2})|(?P<raised>[⁻⁺]?[⁰¹²³⁴⁵⁶⁷⁸⁹]{1,2})))"
    r"\s*(?P<behind>[x×*])?",
    re.IGNORECASE,
)
# A title that states a factor, of which nobody knows whether the numbers have it already.
_FACTOR_IN_TITLE = re.compile(
    r".*(?:\bx|[×*])\s*(?:1(?:[.,]0*)?[ed][+-]?\d{1,2}|10\s*(?:\^|\*\*)\s*[+-]?\d{1,2}"
    r"|10[⁻⁺]?[⁰¹²³⁴⁵⁶⁷⁸⁹]{1,2}|10{2,6})\W*|10{2,6}\s*[x×*]"
    r"|.*\bin (?:tenth|hundredth|thousandth|hundred|thousand)s\W*",
    re.IGNORECASE,
)
# Digits above the line as others.
_PLAIN_DIGITS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺", "0123456789-+")
# A larger factor is none.
_LARGEST_FACTOR = 1e20
# A cell of a rule below a header.
_RULE = re.compile(r":?[-_=~+]{3,}:?")
# A number of a row.
_WHOLE_NUMBER = re.compile(r"[0-9]{1,9}")
# Rows that are numbered one by one are no decimal fractions by chance.
_LEAST_COUNTED = 5
# Names of columns of remarks.
_REMARKS = re.compile(
    r"(?:comment|remark|note|bemerkung|kommentar|commentaire|remarque|observaci[oó]n)(?:s|en|es)?",
    re.IGNORECASE,
)
# A row of so many numbers above the header is one of data.
_LEAST_NUMBERS_OF_DATA = 2
# Cells that are put into arrays at once.
_CELLS_AT_ONCE = 100_000
# Titles above a header that are named in a note.
_NAMED_TITLES = 3
# Characters of a title that are named.
_TITLE_LENGTH = 60


def without_nameless(cells: TableCells) -> TableCells:
    """The cells without the columns that have no name. Its argument changes."""
    with_names = [k for k, name in enumerate(cells.names) if name]
    cells.columns = [cells.columns[k] for k in with_names]
    cells.names = [cells.names[k] for k in with_names]
    cells.above = [[record[k] for k in with_names] for record in cells.above]
    return cells


def _names_with_units(
    cells: Sequence[str],
    names: Sequence[str],
    name_worth: NameWorth,
) -> list[str] | None:
    """The names of a header with the units in the cells below them; None where these are no row of
    units. A row of units has no number, units in at least half of its cells that are filled in, and
    a unit under a name of a column.
    """
    filled = {}
    for k, cell in enumerate(cells):
        if cell not in _NO_UNITS:
            filled[k] = cell.strip("[](){} ")
    units = {k for k, text in filled.items() if symbol_of(text) or text.lower() in _PIXELS}
    named = {k for k in filled if k < len(names) and name_worth(names[k])}
    if 2 * len(units) < len(filled) or units.isdisjoint(named):
        return None
    if any(map(NUMBER.fullmatch, filled.values())):
        return None
    with_units = list[str]()
    for k, name in enumerate(names):
        # A unit that stands in the header too is not written twice.
        if k in named and not name.endswith((f"[{filled[k]}]", f"({filled[k]})")):
            with_units.append(f"{name} [{filled[k]}]")
        else:
            with_units.append(name)
    return with_units


def cells_of_records(
    source: str,
    sha256: str,
    rows: Iterator[Record],
    name_worth: NameWorth,
    notes: list[Note],
    name_of_index: str = "",
) -> TableCells:
    """The cells of records: header and columns. Rows of another length, and those that sum up a
    table, are faults. Raises InputError (`empty`, `above-header`, `too-large`).
    """
    filled = (record for record in rows if any(record[1]))
    head = [*islice(filled, records.HEADER_RECORDS)]
    at, worth = records.find_header(head, name_worth)
    if not worth and all(records.is_comment(cells) for _, cells in head):
        words = (
            "only blank and comment lines were read; expected a header line and at least two rows"
        )
        raise refusal(source, "empty", words)
    line, header = head[at]
    factor = _factor_above(source, head[:at], len(header), notes)
    first_name = header[0].lstrip("# ") or header[0] or name_of_index
    names = [first_name, *header[1:]]
    # Behind the first one, levels of an index have no names either.
    levels = [*takewhile(lambda k: not names[k], range(1, len(names)))] if name_of_index else []
    for level in levels:
        names[level] = f"{name_of_index} {level + 1}"
    records.check_shape(source, 1, len(names))
    below = [cells for _, cells in head[at + 1 :] if not _is_between(cells)]
    if _begin_with_names(below, header):
        names = [name_of_index or ROW_NAMES, *names]
        words = f"rows have one cell more than the header: the first is read as '{names[0]}'"
        notes.append(Note("row-names", words))
    rest = chain(head[at + 1 :], filled)
    data = (record for record in rest if not _is_between(record[1]))
    first = _first_of_data(data, name_worth, notes)
    if first and _factor_of(first[0][1]):
        factor = _noted_factor(first[0], notes)
        first = [*islice(data, 1)]
    with_units = None
    if first:
        _, cells_below = first[0]
        with_units = _names_with_units(cells_below, names, name_worth)
    if with_units is not None:
        names = with_units
        first = []
        notes.append(Note("units-row", "the units were read from the row below the header"))
    width = max(k + 1 for k, name in enumerate(names) if name)
    no_rows = np.empty(0, np.int64)
    cells = TableCells(source, sha256, names[:width], [], no_rows, None, line, notes)
    blank = [""] * width
    unnamed = [""] * (len(names) - len(header))
    cells.above = [[*unnamed, *record, *blank][:width] for _, record in head[:at]]
    cells.factor = factor
    _fill(cells, _rows_of_data(cells, chain(first, data), header, len(names)))
    take_out(cells)
    return without_nameless(cells)


def _is_between(cells: Sequence[str]) -> bool:
    """Whether a record is no row: a comment, or a rule such as Matlab and Markdown draw it."""
    return records.is_comment(cells) or all(map(_RULE.fullmatch, filter(None, cells)))


def _first_of_data(
    data: Iterator[Record],
    name_worth: NameWorth,
    notes: list[Note],
) -> list[Record]:
    """The first record below a header that is no header, without numbers, in other words, as those
    of TrackMate; none where there are no data.
    """
    for line, cells in data:
        worth = sum(map(name_worth, cells))
        if worth < _LEAST_WORTH_AGAIN or any(map(NUMBER.fullmatch, cells)):
            return [(line, cells)]
        notes.append(Note("header-again", f"names of columns again in line {line}; ignored"))
    return []


def _factor_above(
    source: str,
    above: Sequence[Record],
    width: int,
    notes: list[Note],
) -> float:
    """The factor of all numbers that is written above a header of this `width`, 1 without one;
    titles are noted. Raises InputError (`above-header`, `factor`) for rows of numbers, and for
    titles with a factor.
    """
    factor = 1.0
    titles = []
    for line, cells in above:
        if records.is_comment(cells):
            continue
        if _factor_of(cells):
            factor = _noted_factor((line, cells), notes)
            continue
        numeric = [cell for cell in cells if NUMBER.fullmatch(cell)]
        is_like_data = 2 * len(numeric) > len(cells) or len(cells) == width
        is_of_data = len(numeric) >= _LEAST_NUMBERS_OF_DATA and is_like_data
        if is_of_data and cells[0] not in _LEVELS:
            words = (
                "read a row of numbers above the header; expected the header first: move it "
                "up, or delete the row"
            )
            raise refusal(source, "above-header", words, line)
        if not cells[0].lower().startswith("sep="):
            title = " ".join(filter(None, cells))
            if _FACTOR_IN_TITLE.fullmatch(title):
                words = (
                    f"'{one_line(title, _TITLE_LENGTH)}' states a factor of the numbers; expected "
                    "numbers without one: compute them, and delete the line"
                )
                raise refusal(source, "factor", words, line)
            titles.append(one_line(title, _TITLE_LENGTH))
    if titles:
        words = f"ignored above the header: {listed(map(repr, titles), most=_NAMED_TITLES)}"
        notes.append(Note("above-header", words))
    return factor


def _factor_of(cells: Sequence[str]) -> float | None:
    """The factor that a line states for all numbers, as Matlab and Octave write it: `1.0e+03 *`;
    None for any other line.
    """
    match = _FACTOR.fullmatch(" ".join(filter(None, cells)))
    if match is None or not (match["before"] or match["behind"]):
        return None
    exponent = match["exponent"] or match["power"] or match["raised"]
    factor = 10.0 ** int(exponent.translate(_PLAIN_DIGITS))
    return factor if 0.0 < factor < _LARGEST_FACTOR else None


def _noted_factor(record: Record, notes: list[Note]) -> float:
    """The factor in this line, which is noted."""
    line, cells = record
    factor = _factor_of(cells) or 1.0
    words = f"all numbers were multiplied by {factor:g}, as line {line} says"
    notes.append(Note("factor", words))
    return factor


def _begin_with_names(rows: Sequence[Sequence[str]], header: Sequence[str]) -> bool:
    """Whether all rows begin with their name, without a name of the column in the header, as R
    writes tables: each has one cell more than the header, and the first cells are words, or whole
    numbers that grow, each once.

    A comma between cells may be a decimal sign instead: then no number has a point.
    """
    names = [cells[0] for cells in rows if cells != header]
    is_wider = [len(cells) == len(header) + 1 and cells[-1] for cells in rows if cells != header]
    if not names or not all(is_wider) or len({*names}) < len(names) or not all(names):
        return False
    if any(map(_WHOLE_NUMBER.fullmatch, names)):
        if not all(map(_WHOLE_NUMBER.fullmatch, names)):
            return False
        indices = [int(name) for name in names]
        if indices != sorted(indices):
            return False
        has_points = any("." in cell for cells in rows for cell in cells[1:])
        counts = indices == [*range(indices[0], indices[0] + len(indices))]
        return has_points or (counts and len(names) >= _LEAST_COUNTED)
    return not any(map(NUMBER.fullmatch, names))


def _fill(cells: TableCells, rows: Iterator[_Row]) -> None:
    """Put rows into the arrays of `cells`, a number of them at a time. Raises InputError
    (`too-large`).
    """
    width = len(cells.names)
    row_numbers = [np.empty(0, np.int64)]
    line_numbers = [np.empty(0, np.int64)]
    pieces = [[texts_of([])] * width]
    count = 0
    while chunk := [*islice(rows, _CELLS_AT_ONCE // width)]:
        numbers_of_chunk, lines, texts = zip(*chunk, strict=True)
        row_numbers.append(np.array(numbers_of_chunk))
        line_numbers.append(np.array(lines))
        # Empty cells may stand behind those of the header.
        columns = [*zip(*texts, strict=False)][:width]
        pieces.append([texts_of(column) for column in columns])
        count += len(chunk)
        records.check_shape(cells.source, count, width)
    cells.rows = np.concatenate(row_numbers)
    cells.lines = np.concatenate(line_numbers)
    cells.columns = [np.concatenate(column) for column in zip(*pieces, strict=True)]


def _rows_of_data(
    cells: TableCells,
    data: Iterator[Record],
    header: list[str],
    most: int,
) -> Iterator[_Row]:
    """The rows that are as long as the header; others, and those with cells behind the first `most`
    are faults. Cells for remarks, the last ones, may be left out.
    """
    width = len(cells.names)
    least = width
    while least > 1 and _REMARKS.fullmatch(cells.names[least - 1]):
        least -= 1
    number = 0
    for line, row in data:
        if row == header:
            cells.note("header-again", f"the header is repeated in line {line}; ignored")
            continue
        number += 1
        first = next(filter(None, row))
        if sums_up(first):
            cells.add(summary_fault(first, number, line))
        elif len(row) < least or any(row[most:]):
            words = f"read {len(row)} cells, expected {width} as in the header"
            cells.add(Fault("row-length", f"{words}{_why_longer(row, width)}", number, line))
        else:
            yield number, line, row + [""] * (width - len(row))


def _why_longer(row: Sequence[str], width: int) -> str:
    """What may be the cause where a row has more cells than the header, which has this `width`."""
    if len(row) == width + 1:
        cause = "remove a decimal comma or stray separator"
        return f"; {cause}, or add the missing cell of the header, such as that of names of rows"
    if len(row) > width and not any("." in cell for cell in row):
        return "; if commas separate cells and decimals too, write decimal points"
    return ""
