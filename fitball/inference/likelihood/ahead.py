"""Kernels that a fit calls, compiled by two processes at once where the disk has none: a first run waits less.

Each process compiles kernels that share next to nothing: one the bounce of one impact and what its derivatives take,
the other the bounce of eight impacts and the density.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numba
import numpy as np

from fitball.inference.likelihood.density_kernels import log_densities
from fitball.inference.problem.layout import Layout
from fitball.models.kernels.bounce import BOUNCE
from fitball.models.kernels.compiled import kept, on_disk, read_only
from fitball.models.kernels.derivative import JACOBIAN
from fitball.scheduling.engine import engine

# A kernel by module and name, and the kinds of arguments that it is compiled for.
Wanted = tuple[str, str, tuple[Any, ...]]


def compile_ahead(layout: Layout, cores: int) -> None:
    """Compile what densities with this `layout` and their derivatives call, unless it is on disk or would not be kept
    there. What an algebraic bounce takes is not worth a second process.
    """
    arguments = (read_only((1, 1)), True, True, layout, np.empty((3, 1)))
    density = log_densities, tuple(map(numba.typeof, arguments))
    if layout.row.algebraic or cores == 1 or not kept(log_densities) or on_disk(*density):
        return
    others = [(entry.kernel, entry.signature.args) for entry in (BOUNCE, JACOBIAN)]
    parts = [[_wanted(*one) for one in part] for part in (others, [density])]
    for _ in engine(2).unordered(_compile, parts):
        pass


def _wanted(kernel: Any, kinds: tuple[Any, ...]) -> Wanted:
    return kernel.__module__, kernel.__name__, kinds


def _compile(part: list[Wanted]) -> None:
    for module, name, kinds in part:
        getattr(import_module(module), name).compile(kinds)
