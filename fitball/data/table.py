"""The frozen impact table: what was measured, in SI units, each quantity counted once. Several are joined, rows one
below the other, each labelled with the table it came from.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from html import escape
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fitball.data.kinematics import independent
from fitball.errors import Fault, TableError
from fitball.observables import INCIDENT_UNITS, OBSERVABLES, SI_UNITS, VELOCITIES
from fitball.values import FloatArray, Impacts, same
from fitball.visible import some

if TYPE_CHECKING:
    import pandas as pd


Value = TypeVar("Value")


class FrozenMapping(Mapping[str, Value]):
    """An unchangeable mapping from names to values; keeps the order in which it was given."""

    __slots__ = ("_items",)

    def __init__(self, items: Mapping[str, Value] | None = None) -> None:
        self._items = dict(items or {})

    def __getitem__(self, key: str) -> Value:
        return self._items[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __repr__(self) -> str:
        return f"FrozenMapping({self._items!r})"


def frozen(values: ArrayLike) -> FloatArray:
    """A copy of numbers that cannot change."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


# Notices of one kind that are printed one by one.
NOTICES_SHOWN = 3


@dataclass(frozen=True)
class Measurement:
    """One rebound column: `name`, `values` (impacts,) in SI, and `sd` (impacts,) when it was stated.

    Where a row has no such measurement both are NaN. No column is empty, and no impact of a table is without any
    measurement.
    """

    name: str
    values: FloatArray
    sd: FloatArray | None = None

    @property
    def measured(self) -> NDArray[np.bool_]:
        """In which rows there is a measurement, (impacts,)."""
        return ~np.isnan(self.values)

    @property
    def complete(self) -> bool:
        """Whether every row has one."""
        return bool(self.measured.all())


@dataclass(frozen=True)
class Notice:
    """Something a reader of the table should know and that did not stop the reading.

    Notices of one `kind` say the same of several rows; "" is of its own kind.
    """

    message: str
    row: int | None = None
    columns: tuple[str, ...] = ()
    kind: str = ""

    def __str__(self) -> str:
        return f"row {self.row}: {self.message}" if self.row is not None else self.message


def summed_up(notices: Iterable[Notice]) -> tuple[str, ...]:
    """Notices as sentences: of a kind that many rows share, which rows these are and the first of them in full."""
    kinds: dict[str, list[Notice]] = {}
    for place, notice in enumerate(notices):
        kinds.setdefault(notice.kind or f"\0{place}", []).append(notice)
    sentences: list[str] = []
    for kind, members in kinds.items():
        if len(members) <= NOTICES_SHOWN:
            sentences += map(str, members)
            continue
        named = ", ".join(str(item.row) for item in members[:NOTICES_SHOWN])
        first = replace(members[0], message=members[0].message.removeprefix(f"{kind}: "))
        example = f"; {first}" if members[0].message != kind else ""
        sentences.append(f"rows {named} and {len(members) - NOTICES_SHOWN:,} more: {kind}{example}")
    return tuple(sentences)


@dataclass(frozen=True)
class Covariance:
    """The stated errors of each row, and how they belong together: `values` (impacts, columns, columns) in SI, zero
    where nothing is stated or measured. The `columns` are v_x1, v_y1, omega_1, and those that were measured.
    """

    columns: tuple[str, ...]
    values: FloatArray


@dataclass(frozen=True, repr=False, eq=False)
class ImpactTable:
    """A table of measured impacts; two are equal if their content is.

    `measurements` are independent, and each enters a likelihood once. `redundant` ones repeat them in another form
    (speed and angle beside components) and are only checked. `impacts` has zeros for missing columns;
    `incident_columns` are those of the table. `incident_covariance` (impacts, 3, 3) is that of
    `(v_x1, v_y1, omega_1)`, None if no uncertainty of them is given; `covariance` that of whole rows, None if errors
    of columns are stated one by one.

    `digest` is the SHA-256 of the file's bytes (and of those of its covariances), `files` are the files with the
    SHA-256 of each, `covariance_files` by these the file of their covariances ("" for those given in Python) with its
    SHA-256. `flipped` are columns with the opposite convention and `ignored` those left out, on request
    (`TABLE:COLUMN` in a table of several). `columns` maps fitball's names to
    those of the file. `ball_temperature` (impacts,) is in degrees Celsius, NaN in rows without one, and used by no
    fit; None if the table has no such column. After reading, `rows` (impacts,) are the rows of the file, from 1, and
    `resolution` is half a unit of each column's last printed digit [SI].
    """

    name: str
    source: str
    digest: str
    ids: tuple[str, ...]
    impacts: Impacts
    incident_columns: tuple[str, ...]
    incident_sd: Mapping[str, FloatArray]
    measurements: tuple[Measurement, ...]
    redundant: tuple[Measurement, ...]
    labels: Mapping[str, tuple[str, ...]]
    units: Mapping[str, str]
    notices: tuple[Notice, ...]
    incident_covariance: FloatArray | None = None
    covariance: Covariance | None = None
    flipped: tuple[str, ...] = ()
    ignored: tuple[str, ...] = ()
    columns: Mapping[str, str] = field(default_factory=FrozenMapping)
    ball_temperature: FloatArray | None = None
    files: tuple[tuple[str, str], ...] = ()
    covariance_files: Mapping[str, tuple[str, str]] = field(default_factory=FrozenMapping)
    rows: tuple[int, ...] = field(default=(), compare=False)
    resolution: Mapping[str, float] = field(default_factory=FrozenMapping, compare=False)

    def __len__(self) -> int:
        return len(self.impacts)

    def __eq__(self, other: object) -> bool:
        return same(self, other) if isinstance(other, ImpactTable) else NotImplemented

    def __hash__(self) -> int:
        return hash((self.name, self.digest))

    def __repr__(self) -> str:
        measured = ", ".join(item.name for item in self.measurements) or "nothing"
        labels = f"; labels {some([*self.labels])}" if self.labels else ""
        head = f"{self.name}: {len(self):,} impact{'s' if len(self) != 1 else ''}"
        return f"<ImpactTable {head}, incident {', '.join(self.incident_columns)}, measured {measured}{labels}>"

    def _repr_html_(self) -> str:
        """The table, for a notebook."""
        return f"<p>{escape(repr(self)[1:-1])}</p>{self.to_frame().to_html(max_rows=10, notebook=True)}"

    def to_frame(self) -> pd.DataFrame:
        """The table as a data frame, indexed by id, its columns as in files: `v_x1 [m/s]`, SI, angles in radians.

        `load_table` reads it again; what was only checked (`redundant`) and covariances (`covariance`,
        `incident_covariance`) are not in it.

        >>> fitball.load_table("wang_zero_spin").to_frame().shape
        (7, 8)
        """
        import pandas as pd

        columns = {name: getattr(self.impacts, name) for name in self.incident_columns}
        columns |= {f"{name}_sd": sd for name, sd in self.incident_sd.items()}
        for item in self.measurements:
            columns[item.name] = item.values
            if item.sd is not None:
                columns[f"{item.name}_sd"] = item.sd
        named = {f"{name} [{SI_UNITS[name.removesuffix('_sd')]}]": values for name, values in columns.items()}
        if self.ball_temperature is not None:
            named["ball_temperature [degC]"] = self.ball_temperature
        return pd.DataFrame(named | dict(self.labels), index=pd.Index(self.ids, name="id"))

    @property
    def remarks(self) -> tuple[str, ...]:
        """The notices as sentences, few however long the table."""
        return summed_up(self.notices)

    def measurement(self, name: str) -> Measurement | None:
        """The independent measurement called `name`, or None when the table has none."""
        return next((measurement for measurement in self.measurements if measurement.name == name), None)

    @property
    def has_tangential(self) -> bool:
        """Whether motion along the court was measured."""
        along = any(OBSERVABLES[measurement.name].along for measurement in self.measurements)
        return "v_x1" in self.incident_columns and along

    @property
    def has_spin(self) -> bool:
        """Whether rebound spin was measured (or incident spin set), so that torsion can show."""
        return "omega_1" in self.incident_columns or self.measurement("omega_2") is not None


def joined(tables: Sequence[ImpactTable]) -> ImpactTable:
    """The rows of all tables, with a label column `table` (names of files) when there are several.

    Labels that a table lacks are empty in its rows. A rebound column that a table lacks is missing there, and a
    notice is added. Raises TableError when incident columns or their sds differ, or if
    velocities are components in one table and speed and angle in another.
    """
    if len(tables) == 1:
        return tables[0]
    first = tables[0]
    measured = [name for name in OBSERVABLES if any(table.measurement(name) for table in tables)]
    faults = [fault for other in tables[1:] for fault in _differences(first, other)]
    faults += _rebound_faults(tables, measured)
    names = [table.name for table in tables]
    faults += [f"table {name} is given twice" for name in sorted({n for n in names if names.count(n) > 1})]
    if faults:
        raise TableError(" + ".join(table.source for table in tables), map(Fault, faults))

    labels = {
        name: tuple(text for table in tables for text in table.labels.get(name, ("",) * len(table)))
        for name in dict.fromkeys(name for table in tables for name in table.labels)
    }
    labels["table"] = tuple(table.name for table in tables for _ in range(len(table)))
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
        measurements=tuple(_stacked_measurement(name, tables) for name in measured),
        redundant=(),
        labels=FrozenMapping(labels),
        units=first.units,
        incident_covariance=_stacked([table.incident_covariance for table in tables]),
        notices=(
            *(Notice(f"{table.name}: {remark}") for table in tables for remark in table.remarks),
            *(
                Notice(f"{name} was not measured in {absent}; its other measurements are used", columns=(name,))
                for name in measured
                if (absent := ", ".join(table.name for table in tables if table.measurement(name) is None))
            ),
        ),
        covariance=_stacked_covariance(tables, measured),
        flipped=tuple(f"{table.name}:{name}" for table in tables for name in table.flipped),
        ignored=tuple(f"{table.name}:{name}" for table in tables for name in table.ignored),
        columns=first.columns,
        ball_temperature=_temperatures(tables),
        files=tuple(place for table in tables for place in table.files),
        covariance_files=FrozenMapping(
            {place: file for table in tables for place, file in table.covariance_files.items()}
        ),
    )


def _temperatures(tables: Sequence[ImpactTable]) -> FloatArray | None:
    """The ball temperatures of all tables, NaN in those that have none; None where none has."""
    known = [table.ball_temperature for table in tables]
    if all(column is None for column in known):
        return None
    filled = [np.full(len(one), np.nan) if it is None else it for one, it in zip(tables, known, strict=True)]
    return frozen(np.concatenate(filled))


def _stacked(columns: Sequence[FloatArray | None]) -> FloatArray | None:
    """Columns one below the other; None unless all tables have it."""
    present = [column for column in columns if column is not None]
    return frozen(np.concatenate(present)) if len(present) == len(columns) else None


def _stacked_covariance(tables: Sequence[ImpactTable], measured: Sequence[str]) -> Covariance | None:
    """The covariances of all tables, zero for columns that one lacks; stated sds alone where a table has none. None
    where no table has any.
    """
    if all(table.covariance is None for table in tables):
        return None
    columns = (*INCIDENT_UNITS, *measured)
    blocks = []
    for table in tables:
        own = table.covariance or _of_sds(table)
        places = [columns.index(name) for name in own.columns]
        block = np.zeros((len(table), len(columns), len(columns)))
        block[:, np.array(places)[:, None], places] = own.values
        blocks.append(block)
    return Covariance(columns, frozen(np.concatenate(blocks)))


def _of_sds(table: ImpactTable) -> Covariance:
    """The covariance of each row of a table whose errors are stated one by one."""
    columns, own = (*INCIDENT_UNITS, *(item.name for item in table.measurements)), len(INCIDENT_UNITS)
    values = np.zeros((len(table), len(columns), len(columns)))
    if table.incident_covariance is not None:
        values[:, :own, :own] = table.incident_covariance
    for place, item in enumerate(table.measurements, start=own):
        if item.sd is not None:
            values[:, place, place] = np.where(item.measured, item.sd, 0.0) ** 2
    return Covariance(columns, frozen(values))


def _stacked_measurement(name: str, tables: Sequence[ImpactTable]) -> Measurement:
    """One column of all tables, NaN where one has it not."""
    columns = [table.measurement(name) for table in tables]
    nothing = [np.full(len(table), np.nan) for table in tables]
    values = [gap if item is None else item.values for item, gap in zip(columns, nothing, strict=True)]
    sds = [gap if item is None or item.sd is None else item.sd for item, gap in zip(columns, nothing, strict=True)]
    stated = any(item is not None and item.sd is not None for item in columns)
    return Measurement(name, frozen(np.concatenate(values)), frozen(np.concatenate(sds)) if stated else None)


def _rebound_faults(tables: Sequence[ImpactTable], measured: Sequence[str]) -> list[str]:
    """What keeps rebound columns of tables, those that any has `measured`, from being one column."""
    faults = []
    velocities = [name for name in measured if name in VELOCITIES]
    if set(independent(velocities, "2")) != set(velocities):
        given = "; ".join(
            f"{', '.join(item.name for item in table.measurements if item.name in VELOCITIES) or 'none'} in "
            f"{table.source}"
            for table in tables
        )
        faults.append(
            f"rebound velocities have different columns: {given}; expected the same columns, or some of them, in all "
            "tables that are fitted together"
        )
    for name in measured:
        having = [(table, item) for table in tables if (item := table.measurement(name)) is not None]
        stated = [table.source for table, item in having if item.sd is not None]
        bare = [table.source for table, item in having if item.sd is None]
        if stated and bare:
            faults.append(
                f"{name} has an sd in {stated[0]} and none in {bare[0]}; expected one in all tables that are fitted "
                "together, or in none"
            )
    return faults


def _differences(one: ImpactTable, other: ImpactTable) -> list[str]:
    """What keeps incident columns of two tables from being the same columns."""
    compared = (
        ("incident columns", one.incident_columns, other.incident_columns),
        ("sds of incident columns", tuple(one.incident_sd), tuple(other.incident_sd)),
    )
    return [
        f"{what} differ: {', '.join(columns) or 'none'} in {one.source}, {', '.join(others) or 'none'} in "
        f"{other.source}; expected the same in all tables that are fitted together"
        for what, columns, others in compared
        if columns != others
    ]
