"""Ranks on disk: a CSV file that grows by one line per replicate, in order, so that an interrupted run goes on.

The first line is a comment with all that the ranks depend on. The same seed gives the same bytes, whatever the number
of processes and interruptions.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fitball.errors import ResultFolderError
from fitball.studies.sbc.replicate import Ranked

ENDING = ("converged", "steps", "ess", "r_hat", "failed")


@dataclass(frozen=True)
class RankFile:
    """The file at `path` for the quantities `names`, made with `settings`."""

    path: Path
    names: tuple[str, ...]
    settings: Mapping[str, object]

    @property
    def _head(self) -> str:
        marked = json.dumps(self.settings, sort_keys=True)
        return f"# {marked}\n{','.join(['replicate', *self.names, *ENDING])}\n"

    def open(self) -> int:
        """Make the file, or mend the end of one that was cut off; returns how many replicates it holds.

        Raises ResultFolderError when it cannot be read or written, or was made with other settings.
        """
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            if not self.path.exists():
                self.path.write_bytes(self._head.encode())
            text = self.path.read_bytes().decode("utf-8")
            if not text.startswith(self._head):
                raise ResultFolderError(
                    f"{self.path}: holds ranks of another run (seed, model, priors, table or version differ); remove "
                    "it, or name another folder with --out"
                )
            whole = text[: text.rindex("\n") + 1]
            if whole != text:
                self.path.write_bytes(whole.encode())
        except (OSError, UnicodeDecodeError) as error:
            raise ResultFolderError(f"{self.path}: cannot be read or written: {error}") from None
        return whole.count("\n") - self._head.count("\n")

    def append(self, number: int, ranked: Ranked) -> None:
        """Add one replicate. Raises ResultFolderError."""
        ranks = [str(ranked.ranks[name]) if ranked.ranks else "" for name in self.names]
        ending = [str(int(ranked.converged)), str(ranked.steps), f"{ranked.ess:.1f}", f"{ranked.r_hat:.4f}"]
        try:
            with self.path.open("a", encoding="utf-8", newline="") as file:
                csv.writer(file, lineterminator="\n").writerow([number, *ranks, *ending, ranked.failed])
        except OSError as error:
            raise ResultFolderError(f"{self.path}: cannot be written: {error}") from None

    def read(self, count: int) -> list[Ranked]:
        """The first `count` replicates. Raises ResultFolderError for a damaged line."""
        found = []
        with self.path.open(encoding="utf-8", newline="") as file:
            next(file)
            for number, row in enumerate(csv.DictReader(file)):
                if number == count:
                    break
                try:
                    found.append(self._ranked(number, row))
                except (KeyError, TypeError, ValueError):
                    raise ResultFolderError(
                        f"{self.path}: line {number + 3} is damaged; remove it and all that follow, and run again"
                    ) from None
        return found

    def _ranked(self, number: int, row: Mapping[str, str]) -> Ranked:
        if int(row["replicate"]) != number:
            raise ValueError(number)
        ranks = {} if row["failed"] else {name: int(row[name]) for name in self.names}
        r_hat = float(row["r_hat"])
        if not row["failed"] and not math.isfinite(r_hat):
            raise ValueError(r_hat)
        return Ranked(ranks, row["converged"] == "1", int(row["steps"]), float(row["ess"]), r_hat, row["failed"])
