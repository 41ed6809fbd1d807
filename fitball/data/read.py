"""Reads impact tables: from files to one checked, frozen `ImpactTable` in SI units. A table for a fit is refused if
another reading fits much better. Rebounds that another program computed are read unchanged, but for their units.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from fitball.data.bundled import SHEET_MARK, resolve_table, split_sheet
from fitball.data.cells import Findings, Texts
from fitball.data.checks import (
    check_bounds,
    check_columns,
    check_directions,
    check_pairs,
    check_ranges,
    check_redundant,
    knows_incident,
    normal_speed,
    one_sign,
    surely_meant,
)
from fitball.data.columns import BALL_TEMPERATURE, INCIDENT, LABELS, MEASURED, NUMBERS, REBOUND, SD_SUFFIX
from fitball.data.header import Naming, naming, read_header, vocabulary, with_units
from fitball.data.heights import speeds_of_heights
from fitball.data.kinematics import Uncertain, covariance_matrix, independent, velocity
from fitball.data.labels import labelled, one_spelling
from fitball.data.laws import repeats_of
from fitball.data.misreading import check_flips, doubt_of, doubt_of_table, flip_columns, flips_of, gaps_of_table
from fitball.data.numbers import (
    Columns,
    plain_numbers,
    read_column,
    split_deviations,
    unique_ids,
    within_limits,
    without_empty,
    without_gaps,
)
from fitball.data.scene import Scene, load_scene
from fitball.data.table import FrozenMapping, ImpactTable, Measurement, frozen, joined
from fitball.data.temperatures import ball_temperatures
from fitball.data.text import frame_table, read_raw
from fitball.data.units import Unit
from fitball.errors import Fault, ParameterError, ReadingError, TableError
from fitball.kinds import checked
from fitball.observables import OBSERVABLES, VELOCITIES
from fitball.values import FloatArray, Impacts
from fitball.visible import unguarded

if TYPE_CHECKING:
    import pandas


# What a table may be read from: a path or bundled name, a DataFrame, or columns by name.
Source: TypeAlias = "str | os.PathLike[str] | pandas.DataFrame | Mapping[str, Sequence[Any]]"

# What a DataFrame is called in reports and messages, unless its `attrs["name"]` says.
FRAME = "DataFrame"
# Every column that may be named.
OURS = (*NUMBERS, *LABELS, BALL_TEMPERATURE)
# What names a file; any other source is a DataFrame.
PATHS = (str, os.PathLike)
LEAST_IMPACTS = 2
LONGEST_LABEL = 200


@dataclass(frozen=True)
class Written:
    """A table before its numbers are read: `name`, `source`, SHA-256 of its bytes, and the cells of its header
    (`heads`). The cells of its `numbers`, with their `units`, and of its `texts` are by fitball's names; `extras` are
    texts that are no labels. `warmth` is the unit of ball temperatures as it is written, if there is one. `files` are
    those it came from, none for a DataFrame.
    """

    name: str
    source: str
    digest: str
    files: tuple[tuple[str, str], ...]
    heads: Texts
    units: Mapping[str, Unit | None]
    numbers: Mapping[str, Texts]
    texts: Mapping[str, Texts]
    extras: tuple[str, ...]
    warmth: str | None
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
        raise ParameterError(f"these columns are not a table: {error}") from None


def name_of(source: str | os.PathLike[str] | pandas.DataFrame) -> str:
    """What the table of a source is called. Raises TableError where there is no such file."""
    if not isinstance(source, PATHS):
        return str(source.attrs.get("name", FRAME))
    sheet = split_sheet(source)[1]
    return resolve_table(source).stem + ("" if sheet is None else f"-{sheet}")


def written_table(source: str | os.PathLike[str] | pandas.DataFrame, naming: Naming) -> Written:
    """Header and columns of a table, its numbers with decimal points, deviations in columns of their own.

    Raises TableError where it cannot be taken apart at all.
    """
    known = vocabulary(naming)
    place, name, files = FRAME, name_of(source), dict[str, str]()
    if isinstance(source, PATHS):
        path = resolve_table(source)
        sheet = split_sheet(source)[1]
        raw = read_raw(path, known, sheet)
        of_it = "" if sheet is None else SHEET_MARK + sheet
        place, files = f"{path}{of_it}", {f"{path.resolve()}{of_it}": sha256(raw.data).hexdigest()}
    else:
        place = name
        raw = frame_table(place, source, known, source.to_csv().encode("utf-8", "backslashreplace"))
    found = Findings.from_raw(raw)
    header = read_header(raw.header, found, naming)
    numbers, notes = plain_numbers({name: raw.columns[header.places[name]] for name in header.units})
    parted = {name: split_deviations(cells) for name, cells in numbers.items()}
    stated = {name + SD_SUFFIX: sds for name, (_values, sds) in parted.items() if sds is not None}
    for sd in [sd for sd in stated if sd in header.units or sd not in NUMBERS]:
        del stated[sd]
        name = sd.removesuffix(SD_SUFFIX)
        found.header_fault(f"has standard deviations (±) in its cells, and a column {sd} too; keep one of them", name)
    if stated:
        taken = ", ".join(sd.removesuffix(SD_SUFFIX) for sd in stated)
        notes = (*notes, f"numbers after ± in {taken} are read as one standard deviation")
    for note in notes:
        found.notice(note)
    return Written(
        name=name_of(source),
        source=place,
        digest=sha256(raw.data).hexdigest(),
        files=tuple(files.items()),
        heads=raw.header,
        units={**header.units, **{sd: header.units[sd.removesuffix(SD_SUFFIX)] for sd in stated}},
        numbers={name: values for name, (values, _sds) in parted.items()} | stated,
        texts={name: unguarded(raw.columns[header.places[name]]) for name in header.texts},
        extras=header.extras,
        warmth=header.warmth,
        found=found,
    )


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

    A path that exists is preferred to a bundled name. Units are converted to m/s, rad/s, rad and s. With
    `rebound=False` rebound columns are optional and one row is enough, for impacts to predict. A missing rebound
    value is NaN in its `Measurement`. `scene` (default: the one beside the table) has the ball and the noise for
    checks of energy. Columns in `flip` are read with the opposite convention (see `misreading.flipped`). `columns`
    maps fitball's names to those of the table, `{"v_1": "Vin", "theta_1": "angle_in [deg]"}`, and is preferred to
    the scene's. `units` has the units of columns by either name.

    Raises TableError with every fault of the file: row, line, column, what was read and what was expected. It names
    another reading if that has no fault. Raises SceneError for a scene beside it that cannot be used. Raises
    ParameterError for an unknown column in `columns` or `units`, or one that cannot be flipped.

    >>> given = {"v_1": [38.0, 40.0], "theta_1": [18.0, 25.0], "v_x2": [11.0, 10.5], "v_y2": [4.0, 5.0]}
    >>> fitball.load_table(given, units={"v_1": "mph"}, name="mine")
    <ImpactTable mine: 2 impacts, incident v_x1, v_y1, measured v_x2, v_y2>
    """
    flip = (flip,) if isinstance(flip, str) else flip
    known = scene or load_scene(source if isinstance(source, PATHS) else None, as_read=True)
    asked = with_units({**known.columns, **(columns or {})}, units or {}, OURS)
    text = written_table(framed(source), naming(asked, OURS))
    text = text if name is None else replace(text, name=name)
    found, least = text.found, LEAST_IMPACTS if rebound else 1
    _check_count(found, least)
    numbers: Columns = {
        name: read_column(name, text.units[name], cells, found, gaps=True) for name, cells in text.numbers.items()
    }
    numbers = within_limits(without_empty(numbers, found), found)
    numbers = speeds_of_heights(numbers, found)
    grouped = {item.column for item in labelled(text.texts)} - {BALL_TEMPERATURE}
    check_columns(numbers, [*text.units, *text.texts], text.extras, found, rebound, grouped)
    if found.faults and (meant := surely_meant(text.extras, numbers)):
        under = _beneath(source, {**asked, **meant}, rebound=rebound, scene=known, flip=flip, name=name)
        found.faults.extend(fault for fault in under if fault not in found.faults)
        found.refuse(text.source)
    numbers, kept = without_gaps(numbers, rebound, least, found)
    texts = text.texts
    if len(kept) < len(found.rows):
        found, texts = found.among(kept), {name: tuple(cells[k] for k in kept) for name, cells in texts.items()}
    warmth = ball_temperatures(texts, text.warmth, found)
    texts = one_spelling({name: cells for name, cells in texts.items() if name != BALL_TEMPERATURE}, found)
    numbers = one_sign(flip_columns(numbers, flips_of(flip, text.name), found), found)
    check_ranges(numbers, found)
    for end in ("1", "2"):
        check_redundant(numbers, end, found)
    check_pairs(numbers, found)
    check_bounds(numbers, known, found)
    check_directions(numbers, found)
    _check_labels(texts, found)
    ids = unique_ids(texts.get("id"), found)
    found.refuse(text.source, _hints(numbers, known) if rebound and found.faults else ())
    table = _assembled(replace(text, texts=texts, found=found), numbers, ids)
    return replace(table, flipped=flips_of(flip, text.name), columns=FrozenMapping(asked), ball_temperature=warmth)


def _beneath(source: Source, columns: Mapping[str, str], **reading: Any) -> list[Fault]:
    """The faults in rows of a table whose columns are named so, to be mended in the same round."""
    try:
        load_table(source, columns=columns, **reading)
    except TableError as error:
        theirs = {ours: naming({ours: text}, (ours,)).theirs[ours] for ours, text in columns.items()}
        faults = [fault for fault in error.faults if fault.row is not None]
        return [replace(fault, column=theirs.get(fault.column or "", fault.column)) for fault in faults]
    return []


def _hints(columns: Columns, scene: Scene) -> tuple[str, ...]:
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
        found.header_fault(f"no rows after the header; {expected}")
    elif count < least:
        message = f"read one row only; expected at least {least} impacts, since one does not determine the noise"
        line = found.rows.lines[0] if found.rows else found.faults[0].line
        found.faults.append(Fault(message, row=1, line=line))


def _check_labels(texts: Mapping[str, Texts], found: Findings) -> None:
    """Add a fault for every label that is no name: labels head tables and figures."""
    for name in texts.keys() & {*LABELS}:
        for place, label in enumerate(texts[name]):
            if len(label) > LONGEST_LABEL:
                message = f"read a text of {len(label)} characters; expected at most {LONGEST_LABEL}"
                found.fault(message, name, place)


def _assembled(text: Written, columns: Columns, ids: tuple[str, ...]) -> ImpactTable:
    _note_sds(columns, text.found)
    impacts, incident_columns, incident_sd, covariance = _incident(columns, len(text.found.rows))
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
        labels=FrozenMapping({name: cells for name, cells in text.texts.items() if name != "id"}),
        units=FrozenMapping({name: column.unit.symbol for name, column in columns.items()}),
        notices=tuple(sorted(text.found.notices, key=lambda notice: notice.row or 0)),
        incident_covariance=covariance,
        files=text.files,
        rows=text.found.rows.numbers,
        resolution=FrozenMapping({name: column.half_width for name, column in columns.items()}),
    )


def _measurement(columns: Columns, name: str) -> Measurement:
    sd = columns.get(name + SD_SUFFIX)
    return Measurement(name, frozen(columns[name].values), None if sd is None else frozen(sd.values))


def _incident(
    columns: Columns, count: int
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


def _measured_cor(columns: Columns, v_y1: FloatArray) -> FloatArray | None:
    rebound = normal_speed(columns, "2")
    return None if rebound is None or np.isnan(rebound).any() else rebound / v_y1


def _note_sds(columns: Columns, found: Findings) -> None:
    """Add a notice for every sd with another unit than its quantity, often a forgotten unit, and for every sd of a
    velocity column that is redundant.
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


def load_tables(
    sources: Sequence[ImpactTable | Source],
    scene: Scene | None = None,
    flip: Sequence[str] = (),
    columns: Mapping[str, str] | None = None,
) -> ImpactTable:
    """One table, or several joined; `flip` and `columns` as `load_table` has them, a column of one of several tables
    is flipped as `TABLE:COLUMN`. Raises as `load_table` does for each, TableError for tables that differ,
    ParameterError for a table that is not there.
    """
    return joined(_read_each(sources, scene, flip, columns, None))


def trusted_table(
    data: Sequence[ImpactTable | Source],
    scene: Scene,
    flip: Sequence[str] = (),
    as_read: bool = False,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
) -> tuple[ImpactTable, tuple[str, ...]]:
    """A table, or the one joined from several, and notes on how it was read.

    Each table is checked by itself, with the scene's ball. With `as_read` a table that another reading fits much
    better is accepted, with a note; otherwise ReadingError is raised. Raises ParameterError for `flip` or `columns`
    of a table that has been read already, and as `load_tables` does.
    """
    for what, given in (("flip", flip), ("columns", columns), ("units", units)):
        if given and any(isinstance(item, ImpactTable) for item in data):
            raise ParameterError(
                f"{what}: this table has been read already; pass it to load_table(file, {what}=...) instead"
            )
    tables = _read_each(data, scene, flip, columns, units)
    notes = []
    for table in tables:
        gaps = gaps_of_table(table, scene.ball)
        notes += [] if gaps is None else [f"{table.name}: {gaps}"]
        copies, near = repeats_of(table, scene.ball)
        if copies is not None and not as_read:
            raise ReadingError(table.source, (copies,), "rows are copies of others:")
        notes += [f"{table.name}: all rows are used, on request (as_read), although {copies}"] if copies else []
        notes += [f"{table.name}: {near}"] if near else []
        doubt = doubt_of_table(table, scene.ball)
        if doubt is not None and not as_read:
            raise ReadingError(table.source, doubt.lines(scene))
        if doubt is not None:
            notes.append(
                f"{table.name}: read as in its header, on request (as_read), although {doubt.lines(scene)[0]}"
            )
    return joined(tables), tuple(notes)


def _read_each(
    sources: Sequence[ImpactTable | Source],
    scene: Scene | None,
    flip: Sequence[str],
    columns: Mapping[str, str] | None,
    units: Mapping[str, str] | None,
) -> list[ImpactTable]:
    """The tables one by one, those that were read already as they are."""
    check_flips(flip, [name_of(framed(source)) for source in sources if not isinstance(source, ImpactTable)])

    def read(source: ImpactTable | Source) -> ImpactTable:
        if isinstance(source, ImpactTable):
            return source
        return load_table(source, scene=scene, flip=flip, columns=columns, units=units)

    return [read(source) for source in sources]


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
