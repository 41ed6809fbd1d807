"""Tables of different kinds on which samplers and densities are timed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pandas as pd

from fitball.data.read import load_table
from fitball.data.scene import Scene, load_scene
from fitball.data.table import ImpactTable, Measurement
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.problem import Problem
from fitball.models.names import DEFAULT_MODEL
from fitball.models.registry import model
from fitball.studies.bench.hard_cases import BASE
from fitball.values import FloatArray, Impacts, impacts

COLUMNS = ("v_x1 [m/s]", "v_y1 [m/s]", "omega_1 [rad/s]", "v_x2 [m/s]", "v_y2 [m/s]", "omega_2 [rad/s]")
# Noise at which densities are timed [m/s, rad/s]: as large as in Wang's tables.
VELOCITY, SPIN = 0.4, 14.0
# Slow impacts that are simulated, and the degrees of freedom of errors with outliers.
SLOW, FREEDOM = 30, 3.0
# The truth of tables of many rows.
SIMULATED = {"mu": 0.6, "e_x": 0.1, "offset": 0.0, "cor_10": 0.78, "cor_slope": -0.012}


def problems() -> Iterator[tuple[str, Problem]]:
    """Five problems by the name of their table: measured, simulated, slow, ungrouped, with outliers, incomplete."""
    for name in ("wang_zero_spin", "wang_all", "synthetic_court"):
        yield name, posed(name)
    yield "slow, without groups", build_problem(load_table(_slow()), Scene(), Choices())
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


def write_simulated(place: Path, rows: int) -> None:
    """A CSV file of about `rows` impacts of 8 to 35 m/s at 15 to 70 degrees, with back- and topspin, that grip-slip
    made, 0.3 m/s and 10 rad/s of noise added; a rebound that noise turns is left out.
    """
    rng = np.random.default_rng(rows)
    speed, angle = rng.uniform(8.0, 35.0, rows), np.radians(rng.uniform(15.0, 70.0, rows))
    given = impacts(speed * np.cos(angle), speed * np.sin(angle), rng.uniform(-200.0, 300.0, rows))
    frame = simulated_frame("grip-slip", SIMULATED, given, (0.3, 0.3, 10.0), rng)
    frame[frame["v_y2 [m/s]"] > 0.0].to_csv(place, index=False, float_format="%.6g")


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
