"""The density of a problem against one written out in scipy, over all its forms."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from support.density import (
    INCIDENT,
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
from fitball.inference.density import (
    cell_factors,
    cell_log_density,
    cell_slopes,
    cells,
    log_likelihood,
    pointwise,
)
from fitball.inference.forward import ForwardModel
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
    """A problem of a table of this form; sessions only where a camera and levels are."""
    labels = []
    if levels:
        labels.append("surface")
        if camera:
            labels.append("session")
    columns = TIMED if timed else REBOUND
    text = "two-mass" if timed else "grip-slip"
    table = table_of(columns, errors, gaps, labels)
    scene = scene_of(camera, timed, ball=levels and not camera)
    return problem_of(table, scene, text, noise=noise)


def all_at_once(noise, errors):
    """A form with gaps, a camera, levels and times."""
    return form(
        noise,
        gaps=True,
        errors=errors,
        camera=True,
        levels=True,
        timed=True,
    )


def written_out(problem, q):
    """The log posterior by scipy at coordinates (draws, free)."""
    scores = []
    for row in q:
        arrays = problem.values(row[None])
        values = {name: float(array[0]) for name, array in arrays.items()}
        scores.append(log_posterior(problem, values))
    return scores


def words_of(words):
    """The name of a form."""
    return "-".join(map(str, words))


@pytest.mark.parametrize("form_of", FORMS, ids=words_of)
def test_the_posterior_is_that_of_scipy(form_of):
    _, _, errors, _, levels, _ = form_of
    problem = form(*form_of)
    assert bool(problem.forward.levels) is levels
    assert (problem.rows.errors is not None) is (errors == "corr")
    rng = np.random.default_rng(3)
    of_prior = problem.prior.draw(rng, 1)
    q = np.vstack([near(problem, 1), of_prior])
    scores = density.log_posterior(problem, q)
    exact = written_out(problem, q)
    assert_allclose(scores, exact, rtol=1e-10, atol=1e-8)
    assert np.isfinite(exact[0])


def test_every_part_of_it_matters():
    problem = all_at_once("normal", "corr")
    truth = truth_of(problem)
    exact = log_posterior(problem, truth)
    q = problem.coordinates(truth)
    (score,) = density.log_posterior(problem, q[None])
    assert score == pytest.approx(exact, rel=1e-10)
    for omitted in ("priors", "levels", "camera", "errors", "correlations", "contact time"):
        incomplete = log_posterior(problem, truth, (omitted,))
        assert abs(incomplete - exact) > 1e-2, omitted


@pytest.mark.parametrize("errors", ["sd", "corr"])
def test_stated_errors_alone_where_scatter_is_held_at_nothing(errors):
    no_scatter = {"v_x_sd": 0.0, "spin_sd": 0.0}
    table = table_of(REBOUND, errors)
    problem = problem_of(table, scene_of(), fix=no_scatter)
    q = near(problem, 2)
    scores = density.log_posterior(problem, q)
    assert_allclose(scores, written_out(problem, q), rtol=1e-9)


def test_errors_of_a_long_table_are_made_in_parts(monkeypatch):
    table = table_of(TIMED, "corr", gaps=True)
    at_once = row_errors.row_errors(table, TIMED)
    monkeypatch.setattr(row_errors, "ROWS_AT_ONCE", 3)
    in_parts = row_errors.row_errors(table, TIMED)
    for array, other in zip(at_once, in_parts, strict=True):
        assert_array_equal(array, other)
    exact_table = replace(table, sd={}, corr={})
    assert row_errors.row_errors(exact_table, TIMED) is None


def test_speeds_and_angles_have_noises_of_their_own():
    table = table_of(("v_2", "theta_2", "omega_2"))
    problem = problem_of(table, scene_of())
    noises = [observable.noise for observable in problem.observables]
    assert noises == ["speed_sd", "angle_sd", "spin_sd"]
    q = near(problem)
    scores = density.log_posterior(problem, q)
    assert_allclose(scores, written_out(problem, q), rtol=1e-10)


def test_outside_the_bounds_and_without_a_number_there_is_no_density():
    problem = problem_of(table_of(REBOUND), scene_of())
    good = problem.coordinates(truth_of(problem))
    prior = problem.prior
    trials = [good]
    for k in range(good.size):
        low = prior.low[k]
        high = prior.high[k]
        below = low - 1e-9
        above = high + 1e-9 * abs(high)
        for value in (below, above, np.nan):
            trial = good.copy()
            trial[k] = value
            trials.append(trial)
    scores = density.log_posterior(problem, np.array(trials))
    assert np.isfinite(scores[0])
    assert_array_equal(scores[1:], -np.inf)


def test_a_draw_without_an_answer_has_no_density():
    problem = problem_of(table_of(TIMED), scene_of(time=True), "two-mass")
    # COR above the mass ratio: the core would return faster than it came.
    values = {**truth_of(problem), "mass_ratio": 0.6}
    q = problem.coordinates(values)[None]
    assert np.isfinite(problem.prior.log_density(q))[0]
    assert density.log_posterior(problem, q)[0] == -np.inf
    # Withheld measurements leave the impact, which must be possible still.
    withheld = problem.without_rows(np.arange(10))
    assert density.log_posterior(withheld, q)[0] == -np.inf


@pytest.mark.parametrize("errors", ["sd", "corr"])
def test_parts_of_a_long_table_and_other_draws_change_nothing(errors, monkeypatch):
    problem = all_at_once("student-t", errors)
    q = near(problem, 7)
    at_once = density.log_posterior(problem, q)
    alone = [density.log_posterior(problem, row[None])[0] for row in q]
    assert_allclose(alone, at_once, rtol=1e-13)
    points = pointwise(problem, q, TIMED)
    monkeypatch.setattr(density, "STATES_AT_ONCE", 50)
    assert len(list(density.row_blocks(problem, 7))) > 1
    in_parts = density.log_posterior(problem, q)
    assert_allclose(in_parts, at_once, rtol=1e-13)
    assert_array_equal(pointwise(problem, q, TIMED), points)
    likelihood = log_likelihood(problem, q)[0]
    assert_allclose(points.sum(axis=1), likelihood, rtol=1e-12)


def test_some_columns_of_an_impact_whatever_the_others():
    problem = form("normal", False, "corr", False, False, False)
    q = near(problem, 1)
    columns = [0, 2]
    answers = cells(problem, q)
    points = pointwise(problem, q, ("v_x2", "omega_2"))
    factor = cell_factors(problem, q)[0]
    covariances = factor @ factor.swapaxes(1, 2)
    exact = []
    for k in range(10):
        mean = answers.mean[0, k, columns]
        covariance = covariances[k][np.ix_(columns, columns)]
        law = stats.multivariate_normal(mean, covariance)
        measured = problem.rows.y[k, columns]
        exact.append(law.logpdf(measured))
    assert_allclose(points[0], exact, rtol=1e-10)
    # Given v_y2 it is another density.
    each = cell_log_density(problem, answers, problem.values(q))[0]
    conditional = each[:, columns].sum(axis=1)
    assert np.abs(conditional - exact).max() > 1e-3


def test_withheld_and_chosen_impacts():
    problem = all_at_once("normal", "corr")
    q = near(problem, 2)
    rows = np.array([3, 7])
    points = pointwise(problem, q, TIMED)
    chosen = problem.take(rows)
    assert_array_equal(pointwise(chosen, q, TIMED), points[:, rows])
    assert chosen.table.labels["id"] == ("4", "8")
    withheld = problem.without_rows(rows)
    points[:, rows] = 0.0
    assert_array_equal(pointwise(withheld, q, TIMED), points)


def integrated(problem, values, k, sign=1.0):
    """Log likelihood of the k-th impact by Gauss-Hermite quadrature over its true state."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(10)
    weights = weights / weights.sum()
    stated = covariance_of(problem.table, REBOUND, k)
    of_impact = stated[:3, :3]
    across = stated[3:, :3]
    regression = across @ np.linalg.inv(of_impact)
    root = np.linalg.cholesky(of_impact)
    columns = problem.table.values
    state = np.array([columns[name][k] for name in INCIDENT])
    rebound = np.array([columns[name][k] for name in REBOUND])
    shares = []
    deviations = []
    for of_point in product(range(10), repeat=3):
        shares.append(np.prod(weights[[*of_point]]))
        step = root @ nodes[[*of_point]]
        seen = seen_by(problem, values, k, state + step)
        mean = np.array([seen[name] for name in REBOUND])
        deviations.append(rebound - mean + sign * regression @ step)
    noises = ("v_x_sd", "v_y_sd", "spin_sd")
    scatter = np.diag([values[name] ** 2 for name in noises])
    of_rebound = stated[3:, 3:] - regression @ across.T
    law = stats.multivariate_normal(np.zeros(3), of_rebound + scatter)
    densities = law.pdf(np.array(deviations))
    return np.log(shares @ densities)


def test_sigma_points_against_the_integral_over_true_states():
    problem = problem_of(table_of(REBOUND, "corr", count=4), scene_of())
    values = truth_of(problem)
    values |= {"v_x_sd": 0.05, "v_y_sd": 0.05, "spin_sd": 3.0}
    q = problem.coordinates(values)
    points = pointwise(problem, q[None], REBOUND)[0]
    exact = [integrated(problem, values, k) for k in range(4)]
    assert_allclose(points, exact, atol=0.03)
    # Errors of impact and rebound that belong together the other way round are seen.
    turned = [integrated(problem, values, k, sign=-1.0) for k in range(4)]
    assert np.abs(points - turned).max() > 0.3


@pytest.mark.parametrize("errors", ["sd", "corr"])
def test_slopes_are_those_of_the_density(errors):
    problem = all_at_once("normal", errors)
    q = problem.coordinates(truth_of(problem))
    answers, rate = cell_slopes(problem, q[None])
    assert_allclose(answers.z, cells(problem, q[None]).z, rtol=1e-13)
    value, sd = problem.contact_time
    of_residuals = np.einsum("ic,kic->k", answers.z[0], rate.z[0])
    of_noise = rate.log_sd[0].sum(axis=(1, 2))
    of_time = (answers.time[0] - value) / sd**2 * rate.time[0]
    of_prior = problem.prior.pull(q[None])[0][0]
    gradient = -(of_residuals + of_noise + of_time + of_prior)
    # Of the density itself by differences of the fourth order.
    for k, width in enumerate(problem.prior.width):
        step = np.zeros(q.size)
        step[k] = 1e-4 * width
        places = q + np.outer((-2, -1, 1, 2), step)
        far_below, below, above, far_above = density.log_posterior(problem, places)
        exact = (far_below - 8.0 * below + 8.0 * above - far_above) / 12e-4
        slope = gradient[k] * width
        assert slope == pytest.approx(exact, rel=1e-4, abs=1e-3), problem.free[k]


@pytest.mark.parametrize("errors", ["", "sd"])
def test_slopes_with_noise_take_no_bounces(errors, monkeypatch):
    problem = all_at_once("student-t", errors)
    q = problem.coordinates(truth_of(problem))[None].repeat(3, axis=0)
    q[1:] += 0.1 * problem.prior.width
    rows = list[int]()
    bounced = ForwardModel.rebound

    def counted(forward, values, states, index):
        rows.append(len(values["k_y"]))
        return bounced(forward, values, states, index)

    monkeypatch.setattr(ForwardModel, "rebound", counted)
    cell_slopes(problem, q)
    moving = len(problem.free) - len(problem.noises)
    # The last two are the same: of these there are bounces once.
    assert sum(rows) == 2 * (1 + 2 * moving)


def test_a_slope_at_a_bound_is_one_sided():
    problem = problem_of(table_of(REBOUND), scene_of())
    q = problem.coordinates(truth_of(problem) | {"e_x": 1.0})
    answers, rate = cell_slopes(problem, q[None])
    k = problem.free.index("e_x")
    assert problem.prior.high[k] == q[k]
    step = 1e-5 * problem.prior.width[k]
    back = q.copy()
    back[k] -= step
    before = cells(problem, back[None])
    exact = (answers.z[0] - before.z[0]) / step
    assert_allclose(rate.z[0, k], exact, rtol=1e-9)
    assert np.abs(exact).max() > 1.0
