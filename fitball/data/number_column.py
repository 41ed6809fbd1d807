"""From cells as text to arrays in SI, with the half-width that the printed digits leave open."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from fitball.data.columns import NUMBERS, SD_SUFFIX, Column
from fitball.data.dialect.cells import FORMULA_ERROR
from fitball.data.dialect.numbers import explained
from fitball.data.findings import Findings
from fitball.data.units import DEFAULT_UNIT, Unit
from fitball.values import FloatArray

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
