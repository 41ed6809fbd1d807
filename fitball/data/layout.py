"""Records of a file -> header and columns: titles above, units below the header, rows of data."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import chain, islice
from typing import TypeAlias

import numpy as np

from fitball.base.errors import Fault, Note
from fitball.base.text import listed, one_line
from fitball.base.units import symbol_of
from fitball.data import records
from fitball.data.cells import TableCells, texts_of
from fitball.data.records import NUMBER, NameWorth, Record, refusal

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
# How rows begin that sum up a table.
_SUMMARY = re.compile(
    r"(mean|average|median|sd|std(\.? ?dev)?|standard deviation|mittel(wert)?)[.:]?",
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
    _note_above(source, head[:at], notes)
    line, header = head[at]
    first_name = header[0].lstrip("# ") or header[0] or name_of_index
    names = [first_name, *header[1:]]
    records.check_shape(source, 1, len(names))
    below = chain(head[at + 1 :], filled)
    data = (record for record in below if not records.is_comment(record[1]))
    first = _first_of_data(data, name_worth, notes)
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
    cells.above = [[*record, *blank][:width] for _, record in head[:at]]
    _fill(cells, _rows_of_data(cells, chain(first, data), header))
    return without_nameless(cells)


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


def _note_above(source: str, above: Sequence[Record], notes: list[Note]) -> None:
    """Note titles above the header. Raises InputError (`above-header`) for rows of numbers."""
    titles = []
    for line, cells in above:
        if records.is_comment(cells):
            continue
        numeric = [cell for cell in cells if NUMBER.fullmatch(cell)]
        if len(numeric) >= _LEAST_NUMBERS_OF_DATA and cells[0] not in _LEVELS:
            words = (
                "read a row of numbers above the header; expected the header first: move it "
                "up, or delete the row"
            )
            raise refusal(source, "above-header", words, line)
        if not cells[0].lower().startswith("sep="):
            title = " ".join(filter(None, cells))
            titles.append(one_line(title, _TITLE_LENGTH))
    if titles:
        words = f"ignored above the header: {listed(map(repr, titles), most=_NAMED_TITLES)}"
        notes.append(Note("above-header", words))


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
) -> Iterator[_Row]:
    """The rows that are as long as the header; others are faults."""
    width = len(cells.names)
    number = 0
    for line, row in data:
        if row == header:
            cells.note("header-again", f"the header is repeated in line {line}; ignored")
            continue
        number += 1
        first = next(filter(None, row))
        if _SUMMARY.fullmatch(first):
            words = (
                f"begins with '{first}', as a row that sums up a table; expected impacts: delete it"
            )
            cells.add(Fault("summary-row", words, number, line))
        elif len(row) < width or any(row[len(header) :]):
            words = f"read {len(row)} cells, expected {width} as in the header"
            if len(row) > width:
                words += "; if commas separate cells and decimals too, write decimal points"
            cells.add(Fault("row-length", words, number, line))
        else:
            yield number, line, row
