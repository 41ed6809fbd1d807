"""Least squares by lmfit: the errors that its documentation promises, and why a parameter has
none.
"""

from dataclasses import replace

import lmfit
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import approx_fprime, curve_fit, minimize_scalar
from support.density import REBOUND, problem_of, scene_of, table_of, truth_of
from support.line import SD, line_problem
from support.near import assert_near, assert_within

import fitball
from fitball.base import air
from fitball.base.values import Ball
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
    assert_near(result.values["slope"], slope)
    assert_near(result.values["shift"], shift)
    # Whatever noise was expected: they follow from how the measurements scatter.
    assert_near(result.stderr["slope"], slope_error, 1e-4)
    assert_near(result.stderr["shift"], shift_error, 1e-4)
    residuals = (y - slope * x - shift) / noise
    square = np.sum(residuals**2)
    assert_near(result.chi_square, square, 1e-9)
    assert result.degrees_of_freedom == x.size - 2
    aic = x.size * np.log(square / x.size) + 4.0
    assert_near(result.aic, aic, 1e-9)
    assert result.stderr["v_x_sd"] is None
    assert result.missing["v_x_sd"].startswith("fixed")


def test_the_noise_is_taken_as_expected():
    problem = line_problem(noise=0.0)
    result = fit_of(problem)
    assert_near(result.values["v_x_sd"], 0.25)
    assert result.stderr["v_x_sd"] is None
    expected = fit_of(line_problem(noise=0.25))
    assert_near(result.chi_square, expected.chi_square)


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
    assert_near(result.chi_square, square, 1e-9)
    assert result.degrees_of_freedom == 30 + 2 - 7


def line_with_stated_slope(noise):
    """The straight line, and that its slope is 0.62 ± 0.01 by another measurement."""
    problem = line_problem(noise=noise, prior={"slope": "normal(0.62, 0.01)"})
    parameters = tuple(
        parameter._replace(measured=parameter.spec.name == "slope")
        for parameter in problem.prior.parameters
    )
    return replace(problem, prior=replace(problem.prior, parameters=parameters))


def shift_by_restricted_likelihood(x, y):
    """Shift of a line, its error, and the sd of the noise. The stated slope is one common error of
    all rows, of covariance 0.01^2 x x', beside the noise of largest restricted likelihood.
    """
    rest = y - 0.62 * x
    ones = np.ones(x.size)

    def fitted(noise):
        covariance = noise**2 * np.eye(x.size) + 0.01**2 * np.outer(x, x)
        inverse = np.linalg.inv(covariance)
        information = ones @ inverse @ ones
        shift = ones @ inverse @ rest / information
        residual = rest - shift
        deviance = np.linalg.slogdet(covariance)[1] + np.log(information)
        return shift, information**-0.5, deviance + residual @ inverse @ residual

    best = minimize_scalar(
        lambda log_noise: fitted(np.exp(log_noise))[2],
        bounds=(np.log(0.01), np.log(10.0)),
        method="bounded",
        options={"xatol": 1e-9},
    )
    noise = np.exp(best.x)
    shift, error, _ = fitted(noise)
    return shift, error, noise


@pytest.mark.parametrize("noise", [SD / 20.0, SD, 20.0 * SD])
def test_a_stated_parameter_keeps_its_error_whatever_noise_was_expected(noise):
    problem = line_with_stated_slope(noise)
    result = fit_of(problem)
    x = problem.rows.states.v_x1
    y = problem.rows.y[:, 0]
    shift, error, scatter = shift_by_restricted_likelihood(x, y)
    assert_within(result.values["shift"], shift, 1e-4 * error)
    assert_near(result.stderr["shift"], error, 1e-4)
    design = np.column_stack([x, np.ones(x.size)]) / scatter
    information = design.T @ design + np.diag([0.01**-2, 0.0])
    slope_error = np.sqrt(np.linalg.inv(information)[0, 0])
    assert_near(result.stderr["slope"], slope_error, 1e-4)
    # Chi-square compares with the expected noise, and with what is stated.
    residual = (y - result.values["slope"] * x - result.values["shift"]) / noise
    stated = (result.values["slope"] - 0.62) / 0.01
    assert_near(result.chi_square, residual @ residual + stated**2, 1e-9)
    assert result.degrees_of_freedom == x.size + 1 - 2
    # The noise of measurements is fitted, that of what is stated is not.
    deviance = x.size * np.log(residual @ residual / x.size) + stated**2
    assert_near(result.aic, deviance + 2.0 * 2, 1e-9)
    assert_near(result.bic, deviance + 2.0 * np.log(x.size + 1), 1e-9)


def speeds_of_heights(heights, cor_10, cor_slope, drag):
    """Speeds after the bounce of balls dropped through air, as their rebound heights read at the
    usual drag. Where restitution rises with speed, its odds are a power of it.
    """
    braking = drag * air.braking_per_drag(Ball(), {})
    landing = air.landing_speed(heights, braking)
    power = 10.0 * cor_slope / (cor_10 * (1.0 - cor_10))
    odds = cor_10 / (1.0 - cor_10) * (landing / 10.0) ** power
    rebound = odds / (1.0 + odds) * landing
    usual = 0.55 * air.braking_per_drag(Ball(), {})
    return air.launch_speed(air.rebound_height(rebound, braking), usual)


def test_the_stated_drag_of_drops_by_heights_keeps_its_error():
    """Drops tell little of the drag; residuals far below the expected noise do not add to it."""
    heights = np.repeat([1.0, 1.5, 2.0, 2.54], 5)
    errors = 0.002 * np.tile([-1.0, -0.5, 0.0, 0.5, 1.0], 4)
    table = {"drop_height [m]": heights, "rebound_height [m]": 0.55 * heights + errors}
    fit = fitball.calibrate(table, point_only=True)
    result = fit.least_squares
    names = ("cor_10", "cor_slope", "drag")
    best = np.array([result.values[name] for name in names])
    slopes = np.transpose(
        [
            speeds_of_heights(heights, *(best + step)) - speeds_of_heights(heights, *(best - step))
            for step in 1e-5 * np.eye(3)
        ]
    )
    design = slopes / 2e-5
    measured = air.launch_speed(0.55 * heights + errors, 0.55 * air.braking_per_drag(Ball(), {}))
    residual = measured - speeds_of_heights(heights, *best)
    # The drag is between stated and measured: two to three parameters are the measurements'.
    noise = np.sqrt(residual @ residual / 17.5)
    information = design.T @ design / noise**2 + np.diag([0.0, 0.0, 0.08**-2])
    expected = np.sqrt(np.diag(np.linalg.inv(information)))
    assert_near([result.stderr[name] for name in names], expected, 0.02)
    assert 0.05 < result.stderr["drag"] < 0.08


def test_no_error_on_a_bound_or_where_nothing_changes():
    prior = {"mu": "uniform(0.1, 0.5)"}
    bound = fit_of(
        problem_of(
            table_of(REBOUND),
            scene_of(),
            prior=prior,
        )
    )
    assert_near(bound.values["mu"], 0.5)
    assert bound.stderr["mu"] is None
    fixed = fit_of(
        problem_of(
            table_of(REBOUND),
            scene_of(),
            fix={"mu": 0.5},
        )
    )
    for name in ("e_x", "offset", "cor_10", "cor_slope"):
        assert_near(bound.stderr[name], fixed.stderr[name], 1e-3)
    # Fewer measurements than parameters.
    few = fit_of(
        problem_of(
            table_of(REBOUND, count=2),
            scene_of(),
            "two-mass",
        )
    )
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
    fit = fitball.calibrate(
        film.table,
        model="brody",
        point_only=True,
    )
    # On some machines the last step ends at zero itself.
    assert_within(fit.least_squares.values["mu"], 0.0, 1e-9)
    assert fit.least_squares.stderr["mu"] is None


def test_beside_zero_friction_has_ended_though_its_coordinate_is_far_from_an_end():
    """Where the last step of lmfit ends beside zero is a matter of a machine's digits."""
    problem = problem_of(table_of(REBOUND), scene_of(), "grip-slip")
    best = truth_of(problem)
    parameters = lmfit.Parameters()
    for name in problem.free:
        parameters.add(name, value=best[name])
    for value, ended in ((1e-9, ["mu"]), (1e-3, [])):
        parameters["mu"].set(value=value, min=0.0)
        assert search._ended_at_zero(problem, best, parameters, ()) == ended
    parameters["mu"].set(value=1e-9)
    assert search._ended_at_zero(problem, best, parameters, {"mu"}) == []
