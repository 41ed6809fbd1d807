"""The one decorator with which kernels are compiled, typed so that a checker sees through it."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a scalar kernel: cached on disk, free of the interpreter lock, strict IEEE arithmetic.

    `error_model="numpy"` lets a division by zero give an infinity instead of an exception, so that a
    batch is never stopped by one impact; every kernel marks such an impact by its status.
    """
    return cast("Callable[P, R]", numba.njit(cache=True, nogil=True, error_model="numpy")(function))
