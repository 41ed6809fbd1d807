"""Effective draws a CPU second: fitball's sampling beside other samplers, on tables of different kinds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
import pandas as pd

from fitball.inference.effort import Effort
from fitball.inference.point.point_fit import point_fit
from fitball.inference.problem.problem import Problem
from fitball.inference.sampling.ensembles import sample
from fitball.studies.bench.clock import Budget
from fitball.studies.bench.densities import OURS, SCRIPT
from fitball.studies.bench.samplers import RIVALS, STRETCH, Target
from fitball.studies.bench.tables import problems
from fitball.values import FloatArray
from fitball.version import __version__

# Effective draws below which nothing is said: the chains have not met.
LEAST = 20.0
NAIVE = "emcee, stretch move, on solve_ivp"


def missing() -> list[str]:
    """Packages of rivals that are not installed."""
    return [rival.package for rival in RIVALS if rival.version is None]


def sampling_costs(seconds: float, densities: pd.DataFrame, report: Callable[[str], None]) -> pd.DataFrame:
    """One row a table and sampler: CPU seconds (of rivals about `seconds`), densities, effective draws, densities a
    draw and draws a second.

    A script on `solve_ivp` asks for as many densities as the same sampler does on ours; `densities` say what each
    costs it.
    """
    scripts = densities[densities["log posterior"] == SCRIPT].set_index("table")["microseconds"]
    rows = []
    for name, problem in problems():
        report(f"effective draws of {name}")
        _, point = point_fit(problem, np.random.default_rng(1))
        chosen = [[optimum[free] for free in problem.free_names] for optimum in point.optima]
        optima = problem.to_coordinates(np.array(chosen))
        for sampler, version, spent, asked, draws in (_ours(problem, optima), *_theirs(problem, optima, seconds)):
            rows.append(_row(name, sampler, version, spent, asked, draws))
            if sampler == STRETCH:
                rows.append(_row(name, NAIVE, version, 1e-6 * asked * scripts[name], asked, draws))
    return pd.DataFrame(rows)


Found = tuple[str, str, float, int, float]


def _ours(problem: Problem, optima: FloatArray) -> Found:
    settings = Effort(cores=1).settings(problem)
    budget = Budget(math.inf)
    sampled = sample(problem, optima, settings, None, False, lambda _progress: None)
    asked = sampled.steps * settings.walkers * settings.ensembles
    return OURS, __version__, budget.spent, asked, sampled.convergence.min_ess


def _theirs(problem: Problem, optima: FloatArray, seconds: float) -> Iterator[Found]:
    for rival in RIVALS:
        if rival.version is not None:
            target, budget = Target(problem, optima), Budget(seconds)
            draws = rival.run(target, budget)
            yield rival.name, rival.version, budget.spent, target.evaluations, draws


def _row(table: str, sampler: str, version: str, seconds: float, asked: int, draws: float) -> dict[str, object]:
    known = draws if draws >= LEAST else math.nan
    return {
        "table": table, "sampler": sampler, "version": version, "CPU seconds": seconds, "densities": asked,
        "effective draws": draws, "densities a draw": asked / known, "draws a CPU second": known / seconds,
    }  # fmt: skip
