"""Several tables as one: rows one below the other, each labelled with the table it came from."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from hashlib import sha256

import numpy as np

from fitball.data.bundled import resolve_table
from fitball.data.frozen import FrozenMapping
from fitball.data.read import load_table
from fitball.data.reading.flip import check_flips
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable, Measurement, Notice
from fitball.errors import Fault, TableError
from fitball.values import FloatArray, Impacts

ORIGIN = "table"


def load_tables(
    sources: Sequence[str | os.PathLike[str]], scene: Scene | None = None, flip: Sequence[str] = ()
) -> ImpactTable:
    """One table, or several joined; `flip` names columns as `load_table` has it, of one of several tables as
    `TABLE:COLUMN`. Raises as `load_table` does for each, TableError for tables that differ, ParameterError for a
    table that is not there.
    """
    return joined(read_each(sources, scene, flip))


def read_each(
    sources: Sequence[str | os.PathLike[str]], scene: Scene | None = None, flip: Sequence[str] = ()
) -> list[ImpactTable]:
    """The tables of `load_tables` one by one. Raises as `load_table` does, ParameterError as `load_tables`."""
    check_flips(flip, [resolve_table(source).stem for source in sources])
    return [load_table(source, scene=scene, flip=flip) for source in sources]


def joined(tables: Sequence[ImpactTable]) -> ImpactTable:
    """The rows of all tables, with a label column `table` (names of files) when there are several.

    Label columns that not all have are left empty where they are missing. Raises TableError when measured columns or
    stated sds differ: an impact without a measurement cannot stand beside one that has it.
    """
    if len(tables) == 1:
        return tables[0]
    first = tables[0]
    faults = [fault for other in tables[1:] for fault in _differences(first, other)]
    names = [table.name for table in tables]
    faults += [Fault(f"table {name} is given twice") for name in sorted({n for n in names if names.count(n) > 1})]
    if faults:
        raise TableError(" + ".join(table.source for table in tables), faults)

    def stacked(columns: Sequence[FloatArray]) -> FloatArray:
        whole = np.concatenate(columns)
        whole.setflags(write=False)
        return whole

    labels = {
        name: tuple(text for table in tables for text in table.labels.get(name, ("",) * len(table)))
        for name in dict.fromkeys(name for table in tables for name in table.labels)
    }
    labels[ORIGIN] = tuple(table.name for table in tables for _ in range(len(table)))
    covariances = [table.incident_covariance for table in tables if table.incident_covariance is not None]
    cor = [table.impacts.cor for table in tables if table.impacts.cor is not None]
    return ImpactTable(
        name="+".join(names),
        source=" + ".join(table.source for table in tables),
        digest=sha256("".join(table.digest for table in tables).encode()).hexdigest(),
        ids=tuple(f"{table.name}:{name}" for table in tables for name in table.ids),
        impacts=Impacts(
            stacked([table.impacts.v_x1 for table in tables]),
            stacked([table.impacts.v_y1 for table in tables]),
            stacked([table.impacts.omega_1 for table in tables]),
            stacked(cor) if len(cor) == len(tables) else None,
        ),
        incident_columns=first.incident_columns,
        incident_sd=FrozenMapping(
            {name: stacked([table.incident_sd[name] for table in tables]) for name in first.incident_sd}
        ),
        measurements=tuple(
            _stacked_measurement([table.measurements[k] for table in tables], stacked)
            for k in range(len(first.measurements))
        ),
        redundant=(),
        labels=FrozenMapping(labels),
        units=first.units,
        incident_covariance=stacked(covariances) if len(covariances) == len(tables) else None,
        notices=tuple(Notice(f"{table.name}: {remark}") for table in tables for remark in table.remarks),
        flipped=tuple(f"{table.name}:{name}" for table in tables for name in table.flipped),
        files=tuple(place for table in tables for place in table.files),
    )


def _stacked_measurement(
    columns: Sequence[Measurement], stacked: Callable[[Sequence[FloatArray]], FloatArray]
) -> Measurement:
    sds = [item.sd for item in columns if item.sd is not None]
    return Measurement(columns[0].name, stacked([item.values for item in columns]), stacked(sds) if sds else None)


def _differences(one: ImpactTable, other: ImpactTable) -> list[Fault]:
    faults = []
    for what, columns, others in (
        ("incident columns", one.incident_columns, other.incident_columns),
        ("stated sds of incident columns", tuple(one.incident_sd), tuple(other.incident_sd)),
        (
            "measured columns",
            tuple(measurement.name for measurement in one.measurements),
            tuple(measurement.name for measurement in other.measurements),
        ),
        (
            "measured columns with a stated sd",
            tuple(measurement.name for measurement in one.measurements if measurement.sd is not None),
            tuple(measurement.name for measurement in other.measurements if measurement.sd is not None),
        ),
    ):
        if columns != others:
            faults.append(
                Fault(
                    f"{what} differ: {', '.join(columns) or 'none'} in {one.source}, "
                    f"{', '.join(others) or 'none'} in {other.source}; expected the same in all tables that are "
                    "fitted together"
                )
            )
    return faults
