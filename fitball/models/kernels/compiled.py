"""How kernels are compiled: `njit(cache=True)` without the GIL, in a folder named by the hash of
all their sources.

Numba keeps what it compiled until the file of that function changes, and does not see edits of what
it calls in other
files: so new sources mean a new folder. Of processes that start together one compiles, and the
others wait for it.
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

# A division by zero gives an infinity or NaN, which ends as a status; products and sums may be
# contracted.
OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}
# Without ways in for the interpreter and for C, which take a fifth of the time to compile.
INNER: dict[str, Any] = {
    "forceinline": True,
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    **OPTIONS,
}
P = ParamSpec("P")
R = TypeVar("R")


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """A kernel that others call, in Python too: not kept on disk by itself."""
    made: Callable[P, R] = numba.njit(**OPTIONS)(function)
    return made


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """A part of kernels, expanded where it is called (without that a bounce takes 1.8 times as
    long).
    """
    made: Callable[P, R] = numba.njit(**INNER)(function)
    return made


@functools.cache
def folder() -> Path:
    """Where these sources, compiled by this numba, are kept."""
    sources = sorted(Path(__file__).parent.glob("*.py"))
    named = b"".join(source.read_bytes() for source in sources) + numba.__version__.encode()
    return cache_folder() / f"kernels-{hashlib.sha256(named).hexdigest()[:16]}"


def entry(function: Callable[P, R]) -> Callable[P, R]:
    """A kernel that Python calls, kept on disk; the first call compiles it, or waits for a process
    that does.
    """
    settings: Any = numba.config
    before, settings.CACHE_DIR = settings.CACHE_DIR, os.fspath(folder())
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
        with once_for_all_processes(
            folder() / f"{function.__module__}.{function.__name__}",
            "compiling the models, once",
        ):
            collecting = gc.isenabled()
            # A compiler makes little but objects that stay.
            gc.disable()
            try:
                found: R = compiled(*arguments, **named)
            finally:
                if collecting:
                    gc.enable()
        ready = True
        return found

    return call
