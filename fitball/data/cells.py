"""`TableCells`, a table as it is written, and the numbers of its columns: decimal signs, ±.

What was assumed is noted, what may be two things is refused. Columns are arrays: an object for each
cell would take too much memory.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Annotated, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from fitball.base.errors import Fault, InputError, Note
from fitball.base.text import one_line
from fitball.base.values import FloatArray, IntArray
from fitball.data.deviations import DEVIATION_SIGNS, with_deviation
from fitball.data.records import NUMBER, cell_text

# Cells of a column, texts or numbers.
CellArray: TypeAlias = NDArray[Any]

# Faults of a table that are listed: more are seldom read, and take memory.
_MOST_FAULTS = 10_000
# Cells by which a column of numbers is told from one of text.
_FIRST_CELLS = 50
# A number, be it of another dialect, or with more behind it.
_BEGINS_AS_NUMBER = re.compile(r"[+\-\u2212\u2013]?[.,]?[0-9]")


@dataclass
class TableCells:
    """A table as it is written.

    `names` are the cells of the header, none empty, with the units of a row below it in brackets.
    `columns`, in that order, are arrays of text, or of numbers where the source has numbers. `rows`
    are the numbers of the rows of data from 1, `lines` those of the lines of the file (None in
    memory); `header` is the header's line, `above` the records above it, cut to the names. All
    numbers are to be multiplied by `factor`. `sha256` is that of the file's bytes, or of names and
    cells in memory.

    The table collects `notes` on what was assumed, and `faults`, for which it is refused. Faults of
    rows name columns as the file does: `theirs` are names of the file by ours, where the user gave
    them. `leave_out` are the columns without which nothing contradicts.
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
    above: list[list[str]] = field(default_factory=list)
    factor: float = 1.0
    theirs: dict[str, str] = field(default_factory=dict)
    leave_out: str = ""

    def text(self, index: int) -> list[str]:
        """The cells of the column of this index as text; whole numbers without a point."""
        column = self.columns[index]
        if column.dtype.kind == "T":
            return list(column.tolist())
        return [cell_text(cell) for cell in column.tolist()]

    def has_numbers(self, index: int) -> bool:
        """Whether any cell of the column of this index begins as a number does."""
        column = self.columns[index]
        if column.dtype.kind != "T":
            return True
        return any(map(_BEGINS_AS_NUMBER.match, column.tolist()))

    def begins_with_numbers(self, index: int) -> bool:
        """Whether the first cells of the column of this index that are filled in are numbers."""
        column = self.columns[index][:_FIRST_CELLS]
        if column.dtype.kind != "T":
            return True
        filled = [cell for cell in column.tolist() if cell.lower() not in ABSENT]
        return all(_BEGINS_AS_NUMBER.match(cell) for cell in filled)

    def plain_numbers(self, index: int) -> Annotated[FloatArray, "rows"]:
        """The cells of the column of this index as numbers, with decimal points or commas, NaN
        where one is none: that is no fault here.
        """
        column = self.columns[index]
        if column.dtype.kind != "T":
            return column.astype(np.float64)
        return _floats([_MINUS.sub("-", cell).replace(",", ".") for cell in column.tolist()])

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
            faults = [self._in_own_columns(fault) for fault in sorted(self.faults, key=_sort_key)]
            raise InputError(self.source, faults, hints)

    def _in_own_columns(self, fault: Fault) -> Fault:
        """A fault of a row with the column as the file calls it; a contradiction with what to leave
        out.
        """
        if fault.code == "contradiction" and self.leave_out:
            words = f"{fault.message}, or leave out what contradicts (--ignore {self.leave_out})"
            fault = replace(fault, message=words)
        if fault.row is None or fault.column is None:
            return fault
        return replace(fault, column=self.theirs.get(fault.column, fault.column))


def _sort_key(fault: Fault) -> tuple[bool, int]:
    """What faults are sorted by: rows, the header before them; that there are more comes last."""
    return fault.code == "more-faults", fault.row or 0


def texts_of(cells: Sequence[str]) -> CellArray:
    """Texts as an array (rows,)."""
    return np.array(cells, dtype=np.dtypes.StringDType())


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
# A text that is no number is read anew, as of another dialect, if it has such a sign.
_DIALECT_SIGNS = re.compile(f"[,\u2212\u2013{DEVIATION_SIGNS}]")
# Characters of a cell that a message shows.
_SHOWN_CHARACTERS = 60


def numbers(
    cells: TableCells,
    wanted: Mapping[str, int],
) -> dict[str, Annotated[FloatArray, "rows"]]:
    """Columns of numbers by name, as they are written, but for a factor of all: no unit is applied.
    `wanted` has the index of each among `cells.columns`.

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
        in_percent = {name for name in texts if "%" in cells.names[wanted[name]]}
        texts = _without_dialect(cells, texts, in_percent)
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
        parsed *= cells.factor
    return values


def _floats(texts: Sequence[str]) -> FloatArray:
    """Numbers (rows,), NaN where a text is none. Stricter than float(): no "1_000", no "nan" or
    "inf", no digits of other scripts.
    """
    is_number = NUMBER.fullmatch
    parsed = (float(text) if is_number(text) else np.nan for text in texts)
    return np.fromiter(parsed, np.float64, len(texts))


def _indices_of_gaps(values: FloatArray) -> list[int]:
    """Indices of the rows that are NaN."""
    gaps = np.flatnonzero(np.isnan(values))
    return list(gaps.tolist())


def _has_dialect(texts: Sequence[str], values: FloatArray) -> bool:
    """Whether a text that is no number has a comma, a dash or a deviation."""
    return any(_DIALECT_SIGNS.search(texts[k]) for k in _indices_of_gaps(values))


def _without_dialect(
    cells: TableCells, texts: Mapping[str, list[str]], in_percent: Set[str]
) -> dict[str, list[str]]:
    """The texts with decimal points and hyphens, and deviations in columns NAME_sd. Those in per
    cent of columns that are `in_percent` themselves may be two things: they stay as they are.
    """
    plain = dict[str, list[str]]()
    percent = dict[str, list[int]]()
    for name, column in texts.items():
        values = list[str]()
        deviations = list[str]()
        for k, text in enumerate(_MINUS.sub("-", text) for text in column):
            pair = with_deviation(text)
            if pair and pair.is_percent and name in in_percent:
                pair = None
            values.append(pair.value if pair else text)
            deviations.append(pair.deviation if pair else "")
            if pair and pair.is_percent:
                percent.setdefault(name, []).append(k)
        plain[name] = values
        if any(deviations):
            words = "numbers behind ± or in brackets"
            cells.note("plus-minus", f"{words} in {name} are standard deviations")
            plain[f"{name}_sd"] = deviations
            if f"{name}_sd" in texts:
                words = (
                    f"has standard deviations behind ±, and there is a column {name}_sd; keep "
                    "one of them"
                )
                cells.fault("sd-twice", words, name)
    _use_decimal_points(cells, plain)
    for name, rows in percent.items():
        numbers_of, deviations_of = _floats(plain[name]), _floats(plain[f"{name}_sd"])
        for k in rows:
            share = 0.01 * float(abs(numbers_of[k]) * deviations_of[k])
            # What is no number has its fault as it is written.
            plain[f"{name}_sd"][k] = plain[f"{name}_sd"][k] if np.isnan(share) else repr(share)
    return plain


def _use_decimal_points(cells: TableCells, texts: Mapping[str, list[str]]) -> None:
    """Put points in place of the decimal commas of texts, if they have these, with a note."""
    if not _has_decimal_commas([*chain(*texts.values())]):
        return
    cells.note("decimal-commas", "numbers have decimal commas")
    for column in texts.values():
        for k, text in enumerate(column):
            if _COMMA.fullmatch(text):
                column[k] = text.replace(",", ".")


def _has_decimal_commas(texts: Sequence[str]) -> bool:
    """Whether commas are decimal signs: no number has a point, and at least one comma cannot stand
    between thousands.
    """
    if any("." in text and NUMBER.fullmatch(text) for text in texts):
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
