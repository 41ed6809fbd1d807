"""Running the replicates of a case over several sittings; what they gave, on disk."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from fitball.report.form.growing_csv import GrowingCsv
from fitball.scheduling.engine import Engine, in_order
from fitball.studies.plan.cases import CASES
from fitball.studies.plan.findings import Finding, finding
from fitball.studies.plan.replicate import Narrowed, Ready, prepared, replicate
from fitball.version import __version__


def run_case(
    name: str,
    seed: int,
    replicates: int,
    path: Path,
    engine: Engine,
    report: Callable[[int], None] = lambda _done: None,
) -> Finding:
    """Replicates 0 to `replicates` - 1 of the case called `name`, those that `path` holds read and the others made
    and appended to it; `report` is told how many are done. Raises ResultFolderError.
    """
    ready = prepared(name, seed)
    kept = _file(ready, name, seed, path)
    done = kept.open()
    report(min(done, replicates))
    numbers = range(done, replicates)
    for number, made in zip(numbers, in_order(engine, partial(replicate, ready, seed), numbers), strict=True):
        cells: list[str] = []
        for design in ready.designs:
            cells += _cells(made[design], len(ready.plan.parts))
        kept.append(number, cells)
        report(number + 1)
    rows = [row for _, row in kept.rows(replicates)]
    return finding(name, ready, {design: [_read(ready, row, design) for row in rows] for design in ready.designs})


def _file(ready: Ready, name: str, seed: int, path: Path) -> GrowingCsv:
    columns = [
        f"{design}:{head}"
        for design in ready.designs
        for head in ("nats", "effective", *(f"sd {part.name}" for part in ready.plan.parts))
    ]
    promised = {design: f"{one.gain:.6g}" for design, one in ready.designs.items()}
    settings = {"version": __version__, "case": name, "seed": seed, "words": CASES[name].words, "promised": promised}
    return GrowingCsv(path, columns, settings, "refits")


def _cells(made: Narrowed | None, parts: int) -> list[str]:
    if made is None:
        return [""] * (parts + 2)
    return [f"{made.nats:.6g}", f"{made.effective:.0f}", *(f"{sd:.6g}" for sd in made.sds)]


def _read(ready: Ready, row: Mapping[str, str], design: str) -> Narrowed | None:
    if not row[f"{design}:nats"]:
        return None
    sds = np.array([float(row[f"{design}:sd {part.name}"]) for part in ready.plan.parts])
    return Narrowed(float(row[f"{design}:nats"]), sds, float(row[f"{design}:effective"]))
