"""Running many replicates, and their ranks on disk, one line each."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from fitball.scheduling.engine import Engine
from validation.sbc.replicate import Experiment, Ranked, run_replicate
from validation.shared.growing_csv import GrowingCsv
from validation.shared.replicates import Report, kept_replicates, silent

ENDING = ("converged", "steps", "ess", "r_hat", "failed")


def run_replicates(
    experiment: Experiment, seed: int, replicates: int, path: Path, engine: Engine, report: Report = silent
) -> list[Ranked]:
    """Replicates 0 to `replicates` - 1; see `kept_replicates`. Raises ResultFolderError."""
    names = experiment.names

    def cells(ranked: Ranked) -> list[str]:
        ranks = [str(ranked.ranks[name]) if ranked.ranks else "" for name in names]
        ending = [str(int(ranked.converged)), str(ranked.steps), f"{ranked.ess:.1f}", f"{ranked.r_hat:.4f}"]
        return [*ranks, *ending, ranked.failed]

    def read(row: Mapping[str, str]) -> Ranked:
        ranks = {} if row["failed"] else {name: int(row[name]) for name in names}
        r_hat = float(row["r_hat"])
        if not row["failed"] and not math.isfinite(r_hat):
            raise ValueError(r_hat)
        return Ranked(ranks, row["converged"] == "1", int(row["steps"]), float(row["ess"]), r_hat, row["failed"])

    file = GrowingCsv(path, (*names, *ENDING), {"seed": seed, **experiment.settings}, "ranks")
    make = partial(run_replicate, experiment, seed)
    return kept_replicates(file, replicates, make, cells, read, engine, report)
