"""Which problems have a density that is compiled whole, and its call; the others go the way of `posterior`, array by
array.
"""

from __future__ import annotations

import weakref
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from fitball.inference.likelihood.density_kernels import log_densities
from fitball.inference.problem.layout import MEASURES, Layout, laid_out
from fitball.inference.problem.noise import NormalNoise, StudentNoise
from fitball.inference.problem.parallel import LARGE_BATCH
from fitball.inference.problem.problem import Problem
from fitball.models.capabilities import KernelCall
from fitball.models.kernels.algebraic import algebraic_bounce
from fitball.models.kernels.bounce import bounce
from fitball.values import FloatArray

# Layouts by the identity of their problems, for as long as these live.
_layouts: dict[int, Layout | None] = {}


def call_of(problem: Problem) -> KernelCall:
    """How the model calls its kernel; the numbers of its parameters stand for any others."""
    return problem.model.kernel_call(problem.model_names, np.ones(len(problem.model_names)))


def why_not_compiled(problem: Problem) -> str:
    """Why the density of a problem is made array by array; empty where it is compiled whole."""
    if call_of(problem).entry not in (bounce, algebraic_bounce):
        return f"model {problem.model.name} has no kernel that the compiled density calls"
    if type(problem.noise) not in (NormalNoise, StudentNoise):
        return f"noise {problem.noise.name} is not among the compiled ones"
    if any(observable.name not in MEASURES for observable in problem.observables):
        return "a measured column is not among the compiled ones"
    if problem.incident is not None:
        return "uncertain incident states ask for derivatives, and near a change of regime for mixtures"
    return "" if problem.force is None else "each force record asks for the best start of its contact"


def layout_of(problem: Problem) -> Layout | None:
    """The layout of a problem, made once; None where its density is not compiled."""
    key = id(problem)
    if key not in _layouts:
        _layouts[key] = None if why_not_compiled(problem) else laid_out(problem, call_of(problem))
        weakref.finalize(problem, _layouts.pop, key)
    return _layouts[key]


def compiled_densities(
    problem: Problem, layout: Layout, points: FloatArray, *, from_coordinates: bool, measured: bool = True
) -> FloatArray:
    """Log densities (3, draws) as `log_densities` has them, for coordinates or values `points` (draws, free).

    Large batches are shared among the threads of the problem; a draw's numbers do not depend on the others.
    """
    # One kind of array: for each other kind the kernel would be compiled again.
    rows = np.ascontiguousarray(points, dtype=np.float64).view()
    rows.flags.writeable = False
    out = np.empty((3, len(rows)))
    if problem.threads == 1 or rows.shape[0] * len(problem.impacts) <= LARGE_BATCH:
        log_densities(rows, from_coordinates, measured, layout, out)
        return out
    parts = np.array_split(np.arange(len(rows)), min(len(rows), 4 * problem.threads))
    made = [np.empty((3, part.size)) for part in parts]
    with ThreadPoolExecutor(problem.threads) as pool:
        tasks = [
            pool.submit(log_densities, rows[part[0] : part[-1] + 1], from_coordinates, measured, layout, mine)
            for part, mine in zip(parts, made, strict=True)
        ]
        for task in tasks:
            task.result()
    return np.concatenate(made, axis=1)
