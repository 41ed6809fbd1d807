"""Populations over levels that are known: how often do intervals of levels and of both spreads hold the truth?"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from fitball.api.calibrating import pose
from fitball.inference.population.hyper import Known
from fitball.inference.population.levels import population_over
from fitball.inference.problem.problem import Choices
from fitball.scheduling.engine import Engine
from fitball.values import FloatArray
from validation.population.coverage import CONTROL, ROWS, grown, table_draws
from validation.population.tables import (
    INTERIM,
    MODEL,
    OTHERS,
    QUANTITIES,
    Truth,
    before,
    draw_table,
    draw_truth,
    kept_columns,
    posterior_draws,
)

LEVELS, EACH = 3, 4
# Of a population whether the interval holds the truth, of its levels how many do; the width of each interval, mean of
# the levels'.
COUNTED = ("centre", "between", "within", "levels")
FIELDS = tuple(f"{what}_{cell}" for what in COUNTED for cell in ("holds", "width"))


def fitted_levels(seed: int, number: int) -> tuple[Mapping[str, Mapping[str, FloatArray]], Mapping[str, FloatArray]]:
    """Population `number`: of each quantity the truths (one or levels,) of what is counted, and draws (tables, draws)
    of the tables, fitted one by one, level by level.
    """
    root = np.random.SeedSequence(seed, spawn_key=(number, LEVELS))
    rng = np.random.default_rng(root.spawn(1)[0])
    truth, within = draw_truth(rng), draw_truth(rng).spread
    values = {name: truth.centre[name] + truth.spread[name] * rng.standard_normal(LEVELS) for name in QUANTITIES}
    draws = []
    for k, own in enumerate(root.spawn(LEVELS * EACH)):
        here = Truth({name: float(values[name][k // EACH]) for name in QUANTITIES}, within)
        table, _true = draw_table(here, ROWS, rng)
        problem = pose(table, Choices(model=MODEL, priors={**INTERIM, **OTHERS}, velocity_noise="tied"), as_read=True)
        draws.append(kept_columns(posterior_draws(problem, own)))
    truths = {
        name: {
            "centre": np.array([truth.centre[name]]), "between": np.array([truth.spread[name]]),
            "within": np.array([within[name]]), "levels": values[name],
        }
        for name in QUANTITIES
    }  # fmt: skip
    return truths, {name: np.array([kept[name] for kept in draws]) for name in QUANTITIES}


def replicate(seed: int, number: int) -> tuple[str, ...]:
    """The cells of one population."""
    truths, draws = fitted_levels(seed, number)
    cells: list[float] = []
    for divided in (True, False):
        for name in QUANTITIES:
            tables = table_draws(name, draws[name], divided)
            levels = {str(j): tables[j * EACH : (j + 1) * EACH] for j in range(LEVELS)}
            found = population_over(levels, before(name))
            assert found.within is not None
            known = {"centre": [found.centre], "between": [found.spread], "within": [found.within]}
            known["levels"] = [level.known for level in found.levels]
            for what in COUNTED:
                cells += _counted(known[what], truths[name][what])
    return tuple(f"{cell:.6g}" for cell in cells)


def _counted(known: list[Known], truth: FloatArray) -> list[float]:
    low, high = np.array([[one.low, one.high] for one in known]).T
    return [float(np.sum((low <= truth) & (truth <= high))), float(np.mean(high - low))]


def columns() -> tuple[str, ...]:
    """Names of the cells of a population."""
    return tuple(f"{way}{name}:{field}" for way in ("", f"{CONTROL}:") for name in QUANTITIES for field in FIELDS)


def run_levels(
    seed: int, replicates: int, path: Path, engine: Engine, report: Callable[[int], None] = lambda _done: None
) -> list[Mapping[str, float]]:
    """Populations 0 to `replicates` - 1 on levels, as `run_populations`."""
    settings = {"levels": LEVELS, "each": EACH}
    return grown(seed, replicates, path, engine, report, partial(replicate, seed), columns(), settings)
