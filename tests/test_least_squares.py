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

from fitball.inference.density import cells
from fitball.inference.search import least_squares as search
from fitball.inference.search.best_fit import best_fit
from fitball.inference.search.least_squares import least_squares, minimized


def fitted(problem):
    return least_squares(problem, best_fit(problem, np.random.default_rng(0)))


@pytest.mark.parametrize("noise", [SD, 5.0 * SD])
def test_a_straight_line_as_curve_fit_has_it(noise):
    problem = line_problem(noise=noise)
    found = fitted(problem)
    x = problem.rows.states.v_x1
    y = problem.rows.y[:, 0]
    best, covariance = curve_fit(
        lambda x, a, b: a * x + b,
        x,
        y,
        sigma=np.full(x.size, noise),
        absolute_sigma=False,
    )
    for k, name in enumerate(("slope", "shift")):
        assert found.values[name] == pytest.approx(best[k], rel=1e-6)
        # Whatever noise was expected: they follow from how the measurements scatter.
        assert found.stderr[name] == pytest.approx(np.sqrt(covariance[k, k]), rel=1e-4)
    square = np.sum(((y - best[0] * x - best[1]) / noise) ** 2)
    assert found.chi_square == pytest.approx(square, rel=1e-9)
    assert found.degrees_of_freedom == x.size - 2
    assert found.aic == pytest.approx(x.size * np.log(square / x.size) + 4.0, rel=1e-9)
    assert found.stderr["v_x_sd"] is None
    assert found.missing["v_x_sd"].startswith("fixed")


def test_the_noise_is_taken_as_expected():
    problem = line_problem(noise=0.0)
    found = fitted(problem)
    assert found.values["v_x_sd"] == pytest.approx(0.25, rel=1e-6)
    assert found.stderr["v_x_sd"] is None
    assert found.chi_square == pytest.approx(fitted(line_problem(noise=0.25)).chi_square, rel=1e-6)


def test_lmfit_itself_is_at_hand():
    table = table_of(REBOUND, labels=("surface",), count=14)
    problem = problem_of(table, scene_of(), pool={"mu": "surface"})
    point = best_fit(problem, np.random.default_rng(0))
    found = minimized(problem, point)
    known = least_squares(problem, point)
    assert isinstance(found, lmfit.minimizer.MinimizerResult)
    assert "mu_a_" in lmfit.fit_report(found)
    assert found.redchi == found.chisqr / found.nfree
    assert found.params["mu_a_"].stderr == known.stderr["mu[a]"] > 0.0
    assert known.degrees_of_freedom == 14 * 3 - 7


def test_slopes_are_those_of_the_residuals():
    problem = problem_of(table_of(REBOUND, "corr"), scene_of(time=True, ball=True), "two-mass")
    values = truth_of(problem)
    q = problem.coordinates(values)
    width = problem.prior.width

    def at(row):
        return search._linear(
            problem,
            {name: v[0] for name, v in problem.values(row[None]).items()},
        )[0]

    wanted = approx_fprime(q, at, 1e-7 * width)
    found = search._linear(problem, values)[1]
    assert found.shape == (10 * 3 + 1 + 2, q.size)
    assert_allclose(found * width, wanted * width, atol=1e-4)
    assert np.all(np.abs(found[-3:] * width).max(axis=1) > 0.1)


def test_what_the_scene_measured_counts():
    ball = problem_of(table_of(REBOUND), scene_of(ball=True))
    found = fitted(ball)
    z = 0.0
    for name, stated, sd in (("ball_mass", 0.0577, 2e-4), ("inertia_ratio", 0.56, 0.01)):
        z += ((found.values[name] - stated) / sd) ** 2
        assert found.stderr[name] < 3.0 * sd
    own = cells(ball, ball.coordinates(found.values)[None]).z
    assert found.chi_square == pytest.approx(np.sum(own**2) + z, rel=1e-9)
    assert found.degrees_of_freedom == 30 + 2 - 7


def test_no_error_on_a_bound_or_where_nothing_changes():
    bound = fitted(problem_of(table_of(REBOUND), scene_of(), prior={"mu": "uniform(0.1, 0.5)"}))
    assert bound.values["mu"] == pytest.approx(0.5)
    assert bound.stderr["mu"] is None
    held = fitted(problem_of(table_of(REBOUND), scene_of(), fix={"mu": 0.5}))
    for name in ("e_x", "offset", "cor_10", "cor_slope"):
        assert bound.stderr[name] == pytest.approx(held.stderr[name], rel=1e-3)
    # Fewer measurements than parameters.
    few = fitted(problem_of(table_of(REBOUND, count=2), scene_of(), "two-mass"))
    assert few.degrees_of_freedom < 0
    assert {*few.missing} >= {"mass_ratio", "k_y", "k_theta"}
    # Friction where all impacts grip.
    table = table_of(REBOUND)
    table.values["v_x1"][:] *= 0.2
    table.values["v_x2"][:] *= 0.2
    table.values["omega_1"][:] = table.values["omega_2"][:] = 0.0
    grip = fitted(problem_of(table, scene_of()))
    assert grip.stderr["mu"] is None
    assert grip.stderr["cor_10"] > 0.0
    assert {*grip.missing} == {"mu", "v_x_sd", "v_y_sd", "spin_sd"}
