"""The road by which tables come to a fit: read one by one, refused while another reading explains them much better,
and joined, rows one below the other, each labelled with the table it came from.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from hashlib import sha256

import numpy as np

from fitball.data.kinematics import independent
from fitball.data.misreading import check_flips, doubt_of_table, gaps_of_table
from fitball.data.read import Source, framed, load_table, name_of
from fitball.data.repeats import repeats_of
from fitball.data.scene import Scene
from fitball.data.table import FrozenMapping, ImpactTable, Measurement, Notice, frozen
from fitball.errors import Fault, ParameterError, ReadingError, TableError
from fitball.observables import INCIDENT_UNITS, OBSERVABLES, VELOCITIES
from fitball.values import FloatArray, Impacts

ORIGIN = "table"


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
    """A table, or the one joined from several, and what is to be said of how it was read.

    Each table is looked at by itself, as one of the scene's ball. With `as_read` one that another reading explains
    much better is taken all the same, and a sentence tells. Raises ReadingError for it otherwise, ParameterError for
    a table that was read already and is to be flipped or to have other names (`columns`), and as `load_tables` does.
    """
    for what, given in (("flip", flip), ("columns", columns), ("units", units)):
        if given and any(isinstance(item, ImpactTable) for item in data):
            raise ParameterError(
                f"{what}: this table was read already; say so where it is read, load_table(file, {what}=...)"
            )
    tables = _read_each(data, scene, flip, columns, units)
    notes = []
    for table in tables:
        gaps = gaps_of_table(table, scene.ball)
        notes += [] if gaps is None else [f"{table.name}: {gaps}"]
        copies, near = repeats_of(table, scene.ball)
        if copies is not None and not as_read:
            raise ReadingError(table.source, (copies,), "rows are copies of others:")
        notes += [f"{table.name}: every row counts, on request (as_read), although {copies}"] if copies else []
        notes += [f"{table.name}: {near}"] if near else []
        doubt = doubt_of_table(table, scene.ball)
        if doubt is not None and not as_read:
            raise ReadingError(table.source, doubt.lines(scene))
        if doubt is not None:
            notes.append(
                f"{table.name}: taken as its header says, on request (as_read), although {doubt.lines(scene)[0]}"
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


def joined(tables: Sequence[ImpactTable]) -> ImpactTable:
    """The rows of all tables, with a label column `table` (names of files) when there are several.

    Label columns that not all have are left empty where they are missing; a rebound column that some have is missing
    in the others, and a notice tells. Raises TableError when incident columns or stated sds differ, or velocities are
    told as components here and as speed and angle there.
    """
    if len(tables) == 1:
        return tables[0]
    first = tables[0]
    faults = [fault for other in tables[1:] for fault in _differences(first, other)] + _rebound_faults(tables)
    names = [table.name for table in tables]
    faults += [f"table {name} is given twice" for name in sorted({n for n in names if names.count(n) > 1})]
    if faults:
        raise TableError(" + ".join(table.source for table in tables), map(Fault, faults))

    labels = {
        name: tuple(text for table in tables for text in table.labels.get(name, ("",) * len(table)))
        for name in dict.fromkeys(name for table in tables for name in table.labels)
    }
    labels[ORIGIN] = tuple(table.name for table in tables for _ in range(len(table)))
    v_x, v_y, omega = (np.concatenate([getattr(table.impacts, name) for table in tables]) for name in INCIDENT_UNITS)
    sds = {name: frozen(np.concatenate([table.incident_sd[name] for table in tables])) for name in first.incident_sd}
    return ImpactTable(
        name="+".join(names),
        source=" + ".join(table.source for table in tables),
        digest=sha256("".join(table.digest for table in tables).encode()).hexdigest(),
        ids=tuple(f"{table.name}:{name}" for table in tables for name in table.ids),
        impacts=Impacts(v_x, v_y, omega, _stacked([table.impacts.cor for table in tables])),
        incident_columns=first.incident_columns,
        incident_sd=FrozenMapping(sds),
        measurements=tuple(_stacked_measurement(name, tables) for name in _measured_columns(tables)),
        redundant=(),
        labels=FrozenMapping(labels),
        units=first.units,
        incident_covariance=_stacked([table.incident_covariance for table in tables]),
        notices=(
            *(Notice(f"{table.name}: {remark}") for table in tables for remark in table.remarks),
            *_absent_columns(tables),
        ),
        flipped=tuple(f"{table.name}:{name}" for table in tables for name in table.flipped),
        columns=first.columns,
        files=tuple(place for table in tables for place in table.files),
    )


def _measured_columns(tables: Sequence[ImpactTable]) -> list[str]:
    """Rebound columns that at least one table counts, in the order of all that there are."""
    return [name for name in OBSERVABLES if any(table.measurement(name) for table in tables)]


def _absent_columns(tables: Sequence[ImpactTable]) -> list[Notice]:
    lacking = {name: [table.name for table in tables if table.measurement(name) is None]
               for name in _measured_columns(tables)}  # fmt: skip
    return [
        Notice(f"{name} was not measured in {', '.join(names)}: what else was measured there counts", columns=(name,))
        for name, names in lacking.items()
        if names
    ]


def _stacked(columns: Sequence[FloatArray | None]) -> FloatArray | None:
    """Columns one below the other; None unless all tables have it."""
    present = [column for column in columns if column is not None]
    return frozen(np.concatenate(present)) if len(present) == len(columns) else None


def _stacked_measurement(name: str, tables: Sequence[ImpactTable]) -> Measurement:
    """One column of all tables, NaN where one has it not."""
    columns = [table.measurement(name) for table in tables]
    nothing = [np.full(len(table), np.nan) for table in tables]
    values = [gap if item is None else item.values for item, gap in zip(columns, nothing, strict=True)]
    sds = [gap if item is None or item.sd is None else item.sd for item, gap in zip(columns, nothing, strict=True)]
    stated = any(item is not None and item.sd is not None for item in columns)
    return Measurement(name, frozen(np.concatenate(values)), frozen(np.concatenate(sds)) if stated else None)


def _rebound_faults(tables: Sequence[ImpactTable]) -> list[str]:
    """What keeps rebound columns of tables from being one column."""
    faults = []
    velocities = [name for name in _measured_columns(tables) if name in VELOCITIES]
    if set(independent(velocities, "2")) != set(velocities):
        told = "; ".join(
            f"{', '.join(item.name for item in table.measurements if item.name in VELOCITIES) or 'none'} in "
            f"{table.source}"
            for table in tables
        )
        faults.append(
            f"rebound velocities are told in different ways: {told}; expected the same columns, or some of them, in "
            "all tables that are fitted together"
        )
    for name in _measured_columns(tables):
        having = [(table, item) for table in tables if (item := table.measurement(name)) is not None]
        stated = [table.source for table, item in having if item.sd is not None]
        bare = [table.source for table, item in having if item.sd is None]
        if stated and bare:
            faults.append(
                f"{name} has a stated sd in {stated[0]} and none in {bare[0]}; expected one in all tables that are "
                "fitted together, or in none"
            )
    return faults


def _differences(one: ImpactTable, other: ImpactTable) -> list[str]:
    """What keeps incident columns of two tables from being the same columns."""
    compared = (
        ("incident columns", one.incident_columns, other.incident_columns),
        ("stated sds of incident columns", tuple(one.incident_sd), tuple(other.incident_sd)),
    )
    return [
        f"{what} differ: {', '.join(columns) or 'none'} in {one.source}, {', '.join(others) or 'none'} in "
        f"{other.source}; expected the same in all tables that are fitted together"
        for what, columns, others in compared
        if columns != others
    ]
