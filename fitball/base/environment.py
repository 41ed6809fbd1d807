"""The machine: cores, threads that kernels share, where what was compiled is kept."""

import atexit
import functools
import logging
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

# Threads that kernels share; None: the cores of this process.
_count: ContextVar[int | None] = ContextVar("_count", default=None)
log = logging.getLogger("fitball")


def packages() -> dict[str, str]:
    """Versions of Python and of the packages that numbers depend on."""
    import platform
    from importlib.metadata import version

    names = ("numpy", "scipy", "numba", "lmfit", "emcee", "arviz-stats")
    return {"python": platform.python_version()} | {name: version(name) for name in names}


def cores() -> int:
    """Cores that this process may use, by its affinity where the system tells."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def threads(count: int | None) -> Iterator[None]:
    """Let kernels share draws over `count` threads inside (None: this process's cores); workers of
    a pool use one.
    """
    token = _count.set(count)
    try:
        yield
    finally:
        _count.reset(token)


def run_in_threads(work: Callable[[int, int], object], size: int, least: int) -> None:
    """Call `work(first, last)` for parts of `range(size)`, none below `least` if there are several,
    by threads.
    """
    parts = max(1, size // max(least, 1))
    # The system is asked for its cores only where these matter.
    parts = min(parts, _count.get() or cores()) if parts > 1 else 1
    edges = [size * k // parts for k in range(parts + 1)]
    others = [_pool(parts).submit(work, *edges[k : k + 2]) for k in range(1, parts)]
    work(edges[0], edges[1])
    for other in others:
        other.result()


@functools.cache
def _pool(count: int) -> ThreadPoolExecutor:
    """The pool of so many threads, which all kernels share."""
    return ThreadPoolExecutor(count, thread_name_prefix="fitball")


if hasattr(os, "register_at_fork"):
    # Threads do not live on in a child.
    os.register_at_fork(after_in_child=_pool.cache_clear)


@functools.cache
def cache_folder() -> Path:
    """Fitball's folder among the user's caches, or one for this process alone where that cannot be
    written.
    """
    set_by = ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "LOCALAPPDATA")
    folder = Path(next(filter(None, map(os.environ.get, set_by)), "~/.cache")) / "fitball"
    try:
        folder = folder.expanduser()
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except (OSError, RuntimeError):
        log.warning(
            "%s cannot be written, so the models are compiled in every run: set NUMBA_CACHE_DIR "
            "to a folder that can",
            folder,
        )
        folder = Path(tempfile.mkdtemp(prefix="fitball-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


@contextmanager
def once_for_all_processes(mark: Path, message: str) -> Iterator[None]:
    """Let one process at a time inside, and say so, until one has come through and left its
    `mark`.
    """
    if mark.exists():
        yield
        return
    import filelock

    mark.parent.mkdir(parents=True, exist_ok=True)
    with filelock.FileLock(f"{mark}.lock"):
        if not mark.exists():
            log.info("%s (kept in %s)", message, mark.parent)
        yield
        mark.touch()
