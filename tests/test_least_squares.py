"""Least squares by lmfit: the errors that its documentation promises, and why a parameter has
none.
"""

import lmfit
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import approx_fprime, curve_fit
from support.density import REBOUND, problem_of, scene_of, table_of, truth_of
from support.line import SD, line_problem

import fitball
from fitball.inference.density import cells
from fitball.inference.search import least_squares as search
from fitball.inference.search.best_fit import best_fit
from fitball.inference.search.least_squares import least_squares


def fit_of(problem):
    """Least squares from the best fit."""
    return least_squares(problem, best_fit(problem, np.random.default_rng(0)))


@pytest.mark.parametrize("noise", [SD, 5.0 * SD])
def test_a_straight_line_as_curve_fit_has_it(noise):
    problem = line_problem(noise=noise)
    result = fit_of(problem)
    x = problem.rows.states.v_x1
    y = problem.rows.y[:, 0]
    (slope, shift), covariance = curve_fit(
        lambda x, slope, shift: slope * x + shift,
        x,
        y,
        sigma=np.full(x.size, noise),
        absolute_sigma=False,
    )
    slope_error, shift_error = np.sqrt(np.diag(covariance))
    assert result.values["slope"] == pytest.approx(slope, rel=1e-6)
    assert result.values["shift"] == pytest.approx(shift, rel=1e-6)
    # Whatever noise was expected: they follow from how the measurements scatter.
    assert result.stderr["slope"] == pytest.approx(slope_error, rel=1e-4)
    assert result.stderr["shift"] == pytest.approx(shift_error, rel=1e-4)
    residuals = (y - slope * x - shift) / noise
    square = np.sum(residuals**2)
    assert result.chi_square == pytest.approx(square, rel=1e-9)
    assert result.degrees_of_freedom == x.size - 2
    aic = x.size * np.log(square / x.size) + 4.0
    assert result.aic == pytest.approx(aic, rel=1e-9)
    assert result.stderr["v_x_sd"] is None
    assert result.missing["v_x_sd"].startswith("fixed")


def test_the_noise_is_taken_as_expected():
    problem = line_problem(noise=0.0)
    result = fit_of(problem)
    assert result.values["v_x_sd"] == pytest.approx(0.25, rel=1e-6)
    assert result.stderr["v_x_sd"] is None
    expected = fit_of(line_problem(noise=0.25))
    assert result.chi_square == pytest.approx(expected.chi_square, rel=1e-6)


def test_the_result_of_lmfit_has_the_same_errors():
    table = table_of(REBOUND, labels=("surface",), count=14)
    problem = problem_of(table, scene_of(), pool={"mu": "surface"})
    point = best_fit(problem, np.random.default_rng(0))
    of_lmfit, _ = search._minimize(problem, point)
    result = least_squares(problem, point)
    assert isinstance(of_lmfit, lmfit.minimizer.MinimizerResult)
    assert "mu_a_" in lmfit.fit_report(of_lmfit)
    assert of_lmfit.redchi == of_lmfit.chisqr / of_lmfit.nfree
    assert of_lmfit.params["mu_a_"].stderr == result.stderr["mu[a]"]
    assert result.stderr["mu[a]"] > 0.0
    assert result.degrees_of_freedom == 14 * 3 - 7


def test_slopes_are_those_of_the_residuals():
    scene = scene_of(time=True, ball=True)
    problem = problem_of(table_of(REBOUND, "corr"), scene, "two-mass")
    values = truth_of(problem)
    q = problem.coordinates(values)
    width = problem.prior.width

    def residuals_at(q):
        values = problem.values(q[None])
        point = {name: column[0] for name, column in values.items()}
        residuals, _ = search._linearize(problem, point)
        return residuals

    wanted = approx_fprime(q, residuals_at, 1e-7 * width)
    _, slopes = search._linearize(problem, values)
    assert slopes.shape == (10 * 3 + 1 + 2, q.size)
    assert_allclose(slopes * width, wanted * width, atol=1e-4)
    # The rows of what the scene measured, too.
    of_scene = np.abs(slopes[-3:] * width)
    assert np.all(of_scene.max(axis=1) > 0.1)


def test_what_the_scene_measured_counts():
    problem = problem_of(table_of(REBOUND), scene_of(ball=True))
    result = fit_of(problem)
    mass_z = (result.values["ball_mass"] - 0.0577) / 2e-4
    ratio_z = (result.values["inertia_ratio"] - 0.56) / 0.01
    assert result.stderr["ball_mass"] < 3.0 * 2e-4
    assert result.stderr["inertia_ratio"] < 3.0 * 0.01
    q = problem.coordinates(result.values)
    z = cells(problem, q[None]).z
    square = np.sum(z**2) + mass_z**2 + ratio_z**2
    assert result.chi_square == pytest.approx(square, rel=1e-9)
    assert result.degrees_of_freedom == 30 + 2 - 7


def test_no_error_on_a_bound_or_where_nothing_changes():
    prior = {"mu": "uniform(0.1, 0.5)"}
    bound = fit_of(problem_of(table_of(REBOUND), scene_of(), prior=prior))
    assert bound.values["mu"] == pytest.approx(0.5)
    assert bound.stderr["mu"] is None
    fixed = fit_of(problem_of(table_of(REBOUND), scene_of(), fix={"mu": 0.5}))
    for name in ("e_x", "offset", "cor_10", "cor_slope"):
        assert bound.stderr[name] == pytest.approx(fixed.stderr[name], rel=1e-3)
    # Fewer measurements than parameters.
    few = fit_of(problem_of(table_of(REBOUND, count=2), scene_of(), "two-mass"))
    assert few.degrees_of_freedom < 0
    assert {*few.missing} >= {"mass_ratio", "k_y", "k_theta"}
    # Friction where all impacts grip.
    table = table_of(REBOUND)
    table.values["v_x1"][:] *= 0.2
    table.values["v_x2"][:] *= 0.2
    table.values["omega_1"][:] = 0.0
    table.values["omega_2"][:] = 0.0
    grip = fit_of(problem_of(table, scene_of()))
    assert grip.stderr["mu"] is None
    assert grip.stderr["cor_10"] > 0.0
    assert {*grip.missing} == {"mu", "v_x_sd", "v_y_sd", "spin_sd"}


def test_a_value_that_ends_at_zero_is_on_its_bound():
    """Balls that lost hardly any speed along the court, read as other balls than they were: without
    friction, whose coordinate is then infinite.
    """
    film = fitball.track("table_tennis_topspin")
    fit = fitball.calibrate(film.table, model="brody", point_only=True)
    # On some machines the last step ends at zero itself.
    assert fit.least_squares.values["mu"] == pytest.approx(0.0, abs=1e-9)
    assert fit.least_squares.stderr["mu"] is None
