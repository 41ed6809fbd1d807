"""The density of a problem against one written out in scipy, over all its forms."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy import stats
from support.density import (
    REBOUND,
    TIMED,
    covariance_of,
    log_posterior,
    near,
    problem_of,
    scene_of,
    seen_by,
    table_of,
    truth_of,
)

from fitball.inference import density
from fitball.inference.density import cells, factors, log_likelihood, pointwise, slopes, terms
from fitball.inference.problem import row_errors

FORMS = list(
    product(
        ("normal", "student-t"),
        (False, True),
        ("", "sd", "corr"),
        (False, True),
        (False, True),
        (False, True),
    )
)


def form(noise, gaps, errors, camera, levels, timed):
    labels = (*(("surface",) if levels else ()), *(("session",) if camera and levels else ()))
    table = table_of(TIMED if timed else REBOUND, errors, gaps, labels)
    scene = scene_of(camera, timed, ball=levels and not camera)
    return problem_of(table, scene, "two-mass" if timed else "grip-slip", noise=noise)


def named(problem, q):
    return {name: float(array[0]) for name, array in problem.values(q[None]).items()}


@pytest.mark.parametrize("of", FORMS, ids=lambda of: "-".join(map(str, of)))
def test_the_posterior_is_that_of_scipy(of):
    problem = form(*of)
    assert bool(problem.forward.levels) is of[4]
    assert (problem.rows.errors is not None) is (of[2] == "corr")
    q = np.vstack([near(problem, 1), problem.prior.draw(np.random.default_rng(3), 1)])
    exact = [log_posterior(problem, named(problem, row)) for row in q]
    np.testing.assert_allclose(density.log_posterior(problem, q), exact, rtol=1e-10, atol=1e-8)
    assert np.isfinite(exact[0])


def test_every_part_of_it_matters():
    problem = form("normal", True, "corr", True, True, True)
    at = truth_of(problem)
    whole = log_posterior(problem, at)
    assert density.log_posterior(problem, problem.coordinates(at)[None])[0] == pytest.approx(
        whole,
        rel=1e-10,
    )
    for part in ("priors", "levels", "camera", "errors", "correlations", "contact time"):
        assert abs(log_posterior(problem, at, (part,)) - whole) > 1e-2, part


@pytest.mark.parametrize("errors", ["sd", "corr"])
def test_stated_errors_alone_where_scatter_is_held_at_nothing(errors):
    problem = problem_of(table_of(REBOUND, errors), scene_of(), fix={"v_x_sd": 0.0, "spin_sd": 0.0})
    q = near(problem, 2)
    exact = [log_posterior(problem, named(problem, row)) for row in q]
    np.testing.assert_allclose(density.log_posterior(problem, q), exact, rtol=1e-9)


def test_errors_of_a_long_table_are_made_in_parts(monkeypatch):
    table = table_of(TIMED, "corr", gaps=True)
    whole = row_errors.row_errors(table, TIMED)
    monkeypatch.setattr(row_errors, "PART", 3)
    for one, other in zip(whole, row_errors.row_errors(table, TIMED), strict=True):
        np.testing.assert_array_equal(one, other)
    assert row_errors.row_errors(replace(table, sd={}, corr={}), TIMED) is None


def test_speeds_and_angles_have_noises_of_their_own():
    table = table_of(("v_2", "theta_2", "omega_2"))
    problem = problem_of(table, scene_of())
    assert [item.noise for item in problem.observables] == ["speed_sd", "angle_sd", "spin_sd"]
    q = near(problem)
    exact = [log_posterior(problem, named(problem, row)) for row in q]
    np.testing.assert_allclose(density.log_posterior(problem, q), exact, rtol=1e-10)


def test_outside_the_bounds_and_without_a_number_there_is_no_density():
    problem = problem_of(table_of(REBOUND), scene_of())
    good = problem.coordinates(truth_of(problem))
    prior = problem.prior
    trials = np.tile(good, (3 * good.size + 1, 1))
    for k in range(good.size):
        trials[3 * k : 3 * k + 3, k] = (
            prior.low[k] - 1e-9,
            prior.high[k] + 1e-9 * abs(prior.high[k]),
            np.nan,
        )
    scores = density.log_posterior(problem, trials)
    assert np.isfinite(scores[-1])
    np.testing.assert_array_equal(scores[:-1], -np.inf)


def test_a_draw_without_an_answer_has_no_density():
    problem = problem_of(table_of(TIMED), scene_of(time=True), "two-mass")
    # COR above the mass ratio: the core would return faster than it came.
    q = problem.coordinates({**truth_of(problem), "mass_ratio": 0.6})[None]
    assert np.isfinite(problem.prior.log_density(q))[0]
    assert density.log_posterior(problem, q)[0] == -np.inf
    # Withheld measurements leave the impact, which must be possible still.
    assert density.log_posterior(problem.without(np.arange(10)), q)[0] == -np.inf


@pytest.mark.parametrize("errors", ["sd", "corr"])
def test_parts_of_a_long_table_and_other_draws_change_nothing(errors, monkeypatch):
    problem = form("student-t", True, errors, True, True, True)
    q = near(problem, 7)
    whole = density.log_posterior(problem, q)
    alone = [density.log_posterior(problem, row[None])[0] for row in q]
    np.testing.assert_allclose(alone, whole, rtol=1e-13)
    points = pointwise(problem, q, TIMED)
    monkeypatch.setattr(density, "AT_ONCE", 50)
    assert len(list(density.parts(problem, 7))) > 1
    np.testing.assert_allclose(density.log_posterior(problem, q), whole, rtol=1e-13)
    np.testing.assert_array_equal(pointwise(problem, q, TIMED), points)
    np.testing.assert_allclose(points.sum(axis=1), log_likelihood(problem, q)[0], rtol=1e-12)


def test_some_columns_of_an_impact_whatever_the_others():
    problem = form("normal", False, "corr", False, False, False)
    q = near(problem, 1)
    some = [0, 2]
    made = cells(problem, q)
    found = pointwise(problem, q, ("v_x2", "omega_2"))
    factor = factors(problem, q)[0]
    whole = factor @ factor.swapaxes(1, 2)
    exact = [
        stats.multivariate_normal(made.mean[0, k, some], whole[k][np.ix_(some, some)]).logpdf(
            problem.rows.y[k, some]
        )
        for k in range(10)
    ]
    np.testing.assert_allclose(found[0], exact, rtol=1e-10)
    # Given v_y2 it is another density.
    given = terms(problem, made, problem.values(q))[0][:, some].sum(axis=1)
    assert np.abs(given - exact).max() > 1e-3


def test_withheld_and_chosen_impacts():
    problem = form("normal", True, "corr", True, True, True)
    q = near(problem, 2)
    rows = np.array([3, 7])
    points = pointwise(problem, q, TIMED)
    np.testing.assert_array_equal(pointwise(problem.take(rows), q, TIMED), points[:, rows])
    assert problem.take(rows).table.labels["id"] == ("4", "8")
    points[:, rows] = 0.0
    np.testing.assert_array_equal(pointwise(problem.without(rows), q, TIMED), points)


def integrated(problem, values, k, sign=1.0):
    """Log likelihood of the k-th impact by Gauss-Hermite quadrature over its true state."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(10)
    stated = covariance_of(problem.table, REBOUND, k)
    u = stated[:3, :3]
    across = stated[3:, :3]
    own = stated[3:, 3:]
    follows = sign * across @ np.linalg.inv(u)
    root = np.linalg.cholesky(u)
    scatter = np.diag([values[name] ** 2 for name in ("v_x_sd", "v_y_sd", "spin_sd")])
    grid = np.stack(np.meshgrid(nodes, nodes, nodes), axis=-1).reshape(-1, 3)
    share = (
        np.stack(np.meshgrid(weights, weights, weights), axis=-1).reshape(-1, 3).prod(axis=1)
        / weights.sum() ** 3
    )
    read = np.array([problem.table.values[name][k] for name in ("v_x1", "v_y1", "omega_1")])
    gaps = []
    for t in grid @ root.T:
        made = seen_by(problem, values, k, read + t)
        gaps.append([problem.table.values[name][k] - made[name] for name in REBOUND] + follows @ t)
    rest = stats.multivariate_normal(
        np.zeros(3),
        own - across @ np.linalg.inv(u) @ across.T + scatter,
    )
    return np.log(share @ rest.pdf(np.array(gaps)))


def test_sigma_points_against_the_integral_over_true_states():
    problem = problem_of(table_of(REBOUND, "corr", count=4), scene_of())
    at = truth_of(problem) | {"v_x_sd": 0.05, "v_y_sd": 0.05, "spin_sd": 3.0}
    found = pointwise(problem, problem.coordinates(at)[None], REBOUND)[0]
    exact, turned = (
        np.array([integrated(problem, at, k, sign) for k in range(4)]) for sign in (1.0, -1.0)
    )
    np.testing.assert_allclose(found, exact, atol=0.03)
    assert np.abs(found - turned).max() > 0.3


@pytest.mark.parametrize("errors", ["sd", "corr"])
def test_slopes_are_those_of_the_density(errors):
    problem = form("normal", True, errors, True, True, True)
    q = problem.coordinates(truth_of(problem))
    made, rate = slopes(problem, q[None])
    np.testing.assert_allclose(made.z, cells(problem, q[None]).z, rtol=1e-13)
    value, sd = problem.contact_time
    found = -np.einsum("ic,kic->k", made.z[0], rate.z[0]) - rate.log_sd[0].sum(axis=(1, 2))
    found -= (made.time[0] - value) / sd**2 * rate.time[0] + problem.prior.pull(q[None])[0][0]
    # Of the density itself by differences of the fourth order.
    for k, width in enumerate(problem.prior.width):
        step = 1e-4 * width * np.eye(q.size)[k]
        ends = density.log_posterior(problem, q + np.outer((-2, -1, 1, 2), step))
        exact = (ends[0] - 8.0 * ends[1] + 8.0 * ends[2] - ends[3]) / 12e-4
        assert found[k] * width == pytest.approx(exact, rel=1e-4, abs=1e-3), problem.free[k]


def test_a_slope_at_a_bound_is_one_sided():
    problem = problem_of(table_of(REBOUND), scene_of())
    q = problem.coordinates(truth_of(problem) | {"e_x": 1.0})
    made, rate = slopes(problem, q[None])
    k = problem.free.index("e_x")
    assert problem.prior.high[k] == q[k]
    back = q - 1e-5 * problem.prior.width * np.eye(q.size)[k]
    exact = (made.z[0] - cells(problem, back[None]).z[0]) / (1e-5 * problem.prior.width[k])
    np.testing.assert_allclose(rate.z[0, k], exact, rtol=1e-9)
    assert np.abs(exact).max() > 1.0
