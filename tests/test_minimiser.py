"""What lmfit is given: derivatives, and errors withheld where a bound cuts them off."""

from __future__ import annotations

from dataclasses import replace

import lmfit
import numpy as np
import pytest
from samples import GRIP_SLIP, coordinates_of, drop_table, linear_problem, problem_of, synthetic

from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.data.table import Measurement
from fitball.inference.likelihood.residuals import Weighting, default_noise, residuals
from fitball.inference.point.least_squares import Settling, least_squares
from fitball.inference.point.point_fit import maximum_posterior, starting_points
from fitball.inference.problem.build import Choices, build_problem


def weighting(problem):
    return Weighting(default_noise(problem), penalised=False)


def test_one_call_settles_what_was_searched_and_its_covariance_is_what_is_said(monkeypatch):
    """A smooth, linear table: lmfit's own standard errors, not scaled by the chi-square."""
    calls, plain = [], lmfit.Minimizer

    class Watched(plain):
        def least_squares(self, *given, **options):
            calls.append(super().least_squares(*given, **options))
            return calls[-1]

    monkeypatch.setattr("fitball.inference.point.least_squares.lmfit.Minimizer", Watched)
    problem = problem_of("wang_all.csv", "grip-slip")
    found = least_squares(problem, starting_points(problem, np.random.default_rng(1), 5))
    (told,) = calls
    assert {name for name, item in told.params.items() if item.vary} == set(told.var_names)
    for name in told.var_names:
        assert found.stderr[name] == pytest.approx(told.params[name].stderr, rel=1e-6)
        assert found.values[name] == told.params[name].value
    np.testing.assert_allclose(found.covariance, told.covar, rtol=1e-6)
    assert (found.chi_square, found.evaluations) == (told.chisqr, told.nfev)


@pytest.mark.parametrize("choices", [{}, {"pool": {"mu": "group"}}])
def test_names_that_are_no_identifiers_reach_lmfit(choices):
    problem = problem_of("wang_all.csv", "grip-slip", **choices)
    at = starting_points(problem, np.random.default_rng(3), 1)[0]
    made = Settling(problem, weighting(problem), at).parameters
    assert len(made) == len(problem.parameters)
    assert [item.value for item in made.values() if item.vary] == [
        value for value, name in zip(at, problem.free_names, strict=True) if not name.endswith("_sd")
    ]


def test_the_model_beyond_its_wall_is_no_place_for_lmfit():
    """On the wall mass_ratio = COR the mass ratio follows the others, as lmfit's expression."""
    problem = problem_of("wang_zero_spin.csv")
    found = least_squares(problem, starting_points(problem, np.random.default_rng(1), 16))
    at = np.array([found.values[name] for name in problem.free_names])
    made = Settling(problem, weighting(problem), at)
    assert "cor_10" in made.parameters["mass_ratio"].expr
    assert made.parameters["mass_ratio"].value == pytest.approx(found.values["mass_ratio"], abs=1e-7)
    for sign in (-1.0, 1.0):
        moved = made._moved(problem.free_names.index("cor_10"), 1e3 * sign)
        assert not problem.rebound(moved[None, :]).status.any()


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


def test_a_loguniform_prior_below_one_is_searched_as_a_whole():
    table, scene = load_table("wang_zero_spin.csv"), replace(load_scene("wang_zero_spin.csv"), mu=None)
    found, wanted = (
        least_squares(problem, starting_points(problem, np.random.default_rng(1), 5)).values["mu"]
        for text in ("loguniform(0.05, 0.7)", "uniform(0.05, 0.7)")
        for problem in [build_problem(table, scene, Choices(model="brody", priors={"mu": text}))]
    )
    assert found == pytest.approx(wanted, rel=1e-6)


def test_residuals_at_the_truth_vanish():
    problem = synthetic(problem_of("wang_zero_spin.csv", "grip-slip"), GRIP_SLIP)
    at = problem.to_values(coordinates_of(problem, GRIP_SLIP)[None, :])
    np.testing.assert_allclose(residuals(problem, at, weighting(problem)), 0.0, atol=1e-9)
