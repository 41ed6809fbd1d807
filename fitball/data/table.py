"""The frozen impact table: what was measured, in SI units, each quantity counted once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from html import escape
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fitball.observables import OBSERVABLES, SI_UNITS
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


# Notices of one kind that are told one by one.
NOTICES_TOLD = 3


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
        if len(members) <= NOTICES_TOLD:
            sentences += map(str, members)
            continue
        named = ", ".join(str(item.row) for item in members[:NOTICES_TOLD])
        first = replace(members[0], message=members[0].message.removeprefix(f"{kind}: "))
        sentences.append(f"rows {named} and {len(members) - NOTICES_TOLD:,} more: {kind}; {first}")
    return tuple(sentences)


@dataclass(frozen=True, repr=False, eq=False)
class ImpactTable:
    """A table of measured impacts; two are equal when all they hold is.

    `measurements` are independent and enter a likelihood, each once; `redundant` repeat them in other
    words (speed and angle beside components) and were only checked. `impacts` holds zeros where the
    table has no such column; `incident_columns` names those that it has. `incident_covariance` (impacts, 3, 3) is
    that of `(v_x1, v_y1, omega_1)`, None where no uncertainty of them was stated. `digest` is the SHA-256 of
    the file's bytes, `files` are those it was read from, each with the SHA-256 of its bytes; `flipped` are columns
    that were counted the other way round on request (`TABLE:COLUMN` in a table of several), `columns` names in the
    file that are not ours, by our name. Where the table was just read `rows` (impacts,) says where each stood, from
    1, and `resolution` half a unit of each column's last printed digit [SI].
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
    flipped: tuple[str, ...] = ()
    columns: Mapping[str, str] = field(default_factory=FrozenMapping)
    files: tuple[tuple[str, str], ...] = ()
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
        """The table as a notebook shows it."""
        return f"<p>{escape(repr(self)[1:-1])}</p>{self.to_frame().to_html(max_rows=10, notebook=True)}"

    def to_frame(self) -> pd.DataFrame:
        """The table as a data frame, indexed by id, its columns as in files: `v_x1 [m/s]`, SI, angles in radians.

        `load_table` reads it again; what was only checked (`redundant`) and correlations between stated sds of the
        incident state are not in it.

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
        """Whether the table says anything about motion along the court."""
        along = any(OBSERVABLES[measurement.name].along for measurement in self.measurements)
        return "v_x1" in self.incident_columns and along

    @property
    def has_spin(self) -> bool:
        """Whether rebound spin was measured (or incident spin set), so that torsion can show."""
        return "omega_1" in self.incident_columns or self.measurement("omega_2") is not None
