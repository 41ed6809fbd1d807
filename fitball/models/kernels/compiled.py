"""How kernels are compiled: `njit(cache=True)` without the GIL, in a folder named by the hash of
all their sources.

Numba caches what it compiled until the file of that function changes, and does not see edits in
other files of what the function calls: so new sources mean a new folder. Of processes that start
together one compiles, and the others wait for it.
"""

import functools
import gc
import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba

from fitball.base.environment import cache_folder, once_for_all_processes

# Kernels run in threads. A division by zero gives an infinity or NaN, which ends as a status;
# products and sums may be contracted.
OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}
# Inlined parts have no wrappers for the interpreter and for C, which take a fifth of the time to
# compile.
INNER: dict[str, Any] = {
    "forceinline": True,
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    **OPTIONS,
}
P = ParamSpec("P")
R = TypeVar("R")


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a kernel that other kernels and Python call; it is not cached on disk by itself."""
    compiled: Callable[P, R] = numba.njit(**OPTIONS)(function)
    return compiled


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that is expanded in the kernels that call it. Without that a bounce takes
    1.8 times as long.
    """
    compiled: Callable[P, R] = numba.njit(**INNER)(function)
    return compiled


@functools.cache
def kernel_folder() -> Path:
    """The folder in which the kernels, compiled of these sources by this numba, are cached."""
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    digest.update(numba.__version__.encode())
    return cache_folder() / f"kernels-{digest.hexdigest()[:16]}"


def entry(function: Callable[P, R]) -> Callable[P, R]:
    """Make a kernel that Python calls, cached on disk. The first call compiles it, or waits for a
    process that does.
    """
    settings: Any = numba.config
    before = settings.CACHE_DIR
    settings.CACHE_DIR = os.fspath(kernel_folder())
    try:
        compiled: Callable[P, R] = numba.njit(cache=True, **OPTIONS)(function)
    finally:
        settings.CACHE_DIR = before
    ready = False

    @functools.wraps(function)
    def call(*arguments: P.args, **named: P.kwargs) -> R:
        nonlocal ready
        if ready:
            return compiled(*arguments, **named)
        mark = kernel_folder() / f"{function.__module__}.{function.__name__}"
        with once_for_all_processes(mark, "compiling the models, once"):
            collecting = gc.isenabled()
            # A compiler makes little but objects that stay.
            gc.disable()
            try:
                result: R = compiled(*arguments, **named)
            finally:
                if collecting:
                    gc.enable()
        ready = True
        return result

    return call
