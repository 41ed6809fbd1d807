"""`Batch`, the result of `batch`: many tables, each with a fit in a folder of its own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from fitball.base.errors import suggestion
from fitball.batches.batched import Batched
from fitball.report.page import Layout
from fitball.results.fit import Fit
from fitball.results.result import Result
from fitball.saved import files_of_fit


class Batch(Batched, Result, Mapping[str, Fit]):
    """Many tables, each fitted on its own: a mapping from names of tables to fits, without those
    that `failed`, which says why. `population(name)` compares a quantity over tables.

    Example:
        >>> import tempfile
        >>> import fitball
        >>> options = {"point_only": True, "cores": 1, "figures": "none", "progress": False}
        >>> drops = {"v_y1": [7.0, 7.1, 7.0], "v_y2": [5.2, 5.25, 5.19]}
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     batch = fitball.batch({"a": drops}, out=folder, model="grip-slip", **options)
        ...     cor = batch["a"].parameters["cor_10"]
        >>> int(batch.tables["impacts"]["a"]), round(cor.point, 2)
        (3, 0.74)
    """

    record: ClassVar[str] = "batch.csv"

    @property
    def exit_code(self) -> int:
        """1 if a table could not be fitted, or a posterior did not converge.

        Example:
            >>> import tempfile
            >>> import fitball
            >>> options = {"point_only": True, "cores": 1, "figures": "none", "progress": False}
            >>> drop = {"v_y1": [7.0], "v_y2": [5.2]}
            >>> with tempfile.TemporaryDirectory() as folder:
            ...     batch = fitball.batch({"too short": drop}, out=folder, **options)
            >>> batch.exit_code
            1
        """
        return int(bool(self.failed) or bool((self.tables["status"] == "not converged").any()))

    @property
    def _layout(self) -> Layout:
        from fitball.batches.page import PAGE

        return PAGE.of(self)

    def __iter__(self) -> Iterator[str]:
        return iter([name for name in self.tables.index if name not in self.failed])

    def __len__(self) -> int:
        return len(self.tables) - len(self.failed)

    def __getitem__(self, name: str) -> Fit:
        """The fit of a table, read from its folder.

        Raises:
            KeyError: there is no such table, or it could not be fitted, with the reason.
        """
        if name not in self.tables.index:
            raise KeyError(f"{name}: {suggestion(str(name), self.tables.index)}")
        if name in self.failed:
            raise KeyError(f"{name}: {self.failed[name]}")
        return Fit.of(files_of_fit.read(self.folder / name, self.own))
