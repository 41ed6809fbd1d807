"""Tasks on a Dask cluster: whatever Dask runs on, be it processes, machines or a queue such as SLURM's."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

from fitball.errors import ParameterError
from fitball.scheduling.engine import Elsewhere, Item, Made

# How long a scheduler may take to answer [s].
PATIENCE = 20.0
# Tasks handed in at a time for each thread of the cluster: enough that none waits, few enough to hold.
AHEAD = 3


@dataclass(frozen=True)
class ClusterEngine:
    """The cluster of the Dask scheduler at `place`: an address, or the file that describes it."""

    place: str

    def unordered(
        self,
        make: Callable[[Item], Made],
        items: Sequence[Item],
        here: Callable[[Item], Made] | None = None,  # noqa: ARG002 - nothing is made here
    ) -> Iterator[Made]:
        """See `Engine`. Raises ParameterError where Dask is not installed or does not answer too."""
        try:
            from distributed import as_completed
            from distributed.scheduler import KilledWorker
        except ImportError:
            raise ParameterError(
                "a scheduler was named, but Dask is not installed here: pip install 'fitball[dask]'"
            ) from None
        with self._client() as client:
            waiting = iter(items)
            elsewhere = Elsewhere(make)
            ahead = AHEAD * max(1, sum(client.nthreads().values()))
            first = [client.submit(elsewhere, item, pure=False) for item in islice(waiting, ahead)]
            running = as_completed(first, loop=client.loop)
            try:
                for future in running:
                    yield future.result()
                    future.release()
                    for item in waiting:
                        running.add(client.submit(elsewhere, item, pure=False))
                        break
            except KilledWorker as error:
                raise ParameterError(f"a worker of the cluster was killed: {error}") from None

    def _client(self) -> Any:
        from distributed import Client

        known = {"scheduler_file": self.place} if self.place.endswith(".json") else {"address": self.place}
        try:
            return Client(timeout=PATIENCE, set_as_default=False, **known)
        except (OSError, ValueError) as error:
            raise ParameterError(f"scheduler {self.place}: no Dask scheduler answers there: {error}") from None
