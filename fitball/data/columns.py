"""What the columns of a table may be called, and what a given header means."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches

from fitball.data.units import UNITS, Dimension, Unit, parse_unit
from fitball.errors import Fault, UnitError
from fitball.observables import OBSERVABLES

INCIDENT: Mapping[str, Dimension] = {
    "v_x1": Dimension.SPEED,
    "v_y1": Dimension.SPEED,
    "v_1": Dimension.SPEED,
    "theta_1": Dimension.ANGLE,
    "omega_1": Dimension.SPIN,
}
REBOUND: Mapping[str, Dimension] = {name: UNITS[item.unit].dimension for name, item in OBSERVABLES.items()}
MEASURED: Mapping[str, Dimension] = {**INCIDENT, **REBOUND}
LABELS = ("id", "surface", "ball", "group", "location")
SD_SUFFIX = "_sd"
NUMBERS: Mapping[str, Dimension] = {**MEASURED, **{name + SD_SUFFIX: MEASURED[name] for name in MEASURED}}

_HEADER = re.compile(r"^(?P<name>[^\[\]]*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?$")
# High enough to pass over words that only share a few letters ("case", "temperature"), low enough
# to catch one wrong, missing or swapped character in names as short as "v_y1" (difflib ratio 0.75 and up).
_NEAR = 0.75


@dataclass(frozen=True)
class Column:
    """One column: its place in the file, its `name`, its `unit` (None for text, or when not understood)."""

    index: int
    name: str
    unit: Unit | None


@dataclass(frozen=True)
class Header:
    """The columns of a table: `numbers` by name, and `texts` (labels and ignored extras) by name."""

    numbers: Mapping[str, Column]
    texts: Mapping[str, Column]
    extras: tuple[str, ...]


def _bare(name: str) -> str:
    """A name without case, spaces and signs: two names with the same bare form are one name misspelt."""
    return re.sub(r"[^a-z0-9]", "", name.lower())


def _nearest(name: str, taken: Iterable[str]) -> str | None:
    """The known name that `name` misspells, or None when it is a name of its own.

    A name that differs only in case or signs is always a misspelling; one that merely evidence similar is
    one only while the name it resembles is absent, since `theta_3` beside `theta_1` is a column of its own.
    """
    known = [*NUMBERS, *LABELS]
    same = [item for item in known if _bare(item) == _bare(name)]
    if same:
        return same[0]
    free = [item for item in NUMBERS if item not in set(taken)]
    near = get_close_matches(name.lower(), free, n=1, cutoff=_NEAR)
    return near[0] if near else None


def read_header(cells: tuple[str, ...], line: int | None, faults: list[Fault]) -> Header:
    """Find out what each column is; faults of the header are added to `faults`.

    A misspelt column is a fault and is then read as the column it resembles, so that the faults of its
    values come out in the same run.
    """
    parsed = [split_cell(cell, line, faults) for cell in cells]
    exact = {name for name, _ in parsed}
    numbers: dict[str, Column] = {}
    texts: dict[str, Column] = {}
    extras: list[str] = []
    for index, (name, unit_text) in enumerate(parsed):
        if not name:
            extras.append(f"(column {index + 1}, without a name)")
            continue
        meant = name
        if name not in NUMBERS and name not in LABELS:
            near = _explain_unknown(name, exact | set(numbers), line, faults)
            meant = near or name
            if near is None:
                extras.append(name)
        if meant in numbers or meant in texts:
            message = f"read '{cells[index]}', but another column is '{meant}' already; keep one of them"
            faults.append(Fault(message, line=line, column=meant))
        elif meant in NUMBERS:
            numbers[meant] = Column(index, meant, _unit(meant, unit_text, line, faults))
        else:
            texts[meant] = Column(index, meant, None)
    return Header(numbers, texts, tuple(extras))


def split_cell(cell: str, line: int | None, faults: list[Fault]) -> tuple[str, str | None]:
    """Name and unit (None without brackets) of a header cell."""
    match = _HEADER.match(cell.strip())
    if match is None:
        message = "the brackets do not match; expected a name and a unit, such as 'v_x1 [m/s]'"
        faults.append(Fault(message, line=line, column=cell))
        return cell.split("[")[0].strip(), None
    name = match["name"].strip()
    round_bracket = re.match(r"^(.*?)\s*\(([^()]*)\)$", name)
    if round_bracket and round_bracket[1] in NUMBERS:
        message = f"units stand in square brackets; write '{round_bracket[1]} [{round_bracket[2]}]'"
        faults.append(Fault(message, line=line, column=cell))
        return round_bracket[1], round_bracket[2]
    return name, match["unit"]


def _unit(name: str, text: str | None, line: int | None, faults: list[Fault]) -> Unit | None:
    try:
        return parse_unit(text, NUMBERS[name])
    except UnitError as error:
        faults.append(Fault(str(error), line=line, column=name))
        return None


def _explain_unknown(name: str, taken: set[str], line: int | None, faults: list[Fault]) -> str | None:
    """The known column that an unknown name stands for; None for a column of the user's own."""
    near = _nearest(name, taken)
    if near is not None:
        message = f"unknown column; did you mean '{near}'? Rename it (a column of your own needs another name)"
        faults.append(Fault(message, line=line, column=name))
    elif name.endswith(SD_SUFFIX):
        message = (
            f"'{name.removesuffix(SD_SUFFIX)}' is no column that can have a standard deviation; "
            f"known: {', '.join(MEASURED)}"
        )
        faults.append(Fault(message, line=line, column=name))
    return near
