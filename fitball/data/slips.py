"""Decimal points that seem to have slipped: a number a tenth or a hundredfold of all others."""

from __future__ import annotations

import numpy as np

from fitball.base.text import listed
from fitball.data.cells import TableCells
from fitball.data.checks import Units, in_unit_of_file
from fitball.data.kinematics import Columns

# Columns whose numbers are of one size where rows repeat an impact: none crosses zero.
_OF_ONE_SIZE = (
    "v_1",
    "v_y1",
    "theta_1",
    "v_2",
    "v_y2",
    "theta_2",
    "drop_height",
    "rebound_height",
    "flight_time_1",
    "flight_time_2",
    "cor",
    "height_ratio",
    "contact_time",
)
# Rows beside which a number may be judged.
_LEAST_OTHERS = 4
# Numbers that are farther than this factor from the median are others.
_NEAR = 1.6
# Most rows that are, as a share: more are impacts of another kind.
_MOST_SLIPS = 0.05
# Factor by which a number with its point mended may lie beyond the others.
_BEYOND = 1.15
# Rows that a note names.
_NAMED_ROWS = 6
# What a number is of the right one.
_SLIPS = {
    0.001: "a thousandth of",
    0.01: "a hundredth of",
    0.1: "a tenth of",
    10.0: "ten times",
    100.0: "a hundred times",
    1000.0: "a thousand times",
}


def slips_by_row(own: Columns, units: Units) -> dict[int, dict[str, str]]:
    """By index of a row and column of the file what a number is beside those of the other rows,
    where its decimal point seems to have slipped. `own` are columns (rows,) in SI.
    """
    slips: dict[int, dict[str, str]] = {}
    for name in _OF_ONE_SIZE:
        if name not in own:
            continue
        values = np.abs(own[name])
        known = values[np.isfinite(values) & (values > 0.0)]
        if known.size <= _LEAST_OTHERS:
            continue
        median = float(np.median(known))
        others = known[(known < _NEAR * median) & (known > median / _NEAR)]
        if known.size - others.size > max(1.0, _MOST_SLIPS * known.size):
            continue
        low = float(others.min()) / _BEYOND
        high = float(others.max()) * _BEYOND
        usual = in_unit_of_file(name, median, units)
        for share, words in _SLIPS.items():
            for row in np.flatnonzero((values >= share * low) & (values <= share * high)).tolist():
                read = in_unit_of_file(name, float(own[name][row]), units)
                slips.setdefault(row, {})[name] = f"read {read}, {words} the usual {usual}"
    return slips


def note_slips(cells: TableCells, own: Columns, units: Units) -> None:
    """Note numbers whose decimal point seems to have slipped."""
    words = list[str]()
    for row, slips in slips_by_row(own, units).items():
        number = int(cells.rows[row])
        words += [f"row {number}, {name}: {text}" for name, text in slips.items()]
    if words:
        cells.note("slip", f"{listed(words, most=_NAMED_ROWS)}. Correct what was mistyped")
