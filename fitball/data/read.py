"""Reading an impact table: from a file to a checked, frozen `ImpactTable` in SI units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fitball.data.bounds import check_bounds, normal_speed
from fitball.data.checks import check_directions, check_pairs, check_ranges, one_sign
from fitball.data.columns import LABELS, MEASURED, NUMBERS, REBOUND, SD_SUFFIX, Header
from fitball.data.completeness import check_columns, knows_incident
from fitball.data.dialect.cells import RawRow, RawTable
from fitball.data.frozen import FrozenMapping
from fitball.data.gaps import without_empty, without_gaps
from fitball.data.heights import speeds_of_heights
from fitball.data.ids import unique_ids
from fitball.data.limits import within_limits
from fitball.data.naming import naming, with_units
from fitball.data.number_column import NumberColumn, read_column
from fitball.data.propagation import Uncertain, covariance_matrix
from fitball.data.reading.doubt import doubt_of
from fitball.data.reading.flip import flip_columns, flips_of
from fitball.data.redundancy import check_redundant, independent
from fitball.data.scene import Scene, load_scene
from fitball.data.table import ImpactTable, Measurement, Notice
from fitball.data.velocity import velocity
from fitball.data.written import PATHS, Source, Written, framed, written_table
from fitball.errors import Fault, TableError
from fitball.observables import OBSERVABLES, VELOCITIES
from fitball.values import FloatArray, Impacts

LEAST_IMPACTS = 2
LONGEST_LABEL = 200


def load_table(
    source: Source,
    *,
    rebound: bool = True,
    scene: Scene | None = None,
    flip: Sequence[str] = (),
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    name: str | None = None,
) -> ImpactTable:
    """Read an impact table: a file (CSV and its like, a workbook, Parquet), a bundled one by name, a DataFrame, or
    columns by name. It is called `name` (default: as the file).

    A path that exists wins over a bundled name. Units convert here, once, to m/s, rad/s, rad and s. With
    `rebound=False` the rebound columns may be missing and one row is enough: impacts to predict, not to fit.
    A rebound cell that says that nothing was measured is NaN in its `Measurement`; see `gaps`.
    `scene` says with what ball and what noise a rebound may seem to gain energy; without it that is the scene beside
    the table. The columns named in `flip` are counted the other way round (see `reading.flip`). `columns` gives
    names that are not ours by our name, `{"v_1": "Vin", "theta_1": "angle_in [deg]"}`, before those of the scene;
    `units` the units of columns by either name. Raises TableError
    with every fault of the file: its row, line, column, what was read and what was expected, and what may be meant
    where another reading has none; SceneError for a scene beside it that cannot be used; ParameterError for a column
    that cannot be flipped, or for names in `columns` and `units` that are no columns.

    >>> given = {"v_1": [38.0, 40.0], "theta_1": [18.0, 25.0], "v_x2": [11.0, 10.5], "v_y2": [4.0, 5.0]}
    >>> fitball.load_table(given, units={"v_1": "mph"}, name="mine")
    <ImpactTable mine: 2 impacts, incident v_x1, v_y1, measured v_x2, v_y2>
    """
    flip = (flip,) if isinstance(flip, str) else flip
    known = scene or load_scene(source if isinstance(source, PATHS) else None, as_read=True)
    asked = with_units({**known.columns, **(columns or {})}, units or {}, (*NUMBERS, *LABELS))
    text = written_table(framed(source), naming(asked, (*NUMBERS, *LABELS)))
    text = text if name is None else replace(text, name=name)
    raw, header = text.raw, text.header
    faults, notices = list(text.faults), list(text.notices)
    least = LEAST_IMPACTS if rebound else 1
    _check_count(raw, faults, least)
    numbers = {name: read_column(column, raw.rows, faults, gaps=True) for name, column in header.numbers.items()}
    numbers = within_limits(without_empty(numbers, notices), raw.rows, faults)
    numbers = speeds_of_heights(numbers, raw.rows, faults, notices)
    check_columns(numbers, header, raw.header_line, faults, notices, rebound)
    numbers, rows = without_gaps(numbers, raw.rows, rebound, least, faults, notices)
    raw = replace(raw, rows=rows)
    numbers = flip_columns(numbers, flips_of(flip, text.name), notices)
    numbers = one_sign(numbers, raw.rows, faults, notices)
    check_ranges(numbers, raw.rows, faults)
    for end in ("1", "2"):
        check_redundant(numbers, end, raw.rows, faults, notices)
    check_pairs(numbers, raw.rows, faults)
    check_bounds(numbers, raw.rows, known, faults, notices)
    check_directions(numbers, raw.rows, notices)
    _check_labels(header, raw.rows, faults)
    ids = unique_ids(header, raw.rows, notices)
    if faults:
        # Header first, then row by row, so that the list can be worked off from the top of the file.
        hints = _hints(numbers, known) if rebound else ()
        raise TableError(text.source, sorted(faults, key=lambda fault: fault.row or 0), hints)
    table = _assemble(replace(text, raw=raw), numbers, ids, notices)
    return replace(table, flipped=flips_of(flip, text.name), columns=FrozenMapping(asked))


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


def _frozen(values: FloatArray) -> FloatArray:
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def _assemble(
    text: Written, columns: Mapping[str, NumberColumn], ids: tuple[str, ...], notices: list[Notice]
) -> ImpactTable:
    rows = text.raw.rows
    impacts, incident_columns, incident_sd, covariance = _incident(columns, len(rows))
    counted = {*independent(columns, "2"), *(OBSERVABLES.keys() - VELOCITIES)}
    remarks = [*notices, *_unit_notices(columns), *_unused_sds(columns)]
    rebound = [_measurement(columns, name) for name in REBOUND if name in columns]
    return ImpactTable(
        name=text.name,
        source=text.source,
        digest=text.digest,
        ids=ids,
        impacts=impacts,
        incident_columns=incident_columns,
        incident_sd=FrozenMapping(incident_sd),
        measurements=tuple(item for item in rebound if item.name in counted),
        redundant=tuple(item for item in rebound if item.name not in counted),
        labels=FrozenMapping(
            {
                name: tuple(row.cells[column.index] for row in rows)
                for name, column in text.header.texts.items()
                if name != "id"
            }
        ),
        units=FrozenMapping({name: column.unit.symbol for name, column in columns.items()}),
        notices=tuple(sorted(remarks, key=lambda notice: notice.row or 0)),
        incident_covariance=covariance,
        files=text.files,
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
