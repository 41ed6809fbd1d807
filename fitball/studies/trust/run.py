"""Running the replicates of a scenario on several processes and over several sittings; what they said, on disk."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from fitball.inference.results.results import Verdict
from fitball.report.form.growing_csv import GrowingCsv
from fitball.scheduling.engine import Engine, in_order
from fitball.studies.trust.replicate import Said, Told, replicate, settings_of
from fitball.studies.trust.scenarios import SCENARIOS

FIELDS = ("verdict", "low", "high", "truth", "pinned")
FIRST = ("answer", "p", "converged", "failed")


@dataclass(frozen=True)
class ToldFile:
    """What the fits of a scenario said, one line a table: of each parameter of `names` the fields of `Said`."""

    path: Path
    names: tuple[str, ...]
    settings: Mapping[str, object]

    @property
    def file(self) -> GrowingCsv:
        """The file itself."""
        columns = (*FIRST, *(f"{name}:{field}" for name in self.names for field in FIELDS))
        return GrowingCsv(self.path, columns, self.settings, "fits")

    def append(self, number: int, told: Told) -> None:
        """Add one table. Raises ResultFolderError."""
        cells = [told.answer, f"{told.p:.4g}", str(int(told.converged)), told.failed]
        for name in self.names:
            one = told.parameters.get(name)
            cells += [""] * len(FIELDS) if one is None else _cells(one)
        self.file.append(number, cells)

    def read(self, count: int) -> list[Told]:
        """The first `count` tables. Raises ResultFolderError for a damaged line."""
        told = []
        for number, row in self.file.rows(count):
            try:
                told.append(self._told(row))
            except ValueError:
                raise self.file.damaged(number) from None
        return told

    def _told(self, row: Mapping[str, str]) -> Told:
        said = {} if row["failed"] else {name: _said(row, name) for name in self.names}
        return Told(row["answer"], float(row["p"]), said, row["converged"] == "1", row["failed"])


def _cells(said: Said) -> list[str]:
    numbers = [f"{said.low:.9g}", f"{said.high:.9g}", "" if said.truth is None else f"{said.truth:.9g}"]
    return [str(said.verdict), *numbers, "" if said.pinned is None else str(int(said.pinned))]


def _said(row: Mapping[str, str], name: str) -> Said:
    verdict, low, high, truth, pinned = (row[f"{name}:{field}"] for field in FIELDS)
    return Said(
        Verdict(verdict), float(low), float(high), float(truth) if truth else None, pinned == "1" if pinned else None
    )


def run_scenario(
    name: str,
    seed: int,
    replicates: int,
    path: Path,
    engine: Engine,
    report: Callable[[int], None] = lambda _done: None,
) -> list[Told]:
    """Replicates 0 to `replicates` - 1 of the scenario called `name`, those that `path` holds read and the others
    computed and appended to it.

    `report` is told the number of replicates done. Raises ResultFolderError. After Ctrl-C the same call goes on.
    """
    scenario = SCENARIOS[name]
    kept = ToldFile(path, scenario.problem.free_names, {"seed": seed, **settings_of(scenario)})
    done = kept.file.open()
    report(min(done, replicates))
    numbers = range(done, replicates)
    made = in_order(engine, partial(replicate, name, seed), numbers)
    for number, told in zip(numbers, made, strict=True):
        kept.append(number, told)
        report(number + 1)
    return kept.read(replicates)
