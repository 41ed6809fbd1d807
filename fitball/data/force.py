"""Force-time records: many samples an impact, in a file that is named by the user, by the scene, or lies beside the
impact table.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from itertools import groupby
from pathlib import Path

import numpy as np

from fitball.data.bundled import FORCE_ENDING, PARQUET_SUFFIXES, resolve_table
from fitball.data.cells import Findings, RawTable, Texts, Vocabulary
from fitball.data.header import is_unit, split_cell
from fitball.data.numbers import NumberColumn, plain_numbers, read_column, repeated
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.data.text import read_raw
from fitball.data.units import Dimension, Unit, parse_unit
from fitball.errors import SceneError, TableError, UnitError, suggestion
from fitball.values import FloatArray
from fitball.wording import option

DIMENSIONS: Mapping[str, Dimension] = {"t": Dimension.TIME, "F": Dimension.FORCE}
LEFT_OUT = "none"
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

    Units are in the header (default: s and N). Raises TableError with every fault: row, line, column, what was read
    and what was expected.
    """
    raw = read_raw(path, Vocabulary(lambda cell: float(_name(cell) in ("id", *DIMENSIONS, *MISNAMED)), is_unit))
    found = Findings.from_raw(raw)
    places, units = _header(raw, found)
    if len(found.faults) > len(raw.faults):
        raise TableError(str(path), found.faults)
    cells, _notes = plain_numbers({name: raw.columns[places[name]] for name in DIMENSIONS})
    times, forces = (read_column(name, units[name], cells[name], found) for name in DIMENSIONS)
    if not raw.rows:
        found.header_fault("no rows after the header; expected samples of force")
    records = [] if found.faults else _records(raw.columns[places["id"]], times, forces, table, found)
    found.refuse(str(path))
    ordered = tuple(sorted(records, key=lambda record: record.row))
    return ForceFile(str(path), sha256(raw.data).hexdigest(), ordered)


def _name(cell: str) -> str:
    return split_cell(cell)[0]


def _header(raw: RawTable, found: Findings) -> tuple[dict[str, int], dict[str, Unit]]:
    """Places and units of the three columns; a fault for each that is missing or whose unit is not understood."""
    places, units = dict[str, int](), dict[str, Unit]()
    for index, cell in enumerate(raw.header):
        name, unit = split_cell(cell, found=found)
        if name in places:
            found.header_fault("two columns have this name; keep one", name)
        elif name == "id" or name in DIMENSIONS:
            places[name] = index
            if name in DIMENSIONS:
                try:
                    units[name] = parse_unit(unit, DIMENSIONS[name])
                except UnitError as error:
                    found.header_fault(str(error), name)
        elif name in MISNAMED:
            found.header_fault(f"unknown column; did you mean '{MISNAMED[name]}'? Rename it", name)
    for name in ("id", *DIMENSIONS):
        if name not in places:
            found.header_fault(f"column '{name}' is missing; {EXPECTED}")
    return places, units


def _records(
    ids: Texts, times: NumberColumn, forces: NumberColumn, table: ImpactTable, found: Findings
) -> list[ForceRecord]:
    records: list[ForceRecord] = []
    begun: dict[str, int] = {}
    for name, group in groupby(range(len(ids)), key=ids.__getitem__):
        places = list(group)
        head, read = places[0], f"read '{name}', which"
        if name not in table.ids:
            hint = suggestion(name, table.ids) if len(table.ids) <= 40 or name else f"it has {len(table.ids)} impacts"
            found.fault(f"{read} is not an impact of {table.source}; {hint}", "id", head)
        elif repeated(name) in table.ids:
            found.fault(
                f"{read} names several impacts of {table.source}; expected one impact for each id there", "id", head
            )
        elif name in begun:
            message = (
                f"a second record of '{name}' (the first is at row {begun[name]}); expected one record for each id"
            )
            found.fault(message, "id", head)
        else:
            taken, force = times.take(np.array(places)), forces.values[places]
            wrong = _record_fault(name, taken, force)
            if wrong is None:
                force.setflags(write=False)
                begin, step = float(taken.values[0]), _step(taken)
                records.append(ForceRecord(name, table.ids.index(name), begin, step, force))
            else:
                message, column, sample = wrong
                found.fault(message, column, places[sample])
        begun.setdefault(name, found.rows.numbers[head])
    return records


def _step(times: NumberColumn) -> float:
    return float(times.values[-1] - times.values[0]) / (len(times.values) - 1)


def _record_fault(name: str, column: NumberColumn, forces: FloatArray) -> tuple[str, str, int] | None:
    """What is wrong with a record, first with its times, then with the course of its force; in which column and at
    which sample.
    """
    times = column.values
    if len(times) < LEAST_SAMPLES:
        return f"the record of '{name}' has {len(times)} samples; expected at least {LEAST_SAMPLES}", "t", 0
    steps = np.diff(times)
    typical = float(np.median(steps))
    # Printed times are rounded: half a step either way is no gap yet.
    for wrong, words in (
        (steps <= 0.0, "expected increasing times"),
        ((steps < 0.5 * typical) | (steps > 1.5 * typical), "expected evenly spaced samples without a gap"),
    ):
        if np.any(wrong):
            k = int(np.argmax(wrong))
            read = f"read {column.text(k + 1)} after {column.text(k)} in the record of '{name}'"
            return f"{read}; {words}", "t", k + 1
    peak = float(forces.max())
    if peak <= 0.0 or -float(forces.min()) > peak:
        words = "is mostly negative; expected positive F in compression: change the sign"
        return f"the record of '{name}' {words}", "F", 0
    for end, word, sample in ((forces[0], "begins", "landing"), (forces[-1], "ends", "release")):
        if end > CUT * peak:
            return (
                f"the record of '{name}' {word} at {100.0 * float(end) / peak:.0f} % of its peak; the {sample} is "
                f"cut off; expected samples from before landing until after release (below {100.0 * CUT:.0f} %)",
                "F", 0,
            )  # fmt: skip
    first, last = _pulse(forces)
    if last - first + 1 < LEAST_SAMPLES:
        return (
            f"the record of '{name}' has {last - first + 1} samples above {100.0 * PULSE:.0f} % of its peak; "
            f"expected at least {LEAST_SAMPLES} during the contact: use a higher sampling rate",
            "t", 0,
        )  # fmt: skip
    length = (last - first) * _step(column)
    if not SHORTEST < length < LONGEST:
        return (
            f"the contact in the record of '{name}' lasts {1e3 * length:.3g} ms; expected {1e3 * SHORTEST:g} to "
            f"{1e3 * LONGEST:g} ms: check the unit of t (without a unit it is s; write 't [ms]')",
            "t", 0,
        )  # fmt: skip
    return None


def _pulse(forces: FloatArray) -> tuple[int, int]:
    top = int(np.argmax(forces))
    low = forces < PULSE * forces[top]
    before, after = np.flatnonzero(low[:top]), np.flatnonzero(low[top:])
    return int(before[-1]) + 1 if before.size else 0, top + int(after[0]) - 1 if after.size else forces.size - 1


def find_force(
    sources: Sequence[str], table: ImpactTable, scene: Scene, named: str | None = None
) -> tuple[ForceFile | None, tuple[str, ...]]:
    """The force records of a table read from `sources`, None where there are none, and notes.

    `named` "none" leaves them out. What is `named` wins over the scene's `[force] file` (relative to the scene), and
    that over a file `<table>_force.csv` (or Parquet) beside a single table. Raises TableError as `load_force` does,
    SceneError for a scene that says how records are and no record.
    """
    if named == LEFT_OUT:
        return None, ("force records are ignored, on request",)
    if named is not None:
        return load_force(Path(named), table), ()
    if scene.force_file is not None:
        place = Path(scene.source or ".").parent / scene.force_file
        if not os.path.lexists(place):
            raise SceneError(f"{scene.source}: [force] file = '{scene.force_file}': no such file: {place}")
        return load_force(place, table), ()
    beside = [found for found in map(_beside, sources) if found is not None]
    if beside and len(sources) == 1:
        only = beside[0]
        return load_force(only, table), (f"force records beside the table are used: {only.name}",)
    if beside:
        files = ", ".join(place.name for place in beside)
        named = option("force", "FILE")
        return None, (f"{files} not used: for several tables, give one file with {named}, with ids such as table:id",)
    if scene.force_sd is not None or scene.force_start_sd is not None:
        raise SceneError(f"{scene.source}: [force] describes force records, but none are given; add file = ...")
    return None, ()


def _beside(source: str) -> Path | None:
    try:
        table = resolve_table(source)
    except TableError:
        # A table made in memory lies nowhere.
        return None
    places = [table.with_name(table.stem + FORCE_ENDING + suffix) for suffix in (".csv", *PARQUET_SUFFIXES)]
    return next((place for place in places if os.path.lexists(place)), None)
