"""Speed against error: of one bounce, the kernels beside programs without a closed form; and of the log
posterior, beside one written plainly, scipy's densities of integrated rebounds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd
from scipy.stats import norm
from scipy.stats import t as student

from fitball.bench.clock import Pace, by_turns
from fitball.bench.integrators import END, Method, adaptive, fixed_steps, set_up
from fitball.bench.problems import HARD, Scene, default_model, oracle, spread_coordinates
from fitball.inference.likelihood.posterior import log_posterior
from fitball.inference.problem.problem import Problem
from fitball.models.types import Rebound
from fitball.values import FloatArray, impacts

# Draws of a large batch.
DRAWS = 200
STEPS = (5, 10, 20, 50, 100, 200, 400, 1600)
STEPS_OF_ORDER_8 = (5, 10, 20, 40, 80)
TOLERANCES = (1e-3, 1e-6, 1e-9, 1e-12)
# As `solve_ivp` is called, and with steps of at most a twentieth of the contact, which step over no grip.
CAREFUL = 0.05
ADAPTIVE: tuple[tuple[str, Method, float], ...] = (
    ("solve_ivp RK45", "RK45", math.inf),
    ("solve_ivp LSODA", "LSODA", math.inf),
    ("solve_ivp DOP853", "DOP853", math.inf),
    ("solve_ivp DOP853, short steps", "DOP853", CAREFUL),
)
FASTEST = "closed form, many draws"
CARELESS_RK4 = "RK4 compiled, events between steps"
LOCATED_RK4, LOCATED_8 = "RK4 compiled, events located", "order 8 compiled, events located"
# Rebound columns in SI, (impacts,): v_x2, v_y2, omega_2, contact time.
Solved = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
Solve = Callable[[Problem, dict[str, float]], Solved]
# Draws in one batch, and of how many the error is known.
WALKERS, JUDGED = 40, 8
OURS, SCRIPT = "fitball", "plain Python, solve_ivp DOP853, short steps"


@dataclass(frozen=True)
class Solver:
    """A solver at one setting; `solve` returns `v_x2` and `omega_2`, (impacts, 2), of each impact `times` over."""

    name: str
    setting: str
    solve: Callable[[], FloatArray]
    times: int = 1


def errors(scene: Scene, solved: FloatArray) -> FloatArray:
    """Largest error of velocity and of surface speed `R omega_2` over the incident surface speed, (impacts,)."""
    wrong = np.abs(solved - np.stack([scene.v_x2, scene.omega_2], axis=1)) * (1.0, default_model().ball.radius)
    return np.asarray(wrong.max(axis=1) / scene.speed)


def work_precision(scenes: tuple[Scene, ...], pace: Pace) -> pd.DataFrame:
    """One row per solver, setting and scene: CPU microseconds per impact, largest and median error."""
    rows = []
    for scene in scenes:
        found = [*closed_forms(scene), *(rivals(scene) if scene.name != HARD else ())]
        spent = by_turns({solver.name + solver.setting: solver.solve for solver in found}, pace)
        for solver in found:
            error = errors(scene, solver.solve())
            taken = spent[solver.name + solver.setting] / (len(scene.impacts) * solver.times)
            rows.append({
                "scene": scene.name, "solver": solver.name, "setting": solver.setting, "microseconds": 1e6 * taken,
                "largest error": float(error.max()), "median error": float(np.median(error)),
            })  # fmt: skip
    return pd.DataFrame(rows)


def closed_forms(scene: Scene) -> Iterator[Solver]:
    """The public path: one impact a call, and the impacts of a scene that has one set of parameters at once, alone
    and for many draws.
    """
    chosen, given = default_model(), scene.impacts
    singles = [impacts(given.v_x1[k], given.v_y1[k], given.omega_1[k]) for k in range(len(given))]

    def one_by_one() -> FloatArray:
        made = [chosen.evaluate(scene.names, scene.values[k : k + 1], one) for k, one in enumerate(singles)]
        return np.array([(item.v_x2[0, 0], item.omega_2[0, 0]) for item in made])

    def at_once(values: FloatArray) -> FloatArray:
        made = chosen.evaluate(scene.names, values, given)
        return np.stack([made.v_x2[-1], made.omega_2[-1]], axis=1)

    yield Solver("closed form, one by one", "", one_by_one)
    if scene.name != HARD:
        yield Solver("closed form, one draw", "", partial(at_once, scene.values[:1]))
        yield Solver(FASTEST, "", partial(at_once, np.repeat(scene.values[:1], DRAWS, axis=0)), DRAWS)


def rivals(scene: Scene) -> Iterator[Solver]:
    """Integrators, careless and careful. None on joints up to 1e8 N m/rad: there explicit steps of any practical size
    diverge, and adaptive ones take minutes.
    """
    ball, given = default_model().ball, scene.impacts
    named = [dict(zip(scene.names, row.tolist(), strict=True)) for row in scene.values]
    states = zip(given.v_x1.tolist(), given.v_y1.tolist(), given.omega_1.tolist(), strict=True)
    setups = np.array([set_up(ball, values, *state) for values, state in zip(named, states, strict=True)])

    def ode(method: Method, rtol: float, most: float) -> FloatArray:
        return np.array([adaptive(setup, method, rtol, most) for setup in setups])

    for name, order, located, counts in (
        (CARELESS_RK4, 4, False, STEPS), (LOCATED_RK4, 4, True, STEPS), (LOCATED_8, 8, True, STEPS_OF_ORDER_8),
    ):  # fmt: skip
        for steps in counts:
            yield Solver(name, f"{steps} steps", partial(fixed_steps, setups, order, steps, located=located))
    for name, method, most in ADAPTIVE:
        for rtol in TOLERANCES:
            yield Solver(name, f"rtol {rtol:g}", partial(ode, method, rtol, most))


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
