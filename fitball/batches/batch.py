"""`Batch`, the result of `batch`: many tables, each with a fit in a folder of its own."""

from __future__ import annotations

from typing import ClassVar

from fitball.base.errors import suggestion
from fitball.batches.batched import Batched
from fitball.report.page import Layout
from fitball.results.fit import Fit
from fitball.results.result import Result
from fitball.saved import files_of_fit


class Batch(Batched, Result):
    """Many tables, each fitted on its own: a mapping from names of tables to fits. `failed` says
    why tables could not be fitted; `population(name)` compares a quantity over tables.
    """

    record: ClassVar[str] = "batch.csv"

    @property
    def exit_code(self) -> int:
        """1 if a table could not be fitted, or a posterior did not converge."""
        return int(bool(self.failed) or bool((self.tables["status"] == "not converged").any()))

    @property
    def _layout(self) -> Layout:
        from fitball.batches.page import PAGE

        return PAGE.of(self)

    def __getitem__(self, name: str) -> Fit:
        """The fit of a table, read when asked for. Raises KeyError with the reason of a table that
        failed.
        """
        if name not in self.tables.index:
            raise KeyError(f"{name}: {suggestion(name, self.tables.index)}")
        if name in self.failed:
            raise KeyError(f"{name}: {self.failed[name]}")
        return Fit.of(files_of_fit.read(self.folder / name, self.own))
