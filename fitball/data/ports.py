"""Rebounds that another program computed, read unchanged, but for their units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fitball.data.cells import Findings
from fitball.data.columns import INCIDENT, REBOUND
from fitball.data.header import Naming, read_header, vocabulary
from fitball.data.numbers import read_column
from fitball.data.text import read_raw
from fitball.values import FloatArray
from fitball.visible import unguarded

# What a program writes for an output it does not have.
_EMPTY = ("", "nan", "none", "null", "-", "na", "n/a")


@dataclass(frozen=True)
class PortFile:
    """Columns in SI by name, each (rows,): incident ones repeated in the file, and outputs.

    `ids` and `regimes` are the texts of columns `id` and `regime`, None where there are none.
    """

    source: str
    count: int
    incident: Mapping[str, FloatArray]
    outputs: Mapping[str, FloatArray]
    ids: tuple[str, ...] | None
    regimes: tuple[str, ...] | None


def read_port(path: Path) -> PortFile:
    """Read the outputs of a port. Raises TableError with every fault: row, column, what was read and expected."""
    raw = read_raw(path, vocabulary(Naming()))
    found = Findings.from_raw(raw)
    header = read_header(raw.header, found)
    if not raw.rows and not found.faults:
        found.fault("no rows after the header; expected one row for each golden impact")
    cells = {name: raw.columns[place] for name, place in header.places.items()}
    names = [name for name in (*INCIDENT, *REBOUND) if name in header.units]
    present = [name for name in names if not all(cell.lower() in _EMPTY for cell in cells[name])]
    if not any(name in REBOUND for name in present):
        found.header_fault(f"no rebound column; expected at least one of {', '.join(REBOUND)}")
    columns = {name: read_column(name, header.units[name], cells[name], found).values for name in present}
    found.refuse(str(path))
    return PortFile(
        source=str(path),
        count=len(raw.rows),
        incident={name: values for name, values in columns.items() if name in INCIDENT},
        outputs={name: values for name, values in columns.items() if name in REBOUND},
        ids=unguarded(cells["id"]) if "id" in cells else None,
        regimes=unguarded(cells["regime"]) if "regime" in cells else None,
    )
