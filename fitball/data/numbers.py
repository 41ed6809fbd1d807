"""From cells as text to arrays in SI, with the half-width that the printed digits leave open.

Numbers are read as people write them: decimal commas, printed minus signs, `21.0 ± 0.2`. What may be meant in two
ways is left as it is and refused, as is a number that no impact of a ball has.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from fitball.data.columns import NUMBERS, SD_SUFFIX, limit_of
from fitball.data.findings import FORMULA_ERROR, Findings, RawRow
from fitball.data.header import Column
from fitball.data.units import DEFAULT_UNIT, UNITS, Unit, symbols
from fitball.errors import ParameterError
from fitball.values import FloatArray

_COMMA = re.compile(r"[+\-]?\d*,\d+(?:[eE][+\-]?\d+)?")
_POINT = re.compile(r"[+\-]?(?:\d+\.\d*|\.\d+)(?:[eE][+\-]?\d+)?")
_THOUSANDS = re.compile(r"[+\-]?[1-9]\d{0,2},\d{3}")
_GROUPED = re.compile(r"[+\-]?\d{1,3}(?:[.,' \u00a0\u202f]\d{3})+(?:[.,]\d+)?")
_MINUS = re.compile(r"(?:^|(?<=[eE]))[\u2212\u2013](?=[\d.,])")
# Without any of these there is no decimal comma, printed minus sign or deviation; and no deviation.
_SIGNS, _DEVIATION_SIGNS = ",±+\u2212\u2013", "±+"
# No number with its deviation is longer; the pattern takes time with the square of the length.
_LONGEST_PAIR = 100
_PLUS_MINUS = re.compile(r"(?P<value>[^±]*?\S)\s*(?:±|\+/-|\+/\u2212|\+-)\s*(?P<sd>[^±+\-\s].*)")


def plain_numbers(rows: Sequence[RawRow], places: Sequence[int]) -> tuple[tuple[RawRow, ...], tuple[str, ...]]:
    """The rows with decimal points and hyphens in their cells at `places`, which hold numbers, and notes on what was
    changed.

    A file has one decimal sign: commas are one where no number has a point, and at least one comma cannot stand
    between thousands.
    """
    notes: tuple[str, ...] = ()
    cells = [row.cells[place] for row in rows for place in places]
    if not _any_of(_SIGNS, cells):
        return tuple(rows), notes
    if any(_MINUS.search(cell) for cell in cells):
        notes = ("printed minus signs (\u2212, –) were read as such",)
        rows = [_changed(row, places, lambda cell: _MINUS.sub("-", cell)) for row in rows]
    parts = [part for row in rows for place in places for part in _parts(row.cells[place])]
    commas = [part for part in parts if _COMMA.fullmatch(part)]
    if not commas or all(map(_THOUSANDS.fullmatch, commas)) or any(map(_POINT.fullmatch, parts)):
        return tuple(rows), notes
    return tuple(_changed(row, places, _with_point) for row in rows), (*notes, "numbers have decimal commas")


def _any_of(signs: str, cells: Sequence[str]) -> bool:
    """Whether any of the signs stands in any of the cells, which are looked at as one text: they may be millions."""
    text = "\n".join(cells)
    return any(sign in text for sign in signs)


def _changed(row: RawRow, places: Sequence[int], change: Callable[[str], str]) -> RawRow:
    cells = list(row.cells)
    for place in places:
        cells[place] = change(cells[place])
    return replace(row, cells=tuple(cells))


def _parts(cell: str) -> Iterable[str]:
    """The number of a cell, or number and deviation."""
    pair = _pair(cell)
    return (cell,) if pair is None else (pair["value"], pair["sd"])


def _pair(cell: str) -> re.Match[str] | None:
    """A number and its deviation, if a cell holds both."""
    return _PLUS_MINUS.fullmatch(cell) if len(cell) <= _LONGEST_PAIR else None


def _with_point(cell: str) -> str:
    whole = all(_COMMA.fullmatch(part) or part.lstrip("+-").isdigit() for part in _parts(cell))
    return cell.replace(",", ".") if whole else cell


def split_deviations(rows: Sequence[RawRow], places: Sequence[int]) -> tuple[tuple[RawRow, ...], dict[int, int]]:
    """The rows with each `value ± sd` as its value, the sds in columns of their own behind the others; the places of
    these columns by that of the number. A row without a deviation has an empty cell there.
    """
    if not _any_of(_DEVIATION_SIGNS, [row.cells[place] for row in rows for place in places]):
        return tuple(rows), {}
    stated = [place for place in places if any(_pair(row.cells[place]) for row in rows)]
    if not stated:
        return tuple(rows), {}
    width = len(rows[0].cells)
    split = []
    for row in rows:
        cells, sds = list(row.cells), []
        for place in stated:
            pair = _pair(cells[place])
            sds.append("" if pair is None else pair["sd"])
            if pair is not None:
                cells[place] = pair["value"]
        split.append(replace(row, cells=(*cells, *sds)))
    return tuple(split), {place: width + k for k, place in enumerate(stated)}


def explained(cell: str) -> str | None:
    """Why the number of a cell is open, and what to write; None where it is something else than a number."""
    if _THOUSANDS.fullmatch(cell):
        return (
            f"read '{cell}', which may be {cell.replace(',', '.')} or {cell.replace(',', '')}; expected a decimal "
            "point, and nothing between thousands"
        )
    if _COMMA.fullmatch(cell):
        return (
            f"read '{cell}', a decimal comma, beside numbers with points; expected one decimal sign: write "
            f"'{cell.replace(',', '.')}'"
        )
    if _GROUPED.fullmatch(cell):
        return f"read '{cell}', with signs between thousands; expected a decimal point and no other sign"
    return None


# Stricter than float(): no "1_000", no "nan" or "inf", no digits of other scripts.
_NUMBER = re.compile(r"[+-]?([0-9]+(?:\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]{1,3})?")
# `#N/A` and `#NV` are how Excel shows what is not available.
_ABSENT = ("", "nan", "na", "n/a", "null", "none", "-", "--", "<na>", "#n/a", "#nv")
_INFINITE = ("inf", "infinity", "∞")

# Digits of a double, and the largest power of ten that is one.
DIGITS, MOST_EXPONENT = 15, 308


@dataclass(frozen=True)
class NumberColumn:
    """A column of numbers. `values` (impacts,) in SI, NaN where a cell had a fault and where it is `missing`
    (impacts,), that is, says that nothing was measured; `half_width` [SI] is half a unit of the last printed decimal;
    `unit` as in the file; `decimals` as printed.
    """

    name: str
    values: FloatArray
    half_width: float
    unit: Unit
    decimals: int
    missing: NDArray[np.bool_]

    def take(self, rows: NDArray[np.int64]) -> NumberColumn:
        """The cells with these places."""
        return replace(self, values=self.values[rows], missing=self.missing[rows])

    def shown(self, value: float) -> str:
        """An SI value as the file would print it, shorter where that takes more digits than a number has."""
        number = self.unit.from_si(float(value))
        if abs(number) >= 10.0**DIGITS or self.decimals > DIGITS:
            return f"{number:.6g} {self.unit.symbol}"
        return f"{number:.{self.decimals}f} {self.unit.symbol}"


def read_column(column: Column, found: Findings, *, gaps: bool = False) -> NumberColumn:
    """The numbers of one column; all NaN when its unit was not understood (that fault is reported already),
    so that no later check draws conclusions from them.

    The half-width follows from the cell printed to most decimals, because spreadsheets drop trailing
    zeros: a `6` between `6.47` and `7.25` was measured as 6.00. With `gaps` a cell that says that nothing was
    measured (empty, `nan`, `NA`, `-`) is no fault.
    """
    cells = [row.cells[column.index] for row in found.rows]
    missing = np.array([gaps and absent(cell) for cell in cells], dtype=np.bool_)
    numbers = [
        None if gap else _read_cell(cell, k, column.name, found, gaps)
        for k, (cell, gap) in enumerate(zip(cells, missing.tolist(), strict=True))
    ]
    unit = column.unit or DEFAULT_UNIT[NUMBERS[column.name]]
    exponent = min((number[1] for number in numbers if number is not None), default=0)
    trusted = [float("nan") if item is None or column.unit is None else item[0] for item in numbers]
    with np.errstate(over="ignore"):
        values = unit.to_si(np.array(trusted, dtype=np.float64))
    for k in np.flatnonzero(np.isinf(values)).tolist():
        found.fault(f"read '{cells[k]}', which is not finite in SI units; expected a number", column.name, k)
        values[k] = np.nan
    half_width = unit.to_si(0.5 * 10.0**exponent)
    return NumberColumn(column.name, values, half_width, unit, max(0, -exponent), missing)


def absent(text: str) -> bool:
    """Whether a cell says that nothing was measured."""
    return text.lower() in _ABSENT


def _read_cell(text: str, place: int, name: str, found: Findings, gaps: bool) -> tuple[float, int] | None:
    """The number of a cell, and the power of ten of its last digit; None, with a fault, where it has none."""
    matched = _NUMBER.fullmatch(text)
    if matched and isfinite(number := float(text)):
        digits, power = matched[1], matched[2]
        point = digits.find(".")
        exponent = (point + 1 - len(digits) if point >= 0 else 0) + (int(power[1:]) if power else 0)
        # "0e400" is zero, but no digit of it stands where a number can have one.
        if exponent <= MOST_EXPONENT:
            return number, exponent
    found.fault(_explain(text, name, gaps), name, place)
    return None


def _explain(text: str, name: str, gaps: bool) -> str:
    what = "a standard deviation" if name.endswith(SD_SUFFIX) else "a number"
    lower = text.lower()
    if absent(text):
        return f"read {repr(text) if text else 'an empty cell'}; expected {what}: measure it, or delete the row"
    if lower.lstrip("+-") in _INFINITE or _NUMBER.fullmatch(text):
        return f"read '{text}', which is not finite; expected {what}"
    open_number = explained(text)
    if open_number is not None:
        return open_number
    empty = "leave the cell empty where nothing was measured" if gaps else "measure it, or delete the row"
    if FORMULA_ERROR.match(text):
        return (
            f"read '{text}', the error of a formula in a spreadsheet; expected {what}: mend the formula, or {empty}"
        )
    if not any(map(str.isdigit, text)):
        return f"read '{text}'; expected {what} such as 11.73: {empty}"
    return f"read '{text}'; expected {what} such as 11.73 (units belong in the header)"


def beyond_limit(name: str, values: FloatArray) -> NDArray[np.bool_]:
    """Where `values` [SI] of a quantity, or of its sd, cannot be (same shape).

    What is zero or negative is left to checks that say why it may not be.
    """
    limit, size = limit_of(name), np.abs(values)
    beyond: NDArray[np.bool_] = (size > limit.most) | ((size > 0.0) & (size < limit.least))
    return beyond


def within_limits(columns: Mapping[str, NumberColumn], found: Findings) -> dict[str, NumberColumn]:
    """The columns with NaN and a fault for every number beyond the limit of its quantity.

    NaN, so that no later check draws conclusions from it.
    """
    kept = dict(columns)
    for name, column in columns.items():
        beyond = beyond_limit(name, column.values)
        if not beyond.any():
            continue
        kept[name] = replace(column, values=np.where(beyond, np.nan, column.values))
        meant = _meant(column)
        for k in np.flatnonzero(beyond).tolist():
            read = f"read {column.shown(column.values[k])}; expected {limit_of(name).words}"
            found.fault(f"{read}: check the unit and the digits{meant}", name, k)
    return kept


def _meant(column: NumberColumn) -> str:
    """A question, where a single other unit makes every number of a column one that can be."""
    units = [UNITS[symbol] for symbol in symbols(column.unit.dimension)]
    with np.errstate(over="ignore"):
        written = column.unit.from_si(column.values[np.isfinite(column.values)])
        fitting = [unit.symbol for unit in units if not beyond_limit(column.name, unit.to_si(written)).any()]
    return f"; did you mean '{column.name} [{fitting[0]}]' in the header?" if len(fitting) == 1 else ""


def refuse_beyond(name: str, values: FloatArray) -> None:
    """Raise ParameterError for a quantity of an option's text that no impact has; `values` in SI."""
    if beyond_limit(name, values).any():
        raise ParameterError(f"{name}: expected {limit_of(name).words}: check the unit and the digits")
