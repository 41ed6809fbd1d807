"""Ctrl-C and the processes that share work: it reaches every process of a terminal, ready or not."""

from __future__ import annotations

import multiprocessing
import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

from fitball.wording import listen

Made = TypeVar("Made")


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Processes started in here begin with Ctrl-C held back, so that none is caught halfway through its imports,
    until they call `die_on_interrupt` or `ignore_interrupts`. One that comes meanwhile is raised here afterwards.
    """
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def begin_worker(command_line: bool) -> None:
    """Messages are as the parent's, see `wording`; and as `die_on_interrupt`."""
    listen(command_line)
    die_on_interrupt()


def die_on_interrupt() -> None:
    """Only the parent has something to say about a Ctrl-C; one that was held back counts.

    A run in the background, for which the shell had it ignored, goes on ignoring it.
    """
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    _release()


def ignore_interrupts() -> None:
    """Only the parent acts on a Ctrl-C; the work in hand is finished."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _release()


def _release() -> None:
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def in_order(make: Callable[[int], Made], numbers: range, cores: int) -> Iterator[tuple[int, Made]]:
    """What `make` gives for each number, in order, by `cores` processes, or none beside this one."""
    if cores == 1 or len(numbers) < 2:
        for number in numbers:
            yield number, make(number)
        return
    # Fresh processes: forking one that runs threads (as numerical libraries do) may hang.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(cores, len(numbers)), context, ignore_interrupts) as pool:
        try:
            with interrupts_held():
                results = pool.map(make, numbers)
            yield from zip(numbers, results, strict=True)
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
