"""Reads impact tables: from files to one checked, frozen `ImpactTable` in SI units. A table for a fit is refused if
another reading fits much better. Rebounds that another program computed are read unchanged, but for their units.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
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
from fitball.data.covariance import Stated, errors_of, together, turned, whole_rows, with_sds
from fitball.data.covariance_entries import LEFT_OUT, Given, Layout
from fitball.data.header import Naming, naming, our_column, read_header, vocabulary, with_units
from fitball.data.heights import speeds_of_heights
from fitball.data.kinematics import Uncertain, covariance_matrix, independent, velocity
from fitball.data.labels import labelled, one_spelling
from fitball.data.misreading import doubt_of, flip_columns, named_of
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
from fitball.data.table import FrozenMapping, ImpactTable, Measurement, frozen
from fitball.data.temperatures import ball_temperatures
from fitball.data.text import frame_table, read_raw
from fitball.data.units import Unit
from fitball.errors import Fault, ParameterError, TableError, suggestion
from fitball.kinds import checked
from fitball.observables import INCIDENT_UNITS, OBSERVABLES, VELOCITIES
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
    covariance: Given | None = None,
    ignore: Sequence[str] = (),
) -> ImpactTable:
    """Read an impact table: a file (CSV and its like, a workbook, Parquet), a bundled one by name, a DataFrame, or
    columns by name. It is called `name` (default: as the file).

    A path that exists is preferred to a bundled name. Units are converted to m/s, rad/s, rad and s. With
    `rebound=False` rebound columns are optional and one row is enough, for impacts to predict. A missing rebound
    value is NaN in its `Measurement`. `scene` (default: the one beside the table) has the ball and the noise for
    checks of energy. Columns in `flip` are read with the opposite convention (see `misreading.flipped`). `columns`
    maps fitball's names to those of the table, `{"v_1": "Vin", "theta_1": "angle_in [deg]"}`, and is preferred to
    the scene's. `units` has the units of columns by either name. Rebound columns in `ignore`, and those that the
    scene ignores, are left out.

    `covariance` are errors that belong together, in the units of the table: a path, `{id: {(column, column):
    value}}`, or an array (rows, columns, columns) with the measured columns in the order of the table's header (all
    numbers but sds, heights and temperatures). The default is the file `NAME_covariance.csv` (or Parquet) beside the
    table, "none" for none.

    Raises TableError with every fault of the file: row, line, column, what was read and what was expected. It names
    another reading if that has no fault. Raises SceneError for a scene beside it that cannot be used. Raises
    ParameterError for an unknown column in `columns` or `units`, or one that cannot be flipped.

    >>> given = {"v_1": [38.0, 40.0], "theta_1": [18.0, 25.0], "v_x2": [11.0, 10.5], "v_y2": [4.0, 5.0]}
    >>> fitball.load_table(given, units={"v_1": "mph"}, name="mine")
    <ImpactTable mine: 2 impacts, incident v_x1, v_y1, measured v_x2, v_y2>
    """
    flip, ignore = ((item,) if isinstance(item, str) else item for item in (flip, ignore))
    known = scene or load_scene(source if isinstance(source, PATHS) else None, as_read=True)
    asked = with_units({**known.columns, **(columns or {})}, units or {}, OURS)
    asked_for = naming(asked, OURS)
    written = written_table(framed(source), asked_for if rebound else replace(asked_for, optional=REBOUND))
    text = written if name is None else replace(written, name=name)
    ignored = _ignored(named_of((*known.ignore, *ignore), text.name), text, asked_for)
    text = _without(text, ignored)
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
        under = _beneath(
            source,
            {**asked, **meant},
            rebound=rebound,
            scene=known,
            flip=flip,
            name=name,
            ignore=ignore,
            covariance=LEFT_OUT,
        )
        found.faults.extend(fault for fault in under if fault not in found.faults)
        found.refuse(text.source)
    numbers, kept = without_gaps(numbers, rebound, least, found)
    texts, names = text.texts, text.texts.get("id", tuple(map(str, found.rows.numbers)))
    if len(kept) < len(found.rows):
        found, texts = found.among(kept), {name: tuple(cells[k] for k in kept) for name, cells in texts.items()}
    warmth = ball_temperatures(texts, text.warmth, found)
    texts = one_spelling({name: cells for name, cells in texts.items() if name != BALL_TEMPERATURE}, found)
    ids = unique_ids(texts.get("id"), found)
    before = flip_columns(numbers, named_of(flip, text.name), found)
    numbers, stated = one_sign(before, found), None
    if not found.faults:
        columns_of_it = tuple(name for name in written.units if name in MEASURED)
        places = dict(zip(kept.tolist(), range(len(kept)), strict=True))
        layout = Layout(
            text.source, columns_of_it, {name: unit for name, unit in written.units.items() if unit is not None},
            frozenset(ignored), asked_for, ids, names, tuple(map(places.get, range(len(names)))),
        )  # fmt: skip
        stated = errors_of(source, covariance, layout, numbers, written.name)
    if stated is not None:
        found.notices.extend(stated.notices)
        stated = turned(stated, before, numbers, named_of(flip, text.name))
        numbers = with_sds(numbers, stated)
    check_ranges(numbers, found)
    for end in ("1", "2"):
        check_redundant(numbers, end, found)
    check_pairs(numbers, found)
    check_bounds(numbers, known, found)
    check_directions(numbers, found)
    _check_labels(texts, found)
    found.refuse(text.source, _hints(numbers, known) if rebound and found.faults else ())
    table = _assembled(replace(text, texts=texts, found=found), numbers, ids, stated)
    return replace(
        table,
        flipped=named_of(flip, text.name),
        ignored=ignored,
        columns=FrozenMapping(asked),
        ball_temperature=warmth,
    )


def _ignored(named: Sequence[str], text: Written, naming: Naming) -> tuple[str, ...]:
    """The measured columns of the rebound that are to be left out, by our names. Raises ParameterError for others."""
    having, ignored = [name for name in text.units if name in REBOUND], list[str]()
    for name in named:
        ours = our_column(name, naming)[0] or name
        if ours in INCIDENT:
            raise ParameterError(
                f"ignore: {ours} is of the incident ball, which every fit needs; columns that can be left out: "
                f"{', '.join(having)}"
            )
        if ours not in having:
            raise ParameterError(
                f"ignore: {text.source} has no rebound column '{name}' to leave out; {suggestion(name, having)}"
            )
        if ours not in ignored:
            ignored.append(ours)
    return tuple(ignored)


def _without(text: Written, ignored: Sequence[str]) -> Written:
    """A table without columns that are left out on request, and their sds; a notice for each."""
    for name in ignored:
        text.found.notice(f"{name} is left out, on request (ignore)", name)
    gone = {*ignored, *(name + SD_SUFFIX for name in ignored)}
    units, numbers = (
        {name: item for name, item in items.items() if name not in gone} for items in (text.units, text.numbers)
    )
    return replace(text, units=units, numbers=numbers)  # type: ignore[arg-type]


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


def _assembled(text: Written, columns: Columns, ids: tuple[str, ...], stated: Stated | None) -> ImpactTable:
    _note_sds(columns, text.found)
    impacts, incident_columns, incident_sd, covariance = _incident(columns, len(text.found.rows))
    counted = {*independent(columns, "2"), *(OBSERVABLES.keys() - VELOCITIES)}
    rebound = [_measurement(columns, name) for name in REBOUND if name in columns]
    whole = None if stated is None else whole_rows(columns, stated, [it.name for it in rebound if it.name in counted])
    if whole is not None and incident_sd:
        covariance = frozen(whole.values[:, : len(INCIDENT_UNITS), : len(INCIDENT_UNITS)])
        variances = np.einsum("kii->ki", covariance)
        incident_sd = {
            name: frozen(np.sqrt(variances[:, place]))
            for place, name in enumerate(INCIDENT_UNITS)
            if name in incident_sd
        }
    return ImpactTable(
        name=text.name,
        source=text.source,
        digest=text.digest if stated is None else sha256(f"{text.digest}{stated.digest}".encode()).hexdigest(),
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
        covariance=whole if whole is not None and together(whole) else None,
        files=text.files,
        covariance_files=FrozenMapping(
            {} if stated is None else {place: (stated.place, stated.digest) for place, _digest in text.files}
        ),
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
