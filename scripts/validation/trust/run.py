"""Running the replicates of a scenario; what they said, on disk, one line a table."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from fitball.inference.results.results import Verdict
from fitball.scheduling.engine import Engine
from validation.shared.growing_csv import GrowingCsv
from validation.shared.replicates import Report, kept_replicates, silent
from validation.trust.replicate import Said, Told, replicate, settings_of
from validation.trust.scenarios import SCENARIOS

FIRST = ("answer", "p", "converged", "failed")
# Of each parameter.
FIELDS = ("verdict", "low", "high", "truth", "pinned")


def run_scenario(
    name: str, seed: int, replicates: int, path: Path, engine: Engine, report: Report = silent
) -> list[Told]:
    """Replicates 0 to `replicates` - 1 of the scenario called `name`; see `kept_replicates`.

    Raises ResultFolderError.
    """
    scenario = SCENARIOS[name]
    names = scenario.problem.free_names if scenario.fault is None else ()

    def cells(told: Told) -> list[str]:
        said = [_cells(told.parameters.get(parameter)) for parameter in names]
        return [
            told.answer,
            f"{told.p:.4g}",
            str(int(told.converged)),
            told.failed,
            *(c for one in said for c in one),
        ]

    def read(row: Mapping[str, str]) -> Told:
        said = {} if row["failed"] else {parameter: _said(row, parameter) for parameter in names}
        return Told(row["answer"], float(row["p"]), said, row["converged"] == "1", row["failed"])

    columns = (*FIRST, *(f"{parameter}:{field}" for parameter in names for field in FIELDS))
    file = GrowingCsv(path, columns, {"seed": seed, **settings_of(scenario)}, "fits")
    return kept_replicates(file, replicates, partial(replicate, name, seed), cells, read, engine, report)


def _cells(said: Said | None) -> list[str]:
    if said is None:
        return [""] * len(FIELDS)
    numbers = [f"{said.low:.9g}", f"{said.high:.9g}", "" if said.truth is None else f"{said.truth:.9g}"]
    return [str(said.verdict), *numbers, "" if said.pinned is None else str(int(said.pinned))]


def _said(row: Mapping[str, str], name: str) -> Said:
    verdict, low, high, truth, pinned = (row[f"{name}:{field}"] for field in FIELDS)
    known = (float(truth) if truth else None, pinned == "1" if pinned else None)
    return Said(Verdict(verdict), float(low), float(high), *known)
