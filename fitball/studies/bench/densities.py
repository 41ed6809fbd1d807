"""Speed against error of the log posterior, beside one written plainly: scipy's densities of integrated rebounds."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import pandas as pd
from scipy.stats import norm
from scipy.stats import t as student

from fitball.inference.likelihood.posterior import log_posterior
from fitball.inference.problem.problem import Problem
from fitball.models.types import Rebound
from fitball.studies.bench.clock import Pace, by_turns
from fitball.studies.bench.integrators import END, Method, adaptive, fixed_steps, set_up
from fitball.studies.bench.precision import CAREFUL
from fitball.studies.bench.scenes import oracle
from fitball.studies.bench.tables import spread_coordinates
from fitball.values import FloatArray

# Rebound columns in SI, (impacts,): v_x2, v_y2, omega_2, contact time.
Solved = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
Solve = Callable[[Problem, dict[str, float]], Solved]
# Draws in one batch, and of how many the error is known.
WALKERS, JUDGED = 40, 8
OURS, SCRIPT = "fitball", "plain Python, solve_ivp DOP853, short steps"


def plain_log_posterior(problem: Problem, coordinates: FloatArray, solve: Solve) -> float:
    """Log posterior of coordinates (free,) by textbook formulas, for tables of rebound components
    whose noise is fitted.
    """
    density = float(problem.prior.log_density(coordinates[None])[0])
    columns = problem.all_values(problem.to_values(coordinates[None]))
    values = {name: float(column[0]) for name, column in columns.items()}
    solved = dict(zip(("v_x2", "v_y2", "omega_2", "contact_time"), solve(problem, values), strict=True))
    kind = student(values["degrees_of_freedom"]) if "degrees_of_freedom" in values else norm()
    for column in problem.observables:
        rows = slice(None) if column.rows is None else column.rows
        assert column.noise is not None
        sd = values[column.noise]
        density += float(np.sum(kind.logpdf((column.observed - solved[column.name][rows]) / sd) - math.log(sd)))
    if problem.contact_time is not None:
        density += float(norm(*problem.contact_time).logpdf(solved["contact_time"].mean()))
    return density


def by_oracle(problem: Problem, values: dict[str, float]) -> Solved:
    """Rebounds by the model's independent solution."""
    parameters = {name: values[name] for name in problem.model_names}
    exact: Rebound = oracle().rebound(parameters, problem.impacts)
    return exact.v_x2, exact.v_y2, exact.omega_2, exact.contact_time


def by_order_8(problem: Problem, values: dict[str, float]) -> Solved:
    """Rebounds by the strongest of the compiled integrators."""
    return _integrated(problem, values, partial(fixed_steps, order=8, steps=20, located=True))


def by_solve_ivp(problem: Problem, values: dict[str, float], most: float = math.inf) -> Solved:
    """Rebounds as a script would have them; see `adaptive`."""
    method: Method = "RK45" if math.isinf(most) else "DOP853"

    def integrate(setups: FloatArray) -> FloatArray:
        return np.array([adaptive(setup, method, 1e-6, most) for setup in setups])

    return _integrated(problem, values, integrate)


def _integrated(problem: Problem, values: dict[str, float], integrate: Callable[[FloatArray], FloatArray]) -> Solved:
    given = problem.impacts
    states = zip(given.v_x1.tolist(), given.v_y1.tolist(), given.omega_1.tolist(), strict=True)
    setups = np.array([set_up(problem.model.ball, values, *state) for state in states])
    v_x2, omega_2 = integrate(setups).T
    cor = values["cor_10"] + values["cor_slope"] * (given.v_y1 - 10.0)
    return v_x2, cor * given.v_y1, omega_2, setups[:, END]


def density_costs(name: str, problem: Problem, pace: Pace) -> pd.DataFrame:
    """CPU microseconds a log posterior at spread draws, and the largest error: of ours, one by one and as many at
    once as walkers move, and of the plain formula with rebounds of integrators.
    """
    at = spread_coordinates(problem, WALKERS)
    exact = np.array([plain_log_posterior(problem, one, by_oracle) for one in at[:JUDGED]])

    def plain(solve: Solve, count: int) -> FloatArray:
        return np.array([plain_log_posterior(problem, one, solve) for one in at[:count]])

    ways: dict[str, tuple[int, Callable[[], FloatArray]]] = {
        f"{OURS}, {WALKERS} at once": (WALKERS, lambda: log_posterior(problem, at)),
        f"{OURS}, one at a time": (1, lambda: log_posterior(problem, at[:1])),
        "plain Python, order 8 compiled": (JUDGED, lambda: plain(by_order_8, JUDGED)),
        "plain Python, solve_ivp RK45": (2, lambda: plain(by_solve_ivp, 2)),
        SCRIPT: (2, lambda: plain(partial(by_solve_ivp, most=CAREFUL), 2)),
    }
    spent = by_turns({way: action for way, (_, action) in ways.items()}, pace)
    return pd.DataFrame([
        {"table": name, "log posterior": way, "microseconds": 1e6 * spent[way] / count,
         "largest error": float(np.abs(action()[:JUDGED] - exact[:count]).max())}
        for way, (count, action) in ways.items()
    ])  # fmt: skip
