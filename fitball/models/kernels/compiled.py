"""The one decorator with which kernels are compiled, typed so that a checker sees through it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")


def _kernel_sources() -> tuple[tuple[str, float, int], ...]:
    """Name, modification time and size of every file kernels may live in."""
    files = sorted(Path(__file__).parents[1].rglob("*.py"))
    return tuple((file.name, file.stat().st_mtime, file.stat().st_size) for file in files)


SOURCES = _kernel_sources()


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a kernel that allocates nothing: cached on disk, free of the interpreter lock, strict IEEE arithmetic.

    `error_model="numpy"` lets a division by zero give an infinity instead of an exception, so that a
    batch is never stopped by one impact; every kernel marks such an impact by its status. References to arrays
    are not counted: their owner is the allocating kernel above, and the counting took a fifth of the time.
    """
    return cast("Callable[P, R]", _compile(function, {"_nrt": False}))


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, always expanded where it is called: for what is apart for order's sake, called once or twice."""
    return cast("Callable[P, R]", _compile(function, {"_nrt": False, "forceinline": True}))


def compiled_allocating(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, for kernels that make arrays."""
    return cast("Callable[P, R]", _compile(function, {}))


def _compile(function: Callable[..., Any], options: dict[str, bool]) -> Any:
    njit: Any = numba.njit
    common = {"cache": True, "nogil": True, "error_model": "numpy"}
    try:
        dispatcher = njit(**common, **options)(function)
    except KeyError:
        # The option is numba's own affair; a numba without it counts references, which costs time only.
        dispatcher = njit(**common)(function)
    _depend_on_all_kernels(dispatcher)
    return dispatcher


def _depend_on_all_kernels(dispatcher: Any) -> None:
    """Let the cache of one kernel expire when any of them changes.

    Numba stamps a cached function with its own file only, and so would go on running an old copy of a kernel it
    calls in another file. Where its cache is not built as expected it is left out: slow to start, never stale.
    """
    index: Any = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    if hasattr(index, "_source_stamp"):
        index._source_stamp = SOURCES
    else:
        dispatcher._cache = numba.core.caching.NullCache()
