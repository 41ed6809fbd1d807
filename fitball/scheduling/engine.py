"""Engines that run tasks on processes: joblib here, Dask on a cluster."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from fitball.errors import ParameterError
from fitball.wording import listen, on_command_line

Item = TypeVar("Item")
Made = TypeVar("Made")
# Each item with how its result is had, which raises what went wrong.
Attempt = Generator[tuple[Item, Callable[[], Made]], None, None]
# How addresses of Dask's schedulers begin; where one is written to a file, its name ends in .json.
ADDRESSES = ("tcp://", "tls://", "ws://", "wss://", "ucx://")
# How long a scheduler may take to answer [s].
PATIENCE = 20.0
# Tasks handed in at a time for each thread of the cluster: enough that none waits, few enough to hold.
AHEAD = 3


class Engine(Protocol):
    """Runs tasks on processes that stay warm from one task to the next."""

    def unordered(
        self,
        make: Callable[[Item], Made],
        items: Sequence[Item],
        here: Callable[[Item], Made] | None = None,
        lost: Callable[[Item, str], Made] | None = None,
    ) -> Iterator[Made]:
        """The result of `make` for each item, when it is ready. Function, items and results must be picklable, and
        only results are held in memory. Tasks begin in the order of the items: the longest comes first.

        `here` replaces `make` in the calling process, if that works too: it has the same result, and may report
        progress. With `lost` the calling process does no task, and a crash affects one task only. If the process of a
        task ends (a crash, too little memory), and again when it runs alone, `lost` makes the result from the item
        and the way it ended.

        The tasks stop when the iterator is closed. Raises ParameterError if a worker process was killed and there is
        no `lost`, and what `make` raises.
        """


def engine(cores: int | None = None, scheduler: str | None = None) -> Engine:
    """Joblib with `cores` processes on this machine (None: all cores), or a Dask cluster. Its `scheduler` is an
    address (`tcp://host:8786`) or the file that it wrote (`scheduler.json`).

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
            f"scheduler {scheduler}: expected the address of a Dask scheduler, such as tcp://localhost:8786, or its "
            "file, such as scheduler.json"
        )
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
    """A task as another process runs it: its messages have the form for Python or the command line as here, and
    it works in the same folder, if it exists there.
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


def tried_again(
    attempt: Callable[[Sequence[Item], bool], Attempt[Item, Made]],
    items: Sequence[Item],
    lost: Callable[[Item, str], Made] | None,
    death: type[Exception] | tuple[type[Exception], ...],
    words: Callable[[Exception], str],
) -> Iterator[Made]:
    """What an `attempt` at the items makes, each with how its result is had, which raises a `death` where its process
    died. With `lost` those are tried again when all others are done, alone: a system that is short of memory kills
    whichever process it likes, and Dask blames every task that was at a worker. `words` say how a process died.
    """
    died: list[tuple[Item, str]] = []
    for alone in (False, True):
        left, died = ([item for item, _how in died] if alone else items), []
        # Closed at once where nobody listens any longer: that ends what still runs.
        with closing(attempt(left, alone)) as made:
            for item, result in made:
                try:
                    yield result()
                except death as error:
                    if lost is None:
                        raise ParameterError(words(error)) from None
                    died.append((item, words(error)))
    for item, how in died:
        assert lost is not None
        yield lost(item, how)


@dataclass(frozen=True)
class ClusterEngine:
    """Tasks on the cluster of the Dask scheduler at `place`, an address or its file. Dask runs on processes, machines
    or a queue such as SLURM's.
    """

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
                "a scheduler is given, but Dask is not installed here: pip install 'fitball[dask]'"
            ) from None
        elsewhere = Elsewhere(make)

        def attempt(left: Sequence[Item], alone: bool) -> Attempt[Item, Made]:
            ahead = 1 if alone else AHEAD * max(1, sum(client.nthreads().values()))
            waiting = iter(left)
            futures = {client.submit(elsewhere, item, pure=False): item for item in islice(waiting, ahead)}
            running = as_completed(list(futures), loop=client.loop)
            for future in running:
                yield futures.pop(future), future.result
                future.release()
                for following in islice(waiting, 1):
                    added = client.submit(elsewhere, following, pure=False)
                    futures[added] = following
                    running.add(added)

        def words(error: Exception) -> str:
            return f"a worker of the cluster was killed: {error}" if lost is None else "the death of its workers"

        with self._client() as client:
            yield from tried_again(attempt, items, lost, KilledWorker, words)

    def _client(self) -> Any:
        from distributed import Client

        known = {"scheduler_file": self.place} if self.place.endswith(".json") else {"address": self.place}
        try:
            if b"tls://" in (Path(self.place).read_bytes() if Path(self.place).is_file() else self.place.encode()):
                self._check_certificates()
            return Client(timeout=PATIENCE, set_as_default=False, **known)
        except (OSError, ValueError) as error:
            raise ParameterError(
                f"scheduler {self.place}: no Dask scheduler answers at this address: {error}"
            ) from None

    def _check_certificates(self) -> None:
        """Raise ParameterError if Dask has no certificates, for its client would fail."""
        from distributed.security import Security

        try:
            known = Security().get_connection_args("client")["ssl_context"] is not None
            why = "none are given"
        except OSError as error:
            known, why = False, str(error)
        if not known:
            raise ParameterError(
                f"scheduler {self.place}: a TLS connection needs certificates ({why}): set the Dask "
                "environment variables DASK_DISTRIBUTED__COMM__TLS__CA_FILE, "
                "DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT and DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY"
            )
