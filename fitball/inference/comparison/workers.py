"""Ctrl-C and the processes that share work: it reaches every process of a terminal, ready or not."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager


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
