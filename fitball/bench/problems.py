"""What the bench works on: impacts with answers to fifty digits (the hard set: to sixteen), and tables of different
kinds on which densities and samplers are timed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256

import numpy as np
import pandas as pd

from fitball.bench.hard_cases import BASE, hard_cases
from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.data.table import ImpactTable, Measurement
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.problem import Problem
from fitball.models.model import Model, Oracle
from fitball.models.registry import model
from fitball.models.specs import DEFAULT_MODEL
from fitball.scheduling.engine import Engine, in_order
from fitball.values import FloatArray, Impacts, impacts

# The hard set holds joints that take minutes at fifty digits; there the double-precision oracle answers, which agrees
# with fifty digits to 1e-15 wherever both have been run.
HARD = "hard"
COLUMNS = ("v_x1 [m/s]", "v_y1 [m/s]", "omega_1 [rad/s]", "v_x2 [m/s]", "v_y2 [m/s]", "omega_2 [rad/s]")
# Noise at which densities are timed [m/s, rad/s]: as large as in Wang's tables.
VELOCITY, SPIN = 0.4, 14.0
# Slow impacts that are simulated, and the degrees of freedom of errors with outliers.
SLOW, FREEDOM = 30, 3.0


@dataclass(frozen=True)
class Scene:
    """Impacts of one kind with one parameter set each (rows, parameters), and the exact `v_x2`, `omega_2`."""

    name: str
    names: tuple[str, ...]
    values: FloatArray
    impacts: Impacts
    v_x2: FloatArray
    omega_2: FloatArray

    @property
    def speed(self) -> FloatArray:
        """Incident speed of the ball's surface, at most, (impacts,): what errors are relative to."""
        spin = default_model().ball.radius * np.abs(self.impacts.omega_1)
        return np.asarray(self.impacts.speed + spin)


def default_model() -> Model:
    """The model whose solvers are compared."""
    return model("two-mass")


def oracle() -> Oracle:
    """Its independent solution."""
    solution = default_model().oracle
    assert solution is not None
    return solution


def scenes(engine: Engine) -> tuple[Scene, ...]:
    """Sliding throughout, slide-grip-slide, grip from the start, Wang's 21, and the hard set of the default model.

    `engine` shares the exact answers, half a second per impact.
    """
    names = default_model().parameter_names
    base = np.array([BASE[name] for name in names])
    hard = [case for case in hard_cases() if not case.closures and "mass_ratio 1" not in case.name]
    kinds = {
        "sliding": impacts([16.0, 17.0, 25.0, 30.0], [4.0, 4.5, 4.0, 6.0], [0.0, -150.0, 0.0, 1e2]),
        "slide-grip-slide": impacts([12.0, 9.0, 14.0, 10.0], [13.0, 15.0, 12.0, 10.0], [0.0, 100.0, 140.0, -100.0]),
        "grip from the start": impacts([5.0, 4.0, 3.0, 6.0], [16.0, 15.0, 12.0, 14.0], [145.0, 120.0, 90.0, 180.0]),
        "Wang's 21": load_table("wang_all.csv").impacts,
        HARD: impacts(*np.array([case.impact for case in hard]).T),
    }
    values = dict.fromkeys(kinds, base) | {
        HARD: np.array([[case.parameters[name] for name in names] for case in hard])
    }
    return tuple(_scene(kind, names, values[kind], given, engine) for kind, given in kinds.items())


def _scene(name: str, names: tuple[str, ...], values: FloatArray, given: Impacts, engine: Engine) -> Scene:
    rows = np.broadcast_to(values, (len(given), len(names))).copy()
    bounces = [(dict(zip(names, row.tolist(), strict=True)), given.take(np.array([k]))) for k, row in enumerate(rows)]
    v_x2, omega_2 = np.array(list(in_order(engine, partial(_exact, None if name == HARD else 50), bounces))).T
    # Two events closer than rounding leave double precision without an answer, and the bench without a rival.
    kept = np.flatnonzero(np.isfinite(v_x2))
    return Scene(name, names, rows[kept], given.take(kept), v_x2[kept], omega_2[kept])


def _exact(digits: int | None, bounce: tuple[Mapping[str, float], Impacts]) -> tuple[float, float]:
    exact = oracle().rebound(*bounce, digits=digits)
    return float(exact.v_x2[0]), float(exact.omega_2[0])


def problems() -> Iterator[tuple[str, Problem]]:
    """Five problems by the name of their table: measured, simulated, slow, ungrouped, with outliers, incomplete."""
    for name in ("wang_zero_spin", "wang_all", "synthetic_court"):
        yield name, posed(name)
    yield "slow, without groups", build_problem(load_table(_slow()), load_scene(None), Choices())
    scene = load_scene("synthetic_court.csv")
    yield "student-t, cells missing", build_problem(load_table(_gappy()), scene, Choices(noise="student-t"))


def posed(name: str, rows: int | None = None) -> Problem:
    """The problem of a bundled table with its scene, `enlarged` to so many rows."""
    table = load_table(f"{name}.csv")
    return build_problem(table if rows is None else enlarged(table, rows), load_scene(f"{name}.csv"), Choices())


def simulated_frame(
    name: str, values: Mapping[str, float], given: Impacts, sds: Sequence[float], rng: np.random.Generator
) -> pd.DataFrame:
    """The table that a model makes at incident states, normal noise of `sds` [m/s, m/s, rad/s] added."""
    made = model(name).rebound(values, given)
    exact = zip((made.v_x2, made.v_y2, made.omega_2), sds, strict=True)
    noisy = [column + sd * rng.standard_normal(len(given)) for column, sd in exact]
    return pd.DataFrame(dict(zip(COLUMNS, (given.v_x1, given.v_y1, given.omega_1, *noisy), strict=True)))


def _slow() -> pd.DataFrame:
    """Impacts as of a ball thrown by hand, spins of both signs."""
    rng = np.random.default_rng(14)
    given = impacts(rng.uniform(1.0, 7.0, SLOW), rng.uniform(2.0, 6.0, SLOW), rng.uniform(-150.0, 150.0, SLOW))
    return simulated_frame(DEFAULT_MODEL, base_values(), given, (0.1, 0.1, 4.0), rng)


def _gappy() -> pd.DataFrame:
    """The simulated court with outliers added, every third spin and every fifth speed unread."""
    rng = np.random.default_rng(15)
    frame = load_table("synthetic_court.csv").to_frame()
    for name, size, every in (("v_x2", 0.2, 5), ("v_y2", 0.2, 7), ("omega_2", 6.0, 3)):
        column = next(head for head in frame if str(head).startswith(name))
        frame[column] += size * rng.standard_t(FREEDOM, len(frame))
        frame.loc[frame.index[every - 1 :: every], column] = np.nan
    return frame


def enlarged(table: ImpactTable, rows: int) -> ImpactTable:
    """A table of `rows` impacts that repeats another with small changes to the incident speeds."""
    rng = np.random.default_rng(rows)
    take = np.arange(rows) % len(table)
    stretch = 1.0 + 0.02 * rng.standard_normal(rows)
    given = table.impacts
    return replace(
        table,
        impacts=Impacts(given.v_x1[take] * stretch, given.v_y1[take] * stretch, given.omega_1[take]),
        measurements=tuple(Measurement(item.name, item.values[take]) for item in table.measurements),
        redundant=(),
        ids=tuple(str(k + 1) for k in range(rows)),
        labels={},
        incident_covariance=None,
        digest=sha256(f"{table.digest} times {rows}".encode()).hexdigest(),
    )


def base_values() -> dict[str, float]:
    """Parameters of the default model as in the catalogue of hard cases."""
    return {name: BASE[name] for name in model(DEFAULT_MODEL).parameter_names}


def spread_draws(count: int, seed: int = 1) -> FloatArray:
    """Parameter draws (count, parameters) of the default model, as wide as a posterior of Wang's 21 impacts."""
    base = base_values()
    widths = {"mass_ratio": 0.015, "k_y": 3e3, "k_theta": 3.0, "mu": 0.02, "eps_10": 3e-4, "eps_slope": 6e-5,
              "cor_10": 0.01, "cor_slope": 0.002}  # fmt: skip
    noise = np.random.default_rng(seed).standard_normal((count, len(base)))
    draws: FloatArray = np.array(list(base.values())) + noise * np.array([widths[name] for name in base])
    return draws


def spread_coordinates(problem: Problem, count: int) -> FloatArray:
    """Coordinates (count, free) of `spread_draws` with noise as large as in Wang's tables."""
    columns = dict(zip(base_values(), spread_draws(count).T, strict=True))
    sizes = {"spin_sd": SPIN, "degrees_of_freedom": 5.0}
    free = [columns.get(name, np.full(count, sizes.get(name, VELOCITY))) for name in problem.free_names]
    return problem.to_coordinates(np.stack(free, axis=1))
