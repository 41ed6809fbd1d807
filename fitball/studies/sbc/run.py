"""Running many replicates, on several processes and over several sittings."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from fitball.scheduling.engine import Engine, in_order
from fitball.studies.sbc.record import RankFile
from fitball.studies.sbc.replicate import Experiment, Ranked, run_replicate


def run_replicates(
    experiment: Experiment,
    seed: int,
    replicates: int,
    path: Path,
    engine: Engine,
    report: Callable[[int], None] = lambda _done: None,
) -> list[Ranked]:
    """Replicates 0 to `replicates` - 1, those that `path` holds read and the others computed and appended to it.

    `report` is told the number of replicates done. Raises ResultFolderError. After Ctrl-C the same call goes on.
    """
    file = RankFile(path, experiment.names, {"seed": seed, **experiment.settings})
    done = file.open()
    report(min(done, replicates))
    numbers = range(done, replicates)
    made = in_order(engine, partial(run_replicate, experiment, seed), numbers)
    for number, ranked in zip(numbers, made, strict=True):
        file.append(number, ranked)
        report(number + 1)
    return file.read(replicates)
