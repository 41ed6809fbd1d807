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
    alignment = aligned(problem, records, {**columns, **{name: np.array([value]) for name, value in best.items()}})
    rest = (alignment.z - alignment.slope * alignment.move[..., None]) * alignment.spread
    # Each start that the record itself decides leaves that much less to scatter.
    freedom = 1.0 - np.mean(1.0 - 1.0 / (alignment.information * records.start[1] ** 2)) / records.nodes
    free = [parameter for parameter in problem.free if parameter.name in FORCE_NOISE]
    for _ in range(TURNS):
        for parameter in free:
            values = parameter.prior.value(np.linspace(*parameter.prior.support, GRID))
            tried = {name: np.full(GRID, value) for name, value in best.items()} | {parameter.name: values}
            spreads = spread(records, tried[SD], tried[MISFIT])
            cost = np.where(records.mask, 0.5 * (rest / spreads) ** 2 + freedom * np.log(spreads), 0.0).sum(
                axis=(1, 2)
            )
            density = parameter.prior.log_density(parameter.prior.coordinate(values))
            best[parameter.name] = float(values[np.argmax(density - cost)])
    return best


def noise_held(problem: Problem, values: Mapping[str, float]) -> Problem:
    """The same problem with the noise of its records fixed at `values`: so profiles of the likelihood are made, whose
    search knows the best size of independent noise only. The problem itself without records.
    """
    if problem.force is None:
        return problem
    held = tuple(
        replace(parameter, fixed=values[parameter.name], fixed_because="held at its most probable size")
        if parameter.name in FORCE_NOISE and parameter.free
        else parameter
        for parameter in problem.parameters
    )
    return replace(problem, parameters=held)
