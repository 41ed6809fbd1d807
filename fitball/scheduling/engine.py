"""The door: which engine runs tasks, and what may be asked of any. Nothing is scheduled by code of ours."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol, TypeVar

from fitball.errors import ParameterError

Item = TypeVar("Item")
Made = TypeVar("Made")
# How addresses of Dask's schedulers begin; where one is written to a file, its name ends in .json.
ADDRESSES = ("tcp://", "tls://", "ws://", "wss://", "ucx://")


class Engine(Protocol):
    """Runs tasks on processes that stay warm from one task to the next."""

    def unordered(self, make: Callable[[Item], Made], items: Sequence[Item]) -> Iterator[Made]:
        """What `make` gives for each item, as it is ready. Function, items and what is made must be picklable, and
        nothing but what is made is held in memory.

        Raises ParameterError where a process that works was killed, and what `make` raises.
        """


def engine(cores: int, scheduler: str | None = None) -> Engine:
    """Joblib with `cores` processes on this machine, or the Dask cluster whose `scheduler` is at an address
    (`tcp://host:8786`) or is described by a file that it wrote (`scheduler.json`).

    Raises ParameterError for another kind of address, or where Dask is not installed or does not answer.
    """
    if scheduler is None:
        from fitball.scheduling.local import LocalEngine

        return LocalEngine(cores)
    if not scheduler.startswith(ADDRESSES) and not scheduler.endswith(".json"):
        raise ParameterError(
            f"scheduler {scheduler}: expected the address of a Dask scheduler, such as tcp://localhost:8786, or the "
            "file that it wrote, such as scheduler.json"
        )
    from fitball.scheduling.cluster import ClusterEngine

    return ClusterEngine(scheduler)
