"""Reading an impact table: from a file to a checked, frozen `ImpactTable` in SI units."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np

from fitball.data.bounds import check_bounds, normal_speed
from fitball.data.bundled import resolve_table
from fitball.data.checks import check_pairs, check_ranges, one_sign
from fitball.data.columns import LABELS, MEASURED, REBOUND, SD_SUFFIX, Header, read_header
from fitball.data.completeness import check_columns, knows_incident
from fitball.data.frozen import FrozenMapping
from fitball.data.gaps import without_empty, without_gaps
from fitball.data.limits import within_limits
from fitball.data.number_column import NumberColumn, read_column
from fitball.data.propagation import Uncertain, covariance_matrix
from fitball.data.raw import RawRow, RawTable, read_raw
from fitball.data.reading.doubt import doubt_of
from fitball.data.reading.flip import flip_columns, flips_of
from fitball.data.redundancy import check_redundant, independent
from fitball.data.scene import Scene, load_scene
from fitball.data.table import ImpactTable, Measurement, Notice
from fitball.data.velocity import velocity
from fitball.errors import Fault, TableError
from fitball.observables import OBSERVABLES, VELOCITIES
from fitball.values import FloatArray, Impacts

LEAST_IMPACTS = 2
LONGEST_LABEL = 200


def load_table(
    source: str | os.PathLike[str], *, rebound: bool = True, scene: Scene | None = None, flip: Sequence[str] = ()
) -> ImpactTable:
    """Read an impact table from a CSV or Parquet file, or a bundled one by name.

    A path that exists wins over a bundled name. Units convert here, once, to m/s, rad/s, rad and s. With
    `rebound=False` the rebound columns may be missing and one row is enough: impacts to predict, not to fit.
    A rebound cell that says that nothing was measured is NaN in its `Measurement`; see `gaps`.
    `scene` says with what ball and what noise a rebound may seem to gain energy; without it that is the scene beside
    the table. The columns named in `flip` are counted the other way round (see `reading.flip`). Raises TableError
    with every fault of the file: its row, line, column, what was read and what was expected, and what may be meant
    where another reading has none; SceneError for a scene beside it that cannot be used; ParameterError for a column
    that cannot be flipped.
    """
    path = resolve_table(source)
    raw = read_raw(path)
    faults, notices = list(raw.faults), list[Notice]()
    header = read_header(raw.header, raw.header_line, faults)
    least = LEAST_IMPACTS if rebound else 1
    _check_count(raw, faults, least)
    columns = {name: read_column(column, raw.rows, faults, gaps=True) for name, column in header.numbers.items()}
    columns = without_empty(columns, notices)
    header = replace(header, numbers={name: header.numbers[name] for name in columns})
    check_columns(header, raw.header_line, faults, notices, rebound)
    columns = within_limits(columns, raw.rows, faults)
    columns, rows = without_gaps(columns, raw.rows, rebound, least, faults, notices)
    raw = replace(raw, rows=rows)
    columns = flip_columns(columns, flips_of(flip, path.stem), notices)
    columns = one_sign(columns, raw.rows, faults, notices)
    check_ranges(columns, raw.rows, faults)
    for end in ("1", "2"):
        check_redundant(columns, end, raw.rows, faults, notices)
    check_pairs(columns, raw.rows, faults)
    known = scene or load_scene(source, as_read=True)
    check_bounds(columns, raw.rows, known, faults, notices)
    _check_labels(header, raw.rows, faults)
    ids = _ids(header, raw.rows, faults)
    if faults:
        # Header first, then row by row, so that the list can be worked off from the top of the file.
        hints = _hints(columns, known) if rebound else ()
        raise TableError(str(path), sorted(faults, key=lambda fault: fault.row or 0), hints)
    return replace(_assemble(path, raw, header, columns, ids, notices), flipped=flips_of(flip, path.stem))


def _hints(columns: Mapping[str, NumberColumn], scene: Scene) -> tuple[str, ...]:
    """What a table that is refused may mean, where another reading explains it much better."""
    if not knows_incident(columns):
        return ()
    numbers = {name: column.values for name, column in columns.items() if name in MEASURED}
    doubt = doubt_of(numbers, {name: column.unit.symbol for name, column in columns.items()}, scene.ball)
    return () if doubt is None else doubt.lines(scene)


def _check_count(raw: RawTable, faults: list[Fault], least: int) -> None:
    count = len(raw.rows) + sum(fault.row is not None for fault in raw.faults)
    if count == 0:
        faults.append(
            Fault(
                f"read a header and no rows; expected at least {least} impact{'s' if least > 1 else ''}",
                line=raw.header_line,
            )
        )
    elif count < least:
        message = f"read one row only; expected at least {least} impacts: one impact cannot fix any scatter"
        faults.append(Fault(message, row=1, line=raw.rows[0].line if raw.rows else raw.faults[0].line))


def _check_labels(header: Header, rows: tuple[RawRow, ...], faults: list[Fault]) -> None:
    """Add a fault for every label that is no name: labels head tables and figures."""
    for name in LABELS:
        if name not in header.texts:
            continue
        for row in rows:
            length = len(row.cells[header.texts[name].index])
            if length > LONGEST_LABEL:
                message = f"read a text of {length} characters; expected a name of at most {LONGEST_LABEL}"
                faults.append(Fault(message, row.number, row.line, name))


def _ids(header: Header, rows: tuple[RawRow, ...], faults: list[Fault]) -> tuple[str, ...]:
    if "id" not in header.texts:
        return tuple(str(row.number) for row in rows)
    index = header.texts["id"].index
    first: dict[str, int] = {}
    for row in rows:
        text = row.cells[index]
        if not text:
            faults.append(Fault("read an empty cell; expected a name for the impact", row.number, row.line, "id"))
        elif text in first:
            message = f"read '{text}', which names row {first[text]} already; expected a name of its own"
            faults.append(Fault(message, row.number, row.line, "id"))
        first.setdefault(text, row.number)
    return tuple(row.cells[index] for row in rows)


def _frozen(values: FloatArray) -> FloatArray:
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def _assemble(
    path: Path,
    raw: RawTable,
    header: Header,
    columns: Mapping[str, NumberColumn],
    ids: tuple[str, ...],
    notices: list[Notice],
) -> ImpactTable:
    impacts, incident_columns, incident_sd, covariance = _incident(columns, len(raw.rows))
    counted = {*independent(columns, "2"), *(OBSERVABLES.keys() - VELOCITIES)}
    remarks = [*notices, *_unit_notices(columns), *_unused_sds(columns)]
    rebound = [_measurement(columns, name) for name in REBOUND if name in columns]
    return ImpactTable(
        name=path.stem,
        source=str(path),
        digest=sha256(raw.data).hexdigest(),
        ids=ids,
        impacts=impacts,
        incident_columns=incident_columns,
        incident_sd=FrozenMapping(incident_sd),
        measurements=tuple(item for item in rebound if item.name in counted),
        redundant=tuple(item for item in rebound if item.name not in counted),
        labels=FrozenMapping(
            {
                name: tuple(row.cells[column.index] for row in raw.rows)
                for name, column in header.texts.items()
                if name != "id"
            }
        ),
        units=FrozenMapping({name: column.unit.symbol for name, column in columns.items()}),
        notices=tuple(sorted(remarks, key=lambda notice: notice.row or 0)),
        incident_covariance=covariance,
        files=((str(path.resolve()), sha256(raw.data).hexdigest()),),
    )


def _measurement(columns: Mapping[str, NumberColumn], name: str) -> Measurement:
    sd = columns.get(name + SD_SUFFIX)
    return Measurement(name, _frozen(columns[name].values), None if sd is None else _frozen(sd.values))


def _incident(
    columns: Mapping[str, NumberColumn], count: int
) -> tuple[Impacts, tuple[str, ...], dict[str, FloatArray], FloatArray | None]:
    """Incident components, the names of those that are known, the stated sd of each, and their covariance.

    The sds of components that come from speed and angle are propagated linearly, with the correlation that this
    leaves between the two. The covariance (impacts, 3, 3) is None where no sd is stated.
    """
    known = {}
    for name in (*independent(columns, "1"), *(["omega_1"] if "omega_1" in columns else [])):
        sd = columns.get(name + SD_SUFFIX)
        values = columns[name].values
        known[name] = Uncertain.exact(values) if sd is None else Uncertain.measured(name, values, sd.values)
    along = velocity(known, "1")
    state = {"v_x1": along.x, "v_y1": along.y, "omega_1": known.get("omega_1")}
    present = {name: item for name, item in state.items() if item is not None}
    zeros = np.zeros(count)
    values_of = {name: present[name].value if name in present else zeros for name in state}
    impacts = Impacts(
        values_of["v_x1"], values_of["v_y1"], values_of["omega_1"], _measured_cor(columns, values_of["v_y1"])
    )
    sds = {name: _frozen(item.sd) for name, item in present.items() if item.parts}
    covariance = None
    if sds:
        covariance = _frozen(covariance_matrix(list(state.values()), count))
    return impacts, tuple(present), sds, covariance


def _measured_cor(columns: Mapping[str, NumberColumn], v_y1: FloatArray) -> FloatArray | None:
    rebound = normal_speed(columns, "2")
    return None if rebound is None or np.isnan(rebound).any() else rebound / v_y1


def _unit_notices(columns: Mapping[str, NumberColumn]) -> list[Notice]:
    """One notice for every sd in another unit than its quantity: a forgotten bracket looks just so."""
    return [
        Notice(
            f"{name} was read in {column.unit.symbol}, {base} in {columns[base].unit.symbol}",
            columns=(name, base),
        )
        for name, column in columns.items()
        if name.endswith(SD_SUFFIX) and columns[base := name.removesuffix(SD_SUFFIX)].unit != column.unit
    ]


def _unused_sds(columns: Mapping[str, NumberColumn]) -> list[Notice]:
    """One notice for every sd of an incident column that other columns made redundant."""
    counted = independent(columns, "1")
    return [
        Notice(f"{name}{SD_SUFFIX} is not used: {' and '.join(counted)} are", columns=(name + SD_SUFFIX,))
        for name in ("v_x1", "v_y1", "v_1", "theta_1")
        if name not in counted and name + SD_SUFFIX in columns
    ]
