"""From cells as text to arrays in SI, with the half-width that the printed digits leave open; which rows are impacts,
and what these are called.

Numbers are read as people write them: decimal commas, printed minus signs, `21.0 ± 0.2`. What may be meant in two
ways is left as it is and refused, as is a number that no impact of a ball has. A gap in a rebound column (a cell that
says that nothing was measured) is no fault: the rest of its row counts. A row of which the incident state is not
known, or nothing of the rebound, is left out, and a column without a single number is taken as not there.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import chain
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from fitball.data.cells import FORMULA_ERROR, Findings, Texts
from fitball.data.columns import NUMBERS, REBOUND, SD_SUFFIX, limit_of
from fitball.data.kinematics import Uncertain, independent, velocity
from fitball.data.table import summed_up
from fitball.data.units import DEFAULT_UNIT, UNITS, Unit, symbols
from fitball.errors import ParameterError
from fitball.observables import OBSERVABLES, VELOCITIES
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

Cells = Mapping[str, Texts]


def plain_numbers(columns: Cells) -> tuple[Cells, tuple[str, ...]]:
    """Columns of numbers with decimal points and hyphens in their cells, and notes on what was changed.

    A file has one decimal sign: commas are one where no number has a point, and at least one comma cannot stand
    between thousands.
    """
    notes: tuple[str, ...] = ()
    if not any(_any_of(_SIGNS, cells) for cells in columns.values()):
        return columns, notes
    if any(map(_MINUS.search, chain(*columns.values()))):
        notes = ("printed minus signs (\u2212, –) were read as such",)
        columns = {name: tuple(_MINUS.sub("-", cell) for cell in cells) for name, cells in columns.items()}
    parts = [part for cells in columns.values() for cell in cells for part in _parts(cell)]
    commas = [part for part in parts if _COMMA.fullmatch(part)]
    if not commas or all(map(_THOUSANDS.fullmatch, commas)) or any(map(_POINT.fullmatch, parts)):
        return columns, notes
    return {name: tuple(map(_with_point, cells)) for name, cells in columns.items()}, (
        *notes,
        "numbers have decimal commas",
    )


def _any_of(signs: str, cells: Texts) -> bool:
    """Whether any of the signs is in any cell; the cells are searched as one text, since they may be millions."""
    text = "\n".join(cells)
    return any(sign in text for sign in signs)


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


def split_deviations(cells: Texts) -> tuple[Texts, Texts | None]:
    """The cells of a column with each `value ± sd` as its value, and the sds, "" where a cell has none; None where no
    cell has.
    """
    pairs = list(map(_pair, cells)) if _any_of(_DEVIATION_SIGNS, cells) else []
    if not any(pairs):
        return cells, None
    values = tuple(cell if pair is None else pair["value"] for cell, pair in zip(cells, pairs, strict=True))
    return values, tuple("" if pair is None else pair["sd"] for pair in pairs)


def explained(cell: str) -> str | None:
    """Why the number of a cell is open, and what to write; None where it is something else than a number."""
    if _THOUSANDS.fullmatch(cell):
        return (
            f"read '{cell}', which may be {cell.replace(',', '.')} or {cell.replace(',', '')}; expected a decimal "
            "point and no separator of thousands"
        )
    if _COMMA.fullmatch(cell):
        return (
            f"read '{cell}' with a decimal comma, but other numbers have points; expected one decimal sign: write "
            f"'{cell.replace(',', '.')}'"
        )
    if _GROUPED.fullmatch(cell):
        return f"read '{cell}' with separators of thousands; expected a decimal point and no other sign"
    return None


# Stricter than float(): no "1_000", no "nan" or "inf", no digits of other scripts.
_NUMBER = re.compile(r"[+-]?([0-9]+(?:\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]{1,3})?")
# `#N/A` and `#NV` are how Excel shows what is not available.
# What begins the notice of a row that is no impact.
IGNORED = "ignored, since"
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

    def text(self, place: int) -> str:
        """The number at a place as the file would print it."""
        return self.printed(float(self.values[place]))

    def printed(self, value: float) -> str:
        """An SI value as the file would print it, shorter where that takes more digits than a number has."""
        number = self.unit.from_si(float(value))
        if abs(number) >= 10.0**DIGITS or self.decimals > DIGITS:
            return f"{number:.6g} {self.unit.symbol}"
        return f"{number:.{self.decimals}f} {self.unit.symbol}"


Columns = Mapping[str, NumberColumn]


def read_column(name: str, unit: Unit | None, cells: Texts, found: Findings, *, gaps: bool = False) -> NumberColumn:
    """The numbers of one column; all NaN when its unit was not understood (that fault is reported already),
    so that no later check draws conclusions from them.

    The half-width follows from the cell printed to most decimals, because spreadsheets drop trailing
    zeros: a `6` between `6.47` and `7.25` was measured as 6.00. With `gaps` a cell that says that nothing was
    measured (empty, `nan`, `NA`, `-`) is no fault.
    """
    missing = np.array([gaps and absent(cell) for cell in cells], dtype=np.bool_)
    numbers = [
        None if gap else _read_cell(cell, k, name, found, gaps)
        for k, (cell, gap) in enumerate(zip(cells, missing.tolist(), strict=True))
    ]
    known = unit or DEFAULT_UNIT[NUMBERS[name]]
    exponent = min((number[1] for number in numbers if number is not None), default=0)
    trusted = [float("nan") if item is None or unit is None else item[0] for item in numbers]
    with np.errstate(over="ignore"):
        values = known.to_si(np.array(trusted, dtype=np.float64))
    for k in np.flatnonzero(np.isinf(values)).tolist():
        found.fault(f"read '{cells[k]}', which is not finite in SI units; expected a number", name, k)
    values = np.where(np.isinf(values), np.nan, values)
    return NumberColumn(name, values, known.to_si(0.5 * 10.0**exponent), known, max(0, -exponent), missing)


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
        return f"read {repr(text) if text else 'an empty cell'}; expected {what}: add it, or delete the row"
    if lower.lstrip("+-") in _INFINITE or _NUMBER.fullmatch(text):
        return f"read '{text}', which is not finite; expected {what}"
    open_number = explained(text)
    if open_number is not None:
        return open_number
    empty = "leave the cell empty if nothing was measured" if gaps else "add it, or delete the row"
    if FORMULA_ERROR.match(text):
        return f"read '{text}', a formula error of a spreadsheet; expected {what}: correct the formula, or {empty}"
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


def within_limits(columns: Columns, found: Findings) -> Columns:
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
            read = f"read {column.text(k)}; expected {limit_of(name).words}"
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


def without_empty(columns: Columns, found: Findings) -> Columns:
    """The columns that hold at least one number, or something that was meant as one; a notice for each other."""
    empty = [name for name, column in columns.items() if column.missing.size and column.missing.all()]
    for name in empty:
        found.notice(f"column {name} has no numbers and is ignored", name)
    gone = {*empty, *(name + SD_SUFFIX for name in empty)}
    return {name: column for name, column in columns.items() if name not in gone}


def without_gaps(columns: Columns, rebound: bool, least: int, found: Findings) -> tuple[Columns, NDArray[np.int64]]:
    """The columns of the impacts that can be used, and the places of these among the rows.

    Velocity cells that are missing are taken from speed and angle where their row has both. An impact without an
    incident state, or, with `rebound`, without any rebound is left out. It is a fault if fewer than `least` stay, or
    if a number has no sd although its column has them.
    """
    count = len(found.rows)
    if not any(column.missing.any() for column in columns.values()):
        return columns, np.arange(count)
    told = _with_sds(_filled(_filled(columns, "1", found), "2", found), found)
    before = len(found.notices)
    kept = _usable(told, rebound, found)
    if len(kept) < least <= count:
        lost = summed_up(found.notices[before:])
        found.fault(f"{len(kept)} of {count} rows are left; expected {least}: {'; '.join(lost)}")
        return told, np.arange(count)
    left = without_empty({name: column.take(kept) for name, column in told.items()}, found)
    for name, column in left.items():
        gaps = np.flatnonzero(column.missing)
        if name in REBOUND and gaps.size:
            first = found.rows.numbers[kept[gaps[0]]]
            found.notice(
                f"{name} is missing in {gaps.size} of {len(kept)} rows, first in row {first}; their other "
                "measurements are used",
                name,
            )
    return left, kept


def _filled(columns: Columns, end: str, found: Findings) -> Columns:
    """Missing velocity components of `end` ("1" or "2") from speed and angle of the same row.

    Only where all four are columns: then components count, and speed and angle repeat them. A component with a stated
    sd is filled where its sd follows too.
    """
    filled = dict(columns)
    components, polar = (f"v_x{end}", f"v_y{end}"), (f"v_{end}", f"theta_{end}")
    if not columns.keys() >= {*components, *polar}:
        return filled
    stated = {
        name: columns[name + SD_SUFFIX].values if name + SD_SUFFIX in columns else np.full(len(found.rows), np.nan)
        for name in polar
    }
    other = velocity({name: Uncertain.measured(name, columns[name].values, stated[name]) for name in polar}, end)
    for name, said in zip(components, (other.x, other.y), strict=True):
        assert said is not None
        sd = columns.get(name + SD_SUFFIX)
        open_cells = columns[name].missing & np.isfinite(said.value)
        if sd is not None:
            open_cells &= np.isfinite(said.sd)
            filled[sd.name] = _put(sd, open_cells, said.sd)
        filled[name] = _put(columns[name], open_cells, said.value)
        kind = f"{name} is missing and computed from {' and '.join(polar)}"
        for k in np.flatnonzero(open_cells).tolist():
            found.notice(kind, name, *polar, place=k, kind=kind)
    return filled


def _put(column: NumberColumn, where: NDArray[np.bool_], values: NDArray[np.float64]) -> NumberColumn:
    return replace(column, values=np.where(where, values, column.values), missing=column.missing & ~where)


def _with_sds(columns: Columns, found: Findings) -> Columns:
    """The columns, no sd where there is no number; a fault for each number without its sd."""
    told = dict(columns)
    for name, column in columns.items():
        sd = columns.get(name + SD_SUFFIX)
        if sd is None:
            continue
        for k in np.flatnonzero(sd.missing & ~column.missing).tolist():
            found.fault(
                f"no standard deviation for {name} = {column.text(k)}; expected one in every row with {name}: add "
                f"it, or delete the column {sd.name} (the noise of {name} is then fitted)",
                sd.name, k,
            )  # fmt: skip
        told[sd.name] = replace(sd, values=np.where(column.missing, np.nan, sd.values))
    return told


def _usable(columns: Columns, rebound: bool, found: Findings) -> NDArray[np.int64]:
    """Places of the rows that are impacts with a known incident state and, with `rebound`, a measured one; a notice
    for each other row.
    """
    nowhere = np.zeros(len(found.rows), dtype=np.bool_)
    incident = [name for name in (*independent(columns, "1"), "omega_1") if name in columns]
    counted = [*independent(columns, "2"), *(name for name in OBSERVABLES if name not in VELOCITIES)]
    after = [columns[name].missing for name in counted if name in columns]
    unknown = np.any([columns[name].missing for name in incident], axis=0) if incident else nowhere
    nothing = np.all(after, axis=0) if rebound and after else nowhere
    for k in np.flatnonzero(unknown | nothing).tolist():
        gaps = [name for name in incident if columns[name].missing[k]]
        what = f"{' and '.join(gaps)} of the incident ball" if gaps else "the rebound"
        kind = f"{IGNORED} {what} was not measured"
        found.notice(kind, *gaps, place=k, kind=kind)
    return np.flatnonzero(~(unknown | nothing))


def unique_ids(written: Texts | None, found: Findings) -> tuple[str, ...]:
    """One name an impact, its number where there is no column of ids; a notice for each that was empty or stood
    already.
    """
    if written is None:
        return tuple(map(str, found.rows.numbers))
    taken, ids, seen = set(written), list[str](), Counter[str]()
    for place, text in enumerate(written):
        name, kind = text, ""
        if not text:
            kind = "id is empty; the number of the row is used"
            name = _free(f"row {found.rows.numbers[place]}", 0, taken)
        elif seen[text]:
            kind = "id is repeated and was made unique"
            name = _free(text, seen[text], taken)
        if kind:
            found.notice(f"{kind}: '{name}'", "id", place=place, kind=kind)
        seen[text] += 1
        taken.add(name)
        ids.append(name)
    return tuple(ids)


def repeated(name: str, k: int = 2) -> str:
    """The name of the `k`-th impact that is called `name`."""
    return f"{name} ({k})"


def _free(name: str, count: int, taken: set[str]) -> str:
    """`name`, or the first `name (2)`, `name (3)`, ... that is not taken; `count` impacts have the name already."""
    if name not in taken:
        return name
    k = count + 1
    while repeated(name, k) in taken:
        k += 1
    return repeated(name, k)
