"""The road from a source to a table.

Source -> cells -> names -> numbers in SI -> flips, one sign, limits -> heights become speeds ->
contradictions, energy -> gaps, labels -> `ImpactTable`. Faults are collected on the way and refused
together.
"""

import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from fitball.base.columns import COLUMNS, INCIDENT, REBOUND
from fitball.base.errors import Fault, InputError, Note, ParameterError, suggestion
from fitball.base.priors import ParameterSpec, parse_prior
from fitball.base.text import column_head, listed
from fitball.base.values import Ball, FloatArray, IntArray
from fitball.data import checks
from fitball.data.bundled import path_of_source
from fitball.data.cells import TableCells, file_and_sheet, numbers, read_cells
from fitball.data.header import LABELS, Header, Naming, read_header
from fitball.data.heights import heights_read, speeds_of_heights
from fitball.data.kinematics import counting_columns
from fitball.data.labels import first_spelled
from fitball.data.misreading import better_readings, doubts, repeated_rows
from fitball.data.scene import Scene, load_scene
from fitball.data.table import ImpactTable, join_tables

# A table, a file, `book.xlsx#sheet`, the name of a bundled one, a data frame, or columns by name.
TableSource: TypeAlias = Any
Names: TypeAlias = str | Sequence[str]
# Columns (rows,) by name, NaN in gaps.
Columns: TypeAlias = dict[str, FloatArray]

# Columns of a table of impacts that need not be there in a table of incident states.
_OF_ANOTHER_TABLE = (*LABELS, *REBOUND, *(f"{name}_sd" for name in COLUMNS))
# Fewest rows that determine the noise of a rebound; one row does not.
_LEAST_ROWS = 2


class _Numbers(NamedTuple):
    """Numbers of a file on their way: `columns` (rows,) in SI; correlations by pair; the sign by
    which errors of a column turn with it.
    """

    columns: Columns
    corr: Columns
    signs: Mapping[str, float]


def load_table(
    source: TableSource,
    *,
    scene: Scene | None = None,
    columns: Mapping[str, str] | None = None,
    flip: Names = (),
    ignore: Names = (),
    rebound: bool = True,
) -> ImpactTable:
    """A table of impacts. The scene (default: beside the file) gives names, ignored columns and the
    ball; `columns` our names to the file's, with the unit if the header has none; `ignore` names
    columns, `NAME_sd` or `corr`. Without `rebound` incident columns suffice, and what is said of
    others concerns another table. Raises InputError with every fault, FolderError (`not-found`),
    ParameterError (`unknown-column`, `not-a-table`).
    """
    source, name = _place_and_name(source)
    scene = _scene(source) if scene is None else scene
    naming = Naming({**scene.columns, **(columns or {})})
    flip = _names((*_names(flip), *_names(scene.measurement.get("flip", ()))))
    ignore = _names((*_names(ignore), *_names(scene.measurement.get("ignore", ()))))
    cells = read_cells(source, naming.worth, name)
    header = read_header(cells, naming, () if rebound else _OF_ANOTHER_TABLE)
    if not rebound:
        present = (*header.numbers, "corr")
        flip = tuple(column for column in flip if column in present)
        ignore = tuple(column for column in ignore if column in present)
    if rebound and isinstance(source, Path) and "corr" not in ignore:
        _refuse_covariance_file(cells, source)
    numbers_read = _numbers_of(cells, header, flip, ignore)
    within_limits = checks.limits(cells, numbers_read.columns, header.units)
    checked = speeds_of_heights(cells, within_limits, scene)
    _check_physics(cells, header, checked, scene, rebound)
    values = _counting_values(checked)
    rows = _usable_rows(cells, values, rebound)
    if cells.faults:
        _refuse_with_readings(cells, header, values, numbers_read.columns, scene.ball_value())
    sds = _sds(values, checked, rows)
    units = {column: header.units[column] for column in values if column in header.units}
    table = ImpactTable(
        name,
        values={column: array[rows] for column, array in values.items()},
        sd=sds,
        corr=_correlations(numbers_read, sds, rows),
        labels=_labels(cells, header, rows),
        read=(
            {
                "source": str(source) if isinstance(source, Path) else name,
                "sha256": cells.sha256,
                "columns": _pairs(naming.columns),
                "flip": ",".join(flip),
                "ignore": ",".join(ignore),
                "units": _pairs(units),
                **heights_read(within_limits, scene),
            },
        ),
    )
    for row in rows[table.impossible()].tolist():
        cells.fault("impossible-correlations", "correlations that no errors can have", None, row)
    cells.refuse()
    return replace(table, notices=(*cells.notes, *repeated_rows(table)))


def _numbers_of(
    cells: TableCells,
    header: Header,
    flip: Sequence[str],
    ignore: Sequence[str],
) -> _Numbers:
    """The numbers of a file in SI, counted as we count, without what is ignored. Raises
    ParameterError (`unknown-column`).
    """
    columns = _in_si(cells, header, ignore)
    corr = {}
    for name in [name for name in columns if name.startswith("corr(")]:
        pair = name.removeprefix("corr(").removesuffix(")")
        corr[pair] = columns.pop(name)
    turned, signs = _turned(cells, columns, flip, header.units)
    checks.deviations(cells, turned)
    return _Numbers(turned, corr, signs)


def _check_physics(
    cells: TableCells,
    header: Header,
    columns: Columns,
    scene: Scene,
    rebound: bool,
) -> None:
    """Add faults of columns that are missing, contradict others, or say that energy is gained."""
    measured = _measured(columns)
    checks.missing_columns(cells, measured, header.guesses, rebound)
    if counting_columns(measured, "1") in checks.INCIDENCES:
        checks.redundant(cells, columns, header.units)
        noises = _noises(scene)
        checks.energy(cells, columns, header.units, scene.ball_value(), noises)


def _measured(columns: Columns) -> list[str]:
    """The columns of quantities, without their sds."""
    return [name for name in columns if name in COLUMNS]


def _counting_values(columns: Columns) -> Columns:
    """The columns that count, each information once, incident first."""
    measured = _measured(columns)
    velocities = {*counting_columns(measured, "1"), *counting_columns(measured, "2")}
    return {
        name: columns[name]
        for name in (*INCIDENT, *REBOUND)
        if name in measured and (name in velocities or not COLUMNS[name].of_velocity)
    }


def _refuse_with_readings(
    cells: TableCells,
    header: Header,
    values: Columns,
    with_outliers: Columns,
    ball: Ball,
) -> None:
    """Refuse a table with faults, and say which other readings explain its columns far better,
    numbers beyond their limits included.
    """
    columns = {}
    if counting_columns(values, "1") in checks.INCIDENCES:
        columns = {name: with_outliers.get(name, array) for name, array in values.items()}
    cells.refuse([reading.text for reading in better_readings(columns, header.units, ball)])


def _sds(values: Columns, columns: Columns, rows: IntArray) -> Columns:
    """Stated sds of the usable rows, NaN where nothing was measured."""
    sds = {}
    for name, array in values.items():
        if f"{name}_sd" in columns:
            sds[name] = np.where(np.isnan(array), np.nan, columns[f"{name}_sd"])[rows]
    return sds


def _correlations(numbers_read: _Numbers, sds: Columns, rows: IntArray) -> Columns:
    """Stated correlations of the usable rows between columns with sds."""
    corr = {}
    for pair, array in numbers_read.corr.items():
        names = pair.split(",")
        if all(name in sds for name in names):
            sign = np.prod([numbers_read.signs.get(name, 1.0) for name in names])
            corr[pair] = array[rows] * sign
    return corr


def _refuse_covariance_file(cells: TableCells, place: Path) -> None:
    """Add a fault where the second edition would have read correlations of the table: without them
    its fit is another.
    """
    beside = place.with_name(f"{place.stem}_covariance.csv")
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


def reading_of(table: ImpactTable) -> dict[str, Any]:
    """How a table was read, as arguments of `load_table`: new impacts are read like those of the
    fit, in its units where they have none.
    """
    first = table.read[0] if table.read else {}
    units = _from_pairs(first.get("units", ""))
    columns = _from_pairs(first.get("columns", ""))
    for name, unit in units.items():
        their = columns.get(name, name)
        columns[name] = their if "[" in their else column_head(their, unit)
    return {"columns": columns, "flip": first.get("flip", "")}


def _pairs(items: Mapping[str, str]) -> str:
    """A mapping as NAME=TEXT,NAME=TEXT."""
    return ",".join(f"{name}={text}" for name, text in items.items())


def _from_pairs(text: str) -> dict[str, str]:
    """The mapping of a text NAME=TEXT,NAME=TEXT; a TEXT may have commas."""
    pairs = re.split(r",(?=\w+=)", text)
    return dict(pair.split("=", 1) for pair in pairs if pair)


def _names(option: Any) -> tuple[str, ...]:
    """Names of an option, each once: A,B or a sequence."""
    names = option
    if isinstance(option, str) and option:
        names = option.split(",")
    return tuple(dict.fromkeys(map(str.strip, names)))


def _place_and_name(source: TableSource) -> tuple[TableSource, str]:
    """The file of a source, with its sheet, or the source in memory; what its table is called.
    Raises ParameterError (`not-a-table`), FolderError (`not-found`).
    """
    if isinstance(source, Mapping) or hasattr(source, "iloc"):
        return source, str(getattr(source, "attrs", {}).get("name", "table"))
    if not isinstance(source, str | Path):
        read = f"read a table of type {type(source).__name__}"
        raise ParameterError(
            f"{read}; expected a file, a data frame, or columns by name",
            "not-a-table",
        )
    file, sheet = file_and_sheet(str(source))
    place = path_of_source(file)
    if sheet:
        return Path(f"{place}#{sheet}"), f"{place.stem}-{sheet}"
    return place, place.stem


def _scene(source: TableSource, place: str | Path | None = None) -> Scene:
    """The scene in the file at `place`, or that beside a file of impacts."""
    file = None
    if isinstance(source, Path):
        file = Path(file_and_sheet(str(source))[0])
        if not file.is_file():
            file = None
    return load_scene(file, place or None)


def _in_si(cells: TableCells, header: Header, ignore: Sequence[str]) -> Columns:
    """Numbers (rows,) in SI without what is ignored or empty. Raises ParameterError
    (`unknown-column`).
    """

    def is_used(name: str) -> bool:
        parts = {name, name.removesuffix("_sd")}
        if name.startswith("corr("):
            pair = name.removeprefix("corr(").removesuffix(")")
            parts = {"corr", *pair.split(",")}
        return parts.isdisjoint(ignore)

    places = {name: place for name, place in header.numbers.items() if is_used(name)}
    written = numbers(cells, places)
    for name in {*ignore} - {"corr", *header.numbers, *written}:
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
    if len(cells.rows):
        faulty = {fault.column for fault in cells.faults}
        for name in [*columns]:
            if np.isnan(columns[name]).all() and name not in faulty:
                cells.note("empty-column", f"{name} has no numbers: read as if it were not there")
                del columns[name]
    return columns


def _turned(
    cells: TableCells,
    columns: Columns,
    flip: Sequence[str],
    units: Mapping[str, str],
) -> tuple[Columns, dict[str, float]]:
    """Numbers counted as we count, and the sign by which errors of a column turn with it. Raises
    ParameterError (`unknown-column`).
    """
    flipped = dict(columns)
    signs = dict[str, float]()
    can_flip = [name for name in columns if name in COLUMNS and COLUMNS[name].opposite]
    for name in flip:
        if name not in can_flip:
            hint = suggestion(name, can_flip)
            words = f"flip: {cells.source} has no column '{name}' to flip; {hint}"
            raise ParameterError(words, "unknown-column")
        opposite = COLUMNS[name].opposite
        if opposite == "negated":
            flipped[name] = -columns[name]
        else:
            flipped[name] = np.pi / 2.0 - columns[name]
        signs[name] = -1.0
        cells.note("flipped", f"{name} is read {opposite}, as requested")
    turned = checks.one_sign(cells, flipped, units)
    for name in columns:
        if turned[name] is not flipped[name]:
            signs[name] = -signs.get(name, 1.0)
    return turned, signs


def _noises(scene: Scene) -> dict[str, float]:
    """Noise of rebound columns [SI] that state no errors: what the scene says, else the median of
    its prior.
    """
    noises = {}
    for name in REBOUND:
        spec = COLUMNS[name].noise
        if spec is None:
            continue
        stated = _stated_noise(scene, spec)
        if stated is None:
            usual = parse_prior(spec)
            stated = float(usual.value(np.array(usual.location)))
        noises[name] = stated
    return noises


def _stated_noise(scene: Scene, spec: ParameterSpec) -> float | None:
    """The sd that a scene states for a noise parameter, held or nominal, or for all velocities."""
    names = [spec.name]
    if spec.unit == "m/s":
        names.append("velocity_sd")
    for name in names:
        for key in (name, f"nominal_{name}"):
            stated = scene.measurement.get(key)
            if isinstance(stated, float | int):
                return stated
    return None


def _usable_rows(cells: TableCells, values: Columns, rebound: bool) -> IntArray:
    """Places of the rows of which the incident state and, with `rebound`, something of the rebound
    is known; a note on the others, a fault (`few-rows`) where fewer than two are left: one does not
    determine its noise.
    """
    gaps = {name: np.isnan(array) for name, array in values.items()}
    before = [gaps[name] for name in gaps if name in INCIDENT]
    after = [gaps[name] for name in gaps if name in REBOUND]
    unusable = np.any(before or [cells.rows < 0], axis=0)
    if rebound and after:
        unusable |= np.all(after, axis=0)
    usable = np.flatnonzero(~unusable)
    least = _LEAST_ROWS if rebound else 1
    numbers_of = listed(cells.rows[unusable].astype(str)) or "none"
    why = f"rows without incident state or rebound: {numbers_of}"
    if len(usable) < least and not cells.faults:
        words = f"{len(usable)} rows can be used; expected at least {least} ({why})"
        cells.fault("few-rows", words)
    elif unusable.any():
        cells.note("rows-left-out", f"left out are {why}")
    return usable


def _labels(cells: TableCells, header: Header, rows: IntArray) -> dict[str, tuple[str, ...]]:
    """Texts of the usable rows by column, `id` first: unique, by default the number of the row;
    others in one spelling.
    """
    places = rows.tolist()
    texts = {}
    for name, place in header.labels.items():
        column = cells.text(place)
        texts[name] = [column[row] for row in places]
    numbered = cells.rows[rows].astype(str).tolist()
    ids = texts.pop("id", numbered)
    unique = _unique(ids, numbered)
    if unique != ids:
        cells.note("ids", "ids that are empty or repeated were made unique")
    labels = {"id": tuple(unique)}
    for name, column in texts.items():
        labels[name] = first_spelled(column)
        respelled = dict.fromkeys(
            f"'{text.strip()}' as '{first}'"
            for text, first in zip(column, labels[name], strict=True)
            if text.strip() != first
        )
        if respelled:
            cells.note("spellings", f"{name}: {listed(respelled)}")
    return labels


def _unique(ids: Sequence[str], numbered: Sequence[str]) -> list[str]:
    """Ids; of those that are empty or repeated with the number of the row, which all are where that
    is not enough.
    """
    count = Counter(ids)
    unique = []
    for text, number in zip(ids, numbered, strict=True):
        is_unique = text and count[text] == 1
        unique.append(text if is_unique else f"{text} ({number})".strip())
    return unique if len({*unique}) == len(unique) else [*numbered]


def load_data(
    sources: TableSource, scene: Scene | str | Path | None, as_read: bool, **reading: Any
) -> tuple[ImpactTable, Scene]:
    """What every fit begins with: one or several tables joined, the scene that is passed or that
    beside the first, doubts refused (InputError `misread`) or, `as_read`, noted. Scenes of further
    tables must name the same ball (`scenes-differ`). Raises ParameterError (`no-data`) without any.
    """
    pairs = [_table_and_scene(source, scene, reading) for source in list_of_sources(sources)]
    if not pairs:
        raise ParameterError(
            "no table was given; expected files, data frames, or names of bundled ones",
            "no-data",
        )
    first_scene = pairs[0][1]
    notes = list[Note]()
    for table, own_scene in pairs:
        if own_scene.ball != first_scene.ball:
            words = (
                "the scene beside this table names another ball than that of the first; "
                "expected one ball, or one scene for all (--scene)"
            )
            raise InputError(table.name, [Fault("scenes-differ", words)])
        readings = [doubt.text for doubt in doubts(table, first_scene.ball_value())]
        if readings and not as_read:
            words = (
                "another reading of the columns fits the data much better; if the table is "
                "right, pass --as-read"
            )
            raise InputError(table.name, [Fault("misread", words)], readings)
        notes += [Note("misread", f"{table.name}: {text}") for text in readings]
    tables = [table for table, _ in pairs]
    # Files of several folders may have one name.
    numbered = [str(k + 1) for k in range(len(tables))]
    names = _unique([table.name for table in tables], numbered)
    named = [replace(table, name=name) for table, name in zip(tables, names, strict=True)]
    table = join_tables(named)
    return replace(table, notices=(*table.notices, *notes)), first_scene


def list_of_sources(sources: TableSource) -> list[TableSource]:
    """The sources of one argument: those of a list, one, or none (None)."""
    if sources is None:
        return []
    return [*sources] if isinstance(sources, list | tuple) else [sources]


def _table_and_scene(
    source: TableSource,
    scene: Scene | str | Path | None,
    reading: Mapping[str, Any],
) -> tuple[ImpactTable, Scene]:
    """A table and its scene, that which is passed or that beside it. Raises ParameterError
    (`read-already`), and what `load_table` does.
    """
    if isinstance(source, ImpactTable):
        if any(reading.values()):
            options = listed(reading, "or")
            words = f"{source.name} has been read already; pass {options} to load_table"
            raise ParameterError(words, "read-already")
        place = Path(source.read[0]["source"]) if source.read else source
        return source, scene if isinstance(scene, Scene) else _scene(place, scene)
    place, _ = _place_and_name(source)
    if not isinstance(scene, Scene):
        scene = _scene(place, scene)
    return load_table(source, scene=scene, **reading), scene
