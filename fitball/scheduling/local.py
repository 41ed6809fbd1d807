"""Tasks on processes of this machine, by loky, the executor of joblib."""

from __future__ import annotations

import os
import re
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from multiprocessing import Pipe
from multiprocessing.connection import wait
from pickle import PicklingError
from queue import SimpleQueue
from time import monotonic
from typing import Any

from fitball.scheduling.engine import Attempt, Elsewhere, Item, Made, tried_again

# Processes share the cores: threads of numerical libraries would only fight over them.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
# How long a process waits for another task before it ends [s].
WARM = 60
# How loky says that a process ended: the name of a signal, or EXIT, and its number.
_ENDED = re.compile(r"(?P<name>[A-Z]+)\((?P<code>-?\d+)\)")
# Processes of earlier calls that wait for a task, each a pool of its own, and since when [s]: one that dies takes no
# other task with it.
_waiting: list[tuple[Any, float]] = []


@dataclass(frozen=True)
class LocalEngine:
    """As many processes as `cores`, the one that asks among them where it works too."""

    cores: int

    def unordered(
        self,
        make: Callable[[Item], Made],
        items: Sequence[Item],
        here: Callable[[Item], Made] | None = None,
        lost: Callable[[Item, str], Made] | None = None,
    ) -> Iterator[Made]:
        """See `Engine`."""
        here = make if here is None else here
        if lost is None and (self.cores == 1 or len(items) < 2):
            yield from map(here, items)
            return
        from joblib.externals.loky.process_executor import BrokenProcessPool, TerminatedWorkerError

        elsewhere = Elsewhere(make)

        def attempt(left: Sequence[Item], alone: bool) -> Attempt[Item, Made]:
            while alone and left and _waiting:
                # None that waits takes memory.
                _waiting.pop()[0].shutdown(kill_workers=True)
            if lost is None:
                return _each(self.cores - 1, elsewhere, left, here)
            return _each(1 if alone else self.cores, elsewhere, left)

        if lost is None:
            yield from tried_again(attempt, items, None, TerminatedWorkerError, _killed)
        else:
            yield from tried_again(attempt, items, lost, (BrokenProcessPool, PicklingError), _ending)


def _each(
    processes: int, make: Callable[[Item], Made], items: Sequence[Item], here: Callable[[Item], Made] | None = None
) -> Attempt[Item, Made]:
    """Every item with how its result is had, as it is ready; the process that asks makes some too by `here`."""
    waiting, ready = deque(items), SimpleQueue[tuple[Any, Item, Future[Made], bool]]()
    running: set[Any] = set()

    def hand_out(pool: Any) -> bool:
        """The next task to a process that is free, one at a time, so that none waits behind a long one; whether there
        was one.
        """
        taken = _taken(waiting)
        for item in taken:
            running.add(pool)
            pool.submit(make, item).add_done_callback(partial(finished, pool, item))
        return bool(taken)

    def finished(pool: Any, task: Item, done: Future[Made]) -> None:
        """In a thread of the pool, while this process works."""
        ready.put((pool, task, done, not (done.cancelled() or done.exception()) and hand_out(pool)))

    def begin() -> None:
        pool = _warm() or _one_process()
        with _interrupts_held():
            hand_out(pool)

    left, mine = len(items), _taken(waiting) if here else []
    try:
        for _ in range(min(processes, len(waiting))):
            begin()
        while left:
            if here and not mine and ready.empty():
                mine = _taken(waiting)
            if here and mine:
                item = mine.pop()
                yield item, partial(here, item)
            else:
                pool, item, done, busy = ready.get()
                if not busy:
                    running.remove(pool)
                    if done.exception() is None:
                        _waiting.append((pool, monotonic()))
                    else:
                        pool.shutdown(wait=False, kill_workers=True)
                        if waiting:
                            begin()
                yield item, done.result
            left -= 1
    finally:
        waiting.clear()
        for pool in list(running):
            pool.shutdown(wait=False, kill_workers=True)


def _taken(waiting: deque[Item]) -> list[Item]:
    """The next task, if there is one: another thread may just have taken the last."""
    try:
        return [waiting.popleft()]
    except IndexError:
        return []


def _warm() -> Any | None:
    """A pool that waits, if there is one whose process is surely there. Where it has ended, loky starts another with
    the next task, but may not notice when that one dies: who asked would wait for ever.
    """
    while _waiting:
        pool, since = _waiting.pop()
        if monotonic() - since < 0.5 * WARM:
            return pool
        pool.shutdown(wait=False, kill_workers=True)
    return None


def _killed(_error: Exception) -> str:
    return "a worker process was killed, probably for lack of memory: use fewer cores"


def _ending(error: Exception) -> str:
    """How a process ended, in words."""
    ended = _ENDED.search(str(error).rpartition("exit codes")[2])
    if ended is None:
        return " ".join(str(error).split("\n")[0].split())
    return f"exit code {ended['code']}" if int(ended["code"]) >= 0 else f"signal {ended['name']}"


def _one_process() -> Any:
    from multiprocessing import resource_tracker

    from joblib.externals.loky import ProcessPoolExecutor

    if sys.platform != "win32":
        # Processes need it, and Python lets Ctrl-C through again when it has started it.
        resource_tracker.ensure_running()
    # A crash is reported with the result, not by a dump of the stack in the middle of the terminal.
    quiet = {"PYTHONFAULTHANDLER": os.environ.get("PYTHONFAULTHANDLER", "")}
    env = dict.fromkeys(THREADS, "1") | quiet
    return ProcessPoolExecutor(1, timeout=WARM, env=env, initializer=_begin, initargs=(_lifeline()[0],))


@cache
def _lifeline() -> tuple[Any, Any]:
    """A pipe whose other end this process alone holds and never writes to: who reads it is woken when this one ends,
    however it ends.
    """
    return Pipe(duplex=False)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Processes started in here begin with Ctrl-C, which reaches every process of a terminal, held back, so that none
    is caught halfway through its imports, until they call `_begin`. One that comes meanwhile is raised here
    afterwards.
    """
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(asker: Any) -> None:
    """Only the process that asks acts on a Ctrl-C, and ends the others. Where it was killed they end with it, since
    they might write into files of the next run.
    """
    from joblib.externals.loky import process_executor

    # Loky takes growth since the first task for a leak, but one task is a sleep and the next a fit: its process would
    # be replaced with a warning, under the next task.
    process_executor._USE_PSUTIL = False
    threading.Thread(target=_end_with, args=(asker,), daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def _end_with(asker: Any) -> None:
    wait([asker])
    os._exit(1)
