"""Any source -> header and columns of text or numbers: layout, units below the header, decimal
signs, ±.

What was assumed is noted, what may be two things is refused. Columns are arrays, never objects a
cell.
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
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitball.base.errors import Fault, InputError, Note
from fitball.base.text import listed, one_line
from fitball.base.units import symbol_of
from fitball.base.values import FloatArray, IntArray
from fitball.data import records
from fitball.data.records import NameWorth, Record, cell_text, refusal

# Endings of Parquet files.
PARQUET = (".parquet", ".pq")
# Faults that are kept one by one: more are seldom read, and take memory.
_FAULTS = 10_000
# Cells that are put into arrays at once.
_CHUNK = 100_000
# Rows of Parquet that are unpacked at once.
_BATCH = 256
# Titles above a header that are named in a note.
_TITLES = 3


@dataclass
class TableCells:
    """A table as it is written. `names` are the cells of the header, none empty, with the units of
    a row below it in brackets; `columns`, in that order, are arrays (rows,) of text, or of numbers
    where the source has numbers. `rows` are numbers of the rows of data from 1, `lines` those of
    the file (None in memory), `header` is the header's line. `sha256` is that of the file's bytes,
    or of names and cells in memory.

    Collects `notes` on what was assumed and `faults`, for which the table is refused.
    """

    source: str
    sha256: str
    names: list[str]
    columns: list[NDArray[Any]]
    rows: IntArray
    lines: IntArray | None = None
    header: int | None = None
    notes: list[Note] = field(default_factory=list)
    faults: list[Fault] = field(default_factory=list)

    def text(self, place: int) -> list[str]:
        """The cells (rows,) of the column at a place as text; whole numbers without a point."""
        column = self.columns[place]
        if column.dtype.kind == "T":
            return list(column.tolist())
        return [cell_text(cell) for cell in column.tolist()]

    def note(self, code: str, text: str) -> None:
        """Add a note."""
        self.notes.append(Note(code, text))

    def fault(
        self,
        code: str,
        message: str,
        column: str | None = None,
        place: int | None = None,
    ) -> None:
        """Add a fault of the row at a place, or of the header."""
        row = None
        line = self.header
        if place is not None:
            row = int(self.rows[place])
            line = None if self.lines is None else int(self.lines[place])
        self.add(Fault(code, message, row, line, column))

    def add(self, fault: Fault) -> None:
        """Add a fault; the first 10,000 are kept."""
        if len(self.faults) < _FAULTS:
            self.faults.append(fault)
        elif len(self.faults) == _FAULTS:
            self.faults.append(
                Fault("more-faults", f"the first {_FAULTS:,} faults; there are more")
            )

    def refuse(self, hints: Sequence[str] = ()) -> None:
        """Raise InputError if there are faults, those of the header first, then row by row."""
        if self.faults:
            faults = sorted(self.faults, key=_order_of)
            raise InputError(self.source, faults, hints)


def _order_of(fault: Fault) -> tuple[bool, int]:
    """Sorts faults by row, those of the header first."""
    return fault.code == "more-faults", fault.row or 0


def file_and_sheet(source: str) -> tuple[str, str]:
    """A file, and the sheet that is named behind `#`, unless a file has that name."""
    # Unlike that of Path, this answers for a name too long for the system.
    if os.path.isfile(source):  # noqa: PTH113
        return source, ""
    file, _, sheet = source.partition("#")
    return file, sheet


def read_cells(source: Any, known: NameWorth, name: str = "") -> TableCells:
    """The cells of a file (text with any separator in UTF-8, UTF-16 or Windows-1252; a workbook, of
    which `book.xlsx#sheet` chooses a sheet; Parquet), of a DataFrame, whose index counts if it has
    a name, or of a mapping of columns; `name` is what faults call these two. `known` says what a
    header cell is worth (`Naming.worth`).

    Raises InputError where a source cannot be taken apart: `not-found`, `empty`, `too-large`,
    `encoding`, `quotes`, `above-header`, `not-a-workbook`, `no-sheet`, `several-sheets`,
    `not-parquet`, `no-pyarrow`, `not-a-table`. Faults that leave the rest readable are in `faults`:
    `row-length`, `summary-row`.
    """
    if isinstance(source, Mapping) or hasattr(source, "iloc"):
        return _framed(name or type(source).__name__, source)
    place, sheet = file_and_sheet(str(source))
    data = _content(str(source), place)
    suffix = Path(place).suffix.lower()
    if not data.strip():
        words = "the file is empty; expected a header line and at least two rows"
        raise refusal(place, "empty", words)
    if sheet and suffix not in records.WORKBOOKS:
        words = f"'#{sheet}' names a sheet, which {suffix[1:] or 'text'} has not; leave it out"
        raise refusal(str(source), "no-sheet", words)
    sha256 = hashlib.sha256(data).hexdigest()
    if suffix in PARQUET:
        return _framed(place, _parquet(place, data), sha256)
    notes = list[Note]()
    if suffix in records.WORKBOOKS:
        rows = records.workbook_records(place, data, suffix, sheet, known, notes)
    else:
        rows = records.text_records(place, data, known, notes)
    return _laid_out(str(source), sha256, rows, known, notes)


def _content(source: str, place: str) -> bytes:
    """The bytes of a file. Raises InputError (`not-found`, `too-large`)."""
    try:
        # Names that are not UTF-8 cannot be written into results.
        with Path(place.encode().decode()).open("rb") as file:
            data = file.read(records.BYTES + 1)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        words = f"cannot be opened: {why}; expected a readable table"
        raise refusal(source, "not-found", words) from None
    if len(data) > records.BYTES:
        raise records.too_large(place, "a larger file", f"{records.BYTES / 1e6:.0f} MB")
    return data


# ---- memory, Parquet


def _framed(source: str, table: Any, sha256: str = "") -> TableCells:
    """The columns of a DataFrame, or of what makes one; numbers stay numbers. Raises InputError
    (`not-a-table`, `too-large`).
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
    names = [cell_text(name) for name in list[Any](frame.columns)]
    columns = [_array(frame.iloc[:, k]) for k in range(len(names))]
    digest = sha256 or _digest(names, columns)
    return _named(TableCells(source, digest, names, columns, np.arange(len(frame)) + 1))


def _digest(names: Sequence[str], columns: Sequence[NDArray[Any]]) -> str:
    """The SHA-256 of a table in memory."""
    digest = hashlib.sha256("\0".join(names).encode())
    for column in columns:
        if column.dtype.kind == "T":
            digest.update("\0".join(column.tolist()).encode())
        else:
            digest.update(column.tobytes())
    return digest.hexdigest()


def _array(column: Any) -> NDArray[Any]:
    """The cells (rows,) of a column of a DataFrame, as numbers or texts; gaps are NaN or empty."""
    if column.dtype.kind in "iuf":
        return np.asarray(column.to_numpy(np.float64, na_value=np.nan))
    texts = []
    for value, is_gap in zip(column, column.isna(), strict=True):
        texts.append("" if is_gap else cell_text(value))
    return _texts(texts)


def _parquet(source: str, data: bytes) -> Any:
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
        records.check_shape(source, file.metadata.num_rows, file.metadata.num_columns)
        # A text that stands in the file once may be that of all rows: what is unpacked is counted
        # in pieces first.
        unpacked = sum(batch.nbytes for batch in file.iter_batches(_BATCH))
        if unpacked > records.BYTES:
            raise records.too_large(source, "a column", f"{records.BYTES / 1e6:.0f} MB unpacked")
        return file.read().to_pandas()
    # What pandas notes of its columns in the file may be anything.
    except (pyarrow.ArrowException, ValueError, OSError, KeyError, TypeError) as error:
        words = (
            f"not a Parquet file ({one_line(str(error))}); expected Parquet, or CSV with the "
            "ending .csv"
        )
        raise refusal(source, "not-parquet", words) from None


# ---- layout

# A number with a decimal point.
_NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
# What stands in a row of units where a column has none.
_BLANKS = ("", "-", "--", "—", "1", "[-]", "(-)", "[]", "()")
# How rows begin that sum up a table.
_SUMMED = re.compile(
    r"(mean|average|median|sd|std(\.? ?dev)?|standard deviation|mittel(wert)?)[.:]?",
    re.IGNORECASE,
)
# A row of so many numbers above the header is one of data.
_NUMBERS_ABOVE = 2
# Characters of a title that are named.
_TITLE_LENGTH = 60


def _texts(cells: Sequence[str]) -> NDArray[Any]:
    """Texts as an array (rows,)."""
    return np.array(cells, dtype=np.dtypes.StringDType())


def _named(cells: TableCells) -> TableCells:
    """The cells without the columns that have no name."""
    places = [k for k, name in enumerate(cells.names) if name]
    cells.columns = [cells.columns[k] for k in places]
    cells.names = [cells.names[k] for k in places]
    return cells


def _units(cells: Sequence[str], names: Sequence[str], known: NameWorth) -> list[str] | None:
    """The names with the units of the row below them; None where it is no row of units: no number,
    units for at least half of what is filled in, one under a name that is known.
    """
    bare = {k: cell.strip("[](){} ") for k, cell in enumerate(cells) if cell not in _BLANKS}
    units = {k for k, unit in bare.items() if symbol_of(unit)}
    named = {k for k in bare if k < len(names) and known(names[k])}
    if 2 * len(units) < len(bare) or units.isdisjoint(named):
        return None
    if any(map(_NUMBER.fullmatch, bare.values())):
        return None
    with_units = list[str]()
    for k, name in enumerate(names):
        # A unit that stands in the header too is the same one.
        if k in named and not name.endswith((f"[{bare[k]}]", f"({bare[k]})")):
            with_units.append(f"{name} [{bare[k]}]")
        else:
            with_units.append(name)
    return with_units


def _laid_out(
    source: str,
    sha256: str,
    rows: Iterator[Record],
    known: NameWorth,
    notes: list[Note],
) -> TableCells:
    """Header and columns; rows of another length, and those that sum up a table, are faults. Raises
    InputError (`empty`, `above-header`, `too-large`).
    """
    filled = (record for record in rows if any(record[1]))
    head = [*islice(filled, records.REACH)]
    place, worth = records.find_header(head, known)
    if not worth and all(records.is_comment(cells) for _, cells in head):
        words = (
            "only blank and comment lines were read; expected a header line and at least two rows"
        )
        raise refusal(source, "empty", words)
    _note_above(source, head[:place], notes)
    line, header = head[place]
    names = [header[0].lstrip("# ") or header[0], *header[1:]]
    records.check_shape(source, 1, len(names))
    below = chain(head[place + 1 :], filled)
    rest = (record for record in below if not records.is_comment(record[1]))
    first = [*islice(rest, 1)]
    with_units = _units(first[0][1], names, known) if first else None
    if with_units is not None:
        names = with_units
        first = []
        notes.append(Note("units-row", "the units were read from the row below the header"))
    width = max(k + 1 for k, name in enumerate(names) if name)
    no_rows = np.empty(0, np.int64)
    cells = TableCells(source, sha256, names[:width], [], no_rows, None, line, notes)
    _fill(cells, _good(cells, chain(first, rest), header))
    return _named(cells)


def _note_above(source: str, above: Sequence[Record], notes: list[Note]) -> None:
    """Note titles above the header. Raises InputError (`above-header`) for rows of numbers."""
    titles = []
    for line, cells in above:
        if records.is_comment(cells):
            continue
        if sum(_NUMBER.fullmatch(cell) is not None for cell in cells) >= _NUMBERS_ABOVE:
            words = (
                "read a row of numbers above the header; expected the header first: move it "
                "up, or delete the row"
            )
            raise refusal(source, "above-header", words, line)
        if not cells[0].lower().startswith("sep="):
            titles.append(one_line(" ".join(filter(None, cells)), _TITLE_LENGTH))
    if titles:
        words = f"ignored above the header: {listed(map(repr, titles), most=_TITLES)}"
        notes.append(Note("above-header", words))


def _fill(cells: TableCells, good: Iterator[tuple[int, int, list[str]]]) -> None:
    """Put rows into arrays, some at a time. Raises InputError (`too-large`)."""
    width = len(cells.names)
    places = [np.empty((2, 0), np.int64)]
    pieces = [[_texts([])] * width]
    count = 0
    while chunk := [*islice(good, _CHUNK // width)]:
        numbers_of, lines, texts = zip(*chunk, strict=True)
        places.append(np.array([numbers_of, lines]))
        columns = [*zip(*texts, strict=False)][:width]
        pieces.append([_texts(column) for column in columns])
        count += len(chunk)
        records.check_shape(cells.source, count, width)
    cells.rows, cells.lines = np.concatenate(places, axis=1)
    cells.columns = [np.concatenate(column) for column in zip(*pieces, strict=True)]


def _good(
    cells: TableCells,
    rest: Iterator[Record],
    header: list[str],
) -> Iterator[tuple[int, int, list[str]]]:
    """Numbers, lines and cells of rows as long as the header; others are faults."""
    width = len(cells.names)
    number = 0
    for line, row in rest:
        if row == header:
            cells.note("header-again", f"the header is repeated in line {line}; ignored")
            continue
        number += 1
        first = next(filter(None, row))
        if _SUMMED.fullmatch(first):
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

# What a cell says where nothing was measured.
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
_PAIR = re.compile(r"([^±]*?\S)\s*(?:±|\+/-|\+-)\s*([^±+\-\s].*)", re.DOTALL)
# What makes a second look at texts worth it.
_SIGNS = re.compile("[,±+\u2212\u2013]")
# Characters of a cell that a message shows.
_SHOWN = 60


def numbers(cells: TableCells, wanted: Mapping[str, int]) -> dict[str, FloatArray]:
    """Columns (rows,) of numbers by name, at places of `cells.columns`, as they are written: no
    unit is applied. NaN where a cell says that nothing was measured, and where it has a fault:
    `not-a-number`, `not-finite`, `ambiguous-number`. Numbers behind ± are in NAME_sd (fault
    `sd-twice` where that is a column too).

    A file has one decimal sign: commas are one where no number has a point and at least one comma
    cannot stand between thousands.
    """
    values = dict[str, FloatArray]()
    texts = dict[str, list[str]]()
    for name, place in wanted.items():
        array = cells.columns[place]
        if array.dtype.kind == "T":
            texts[name] = array.tolist()
        else:
            values[name] = array.astype(np.float64)
    for name, column in texts.items():
        values[name] = _parsed(column)
    if any(_has_signs(column, values[name]) for name, column in texts.items()):
        texts = _plain(cells, texts)
        for name, column in texts.items():
            values[name] = _parsed(column)
    for name, column in texts.items():
        for k in _gaps(values[name]):
            if column[k].lower() not in ABSENT:
                code, message = _explained(column[k])
                cells.fault(code, message, name, k)
    for name, parsed in values.items():
        is_infinite = np.isinf(parsed)
        for k in np.flatnonzero(is_infinite).tolist():
            words = "read a number that is not finite; expected a number"
            cells.fault("not-finite", words, name, k)
        parsed[is_infinite] = np.nan
    return values


def _parsed(texts: Sequence[str]) -> FloatArray:
    """Numbers (rows,), NaN where a text is none. Stricter than float(): no "1_000", no "nan" or
    "inf", no digits of other scripts.
    """
    is_number = _NUMBER.fullmatch
    parsed = (float(text) if is_number(text) else np.nan for text in texts)
    return np.fromiter(parsed, np.float64, len(texts))


def _gaps(values: FloatArray) -> list[int]:
    """Places of NaN."""
    return list(np.flatnonzero(np.isnan(values)).tolist())


def _has_signs(texts: Sequence[str], values: FloatArray) -> bool:
    """Whether a text that is no number has a comma, a dash or a deviation."""
    return any(_SIGNS.search(texts[k]) for k in _gaps(values))


def _plain(cells: TableCells, texts: Mapping[str, list[str]]) -> dict[str, list[str]]:
    """Texts with decimal points and hyphens, deviations in columns of their own."""
    plain = dict[str, list[str]]()
    for name, column in texts.items():
        with_hyphens = [_MINUS.sub("-", text) for text in column]
        pairs = [_PAIR.fullmatch(text) for text in with_hyphens]
        plain[name] = [
            pair[1] if pair else text for pair, text in zip(pairs, with_hyphens, strict=True)
        ]
        if any(pairs):
            cells.note("plus-minus", f"numbers behind ± in {name} are standard deviations")
            plain[f"{name}_sd"] = [pair[2] if pair else "" for pair in pairs]
            if f"{name}_sd" in texts:
                words = (
                    f"has standard deviations behind ±, and there is a column {name}_sd; keep "
                    "one of them"
                )
                cells.fault("sd-twice", words, name)
    if not _has_decimal_commas([*chain(*plain.values())]):
        return plain
    cells.note("decimal-commas", "numbers have decimal commas")
    for column in plain.values():
        column[:] = [text.replace(",", ".") if _COMMA.fullmatch(text) else text for text in column]
    return plain


def _has_decimal_commas(texts: Sequence[str]) -> bool:
    """Whether commas are decimal signs: no number has a point, and a comma does not stand between
    thousands.
    """
    if any("." in text and _NUMBER.fullmatch(text) for text in texts):
        return False
    commas = [text for text in texts if _COMMA.fullmatch(text)]
    return not all(map(_THOUSANDS.fullmatch, commas))


def _explained(text: str) -> tuple[str, str]:
    """Code and message of a cell that is no number."""
    read = f"read '{one_line(text, _SHOWN)}'"
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
