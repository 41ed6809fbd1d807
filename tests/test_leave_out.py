"""Scores of one model on impacts it has not seen, against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from samples import drop_table, linear_problem, problem_of
from scipy.stats import norm

from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.errors import FitError
from fitball.inference.calibrate import run
from fitball.inference.comparison.left_out import (
    IMPACTS,
    leave_one_out,
    leave_out,
    make_folds,
    refitted_elpd,
    smoothed_elpd,
)
from fitball.inference.comparison.results import criteria
from fitball.inference.effort import Effort
from fitball.inference.likelihood.posterior import impact_terms, log_posterior, pointwise
from fitball.inference.point.point_fit import point_fit
from fitball.inference.prediction.outputs import measured_outputs, output_errors, root_mean_square
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.subsample import thinned_problem, withheld


def point_of(problem, seed=1):
    return point_fit(problem, np.random.default_rng(seed))[1]


# --- leave-one-out densities


def conjugate(rng, count, draws):
    """`y` and `z` (count,) with mean theta and unit variance, and draws of theta given both; prior N(0, 4)."""
    y, z = rng.standard_normal((2, count)) + 1.3
    precision = 0.25 + 2 * count
    theta = rng.normal((y.sum() + z.sum()) / precision, precision**-0.5, draws)
    return y, z, theta


def test_smoothed_loo_is_the_analytic_density_of_a_conjugate_normal():
    y, z, theta = conjugate(np.random.default_rng(4), 12, 20000)
    terms = [norm.logpdf(column[None, :], theta[:, None], 1.0) for column in (y, z)]
    whole = terms[0] + terms[1]
    # Without impact i: theta ~ N(m, v); then y_i ~ N(m, 1 + v) and (y_i, z_i) jointly normal.
    v = 1.0 / (0.25 + 2 * 11)
    m = v * (y.sum() - y + z.sum() - z)
    both = [np.log(np.linalg.det(2 * np.pi * (np.eye(2) + v))) for _ in range(12)]
    gaps = np.stack([y - m, z - m], axis=1)
    quadratic = np.einsum("ij,jk,ik->i", gaps, np.linalg.inv(np.eye(2) + v), gaps)
    elpd, k = smoothed_elpd(whole, whole, 1.0)
    np.testing.assert_allclose(elpd, -0.5 * (np.array(both) + quadratic), atol=0.02)
    assert np.all(k < 0.7)
    # A part of an impact scored, the whole of it left out.
    elpd, _ = smoothed_elpd(whole, terms[0], 1.0)
    np.testing.assert_allclose(elpd, norm.logpdf(y, m, np.sqrt(1.0 + v)), atol=0.02)


def test_withheld_takes_away_the_likelihood_of_those_rows_and_nothing_else():
    problem = problem_of("wang_zero_spin.csv")
    point = point_of(problem)
    top = problem.to_coordinates(np.array([[point.values[name] for name in problem.free_names]]))
    rng = np.random.default_rng(3)
    coordinates = top + 0.02 * problem.prior.width * rng.standard_normal((40, problem.dimension))
    coordinates = coordinates[np.isfinite(log_posterior(problem, coordinates))]
    assert len(coordinates) > 5
    rows = np.array([1, 5])
    held = withheld(problem, rows)
    values = problem.to_values(coordinates)
    terms = impact_terms(problem, values, problem.rebound(values))
    lost = sum(term[:, rows].sum(axis=1) for term in terms.values())
    np.testing.assert_allclose(
        log_posterior(held, coordinates), log_posterior(problem, coordinates) - lost, rtol=1e-11
    )
    again = withheld(held, np.array([0]))
    assert again.observables[0].rows.tolist() == [2, 3, 4, 6]


def test_thinning_keeps_withheld_rows_apart():
    problem = problem_of("wang_all.csv", model="brody")
    held = thinned_problem(withheld(problem, np.array([0, 4, 9])), 10)
    for observable, whole in zip(held.observables, problem.observables, strict=True):
        kept = [held.table.ids[k] for k in observable.rows]
        expected = [whole.observed[problem.table.ids.index(name)] for name in kept]
        np.testing.assert_array_equal(observable.observed, expected)
        assert not {problem.table.ids[k] for k in (0, 4, 9)} & set(kept)


def test_withholding_everything_is_refused():
    problem = problem_of("wang_zero_spin.csv", model="brody")
    with pytest.raises(FitError, match="no measurement is left"):
        withheld(problem, np.arange(7))


def scored_by(problem, columns):
    effort = Effort(seed=2, ess=400.0)
    fit = run(problem, effort)
    settings = replace(effort, seed=9, ensembles=2).settings(problem)
    return fit, settings, leave_one_out(problem, fit, fit.posterior, columns, settings, exact=False)


def test_refits_and_smoothed_importance_sampling_agree_where_k_is_good(monkeypatch):
    problem = problem_of("wang_zero_spin.csv", model="brody")
    columns = ("v_x2", "v_y2", "omega_2")
    fit, settings, found = scored_by(problem, columns)
    assert not found.refitted
    # Which impacts are the steadiest, and how steady, is up to the draws.
    best = np.argsort(found.pareto_k)[:2].tolist()
    assert np.all(found.pareto_k[best] < 0.5)
    # Effective parameters: some, but no more than there are.
    assert 1.0 < found.p_loo < 5.0
    # Were these not to be trusted: by proposals of their own, and where those fail by a chain.
    monkeypatch.setattr("fitball.inference.comparison.left_out.K_TRUSTED", 0.5)
    monkeypatch.setattr(
        "fitball.inference.comparison.left_out.smoothed_elpd",
        lambda *_args: (found.elpd.copy(), np.where(np.isin(np.arange(7), best), 0.9, 0.1)),
    )
    again = leave_one_out(problem, fit, fit.posterior, columns, settings, exact=True)
    assert sorted(again.refitted) == sorted(best)
    assert not again.unsettled
    np.testing.assert_allclose(again.elpd[best], found.elpd[best], atol=0.1)
    monkeypatch.setattr("fitball.inference.sampling.importance.MEETING", np.inf)
    row = again.refitted[0]
    optimum = problem.to_coordinates(np.array([[fit.point.values[name] for name in problem.free_names]]))[0]
    draws = fit.posterior.draws
    likelihood = pointwise(problem, draws, columns)[0][:, row]
    chain, settled = refitted_elpd(problem, draws, likelihood, optimum, row, columns, settings)
    assert settled
    assert chain == pytest.approx(found.elpd[row], abs=0.1)
    assert chain != again.elpd[row]


def test_an_influential_impact_is_scored_as_the_conjugate_normal_has_it():
    """A far outlier of a drop test: its draws are none of those of the posterior that it took part in."""
    table = drop_table(np.random.default_rng(6))
    measured = table.measurement("v_y2")
    values = measured.values.copy()
    values[4] += 0.6
    table = replace(table, measurements=(replace(measured, values=values),))
    problem = linear_problem(table, velocity_sd=0.05)
    fit, settings, found = scored_by(problem, ("v_y2",))
    assert found.pareto_k[4] > 0.7
    again = leave_one_out(problem, fit, fit.posterior, ("v_y2",), settings, exact=True)
    x, y = design(table)
    kept = np.arange(len(y)) != 4
    covariance = 0.05**2 * np.linalg.inv(x[kept].T @ x[kept])
    mean = x[4] @ np.linalg.lstsq(x[kept], y[kept], rcond=None)[0]
    exact = norm.logpdf(y[4], mean, np.sqrt(0.05**2 + x[4] @ covariance @ x[4]))
    assert 4 in again.refitted
    assert again.elpd[4] == pytest.approx(exact, abs=0.3)


# --- errors of left-out impacts


def design(table):
    speed = table.impacts.v_y1
    return np.stack([speed, speed * (speed - 10.0)], axis=1), table.measurement("v_y2").values


def test_left_out_errors_of_a_linear_model_are_those_of_the_hat_matrix():
    table = drop_table(np.random.default_rng(6))
    problem = linear_problem(table, velocity_sd=0.05)
    folds, _ = make_folds(table, np.random.default_rng(0))
    missed, notes = leave_out(problem, point_of(problem), folds, (), np.random.default_rng(1))
    assert not notes
    x, y = design(table)
    hat = x @ np.linalg.inv(x.T @ x) @ x.T
    press = -(y - hat @ y) / (1.0 - np.diag(hat))
    errors = next(item for item in missed if item.scheme == IMPACTS).errors["v_y2"]
    np.testing.assert_allclose(errors, press, atol=2e-5)
    # Several rows at once: (1 - H_SS)^-1 e_S.
    fast = next(item for item in missed if item.scheme == "fastest third")
    block = np.ix_(fast.rows, fast.rows)
    together = -np.linalg.solve(np.eye(3) - hat[block], (y - hat @ y)[fast.rows])
    np.testing.assert_allclose(fast.errors["v_y2"], together, atol=2e-4)


def test_grip_slip_on_wang_left_out_one_by_one():
    """An earlier, independent sketch by least squares with I/(M R^2) = 0.55 left 0.55 m/s and 17.7 rad/s in spin."""
    known = load_scene("wang_all.csv")
    ball = replace(known.ball, inertia=0.55 * known.ball.mass * known.ball.radius**2)
    scene = replace(known, ball=ball, velocity_sd=0.25, spin_sd=10.0, mu=None)
    flat = {"e_x": "uniform(-1, 1)", "offset": "uniform(-0.033, 0.033)", "cor_10": "uniform(0, 1)",
            "cor_slope": "uniform(-0.1, 0.1)", "mu": "uniform(0, 5)"}  # fmt: skip
    table = load_table("wang_all.csv")
    problem = build_problem(table, scene, Choices(model="grip-slip", priors=flat))
    folds = [fold for fold in make_folds(table, np.random.default_rng(0))[0] if fold.scheme == IMPACTS]
    missed, _ = leave_out(problem, point_of(problem), folds, (), np.random.default_rng(1))
    rms = {name: root_mean_square(column) for name, column in missed[0].errors.items()}
    assert rms["v_x2"] == pytest.approx(0.55, abs=0.005)
    assert rms["omega_2"] == pytest.approx(17.7, abs=0.05)


def test_angles_differ_by_the_short_way_round():
    near = output_errors({"theta_2": np.array([3.1, 0.2])}, {"theta_2": np.array([-3.1, 0.1])})
    np.testing.assert_allclose(near["theta_2"], [2 * np.pi - 6.2, -0.1])


def test_outputs_follow_from_speed_and_angle():
    table = load_table("wang_zero_spin.csv")
    polar = replace(table, measurements=table.redundant)
    found = measured_outputs(polar)
    np.testing.assert_allclose(np.hypot(found["v_x2"], found["v_y2"]), found["v_2"])
    assert "theta_2" in measured_outputs(table)


# --- weights


def test_criteria_of_a_linear_model_are_those_of_its_residuals():
    table = drop_table(np.random.default_rng(7))
    problem = linear_problem(table)
    found = criteria(problem, [point_of(problem).values])
    x, y = design(table)
    residual = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    log_likelihood = norm.logpdf(residual, 0.0, np.sqrt(np.mean(residual**2))).sum()
    assert found.log_likelihood == pytest.approx(log_likelihood, abs=1e-5)
    assert (found.parameters, found.measurements) == (3, 9)
    assert found.aicc == pytest.approx(-2 * log_likelihood + 6 + 24 / 5, abs=1e-4)
    assert found.bic == pytest.approx(-2 * log_likelihood + 3 * np.log(9), abs=1e-4)
    assert replace(found, measurements=4).aicc is None


def test_the_maximised_likelihood_is_no_less_than_that_of_the_posterior_maximum():
    problem = problem_of("wang_all.csv", closures={"offset": "grip"})
    point = point_of(problem)
    found = criteria(problem, point.optima[:2])
    assert point.log_likelihood <= found.log_likelihood < point.log_likelihood + 1.0


def test_large_tables_are_left_out_in_folds():
    table = load_table("wang_all.csv")
    count = 63
    rows = np.arange(count) % 21
    large = replace(
        table,
        impacts=type(table.impacts)(*(getattr(table.impacts, name)[rows] for name in ("v_x1", "v_y1", "omega_1"))),
        ids=tuple(map(str, range(count))),
        labels={},
    )
    folds, notes = make_folds(large, np.random.default_rng(0))
    mine = [fold for fold in folds if fold.scheme == IMPACTS]
    assert len(mine) == 20
    assert sorted(np.concatenate([fold.rows for fold in mine])) == list(range(count))
    assert any("20 random folds" in note for note in notes)


@pytest.mark.parametrize("higher", [0, 5])
def test_drops_from_one_height_have_no_slowest_third(higher):
    table = drop_table(np.random.default_rng(1), count=18)
    speeds = np.where(np.arange(18) < higher, 9.0, 7.06)
    table = replace(table, impacts=type(table.impacts)(0.0 * speeds, speeds, 0.0 * speeds))
    folds, notes = make_folds(table, np.random.default_rng(0))
    assert {fold.scheme for fold in folds} == {IMPACTS}
    assert any("have the same speed" in note for note in notes)


# --- published sets
