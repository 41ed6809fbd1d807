"""Tasks on processes of this machine, by joblib."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from fitball.errors import ParameterError
from fitball.scheduling.engine import Item, Made


@dataclass(frozen=True)
class LocalEngine:
    """As many processes as `cores`; one works in the process that asks."""

    cores: int

    def unordered(self, make: Callable[[Item], Made], items: Sequence[Item]) -> Iterator[Made]:
        """See `Engine`."""
        if self.cores == 1 or len(items) < 2:
            yield from map(make, items)
            return
        from joblib import Parallel, delayed
        from joblib.externals.loky.process_executor import TerminatedWorkerError

        # Tasks last seconds: one is handed out at a time, so that none waits behind a long one.
        run = Parallel(self.cores, return_as="generator_unordered", batch_size=1, max_nbytes=None)
        try:
            yield from run(delayed(make)(item) for item in items)
        except TerminatedWorkerError:
            raise ParameterError(
                "a process that worked was killed, as a system does that is short of memory: use fewer cores"
            ) from None
