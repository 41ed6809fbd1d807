"""`ImpactTable`, the only form in which measurements leave this room."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from fitball.base.columns import COLUMNS, INCIDENT, REBOUND
from fitball.base.errors import Fault, InputError, Note
from fitball.base.text import column_head, listed
from fitball.base.values import DataFrame, FloatArray, Impacts, IntArray
from fitball.data.kinematics import (
    AnalyticColumns,
    Columns,
    counting_columns,
    propagate,
    state,
    velocity,
)
from fitball.data.labels import first_spelled

# Correlations printed to six digits are possible still where an eigenvalue of their matrix is this
# far below zero.
_LARGEST_ROUNDING = 1e-6
# Sd of the normal prior of an incident spin of which nothing was measured [rad/s]: topspin and
# backspin of Wang's balls, 1,000 a minute.
UNKNOWN_SPIN_SD = 100.0
# The column that states it, which names the choice among assumptions.
SPIN_CHOICE = "omega_1_sd"


@dataclass(frozen=True, eq=False)
class ImpactTable:
    """Measured impacts in SI, angles in radians, NaN where nothing was measured.

    `values` are the columns that count, each information once, incident first and without gaps.
    `sd` are stated errors; a column states them in all its measured cells or in none. `corr` are
    stated correlations by pair, "v_x1,gap_time". `labels` are texts by column, `id` first, spelled
    as at their first use. `notices` are notes on what was assumed. `read` says of each file how it
    was read: source, SHA-256, columns, flip, ignore, units; where there were heights or flights
    the speeds that they became and the drag coefficient, and of several tables the label `table`.

    Example:
        >>> import fitball
        >>> table = fitball.load_table("wang_zero_spin")
        >>> table
        <ImpactTable wang_zero_spin: 7 impacts, v_x1, v_y1, omega_1, v_x2, v_y2, omega_2>
        >>> table.values["v_x2"].shape
        (7,)
        >>> table.labels["surface"][0]
        'acrylic'
    """

    name: str
    values: Columns
    sd: Columns
    corr: Columns
    labels: Mapping[str, tuple[str, ...]]
    notices: tuple[Note, ...] = ()
    read: tuple[Mapping[str, str], ...] = ()

    def __len__(self) -> int:
        return len(self.labels["id"])

    def __repr__(self) -> str:
        return f"<ImpactTable {self.name}: {len(self):,} impacts, {', '.join(self.values)}>"

    @property
    def impacts(self) -> Impacts:
        """Incident states, from components or from speed and angle; spin is zero where no column
        has it.

        Example:
            >>> import fitball
            >>> impacts = fitball.load_table("wang_zero_spin").impacts
            >>> impacts.v_y1.shape
            (7,)
        """
        states = state(self.values, len(self))
        return Impacts(*states.values())

    @property
    def has_spin(self) -> bool:
        """Whether any spin was measured.

        Example:
            >>> import fitball
            >>> fitball.load_table("wang_zero_spin").has_spin
            True
        """
        return "omega_1" in self.values or "omega_2" in self.values

    @property
    def has_times(self) -> bool:
        """Whether a time of the contact, or a gap between the flights, was measured.

        Example:
            >>> import fitball
            >>> fitball.load_table("synthetic_gaps").has_times
            True
        """
        return any(COLUMNS[name].timed for name in REBOUND if name in self.values)

    @property
    def has_tangential(self) -> bool:
        """Whether motion along the court was measured, before and after: not in a drop test.

        Example:
            >>> import fitball
            >>> fitball.load_table("synthetic_drop").has_tangential
            False
        """
        columns = [COLUMNS[name] for name in REBOUND if name in self.values]
        along = any(column.tangential or column.formula is not None for column in columns)
        return along and "v_x1" in velocity(self.values, "1")

    def with_unknown_spins(self, sd: float = UNKNOWN_SPIN_SD) -> ImpactTable:
        """The table with incident spins of 0 ± `sd` [rad/s], where it has none; else as it is. A
        spin that is known to be zero is a column of zeros.

        Example:
            >>> import fitball
            >>> table = fitball.load_table("synthetic_drop").with_unknown_spins()
            >>> table.sd["omega_1"].tolist()
            [100.0, 100.0, 100.0, 100.0, 100.0]
        """
        if "omega_1" in self.values:
            return self
        count = len(self)
        values = {"omega_1": np.zeros(count), **self.values}
        sds = {**self.sd, "omega_1": np.full(count, sd)}
        return replace(self, values=values, sd=sds)

    def covariance(
        self,
        columns: Sequence[str],
    ) -> Annotated[FloatArray, "impacts columns columns"] | None:
        """Covariance of the stated errors of v_x1, v_y1 and omega_1 and, behind them, of these
        rebound columns [SI]; zero where no error is stated, None where none is stated at all.

        Errors of speed and angle are propagated to the components. No other form of the errors
        needs as much memory: of a large table `take` some rows at a time.

        Example:
            >>> import fitball
            >>> states = {"v_x1": [15.0, 14.0], "v_y1": [5.0, 6.0]}
            >>> table = fitball.load_table({**states, "v_y2": [4.0, 4.6], "v_y2_sd": [0.1, 0.2]})
            >>> covariance = table.covariance(["v_y2"])
            >>> covariance.shape
            (2, 4, 4)
            >>> covariance[:, 3, 3].round(3)
            array([0.01, 0.04])
        """
        names = [name for name in INCIDENT if name in self.values]
        names += columns
        if not any(name in self.sd for name in names):
            return None
        zeros = np.zeros(len(self))
        # The slopes of a rebound column, one and zero, do not depend on its values: gaps may be any
        # number.
        values = {name: np.nan_to_num(self.values.get(name, zeros)) for name in names}
        sds_of = [np.nan_to_num(self.sd.get(name, zeros)) for name in names]
        sds = np.stack(sds_of, axis=1)
        covariance_as_stated = self._correlations(names) * sds[:, :, None] * sds[:, None, :]

        def state_and_rebound(columns_of: AnalyticColumns) -> AnalyticColumns:
            rebound = {name: columns_of[name] for name in columns}
            return state(columns_of, len(self)) | rebound

        _, covariance = propagate(state_and_rebound, values, covariance_as_stated)
        return covariance

    def impossible(self) -> Annotated[IntArray, "rows"]:
        """Rows, from 0, whose stated correlations no errors can have: their matrix has an
        eigenvalue below -1e-6.

        Example:
            >>> import fitball
            >>> fitball.load_table("wang_zero_spin").impossible().size
            0
        """
        correlated = [name for pair in self.corr for name in pair.split(",")]
        names = [*dict.fromkeys(correlated)]
        if not names:
            return np.empty(0, dtype=np.int64)
        eigenvalues = np.linalg.eigvalsh(self._correlations(names))
        return np.flatnonzero(eigenvalues[:, 0] < -_LARGEST_ROUNDING)

    def _correlations(self, names: Sequence[str]) -> FloatArray:
        """Stated correlations (impacts, names, names) of these columns, ones on the diagonal."""
        identity = np.eye(len(names))
        matrix = np.tile(identity, (len(self), 1, 1))
        for pair, values in self.corr.items():
            first, second = pair.split(",")
            if first in names and second in names:
                i = names.index(first)
                j = names.index(second)
                matrix[:, i, j] = np.nan_to_num(values)
                matrix[:, j, i] = matrix[:, i, j]
        return matrix

    def take(self, rows: Annotated[IntArray, "rows"]) -> ImpactTable:
        """The table with these rows only, counted from 0, in this order.

        Example:
            >>> import fitball
            >>> import numpy as np
            >>> fitball.load_table("wang_zero_spin").take(np.array([6, 0])).labels["id"]
            ('zero-7', 'zero-1')
        """
        numbers = rows.tolist()
        labels = {}
        for name, texts in self.labels.items():
            labels[name] = tuple(texts[number] for number in numbers)
        return replace(
            self,
            values={name: values[rows] for name, values in self.values.items()},
            sd={name: sds[rows] for name, sds in self.sd.items()},
            corr={pair: values[rows] for pair, values in self.corr.items()},
            labels=labels,
        )

    def to_frame(self) -> DataFrame:
        """The table as a file has it, index `id`: `v_x1 [m/s]`, `v_x1_sd [m/s]`,
        `corr(v_x1,gap_time)`, labels. `load_table` reads the same numbers from it, to the last
        digit.

        Example:
            >>> import fitball
            >>> table = fitball.load_table("wang_zero_spin")
            >>> table.to_frame().columns[0]
            'v_x1 [m/s]'
            >>> fitball.load_table(table.to_frame()).values.keys() == table.values.keys()
            True
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
        ids = pd.Index(self.labels["id"], name="id")
        return pd.DataFrame(columns, index=ids)


def pair_of(first: str, second: str) -> str:
    """The key of two columns in `ImpactTable.corr`: in the order of the registry."""
    in_order = sorted((first, second), key=[*COLUMNS].index)
    return ",".join(in_order)


def stated_errors(
    columns: Sequence[str],
    covariance: Annotated[FloatArray, "impacts columns columns"],
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """The `sd` and `corr` of an ImpactTable from the covariance [SI] of these columns; of a
    variance that is zero or NaN nothing is stated.
    """
    variances = np.diagonal(covariance, axis1=1, axis2=2)
    stated_variances = np.where(variances > 0.0, variances, np.nan)
    sds = np.sqrt(stated_variances)
    corr = {}
    for j, second in enumerate(columns):
        for i, first in enumerate(columns[:j]):
            values = covariance[:, i, j] / (sds[:, i] * sds[:, j])
            if np.any(np.abs(values) > 0.0):
                corr[pair_of(first, second)] = values
    sd = dict(zip(columns, sds.T.copy(), strict=True))
    return sd, corr


def join_tables(tables: Sequence[ImpactTable]) -> ImpactTable:
    """Several tables as one, with a label `table` if there is more than one; a column that a table
    lacks is a gap in its rows.

    Raises:
        InputError: Tables do not belong together (`incident-columns-differ`,
            `rebound-columns-differ`, `stated-in-some`, `same-table-twice`).
    """
    first = tables[0]
    if len(tables) == 1:
        return first
    names = [table.name for table in tables]
    measured = [name for name in REBOUND if any(name in table.values for table in tables)]
    faults = [*_differences(tables, measured)]
    if faults:
        raise InputError(" + ".join(names), faults)
    counts = [len(table) for table in tables]
    values = {}
    sds = {}
    for name in (*_incident_columns(first), *measured):
        values[name] = _stacked([table.values.get(name) for table in tables], counts, np.nan)
        if any(name in table.sd for table in tables):
            sds[name] = _stacked([table.sd.get(name) for table in tables], counts, np.nan)
    corr = {}
    for pair in dict.fromkeys(pair for table in tables for pair in table.corr):
        corr[pair] = _stacked([table.corr.get(pair) for table in tables], counts, 0.0)
    return ImpactTable(
        name="+".join(names),
        values=values,
        sd=sds,
        corr=corr,
        labels=_joined_labels(tables),
        notices=tuple(_joined_notices(tables, measured)),
        read=tuple(_read_of(table, entry) for table in tables for entry in table.read),
    )


def _read_of(table: ImpactTable, entry: Mapping[str, str]) -> Mapping[str, str]:
    """How a table among several was read: where it had heights or flights, with its label
    `table`.
    """
    return {**entry, "table": table.name} if "drag" in entry else entry


def _joined_labels(tables: Sequence[ImpactTable]) -> dict[str, tuple[str, ...]]:
    """Labels of all rows by column: empty where a table has none, ids behind the table's name."""
    labels = {}
    for name in dict.fromkeys(name for table in tables for name in table.labels):
        texts = list[str]()
        for table in tables:
            texts += table.labels.get(name, ("",) * len(table))
        labels[name] = first_spelled(texts)
    ids = list[str]()
    names = list[str]()
    for table in tables:
        ids += (f"{table.name}:{text}" for text in table.labels["id"])
        names += [table.name] * len(table)
    labels["id"] = tuple(ids)
    labels["table"] = tuple(names)
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
    counts: Sequence[int],
    gap: float,
) -> FloatArray:
    """A column of several tables as one array (impacts of all tables,). `counts` are their numbers
    of impacts; a table without the column has the `gap` in its rows.
    """
    pieces = []
    for column, count in zip(columns, counts, strict=True):
        pieces.append(np.full(count, gap) if column is None else column)
    return np.concatenate(pieces)


def _differences(tables: Sequence[ImpactTable], measured: Sequence[str]) -> Iterator[Fault]:
    """Faults that keep tables from being joined: a table that is there twice, other incident
    columns, other rebound velocities, sds that only some of the tables have.
    """
    names = [table.name for table in tables]
    if _has_duplicates(tables):
        text = (
            f"read {', '.join(names)}, expected different tables with different names: give "
            "each table once"
        )
        yield Fault("same-table-twice", text)
    incident = {table.name: _incident_columns(table) for table in tables}
    expected = incident[names[0]]
    if any(columns != expected for columns in incident.values()):
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
        lacking = [table.name for table in having if name not in table.sd]
        if lacking and len(lacking) < len(having):
            text = f"{name} has no sd in {listed(lacking)}; expected one in every table, or in none"
            yield Fault("stated-in-some", text, column=name)


def _incident_columns(table: ImpactTable) -> list[str]:
    """The incident columns of a table that count."""
    return [name for name in table.values if name in INCIDENT]


def _has_duplicates(tables: Sequence[ImpactTable]) -> bool:
    """Whether two tables have the same name, or the bytes of the same file."""
    names = {table.name for table in tables}
    files = list[tuple[str, str]]()
    for entry in (entry for table in tables for entry in table.read):
        if entry.get("sha256"):
            # Sheets of one workbook are different tables.
            sheet = entry.get("source", "").partition("#")[2]
            files.append((entry["sha256"], sheet))
    return len(names) < len(tables) or len({*files}) < len(files)


def _listed_of(names: Sequence[str], table: ImpactTable) -> str:
    """Those of the columns `names` that a table has, in words."""
    present = [name for name in names if name in table.values]
    return ", ".join(present) or "none"
