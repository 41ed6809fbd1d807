"""Who is told when kernels are compiled and not read from disk: numba itself says so, at the moment it begins.

Nothing is imported here, so that somebody can ask to be told before kernels are loaded.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Compiling:
    """The `kernel` that is being compiled with all it calls, and the `folder` that keeps it for later runs (None:
    there is none that can be written to).
    """

    kernel: str
    folder: str | None


# Is told when a kernel is compiled, and with None when that is done.
Tell = Callable[[Compiling | None], None]


def tell_nobody(_compiling: Compiling | None) -> None:
    """Say nothing."""


_told: list[Tell] = [tell_nobody]


def when_compiling(tell: Tell) -> None:
    """Let `tell` be called from now on, instead of whatever was called before."""
    _told[0] = tell


def tell(compiling: Compiling | None) -> None:
    """Tell that a kernel is being compiled, or that it is done."""
    _told[0](compiling)
