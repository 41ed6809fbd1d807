"""Errors of a row that belong together, those of the incident state with those of the rebound: the likelihood against
the joint normal and against an integral over true states, near a kink too; what is fitted and drawn with them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from samples import problem_of
from scipy import stats

import fitball
from fitball.bench.problems import BASE
from fitball.data.read import load_table
from fitball.data.scene import Scene
from fitball.data.table import Covariance
from fitball.errors import FitError
from fitball.inference.likelihood import regime_mixture
from fitball.inference.likelihood.cells import cells_of
from fitball.inference.likelihood.posterior import impact_terms, log_likelihood, pointwise
from fitball.inference.prediction.new_impacts import observed_observables, predict_new
from fitball.inference.prediction.posterior_predictive import replicated
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.inference.problem.row_errors import errors_from
from fitball.inference.problem.subsample import part_of
from fitball.values import Impacts

TRUTH = {**BASE, "e_x": 0.1, "offset": 0.0, "v_x_sd": 0.11, "v_y_sd": 0.17, "spin_sd": 4.0, "velocity_sd": 0.14}
COLUMNS = ("v_x1", "v_y1", "omega_1", "v_x2", "v_y2", "omega_2")
SDS = np.array([0.2, 0.2, 4.0, 0.2, 0.2, 6.0])


def covariances(count, seed=5, sds=SDS):
    """Of every row another, with correlations of any sign between all columns."""
    rng = np.random.default_rng(seed)
    factor = rng.standard_normal((count, 6, 7))
    made = factor @ factor.transpose(0, 2, 1)
    unit = np.sqrt(np.diagonal(made, axis1=1, axis2=2))
    return made / (unit[:, :, None] * unit[:, None, :]) * np.outer(sds, sds)


def rebounds(model, values, seen, moves):
    made = model.evaluate(model.parameter_names, values, Impacts(*(np.asarray(one) for one in (seen + moves).T)))
    return np.stack([made.v_x2[0], made.v_y2[0], made.omega_2[0]], axis=1), made.regime[0]


def states(count, seed, low=16.0, high=65.0):
    rng = np.random.default_rng(seed)
    theta, speed = np.radians(np.linspace(low, high, count)), rng.uniform(14.0, 22.0, count)
    return np.stack([speed * np.cos(theta), speed * np.sin(theta), rng.uniform(-100.0, 150.0, count)], axis=1)


def table_of(values, seed, seen, scatter=(0.11, 0.17, 4.0), covariance=True, **truth):
    """A table whose rows are read with errors of covariance `values` (rows, 6, 6), of balls that `scatter`."""
    rng, model = np.random.default_rng(seed), fitball.model("grip-slip")
    count = len(seen)
    errors = np.stack([rng.multivariate_normal(np.zeros(6), one) for one in values])
    known = {**TRUTH, **truth}
    row = np.array([[known[name] for name in model.parameter_names]])
    after, _ = rebounds(model, row, seen, np.zeros((count, 3)))
    after = after + errors[:, 3:] + np.array(scatter) * rng.standard_normal((count, 3))
    read, table = seen + errors[:, :3], load_table("wang_all.csv")
    sds = np.sqrt(np.diagonal(values, axis1=1, axis2=2))
    return replace(
        table, impacts=Impacts(*read.T), redundant=(), labels={}, notices=(), ids=tuple(map(str, range(count))),
        measurements=tuple(
            replace(item, values=after[:, k], sd=sds[:, 3 + k]) for k, item in enumerate(table.measurements)
        ),
        incident_sd={name: sds[:, k] for k, name in enumerate(COLUMNS[:3])}, resolution={},
        incident_covariance=values[:, :3, :3], covariance=Covariance(COLUMNS, values) if covariance else None,
    )  # fmt: skip


def posed(table, **choices):
    return build_problem(table, Scene(), Choices(**{"model": "grip-slip", **choices}))


def at(problem, **known):
    return np.array([[{**TRUTH, **known}[name] for name in problem.free_names]])


def steady(problem, values, reach=3.5):
    """Rows whose regime is the same wherever the incident state may lie."""
    root = regime_mixture.roots(problem.errors.incident)
    rebound = problem.rebound(values)
    towards = regime_mixture.crossings(
        lambda impacts, rows: problem.rebound_like(problem.all_values(values), impacts, rows),
        problem.impacts, reach / regime_mixture.REACH * root, rebound,
    )  # fmt: skip
    return np.flatnonzero(~np.any(towards[0], axis=-1))


def joint(problem, values, covariance, k):
    """Mean and covariance of what is measured in row `k`: of `y - f(u)` by the whole matrix at once."""
    model = problem.model
    row = np.array([[problem.all_values(values)[name][0] for name in model.parameter_names]])
    read = np.array([[getattr(problem.impacts, name)[k] for name in COLUMNS[:3]]])
    steps = 1e-5 * np.eye(3)
    slopes = np.stack([
        (rebounds(model, row, read, step)[0] - rebounds(model, row, read, -step)[0])[0] / 2e-5 for step in steps
    ], axis=1)  # fmt: skip
    # Of y_read - f(u_read) = e_y + s - J e_u.
    mix = np.concatenate([-slopes, np.eye(3)], axis=1)
    known = problem.all_values(values)
    own = np.array([known[str(item.noise)][0] for item in problem.observables])
    return rebounds(model, row, read, np.zeros((1, 3)))[0][0], mix @ covariance[k] @ mix.T + np.diag(own**2)


def test_the_likelihood_is_the_joint_normal_of_a_row():
    values = covariances(16)
    problem = posed(table_of(values, 1, states(16, 1)))
    x = at(problem)
    whole, _ = pointwise(problem, x, COLUMNS[3:])
    rows = steady(problem, x)
    assert rows.size > 6
    for k in rows:
        mean, spread = joint(problem, x, values, k)
        observed = [item.observed[k] for item in problem.observables]
        exact = stats.multivariate_normal(mean, spread).logpdf(observed)
        assert whole[0, k] == pytest.approx(exact, rel=1e-6)
        # Some columns alone are integrated over the others, not given them.
        _, some = pointwise(problem, x, ("v_x2", "omega_2"))
        part = stats.multivariate_normal(mean[[0, 2]], spread[np.ix_([0, 2], [0, 2])])
        assert some[0, k] == pytest.approx(part.logpdf(np.array(observed)[[0, 2]]), rel=1e-6)


@pytest.mark.parametrize("seed", [2, 3, 5])
def test_near_a_kink_it_is_the_integral_over_true_states(seed):
    """By draws of the true state, with the errors of the rebound given those of the incident state."""
    values = covariances(12, seed, np.array([0.3, 0.15, 3.0, 0.25, 0.2, 6.0]))
    problem = posed(table_of(values, 3 + seed, states(12, 4, 20.0, 40.0), mu=0.45))
    x, model = at(problem, mu=0.45), problem.model
    known = problem.all_values(x)
    whole, _ = pointwise(problem, x, COLUMNS[3:])
    row = np.array([[known[name][0] for name in model.parameter_names]])
    own = np.diag([known[str(item.noise)][0] ** 2 for item in problem.observables])
    rng, near = np.random.default_rng(7), np.setdiff1d(np.arange(12), steady(problem, x, 3.0))
    made = cells_of(problem, known, problem.rebound(x))
    first = made.spread_out(problem.noise.log_density(made.z, made.columns) - made.log_sd)[0].sum(axis=1)
    away = []
    for k in near:
        c = values[k]
        errors = rng.multivariate_normal(np.zeros(3), c[:3, :3], 100_000)
        read = np.array([[getattr(problem.impacts, name)[k] for name in COLUMNS[:3]]])
        after, _ = rebounds(model, row, read, -errors)
        slope = np.linalg.solve(c[:3, :3], c[:3, 3:]).T
        given = stats.multivariate_normal(np.zeros(3), c[3:, 3:] - slope @ c[:3, 3:] + own)
        observed = np.array([item.observed[k] for item in problem.observables])
        densities = given.pdf(observed - after - errors @ slope.T)
        error = densities.std() / np.sqrt(densities.size) / densities.mean()
        assert whole[0, k] == pytest.approx(np.log(densities.mean()), abs=0.04 + 4.0 * error)
        away.append(abs(first[k] - np.log(densities.mean())))
    assert max(away) > 0.08


def test_independent_errors_are_as_without_a_covariance():
    values = np.zeros((14, 6, 6))
    values[:, range(6), range(6)] = SDS**2
    values[:, 0, 1] = values[:, 1, 0] = 0.5 * SDS[0] * SDS[1]
    together, apart = (posed(table_of(values, 8, states(14, 8), covariance=given)) for given in (True, False))
    x = at(apart)
    one, other = (pointwise(problem, x, COLUMNS[3:])[0] for problem in (together, apart))
    np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10)


def test_the_order_of_columns_does_not_matter():
    values, order = covariances(10, 9), [2, 5, 0, 4, 1, 3]
    table = table_of(values, 9, states(10, 9))
    turned = replace(
        table,
        covariance=Covariance(tuple(COLUMNS[k] for k in order), values[:, order][:, :, order]),
        measurements=tuple(table.measurements[k] for k in (2, 0, 1)),
    )
    one, other = posed(table), posed(turned)
    totals = [
        log_likelihood(problem, at(problem), problem.rebound(at(problem)))[0]
        for problem in (one, replace(other, parameters=one.parameters))
    ]
    assert totals[0] == pytest.approx(totals[1], rel=1e-10)


def test_columns_that_are_not_used_are_integrated_over():
    values = covariances(14, 10)
    table = table_of(values, 10, states(14, 10))
    left = replace(table, measurements=table.measurements[:2])
    keep = [0, 1, 2, 3, 4]
    cut = replace(left, covariance=Covariance(COLUMNS[:5], values[:, keep][:, :, keep]))
    one, other = posed(left), posed(cut)
    assert one.errors.columns == ("v_x2", "v_y2")
    x = at(one)
    np.testing.assert_allclose(pointwise(one, x, COLUMNS[3:5])[0], pointwise(other, x, COLUMNS[3:5])[0], rtol=1e-12)


def test_exact_incidence_takes_the_covariance_of_the_rebound_alone():
    values = covariances(14, 11)
    table = table_of(values, 11, states(14, 11))
    exact = posed(table, incident_errors=False)
    assert not exact.uncertain
    x = at(exact)
    whole = np.sum(list(impact_terms(exact, x, exact.rebound(x)).values()), axis=0)[0]
    rebound = exact.rebound(x)
    for k in range(14):
        mean = [getattr(rebound, name)[0, k] for name in COLUMNS[3:]]
        spread = values[k, 3:, 3:] + np.diag([0.11**2, 0.17**2, 16.0])
        observed = [item.observed[k] for item in exact.observables]
        assert whole[k] == pytest.approx(stats.multivariate_normal(mean, spread).logpdf(observed), rel=1e-9)


def test_singular_errors_need_a_scatter():
    """Errors of v_x2 and v_y2 that are one, as those of a scale are."""
    values = np.zeros((14, 6, 6))
    values[:, range(6), range(6)] = SDS**2
    values[:, 3, 4] = values[:, 4, 3] = SDS[3] * SDS[4]
    table = table_of(values, 12, states(14, 12))
    fitted = posed(table)
    x = at(fitted, v_x_sd=1e-4, v_y_sd=1e-4)
    assert np.isfinite(log_likelihood(fitted, x, fitted.rebound(x))[0])
    for asked in ({"velocity_noise": "stated"}, {"fix": {"v_x_sd": 0.0, "v_y_sd": 0.0}}):
        with pytest.raises(FitError, match="exact combinations"):
            posed(table, **asked)
    # One column that scatters is enough.
    posed(table, fix={"v_x_sd": 0.0})


def test_a_part_of_a_table_has_its_rows():
    values = covariances(14, 13)
    whole = posed(table_of(values, 13, states(14, 13)))
    rows = np.array([1, 4, 9])
    part, x = part_of(whole, rows), at(whole)
    one, other = (pointwise(problem, x, COLUMNS[3:])[0] for problem in (whole, part))
    np.testing.assert_allclose(one[:, rows], other, rtol=1e-12)
    np.testing.assert_allclose(part.table.covariance.values, values[rows])


def test_new_tables_have_the_covariance_of_their_rows():
    """What is measured less what is predicted there, over many tables of the fitted model."""
    values = covariances(8, 14, 0.2 * SDS)
    problem = posed(table_of(values, 14, states(8, 14)))
    x = np.repeat(at(problem), 20_000, axis=0)
    made = replicated(problem, x, np.random.default_rng(1))
    for k in steady(problem, x[:1], 6.0):
        _, spread = joint(problem, x[:1], values, k)
        found = np.cov(np.stack([made[name][:, k] for name in COLUMNS[3:]]))
        unit = np.sqrt(np.outer(np.diag(spread), np.diag(spread)))
        np.testing.assert_allclose(found / unit, spread / unit, atol=0.03)


def test_intervals_hold_with_the_covariance_and_not_without():
    """Errors of both vertical speeds that go together, as those of a wrong tilt: they hardly change their ratio."""
    sds = np.array([0.02, 0.4, 2.0, 0.02, 0.4, 2.0])
    one = np.diag(sds**2)
    one[1, 4] = one[4, 1] = 0.9 * sds[1] * sds[4]
    values = np.tile(one, (20, 1, 1))
    tried = np.linspace(-0.15, 0.15, 121)
    inside = {True: [], False: []}
    for seed in range(200):
        table = table_of(values, 100 + seed, states(20, 100 + seed), scatter=(0.05, 0.05, 2.0))
        for given in (True, False):
            known = {name: TRUTH[name] for name in ("mu", "e_x", "offset", "cor_slope")}
            noise = {"v_x_sd": 0.05, "v_y_sd": 0.05, "spin_sd": 2.0}
            problem = posed(table if given else replace(table, covariance=None), fix=known | noise)
            x = TRUTH["cor_10"] + tried[:, None]
            density = log_likelihood(problem, x, problem.rebound(x))
            below = np.cumsum(np.exp(density - density.max()))
            inside[given].append(np.interp(0.0, tried, below / below[-1]))
    covered = {
        given: [np.mean(np.abs(np.array(place) - 0.5) < 0.5 * level) for level in (0.68, 0.95)]
        for given, place in inside.items()
    }
    # Binomial limits of 200 tables.
    assert abs(covered[True][0] - 0.68) < 0.1
    assert abs(covered[True][1] - 0.95) < 0.05
    # Independent errors of that size would give intervals some times too wide.
    assert covered[False][0] > 0.95


def test_regressions_of_errors_are_those_of_their_definition():
    values = covariances(5, 15)
    values[0, 1, :] = values[0, :, 1] = 0.0
    values[1, :3] = values[1, :, :3] = 0.0
    found = errors_from(Covariance(COLUMNS, values), COLUMNS[3:])
    for k in range(2, 5):
        expected = np.linalg.solve(values[k, :3, :3], values[k, :3, 3:]).T
        np.testing.assert_allclose(found.follows[k], expected, rtol=1e-8)
        np.testing.assert_allclose(
            found.rest[k], np.linalg.inv(np.linalg.inv(values[k])[3:, 3:]), rtol=1e-7, atol=1e-12
        )
    np.testing.assert_allclose(found.follows[0, :, 1], 0.0, atol=1e-12)
    np.testing.assert_allclose(found.follows[1], 0.0, atol=1e-12)
    np.testing.assert_allclose(found.rest[1], values[1, 3:, 3:])
    assert problem_of("wang_all.csv").errors is None


def test_scores_of_a_table_know_what_its_errors_have_in_common():
    """Measured values and predictions share the error of the incident state: deviations are standard with the
    covariance, and not without.
    """
    fit = fitball.calibrate(
        table_of(covariances(30, 21, 0.1 * SDS), 21, states(30, 21)), scene=Scene(), model="grip-slip"
    )
    sds = np.array([0.02, 0.4, 2.0, 0.02, 0.4, 2.0])
    one = np.diag(sds**2)
    one[1, 4] = one[4, 1] = 0.9 * sds[1] * sds[4]
    other = table_of(np.tile(one, (120, 1, 1)), 22, states(120, 22), scatter=(0.11, 0.17, 4.0))
    measured, _ = observed_observables(fit.predicting, other)
    found = {}
    for given in (other.covariance, None):
        prediction = predict_new(
            fit.predicting, other.impacts, measured, incident_covariance=other.incident_covariance, covariance=given
        )
        found[given is None] = float(np.sqrt(np.mean(prediction.output("v_y2").z ** 2)))
    assert found[False] == pytest.approx(1.0, abs=0.2)
    assert found[True] < 0.75
