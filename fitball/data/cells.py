"""Any source -> header and columns of text or numbers: layout, units below the header, decimal
signs, ±.

What was assumed is noted, what may be two things is refused. Columns are arrays: an object for each
cell would take too much memory.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from fitball.base.errors import Fault, InputError, Note
from fitball.base.text import listed, one_line
from fitball.base.units import symbol_of
from fitball.base.values import DataFrame, FloatArray, IntArray
from fitball.data import records
from fitball.data.records import NameWorth, Record, cell_text, refusal

if TYPE_CHECKING:
    from pandas import Series

# Cells of a column, texts or numbers.
CellArray: TypeAlias = NDArray[Any]

# Endings of Parquet files.
PARQUET = (".parquet", ".pq")
# Faults of a table that are listed: more are seldom read, and take memory.
_MOST_FAULTS = 10_000
# Cells that are put into arrays at once.
_CELLS_AT_ONCE = 100_000
# Rows of Parquet that are unpacked at once.
_ROWS_AT_ONCE = 256
# Titles above a header that are named in a note.
_NAMED_TITLES = 3


@dataclass
class TableCells:
    """A table as it is written.

    `names` are the cells of the header, none empty, with the units of a row below it in brackets.
    `columns`, in that order, are arrays of text, or of numbers where the source has numbers. `rows`
    are the numbers of the rows of data from 1, `lines` those of the lines of the file (None in
    memory); `header` is the header's line. `sha256` is that of the file's bytes, or of names and
    cells in memory.

    The table collects `notes` on what was assumed, and `faults`, for which it is refused.
    """

    source: str
    sha256: str
    names: list[str]
    columns: list[Annotated[CellArray, "rows"]]
    rows: Annotated[IntArray, "rows"]
    lines: Annotated[IntArray, "rows"] | None = None
    header: int | None = None
    notes: list[Note] = field(default_factory=list)
    faults: list[Fault] = field(default_factory=list)

    def text(self, index: int) -> list[str]:
        """The cells of the column of this index as text; whole numbers without a point."""
        column = self.columns[index]
        if column.dtype.kind == "T":
            return list(column.tolist())
        return [cell_text(cell) for cell in column.tolist()]

    def note(self, code: str, text: str) -> None:
        """Add a note on what was assumed."""
        self.notes.append(Note(code, text))

    def fault(
        self,
        code: str,
        message: str,
        column: str | None = None,
        index: int | None = None,
    ) -> None:
        """Add a fault of the row of this index, or of the header where there is none."""
        row = None
        line = self.header
        if index is not None:
            row = int(self.rows[index])
            line = None if self.lines is None else int(self.lines[index])
        self.add(Fault(code, message, row, line, column))

    def add(self, fault: Fault) -> None:
        """Add a fault. The first 10,000 are listed."""
        if len(self.faults) < _MOST_FAULTS:
            self.faults.append(fault)
        elif len(self.faults) == _MOST_FAULTS:
            words = f"the first {_MOST_FAULTS:,} faults; there are more"
            self.faults.append(Fault("more-faults", words))

    def refuse(self, hints: Sequence[str] = ()) -> None:
        """Refuse the table if it has faults, with `hints` on what may be meant.

        Raises:
            InputError: There are faults: those of the header first, then row by row.
        """
        if self.faults:
            faults = sorted(self.faults, key=_sort_key)
            raise InputError(self.source, faults, hints)


def _sort_key(fault: Fault) -> tuple[bool, int]:
    """What faults are sorted by: rows, the header before them; that there are more comes last."""
    return fault.code == "more-faults", fault.row or 0


def file_and_sheet(source: str) -> tuple[str, str]:
    """The file that a source names, and the sheet behind `#`, empty where none is named. A file
    whose own name has a `#` is itself meant.
    """
    # Unlike that of Path, this answers for a name too long for the system.
    if os.path.isfile(source):  # noqa: PTH113
        return source, ""
    file, _, sheet = source.partition("#")
    return file, sheet


def read_cells(source: object, name_worth: NameWorth, name: str = "") -> TableCells:
    """The cells of a file, a DataFrame or a mapping of columns.

    A file is text with any separator, in UTF-8, UTF-16 or Windows-1252, a workbook, of which
    `book.xlsx#sheet` chooses a sheet, or Parquet. The index of a DataFrame is a column if it has a
    name. Faults call what is in memory by `name`. `name_worth` says what a cell is worth as one of
    a header (`Naming.worth`).

    Faults that leave the rest readable are in `faults` of the result: `row-length`, `summary-row`.

    Raises:
        InputError: The source cannot be taken apart (`not-found`, `empty`, `too-large`, `encoding`,
            `quotes`, `above-header`, `not-a-workbook`, `no-sheet`, `several-sheets`,
            `not-parquet`, `no-pyarrow`, `not-a-table`).
    """
    if isinstance(source, Mapping) or hasattr(source, "iloc"):
        return _cells_of_frame(name or type(source).__name__, source)
    path, sheet = file_and_sheet(str(source))
    data = _content(str(source), path)
    suffix = Path(path).suffix.lower()
    if not data.strip():
        words = "the file is empty; expected a header line and at least two rows"
        raise refusal(path, "empty", words)
    if sheet and suffix not in records.WORKBOOKS:
        words = f"'#{sheet}' names a sheet, which {suffix[1:] or 'text'} has not; leave it out"
        raise refusal(str(source), "no-sheet", words)
    sha256 = hashlib.sha256(data).hexdigest()
    if suffix in PARQUET:
        return _cells_of_frame(path, _parquet(path, data), sha256)
    notes = list[Note]()
    if suffix in records.WORKBOOKS:
        rows = records.workbook_records(path, data, suffix, sheet, name_worth, notes)
    else:
        rows = records.text_records(path, data, name_worth, notes)
    return _cells_of_records(str(source), sha256, rows, name_worth, notes)


def _content(source: str, path: str) -> bytes:
    """The bytes of a file. Raises InputError (`not-found`, `too-large`)."""
    try:
        # Names that are not UTF-8 cannot be written into results.
        utf8 = path.encode().decode()
        with Path(utf8).open("rb") as file:
            data = file.read(records.MOST_BYTES + 1)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        words = f"cannot be opened: {why}; expected a readable table"
        raise refusal(source, "not-found", words) from None
    if len(data) > records.MOST_BYTES:
        raise records.too_large(path, "a larger file", f"{records.MOST_BYTES / 1e6:.0f} MB")
    return data


# ---- memory, Parquet


def _cells_of_frame(source: str, table: Any, sha256: str = "") -> TableCells:
    """The cells of a DataFrame, or of what pandas makes one of; numbers stay numbers. Raises
    InputError (`not-a-table`, `too-large`).
    """
    import pandas

    try:
        frame = pandas.DataFrame(table)
    except (ValueError, TypeError) as error:
        words = f"expected columns of one length, by name ({error})"
        raise refusal(source, "not-a-table", words) from None
    if any(level is not None for level in frame.index.names):
        frame = frame.reset_index(allow_duplicates=True)
    records.check_shape(source, *frame.shape)
    names = [cell_text(name) for name in frame.columns]
    columns = [_array(frame.iloc[:, k]) for k in range(len(names))]
    sha256 = sha256 or _digest(names, columns)
    rows = np.arange(len(frame)) + 1
    return _without_nameless(TableCells(source, sha256, names, columns, rows))


def _digest(names: Sequence[str], columns: Sequence[CellArray]) -> str:
    """The SHA-256 of a table in memory."""
    digest = hashlib.sha256("\0".join(names).encode())
    for column in columns:
        if column.dtype.kind == "T":
            texts = "\0".join(column.tolist())
            digest.update(texts.encode())
        else:
            digest.update(column.tobytes())
    return digest.hexdigest()


def _array(column: Series[Any]) -> CellArray:
    """The cells (rows,) of a column of a DataFrame, as numbers or texts; gaps are NaN or empty."""
    if column.dtype.kind in "iuf":
        numbers_of_column = column.to_numpy(np.float64, na_value=np.nan)
        return np.asarray(numbers_of_column)
    texts = []
    for value, is_gap in zip(column, column.isna(), strict=True):
        texts.append("" if is_gap else cell_text(value))
    return _texts(texts)


def _parquet(source: str, data: bytes) -> DataFrame:
    """The DataFrame of a Parquet file. Raises InputError (`no-pyarrow`, `not-parquet`,
    `too-large`).
    """
    try:
        import pyarrow.parquet
    except ImportError:
        words = (
            "reading Parquet needs the package 'pyarrow': install it (pip install pyarrow), "
            "or save as CSV"
        )
        raise refusal(source, "no-pyarrow", words) from None
    try:
        file = pyarrow.parquet.ParquetFile(io.BytesIO(data))
        declared = file.metadata
        records.check_shape(source, declared.num_rows, declared.num_columns)
        # A text that stands in the file once may be that of all rows: what is unpacked is counted
        # in pieces first.
        unpacked = sum(batch.nbytes for batch in file.iter_batches(_ROWS_AT_ONCE))
        if unpacked > records.MOST_BYTES:
            raise records.too_large(
                source, "a column", f"{records.MOST_BYTES / 1e6:.0f} MB unpacked"
            )
        frame: DataFrame = file.read().to_pandas()
    # What pandas notes of its columns in the file may be anything.
    except (pyarrow.ArrowException, ValueError, OSError, KeyError, TypeError) as error:
        words = (
            f"not a Parquet file ({one_line(str(error))}); expected Parquet, or CSV with the "
            "ending .csv"
        )
        raise refusal(source, "not-parquet", words) from None
    return frame


# ---- layout

# The number of a row of data, its line, and its cells.
_Row: TypeAlias = tuple[int, int, list[str]]

# A number with a decimal point.
_NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
# Cells of a row of units for a column that has no unit.
_NO_UNITS = ("", "-", "--", "—", "1", "[-]", "(-)", "[]", "()")
# How rows begin that sum up a table.
_SUMMARY = re.compile(
    r"(mean|average|median|sd|std(\.? ?dev)?|standard deviation|mittel(wert)?)[.:]?",
    re.IGNORECASE,
)
# A row of so many numbers above the header is one of data.
_LEAST_NUMBERS_OF_DATA = 2
# Characters of a title that are named.
_TITLE_LENGTH = 60


def _texts(cells: Sequence[str]) -> CellArray:
    """Texts as an array (rows,)."""
    return np.array(cells, dtype=np.dtypes.StringDType())


def _without_nameless(cells: TableCells) -> TableCells:
    """The cells without the columns that have no name. Its argument changes."""
    with_names = [k for k, name in enumerate(cells.names) if name]
    cells.columns = [cells.columns[k] for k in with_names]
    cells.names = [cells.names[k] for k in with_names]
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
    units = {k for k, text in filled.items() if symbol_of(text)}
    named = {k for k in filled if k < len(names) and name_worth(names[k])}
    if 2 * len(units) < len(filled) or units.isdisjoint(named):
        return None
    if any(map(_NUMBER.fullmatch, filled.values())):
        return None
    with_units = list[str]()
    for k, name in enumerate(names):
        # A unit that stands in the header too is not written twice.
        if k in named and not name.endswith((f"[{filled[k]}]", f"({filled[k]})")):
            with_units.append(f"{name} [{filled[k]}]")
        else:
            with_units.append(name)
    return with_units


def _cells_of_records(
    source: str,
    sha256: str,
    rows: Iterator[Record],
    name_worth: NameWorth,
    notes: list[Note],
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
    first_name = header[0].lstrip("# ") or header[0]
    names = [first_name, *header[1:]]
    records.check_shape(source, 1, len(names))
    below = chain(head[at + 1 :], filled)
    data = (record for record in below if not records.is_comment(record[1]))
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
    _fill(cells, _rows_of_data(cells, chain(first, data), header))
    return _without_nameless(cells)


def _note_above(source: str, above: Sequence[Record], notes: list[Note]) -> None:
    """Note titles above the header. Raises InputError (`above-header`) for rows of numbers."""
    titles = []
    for line, cells in above:
        if records.is_comment(cells):
            continue
        numeric = [cell for cell in cells if _NUMBER.fullmatch(cell)]
        if len(numeric) >= _LEAST_NUMBERS_OF_DATA:
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
    pieces = [[_texts([])] * width]
    count = 0
    while chunk := [*islice(rows, _CELLS_AT_ONCE // width)]:
        numbers_of_chunk, lines, texts = zip(*chunk, strict=True)
        row_numbers.append(np.array(numbers_of_chunk))
        line_numbers.append(np.array(lines))
        # Empty cells may stand behind those of the header.
        columns = [*zip(*texts, strict=False)][:width]
        pieces.append([_texts(column) for column in columns])
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


# ---- numbers

# Cells, in small letters, where nothing was measured.
ABSENT = frozenset(("", "nan", "na", "n/a", "null", "none", "-", "--", "<na>", "#n/a", "#nv"))
# A number with a decimal comma.
_COMMA = re.compile(r"[+-]?[0-9]*,[0-9]+(?:[eE][+-]?[0-9]{1,3})?")
# A number with a comma that may stand between thousands.
_THOUSANDS = re.compile(r"[+-]?[1-9][0-9]{0,2},[0-9]{3}")
# A number with signs between thousands.
_GROUPED = re.compile(r"[+-]?[0-9]{1,3}(?:[.,' \u00a0\u202f][0-9]{3})+(?:[.,][0-9]+)?")
# A minus sign, or a dash in place of one.
_MINUS = re.compile(r"(?:^|(?<=[eE/]))[\u2212\u2013](?=[0-9.,]|$)")
# A number with its standard deviation.
_WITH_DEVIATION = re.compile(r"([^±]*?\S)\s*(?:±|\+/-|\+-)\s*([^±+\-\s].*)", re.DOTALL)
# A text that is no number is read anew, as of another dialect, if it has such a sign.
_DIALECT_SIGNS = re.compile("[,±+\u2212\u2013]")
# Characters of a cell that a message shows.
_SHOWN_CHARACTERS = 60


def numbers(
    cells: TableCells,
    wanted: Mapping[str, int],
) -> dict[str, Annotated[FloatArray, "rows"]]:
    """Columns of numbers by name, as they are written: no unit is applied. `wanted` has the index
    of each among `cells.columns`.

    A number is NaN where a cell says that nothing was measured, and where it has a fault:
    `not-a-number`, `not-finite`, `ambiguous-number`. Numbers behind ± are in NAME_sd (fault
    `sd-twice` where that is a column too).

    A file has one decimal sign. Commas are decimal where no number has a point and at least one
    comma cannot stand between thousands.
    """
    values = dict[str, Annotated[FloatArray, "rows"]]()
    texts = dict[str, list[str]]()
    for name, index in wanted.items():
        array = cells.columns[index]
        if array.dtype.kind == "T":
            texts[name] = array.tolist()
        else:
            values[name] = array.astype(np.float64)
    for name, column in texts.items():
        values[name] = _floats(column)
    if any(_has_dialect(column, values[name]) for name, column in texts.items()):
        texts = _without_dialect(cells, texts)
        for name, column in texts.items():
            values[name] = _floats(column)
    for name, column in texts.items():
        for k in _indices_of_gaps(values[name]):
            text = column[k]
            if text.lower() not in ABSENT:
                code, message = _why_no_number(text)
                cells.fault(code, message, name, k)
    for name, parsed in values.items():
        is_infinite = np.isinf(parsed)
        for k in np.flatnonzero(is_infinite).tolist():
            words = "read a number that is not finite; expected a number"
            cells.fault("not-finite", words, name, k)
        parsed[is_infinite] = np.nan
    return values


def _floats(texts: Sequence[str]) -> FloatArray:
    """Numbers (rows,), NaN where a text is none. Stricter than float(): no "1_000", no "nan" or
    "inf", no digits of other scripts.
    """
    is_number = _NUMBER.fullmatch
    parsed = (float(text) if is_number(text) else np.nan for text in texts)
    return np.fromiter(parsed, np.float64, len(texts))


def _indices_of_gaps(values: FloatArray) -> list[int]:
    """Indices of the rows that are NaN."""
    gaps = np.flatnonzero(np.isnan(values))
    return list(gaps.tolist())


def _has_dialect(texts: Sequence[str], values: FloatArray) -> bool:
    """Whether a text that is no number has a comma, a dash or a deviation."""
    return any(_DIALECT_SIGNS.search(texts[k]) for k in _indices_of_gaps(values))


def _without_dialect(cells: TableCells, texts: Mapping[str, list[str]]) -> dict[str, list[str]]:
    """The texts with decimal points and hyphens, and deviations in columns NAME_sd."""
    plain = dict[str, list[str]]()
    for name, column in texts.items():
        values = list[str]()
        deviations = list[str]()
        for text in (_MINUS.sub("-", text) for text in column):
            pair = _WITH_DEVIATION.fullmatch(text)
            values.append(pair[1] if pair else text)
            deviations.append(pair[2] if pair else "")
        plain[name] = values
        if any(deviations):
            cells.note("plus-minus", f"numbers behind ± in {name} are standard deviations")
            plain[f"{name}_sd"] = deviations
            if f"{name}_sd" in texts:
                words = (
                    f"has standard deviations behind ±, and there is a column {name}_sd; keep "
                    "one of them"
                )
                cells.fault("sd-twice", words, name)
    every = [*chain(*plain.values())]
    if not _has_decimal_commas(every):
        return plain
    cells.note("decimal-commas", "numbers have decimal commas")
    for column in plain.values():
        for k, text in enumerate(column):
            if _COMMA.fullmatch(text):
                column[k] = text.replace(",", ".")
    return plain


def _has_decimal_commas(texts: Sequence[str]) -> bool:
    """Whether commas are decimal signs: no number has a point, and at least one comma cannot stand
    between thousands.
    """
    if any("." in text and _NUMBER.fullmatch(text) for text in texts):
        return False
    commas = [text for text in texts if _COMMA.fullmatch(text)]
    return not all(map(_THOUSANDS.fullmatch, commas))


def _why_no_number(text: str) -> tuple[str, str]:
    """Code and message of the fault of a cell that is no number."""
    read = f"read '{one_line(text, _SHOWN_CHARACTERS)}'"
    if _COMMA.fullmatch(text) or _GROUPED.fullmatch(text):
        words = "expected one decimal sign in a file, and no sign between thousands"
        return "ambiguous-number", f"{read}; {words}"
    if text.lower().lstrip("+-") in ("inf", "infinity", "∞"):
        return "not-finite", f"{read}; expected a number"
    words = (
        "expected a number such as 11.73 (units belong in the header), or an empty cell if "
        "nothing was measured"
    )
    return "not-a-number", f"{read}; {words}"
