"""Replicates of a study, made on several processes and over several sittings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

from fitball.scheduling.engine import Engine, in_order
from validation.shared.growing_csv import GrowingCsv

Made = TypeVar("Made")
# Is told how many replicates are done.
Report = Callable[[int], None]


def silent(_done: int) -> None:
    """Report nothing."""


def kept_replicates(
    file: GrowingCsv,
    count: int,
    make: Callable[[int], Made],
    cells: Callable[[Made], Sequence[str]],
    read: Callable[[Mapping[str, str]], Made],
    engine: Engine,
    report: Report,
) -> list[Made]:
    """Replicates 0 to `count` - 1: those that the file holds, and the others made and appended to it.

    `cells` puts one into a line, `read` takes it from there, with ValueError where it cannot be. Raises
    ResultFolderError. After Ctrl-C the same call goes on.
    """
    done = file.open()
    report(min(done, count))
    numbers = range(done, count)
    for number, made in zip(numbers, in_order(engine, make, numbers), strict=True):
        file.append(number, cells(made))
        report(number + 1)
    found = []
    for number, row in file.rows(count):
        try:
            found.append(read(row))
        except ValueError:
            raise file.damaged(number) from None
    return found
