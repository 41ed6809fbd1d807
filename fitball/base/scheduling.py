"""Work over processes: the only place that knows joblib and Dask."""

from __future__ import annotations

import os
import re
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from threading import Thread
from time import sleep
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from fitball.base import environment
from fitball.base.errors import FitballError, MachineError, ParameterError, enough_memory

if TYPE_CHECKING:
    from distributed import Client

_Input = TypeVar("_Input")
_Output = TypeVar("_Output")
# How loky says that a process ended.
_ENDED = re.compile(r"\b[A-Z]+\(-?\d+\)")
# How long a Dask scheduler may take to answer, and the first worker to connect to it [s].
_PATIENCE = 10
_WORKER_PATIENCE = 60


class _Workers(NamedTuple):
    """An executor, how many tasks it works on at once, and the errors by which it says that a
    worker died.
    """

    executor: Executor
    at_once: int
    deaths: tuple[type[Exception], ...]


def as_completed(
    work: Callable[[_Input], _Output],
    inputs: Sequence[_Input],
    cores: int | None = None,
    address: str = "",
) -> Iterator[tuple[int, _Output | FitballError]]:
    """What `work` returns for each input, with the number of the input, as they are done; a
    FitballError is returned, not raised.

    An input whose worker dies is tried once more alone, then its answer is a MachineError
    (`worker-died`). `address` is a Dask scheduler's. A user's functions travel by cloudpickle.

    Raises:
        ParameterError: Dask is not installed, does not answer or has no worker (`scheduler`).
        MachineError: the Dask scheduler ended meanwhile (`scheduler`).
    """
    # A cluster has cores of its own.
    count = len(inputs) if address else min(cores or environment.cores(), len(inputs))
    if count < 2 and not address:
        for number, case in enumerate(inputs):
            yield number, _answer(work, "", case)
        return
    folder = os.getcwd() if address else ""  # noqa: PTH109 - a Path of another system may fail
    task = partial(_answer, work, folder)
    died = yield from _answers(partial(_workers, count, address), task, inputs, range(len(inputs)))
    # Which of several at work did it is unknown: a system short of memory kills any process.
    for number, _ in died:
        alone = partial(_workers, 1, address)
        died_again = yield from _answers(alone, task, inputs, [number])
        for _, end in died_again:
            remedy = "most likely memory is short: use fewer cores, or another machine"
            text = f"the process that worked on it ended twice ({end}); {remedy}"
            yield number, MachineError(text, "worker-died")


def _answer(work: Callable[[_Input], _Output], folder: str, case: _Input) -> _Output | FitballError:
    """What `work` returns for an input, or the FitballError that it raises. It runs with one
    thread, in the `folder` of the process that asks, if that exists here.
    """
    if folder and os.path.isdir(folder):  # noqa: PTH112
        os.chdir(folder)
    try:
        with environment.threads(1), enough_memory():
            return work(case)
    except FitballError as error:
        return error


def _answers(
    workers: Callable[[], AbstractContextManager[_Workers]],
    task: Callable[[_Input], _Output],
    inputs: Sequence[_Input],
    numbers: Sequence[int],
) -> Generator[tuple[int, _Output], None, list[tuple[int, str]]]:
    """Answers to the inputs of these numbers, each with its number; returns the numbers of those
    whose worker died, with how it ended.
    """
    waiting = deque(numbers)
    died = list[tuple[int, str]]()
    while waiting:
        with workers() as (executor, at_once, deaths):
            running: dict[Future[_Output], int] = {}
            broken = False
            while running or (waiting and not broken):
                # No more at once than there are workers: one that dies takes few others with it.
                while waiting and len(running) < at_once and not broken:
                    try:
                        future = executor.submit(task, inputs[waiting[0]])
                    except deaths:
                        # A worker has died, at work or idle, and loky's others with it.
                        broken = True
                    else:
                        running[future] = waiting.popleft()
                if not running:
                    break
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    number = running.pop(future)
                    if future.cancelled():
                        text = "the Dask scheduler ended, or its connection: start it again"
                        raise MachineError(text, "scheduler")
                    error = future.exception()
                    if isinstance(error, deaths):
                        died.append((number, ", ".join(_ENDED.findall(str(error))) or "killed"))
                    else:
                        yield number, future.result()
    return died


@contextmanager
def _workers(count: int, address: str) -> Iterator[_Workers]:
    """Workers inside: `count` processes, or those of the Dask scheduler at the address."""
    if address:
        with _client(address) as client:
            from distributed.scheduler import KilledWorker

            threads = sum(client.nthreads().values())
            at_once = 2 * max(threads, 1) if count > 1 else 1
            yield _Workers(client.get_executor(), at_once, (KilledWorker,))
        return
    from joblib.externals.loky import ProcessPoolExecutor

    # Without time limit: loky does not always notice the death of a worker that it started late.
    pool = ProcessPoolExecutor(count, timeout=None, env=environment.ONE_THREAD, initializer=_begin)
    try:
        yield _Workers(pool, count, (BrokenProcessPool,))
    finally:
        pool.shutdown(kill_workers=True)


def _client(address: str) -> Client:
    """A client of the Dask scheduler at an address, or in the file that it wrote. Raises
    ParameterError (`scheduler`), also where no worker connects to it.
    """
    try:
        from distributed import Client
    except ImportError:
        command = environment.install_command("fitball[dask]")
        text = f"a scheduler is given, but Dask is not installed here: {command}"
        raise ParameterError(text, "scheduler") from None
    option = "scheduler_file" if address.endswith(".json") else "address"
    try:
        client = Client(timeout=_PATIENCE, set_as_default=False, **{option: address})  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        expected = (
            "expected an address such as tcp://localhost:8786, or the file that the scheduler wrote"
        )
        text = f"scheduler: read '{address}'; no Dask scheduler answers there ({error}); {expected}"
        raise ParameterError(text, "scheduler") from None
    try:
        client.wait_for_workers(1, timeout=_WORKER_PATIENCE)
    except TimeoutError:
        client.close()  # type: ignore[no-untyped-call]
        text = (
            f"scheduler: no worker connected to '{address}' within {_WORKER_PATIENCE} s; start "
            "one: dask worker ADDRESS --nthreads 1"
        )
        raise ParameterError(text, "scheduler") from None
    return client


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
