"""From a source to a table: the whole road.

Source -> cells -> names -> numbers in SI -> flips, one sign, limits -> other forms become
velocities -> contradictions, energy -> gaps, labels -> `ImpactTable`. Faults are collected on the
way and refused together.
"""

import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypeAlias, TypedDict, Unpack

import numpy as np

from fitball.base.columns import COLUMNS, FLIGHTS, HEIGHTS, INCIDENT, RATIOS, REBOUND, SERIES
from fitball.base.errors import InputError, ParameterError, suggestion
from fitball.base.options import Names, read_texts
from fitball.base.text import as_pairs, column_head, from_pairs, listed
from fitball.base.values import Ball, DataFrame, FloatArray, IntArray
from fitball.data import checks
from fitball.data.bundled import path_of_source
from fitball.data.cells import TableCells, numbers
from fitball.data.energy import expected_noises, gained_energy
from fitball.data.error_columns import refusal_of_error
from fitball.data.forms import velocities_of_forms
from fitball.data.header import LABELS, Header, Naming, read_header
from fitball.data.kinematics import counting_columns
from fitball.data.labels import first_spelled
from fitball.data.misreading import Doubt, better_readings, repeated_rows
from fitball.data.placeholders import note_unused, note_zeros, without_codes
from fitball.data.proposals import note_unread, with_proposals
from fitball.data.repeats import in_rows
from fitball.data.scene import Scene, load_scene
from fitball.data.signs import counted_as_ours, note_backwards
from fitball.data.slips import note_slips
from fitball.data.sources import file_and_sheet, read_cells
from fitball.data.spatial import in_plane
from fitball.data.table import ImpactTable
from fitball.data.trials import (
    Attempt,
    Change,
    FileNames,
    columns_to_leave_out,
    tried_readings,
    tried_units,
    with_tried_guesses,
    with_tried_slips,
)

# A table, a file, `book.xlsx#sheet`, the name of a bundled table, a data frame, or columns by name.
TableSource: TypeAlias = ImpactTable | str | Path | DataFrame | Mapping[str, object]
# Columns (rows,) in SI by name, NaN in gaps.
_Columns: TypeAlias = dict[str, FloatArray]


class Reading(TypedDict, total=False):
    """Options of `load_table` that verbs pass on."""

    columns: Mapping[str, str] | None
    flip: Names
    ignore: Names


# Columns of a table of impacts that need not be there in a table of incident states.
_OPTIONAL_COLUMNS = (
    *LABELS,
    *REBOUND,
    *RATIOS,
    *SERIES,
    HEIGHTS[1],
    FLIGHTS[1],
    "surface_speed",
    *(f"{name}_sd" for name in COLUMNS),
)
# Fewest rows that determine the noise of a rebound.
_LEAST_ROWS = 2
# Share of rows with faults up to which these are slips, whatever the reading.
_MOST_SLIPS = 0.25


class _Numbers(NamedTuple):
    """Numbers of a file: `columns` in SI and `corr`, correlations by pair, counted as fitball
    counts.
    """

    columns: _Columns
    corr: _Columns


def load_table(
    source: TableSource,
    *,
    scene: Scene | None = None,
    columns: Mapping[str, str] | None = None,
    flip: Names = (),
    ignore: Names = (),
    rebound: bool = True,
) -> ImpactTable:
    """A table of impacts, read from a file, a DataFrame or a mapping of columns.

    The `scene` (default: that in the file beside the table) gives names, ignored columns and the
    ball. `columns` gives the file's names by fitball's, with the unit if the header has none.
    `flip` names columns whose sign, or zero of the angle, is the other one. `ignore` names columns,
    `NAME_sd` or `corr`. Without `rebound` incident columns suffice, and options may name columns
    that the table does not have.

    Example:
        >>> import fitball
        >>> columns = {"v_1 [km/h]": [60.0, 65.0], "theta_1 [deg]": [90, 90], "v_2 [m/s]": [12, 13]}
        >>> fitball.load_table(columns).values["v_1"].round(2)
        array([16.67, 18.06])

    Raises:
        InputError: The table cannot be read, or has faults, all of which are listed (the code of
            the first).
        FolderError: There is no such file (`not-found`).
        ParameterError: An option names no column (`unknown-column`, `columns`), `columns` is no
            mapping (`pairs`), or the source is no table (`not-a-table`).
    """
    file, name = located(source)
    options = _options_of(source, scene, rebound, columns=columns, flip=flip, ignore=ignore)
    cells = read_cells(file, options.naming.worth, name)
    if rebound and isinstance(file, Path) and "corr" not in options.ignore:
        _refuse_covariance_file(cells, file)
    return _table_of(cells, name, options)


class _Options(NamedTuple):
    """How a source, called `source`, is read, by the arguments of `load_table` and the scene; with
    `proposes` what else may be meant is looked for.
    """

    source: str
    scene: Scene
    naming: Naming
    flip: tuple[str, ...]
    ignore: tuple[str, ...]
    rebound: bool
    proposes: bool = True


def _options_of(
    source: TableSource,
    scene: Scene | None,
    rebound: bool,
    **reading: Unpack[Reading],
) -> _Options:
    """The options of a source, with those of its scene. Raises ParameterError."""
    file, name = located(source)
    scene = scene_beside(file) if scene is None else scene
    flip = reading.get("flip", ())
    ignore = reading.get("ignore", ())
    return _Options(
        str(file) if isinstance(file, Path) else name,
        scene,
        Naming({**scene.columns, **read_texts("columns", reading.get("columns"))}),
        _names((*_names(flip), *_names(scene.measurement.get("flip", ())))),
        _names((*_names(ignore), *_names(scene.measurement.get("ignore", ())))),
        rebound,
    )


def readings_in_words(
    doubts: Sequence[Doubt],
    source: TableSource,
    scene: Scene,
    **reading: Unpack[Reading],
) -> list[str]:
    """Sentences on other readings of a source with which it can be read, with what to do; of none
    of which that is known the best one alone. Raises what `load_table` raises.
    """
    if not doubts:
        return []
    if isinstance(source, ImpactTable):
        return tried_readings(doubts, _names_of_table(source), lambda _: True)
    file, name = located(source)
    options = _options_of(source, scene, True, **reading)
    written = read_cells(file, options.naming.worth, name)
    cells = in_rows(_fresh(written), options.naming)
    header = read_header(cells, options.naming)
    names = _names_of_file(cells, header, options)
    attempt = partial(_can_be_read, written, name, options)
    return tried_readings(doubts, names, attempt) or [doubts[0].said]


def _can_be_read(written: TableCells, name: str, options: _Options, change: Change) -> bool:
    """Whether a table as written is read, changed, without a fault but of few rows."""
    names = [change.header.get(cell, cell) for cell in written.names]
    try:
        naming = Naming({**options.scene.columns, **change.columns})
        changed = options._replace(
            naming=naming,
            flip=tuple(change.flip),
            ignore=(*options.ignore, *change.ignore),
            proposes=False,
        )
        _table_of(replace(_fresh(written), names=names), name, changed)
    except InputError as error:
        rows = {fault.row for fault in error.faults}
        return None not in rows and len(rows) <= _MOST_SLIPS * len(written.rows)
    except ParameterError:
        return False
    return True


def _fresh(cells: TableCells) -> TableCells:
    """Cells as they were written, without notes and faults of a reading."""
    return replace(cells, notes=[], faults=[], theirs={})


def _names_of_file(cells: TableCells, header: Header, options: _Options) -> FileNames:
    """How a file calls the columns that are read."""
    read = {ours: cells.names[index] for ours, index in header.numbers.items()}
    return FileNames(read, options.naming, options.flip)


def _names_of_table(table: ImpactTable) -> FileNames:
    """What a table that was read already has for the names of its file."""
    first = table.read[0] if table.read else {}
    naming = Naming(from_pairs(first.get("columns", "")))
    cells = {ours: naming.theirs.get(ours, ours) for ours in table.values}
    return FileNames(cells, naming, _names(first.get("flip", "")))


def _table_of(written: TableCells, name: str, options: _Options) -> ImpactTable:
    """The table of this `name` in cells. Raises InputError, ParameterError (`unknown-column`)."""
    source, scene, naming, flip, ignore, rebound, proposes = options
    attempt = partial(_can_be_read, _fresh(written), name, options)
    cells = in_rows(written, naming)
    header, names = _header_of(cells, options, attempt)
    note_unread(cells, header)
    if not rebound:
        present = (*header.numbers, "corr")
        flip = tuple(column for column in flip if column in present)
        ignore = tuple(column for column in ignore if column in present)
    _refuse_errors(cells, header, ignore)
    note_unused(cells, header)
    numbers_read = _numbers_of(cells, header, flip, ignore)
    within_limits = checks.limits(cells, numbers_read.columns, header.units)
    note_zeros(cells, within_limits, scene.ball_value())
    names_cor = "cor" in naming.columns
    forms = velocities_of_forms(
        cells, header, within_limits, numbers_read.corr, scene, names_cor=names_cor
    )
    checked = forms.columns
    _check_physics(cells, header, checked, within_limits, scene, rebound)
    values = _counting_values(checked)
    rows = _usable_rows(cells, values, rebound)
    if cells.faults:
        readings = []
        if proposes:
            doubts = _doubts(header, values, numbers_read.columns, scene.ball_value())
            readings = tried_readings(doubts, names, attempt)
            readings = readings or tried_units(cells.faults, names, attempt)
            cells.leave_out = columns_to_leave_out(cells.faults, names, attempt)
        _refuse_with_readings(cells, readings)
    sds = _sds(values, checked, rows)
    units = {column: header.units[column] for column in values if column in header.units}
    table = ImpactTable(
        name,
        values={column: array[rows] for column, array in values.items()},
        sd=sds,
        corr=_correlations(forms.corr, sds, rows),
        labels=_labels(cells, header, rows),
        read=(
            {
                "source": source,
                "sha256": cells.sha256,
                "columns": as_pairs(naming.columns),
                "flip": ",".join(flip),
                "ignore": ",".join(ignore),
                "units": as_pairs(units),
                **forms.read,
            },
        ),
    )
    for row in rows[table.impossible()].tolist():
        cells.fault("impossible-correlations", "correlations that no errors can have", None, row)
    cells.refuse()
    note_backwards(cells, checked, rows)
    note_slips(cells, within_limits, header.units)
    return replace(table, notices=(*cells.notes, *repeated_rows(table)))


def _header_of(cells: TableCells, options: _Options, attempt: Attempt) -> tuple[Header, FileNames]:
    """The header of a table, with proposals that were tried, and how the file calls its columns."""
    optional = () if options.rebound else _OPTIONAL_COLUMNS
    header = read_header(cells, options.naming, optional)
    header = with_proposals(cells, header, options.naming)
    names = _names_of_file(cells, header, options)
    if not options.proposes:
        return replace(header, guesses={}), names
    cells.faults = with_tried_slips(cells.faults, header, names, attempt)
    if header.guesses:
        header = with_tried_guesses(header, names, attempt)
    return header, names


def _refuse_errors(cells: TableCells, header: Header, ignore: Sequence[str]) -> None:
    """Add faults of errors that are no standard deviations, and are not ignored."""
    for name, words in header.refused_errors.items():
        if {name, name.removesuffix("_sd")}.isdisjoint(ignore):
            cells.fault("not-one-sd", refusal_of_error(name, words), name)


def _numbers_of(
    cells: TableCells,
    header: Header,
    flip: Sequence[str],
    ignore: Sequence[str],
) -> _Numbers:
    """The numbers of a file in SI, counted as fitball counts, without what is ignored. Raises
    ParameterError (`unknown-column`).
    """
    columns = {}
    corr = {}
    for name, array in _in_si(cells, header, ignore).items():
        if name.startswith("corr("):
            corr[_pair_in(name)] = array
        else:
            columns[name] = array
    measured = without_codes(cells, columns, header.factors)
    planar = in_plane(cells, measured, corr)
    turned, signs = counted_as_ours(cells, planar, flip, header.units)
    checks.deviations(cells, turned)
    for pair in corr:
        corr[pair] = corr[pair] * np.prod([signs.get(name, 1.0) for name in pair.split(",")])
    return _Numbers(turned, corr)


def _check_physics(
    cells: TableCells,
    header: Header,
    columns: _Columns,
    own: _Columns,
    scene: Scene,
    rebound: bool,
) -> None:
    """Add faults of columns that are missing, contradict others, or say that energy is gained.
    `own` are the columns of the file, before other forms became velocities.
    """
    measured = _measured(columns)
    checks.missing_columns(cells, measured, header.option, rebound)
    if counting_columns(measured, "1") in checks.INCIDENCES:
        checks.redundant(cells, columns, header.units)
        gained_energy(
            cells,
            columns,
            own,
            header.units,
            scene.ball_value(),
            expected_noises(scene),
            header.option,
        )


def _pair_in(name: str) -> str:
    """The pair A,B in the name of a column corr(A,B)."""
    return name.removeprefix("corr(").removesuffix(")")


def _measured(columns: _Columns) -> list[str]:
    """The columns of quantities, without their sds."""
    return [name for name in columns if name in COLUMNS]


def _counting_values(columns: _Columns) -> _Columns:
    """The columns that count, each information once, incident first."""
    measured = _measured(columns)
    velocities = {*counting_columns(measured, "1"), *counting_columns(measured, "2")}
    return {
        name: columns[name]
        for name in (*INCIDENT, *REBOUND)
        if name in measured and (name in velocities or not COLUMNS[name].of_velocity)
    }


def _doubts(
    header: Header,
    values: _Columns,
    with_outliers: _Columns,
    ball: Ball,
) -> tuple[Doubt, ...]:
    """Other readings that explain the columns of a table with faults far better, numbers beyond
    their limits included.
    """
    columns = {}
    if counting_columns(values, "1") in checks.INCIDENCES:
        columns = {name: with_outliers.get(name, array) for name, array in values.items()}
    return better_readings(columns, header.units, ball)


def _refuse_with_readings(cells: TableCells, readings: Sequence[str]) -> None:
    """Refuse a table with faults, and say which other readings explain it."""
    for note in cells.notes:
        if note.code == "zeros":
            # It may be why energy is gained.
            cells.fault(note.code, note.text)
    cells.refuse(readings)


def _sds(values: _Columns, columns: _Columns, rows: IntArray) -> _Columns:
    """Stated sds of the usable rows, NaN where nothing was measured."""
    sds = {}
    for name, array in values.items():
        if f"{name}_sd" in columns:
            sd = np.where(np.isnan(array), np.nan, columns[f"{name}_sd"])
            sds[name] = sd[rows]
    return sds


def _correlations(stated: _Columns, sds: _Columns, rows: IntArray) -> _Columns:
    """Stated correlations of the usable rows between columns with sds."""
    corr = {}
    for pair, array in stated.items():
        if all(name in sds for name in pair.split(",")):
            corr[pair] = array[rows]
    return corr


def _refuse_covariance_file(cells: TableCells, path: Path) -> None:
    """Add a fault where the second edition would have read correlations from a file beside the
    table: without them its fit is another.
    """
    beside = path.with_name(f"{path.stem}_covariance.csv")
    # Unlike that of Path, this answers for a name too long for the system.
    if os.path.exists(beside):  # noqa: PTH110
        text = (
            f"{beside.name} is there, which is not read: correlations stand in columns "
            "corr(a,b) of the table"
        )
        cells.fault(
            "covariance-file",
            f"{text}; add them, or leave them out with --ignore corr (ignore=)",
        )


def reading_of(table: ImpactTable) -> Reading:
    """How a table was read, as arguments of `load_table`: new impacts are read like those of the
    fit, in its units where they have none.
    """
    first = table.read[0] if table.read else {}
    units = from_pairs(first.get("units", ""))
    columns = from_pairs(first.get("columns", ""))
    for name, unit in units.items():
        their = columns.get(name, name)
        columns[name] = their if "[" in their else column_head(their, unit)
    return {"columns": columns, "flip": first.get("flip", "")}


def _names(option: object) -> tuple[str, ...]:
    """Names of an option, each once: A,B or a sequence."""
    names = list[str]()
    if isinstance(option, str):
        names = option.split(",") if option else []
    elif isinstance(option, Iterable):
        names = [*option]
    return tuple(dict.fromkeys(map(str.strip, names)))


def located(source: TableSource) -> tuple[TableSource, str]:
    """The path of a source that is a file, with its sheet, or the source in memory; what its table
    is called. Raises ParameterError (`not-a-table`), FolderError (`not-found`).
    """
    if isinstance(source, Mapping) or hasattr(source, "iloc"):
        attributes = getattr(source, "attrs", {})
        return source, str(attributes.get("name", "table"))
    if not isinstance(source, str | Path):
        read = f"read a table of type {type(source).__name__}"
        raise ParameterError(
            f"{read}; expected a file, a data frame, or columns by name",
            "not-a-table",
        )
    file, sheet = file_and_sheet(str(source))
    path = path_of_source(file)
    if sheet:
        return Path(f"{path}#{sheet}"), f"{path.stem}-{sheet}"
    return path, path.stem


def scene_beside(source: TableSource, path: str | Path | None = None) -> Scene:
    """The scene in the file at `path`, or that beside a file of impacts."""
    file = None
    if isinstance(source, Path):
        name, _ = file_and_sheet(str(source))
        if Path(name).is_file():
            file = Path(name)
    return load_scene(file, path or None)


def _in_si(cells: TableCells, header: Header, ignore: Sequence[str]) -> _Columns:
    """Columns of numbers in SI without those that are ignored or empty. Raises ParameterError
    (`unknown-column`).
    """

    def is_used(name: str) -> bool:
        concerned = {name, name.removesuffix("_sd")}
        if name.startswith("corr("):
            concerned = {"corr", *_pair_in(name).split(",")}
        return concerned.isdisjoint(ignore)

    used = {name: index for name, index in header.numbers.items() if is_used(name)}
    written = numbers(cells, used)
    for name in {*ignore} - {"corr", *header.numbers, *header.refused_errors, *written}:
        hint = suggestion(name, header.numbers)
        raise ParameterError(
            f"ignore: {cells.source} has no column '{name}'; {hint}",
            "unknown-column",
        )
    if ignore:
        cells.note("ignored", f"not used, as requested: {listed(ignore)}")
    columns = {}
    # Sds behind ± come with their column.
    for name, values in written.items():
        factor = header.factors.get(name) or header.factors[name.removesuffix("_sd")]
        if is_used(name):
            columns[name] = values * factor
    for name in header.shares:
        base = name.removesuffix("_sd")
        if name in columns and base in columns:
            # A share of nothing is no error.
            size = np.where(columns[base] == 0.0, np.nan, np.abs(columns[base]))
            columns[name] *= size
    if len(cells.rows):
        faulty = {fault.column for fault in cells.faults}
        for name in [*columns]:
            if np.isnan(columns[name]).all() and name not in faulty:
                cells.note("empty-column", f"{name} has no numbers: read as if it were not there")
                del columns[name]
    return columns


def _usable_rows(cells: TableCells, values: _Columns, rebound: bool) -> IntArray:
    """Indices of the rows that have an incident state and, with `rebound`, at least one number of
    the rebound. Others are noted; where too few remain, that is a fault (`few-rows`).
    """
    gaps = {name: np.isnan(array) for name, array in values.items()}
    before = [gaps[name] for name in gaps if name in INCIDENT]
    after = [gaps[name] for name in gaps if name in REBOUND]
    unusable = np.any(before or [cells.rows < 0], axis=0)
    if rebound and after:
        unusable |= np.all(after, axis=0)
    usable = np.flatnonzero(~unusable)
    least = _LEAST_ROWS if rebound else 1
    row_numbers = listed(cells.rows[unusable].astype(str)) or "none"
    why = f"rows without incident state or rebound: {row_numbers}"
    if len(usable) < least and not cells.faults:
        words = f"{len(usable)} rows can be used; expected at least {least} ({why})"
        cells.fault("few-rows", words)
    elif unusable.any():
        cells.note("rows-left-out", f"left out are {why}")
    return usable


def _labels(cells: TableCells, header: Header, rows: IntArray) -> dict[str, tuple[str, ...]]:
    """Texts of the usable rows by column. `id` is first, unique, and by default the number of the
    row; other labels have the spelling of their first use.
    """
    usable = rows.tolist()
    texts = {}
    for name, index in header.labels.items():
        column = cells.text(index)
        texts[name] = [column[row] for row in usable]
    numbered = cells.rows[rows].astype(str).tolist()
    ids = texts.pop("id", numbered)
    unique = unique_ids(ids, numbered)
    if unique != ids:
        cells.note("ids", "ids that are empty or repeated were made unique")
    labels = {"id": tuple(unique)}
    for name, column in texts.items():
        labels[name] = first_spelled(column)
        respelled = list[str]()
        for text, first in zip(map(str.strip, column), labels[name], strict=True):
            if text != first:
                respelled.append(f"'{text}' as '{first}'")
        if respelled:
            cells.note("spellings", f"{name}: {listed(dict.fromkeys(respelled))}")
    return labels


def unique_ids(ids: Sequence[str], numbered: Sequence[str]) -> list[str]:
    """The ids, those that are empty or repeated with the number of the row behind them; the numbers
    alone where that does not make them unique.
    """
    count = Counter(ids)
    unique = []
    for text, number in zip(ids, numbered, strict=True):
        is_unique = text and count[text] == 1
        unique.append(text if is_unique else f"{text} ({number})".strip())
    return unique if len({*unique}) == len(unique) else [*numbered]
