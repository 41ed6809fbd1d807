"""Tasks on processes of this machine, by loky, the executor of joblib."""

from __future__ import annotations

import signal
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any

from fitball.errors import ParameterError
from fitball.scheduling.engine import Elsewhere, Item, Made

# Processes share the cores: threads of numerical libraries would only fight over them.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
# How long a process waits for another task before it ends [s].
WARM = 60


@dataclass(frozen=True)
class LocalEngine:
    """As many processes as `cores`, the one that asks among them."""

    cores: int

    def unordered(
        self, make: Callable[[Item], Made], items: Sequence[Item], here: Callable[[Item], Made] | None = None
    ) -> Iterator[Made]:
        """See `Engine`."""
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


def _taken(waiting: deque[Item]) -> list[Item]:
    """The next task, if there is one: another thread may just have taken the last."""
    try:
        return [waiting.popleft()]
    except IndexError:
        return []


def _pool(workers: int) -> Any:
    """The processes that work, those of an earlier call where they are still there."""
    from multiprocessing import resource_tracker

    from joblib.externals.loky import get_reusable_executor

    if sys.platform != "win32":
        # Processes need it, and Python lets Ctrl-C through again when it has started it.
        resource_tracker.ensure_running()
    return get_reusable_executor(
        workers, timeout=WARM, initializer=_ignore_interrupts, env=dict.fromkeys(THREADS, "1")
    )


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Processes started in here begin with Ctrl-C, which reaches every process of a terminal, held back, so that none
    is caught halfway through its imports, until they call `_ignore_interrupts`. One that comes meanwhile is raised
    here afterwards.
    """
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _ignore_interrupts() -> None:
    """Only the process that asks acts on a Ctrl-C, and ends the others."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
