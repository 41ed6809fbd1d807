"""Running many replicates, on several processes and over several sittings."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from fitball.inference.comparison.workers import in_order
from fitball.studies.sbc.record import RankFile
from fitball.studies.sbc.replicate import Experiment, Ranked, run_replicate


def run_replicates(
    experiment: Experiment,
    seed: int,
    replicates: int,
    path: Path,
    cores: int,
    report: Callable[[int], None] = lambda _done: None,
) -> list[Ranked]:
    """Replicates 0 to `replicates` - 1, those that `path` holds read and the others computed and appended to it.

    `report` is told the number of replicates done. Raises ResultFolderError. After Ctrl-C the same call goes on.
    """
    file = RankFile(path, experiment.names, {"seed": seed, **experiment.settings})
    done = file.open()
    report(min(done, replicates))
    for number, ranked in in_order(partial(run_replicate, experiment, seed), range(done, replicates), cores):
        file.append(number, ranked)
        report(number + 1)
    return file.read(replicates)
