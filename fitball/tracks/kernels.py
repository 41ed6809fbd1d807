"""Kernels of tracks: as those of models, and compiled anew when a source of this folder changes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

from fitball.models.kernels import compiled as kernels

P = ParamSpec("P")
R = TypeVar("R")

SOURCES = tuple(
    (file.name, file.stat().st_mtime, file.stat().st_size) for file in sorted(Path(__file__).parent.glob("*.py"))
)


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """As `fitball.models.kernels.compiled.compiled`, for kernels that call others of this folder."""
    kernel = kernels.compiled(function)
    files = getattr(getattr(kernel, "_cache", None), "_cache_file", None)
    if isinstance(files, kernels.KernelFiles):
        files.stamp = (*files.stamp, *SOURCES)
    return kernel
