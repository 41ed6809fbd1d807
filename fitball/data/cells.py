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
from fitball.data.records import Known, Record, refusal, shown

PARQUET = (".parquet", ".pq")
# Faults that are kept one by one, and cells that are put into arrays at once.
_FAULTS = 10_000
_CHUNK = 100_000


@dataclass
class Cells:
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
        """The cells of the column at a place as text; whole numbers without a point."""
        column = self.columns[place]
        return (
            column.tolist()
            if column.dtype.kind == "T"
            else [shown(cell) for cell in column.tolist()]
        )

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
        row = None if place is None else int(self.rows[place])
        line = (
            self.header if place is None else None if self.lines is None else int(self.lines[place])
        )
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
            faults = sorted(self.faults, key=lambda one: (one.code == "more-faults", one.row or 0))
            raise InputError(self.source, faults, hints)


def file_and_sheet(source: str) -> tuple[str, str]:
    """A file, and the sheet that is named behind `#`, unless a file has that name."""
    # Unlike that of Path, this answers for a name too long for the system.
    file, _, sheet = (source, "", "") if os.path.isfile(source) else source.partition("#")  # noqa: PTH113
    return file, sheet


def read_cells(source: Any, known: Known, name: str = "") -> Cells:
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
    try:
        # Names that are not UTF-8 cannot be written into results.
        with Path(place.encode().decode()).open("rb") as file:
            data = file.read(records.BYTES + 1)
    except (OSError, ValueError) as error:
        words = (
            f"cannot be opened: {getattr(error, 'strerror', None) or error}; expected a "
            "readable table"
        )
        raise refusal(str(source), "not-found", words) from None
    if len(data) > records.BYTES:
        raise records.too_large(place, "a larger file", f"{records.BYTES / 1e6:.0f} MB")
    suffix = Path(place).suffix.lower()
    notes = list[Note]()
    sha256 = hashlib.sha256(data).hexdigest()
    if not data.strip():
        raise refusal(
            place,
            "empty",
            "the file is empty; expected a header line and at least two rows",
        )
    if sheet and suffix not in records.WORKBOOKS:
        raise refusal(
            str(source),
            "no-sheet",
            f"'#{sheet}' names a sheet, which {suffix[1:] or 'text'} has not; leave it out",
        )
    if suffix in PARQUET:
        return _framed(place, _parquet(place, data), sha256)
    if suffix in records.WORKBOOKS:
        found = records.workbook_records(place, data, suffix, sheet, known, notes)
    else:
        found = records.text_records(place, data, known, notes)
    return _laid_out(str(source), sha256, found, known, notes)


# ---- memory, Parquet


def _framed(source: str, given: Any, sha256: str = "") -> Cells:
    """The columns of a DataFrame, or of what makes one; numbers stay numbers."""
    import pandas

    try:
        frame = pandas.DataFrame(given)
    except (ValueError, TypeError) as error:
        raise refusal(
            source,
            "not-a-table",
            f"expected columns of one length, by name ({error})",
        ) from None
    if any(level is not None for level in frame.index.names):
        frame = frame.reset_index(allow_duplicates=True)
    records.check_shape(source, *frame.shape)
    names = [shown(name) for name in list[Any](frame.columns)]
    columns = [_array(frame.iloc[:, k]) for k in range(len(names))]
    digest = hashlib.sha256("\0".join(names).encode())
    for column in columns:
        digest.update(
            "\0".join(column.tolist()).encode() if column.dtype.kind == "T" else column.tobytes()
        )
    return _named(
        Cells(source, sha256 or digest.hexdigest(), names, columns, np.arange(len(frame)) + 1)
    )


def _array(column: Any) -> NDArray[Any]:
    """The cells of a column of a DataFrame."""
    if column.dtype.kind in "iuf":
        return np.asarray(column.to_numpy(np.float64, na_value=np.nan))
    return _texts(
        ["" if gap else shown(value) for value, gap in zip(column, column.isna(), strict=True)]
    )


def _parquet(source: str, data: bytes) -> Any:
    """The DataFrame of a Parquet file."""
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
        if sum(batch.nbytes for batch in file.iter_batches(256)) > records.BYTES:
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

_NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
_BLANKS = ("", "-", "--", "—", "1", "[-]", "(-)", "[]", "()")
_SUMMED = re.compile(
    r"(mean|average|median|sd|std(\.? ?dev)?|standard deviation|mittel(wert)?)[.:]?",
    re.IGNORECASE,
)


def _texts(cells: Sequence[str]) -> NDArray[Any]:
    return np.array(cells, dtype=np.dtypes.StringDType())


def _named(cells: Cells) -> Cells:
    """Without the columns that have no name."""
    kept = [k for k, name in enumerate(cells.names) if name]
    cells.names, cells.columns = [cells.names[k] for k in kept], [cells.columns[k] for k in kept]
    return cells


def _units(cells: Sequence[str], names: Sequence[str], known: Known) -> list[str] | None:
    """The names with the units of the row below them; None where it is no row of units: no number,
    units for at least half of what is filled in, one under a name that is known.
    """
    bare = {k: cell.strip("[](){} ") for k, cell in enumerate(cells) if cell not in _BLANKS}
    units = {k for k, unit in bare.items() if symbol_of(unit)}
    named = {k for k in bare if k < len(names) and known(names[k])}
    if (
        2 * len(units) < len(bare)
        or not units & named
        or any(map(_NUMBER.fullmatch, bare.values()))
    ):
        return None
    # A unit that stands in the header too is the same one.
    named -= {k for k in named if names[k].endswith((f"[{bare[k]}]", f"({bare[k]})"))}
    return [f"{name} [{bare[k]}]" if k in named else name for k, name in enumerate(names)]


def _laid_out(
    source: str,
    sha256: str,
    found: Iterator[Record],
    known: Known,
    notes: list[Note],
) -> Cells:
    """Header and columns; rows of another length, and those that sum up a table, are faults."""
    found = (record for record in found if any(record[1]))
    head = [*islice(found, records.REACH)]
    at, worth = records.find_header(head, known)
    if not worth and all(records.is_comment(cells) for _, cells in head):
        words = (
            "only blank and comment lines were read; expected a header line and at least two rows"
        )
        raise refusal(source, "empty", words)
    above = [(line, cells) for line, cells in head[:at] if not records.is_comment(cells)]
    for line, cells in above:
        if sum(_NUMBER.fullmatch(cell) is not None for cell in cells) >= 2:
            words = (
                "read a row of numbers above the header; expected the header first: move it "
                "up, or delete the row"
            )
            raise refusal(source, "above-header", words, line)
    titles = [
        one_line(" ".join(filter(None, cells)), 60)
        for _, cells in above
        if cells[0][:4].lower() != "sep="
    ]
    if titles:
        notes.append(
            Note("above-header", f"ignored above the header: {listed(map(repr, titles), most=3)}")
        )
    place, header = head[at]
    names = [header[0].lstrip("# ") or header[0], *header[1:]]
    records.check_shape(source, 1, len(names))
    rest = (record for record in chain(head[at + 1 :], found) if not records.is_comment(record[1]))
    first = [*islice(rest, 1)]
    if first and (units := _units(first[0][1], names, known)):
        names = units
        first = []
        notes.append(Note("units-row", "the units were read from the row below the header"))
    width = max(k + 1 for k, name in enumerate(names) if name)
    made = Cells(source, sha256, names[:width], [], np.empty(0, np.int64), None, place, notes)
    good = _good(made, chain(first, rest), header)
    places = [np.empty((2, 0), np.int64)]
    pieces = [[_texts([])] * width]
    while chunk := [*islice(good, _CHUNK // width)]:
        *where, texts = zip(*chunk, strict=True)
        places.append(np.array(where))
        pieces.append([_texts(column) for column in [*zip(*texts, strict=False)][:width]])
        records.check_shape(source, sum(one.shape[1] for one in places), width)
    made.rows, made.lines = np.concatenate(places, axis=1)
    made.columns = [np.concatenate(column) for column in zip(*pieces, strict=True)]
    return _named(made)


def _good(
    made: Cells,
    rest: Iterator[Record],
    header: list[str],
) -> Iterator[tuple[int, int, list[str]]]:
    """Numbers, lines and cells of rows as long as the header; others are faults."""
    width = len(made.names)
    number = 0
    for line, cells in rest:
        if cells == header:
            made.note("header-again", f"the header is repeated in line {line}; ignored")
            continue
        number += 1
        if _SUMMED.fullmatch(word := next(filter(None, cells))):
            words = (
                f"begins with '{word}', as a row that sums up a table; expected impacts: delete it"
            )
            made.add(Fault("summary-row", words, number, line))
        elif len(cells) < width or any(cells[len(header) :]):
            hint = (
                "; if commas separate cells and decimals too, write decimal points"
                if len(cells) > width
                else ""
            )
            words = f"read {len(cells)} cells, expected {width} as in the header{hint}"
            made.add(Fault("row-length", words, number, line))
        else:
            yield number, line, cells


# ---- numbers

ABSENT = frozenset(("", "nan", "na", "n/a", "null", "none", "-", "--", "<na>", "#n/a", "#nv"))
_COMMA = re.compile(r"[+-]?[0-9]*,[0-9]+(?:[eE][+-]?[0-9]{1,3})?")
_THOUSANDS = re.compile(r"[+-]?[1-9][0-9]{0,2},[0-9]{3}")
_GROUPED = re.compile(r"[+-]?[0-9]{1,3}(?:[.,' \u00a0\u202f][0-9]{3})+(?:[.,][0-9]+)?")
_MINUS = re.compile(r"(?:^|(?<=[eE/]))[\u2212\u2013](?=[0-9.,]|$)")
_PAIR = re.compile(r"([^±]*?\S)\s*(?:±|\+/-|\+-)\s*([^±+\-\s].*)", re.DOTALL)
_SIGNS = re.compile("[,±+\u2212\u2013]")


def numbers(cells: Cells, wanted: Mapping[str, int]) -> dict[str, FloatArray]:
    """Columns (rows,) of numbers by name, at places of `cells.columns`, as they are written: no
    unit is applied. NaN where a cell says that nothing was measured, and where it has a fault:
    `not-a-number`, `not-finite`, `ambiguous-number`. Numbers behind ± are in NAME_sd (fault
    `sd-twice` where that is a column too).

    A file has one decimal sign: commas are one where no number has a point and at least one comma
    cannot stand between thousands.
    """
    columns = {name: cells.columns[place] for name, place in wanted.items()}
    values = {
        name: column.astype(np.float64)
        for name, column in columns.items()
        if column.dtype.kind != "T"
    }
    texts = {name: column.tolist() for name, column in columns.items() if column.dtype.kind == "T"}
    values |= {name: _parsed(column) for name, column in texts.items()}
    if any(_SIGNS.search(column[k]) for name, column in texts.items() for k in _gaps(values[name])):
        texts = _plain(cells, texts)
        values |= {name: _parsed(column) for name, column in texts.items()}
    for name, column in texts.items():
        for k in _gaps(values[name]):
            if column[k].lower() not in ABSENT:
                cells.fault(*_explained(column[k]), name, k)
    for name, found in values.items():
        for k in np.flatnonzero(np.isinf(found)).tolist():
            cells.fault(
                "not-finite",
                "read a number that is not finite; expected a number",
                name,
                k,
            )
        found[np.isinf(found)] = np.nan
    return values


def _parsed(texts: Sequence[str]) -> FloatArray:
    """Stricter than float(): no "1_000", no "nan" or "inf", no digits of other scripts."""
    match = _NUMBER.fullmatch
    return np.fromiter(
        (float(text) if match(text) else np.nan for text in texts),
        np.float64,
        len(texts),
    )


def _gaps(values: FloatArray) -> list[int]:
    return np.flatnonzero(np.isnan(values)).tolist()


def _plain(cells: Cells, texts: Mapping[str, list[str]]) -> dict[str, list[str]]:
    """Texts with decimal points and hyphens, deviations in columns of their own."""
    made = dict[str, list[str]]()
    for name, column in texts.items():
        plain = [_MINUS.sub("-", text) for text in column]
        pairs = [_PAIR.fullmatch(text) for text in plain]
        made[name] = [pair[1] if pair else text for pair, text in zip(pairs, plain, strict=True)]
        if any(pairs):
            cells.note("plus-minus", f"numbers behind ± in {name} are standard deviations")
            made[name + "_sd"] = [pair[2] if pair else "" for pair in pairs]
            if name + "_sd" in texts:
                words = (
                    f"has standard deviations behind ±, and there is a column {name}_sd; keep "
                    "one of them"
                )
                cells.fault("sd-twice", words, name)
    every = [*chain(*made.values())]
    commas = [text for text in every if _COMMA.fullmatch(text)]
    points = any("." in text and _NUMBER.fullmatch(text) for text in every)
    if points or all(map(_THOUSANDS.fullmatch, commas)):
        return made
    cells.note("decimal-commas", "numbers have decimal commas")
    return {
        n: [t.replace(",", ".") if _COMMA.fullmatch(t) else t for t in column]
        for n, column in made.items()
    }


def _explained(text: str) -> tuple[str, str]:
    """Code and message of a cell that is no number."""
    read = f"read '{one_line(text, 60)}'"
    if _COMMA.fullmatch(text) or _GROUPED.fullmatch(text):
        return (
            "ambiguous-number",
            f"{read}; expected one decimal sign in a file, and no sign between thousands",
        )
    if text.lower().lstrip("+-") in ("inf", "infinity", "∞"):
        return "not-finite", f"{read}; expected a number"
    words = (
        "expected a number such as 11.73 (units belong in the header), or an empty cell if "
        "nothing was measured"
    )
    return "not-a-number", f"{read}; {words}"
