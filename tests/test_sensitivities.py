"""Exact derivatives against differences: of rebounds, of residuals, over levels, biases, walls and kinds of noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from samples import TWO_MASS, polar_problem, problem_of

from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.inference.likelihood.residuals import (
    Weighting,
    default_noise,
    differentiable,
    residual_slopes,
    residuals,
)
from fitball.inference.point.least_squares import Settling
from fitball.inference.point.point_fit import starting_points
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.noise import KINDS, NoiseKind
from fitball.models.types import OUTPUTS
from fitball.observables import OBSERVABLES

CASES = {
    "two-mass": Choices(),
    "grip-slip": Choices(model="grip-slip"),
    "thesis-exact": Choices(model="thesis-exact"),
    "one parameter by level": Choices(pool={"mu": "group"}),
    "two parameters by level": Choices(pool={"cor_10": "group", "k_theta": "group"}),
    "level of a fixed parameter": Choices(pool={"k_theta": "group"}, fix={"k_theta": 15.0}),
    "biased groups, heavy tails": Choices(model="grip-slip", offsets="group", noise="student-t"),
    "a logarithm of the walled": Choices(priors={"mass_ratio": "lognormal(0.9, 0.1)"}),
}

# Neither momentum balance, nor one wall for all levels.
WALL_LESS = ("grip-slip", "thesis-exact", "two parameters by level", "biased groups, heavy tails")


def problem_and_start(choices, table="wang_all.csv"):
    problem = build_problem(load_table(table), load_scene(table), choices)
    start = starting_points(problem, np.random.default_rng(3), 1)[:1]
    for k, name in enumerate(problem.free_names):
        start[0, k] = TWO_MASS.get(name, 0.03 if "place[" in name else start[0, k])
    return problem, start


def differences(function, x, steps):
    """Central differences with one halving of the steps, (..., coordinates)."""

    def slopes(factor):
        ends = [function(np.concatenate([x + s * factor * np.diag(steps) for s in (1.0, -1.0)]))]
        up, down = np.split(ends[0], 2)
        return np.moveaxis((up - down) / (2.0 * factor * steps.reshape(-1, *[1] * (up.ndim - 1))), 0, -1)

    return (4.0 * slopes(0.5) - slopes(1.0)) / 3.0


@pytest.mark.parametrize("case", CASES)
def test_rebounds(case):
    problem, start = problem_and_start(CASES[case])
    x = problem.to_coordinates(start)
    rebound, slopes = problem.differentiated(x)
    assert not np.any(rebound.status)
    for name in (name for name in OUTPUTS if problem.model.gives(OBSERVABLES[name])):
        wanted = differences(
            lambda at, name=name: getattr(problem.rebound(problem.to_values(at)), name), x, 1e-4 * problem.prior.width
        )
        size = np.abs(getattr(rebound, name)[0]).max()
        np.testing.assert_allclose(
            slopes[name][0] * problem.prior.width / size, wanted * problem.prior.width / size, rtol=1e-6, atol=1e-8
        )


@pytest.mark.parametrize("case", CASES)
def test_residuals_as_lmfit_sees_them(case):
    """On the wall too, where the mass ratio goes with the restitution."""
    problem, start = problem_and_start(CASES[case])
    weighting = Weighting(default_noise(problem), penalised=False)
    assert differentiable(problem) and Settling(problem, weighting, start[0]).wall is None
    named = {name: column[0] for name, column in problem.all_values(start).items()}
    walls = [wall for wall in problem.linear_constraints if wall.lower_bound_of in problem.free_names]
    assert bool(walls) == (case not in WALL_LESS)
    if walls:
        others = (sum(f * named[name] for name, f in wall.coefficients.items() if f != -1.0) for wall in walls)
        start[0, problem.free_names.index("mass_ratio")] = max(others) + walls[0].margin - walls[0].bound
    made = Settling(problem, weighting, start[0])
    assert (made.wall is None) == (case in WALL_LESS) and ("mass_ratio" in moving(made)) == (
        case in WALL_LESS and "mass_ratio" in problem.free_names
    )
    found, wanted = made._slopes(start, problem), made._differences(start)
    scale = made.width[made.varied]
    np.testing.assert_allclose(found * scale, wanted * scale, rtol=1e-5, atol=1e-6 * np.abs(wanted * scale).max())


def moving(made):
    return [made.problem.free_names[k] for k in made.varied]


def test_angles_and_tails(tmp_path):
    """The spread of an angle moves with the speed."""
    problem = polar_problem(tmp_path)
    start = starting_points(problem, np.random.default_rng(3), 1)[:1]
    x = problem.to_coordinates(start)
    for noise in ({}, {"degrees_of_freedom": 3.0}):
        weighting = Weighting(default_noise(problem) | noise, penalised=True)
        found = residual_slopes(problem, x, weighting)[0] * problem.prior.width
        wanted = differences(
            lambda at, weighting=weighting: residuals(problem, problem.to_values(at), weighting),
            x, 1e-4 * problem.prior.width,
        ) * problem.prior.width  # fmt: skip
        np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-6 * np.abs(wanted).max())


@pytest.mark.parametrize("kind", KINDS.values(), ids=list(KINDS))
def test_residuals_of_every_kind_of_noise(kind):
    sizes = {item.name: 4.0 for item in kind.parameters}
    z = np.array([[-8.0, -1.0, -1e-3, 0.0, 1e-3, 1.0, 8.0]])
    wanted = (kind.residual(z + 1e-5, sizes) - kind.residual(z - 1e-5, sizes)) / 2e-5
    np.testing.assert_allclose(kind.residual_rate(z, sizes), wanted, rtol=1e-7)
    np.testing.assert_allclose(NoiseKind.residual_rate(kind, z, sizes), wanted, rtol=1e-7)


def test_what_cannot_be_evaluated_is_flat_in_residuals_and_has_no_slope_in_rebounds():
    problem, start = problem_and_start(Choices())
    start[0, problem.free_names.index("mass_ratio")] = 0.5
    x = problem.to_coordinates(start)
    rebound, slopes = problem.differentiated(x)
    failed = rebound.status[0] != 0
    assert failed.any() and np.isnan(slopes["v_y2"][0, failed][:, problem.free_names.index("cor_10")]).all()
    noise = [k for k, name in enumerate(problem.free_names) if name.endswith("_sd")]
    assert np.all(slopes["v_y2"][0][:, noise] == 0.0)
    assert np.all(residual_slopes(problem, x, Weighting(default_noise(problem), penalised=False)) == 0.0)


def test_errors_of_the_incident_state_and_force_records_keep_differences():
    problem = problem_of("wang_all.csv")
    assert differentiable(problem)
    assert not differentiable(replace(problem, force=object())) and not differentiable(
        replace(problem, errors=object())
    )
