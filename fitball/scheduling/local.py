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
from functools import cache
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from pickle import PicklingError
from queue import SimpleQueue
from typing import Any

from fitball.errors import ParameterError
from fitball.scheduling.engine import Elsewhere, Item, Made

# Processes share the cores: threads of numerical libraries would only fight over them.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
# How long a process waits for another task before it ends [s].
WARM = 60
# How loky says that a process ended: the name of a signal, or EXIT, and its number.
_ENDED = re.compile(r"(?P<name>[A-Z]+)\((?P<code>-?\d+)\)")
# Processes of earlier calls that wait for a task, each a pool of its own.
_waiting: list[Any] = []


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
        if lost is not None:
            yield from self._isolated(Elsewhere(make), items, lost)
            return
        here = make if here is None else here
        if self.cores == 1 or len(items) < 2:
            yield from map(here, items)
            return
        from joblib.externals.loky.process_executor import TerminatedWorkerError

        waiting, ready = deque(items), SimpleQueue[Future[Made]]()
        workers = min(self.cores, len(items)) - 1
        pool, elsewhere = _pool(workers), Elsewhere(make)

        def hand_out(done: Future[Made] | None = None) -> None:
            """The next task to the process that is free; in a thread of the pool, while this one works."""
            if done is None or not (done.cancelled() or done.exception()):
                # One at a time, so that none waits behind a long one.
                for item in _taken(waiting):
                    pool.submit(elsewhere, item).add_done_callback(hand_out)
            if done is not None:
                ready.put(done)

        left, mine = len(items), _taken(waiting)
        try:
            with _interrupts_held():
                for _ in range(workers):
                    hand_out()
            while left:
                if not mine and ready.empty():
                    mine = _taken(waiting)
                yield here(mine.pop()) if mine else ready.get().result()
                left -= 1
        except TerminatedWorkerError:
            raise ParameterError(
                "a process that worked was killed, as a system does that is short of memory: use fewer cores"
            ) from None
        finally:
            waiting.clear()
            if left:
                pool.shutdown(wait=False, kill_workers=True)

    def _isolated(
        self, make: Callable[[Item], Made], items: Sequence[Item], lost: Callable[[Item, str], Made]
    ) -> Iterator[Made]:
        """Whose process died is tried again when all others are done, alone: a system that is short of memory kills
        whichever process it likes.
        """
        from joblib.externals.loky.process_executor import BrokenProcessPool

        died: list[tuple[Item, str]] = []
        for alone in (False, True):
            left, died = ([item for item, _how in died] if alone else items), []
            while alone and left and _waiting:
                # None that waits takes memory.
                _waiting.pop().shutdown(kill_workers=True)
            for item, done in _each_alone(1 if alone else self.cores, make, left):
                try:
                    yield done.result()
                except (BrokenProcessPool, PicklingError) as error:
                    died.append((item, _ending(error)))
        for item, how in died:
            yield lost(item, how)


def _each_alone(
    processes: int, make: Callable[[Item], Made], items: Sequence[Item]
) -> Iterator[tuple[Item, Future[Made]]]:
    """Every item with what became of it. Each process is a pool of its own: one that dies takes no other task with
    it. The process that asks only hands out.
    """
    waiting, ready = deque(items), SimpleQueue[tuple[Any, Item, Future[Made]]]()
    running: set[Any] = set()

    def hand_out(pool: Any) -> None:
        item = waiting.popleft()
        running.add(pool)
        with _interrupts_held():
            pool.submit(make, item).add_done_callback(lambda done: ready.put((pool, item, done)))

    try:
        for _ in range(min(processes, len(items))):
            hand_out(_waiting.pop() if _waiting else _one_process())
        while running:
            pool, item, done = ready.get()
            running.remove(pool)
            if done.exception() is not None:
                pool.shutdown(wait=False, kill_workers=True)
                pool = _one_process()
            if waiting:
                hand_out(pool)
            else:
                _waiting.append(pool)
            yield item, done
    finally:
        for pool in running:
            pool.shutdown(wait=False, kill_workers=True)


def _one_process() -> Any:
    from joblib.externals.loky import ProcessPoolExecutor

    settings = _settings()
    # Of a process that crashes the result tells, not a dump of its stack in the middle of the terminal.
    settings["env"]["PYTHONFAULTHANDLER"] = os.environ.get("PYTHONFAULTHANDLER", "")
    return ProcessPoolExecutor(1, **settings)


def _ending(error: Exception) -> str:
    """How a process ended, in words."""
    ended = _ENDED.search(str(error).rpartition("exit codes")[2])
    if ended is None:
        return " ".join(str(error).split("\n")[0].split())
    return f"exit code {ended['code']}" if int(ended["code"]) >= 0 else f"signal {ended['name']}"


def _taken(waiting: deque[Item]) -> list[Item]:
    """The next task, if there is one: another thread may just have taken the last."""
    try:
        return [waiting.popleft()]
    except IndexError:
        return []


def _pool(workers: int) -> Any:
    """The processes that work, those of an earlier call where they are still there."""
    from joblib.externals.loky import get_reusable_executor

    return get_reusable_executor(workers, **_settings())


def _settings() -> dict[str, Any]:
    """What every pool of processes has."""
    from multiprocessing import resource_tracker

    if sys.platform != "win32":
        # Processes need it, and Python lets Ctrl-C through again when it has started it.
        resource_tracker.ensure_running()
    begin = {"initializer": _begin, "initargs": (_lifeline()[0],)}
    return {"timeout": WARM, "env": dict.fromkeys(THREADS, "1"), **begin}


@cache
def _lifeline() -> tuple[Connection, Connection]:
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


def _begin(asker: Connection) -> None:
    """Only the process that asks acts on a Ctrl-C, and ends the others. Where it was killed they end with it: what
    they would write meets the files of whoever asks next.
    """
    threading.Thread(target=_end_with, args=(asker,), daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def _end_with(asker: Connection) -> None:
    wait([asker])
    os._exit(1)
