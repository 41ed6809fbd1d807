"""Populations that are known: how often do intervals of centre and spread, and of each table, hold the truth?"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np

from fitball.api.calibrating import pose
from fitball.inference.population.draws import TableDraws
from fitball.inference.population.quantity import prior_of, quantity
from fitball.inference.population.reweighting import Population, population
from fitball.inference.problem.problem import Choices
from fitball.scheduling.engine import Engine, in_order
from fitball.values import FloatArray
from fitball.version import __version__
from validation.population.tables import (
    DRAWS,
    INTERIM,
    MAX_STEPS,
    MODEL,
    OTHERS,
    POPULATIONS,
    QUANTITIES,
    SCHEDULE,
    Truth,
    before,
    draw_table,
    draw_truth,
    kept_columns,
    posterior_draws,
)
from validation.shared.growing_csv import GrowingCsv

TABLES, ROWS = 20, 6
# What is counted of a population of a quantity: truth and interval of centre and of spread, tables whose interval
# alone and given all holds the truth, mean squared errors of both, tables that are not to be trusted.
FIELDS = (
    "centre_truth", "centre", "centre_low", "centre_high", "spread_truth", "spread", "spread_low", "spread_high",
    "alone_holds", "given_all_holds", "alone_error", "given_all_error", "not_trusted",
)  # fmt: skip
# With the interim priors left in: a control that must fail.
CONTROL = "left_in"


@dataclass(frozen=True)
class Fitted:
    """Tables of a population: the truth, true values (tables,) and draws (tables, draws) of each quantity."""

    truth: Truth
    values: Mapping[str, FloatArray]
    draws: Mapping[str, FloatArray]


def fitted_tables(seed: int, number: int) -> Fitted:
    """Population `number`: its tables simulated and fitted one by one."""
    root = np.random.SeedSequence(seed, spawn_key=(number,))
    rng = np.random.default_rng(root.spawn(1)[0])
    truth = draw_truth(rng)
    values, draws = [], []
    for own in root.spawn(TABLES):
        table, true = draw_table(truth, ROWS, rng)
        values.append(true)
        problem = pose(table, Choices(model=MODEL, priors={**INTERIM, **OTHERS}, velocity_noise="tied"), as_read=True)
        draws.append(kept_columns(posterior_draws(problem, own)))
    return Fitted(
        truth,
        {name: np.array([true[name] for true in values]) for name in QUANTITIES},
        {name: np.array([kept[name] for kept in draws]) for name in QUANTITIES},
    )


def found_of(name: str, draws: FloatArray, divided: bool = True) -> Population:
    """The population of a quantity from draws (tables, draws); the priors left in where not `divided`."""
    return population(table_draws(name, draws, divided), before(name))


def table_draws(name: str, draws: FloatArray, divided: bool = True) -> list[TableDraws]:
    """The tables as a population takes them, from draws (tables, draws); the priors left in where not `divided`."""
    asked = quantity(name)
    log_prior = asked.log_prior({name: prior_of(asked.parts[0], INTERIM[name])}) if divided else np.zeros_like
    return [TableDraws.of(str(k), asked.coordinates({name: own}), log_prior) for k, own in enumerate(draws)]


def replicate(seed: int, number: int) -> tuple[str, ...]:
    """The cells of one population."""
    fitted = fitted_tables(seed, number)
    cells: list[float] = []
    for divided in (True, False):
        for name in QUANTITIES:
            cells += _counted(name, fitted, found_of(name, fitted.draws[name], divided))
    return tuple(f"{cell:.6g}" for cell in cells)


def _counted(name: str, fitted: Fitted, found: Population) -> list[float]:
    asked = quantity(name)
    true = asked.coordinates(fitted.values)
    alone = asked.coordinates(fitted.draws)
    low, middle, high = np.quantile(alone, (0.025, 0.5, 0.975), axis=1)
    given = np.array([[table.known.low, table.known.median, table.known.high] for table in found.tables]).T
    numbers = [fitted.truth.centre[name], found.centre.median, found.centre.low, found.centre.high]
    numbers += [fitted.truth.spread[name], found.spread.median, found.spread.low, found.spread.high]
    numbers += [float(np.sum((low <= true) & (true <= high))), float(np.sum((given[0] <= true) & (true <= given[2])))]
    numbers += [float(np.mean((middle - true) ** 2)), float(np.mean((given[1] - true) ** 2))]
    return [*numbers, float(len(found.doubtful))]


def columns() -> tuple[str, ...]:
    """Names of the cells of a population."""
    ways = ("", f"{CONTROL}:")
    return tuple(f"{way}{name}:{field}" for way in ways for name in QUANTITIES for field in FIELDS)


def run_populations(
    seed: int, replicates: int, path: Path, engine: Engine, report: Callable[[int], None] = lambda _done: None
) -> list[Mapping[str, float]]:
    """Populations 0 to `replicates` - 1, those that the file at `path` holds read and the others made by `engine` and
    appended; `report` is told how many are done. Raises ResultFolderError. After Ctrl-C the same call goes on.
    """
    return grown(seed, replicates, path, engine, report, partial(replicate, seed), columns(), {"tables": TABLES})


def grown(
    seed: int,
    replicates: int,
    path: Path,
    engine: Engine,
    report: Callable[[int], None],
    make: Callable[[int], tuple[str, ...]],
    heads: tuple[str, ...],
    own: Mapping[str, object],
) -> list[Mapping[str, float]]:
    """Replicates that `make` makes of their number, in a file with these heads that grows; `own` are settings beside
    those of every study of populations.
    """
    settings = {
        "version": __version__, "seed": seed, "model": MODEL,
        "priors": {**INTERIM, **OTHERS}, "populations": dict(POPULATIONS),
        "rows": ROWS, "draws": DRAWS, "max_steps": MAX_STEPS, **own, **asdict(SCHEDULE),
    }  # fmt: skip
    file = GrowingCsv(path, heads, settings, "populations")
    done = file.open()
    report(min(done, replicates))
    numbers = range(done, replicates)
    for number, cells in zip(numbers, in_order(engine, make, numbers), strict=True):
        file.append(number, cells)
        report(number + 1)
    return [_numbers(file, number, row) for number, row in file.rows(replicates)]


def _numbers(file: GrowingCsv, number: int, row: Mapping[str, str]) -> Mapping[str, float]:
    try:
        return {name: float(cell) for name, cell in row.items()}
    except ValueError:
        raise file.damaged(number) from None
