"""Reading an impact table: from a file to a checked, frozen `ImpactTable` in SI units. Rebounds that another program
computed are read as they stand: units convert, nothing is mended.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from fitball.data.bounds import check_bounds, normal_speed
from fitball.data.bundled import SHEET_MARK, resolve_table, split_sheet
from fitball.data.checks import (
    check_columns,
    check_directions,
    check_pairs,
    check_ranges,
    check_redundant,
    knows_incident,
    one_sign,
)
from fitball.data.columns import INCIDENT, LABELS, MEASURED, NUMBERS, REBOUND, SD_SUFFIX
from fitball.data.findings import Findings, RawTable
from fitball.data.header import (
    Column,
    Header,
    Naming,
    naming,
    read_header,
    vocabulary,
    with_units,
)
from fitball.data.heights import speeds_of_heights
from fitball.data.kinematics import Uncertain, covariance_matrix, independent, velocity
from fitball.data.misreading import doubt_of, flip_columns, flips_of
from fitball.data.numbers import NumberColumn, plain_numbers, read_column, split_deviations, within_limits
from fitball.data.rows import unique_ids, without_empty, without_gaps
from fitball.data.scene import Scene, load_scene
from fitball.data.table import FrozenMapping, ImpactTable, Measurement, frozen
from fitball.data.text import frame_table, read_raw
from fitball.errors import Fault, ParameterError
from fitball.kinds import checked
from fitball.observables import OBSERVABLES, VELOCITIES
from fitball.values import FloatArray, Impacts

if TYPE_CHECKING:
    import pandas


# What a table may be read from: a path or bundled name, a DataFrame, or columns by name.
Source: TypeAlias = "str | os.PathLike[str] | pandas.DataFrame | Mapping[str, Sequence[Any]]"

# What a DataFrame is called in reports and messages, unless its `attrs["name"]` says.
FRAME = "DataFrame"
# What names a file; any other source is a DataFrame.
PATHS = (str, os.PathLike)


@dataclass(frozen=True)
class Written:
    """A table before its numbers are looked at: `name`, where it is from, the SHA-256 of its bytes, what was read,
    and what was found so far; `files` are those it came from, none for a DataFrame.
    """

    name: str
    source: str
    digest: str
    files: tuple[tuple[str, str], ...]
    raw: RawTable
    header: Header
    found: Findings


def in_memory(source: object) -> bool:
    """Whether a source is a DataFrame or a mapping of columns, and no file."""
    return isinstance(source, Mapping) or (hasattr(source, "iloc") and hasattr(source, "columns"))


def check_source(source: object) -> None:
    """Raise ParameterError for what is no source of a table."""
    if not (isinstance(source, PATHS) or in_memory(source)):
        raise ParameterError(
            f"read a table of type {type(source).__name__}, expected a data frame, a path, the name of a bundled "
            "table, or columns by name"
        )


def framed(source: Any) -> str | os.PathLike[str] | pandas.DataFrame:
    """A source, columns by name as a DataFrame. Raises ParameterError for columns of unequal length, and as
    `check_source` does.
    """
    check_source(source)
    if not isinstance(source, Mapping):
        return source  # type: ignore[no-any-return]
    import pandas

    try:
        return pandas.DataFrame(source)
    except ValueError as error:
        raise ParameterError(f"these columns make no table: {error}") from None


def name_of(source: str | os.PathLike[str] | pandas.DataFrame) -> str:
    """What the table of a source is called. Raises TableError where there is no such file."""
    if not isinstance(source, PATHS):
        return str(source.attrs.get("name", FRAME))
    sheet = split_sheet(source)[1]
    return resolve_table(source).stem + ("" if sheet is None else f"-{sheet}")


def written_table(source: str | os.PathLike[str] | pandas.DataFrame, naming: Naming) -> Written:
    """Header and rows of a table, its numbers with decimal points, deviations in columns of their own.

    Raises TableError where it cannot be taken apart at all.
    """
    known = vocabulary(naming)
    files: tuple[tuple[str, str], ...] = ()
    if isinstance(source, PATHS):
        path = resolve_table(source)
        sheet = split_sheet(source)[1]
        raw = read_raw(path, known, sheet)
        of_it = "" if sheet is None else SHEET_MARK + sheet
        place, files = f"{path}{of_it}", ((f"{path.resolve()}{of_it}", sha256(raw.data).hexdigest()),)
    else:
        place = name_of(source)
        raw = frame_table(place, source, known, source.to_csv().encode("utf-8", "backslashreplace"))
    found = Findings.of(raw)
    header = _plain(read_header(raw.header, found, naming), found)
    return Written(name_of(source), place, sha256(raw.data).hexdigest(), files, raw, header, found)


def _plain(header: Header, found: Findings) -> Header:
    """The header, with a column `<name>_sd` for each whose cells state their deviations; the rows that were found get
    plain numbers.
    """
    names = {column.index: name for name, column in header.numbers.items()}
    rows, notes = plain_numbers(found.rows, tuple(names))
    found.rows, added = split_deviations(rows, tuple(names))
    numbers, taken = dict(header.numbers), list[str]()
    for place, index in added.items():
        name, sd = names[place], names[place] + SD_SUFFIX
        if name.endswith(SD_SUFFIX) or sd in numbers:
            found.header_fault(
                f"states deviations (±) in its cells, and {sd} is a column too; expected them once", name
            )
            continue
        numbers[sd] = Column(index, sd, numbers[name].unit)
        taken.append(name)
    if taken:
        notes = (*notes, f"what stands behind ± in {', '.join(taken)} is taken as one standard deviation")
    for note in notes:
        found.notice(note)
    return replace(header, numbers=numbers)


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
    the table. The columns named in `flip` are counted the other way round (see `misreading.flipped`). `columns` gives
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
