"""`Batched`: a row a table, populations of quantities over them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fitball.base.errors import Note, ParameterError, suggestion
from fitball.base.numbers import counted
from fitball.base.values import DataFrame
from fitball.batches.control import Control, control_frame
from fitball.batches.rows import FAILED, TableQuantity, over_tables
from fitball.models.model import Model
from fitball.uses.hierarchy import Hierarchy


@dataclass(frozen=True, eq=False, repr=False)
class Batched:
    """A batch in a `folder`. Frames `tables` (`batch.csv`: a row a table, with outcome, adequacy,
    quantities in SI with sds and verdicts, measured pace and rebound) and `populations` (centre and
    spread of each quantity that three tables determine, by all tables with a posterior).
    `quantities` are those of each table, by name; `control` has the control charts over tables in
    order; `own` is the user's function that all were fitted with.
    """

    folder: Path
    tables: DataFrame
    populations: DataFrame
    quantities: Mapping[str, Mapping[str, TableQuantity]]
    notes: tuple[Note, ...] = ()
    own: Model | None = None
    control: tuple[Control, ...] = ()

    def __repr__(self) -> str:
        tables = counted(len(self.tables), "table")
        return f"<Batch of {tables} in {self.folder}, {len(self.failed)} failed>"

    @property
    def frames(self) -> Mapping[str, DataFrame]:
        """The frames of tables and populations, and of control charts if there are any, named as
        their files.

        Example:
            >>> import tempfile
            >>> import fitball
            >>> options = {"point_only": True, "cores": 1, "figures": "none", "progress": False}
            >>> drop = {"v_y1": [7.0], "v_y2": [5.2]}
            >>> with tempfile.TemporaryDirectory() as folder:
            ...     batch = fitball.batch({"too short": drop}, out=folder, **options)
            >>> {name: len(frame) for name, frame in batch.frames.items()}
            {'batch': 1, 'population': 0}
        """
        frames = {"batch": self.tables, "population": self.populations}
        if self.control:
            frames["control"] = control_frame(self.control)
        return frames

    @property
    def failed(self) -> Mapping[str, str]:
        """Why tables could not be fitted, by name of table.

        Example:
            >>> import tempfile
            >>> import fitball
            >>> options = {"point_only": True, "cores": 1, "figures": "none", "progress": False}
            >>> drop = {"v_y1": [7.0], "v_y2": [5.2]}
            >>> with tempfile.TemporaryDirectory() as folder:
            ...     batch = fitball.batch({"too short": drop}, out=folder, **options)
            >>> [*batch.failed]
            ['too short']
        """
        return dict(self.tables["reason"][self.tables["outcome"] == FAILED])

    def population(self, name: str) -> Hierarchy:
        """Draws of centre and spread of a quantity over all tables with a posterior, of a new
        table, of each given all others; in SI, but the spread of a logarithm, which is relative.

        Raises:
            ParameterError: no table has it (`unknown-quantity`), or fewer than three determine it
                (`too-few-tables`).

        Example:
            >>> import tempfile
            >>> import fitball
            >>> options = {"point_only": True, "cores": 1, "figures": "none", "progress": False}
            >>> drops = {}
            >>> for name, shift in {"a": 0.0, "b": 0.05, "c": 0.1}.items():
            ...     v_y2 = [5.2 + shift, 5.25 + shift, 5.19 + shift]
            ...     drops[name] = {"v_y1": [7.0, 7.1, 7.0], "v_y2": v_y2}
            >>> with tempfile.TemporaryDirectory() as folder:
            ...     batch = fitball.batch(drops, out=folder, model="grip-slip", **options)
            >>> population = batch.population("cor_measured")
            >>> round(float(population.centre.mean()), 2)
            0.75
            >>> population.each.shape
            (3, 500)
        """
        names = dict.fromkeys(name for row in self.quantities.values() for name in row)
        if name not in names:
            raise ParameterError(f"read '{name}': {suggestion(name, names)}", "unknown-quantity")
        return over_tables(name, self.of(name))

    def of(self, name: str) -> list[TableQuantity]:
        """A quantity of the tables that have a posterior or a test of it, in their order.

        Example:
            >>> import tempfile
            >>> import fitball
            >>> options = {"point_only": True, "cores": 1, "figures": "none", "progress": False}
            >>> drops = {"v_y1": [7.0, 7.1, 7.0], "v_y2": [5.2, 5.25, 5.19]}
            >>> with tempfile.TemporaryDirectory() as folder:
            ...     batch = fitball.batch({"a": drops}, out=folder, model="grip-slip", **options)
            >>> [quantity.meaning for quantity in batch.of("cor_measured")]
            ['COR of drops, as measured']
        """
        return [row[name] for row in self.quantities.values() if name in row]
