"""Reading an impact table: from a file to a checked, frozen `ImpactTable` in SI units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fitball.data.bounds import check_bounds, normal_speed
from fitball.data.checks import check_directions, check_pairs, check_ranges, one_sign
from fitball.data.columns import LABELS, MEASURED, NUMBERS, REBOUND, SD_SUFFIX, Header
from fitball.data.completeness import check_columns, knows_incident
from fitball.data.findings import Findings
from fitball.data.frozen import FrozenMapping, frozen
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
from fitball.data.table import ImpactTable, Measurement
from fitball.data.velocity import velocity
from fitball.data.written import PATHS, Source, Written, framed, written_table
from fitball.errors import Fault
from fitball.kinds import checked
from fitball.observables import OBSERVABLES, VELOCITIES
from fitball.values import FloatArray, Impacts

LEAST_IMPACTS = 2
LONGEST_LABEL = 200


@checked
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
    header, found = text.header, text.found
    least = LEAST_IMPACTS if rebound else 1
    _check_count(found, least)
    numbers = {name: read_column(column, found, gaps=True) for name, column in header.numbers.items()}
    numbers = within_limits(without_empty(numbers, found), found)
    numbers = speeds_of_heights(numbers, found)
    check_columns(numbers, header, found, rebound)
    numbers = without_gaps(numbers, rebound, least, found)
    numbers = one_sign(flip_columns(numbers, flips_of(flip, text.name), found), found)
    check_ranges(numbers, found)
    for end in ("1", "2"):
        check_redundant(numbers, end, found)
    check_pairs(numbers, found)
    check_bounds(numbers, known, found)
    check_directions(numbers, found)
    _check_labels(header, found)
    ids = unique_ids(header, found)
    found.refuse(text.source, _hints(numbers, known) if rebound and found.faults else ())
    return replace(_assembled(text, numbers, ids), flipped=flips_of(flip, text.name), columns=FrozenMapping(asked))


def _hints(columns: Mapping[str, NumberColumn], scene: Scene) -> tuple[str, ...]:
    """What a table that is refused may mean, where another reading explains it much better."""
    if not knows_incident(columns):
        return ()
    numbers = {name: column.values for name, column in columns.items() if name in MEASURED}
    doubt = doubt_of(numbers, {name: column.unit.symbol for name, column in columns.items()}, scene.ball)
    return () if doubt is None else doubt.lines(scene)


def _check_count(found: Findings, least: int) -> None:
    count = len(found.rows) + sum(fault.row is not None for fault in found.faults)
    if count == 0:
        expected = f"expected at least {least} impact{'s' if least > 1 else ''}"
        found.header_fault(f"read a header and no rows; {expected}")
    elif count < least:
        message = f"read one row only; expected at least {least} impacts: one impact cannot fix any scatter"
        line = found.rows[0].line if found.rows else found.faults[0].line
        found.faults.append(Fault(message, row=1, line=line))


def _check_labels(header: Header, found: Findings) -> None:
    """Add a fault for every label that is no name: labels head tables and figures."""
    for name in header.texts.keys() & {*LABELS}:
        for place, label in enumerate(header.cells(name, found.rows)):
            if len(label) > LONGEST_LABEL:
                message = f"read a text of {len(label)} characters; expected a name of at most {LONGEST_LABEL}"
                found.fault(message, name, place)


def _assembled(text: Written, columns: Mapping[str, NumberColumn], ids: tuple[str, ...]) -> ImpactTable:
    rows = text.found.rows
    _tell_of_sds(columns, text.found)
    impacts, incident_columns, incident_sd, covariance = _incident(columns, len(rows))
    counted = {*independent(columns, "2"), *(OBSERVABLES.keys() - VELOCITIES)}
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
        labels=FrozenMapping({name: text.header.cells(name, rows) for name in text.header.texts if name != "id"}),
        units=FrozenMapping({name: column.unit.symbol for name, column in columns.items()}),
        notices=tuple(sorted(text.found.notices, key=lambda notice: notice.row or 0)),
        incident_covariance=covariance,
        files=text.files,
        rows=tuple(row.number for row in rows),
        resolution=FrozenMapping({name: column.half_width for name, column in columns.items()}),
    )


def _measurement(columns: Mapping[str, NumberColumn], name: str) -> Measurement:
    sd = columns.get(name + SD_SUFFIX)
    return Measurement(name, frozen(columns[name].values), None if sd is None else frozen(sd.values))


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
    v_x, v_y, omega = (np.zeros(count) if item is None else item.value for item in state.values())
    impacts = Impacts(v_x, v_y, omega, _measured_cor(columns, v_y))
    sds = {name: frozen(item.sd) for name, item in present.items() if item.parts}
    covariance = frozen(covariance_matrix(list(state.values()), count)) if sds else None
    return impacts, tuple(present), sds, covariance


def _measured_cor(columns: Mapping[str, NumberColumn], v_y1: FloatArray) -> FloatArray | None:
    rebound = normal_speed(columns, "2")
    return None if rebound is None or np.isnan(rebound).any() else rebound / v_y1


def _tell_of_sds(columns: Mapping[str, NumberColumn], found: Findings) -> None:
    """Add a notice for every sd in another unit than its quantity, since a forgotten bracket looks just so, and for
    every sd of a velocity column that other columns made redundant.
    """
    for name, column in columns.items():
        base = columns[name.removesuffix(SD_SUFFIX)]
        if base.unit != column.unit:
            units = f"{column.unit.symbol}, {base.name} in {base.unit.symbol}"
            found.notice(f"{name} was read in {units}", name, base.name)
    for end in ("1", "2"):
        counted = independent(columns, end)
        for name in (f"v_x{end}", f"v_y{end}", f"v_{end}", f"theta_{end}"):
            if name not in counted and name + SD_SUFFIX in columns:
                found.notice(f"{name}{SD_SUFFIX} is not used: {' and '.join(counted)} are", name + SD_SUFFIX)
