"""Running the replicates of a case; what they gave, on disk, one line a simulated table."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from fitball.scheduling.engine import Engine
from fitball.version import __version__
from validation.plan.cases import CASES
from validation.plan.findings import Finding, finding
from validation.plan.replicate import Narrowed, prepared, replicate
from validation.shared.growing_csv import GrowingCsv
from validation.shared.replicates import Report, kept_replicates, silent

Refits = Mapping[str, Narrowed | None]


def run_case(name: str, seed: int, replicates: int, path: Path, engine: Engine, report: Report = silent) -> Finding:
    """What replicates 0 to `replicates` - 1 of the case called `name` say; see `kept_replicates`.

    Raises ResultFolderError.
    """
    ready = prepared(name, seed)
    heads = ("nats", "effective", *(f"sd {part.name}" for part in ready.plan.parts))

    def cells(made: Refits) -> list[str]:
        return [cell for one in made.values() for cell in (_cells(one) if one else [""] * len(heads))]

    def read(row: Mapping[str, str]) -> Refits:
        return {design: _narrowed([row[f"{design}:{head}"] for head in heads]) for design in ready.designs}

    promised = {design: f"{one.gain:.6g}" for design, one in ready.designs.items()}
    settings = {"version": __version__, "case": name, "seed": seed, "words": CASES[name].words, "promised": promised}
    columns = [f"{design}:{head}" for design in ready.designs for head in heads]
    file = GrowingCsv(path, columns, settings, "refits")
    made = kept_replicates(file, replicates, partial(replicate, ready, seed), cells, read, engine, report)
    return finding(name, ready, {design: [one[design] for one in made] for design in ready.designs})


def _cells(one: Narrowed) -> list[str]:
    return [f"{one.nats:.6g}", f"{one.effective:.0f}", *(f"{sd:.6g}" for sd in one.sds)]


def _narrowed(cells: list[str]) -> Narrowed | None:
    if not cells[0]:
        return None
    nats, effective, *sds = map(float, cells)
    return Narrowed(nats, np.array(sds), effective)
