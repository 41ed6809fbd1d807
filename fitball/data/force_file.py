"""Reading force-time records: many samples an impact, in a file beside the impact table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from hashlib import sha256
from itertools import groupby
from pathlib import Path

import numpy as np

from fitball.data.columns import Column, is_unit, split_cell
from fitball.data.dialect.cells import RawRow, RawTable, Vocabulary
from fitball.data.dialect.files import read_raw
from fitball.data.dialect.numbers import plain_numbers
from fitball.data.ids import repeated
from fitball.data.number_column import NumberColumn, read_column
from fitball.data.table import ImpactTable
from fitball.data.units import DEFAULT_UNIT, Dimension, parse_unit
from fitball.errors import Fault, TableError, UnitError, suggestion
from fitball.values import FloatArray

DIMENSIONS: Mapping[str, Dimension] = {"t": Dimension.TIME, "F": Dimension.FORCE}
EXPECTED = "expected columns id, t and F, such as 'id,t [ms],F [N]'"
# What else people call these columns.
MISNAMED = {"f": "F", "force": "F", "load": "F", "time": "t", "T": "t", "impact": "id", "ID": "id", "Id": "id"}
# Share of its peak from which a force belongs to the contact.
PULSE = 0.05
# Samples within the contact below which a mean force between samples is no longer the force at them to 1 %.
LEAST_SAMPLES = 12
# Share of its peak at which a record may begin or end: further up, landing or release was cut off.
CUT = 0.2
# A ball on a court or a racket stays some milliseconds; outside of this the unit of time is wrong.
SHORTEST, LONGEST = 2.0e-4, 5.0e-2


@dataclass(frozen=True)
class ForceRecord:
    """The force on the court during one impact: evenly spaced times from `begin` every `step` [s], and `force`
    (samples,) [N], positive in compression. `row` is the impact's place in the table.
    """

    id: str
    row: int
    begin: float
    step: float
    force: FloatArray

    @property
    def times(self) -> FloatArray:
        """Times of the samples (samples,) [s]."""
        return np.asarray(self.begin + self.step * np.arange(self.force.size, dtype=np.float64))

    @property
    def pulse(self) -> tuple[int, int]:
        """First and last sample around the peak that belong to the contact."""
        return _pulse(self.force)


@dataclass(frozen=True)
class ForceFile:
    """Force records as read, in the order of the table; `digest` is the SHA-256 of the file's bytes."""

    source: str
    digest: str
    records: tuple[ForceRecord, ...]


def load_force(path: Path, table: ImpactTable) -> ForceFile:
    """Read the force records of a table's impacts from a CSV or Parquet file with columns id, t, F.

    Units stand in the header (s and N without). Raises TableError with every fault: row, line, column, what was read
    and what was expected.
    """
    raw = read_raw(path, Vocabulary(lambda cell: float(_name(cell) in ("id", *DIMENSIONS, *MISNAMED)), is_unit))
    faults = list(raw.faults)
    header = _header(raw, faults)
    if header is None:
        raise TableError(str(path), faults)
    raw = replace(raw, rows=plain_numbers(raw.rows, [header[name].index for name in DIMENSIONS]))
    columns = {name: read_column(header[name], raw.rows, faults) for name in DIMENSIONS}
    if not raw.rows:
        faults.append(Fault("read a header and no rows; expected samples of force", line=raw.header_line))
    records = [] if faults else _records(raw, header["id"].index, columns, table, faults)
    if faults:
        raise TableError(str(path), sorted(faults, key=lambda fault: fault.row or 0))
    ordered = tuple(sorted(records, key=lambda record: record.row))
    return ForceFile(str(path), sha256(raw.data).hexdigest(), ordered)


def _name(cell: str) -> str:
    return split_cell(cell, None, [])[0]


def _header(raw: RawTable, faults: list[Fault]) -> dict[str, Column] | None:
    """The three columns; None, with a fault for each, when one is missing or its unit is not understood."""
    columns: dict[str, Column] = {}
    count = len(faults)
    for index, cell in enumerate(raw.header):
        name, unit = split_cell(cell, raw.header_line, faults)
        if name in columns:
            faults.append(Fault("another column has that name already; keep one", None, raw.header_line, name))
        elif name == "id":
            columns[name] = Column(index, name, None)
        elif name in DIMENSIONS:
            try:
                columns[name] = Column(index, name, parse_unit(unit, DIMENSIONS[name]))
            except UnitError as error:
                faults.append(Fault(str(error), line=raw.header_line, column=name))
                columns[name] = Column(index, name, DEFAULT_UNIT[DIMENSIONS[name]])
        elif name in MISNAMED:
            message = f"unknown column; did you mean '{MISNAMED[name]}'? Rename it"
            faults.append(Fault(message, line=raw.header_line, column=name))
    missing = [name for name in ("id", *DIMENSIONS) if name not in columns]
    faults += [Fault(f"there is no column '{name}'; {EXPECTED}", line=raw.header_line) for name in missing]
    return columns if len(faults) == count else None


def _records(
    raw: RawTable, id_column: int, columns: Mapping[str, NumberColumn], table: ImpactTable, faults: list[Fault]
) -> list[ForceRecord]:
    records: list[ForceRecord] = []
    begun: dict[str, int] = {}
    for name, group in groupby(range(len(raw.rows)), key=lambda k: raw.rows[k].cells[id_column]):
        places = list(group)
        head = raw.rows[places[0]]
        if name not in table.ids:
            hint = suggestion(name, table.ids) if len(table.ids) <= 40 or name else f"{len(table.ids)} are known"
            message = f"read '{name}', which is no impact of {table.source}; {hint}"
            faults.append(Fault(message, head.number, head.line, "id"))
        elif repeated(name) in table.ids:
            message = (
                f"read '{name}', which names several impacts of {table.source}; expected one name an impact there"
            )
            faults.append(Fault(message, head.number, head.line, "id"))
        elif name in begun:
            message = f"the record of '{name}' begins again; it stood at row {begun[name]}: expected one record an id"
            faults.append(Fault(message, head.number, head.line, "id"))
        else:
            record = _record(name, places, raw.rows, columns, table, faults)
            if record is not None:
                records.append(record)
        begun.setdefault(name, head.number)
    return records


def _record(
    name: str,
    places: list[int],
    rows: tuple[RawRow, ...],
    columns: Mapping[str, NumberColumn],
    table: ImpactTable,
    faults: list[Fault],
) -> ForceRecord | None:
    """One record, or None with a fault: the first of its times, else one of its forces."""
    times, forces = columns["t"].values[places], columns["F"].values[places]
    head = rows[places[0]]

    def fault(message: str, column: str, at: RawRow = head) -> None:
        faults.append(Fault(message, at.number, at.line, column))

    if len(places) < LEAST_SAMPLES:
        fault(f"the record of '{name}' has {len(places)} samples; expected at least {LEAST_SAMPLES}", "t")
        return None
    steps = np.diff(times)
    typical = float(np.median(steps))
    # Printed times are rounded: half a step either way is no gap yet.
    for wrong, words in (
        (steps <= 0.0, "expected times that increase"),
        ((steps < 0.5 * typical) | (steps > 1.5 * typical), "expected evenly spaced samples without a gap"),
    ):
        if np.any(wrong):
            k = int(np.argmax(wrong))
            shown = columns["t"].shown
            fault(
                f"read {shown(times[k + 1])} after {shown(times[k])} in the record of '{name}'; {words}",
                "t",
                rows[places[k + 1]],
            )
            return None
    problem = _force_fault(name, forces, (times[-1] - times[0]) / (len(places) - 1))
    if problem is not None:
        fault(problem[0], problem[1])
        return None
    step = float(times[-1] - times[0]) / (len(places) - 1)
    forces.setflags(write=False)
    return ForceRecord(name, table.ids.index(name), float(times[0]), step, forces)


def _force_fault(name: str, forces: FloatArray, step: float) -> tuple[str, str] | None:
    """What is wrong with the course of a force, and in which column."""
    peak = float(forces.max())
    if peak <= 0.0 or -float(forces.min()) > peak:
        return f"the record of '{name}' is mostly negative; expected F positive in compression: change its sign", "F"
    for end, word, sample in ((forces[0], "begins", "landing"), (forces[-1], "ends", "release")):
        if end > CUT * peak:
            return (
                f"the record of '{name}' {word} at {100.0 * float(end) / peak:.0f} % of its peak; expected samples "
                f"from before landing until after release (below {100.0 * CUT:.0f} %): the {sample} is cut off",
                "F",
            )
    first, last = _pulse(forces)
    if last - first + 1 < LEAST_SAMPLES:
        return (
            f"the record of '{name}' has {last - first + 1} samples above {100.0 * PULSE:.0f} % of its peak; "
            f"expected at least {LEAST_SAMPLES} during the contact: sample faster",
            "t",
        )
    length = (last - first) * step
    if not SHORTEST < length < LONGEST:
        return (
            f"the contact in the record of '{name}' lasts {1e3 * length:.3g} ms; expected "
            f"{1e3 * SHORTEST:g} to {1e3 * LONGEST:g} ms: check the unit of t (seconds without one: write 't [ms]')",
            "t",
        )
    return None


def _pulse(forces: FloatArray) -> tuple[int, int]:
    top = int(np.argmax(forces))
    low = forces < PULSE * forces[top]
    before, after = np.flatnonzero(low[:top]), np.flatnonzero(low[top:])
    return int(before[-1]) + 1 if before.size else 0, top + int(after[0]) - 1 if after.size else forces.size - 1
