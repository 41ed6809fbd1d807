"""What a batch found: a row a table, populations of quantities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fitball.base.errors import Note, ParameterError, suggestion
from fitball.base.numbers import counted
from fitball.base.values import DataFrame
from fitball.batches.rows import FAILED, Quantity, over_tables
from fitball.models.model import Model
from fitball.uses.hierarchy import Hierarchy


@dataclass(frozen=True, eq=False, repr=False)
class Batched:
    """Frames `tables` (`batch.csv`: a row a table, with outcome, adequacy, quantities in SI with
    sds and verdicts, measured pace and rebound) and `populations` (centre and spread of each
    quantity that three tables determine). `quantities` are those of each table, by name; `own` is
    the function of one's own that all were fitted with.
    """

    folder: Path
    tables: DataFrame
    populations: DataFrame
    quantities: Mapping[str, Mapping[str, Quantity]]
    notes: tuple[Note, ...] = ()
    own: Model | None = None

    def __repr__(self) -> str:
        tables = counted(len(self.tables), "table")
        return f"<Batch of {tables} in {self.folder}, {len(self.failed)} failed>"

    @property
    def frames(self) -> Mapping[str, DataFrame]:
        """Both frames, named as their files."""
        return {"batch": self.tables, "population": self.populations}

    @property
    def failed(self) -> Mapping[str, str]:
        """Why tables could not be fitted, by name."""
        return dict(self.tables["reason"][self.tables["outcome"] == FAILED])

    def population(self, name: str) -> Hierarchy:
        """Draws of centre and spread of a quantity over the tables that determine it, of a new
        table, of each given all others; in SI, but the spread of a logarithm, which is relative.
        Raises ParameterError (`unknown-quantity`, `too-few-tables`).
        """
        names = dict.fromkeys(name for row in self.quantities.values() for name in row)
        if name not in names:
            raise ParameterError(f"read '{name}': {suggestion(name, names)}", "unknown-quantity")
        return over_tables(name, self.of(name))

    def of(self, name: str) -> list[Quantity]:
        """A quantity of the tables that determine it, in their order."""
        return [row[name] for row in self.quantities.values() if name in row]
