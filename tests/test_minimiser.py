"""What lmfit is given: derivatives, and errors withheld where a bound cuts them off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from samples import GRIP_SLIP, coordinates_of, drop_table, linear_problem, problem_of, synthetic

from fitball.bench.problems import enlarged
from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.data.table import Measurement
from fitball.inference.likelihood.residuals import Weighting, default_noise, residuals
from fitball.inference.point import lmfit_minimiser as lmfit_side
from fitball.inference.point.least_squares import least_squares
from fitball.inference.point.lmfit_minimiser import Minimiser
from fitball.inference.point.maximum_posterior import maximum_posterior
from fitball.inference.point.point_fit import starting_points
from fitball.inference.problem.build import Choices, build_problem


def weighting(problem):
    return Weighting(default_noise(problem), penalised=False)


@pytest.mark.parametrize("name", ["grip-slip", "two-mass"])
def test_jacobians_of_tables_short_and_long_are_the_same_rows(name):
    """Above a thousand impacts the differences are one-sided: same slopes, repeated rows, to their own error."""
    table = enlarged(load_table("wang_all.csv"), 1050)
    scene = load_scene("wang_all.csv")
    long = build_problem(table, scene, Choices(model=name))
    assert len(long.impacts) > lmfit_side.ONE_SIDED
    made = Minimiser(long, weighting(long))
    at = made.to_fitted(starting_points(long, np.random.default_rng(3), 1))[0]
    parameters = made.parameters(at)
    one_sided = made.jacobian(parameters)
    step = 1e-5 * made.scale()
    central = [
        (made.at((at + step * unit)[None, :])[0] - made.at((at - step * unit)[None, :])[0]) / (2.0 * step[k])
        for k, unit in enumerate(np.eye(at.size))
    ]
    size = np.max(np.abs(central), axis=1)
    assert one_sided.shape == (made.residual(parameters).size, at.size)
    np.testing.assert_allclose(one_sided / size, np.transpose(central) / size, atol=1e-3)


def test_a_one_sided_step_turns_round_at_its_upper_bound(monkeypatch):
    monkeypatch.setattr(lmfit_side, "ONE_SIDED", 5)
    problem = problem_of("wang_zero_spin.csv", "grip-slip")
    made = Minimiser(problem, weighting(problem))
    at = made.to_fitted(starting_points(problem, np.random.default_rng(3), 1))[0]
    column = made.names.index("e_x")
    at[column] = made.limits()[1][column]
    found = made.jacobian(made.parameters(at))
    monkeypatch.setattr(lmfit_side, "ONE_SIDED", 1000)
    np.testing.assert_allclose(found, made.jacobian(made.parameters(at)), rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_on_either_bound_there_is_no_symmetric_error(side):
    """Restitution of a drop test that rises or falls with speed more steeply than is allowed."""
    table = drop_table(np.random.default_rng(1))
    speeds = np.linspace(8.0, 12.0, len(table.impacts))
    rebound = Measurement("v_y2", (0.5 + side * 0.2 * (speeds - 10.0)) * speeds)
    problem = linear_problem(
        replace(table, impacts=replace(table.impacts, v_y1=speeds), measurements=(rebound,)), velocity_sd=0.1
    )
    found = least_squares(problem, starting_points(problem, np.random.default_rng(1), 5))
    assert found.values["cor_slope"] == pytest.approx(side * 0.1, rel=1e-5)
    assert found.stderr["cor_slope"] is None and "lies on a bound" in found.missing["cor_slope"]
    assert found.stderr["cor_10"] is not None


@pytest.mark.parametrize(
    ("name", "parameter", "text", "edge"),
    [
        ("brody", "cor_slope", "uniform(-0.005, 0.02)", -0.005),
        ("grip-slip", "mu", "loguniform(0.3, 0.4)", 0.4),
        ("grip-slip", "velocity_sd", "uniform(0.01, 0.0101)", 0.0101),
        ("two-mass", "mass_ratio", "uniform(0.5, 0.80)", 0.80),
    ],
)
def test_a_uniform_prior_that_excludes_what_the_table_wants_ends_the_search_at_its_edge(name, parameter, text, edge):
    table, scene = load_table("wang_zero_spin.csv"), load_scene("wang_zero_spin.csv")
    problem = build_problem(table, replace(scene, mu=None), Choices(model=name, priors={parameter: text}))
    found = maximum_posterior(problem, starting_points(problem, np.random.default_rng(1), 5))
    prior = next(item.prior for item in problem.free if item.name == parameter)
    low, high = prior.value(np.array(prior.support))
    assert low <= found.values[parameter] <= high
    assert found.values[parameter] == pytest.approx(edge, abs=0.02 * (high - low))


def test_residuals_at_the_truth_vanish():
    problem = synthetic(problem_of("wang_zero_spin.csv", "grip-slip"), GRIP_SLIP)
    at = problem.to_values(coordinates_of(problem, GRIP_SLIP)[None, :])
    np.testing.assert_allclose(residuals(problem, at, weighting(problem)), 0.0, atol=1e-9)
