"""Tables of a population whose centre and spread are known, and draws of the posterior of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitball.api.calibrating import pose
from fitball.data.table import ImpactTable
from fitball.inference.point.maximum_posterior import maximum_posterior
from fitball.inference.point.point_fit import STARTS, starting_points
from fitball.inference.population.hyper import Before
from fitball.inference.population.quantity import prior_of, quantity
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.problem import Choices, Problem
from fitball.inference.results.results import Posterior, thinned
from fitball.inference.sampling.ensembles import ENSEMBLES, Schedule, Settings, default_walkers, sample
from fitball.models.registry import model
from fitball.observables import SI_UNITS
from fitball.values import FloatArray, Impacts

MODEL = "grip-slip"
QUANTITIES = ("mu", "cor_10")
# What is known of a population before its tables, and what they are drawn from: centre and its sd in the coordinate,
# sd of the half-normal distribution of the spread.
POPULATIONS: Mapping[str, tuple[float, float, float]] = {
    "mu": (float(np.log(0.62)), 0.15, 0.15), "cor_10": (0.76, 0.03, 0.03)
}  # fmt: skip
# Priors that the tables are fitted under: beside the populations by about a sd of theirs, as a user may state them
# who has read of other courts. The other parameters are drawn from theirs.
INTERIM: Mapping[str, str] = {"mu": "lognormal(0.45, 0.3)", "cor_10": "normal(0.7, 0.06)"}
OTHERS: Mapping[str, str] = {
    "e_x": "normal(0.1, 0.15)", "offset": "normal(0.002, 0.001)", "cor_slope": "normal(-0.012, 0.004)",
    "velocity_sd": "lognormal(0.5, 0.2)", "spin_sd": "lognormal(20, 0.2)",
}  # fmt: skip
SCHEDULE = Schedule(warm_up=160, first_check=320, target_ess=400.0, target_r_hat=1.05)
MAX_STEPS = 2000
DRAWS = 400


@dataclass(frozen=True)
class Truth:
    """A population: centre and spread of each quantity, in its coordinate."""

    centre: Mapping[str, float]
    spread: Mapping[str, float]


def draw_truth(rng: np.random.Generator) -> Truth:
    """One of the populations that may be."""
    drawn = {name: rng.standard_normal(2) for name in QUANTITIES}
    known = POPULATIONS
    return Truth(
        {name: known[name][0] + known[name][1] * float(z[0]) for name, z in drawn.items()},
        {name: known[name][2] * abs(float(z[1])) for name, z in drawn.items()},
    )


def before(name: str) -> Before:
    """What is known of a population of a quantity before its tables."""
    centre, sd, spread = POPULATIONS[name]
    asked = quantity(name)
    ends = asked.ends({name: prior_of(asked.parts[0], INTERIM[name])})
    return Before(lambda places: -0.5 * ((places - centre) / sd) ** 2, spread, ends)


def draw_table(
    truth: Truth, rows: int, rng: np.random.Generator, known: Mapping[str, float] | None = None
) -> tuple[ImpactTable, Mapping[str, float]]:
    """The table of one court, impacts steep and shallow; and its true parameters: those that are `known`, the
    quantities from their population, all others from their priors.
    """
    specs = {**model(MODEL).specs, **NOISE_SPECS}
    values = {name: float(prior_of(specs[name], text).draw(rng, 1)[0]) for name, text in OTHERS.items()}
    for name in QUANTITIES:
        values[name] = quantity(name).value(truth.centre[name] + truth.spread[name] * float(rng.standard_normal()))
    values |= known or {}
    speed, angle = rng.uniform(14.0, 25.0, rows), np.radians(rng.uniform(22.0, 55.0, rows))
    impacts = Impacts(speed * np.cos(angle), speed * np.sin(angle), rng.uniform(-150.0, 150.0, rows))
    rebound = model(MODEL).rebound(
        {name: value for name, value in values.items() if name not in NOISE_SPECS}, impacts
    )
    columns = {"v_x1": impacts.v_x1, "v_y1": impacts.v_y1, "omega_1": impacts.omega_1}
    for name in ("v_x2", "v_y2", "omega_2"):
        sd = values["spin_sd" if name == "omega_2" else "velocity_sd"]
        columns[name] = getattr(rebound, name) + sd * rng.standard_normal(rows)
    frame = {f"{name} [{SI_UNITS[name]}]": column.tolist() for name, column in columns.items()}
    return pose(frame, Choices(model=MODEL), as_read=True).table, values


def posterior_draws(problem: Problem, root: np.random.SeedSequence, schedule: Schedule = SCHEDULE) -> Posterior:
    """The posterior of one table by the road of `calibrate` with a shorter chain."""
    point = maximum_posterior(problem, starting_points(problem, np.random.default_rng(root), STARTS))
    optima = np.array([[optimum[name] for name in problem.free_names] for optimum in point.optima])
    settings = Settings(
        default_walkers(problem.dimension), ENSEMBLES, MAX_STEPS, 1, int(root.generate_state(1)[0]), schedule
    )
    sampled = sample(problem, problem.to_coordinates(optima), settings, None, False, lambda _progress: None)
    shape = sampled.kept.shape
    values: FloatArray = problem.to_values(sampled.kept.reshape(-1, shape[-1])).reshape(shape)
    return Posterior(problem.free_names, values, np.empty(shape[:-1]), np.empty((0, shape[-1])))


def kept_columns(posterior: Posterior) -> Mapping[str, FloatArray]:
    """As many draws (draws,) of each quantity as a batch keeps."""
    kept = thinned(posterior, DRAWS)
    return {name: kept[:, posterior.names.index(name)] for name in QUANTITIES}
