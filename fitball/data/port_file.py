"""Rebounds that another program computed, read from a CSV file as they stand: units convert, nothing is mended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fitball.data.columns import INCIDENT, REBOUND, Header, read_header, vocabulary
from fitball.data.dialect.cells import RawTable
from fitball.data.dialect.files import read_raw
from fitball.data.findings import Findings
from fitball.data.naming import Naming
from fitball.data.number_column import read_column
from fitball.values import FloatArray

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
    found = Findings.of(raw)
    header = read_header(raw.header, found)
    if not raw.rows and not found.faults:
        found.fault("read a header and no rows; expected one row for each golden impact")
    present = [name for name in (*INCIDENT, *REBOUND) if name in header.numbers and not _empty(header, raw, name)]
    if not any(name in REBOUND for name in present):
        found.header_fault(f"no column of a rebound; expected one or more of {', '.join(REBOUND)}")
    columns = {name: read_column(header.numbers[name], found).values for name in present}
    found.refuse(str(path))
    return PortFile(
        source=str(path),
        count=len(raw.rows),
        incident={name: values for name, values in columns.items() if name in INCIDENT},
        outputs={name: values for name, values in columns.items() if name in REBOUND},
        ids=header.cells("id", raw.rows) if "id" in header.texts else None,
        regimes=header.cells("regime", raw.rows) if "regime" in header.texts else None,
    )


def _empty(header: Header, raw: RawTable, name: str) -> bool:
    index = header.numbers[name].index
    return all(row.cells[index].lower() in _EMPTY for row in raw.rows)
