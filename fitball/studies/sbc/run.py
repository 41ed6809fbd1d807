"""Running many replicates, on several processes and over several sittings."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from fitball.inference.comparison.workers import ignore_interrupts, interrupts_held
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
    for number, ranked in _computed(partial(run_replicate, experiment, seed), range(done, replicates), cores):
        file.append(number, ranked)
        report(number + 1)
    return file.read(replicates)


def _computed(replicate: Callable[[int], Ranked], numbers: range, cores: int) -> Iterator[tuple[int, Ranked]]:
    """Replicates in order; `cores` processes, or none beside this one."""
    if cores == 1 or len(numbers) < 2:
        for number in numbers:
            yield number, replicate(number)
        return
    # Fresh processes: forking one that runs threads (as numerical libraries do) may hang.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(cores, len(numbers)), context, ignore_interrupts) as pool:
        try:
            with interrupts_held():
                results = pool.map(replicate, numbers)
            yield from zip(numbers, results, strict=True)
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
