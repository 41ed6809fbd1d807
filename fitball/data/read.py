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
from typing import Any, TypeAlias

import numpy as np

from fitball.base.columns import COLUMNS, HEIGHTS, INCIDENT, REBOUND
from fitball.base.errors import Fault, InputError, Note, ParameterError, suggestion
from fitball.base.itf import GRAVITY
from fitball.base.priors import parse_prior
from fitball.base.text import column_head, listed
from fitball.base.values import FloatArray, IntArray
from fitball.data import checks
from fitball.data.bundled import place_of
from fitball.data.cells import Cells, file_and_sheet, numbers, read_cells
from fitball.data.header import LABELS, Header, Naming, read_header
from fitball.data.kinematics import counted
from fitball.data.labels import first_spelled
from fitball.data.misreading import better_readings, doubts, repeated_rows
from fitball.data.scene import Scene, load_scene
from fitball.data.table import ImpactTable, joined

# A table, a file, `book.xlsx#sheet`, the name of a bundled one, a data frame, or columns by name.
Source: TypeAlias = Any
Names: TypeAlias = str | Sequence[str]
Known: TypeAlias = dict[str, FloatArray]


def load_table(
    source: Source,
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
    source, name = _found(source)
    scene = _scene(source) if scene is None else scene
    columns = {**scene.columns, **(columns or {})}
    flip = _names((*_names(flip), *_names(scene.measurement.get("flip", ()))))
    ignore = _names((*_names(ignore), *_names(scene.measurement.get("ignore", ()))))
    naming = Naming(columns)
    cells = read_cells(source, naming.worth, name)
    header = read_header(
        cells,
        naming,
        () if rebound else (*LABELS, *REBOUND, *(f"{name}_sd" for name in COLUMNS)),
    )
    if not rebound:
        flip, ignore = (
            tuple(name for name in names if name in (*header.numbers, "corr"))
            for names in (flip, ignore)
        )
    units = header.units
    if rebound and isinstance(source, Path) and "corr" not in ignore:
        _check_beside(cells, source)
    known = _known(cells, header, ignore)
    corr = {item[5:-1]: known.pop(item) for item in [*known] if item.startswith("corr(")}
    known, signs = _turned(cells, known, flip, units)
    checks.deviations(cells, known)
    all_of_it = known
    known = _speeds(cells, checks.limits(cells, known, units))
    measured = [item for item in known if item in COLUMNS]
    checks.missing_columns(cells, measured, header.guesses, rebound)
    if complete := counted(measured, "1") in checks.INCIDENCES:
        checks.redundant(cells, known, units)
        checks.energy(cells, known, units, scene.ball_value(), _noises(scene))
    values = _fitted(known, measured)
    rows = _rows(cells, values, rebound)
    if cells.faults:
        whole = {item: all_of_it.get(item, array) for item, array in values.items()}
        readings = better_readings(whole if complete else {}, units, scene.ball_value())
        cells.refuse([reading.text for reading in readings])
    sds, stated = _stated(known, values, corr, signs, rows)
    read = {"source": str(source) if isinstance(source, Path) else name, "sha256": cells.sha256}
    read |= {"columns": _pairs(naming.columns), "flip": ",".join(flip), "ignore": ",".join(ignore)}
    read |= {"units": _pairs({item: units[item] for item in values if item in units})}
    values = {item: array[rows] for item, array in values.items()}
    labels = _labels(cells, header, rows)
    table = ImpactTable(name, values, sds, stated, labels, read=(read,))
    for row in rows[table.impossible()].tolist():
        cells.fault("impossible-correlations", "correlations that no errors can have", None, row)
    cells.refuse()
    return replace(table, notices=(*cells.notes, *repeated_rows(table)))


def _fitted(known: Known, measured: Sequence[str]) -> Known:
    """Incidence and rebound without what other columns say already."""
    counts = {*counted(measured, "1"), *counted(measured, "2")}
    return {
        item: known[item]
        for item in (*INCIDENT, *REBOUND)
        if item in measured and (item in counts or not COLUMNS[item].of_velocity)
    }


def _stated(
    known: Known,
    values: Known,
    corr: Known,
    signs: Mapping[str, float],
    rows: IntArray,
) -> tuple[Known, Known]:
    """Stated standard deviations of the `rows` that are used, by column, and correlations by pair,
    which turn their sign with the columns.
    """
    sds = {item: known[f"{item}_sd"] for item in values if f"{item}_sd" in known}
    sds = {item: np.where(np.isnan(values[item]), np.nan, sd)[rows] for item, sd in sds.items()}
    stated = {pair: array[rows] for pair, array in corr.items() if {*pair.split(",")} <= {*sds}}
    for pair in stated:
        stated[pair] *= np.prod([signs.get(item, 1.0) for item in pair.split(",")])
    return sds, stated


def _check_beside(cells: Cells, place: Path) -> None:
    """A fault where the second edition would have read correlations of the table: without them its
    fit is another.
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
    units, columns = (
        dict(pair.split("=", 1) for pair in re.split(r",(?=\w+=)", first.get(part, "")) if pair)
        for part in ("units", "columns")
    )
    for name, unit in units.items():
        their = columns.get(name, name)
        columns[name] = their if "[" in their else column_head(their, unit)
    return {"columns": columns, "flip": first.get("flip", "")}


def _pairs(items: Mapping[str, str]) -> str:
    return ",".join(f"{one}={other}" for one, other in items.items())


def _names(given: Any) -> tuple[str, ...]:
    """Names of an option: A,B or a sequence."""
    return tuple(
        dict.fromkeys(
            map(str.strip, given.split(",") if isinstance(given, str) and given else given)
        )
    )


def _found(source: Source) -> tuple[Source, str]:
    """The file of a source, with its sheet, or the source in memory; what its table is called."""
    if isinstance(source, Mapping) or hasattr(source, "iloc"):
        return source, str(getattr(source, "attrs", {}).get("name", "table"))
    if not isinstance(source, str | Path):
        read = f"read a table of type {type(source).__name__}"
        raise ParameterError(
            f"{read}; expected a file, a data frame, or columns by name",
            "not-a-table",
        )
    file, sheet = file_and_sheet(str(source))
    place = place_of(file)
    return (Path(f"{place}#{sheet}"), f"{place.stem}-{sheet}") if sheet else (place, place.stem)


def _scene(source: Source, given: str | Path | None = None) -> Scene:
    """The scene that is given, or that beside a file."""
    file = Path(file_and_sheet(str(source))[0]) if isinstance(source, Path) else None
    return load_scene(file if file and file.is_file() else None, given or None)


def _known(cells: Cells, header: Header, ignore: Sequence[str]) -> Known:
    """Numbers (rows,) in SI without what is ignored or empty. Raises ParameterError
    (`unknown-column`).
    """

    def used(name: str) -> bool:
        parts = (
            ["corr", *name[5:-1].split(",")]
            if name.startswith("corr(")
            else [name, name.removesuffix("_sd")]
        )
        return {*parts}.isdisjoint(ignore)

    written = numbers(cells, {name: place for name, place in header.numbers.items() if used(name)})
    for name in {*ignore} - {"corr", *header.numbers, *written}:
        hint = suggestion(name, header.numbers)
        raise ParameterError(
            f"ignore: {cells.source} has no column '{name}'; {hint}",
            "unknown-column",
        )
    if ignore:
        cells.note("ignored", f"not used, as requested: {listed(ignore)}")
    factors = {
        name: header.factors.get(name) or header.factors[name.removesuffix("_sd")]
        for name in written
    }
    known = {name: values * factors[name] for name, values in written.items() if used(name)}
    spared = {fault.column for fault in cells.faults}
    empty = [
        name for name, values in known.items() if np.isnan(values).all() and name not in spared
    ]
    for name in empty if len(cells.rows) else []:
        cells.note("empty-column", f"{name} has no numbers: read as if it were not there")
        del known[name]
    return known


def _turned(
    cells: Cells,
    known: Known,
    flip: Sequence[str],
    units: Mapping[str, str],
) -> tuple[Known, dict[str, float]]:
    """Numbers counted as we count, and the sign by which errors of a column turn with it. Raises
    ParameterError (`unknown-column`).
    """
    flipped = dict(known)
    can = [name for name in known if name in COLUMNS and COLUMNS[name].opposite]
    for name in flip:
        if name not in can:
            words = f"flip: {cells.source} has no column '{name}' to flip; {suggestion(name, can)}"
            raise ParameterError(words, "unknown-column")
        flipped[name] = (
            -known[name] if COLUMNS[name].opposite == "negated" else np.pi / 2.0 - known[name]
        )
        cells.note("flipped", f"{name} is read {COLUMNS[name].opposite}, as requested")
    turned = checks.one_sign(cells, flipped, units)
    signs = dict.fromkeys(flip, -1.0)
    return turned, signs | {
        name: -signs.get(name, 1.0) for name in known if turned[name] is not flipped[name]
    }


def _speeds(cells: Cells, known: Known) -> Known:
    """Speeds of free fall, v = sqrt(2 g h), for heights; their sds to first order."""
    made = dict(known)
    for name, speed in zip(HEIGHTS, ("v_y1", "v_y2"), strict=True):
        height = made.pop(name, None)
        sd = made.pop(f"{name}_sd", None)
        if height is not None and speed in known:
            cells.fault(
                "height-and-speed",
                f"says the same as {speed}: leave one of them out (--ignore)",
                name,
            )
        elif height is not None:
            made[speed] = np.sqrt(2.0 * GRAVITY * np.abs(height))
            made |= {} if sd is None else {f"{speed}_sd": GRAVITY * sd / made[speed]}
            cells.note(
                "heights",
                f"{name}: {speed} = sqrt(2 g h), without air drag, h at the bottom of the ball",
            )
    return made


def _noises(scene: Scene) -> dict[str, float]:
    """Noise of rebound columns [SI] that state no errors: what the scene says, else the median of
    its prior.
    """
    found = {}
    for name, spec in [(name, COLUMNS[name].noise) for name in REBOUND]:
        if spec is not None:
            names = [spec.name, *(["velocity_sd"] if spec.unit == "m/s" else [])]
            said = [
                scene.measurement.get(f"{prefix}{one}")
                for one in names
                for prefix in ("", "nominal_")
            ]
            stated = [one for one in said if isinstance(one, float | int)]
            usual = parse_prior(spec)
            found[name] = stated[0] if stated else float(usual.value(np.array(usual.location)))
    return found


def _rows(cells: Cells, values: Known, rebound: bool) -> IntArray:
    """Places of the rows of which the incident state and, with `rebound`, something of the rebound
    is known; a note on the others, a fault (`few-rows`) where fewer than two are left: one does not
    determine its noise.
    """
    gaps = {name: np.isnan(array) for name, array in values.items()}
    unusable = np.any([gaps[name] for name in gaps if name in INCIDENT] or [cells.rows < 0], axis=0)
    if rebound and (after := [gaps[name] for name in gaps if name in REBOUND]):
        unusable |= np.all(after, axis=0)
    kept = np.flatnonzero(~unusable)
    least = 1 + rebound
    why = (
        "rows without incident state or rebound: "
        f"{listed(cells.rows[unusable].astype(str)) or 'none'}"
    )
    if len(kept) < least and not cells.faults:
        cells.fault("few-rows", f"{len(kept)} rows can be used; expected at least {least} ({why})")
    elif unusable.any():
        cells.note("rows-left-out", f"left out are {why}")
    return kept


def _labels(cells: Cells, header: Header, rows: IntArray) -> dict[str, tuple[str, ...]]:
    """Texts by column, `id` first: unique, by default the number of the row; others in one
    spelling.
    """
    written = {name: cells.text(place) for name, place in header.labels.items()}
    texts = {name: [column[row] for row in rows.tolist()] for name, column in written.items()}
    numbered = cells.rows[rows].astype(str).tolist()
    ids = texts.pop("id", numbered)
    found = {"id": tuple(_unique(ids, numbered))}
    if [*found["id"]] != ids:
        cells.note("ids", "ids that are empty or repeated were made unique")
    for name, column in texts.items():
        found[name] = first_spelled(column)
        pairs = zip(column, found[name], strict=True)
        if other := dict.fromkeys(
            f"'{one.strip()}' as '{first}'" for one, first in pairs if one.strip() != first
        ):
            cells.note("spellings", f"{name}: {listed(other)}")
    return found


def _unique(ids: Sequence[str], numbered: Sequence[str]) -> list[str]:
    """Ids; of those that are empty or repeated with the number of the row, which all are where that
    is not enough.
    """
    count = Counter(ids)
    pairs = zip(ids, numbered, strict=True)
    made = [
        one if one and count[one] == 1 else f"{one} ({number})".strip() for one, number in pairs
    ]
    return made if len({*made}) == len(made) else [*numbered]


def load_data(
    sources: Source, scene: Scene | str | Path | None, as_read: bool, **reading: Any
) -> tuple[ImpactTable, Scene]:
    """What every fit begins with: one or several tables joined, the scene given or beside the
    first, doubts refused (InputError `misread`) or, `as_read`, noted. Scenes of further tables must
    name the same ball (`scenes-differ`). Raises ParameterError (`no-data`) without any.
    """
    read = [_read(source, scene, reading) for source in list_of_sources(sources)]
    if not read:
        raise ParameterError(
            "no table was given; expected files, data frames, or names of bundled ones",
            "no-data",
        )
    known = read[0][1]
    notes = list[Note]()
    for table, own in read:
        if own.ball != known.ball:
            words = (
                "the scene beside this table names another ball than that of the first; "
                "expected one ball"
            )
            raise InputError(
                table.name,
                [Fault("scenes-differ", f"{words}, or one scene for all (--scene)")],
            )
        found = [one.text for one in doubts(table, known.ball_value())]
        if found and not as_read:
            words = (
                "another reading of the columns fits the data much better; if the table is "
                "right, pass --as-read"
            )
            raise InputError(table.name, [Fault("misread", words)], found)
        notes += [Note("misread", f"{table.name}: {text}") for text in found]
    # Files of several folders may have one name.
    names = _unique([table.name for table, _ in read], [str(k + 1) for k in range(len(read))])
    whole = joined(
        [replace(table, name=name) for (table, _), name in zip(read, names, strict=True)]
    )
    return replace(whole, notices=(*whole.notices, *notes)), known


def list_of_sources(sources: Source) -> list[Source]:
    """The sources of one argument: those of a list, one, or none (None)."""
    if sources is None:
        return []
    return [*sources] if isinstance(sources, list | tuple) else [sources]


def _read(
    source: Source,
    scene: Scene | str | Path | None,
    reading: Mapping[str, Any],
) -> tuple[ImpactTable, Scene]:
    """A table and its scene, that given or beside it. Raises ParameterError (`read-already`)."""
    made = isinstance(source, ImpactTable)
    if made and any(reading.values()):
        words = f"{source.name} has been read already; pass {listed(reading, 'or')} to load_table"
        raise ParameterError(words, "read-already")
    place = (
        Path(source.read[0]["source"])
        if made and source.read
        else source
        if made
        else _found(source)[0]
    )
    own = scene if isinstance(scene, Scene) else _scene(place, scene)
    return source if made else load_table(source, scene=own, **reading), own
