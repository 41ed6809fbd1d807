"""`ImpactTable`, the only form in which measurements leave this room."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitball.base.columns import COLUMNS, INCIDENT, REBOUND
from fitball.base.errors import Fault, InputError, Note
from fitball.base.text import column_head, listed
from fitball.base.values import DataFrame, FloatArray, Impacts, IntArray
from fitball.data.kinematics import Columns, counting_columns, propagate, state, velocity
from fitball.data.labels import first_spelled

# Correlations printed to six digits are possible still where an eigenvalue of their matrix is this
# far below zero.
_ROUNDED = 1e-6


@dataclass(frozen=True, eq=False)
class ImpactTable:
    """Measured impacts, SI, angles in radians. Arrays by column are (impacts,), NaN where nothing
    was measured.

    `values` are the columns that count, each information once, incident first and without gaps.
    `sd` are stated errors; a column states them in all its measured cells or in none. `corr` are
    stated correlations by pair, "v_x1,gap_time". `labels` are texts by column, `id` first, spelled
    as at their first use. `read` says of each file how it was read: source, SHA-256, columns, flip,
    ignore.
    """

    name: str
    values: Mapping[str, FloatArray]
    sd: Mapping[str, FloatArray]
    corr: Mapping[str, FloatArray]
    labels: Mapping[str, tuple[str, ...]]
    notices: tuple[Note, ...] = ()
    read: tuple[Mapping[str, str], ...] = ()

    def __len__(self) -> int:
        return len(self.labels["id"])

    def __repr__(self) -> str:
        return f"<ImpactTable {self.name}: {len(self):,} impacts, {', '.join(self.values)}>"

    @property
    def impacts(self) -> Impacts:
        """Incident states (impacts,), from components or speed and angle; spin zero without a
        column.
        """
        return Impacts(*state(self.values, len(self)).values())

    @property
    def has_spin(self) -> bool:
        """Whether any spin was measured."""
        return "omega_1" in self.values or "omega_2" in self.values

    @property
    def has_tangential(self) -> bool:
        """Whether motion along the court was measured, before and after: not in a drop test."""
        columns = [COLUMNS[name] for name in REBOUND if name in self.values]
        along = any(column.tangential or column.formula is not None for column in columns)
        return along and "v_x1" in velocity(self.values, "1")

    def covariance(self, columns: Sequence[str]) -> FloatArray | None:
        """Covariance (impacts, 3 + columns, 3 + columns) of stated errors of (v_x1, v_y1, omega_1)
        and these rebound columns, propagated from speed and angle where these count, zero where
        nothing is stated; None if nowhere. The only dense form of errors, made for some rows at a
        time.
        """
        names = [*(name for name in INCIDENT if name in self.values), *columns]
        if not any(name in self.sd for name in names):
            return None
        zeros = np.zeros(len(self))
        # The slopes of a rebound column, one and zero, do not depend on its values: gaps may be any
        # number.
        values = {name: np.nan_to_num(self.values.get(name, zeros)) for name in names}
        sds_of = [np.nan_to_num(self.sd.get(name, zeros)) for name in names]
        sds = np.stack(sds_of, axis=1)
        stated_covariance = self._correlations(names) * sds[:, :, None] * sds[:, None, :]

        def state_and_rebound(columns_of: Columns) -> Columns:
            rebound = {name: columns_of[name] for name in columns}
            return state(columns_of, len(self)) | rebound

        return propagate(state_and_rebound, values, stated_covariance)[1]

    def impossible(self) -> IntArray:
        """Rows whose stated correlations no errors can have: their matrix has an eigenvalue below
        -1e-6.
        """
        names = [*dict.fromkeys(name for pair in self.corr for name in pair.split(","))]
        if not names:
            return np.empty(0, dtype=np.int64)
        least = np.linalg.eigvalsh(self._correlations(names))[:, 0]
        return np.flatnonzero(least < -_ROUNDED)

    def _correlations(self, names: Sequence[str]) -> FloatArray:
        """Correlations (impacts, names, names), ones on the diagonal."""
        matrix = np.tile(np.eye(len(names)), (len(self), 1, 1))
        for pair, values in self.corr.items():
            first, second = pair.split(",")
            if first in names and second in names:
                i = names.index(first)
                j = names.index(second)
                matrix[:, i, j] = matrix[:, j, i] = np.nan_to_num(values)
        return matrix

    def take(self, rows: IntArray) -> ImpactTable:
        """The table of these rows (places from 0) only."""
        places = rows.tolist()
        labels = {
            name: tuple(texts[place] for place in places) for name, texts in self.labels.items()
        }
        return replace(
            self,
            values={name: values[rows] for name, values in self.values.items()},
            sd={name: sds[rows] for name, sds in self.sd.items()},
            corr={pair: values[rows] for pair, values in self.corr.items()},
            labels=labels,
        )

    def to_frame(self) -> DataFrame:
        """The table as a file has it, index `id`: `v_x1 [m/s]`, `v_x1_sd [m/s]`,
        `corr(v_x1,gap_time)`, labels. `load_table` of it is this table to the last digit; `track`
        writes its impacts by it.
        """
        import pandas as pd

        columns: dict[str, object] = {}
        for name, values in self.values.items():
            unit = COLUMNS[name].unit
            columns[column_head(name, unit)] = values
            if name in self.sd:
                columns[column_head(f"{name}_sd", unit)] = self.sd[name]
        columns |= {f"corr({pair})": values for pair, values in self.corr.items()}
        columns |= {name: texts for name, texts in self.labels.items() if name != "id"}
        return pd.DataFrame(columns, index=pd.Index(self.labels["id"], name="id"))


def pair_of(first: str, second: str) -> str:
    """The key of two columns in `ImpactTable.corr`: in the order of the registry."""
    return ",".join(sorted((first, second), key=[*COLUMNS].index))


def stated_errors(
    columns: Sequence[str],
    covariance: FloatArray,
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """The `sd` and `corr` of an ImpactTable from the covariance (impacts, columns, columns) of each
    row [SI]; of a variance that is zero or NaN nothing is stated.
    """
    variances = np.diagonal(covariance, axis1=1, axis2=2)
    sds = np.sqrt(np.where(variances > 0.0, variances, np.nan))
    corr = {}
    for j, second in enumerate(columns):
        for i, first in enumerate(columns[:j]):
            values = covariance[:, i, j] / (sds[:, i] * sds[:, j])
            if np.any(np.abs(values) > 0.0):
                corr[pair_of(first, second)] = values
    return dict(zip(columns, sds.T.copy(), strict=True)), corr


def join_tables(tables: Sequence[ImpactTable]) -> ImpactTable:
    """Tables together, with a label `table` if there are several; columns that one lacks are gaps.
    Raises InputError (`incident-columns-differ`, `rebound-columns-differ`, `stated-in-some`,
    `same-table-twice`).
    """
    first = tables[0]
    if len(tables) == 1:
        return first
    names = [table.name for table in tables]
    measured = [name for name in REBOUND if any(name in table.values for table in tables)]
    faults = [*_differences(tables, measured)]
    if faults:
        raise InputError(" + ".join(names), faults)
    columns = [*(name for name in first.values if name in INCIDENT), *measured]
    values = {}
    sds = {}
    for name in columns:
        values[name] = _stacked([table.values.get(name) for table in tables], tables, np.nan)
        if any(name in table.sd for table in tables):
            sds[name] = _stacked([table.sd.get(name) for table in tables], tables, np.nan)
    corr = {}
    for pair in dict.fromkeys(pair for table in tables for pair in table.corr):
        corr[pair] = _stacked([table.corr.get(pair) for table in tables], tables, 0.0)
    return ImpactTable(
        name="+".join(names),
        values=values,
        sd=sds,
        corr=corr,
        labels=_joined_labels(tables),
        notices=tuple(_joined_notices(tables, measured)),
        read=tuple(entry for table in tables for entry in table.read),
    )


def _joined_labels(tables: Sequence[ImpactTable]) -> dict[str, tuple[str, ...]]:
    """Labels of all rows by column: empty where a table has none, ids behind the table's name."""
    labels = {}
    for name in dict.fromkeys(name for table in tables for name in table.labels):
        texts = list[str]()
        for table in tables:
            texts += table.labels.get(name, ("",) * len(table))
        labels[name] = first_spelled(texts)
    labels["id"] = tuple(f"{table.name}:{text}" for table in tables for text in table.labels["id"])
    labels["table"] = tuple(table.name for table in tables for _ in range(len(table)))
    return labels


def _joined_notices(tables: Sequence[ImpactTable], measured: Sequence[str]) -> Iterator[Note]:
    """The notes of all tables by their names, and those on columns that a table lacks."""
    for table in tables:
        for note in table.notices:
            yield Note(note.code, f"{table.name}: {note.text}")
    for name in measured:
        lacking = [table.name for table in tables if name not in table.values]
        if lacking:
            text = f"{name} was not measured in {listed(lacking)}. Its other measurements are used."
            yield Note("column-in-some", text)


def _stacked(
    columns: Iterable[FloatArray | None],
    tables: Sequence[ImpactTable],
    gap: float,
) -> FloatArray:
    """One column (rows of all tables,), the `gap` in rows of tables that have none."""
    pieces = []
    for column, table in zip(columns, tables, strict=True):
        pieces.append(np.full(len(table), gap) if column is None else column)
    return np.concatenate(pieces)


def _differences(tables: Sequence[ImpactTable], measured: Sequence[str]) -> Iterator[Fault]:
    """What keeps tables from being one: a table twice, incident columns, rebound velocities, sds in
    some.
    """
    names = [table.name for table in tables]
    if _has_one_twice(tables):
        text = (
            f"read {', '.join(names)}, expected different tables with different names: give "
            "each table once"
        )
        yield Fault("same-table-twice", text)
    incident = {table.name: [name for name in table.values if name in INCIDENT] for table in tables}
    if any(columns != incident[names[0]] for columns in incident.values()):
        sets = "; ".join(f"{', '.join(columns)} in {name}" for name, columns in incident.items())
        text = (
            f"incident columns differ: {sets}. Tables that are fitted together need the same "
            "incident columns"
        )
        yield Fault("incident-columns-differ", text)
    velocities = [name for name in measured if COLUMNS[name].of_velocity]
    if {*counting_columns(velocities, "2")} != {*velocities}:
        sets = "; ".join(f"{_listed_of(velocities, table)} in {table.name}" for table in tables)
        text = (
            f"rebound velocities differ: {sets}. Tables that are fitted together need "
            "components, or speed and angle"
        )
        yield Fault("rebound-columns-differ", text)
    for name in (*INCIDENT, *measured):
        having = [table for table in tables if name in table.values]
        bare = [table.name for table in having if name not in table.sd]
        if bare and len(bare) < len(having):
            text = f"{name} has no sd in {listed(bare)}; expected one in every table, or in none"
            yield Fault("stated-in-some", text, column=name)


def _has_one_twice(tables: Sequence[ImpactTable]) -> bool:
    """Whether two tables have one name, or the bytes of one file."""
    names = {table.name for table in tables}
    read = [entry for table in tables for entry in table.read if entry.get("sha256")]
    # Sheets of one workbook are different tables.
    files = {(entry["sha256"], entry.get("source", "").partition("#")[2]) for entry in read}
    return len(names) < len(tables) or len(files) < len(read)


def _listed_of(names: Sequence[str], table: ImpactTable) -> str:
    """Those of the columns that a table has, in words."""
    return ", ".join(name for name in names if name in table.values) or "none"
