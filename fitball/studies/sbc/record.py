"""Ranks on disk, one line a replicate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fitball.report.form.growing_csv import GrowingCsv
from fitball.studies.sbc.replicate import Ranked

ENDING = ("converged", "steps", "ess", "r_hat", "failed")


@dataclass(frozen=True)
class RankFile:
    """The file at `path` for the quantities `names`, made with `settings`; see `GrowingCsv`."""

    path: Path
    names: tuple[str, ...]
    settings: Mapping[str, object]

    @property
    def _file(self) -> GrowingCsv:
        return GrowingCsv(self.path, (*self.names, *ENDING), self.settings, "ranks")

    def open(self) -> int:
        """See `GrowingCsv.open`."""
        return self._file.open()

    def append(self, number: int, ranked: Ranked) -> None:
        """Add one replicate. Raises ResultFolderError."""
        ranks = [str(ranked.ranks[name]) if ranked.ranks else "" for name in self.names]
        ending = [str(int(ranked.converged)), str(ranked.steps), f"{ranked.ess:.1f}", f"{ranked.r_hat:.4f}"]
        self._file.append(number, [*ranks, *ending, ranked.failed])

    def read(self, count: int) -> list[Ranked]:
        """The first `count` replicates. Raises ResultFolderError for a damaged line."""
        ranked = []
        for number, row in self._file.rows(count):
            try:
                ranked.append(self._ranked(row))
            except ValueError:
                raise self._file.damaged(number) from None
        return ranked

    def _ranked(self, row: Mapping[str, str]) -> Ranked:
        ranks = {} if row["failed"] else {name: int(row[name]) for name in self.names}
        r_hat = float(row["r_hat"])
        if not row["failed"] and not math.isfinite(r_hat):
            raise ValueError(r_hat)
        return Ranked(ranks, row["converged"] == "1", int(row["steps"]), float(row["ess"]), r_hat, row["failed"])
