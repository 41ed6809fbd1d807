"""The machine: cores, threads that kernels share, where what was compiled is kept."""

import atexit
import functools
import logging
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from pathlib import Path
from threading import Lock

# By these a process tells linear algebra to use one thread, before NumPy starts. Its matrices here
# are small: more threads wait for each other, and sums would depend on their number.
ONE_THREAD = dict.fromkeys(
    (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
    ),
    "1",
)
# Threads that kernels share; None: the cores of this process.
_count: ContextVar[int | None] = ContextVar("_count", default=None)
log = logging.getLogger("fitball")


def packages() -> dict[str, str]:
    """Versions of Python and of the packages that numbers depend on."""
    import platform
    from importlib.metadata import version

    names = ("numpy", "scipy", "numba", "lmfit", "emcee")
    return {"python": platform.python_version()} | {name: version(name) for name in names}


def install_command(requirement: str) -> str:
    """The command that adds a package to the environment of this process: by the `pip` beside its
    Python, which need not be on PATH.
    """
    pip = Path(sys.executable).with_name("pip")
    return f'{pip if pip.exists() else "pip"} install "{requirement}"'


def cores() -> int:
    """Cores that this process may use, by its affinity where the system tells."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def threads(count: int | None) -> Iterator[None]:
    """Let kernels share draws over `count` threads inside (None: this process's cores); workers of
    a pool use one. Linear algebra uses one in any case.
    """
    token = _count.set(count)
    try:
        with _one_thread_of_algebra():
            yield
    finally:
        _count.reset(token)


class _Limit:
    """The limit of linear algebra in this process while `users` of it are at work: fits in several
    threads share it, and the last to leave lifts it.
    """

    def __init__(self) -> None:
        self.lock = Lock()
        self.users = 0
        self.held = ExitStack()

    def enter(self) -> None:
        """Limit linear algebra to one thread, unless another user did."""
        from threadpoolctl import threadpool_limits

        with self.lock:
            if not self.users:
                self.held.enter_context(threadpool_limits(1, "blas"))
            self.users += 1

    def leave(self) -> None:
        """Give linear algebra its threads back, unless others are at work."""
        with self.lock:
            self.users -= 1
            if not self.users:
                self.held.close()


_limit = _Limit()


@contextmanager
def _one_thread_of_algebra() -> Iterator[None]:
    """Let linear algebra of this process use one thread inside."""
    if os.environ.get("OPENBLAS_NUM_THREADS") == "1":
        # The command line and workers say so before NumPy starts.
        yield
        return
    # SciPy has linear algebra of its own, which is found only once it is loaded.
    import scipy.linalg  # noqa: F401

    _limit.enter()
    try:
        yield
    finally:
        _limit.leave()


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
