"""Work over processes: the only place that knows joblib and Dask."""

import os
import re
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from threading import Thread
from time import sleep
from typing import Any

from fitball.base import environment
from fitball.base.errors import FitballError, MachineError, ParameterError, enough_memory

# Processes share the cores: threads of numerical libraries would only fight over them.
_ONE_EACH = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
# How loky says that a process ended.
_ENDED = re.compile(r"\b[A-Z]+\(-?\d+\)")
# How long a Dask scheduler may take to answer [s].
_PATIENCE = 10


def as_completed(
    make: Callable[[Any], Any],
    items: Sequence[Any],
    cores: int | None = None,
    address: str = "",
) -> Iterator[tuple[int, Any]]:
    """`make` of each item with its place, as they are done; a FitballError is returned, not raised.
    An item whose worker dies is tried once more alone, then returned as MachineError
    (`worker-died`). `address` is a Dask scheduler's. Functions of one's own travel by cloudpickle.

    Raises ParameterError (`scheduler`) where Dask is not installed or does not answer.
    """
    # A cluster has cores of its own.
    count = len(items) if address else min(cores or environment.cores(), len(items))
    if count < 2 and not address:
        yield from ((place, _made(make, "", item)) for place, item in enumerate(items))
        return
    task = partial(_made, make, os.getcwd() if address else "")  # noqa: PTH109 - a Path of another system may fail
    died = yield from _round(partial(_pool, count, address), task, items, range(len(items)))
    # Which of several items at work did it is unknown: a system short of memory kills any process.
    for place, _ in died:
        for _, words in (yield from _round(partial(_pool, 1, address), task, items, [place])):
            remedy = "most likely memory is short: use fewer cores, or another machine"
            text = f"the process that worked on it ended twice ({words}); {remedy}"
            yield place, MachineError(text, "worker-died")


def _made(make: Callable[[Any], Any], folder: str, item: Any) -> Any:
    """`make` of an item as a worker runs it: with one thread, in the `folder` of who asks if it
    exists there.
    """
    if folder and os.path.isdir(folder):  # noqa: PTH112
        os.chdir(folder)
    try:
        with environment.threads(1), enough_memory():
            return make(item)
    except FitballError as error:
        return error


def _round(
    pools: Callable[[], Any],
    task: Callable[[Any], Any],
    items: Sequence[Any],
    places: Sequence[int],
) -> Generator[tuple[int, Any], None, list[tuple[int, str]]]:
    """What is made of the items at these places; returns those whose worker died, with how."""
    waiting = deque(places)
    died = list[tuple[int, str]]()
    while waiting:
        with pools() as (pool, count, deaths):
            running: dict[Future[Any], int] = {}
            broken = False
            while running or (waiting and not broken):
                # No more at once than there are workers: one that dies takes few others with it.
                while waiting and len(running) < count and not broken:
                    try:
                        future = pool.submit(task, items[waiting[0]])
                    except deaths:
                        # A worker has died, at work or idle, and loky's others with it.
                        broken = True
                    else:
                        running[future] = waiting.popleft()
                if not running:
                    break
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    place = running.pop(future)
                    error = future.exception()
                    if isinstance(error, deaths):
                        died.append((place, ", ".join(_ENDED.findall(str(error))) or "killed"))
                    else:
                        yield place, future.result()
    return died


@contextmanager
def _pool(count: int, address: str) -> Iterator[tuple[Any, int, tuple[type[Exception], ...]]]:
    """An executor, how many items it works on at once, and how it says that a worker died."""
    if address:
        with _client(address) as client:
            from distributed.scheduler import KilledWorker

            threads = sum(client.nthreads().values())
            at_once = 2 * max(threads, 1) if count > 1 else 1
            yield client.get_executor(), at_once, (KilledWorker,)
        return
    from joblib.externals.loky import ProcessPoolExecutor

    # Without time limit: loky does not always notice the death of a worker that it started late.
    pool = ProcessPoolExecutor(count, timeout=None, env=_ONE_EACH, initializer=_begin)
    try:
        yield pool, count, (BrokenProcessPool,)
    finally:
        pool.shutdown(kill_workers=True)


def _client(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError:
        text = "a scheduler is given, but Dask is not installed here: pip install 'fitball[dask]'"
        raise ParameterError(text, "scheduler") from None
    option = "scheduler_file" if address.endswith(".json") else "address"
    try:
        return Client(timeout=_PATIENCE, set_as_default=False, **{option: address})  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        wanted = (
            "expected an address such as tcp://localhost:8786, or the file that the scheduler wrote"
        )
        text = f"scheduler: read '{address}'; no Dask scheduler answers there ({error}); {wanted}"
        raise ParameterError(text, "scheduler") from None


def _begin() -> None:
    """Only the process that asks acts on Ctrl-C, and ends the others; if it is killed, they end
    themselves. Loky takes growth since the first item for a leak, and would replace the worker
    under the next.
    """
    from joblib.externals.loky import process_executor

    process_executor._USE_PSUTIL = False
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_outlive, args=(os.getppid(),), daemon=True).start()


def _outlive(parent: int) -> None:
    """End this process soon after its parent, whose place another takes (on Windows none does)."""
    while os.getppid() == parent:
        sleep(1.0)
    os._exit(1)
