"""Speed against error, and where time goes: what `fitball bench` measures, here and now."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from itertools import repeat
from multiprocessing import get_context

import numpy as np
import pandas as pd

from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.data.table import ImpactTable, Measurement
from fitball.inference.calibrate import run
from fitball.inference.comparison.workers import die_on_interrupt
from fitball.inference.effort import Effort
from fitball.inference.likelihood.posterior import log_posterior
from fitball.inference.problem.build import Choices, build_problem
from fitball.studies.bench.hard_cases import BASE
from fitball.studies.bench.rivals import Method, adaptive, set_up, stepped
from fitball.studies.bench.scenes import HARD, Scene, default_model, oracle, scenes
from fitball.values import FloatArray, Impacts, impacts

Solved = tuple[FloatArray, FloatArray]


@dataclass(frozen=True)
class Pace:
    """How long each measurement may take [s], and how large the largest batch is."""

    seconds: float
    steps: tuple[int, ...]
    tolerances: tuple[float, ...]
    many: int
    repeats: int


FULL = Pace(0.5, (50, 100, 200, 400, 800, 1600, 3200, 6400), (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-13), 100_000, 5)
QUICK = Pace(0.05, (100, 400, 1600), (1e-3, 1e-6, 1e-9), 20_000, 3)
METHODS: tuple[Method, ...] = ("RK45", "DOP853", "LSODA", "Radau")
# Noise at which densities are timed: as large as in Wang's tables.
NOISE = {"velocity_sd": 0.4, "v_x_sd": 0.4, "v_y_sd": 0.4, "spin_sd": 14.0}
# Radau has no tolerance below this that scipy's own limits allow it to reach in reasonable time.
TIGHTEST = {"RK45": 1e-9, "LSODA": 1e-11, "Radau": 1e-7}


@dataclass(frozen=True)
class Bench:
    """`precision`: time and error by solver and scene; `batches`, `growth`, `start_up`, `stages`: see their
    functions; `machine` in words.
    """

    precision: pd.DataFrame
    batches: pd.DataFrame
    growth: pd.DataFrame
    start_up: pd.DataFrame
    stages: pd.DataFrame
    machine: str


def measure(pace: Pace, cores: int, report: Callable[[str], None]) -> Bench:
    """Measure everything; minutes at full pace."""
    report("exact answers")
    # Started afresh, not forked: threads and locks of this process do not come along.
    with ProcessPoolExecutor(cores, get_context("spawn"), die_on_interrupt) as pool:
        solved_scenes = scenes(pool)
    report("speed against error")
    precision = pd.DataFrame(list(work_precision(solved_scenes, pace)))
    report("batches and threads")
    batches = batch_costs(pace, cores)
    report("growth with rows and draws")
    growth = growth_costs(pace)
    report("start-up")
    start_up = start_up_costs(pace)
    report("stages of a calibration")
    stages = stage_costs(cores)
    machine = f"{os.cpu_count()} logical cores, Python {sys.version.split()[0]}, numpy {np.__version__}"
    return Bench(precision, batches, growth, start_up, stages, machine)


def timed(action: Callable[[], object], seconds: float, repeats: int) -> float:
    """Median over `repeats` of the time one call takes [s], each repeat filling its share of `seconds`."""
    action()
    begun = time.perf_counter()
    action()
    once = max(time.perf_counter() - begun, 1e-7)
    calls = max(1, int(seconds / repeats / once))
    taken = []
    for _ in range(repeats):
        begun = time.perf_counter()
        for _ in repeat(None, calls):
            action()
        taken.append((time.perf_counter() - begun) / calls)
    return statistics.median(taken)


def errors(scene: Scene, solved: Solved) -> FloatArray:
    """Largest error of velocity and of surface speed `R omega_2` over the incident surface speed, (impacts,)."""
    radius = default_model().ball.radius
    velocity, spin = np.abs(solved[0] - scene.v_x2), radius * np.abs(solved[1] - scene.omega_2)
    return np.asarray(np.maximum(velocity, spin) / scene.speed)


def work_precision(solved_scenes: tuple[Scene, ...], pace: Pace) -> Iterator[dict[str, object]]:
    """One row per solver, setting and scene: microseconds per impact, largest and median error."""
    for scene in solved_scenes:
        for solver, setting, action in _solvers(scene, pace):
            error = errors(scene, action())
            seconds = timed(action, pace.seconds, pace.repeats) / len(scene.impacts)
            yield {
                "scene": scene.name, "solver": solver, "setting": setting, "microseconds": 1e6 * seconds,
                "largest error": float(error.max()), "median error": float(np.median(error)),
            }  # fmt: skip


def _solvers(scene: Scene, pace: Pace) -> Iterator[tuple[str, str, Callable[[], Solved]]]:
    chosen, count = default_model(), len(scene.impacts)
    singles = [impacts(scene.impacts.v_x1[k], scene.impacts.v_y1[k], scene.impacts.omega_1[k]) for k in range(count)]

    def closed() -> Solved:
        made = chosen.evaluate(scene.names, scene.values[:1], scene.impacts)
        v_x2: FloatArray = made.v_x2[0]
        omega_2: FloatArray = made.omega_2[0]
        return v_x2, omega_2

    def one_by_one() -> Solved:
        made = [chosen.evaluate(scene.names, scene.values[k : k + 1], singles[k]) for k in range(count)]
        return np.array([item.v_x2[0, 0] for item in made]), np.array([item.omega_2[0, 0] for item in made])

    def exponentials() -> Solved:
        exact = oracle()
        made = [exact.rebound(_named(scene, k), singles[k]) for k in range(count)]
        return np.array([item.v_x2[0] for item in made]), np.array([item.omega_2[0] for item in made])

    yield "closed form, one by one", "", one_by_one
    if scene.name == HARD:
        # Joints up to 1e8 N m/rad: explicit steps of any practical size diverge, adaptive ones take minutes, and the
        # answers come from matrix exponentials.
        return
    yield "closed form, batch", "", closed
    yield "matrix exponentials", "", exponentials
    setups = np.array(
        [set_up(chosen.ball, _named(scene, k), *(float(x[k]) for x in _columns(scene.impacts))) for k in range(count)]
    )
    work, out = np.empty((5, 6)), np.empty((count, 2))

    def runge_kutta(steps: int) -> Callable[[], Solved]:
        def action() -> Solved:
            stepped(setups, steps, work, out)
            v_x2: FloatArray = out[:, 0].copy()
            omega_2: FloatArray = out[:, 1].copy()
            return v_x2, omega_2

        return action

    def ode(method: Method, rtol: float) -> Callable[[], Solved]:
        def action() -> Solved:
            made = [adaptive(setup, method, rtol) for setup in setups]
            return np.array([item[0] for item in made]), np.array([item[1] for item in made])

        return action

    for steps in pace.steps:
        yield "RK4, compiled", f"{steps} steps", runge_kutta(steps)
    for method in METHODS:
        for rtol in pace.tolerances:
            if rtol >= TIGHTEST.get(method, 0.0):
                yield f"solve_ivp {method}", f"rtol {rtol:g}", ode(method, rtol)


def _named(scene: Scene, k: int) -> dict[str, float]:
    return dict(zip(scene.names, scene.values[k].tolist(), strict=True))


def _columns(given: Impacts) -> tuple[FloatArray, FloatArray, FloatArray]:
    return given.v_x1, given.v_y1, given.omega_1


def spread_draws(count: int, seed: int = 1) -> FloatArray:
    """Parameter draws (count, parameters) of the default model, as wide as a posterior of Wang's 21 impacts."""
    names = default_model().parameter_names
    widths = {"mass_ratio": 0.015, "k_y": 3e3, "k_theta": 3.0, "mu": 0.02, "eps_10": 3e-4, "eps_slope": 6e-5,
              "cor_10": 0.01, "cor_slope": 0.002}  # fmt: skip
    noise = np.random.default_rng(seed).standard_normal((count, len(names)))
    draws: FloatArray = np.array([BASE[name] for name in names]) + noise * np.array([widths[name] for name in names])
    return draws


def batch_costs(pace: Pace, cores: int) -> pd.DataFrame:
    """Microseconds per impact: a public call, one draw of 21 impacts, many, and many on all threads."""
    chosen = default_model()
    names = chosen.parameter_names
    wang = load_table("wang_all.csv").impacts
    values = dict(zip(names, spread_draws(1)[0].tolist(), strict=True))
    one = impacts(wang.v_x1[0], wang.v_y1[0], wang.omega_1[0])
    draws = spread_draws(pace.many // len(wang))
    parts = np.array_split(draws, cores)
    rows = []
    with ThreadPoolExecutor(cores) as pool:
        for label, count, action in (
            ("public call, 1 impact", 1, lambda: chosen.rebound(values, one)),
            ("public call, 21 impacts", len(wang), lambda: chosen.rebound(values, wang)),
            ("batch, 1 draw of 21", len(wang), lambda: chosen.evaluate(names, draws[:1], wang)),
            (f"batch of {draws.shape[0] * len(wang)}, 1 thread", draws.shape[0] * len(wang),
             lambda: chosen.evaluate(names, draws, wang)),
            (f"batch of {draws.shape[0] * len(wang)}, {cores} threads", draws.shape[0] * len(wang),
             lambda: list(pool.map(lambda part: chosen.evaluate(names, part, wang), parts))),
        ):  # fmt: skip
            seconds = timed(action, pace.seconds, pace.repeats)
            rows.append({"call": label, "microseconds an impact": 1e6 * seconds / count})
    return pd.DataFrame(rows)


def enlarged(table: ImpactTable, rows: int) -> ImpactTable:
    """A table of `rows` impacts that repeats another with small changes to the incident speeds."""
    rng = np.random.default_rng(rows)
    take = np.arange(rows) % len(table)
    stretch = 1.0 + 0.02 * rng.standard_normal(rows)
    given = table.impacts
    return replace(
        table,
        impacts=Impacts(given.v_x1[take] * stretch, given.v_y1[take] * stretch, given.omega_1[take]),
        measurements=tuple(
            Measurement(measurement.name, measurement.values[take]) for measurement in table.measurements
        ),
        redundant=(),
        ids=tuple(str(k + 1) for k in range(rows)),
        labels={},
        incident_covariance=None,
        digest=sha256(f"{table.digest} times {rows}".encode()).hexdigest(),
    )


def growth_costs(pace: Pace) -> pd.DataFrame:
    """Cost of the log posterior with rows and with draws, and of a point fit with rows."""
    table, scene = load_table("wang_all.csv"), load_scene("wang_all.csv")
    rows = []
    for count in (7, 21, 210, 2100, 21_000, 100_000):
        problem = build_problem(enlarged(table, count), scene, Choices())
        point = np.array([[{**BASE, **NOISE}[name] for name in problem.free_names]])
        at = problem.to_coordinates(point)
        seconds = timed(partial(log_posterior, problem, at), pace.seconds, pace.repeats)
        row: dict[str, object] = {"rows": count, "draws": 1, "milliseconds": 1e3 * seconds,
                                  "microseconds an impact": 1e6 * seconds / count}  # fmt: skip
        if count in (21, 2100) or (count == 100_000 and pace is FULL):
            begun = time.perf_counter()
            run(problem, Effort(point_only=True))
            row["point fit [s]"] = time.perf_counter() - begun
        rows.append(row)
    problem = build_problem(table, scene, Choices())
    point = np.array([[{**BASE, **NOISE}[name] for name in problem.free_names]])
    for draws in (10, 100, 1000):
        at = np.repeat(problem.to_coordinates(point), draws, axis=0)
        seconds = timed(partial(log_posterior, problem, at), pace.seconds, pace.repeats)
        rows.append({"rows": 21, "draws": draws, "milliseconds": 1e3 * seconds,
                     "microseconds an impact": 1e6 * seconds / (21 * draws)})  # fmt: skip
    return pd.DataFrame(rows)


def start_up_costs(pace: Pace) -> pd.DataFrame:
    """Wall time of fresh processes [s]: help, first rebound with a warm and with an empty compile cache."""
    rebound = (
        "import fitball, time; m = fitball.model('two-mass'); "
        f"print(m.rebound({ {name: BASE[name] for name in default_model().parameter_names} }, "
        "fitball.impacts(14.0, 12.0, 100.0)).v_x2[0])"
    )
    rows = []
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
        for label, words, repeats in (
            ("fitball --help", ["-m", "fitball", "--help"], pace.repeats),
            ("first rebound, empty compile cache", ["-c", rebound], 1),
            ("first rebound, warm compile cache", ["-c", rebound], pace.repeats),
        ):
            taken = []
            for _ in range(repeats):
                begun = time.perf_counter()
                subprocess.run([sys.executable, *words], env=environment, check=True, capture_output=True)
                taken.append(time.perf_counter() - begun)
            rows.append({"process": label, "seconds": statistics.median(taken)})
    return pd.DataFrame(rows)


def stage_costs(cores: int) -> pd.DataFrame:
    """Stages of `calibrate` on two bundled tables, posterior densities and effective samples a second."""
    rows = []
    for name in ("wang_zero_spin.csv", "wang_all.csv"):
        problem = build_problem(load_table(name), load_scene(name), Choices())
        fit = run(problem, Effort(seed=1, cores=cores))
        assert fit.diagnostics is not None
        stages = {timing.stage: timing.seconds for timing in fit.timings}
        least = min(fit.diagnostics.min_ess_bulk, fit.diagnostics.min_ess_tail)
        rows.append(
            {"table": name, **{f"{stage} [s]": seconds for stage, seconds in stages.items()},
             "densities a second": fit.diagnostics.evaluations / stages["sampling"],
             "effective samples a second": least / sum(stages.values())}
        )  # fmt: skip
    return pd.DataFrame(rows)
