"""Tasks on a Dask cluster: whatever Dask runs on, be it processes, machines or a queue such as SLURM's."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
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
        lost: Callable[[Item, str], Made] | None = None,
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
            ahead = AHEAD * max(1, sum(client.nthreads().values()))
            died: list[tuple[Item, str]] = []
            # Dask blames every task that was at a worker when it died, though only one can have killed it: those are
            # tried again one by one.
            for alone in (False, True):
                left, died = ([item for item, _how in died] if alone else items), []
                waiting, elsewhere = iter(left), Elsewhere(make)
                first = islice(waiting, 1 if alone else ahead)
                futures = {client.submit(elsewhere, item, pure=False): item for item in first}
                running = as_completed(list(futures), loop=client.loop)
                for future in running:
                    item = futures.pop(future)
                    try:
                        yield future.result()
                    except KilledWorker as error:
                        if lost is None:
                            raise ParameterError(f"a worker of the cluster was killed: {error}") from None
                        died.append((item, "the death of the workers that tried it"))
                    future.release()
                    for following in islice(waiting, 1):
                        added = client.submit(elsewhere, following, pure=False)
                        futures[added] = following
                        running.add(added)
            for item, how in died:
                assert lost is not None
                yield lost(item, how)

    def _client(self) -> Any:
        from distributed import Client

        known = {"scheduler_file": self.place} if self.place.endswith(".json") else {"address": self.place}
        try:
            if b"tls://" in (Path(self.place).read_bytes() if Path(self.place).is_file() else self.place.encode()):
                self._check_certificates()
            return Client(timeout=PATIENCE, set_as_default=False, **known)
        except (OSError, ValueError) as error:
            raise ParameterError(f"scheduler {self.place}: no Dask scheduler answers there: {error}") from None

    def _check_certificates(self) -> None:
        """Raise ParameterError where Dask was not told of certificates: its client would end in a fault."""
        from distributed.security import Security

        try:
            known = Security().get_connection_args("client")["ssl_context"] is not None
            why = "none was named"
        except OSError as error:
            known, why = False, str(error)
        if not known:
            raise ParameterError(
                f"scheduler {self.place}: a connection by TLS needs certificates ({why}): name them to Dask by the "
                "environment variables DASK_DISTRIBUTED__COMM__TLS__CA_FILE, "
                "DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT and DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY"
            )
