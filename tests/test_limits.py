"""Searches in the limit of a light shell: planted maxima that draws of the prior seldom reach."""

from pathlib import Path

import numpy as np
import pytest
from made_tables import impact_table
from support.fits import drops_of, line

from fitball.base.values import Ball, Impacts
from fitball.data.load import load_data
from fitball.data.scene import Scene
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.inference.search.best_fit import best_fit
from fitball.inference.search.limits import places_in_limits
from fitball.inference.search.objective import Objective, descend
from fitball.models.registry import model

DATA = Path(__file__).parent / "data"
NOISE = {"v_x_sd": 0.2, "v_y_sd": 0.15, "spin_sd": 12.0}
# Of a shell with 1 to 10 parts of 10,000 of the mass; impacts grip.
COMMON = {"eps_10": 2.4e-3, "eps_slope": 0.0, "cor_10": 0.75, "cor_slope": -0.014}
LIGHT = (
    {"mass_ratio": 0.9999, "mu": 2.2, "k_y": 2.1e4, "k_theta": 645.0},
    {"mass_ratio": 0.99993, "mu": 1.8, "k_y": 2.0e4, "k_theta": 162.0},
    {"mass_ratio": 0.9993, "mu": 2.0, "k_y": 9e3, "k_theta": 243.0},
)


def planted(truth, seed):
    """The problem of 24 impacts of a ball, and the log posterior of its maximum near the truth."""
    rng = np.random.default_rng(seed)
    speed = rng.uniform(12.0, 26.0, 24)
    angle = np.radians(rng.uniform(18.0, 62.0, 24))
    spin = rng.uniform(-200.0, 250.0, 24)
    impacts = Impacts(speed * np.cos(angle), speed * np.sin(angle), spin)
    rebound = model("two-mass", ball=Ball(0.0576, 0.03302, 0.54)).rebound(
        {**COMMON, **truth}, impacts
    )
    noise = dict(zip(("v_x2", "v_y2", "omega_2"), NOISE.values(), strict=True))
    values = {"v_x1": impacts.v_x1, "v_y1": impacts.v_y1, "omega_1": impacts.omega_1}
    for name, sd in noise.items():
        values[name] = rebound.column(name) + sd * rng.standard_normal(24)
    problem = build_problem(impact_table(values), Scene(), Choices("two-mass"))
    start = problem.coordinates({**COMMON, **truth, **NOISE})
    _, cost, _ = descend(Objective(problem), start[None])
    return problem, -cost[0]


@pytest.mark.parametrize("truth", LIGHT)
@pytest.mark.parametrize("seed", range(2))
def test_the_maximum_of_a_light_shell_is_found(truth, seed):
    problem, near_truth = planted(truth, seed)
    found = best_fit(problem, np.random.default_rng(seed))
    assert found.log_posterior[0] > near_truth - 0.5


@pytest.mark.parametrize("seed", [0, 2])
def test_the_higher_maximum_of_two_surfaces_is_found(seed):
    """Of 30 impacts of a ball that no model here describes. Of 1,200 searches from draws of the
    prior one reached the highest maximum, at -46.5; others end at -54.
    """
    table, scene = load_data(DATA / "two_solutions.csv", None, False)
    problem = build_problem(table, scene, Choices("two-mass"))
    found = best_fit(problem, np.random.default_rng(seed))
    assert found.log_posterior[0] == pytest.approx(-46.5, abs=0.1)
    assert found.optima[0]["mass_ratio"] > 0.999
    assert found.optima[0]["mu[hard]"] == pytest.approx(1.68, abs=0.05)
    assert min(abs(values["mu[hard]"] - 0.605) for values in found.optima) < 0.02


def test_what_has_no_such_limit_has_no_places_in_it():
    problem, _ = planted(LIGHT[0], 0)
    rng = np.random.default_rng(1)
    places = places_in_limits(problem, problem.prior.location, rng)
    names = problem.free
    assert 0 < len(places) <= 4
    assert np.all(places[:, names.index("mass_ratio")] > 0.93)
    assert np.all(places[:, names.index("mu")] > np.log(1.5))
    for choices in (Choices("grip-slip"), Choices("two-mass", fix={"mass_ratio": 0.9})):
        other = build_problem(problem.table, Scene(), choices)
        assert not len(places_in_limits(other, other.prior.location, rng))
    speeds = np.linspace(5.0, 17.0, 9)
    drops = drops_of(line, speeds, 0.7 * speeds)
    assert not len(places_in_limits(drops, drops.prior.location, rng))
