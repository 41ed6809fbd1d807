"""What stands in a table for something else: zeros and codes for what was not measured, columns of
numbers that are not read.

A spin of exactly 0 is doubted by the angular momentum about the contact, which a bounce keeps but
for a small offset: omega_2 - omega_1 = (v_x1 - v_x2)/(a R) with a = I/(M R^2).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import numpy as np

from fitball.base.text import listed
from fitball.base.values import Ball, BoolArray, FloatArray
from fitball.data.cells import ABSENT, TableCells
from fitball.data.header import LABELS, Header
from fitball.data.kinematics import velocity
from fitball.data.labels import role_of

# A column of more values is none of labels.
_MOST_LABELS = 12
# Columns that a note names.
_NAMED = 12
# Numbers that programs write, with a minus or without, for what was not measured.
_CODES = (99.0, 999.0, 9999.0, 99999.0, 999999.0)
# A code is this many times as large as all other numbers of its column.
_FAR = 4.0
# A negative one that repeats exactly need be this many times.
_FAR_REPEATED = 2.0
# Zeros are doubted in so many rows at least: one may be a zero.
_LEAST_ZEROS = 2
# A number is far from zero above this share of the usual size of its column,
_FAR_SHARE = 0.25
# and above this many times what the balance of angular momentum leaves in other rows, in the median
_FAR_RESIDUALS = 4.0
# or, of rows in which an offset leaves much in all, at the most.
_FAR_FROM_MOST = 2.0
# A ball that moves along the court with less than this share of its speed towards it is dropped.
_DROPPED = 0.1


def note_unused(cells: TableCells, header: Header) -> None:
    """Note columns of numbers that are neither read nor labels: of more than twelve values, and no
    count of rows, or of errors of no column that is read.
    """
    proposed = tuple(header.guesses.values())
    unused = []
    for name, index in header.labels.items():
        cell = cells.names[index]
        if name in LABELS or role_of(name) or any(their.startswith(cell) for their in proposed):
            continue
        if index in header.unread_errors or _has_many_numbers(cells, index):
            unused.append(f"'{cell}'")
    if unused:
        words = f"not used, numbers of no column of fitball: {listed(unused, most=_NAMED)}"
        cells.note("not-used", words)


def _has_many_numbers(cells: TableCells, index: int) -> bool:
    """Whether a column has numbers alone, of more than twelve values, which do not count the rows
    one by one.
    """
    if not cells.begins_with_numbers(index):
        return False
    numbers = cells.plain_numbers(index)
    is_measured = np.isfinite(numbers)
    if len(np.unique(numbers[is_measured])) <= _MOST_LABELS or np.all(np.diff(numbers) == 1.0):
        return False
    missing = np.flatnonzero(~is_measured).tolist()
    texts = cells.text(index) if missing else []
    return all(texts[k].lower() in ABSENT for k in missing)


def without_codes(
    cells: TableCells, columns: Mapping[str, FloatArray], factors: Mapping[str, float]
) -> dict[str, FloatArray]:
    """Columns (rows,) in SI with NaN in place of numbers such as -999, which stand for what was not
    measured; each is a fault (`placeholder`). `factors` are those to SI.
    """
    plain = {}
    for name, column in columns.items():
        plain[name] = column
        factor = factors.get(name, 1.0) * cells.factor
        sizes = np.abs(column)
        largest = np.nanmax(sizes, initial=0.0)
        if not np.isclose(largest, np.multiply(_CODES, factor), rtol=1e-9).any():
            continue
        is_code = np.isclose(sizes, largest, rtol=1e-9)
        others = sizes[~is_code & np.isfinite(sizes)]
        repeats = np.count_nonzero(is_code) > 1 and np.all(column[is_code] < 0.0)
        far = _FAR_REPEATED if repeats else _FAR
        if not others.size or largest <= far * others.max():
            continue
        for row in np.flatnonzero(is_code).tolist():
            words = (
                f"read {column[row] / factor:g}, as programs write for what was not measured; "
                "expected an empty cell"
            )
            cells.fault("placeholder", words, name, row)
        plain[name] = np.where(is_code, np.nan, column)
    return plain


def note_zeros(cells: TableCells, columns: Mapping[str, FloatArray], ball: Ball) -> None:
    """Note cells of exactly 0 where the rebound cannot be, so that 0 may mean that nothing was
    measured. `columns` (rows,) are in SI.
    """
    before = velocity({k: columns[k] for k in columns if k in _INCIDENT}, "1")
    after = velocity({k: columns[k] for k in columns if k in _REBOUND}, "2")
    doubted = {}
    if "v_x1" in before:
        is_dropped = np.abs(before["v_x1"]) < _DROPPED * np.abs(before.get("v_y1", np.inf))
        for name in ("v_x2", "omega_2", "gap_path"):
            if name in columns:
                doubted[name] = _zeros_far_from_others(columns[name]) & ~is_dropped
        if "v_x2" in after and not doubted.get("v_x2", np.zeros(1)).any():
            gain = (before["v_x1"] - after["v_x2"]) / (ball.inertia_ratio * ball.radius)
            doubted |= _doubted_spins(columns, gain)
    for name, is_doubted in doubted.items():
        rows = np.flatnonzero(is_doubted)
        if rows.size < max(1, min(_LEAST_ZEROS, len(is_doubted))):
            continue
        where = f"rows {listed(cells.rows[rows].astype(str))}"
        remedy = "leave the cells empty"
        if len(rows) == len(is_doubted):
            where = "every row"
            remedy = f"leave the column out (--ignore {name})"
        words = f"{name} is 0 in {where}: if that means not measured, {remedy}"
        cells.note("zeros", words)


_INCIDENT = ("v_x1", "v_y1", "v_1", "theta_1")
_REBOUND = ("v_x2", "v_y2", "v_2", "theta_2")


def _zeros_far_from_others(column: FloatArray) -> BoolArray:
    """Cells (rows,) of exactly 0 in a column whose other numbers are all far from it."""
    sizes = np.abs(column[np.isfinite(column) & (column != 0.0)])
    is_far = sizes.size > 0 and sizes.min() > _FAR_SHARE * np.median(sizes)
    return np.asarray((column == 0.0) & is_far)


def _doubted_spins(
    columns: Mapping[str, FloatArray], gain: Annotated[FloatArray, "rows"]
) -> dict[str, Annotated[BoolArray, "rows"]]:
    """By column of spins the cells of exactly 0 that the `gain` of spin [rad/s] contradicts."""
    after = columns.get("omega_2")
    if after is None or not np.isfinite(gain).any():
        return {}
    before = columns.get("omega_1", np.zeros_like(gain))
    left = np.abs(after - before - gain)
    is_zero_before = before == 0.0
    is_zero_after = after == 0.0
    complete = left[np.isfinite(left) & ~is_zero_after & ~is_zero_before]
    usual = left[np.isfinite(left) & ~is_zero_after]
    compared = complete if complete.size else usual
    limit = _FAR_SHARE * float(np.nanmedian(np.abs(gain)))
    if compared.size:
        usual_limit = _FAR_RESIDUALS * float(np.median(compared))
        most = _FAR_FROM_MOST * float(compared.max())
        limit = max(limit, min(usual_limit, most))
    doubted = {"omega_2": is_zero_after & (left > limit)}
    if "omega_1" in columns:
        doubted["omega_1"] = is_zero_before & ~is_zero_after & (left > limit)
        lost = is_zero_before & doubted["omega_2"] & _zeros_far_from_others(before)
        doubted["omega_1"] |= lost
    return doubted
