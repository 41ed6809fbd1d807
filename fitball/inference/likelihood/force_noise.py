"""The noise of force records in a likelihood: its best size, and holding it there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fitball.inference.likelihood.force import MISFIT, SD, aligned, spread
from fitball.inference.problem.force_records import ForceRecords
from fitball.inference.problem.parameters import FORCE_NOISE
from fitball.inference.problem.problem import Problem
from fitball.values import FloatArray

# The grid on which the best noise is looked for, and how often each takes its turn.
GRID, TURNS = 401, 4


def best_force_noise(
    problem: Problem, records: ForceRecords, columns: Mapping[str, FloatArray], current: Mapping[str, float]
) -> dict[str, float]:
    """Noise that maximises the posterior for the deviations at `columns` (1,), starting from `current`."""
    best = {name: current[name] for name in FORCE_NOISE}
    found = aligned(problem, records, {**columns, **{name: np.array([value]) for name, value in best.items()}})
    rest = (found.z - found.slope * found.move[..., None]) * found.spread
    # Each start that the record itself decides leaves that much less to scatter.
    freedom = 1.0 - np.mean(1.0 - 1.0 / (found.information * records.start[1] ** 2)) / records.nodes
    free = [item for item in problem.free if item.name in FORCE_NOISE]
    for _ in range(TURNS):
        for item in free:
            values = item.prior.value(np.linspace(*item.prior.support, GRID))
            tried = {name: np.full(GRID, value) for name, value in best.items()} | {item.name: values}
            spreads = spread(records, tried[SD], tried[MISFIT])
            cost = np.where(records.mask, 0.5 * (rest / spreads) ** 2 + freedom * np.log(spreads), 0.0).sum(
                axis=(1, 2)
            )
            density = item.prior.log_density(item.prior.coordinate(values))
            best[item.name] = float(values[np.argmax(density - cost)])
    return best


def noise_held(problem: Problem, values: Mapping[str, float]) -> Problem:
    """The same problem with the noise of its records fixed at `values`: so profiles of the likelihood are made, whose
    search knows the best size of independent noise only. The problem itself without records.
    """
    if problem.force is None:
        return problem
    held = tuple(
        replace(item, fixed=values[item.name], fixed_because="held at its most probable size")
        if item.name in FORCE_NOISE and item.free
        else item
        for item in problem.parameters
    )
    return replace(problem, parameters=held)
