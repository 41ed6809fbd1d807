"""Signs and zeros of angles: what is flipped, or counted the other way throughout."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitball.base.columns import COLUMNS
from fitball.base.errors import ParameterError, suggestion
from fitball.base.text import listed
from fitball.base.values import FloatArray, IntArray
from fitball.data.cells import TableCells
from fitball.data.checks import Units, in_unit_of_file
from fitball.data.kinematics import Columns, counting_columns, velocity

# Columns that tables which count along a fixed axis have all negative.
_EQUAL_SIGNS = ("v_y2", "theta_1", "theta_2")
# Columns of the spin, whose sign depends on where v_x points.
_SPINS = ("omega_1", "omega_2", "gap_turn")
# Share of the speed by which v_x1 may be negative of a ball that was dropped.
_DROPPED_SHARE = 0.05
# Sds of the stated error by which it may.
_MOST_SDS = 3.0
# Rows that a note names.
_NAMED_ROWS = 12


def counted_as_ours(
    cells: TableCells,
    columns: Columns,
    flip: Sequence[str],
    units: Units,
) -> tuple[dict[str, FloatArray], dict[str, float]]:
    """The columns counted as fitball counts, and -1 for each whose errors changed their sign.
    Raises ParameterError (`unknown-column`).
    """
    flipped = dict(columns)
    signs = dict[str, float]()
    can_flip = [name for name in columns if name in COLUMNS and COLUMNS[name].opposite]
    for name in flip:
        if name not in can_flip:
            hint = suggestion(name, can_flip)
            words = f"flip: {cells.source} has no column '{name}' to flip; {hint}"
            raise ParameterError(words, "unknown-column")
        opposite = COLUMNS[name].opposite
        flipped[name] = -columns[name]
        signs[name] = -1.0
        if opposite == "from the normal":
            # The sign says the direction of travel, or which way angles are counted.
            sign = _sign_of_most(cells, name, columns[name])
            flipped[name] = np.pi / 2.0 - sign * columns[name]
            signs[name] = -sign
        cells.note("flipped", f"{name} is read {opposite}, as requested")
    turned = _equal_signs(cells, flipped, units)
    for name in columns:
        if turned[name] is not flipped[name]:
            signs[name] = -signs.get(name, 1.0)
    return turned, signs


def _equal_signs(cells: TableCells, numbers: Columns, units: Units) -> dict[str, FloatArray]:
    """The numbers with v_y2 and angles counted positive: turned where they are negative throughout;
    faults of the rows whose sign is that of fewer.
    """
    turned = dict(numbers)
    for name in _EQUAL_SIGNS:
        if name not in numbers or not (numbers[name] < 0.0).any():
            continue
        negative = numbers[name] < 0.0
        positive = numbers[name] > 0.0
        turned[name] = np.abs(numbers[name])
        if not positive.any():
            cells.note("turned", f"{name} is negative in every row: its sign was changed")
            continue
        odd = positive
        others = "negative"
        if negative.sum() <= positive.sum():
            odd = negative
            others = "positive"
        for k in np.flatnonzero(odd).tolist():
            read = f"read {in_unit_of_file(name, float(numbers[name][k]), units)}"
            words = f"{read}, but most rows are {others}; expected one sign in all rows"
            cells.fault("mixed-signs", words, name, k)
    return turned


def _sign_of_most(cells: TableCells, name: str, angles: FloatArray) -> float:
    """-1 where most of the angles from the normal (rows,) are negative, which is noted, else 1."""
    negative = int((angles < 0.0).sum())
    if negative <= int((angles > 0.0).sum()):
        return 1.0
    which = "every row" if not (angles > 0.0).any() else "most rows"
    words = f"{name} is negative in {which}: its sign was changed before it is read from the normal"
    cells.note("turned", words)
    return -1.0


def note_backwards(cells: TableCells, columns: Columns, rows: IntArray) -> None:
    """Note which of the `rows` with spins have a ball that flies towards negative v_x: its topspin
    is negative.
    """
    before = velocity({name: columns[name] for name in counting_columns(columns, "1")}, "1")
    if "v_x1" not in before or columns.keys().isdisjoint(_SPINS):
        return
    v_x = before["v_x1"][rows]
    error = np.nan_to_num(np.asarray(columns.get("v_x1_sd", np.zeros(len(cells.rows)))))[rows]
    noise = np.maximum(_MOST_SDS * error, _DROPPED_SHARE * before["v_1"][rows])
    flying = np.flatnonzero(v_x < -noise)
    if not flying.size:
        return
    where = "every row"
    if len(flying) < len(rows):
        word = "row" if flying.size == 1 else "rows"
        where = f"{word} {listed(cells.rows[rows[flying]].astype(str), most=_NAMED_ROWS)}"
    words = f"balls fly towards negative v_x in {where}: their topspin is read as negative"
    cells.note("backwards", words)


def flip_option(flip: Sequence[str], turned: Sequence[str]) -> str:
    """What to do so that `turned` columns are counted the other way beside those in `flip`."""
    names = [name for name in flip if name not in turned]
    names += [name for name in turned if name not in flip]
    if not names:
        return "leave out --flip"
    return f"pass --flip {','.join(names)}"
