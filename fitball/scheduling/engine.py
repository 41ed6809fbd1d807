"""The door: which engine runs tasks, and what may be asked of any. Nothing is scheduled by code of ours."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from fitball.errors import ParameterError
from fitball.wording import listen, on_command_line

Item = TypeVar("Item")
Made = TypeVar("Made")
# How addresses of Dask's schedulers begin; where one is written to a file, its name ends in .json.
ADDRESSES = ("tcp://", "tls://", "ws://", "wss://", "ucx://")


class Engine(Protocol):
    """Runs tasks on processes that stay warm from one task to the next."""

    def unordered(
        self,
        make: Callable[[Item], Made],
        items: Sequence[Item],
        here: Callable[[Item], Made] | None = None,
        lost: Callable[[Item, str], Made] | None = None,
    ) -> Iterator[Made]:
        """What `make` gives for each item, as it is ready. Function, items and what is made must be picklable, and
        nothing but what is made is held in memory. Tasks begin in the order of the items: the longest comes first.

        `here` stands for `make` in the process that asks, where that works too: it makes the same, and may tell how
        far it is. With `lost` nothing is made in the process that asks, and no task can end more than itself: where
        the process of one dies (a crash, too little memory), and again when nothing else runs, `lost` makes the
        result from the item and how the process ended, in words.

        Whoever stops listening stops the tasks. Raises ParameterError where a process that works was killed and there
        is no `lost`, and what `make` raises.
        """


def engine(cores: int | None = None, scheduler: str | None = None) -> Engine:
    """Joblib with `cores` processes on this machine (None: as many as it has), or the Dask cluster whose `scheduler`
    is at an address (`tcp://host:8786`) or is described by a file that it wrote (`scheduler.json`).

    Raises ParameterError for fewer than one core, or another kind of address.
    """
    wanted = (os.cpu_count() or 1) if cores is None else cores
    if wanted < 1:
        raise ParameterError(f"cores = {wanted}: expected at least 1")
    if scheduler is None:
        from fitball.scheduling.local import LocalEngine

        return LocalEngine(wanted)
    if not scheduler.startswith(ADDRESSES) and not scheduler.endswith(".json"):
        raise ParameterError(
            f"scheduler {scheduler}: expected the address of a Dask scheduler, such as tcp://localhost:8786, or the "
            "file that it wrote, such as scheduler.json"
        )
    from fitball.scheduling.cluster import ClusterEngine

    return ClusterEngine(scheduler)


def in_order(engine: Engine, make: Callable[[Item], Made], items: Sequence[Item]) -> Iterator[Made]:
    """As `Engine.unordered`, in the order of the items; what is ready early waits for those before it."""
    early: dict[int, Made] = {}
    following = 0
    for place, made in engine.unordered(_Placed(make), list(enumerate(items))):
        early[place] = made
        while following in early:
            yield early.pop(following)
            following += 1


@dataclass(frozen=True)
class _Placed(Generic[Item, Made]):
    """A task that remembers its place."""

    make: Callable[[Item], Made]

    def __call__(self, placed: tuple[int, Item]) -> tuple[int, Made]:
        place, item = placed
        return place, self.make(item)


class Elsewhere(Generic[Item, Made]):
    """A task as another process runs it: its messages speak to whom they speak to here, and files are named from the
    same folder, if it is there.
    """

    def __init__(self, make: Callable[[Item], Made]) -> None:
        self.make = make
        self.command_line = on_command_line()
        self.folder = Path.cwd()

    def __call__(self, item: Item) -> Made:
        """Run it on `item`."""
        listen(self.command_line)
        if self.folder.is_dir():
            os.chdir(self.folder)
        return self.make(item)
