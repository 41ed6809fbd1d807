"""Incident states measured with errors: first order where it holds, a mixture where the bounce has a kink."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from latent_states import compare
from samples import problem_of
from scipy import stats
from scipy.special import logsumexp

import fitball
from fitball.bench.problems import BASE
from fitball.cli.main import main
from fitball.data.read import load_table
from fitball.data.scene import Scene
from fitball.inference.calibrate import weighs
from fitball.inference.effort import Effort
from fitball.inference.identifiability.information import fisher_information, prior_sds
from fitball.inference.likelihood import regime_mixture
from fitball.inference.likelihood.cells import cells, joint_root, shared_covariance, solved
from fitball.inference.likelihood.posterior import impact_terms, log_likelihood, pointwise
from fitball.inference.prediction.posterior_predictive import replicated
from fitball.inference.problem.noise import NORMAL
from fitball.values import Impacts

VALUES = {**BASE, "velocity_sd": 0.25, "v_x_sd": 0.25, "v_y_sd": 0.25, "spin_sd": 8.0, "e_x": 0.15, "offset": 0.0}


def covariances(count, velocity_sd, spin_sd, correlation=0.4):
    found = np.zeros((count, 3, 3))
    found[:, 0, 0] = found[:, 1, 1] = velocity_sd**2
    found[:, 0, 1] = found[:, 1, 0] = correlation * velocity_sd**2
    found[:, 2, 2] = spin_sd**2
    return found


def simulated(model, angles, covariance, seed, **values):
    """A table at incidence `angles` [deg] whose incident states were measured with errors, and its problem."""
    rng = np.random.default_rng(seed)
    count = len(angles)
    chosen = fitball.model(model)
    rows = np.array([[{**VALUES, **values}[name] for name in chosen.parameter_names]])
    theta = np.radians(angles)
    speed = 17.0 + rng.standard_normal(count)
    seen = Impacts(speed * np.cos(theta), speed * np.sin(theta), 80.0 * rng.standard_normal(count))
    moves = np.einsum("pij,pj->pi", regime_mixture.roots(covariance), rng.standard_normal((count, 3)))
    made = chosen.evaluate(chosen.parameter_names, rows, regime_mixture.shifted(seen, moves, np.arange(count)))
    table = load_table("wang_all.csv")
    measurements = tuple(
        replace(item, values=getattr(made, item.name)[0] + sd * rng.standard_normal(count))
        for item, sd in zip(table.measurements, (0.25, 0.25, 8.0), strict=True)
    )
    return replace(
        table, impacts=seen, measurements=measurements, redundant=(), labels={}, notices=(),
        ids=tuple(map(str, range(count))), incident_covariance=covariance,
        incident_sd={"v_x1": np.sqrt(covariance[:, 0, 0])},
    )  # fmt: skip


def at_truth(problem):
    return np.array([[VALUES[name] for name in problem.free_names]])


def by_quadrature(problem, values, k):
    """Log density of impact `k`: the product rule over the incident state, no derivative anywhere."""
    grid = np.linspace(-4.5, 4.5, 37)
    mesh = np.stack(np.meshgrid(grid, grid, grid, indexing="ij"), axis=-1).reshape(-1, 3)
    weight = -0.5 * np.sum(mesh * mesh, axis=1)
    weight -= logsumexp(weight)
    kept = weight > -25.0
    moves = mesh[kept] @ regime_mixture.roots(problem.errors.incident)[k].T
    rows = np.full(kept.sum(), k)
    made = problem.rebound_like(
        problem.all_values(values), regime_mixture.shifted(problem.impacts, moves, rows), rows
    )
    columns = problem.all_values(values)
    density = weight[kept].copy()
    for observable in problem.observables:
        biased = observable.observed[k]
        if problem.group_bias is not None:
            biased = biased - problem.group_bias.offset(columns, observable.name)[0, k]
        density += stats.norm(observable.predict(made)[0], columns[observable.noise]).logpdf(biased)
    return logsumexp(density)


def first_order(problem, values):
    made = cells(problem, problem.to_coordinates(values))
    return made.spread_out(NORMAL.log_density(made.z, {}) - made.log_sd).sum(axis=2)[0]


def total(problem, values):
    return np.sum(list(impact_terms(problem, values, problem.rebound(values)).values()), axis=0)[0]


def test_whitening_is_the_normal_density_of_all_observables():
    rng = np.random.default_rng(2)
    factor = rng.standard_normal((5, 4, 3, 3))
    shared = np.einsum("dick,dilk->dicl", factor, factor)
    gaps = rng.standard_normal((5, 4, 3))
    root = joint_root(shared, np.broadcast_to([0.3, 1.0, 2.0], (5, 4, 3)))
    z = solved(root, gaps[..., None])[..., 0]
    found = np.sum(NORMAL.log_density(z, {}) - np.log(np.diagonal(root, axis1=2, axis2=3)), axis=2)
    for d in range(5):
        for i in range(4):
            covariance = shared[d, i] + np.diag([0.09, 1.0, 4.0])
            exact = stats.multivariate_normal(np.zeros(3), covariance).logpdf(gaps[d, i])
            assert found[d, i] == pytest.approx(exact, rel=1e-11)


@pytest.mark.parametrize("model", ["two-mass", "grip-slip"])
def test_first_order_away_from_a_kink_and_a_mixture_near_it(model):
    angles = np.linspace(10.0, 70.0, 10)
    table = simulated(model, angles, covariances(10, 0.3, 10.0), 1)
    problem = problem_of(table, model)
    values = at_truth(problem)
    columns = problem.all_values(values)
    near = np.any(
        np.abs(
            regime_mixture.crossings(
                lambda given, rows: problem.rebound_like(columns, given, rows), problem.impacts,
                regime_mixture.roots(problem.errors.incident), problem.rebound(values),
            )[0]
        ) > 0.0, axis=1,
    )  # fmt: skip
    exact = np.array([by_quadrature(problem, values, k) for k in range(10)])
    rough, fine = first_order(problem, values), total(problem, values)
    assert near.sum() < 8
    assert np.max(np.abs(rough - exact)[~near]) < 0.06
    np.testing.assert_allclose(fine[~near], rough[~near], rtol=1e-12)
    assert np.max(np.abs(fine - exact)[near], initial=0.0) < 0.03


def test_first_order_fails_at_the_kink_where_the_mixture_does_not():
    """Impacts laid on the boundary itself: first order is off by some tenths, the mixture by hundredths."""
    table = simulated("grip-slip", np.linspace(20.0, 45.0, 40)[:12], covariances(12, 0.3, 10.0), 4)
    problem = problem_of(table, "grip-slip")
    values = at_truth(problem)
    exact = np.array([by_quadrature(problem, values, k) for k in range(12)])
    assert np.max(np.abs(first_order(problem, values) - exact)) > 0.3
    assert np.max(np.abs(total(problem, values) - exact)) < 0.1


def test_each_column_on_a_kink_is_given_those_before_it():
    """The first terms of an impact add up to the density of those columns alone, whatever the others were."""
    table = simulated("grip-slip", np.linspace(20.0, 45.0, 40)[:12], covariances(12, 0.3, 10.0), 4)
    problem = problem_of(table, "grip-slip")
    values = at_truth(problem)
    terms = impact_terms(problem, values, problem.rebound(values))
    for count in (1, 2, 3):
        first = replace(problem, observables=problem.observables[:count])
        found = np.sum([terms[item.name] for item in first.observables], axis=0)[0]
        assert np.max(np.abs(found - [by_quadrature(first, values, k) for k in range(12)])) < 0.1


def test_columns_that_are_not_scored_are_integrated_out():
    """Beside a model that is told v_y2 others are scored by the rest: its density whatever v_y2 was, at kinks too."""
    table = simulated("grip-slip", np.linspace(20.0, 45.0, 40)[:12], covariances(12, 0.3, 10.0), 4)
    problem = problem_of(table, "grip-slip")
    values, scored = at_truth(problem), ("v_x2", "omega_2")
    rest = replace(problem, observables=tuple(item for item in problem.observables if item.name in scored))
    whole, found = pointwise(problem, values, scored)
    np.testing.assert_array_equal(whole[0], total(problem, values))
    assert np.max(np.abs(found[0] - [by_quadrature(rest, values, k) for k in range(12)])) < 0.1


def test_the_mixture_is_laid_across_the_boundary():
    """Impact 10 lies aslant to its boundary: laid towards the nearest axis instead, the mixture is off by a tenth."""
    table = simulated("two-mass", np.linspace(14.0, 40.0, 30), covariances(30, 0.2, 6.0), 7)
    problem = problem_of(table, "two-mass")
    values = at_truth(problem)
    exact = by_quadrature(problem, values, 10)
    assert abs(first_order(problem, values)[10] - exact) > 0.15
    assert abs(total(problem, values)[10] - exact) < 0.03


def test_levels_and_offsets_keep_to_their_impacts_on_a_kink():
    """Two surfaces of different friction, each group with its own bias, every draw with other parameters."""
    angles = np.linspace(14.0, 34.0, 8)
    table = simulated("grip-slip", angles, covariances(8, 0.3, 10.0), 5)
    table = replace(table, labels={"surface": ("clay", "grass") * 4, "group": ("a",) * 4 + ("b",) * 4})
    problem = problem_of(table, "grip-slip", pool={"mu": "surface", "cor_10": "none"}, offsets="group")
    rng = np.random.default_rng(3)
    named = {name: rng.normal(0.0, 0.4, 3) for name in problem.free_names}
    named |= {name: np.full(3, value) for name, value in VALUES.items() if name in named}
    named["mu"], named["mu_spread"] = np.array([0.5, 0.55, 0.62]), np.array([0.1, 0.2, 0.3])
    values = np.stack([named[name] for name in problem.free_names], axis=1)
    found = np.sum(list(impact_terms(problem, values, problem.rebound(values)).values()), axis=0)
    exact = np.array([[by_quadrature(problem, values[d : d + 1], k) for k in range(8)] for d in range(3)])
    rough = np.array([first_order(problem, values[d : d + 1]) for d in range(3)])
    assert np.sum(np.abs(rough - found) > 0.05) >= 3
    np.testing.assert_allclose(found, exact, atol=0.04)


def test_a_state_that_leaves_the_court_has_no_impact():
    states = (np.array([[10.0, 12.0]]), np.array([[1.0, 5.0]]), np.zeros((1, 2)), None)
    moves = np.zeros((3, 2, 3))
    moves[1, 0, 1], moves[2, 0, 1], moves[2, 1, 1] = -1.0, -0.5, -5.5
    found, possible = regime_mixture.displaced(states, moves)
    np.testing.assert_array_equal(possible, [[True, True], [False, True], [True, False]])
    np.testing.assert_array_equal(found.v_y1, [[1.0, 5.0], [1.0, 5.0], [0.5, 5.0]])


def test_slow_impacts_keep_a_likelihood():
    """Where much of what the incident state may be does not reach the court."""
    covariance = covariances(6, 0.8, 10.0)
    table = simulated("grip-slip", np.linspace(2.0, 12.0, 6), covariances(6, 0.05, 10.0), 9)
    problem = problem_of(replace(table, incident_covariance=covariance), "grip-slip")
    assert (problem.impacts.v_y1 < 4.0 * 0.8).any()
    assert np.isfinite(total(problem, at_truth(problem))).all()


def test_exact_incidence_is_the_limit_of_small_errors():
    table = simulated("two-mass", np.linspace(12.0, 60.0, 8), covariances(8, 1e-7, 1e-6), 3)
    problem = problem_of(table, "two-mass")
    exact = problem_of(table, "two-mass", incident_errors=False)
    values = at_truth(problem)
    assert exact.errors is None
    assert total(problem, values) == pytest.approx(total(exact, values), rel=1e-9)


def test_speed_and_angle_leave_the_components_correlated(tmp_path):
    (tmp_path / "t.csv").write_text(
        "v_1,theta_1,v_1_sd,theta_1_sd,v_x2,v_y2\n20,30,0.5,0.01,13,8\n21,60,0.4,2.0,7,13\n", encoding="utf-8"
    )
    found = load_table(tmp_path / "t.csv").incident_covariance
    for row, (speed, angle, sd, turn) in enumerate(((20.0, 30.0, 0.5, 0.01), (21.0, 60.0, 0.4, 2.0))):
        rng = np.random.default_rng(row)
        a = np.radians(angle) + np.radians(turn) * rng.standard_normal(400_000)
        v = speed + sd * rng.standard_normal(400_000)
        drawn = np.cov(v * np.cos(a), v * np.sin(a))
        np.testing.assert_allclose(found[row, :2, :2], drawn, rtol=0.03, atol=1e-3)
    assert found[0, 0, 1] > 0.99 * np.sqrt(found[0, 0, 0] * found[0, 1, 1])
    np.testing.assert_array_equal(found[:, 2], 0.0)


def gaussian_information(problem, coordinates):
    """Of normal columns with a whole covariance, of which only the own noises move: differences, textbook formula
    (Kay 1993, 3.31), no whitening.
    """
    rows, step = np.arange(len(problem.impacts)), 1e-5
    covariance = problem.errors.incident

    def law(x):
        values = problem.to_values(x[None, :])
        columns, made = problem.all_values(values), problem.rebound(values)
        mean = np.stack([item.predict(made)[0] for item in problem.observables], axis=1)
        noises = [item.sds(columns, made) * np.ones(rows.size) for item in problem.observables]
        return mean, np.stack([noise.reshape(-1) ** 2 for noise in noises], axis=1), columns, made

    _mean, noise, columns, made = law(coordinates)
    slopes = problem.slopes_like(columns, problem.impacts, rows)
    by_input = np.stack([item.column.slopes(made, slopes)[0] for item in problem.observables], axis=1)
    inverse = np.linalg.inv(
        by_input @ covariance @ by_input.swapaxes(1, 2) + noise[..., None] * np.eye(noise.shape[1])
    )
    means, noises = [], []
    for unit in step * np.diag(problem.prior.width):
        up, down = law(coordinates + unit), law(coordinates - unit)
        means.append((up[0] - down[0]) / (2.0 * step))
        noises.append((up[1] - down[1])[..., None] * np.eye(noise.shape[1]) / (2.0 * step))
    first = np.einsum("jia,iab,kib->jk", means, inverse, means)
    return first + 0.5 * np.einsum("iab,jibc,icd,kida->jk", inverse, noises, inverse, noises, optimize=True)


@pytest.mark.parametrize("model", ["grip-slip", "two-mass"])
def test_information_is_that_of_columns_that_share_the_errors_of_the_incidence(model):
    table = simulated(model, np.linspace(10.0, 70.0, 8), covariances(8, 0.6, 25.0), 7)
    problem = problem_of(table, model)
    at = problem.to_coordinates(at_truth(problem))[0]
    found = fisher_information(problem, at, scene=False)
    sds = prior_sds(problem)
    expected = gaussian_information(problem, at) * np.outer(sds, sds)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-4 * np.abs(expected).max())
    # As if they were independent: far off, so that the agreement means something.
    alone = replace(problem, observables=problem.observables[2:])
    k, j = (one.free_names.index("spin_sd") for one in (problem, alone))
    at_alone = alone.to_coordinates(at_truth(alone))[0]
    assert found[k, k] > 2.0 * fisher_information(alone, at_alone, scene=False)[j, j]


def test_information_is_the_scatter_of_the_slope_of_the_likelihood_over_simulated_tables():
    """The likelihood that is sampled, its mixtures at kinks included; the slopes are differences."""
    table = simulated("grip-slip", np.linspace(10.0, 70.0, 12), covariances(12, 0.6, 25.0), 7)
    problem = problem_of(table, "grip-slip")
    at, rng, rows = at_truth(problem), np.random.default_rng(5), np.arange(12)
    x, steps = problem.to_coordinates(at)[0], 1e-4 * np.diag(problem.prior.width)
    around = problem.to_values(np.concatenate([x + steps, x - steps]))
    rebounds, columns = problem.rebound(around), problem.all_values(at)
    root, slopes = regime_mixture.roots(problem.errors.incident), []
    for _ in range(250):
        moves = np.einsum("pij,pj->pi", root, rng.standard_normal((12, 3)))
        made = problem.rebound_like(columns, regime_mixture.shifted(problem.impacts, moves, rows), rows)
        seen_there = tuple(
            replace(item, observed=item.predict(made)[0] + VALUES[item.noise] * rng.standard_normal(12))
            for item in problem.observables
        )
        density = log_likelihood(replace(problem, observables=seen_there), around, rebounds)
        slopes.append((density[: x.size] - density[x.size :]) / 2e-4)
    found = np.diag(fisher_information(problem, x, scene=False))
    scatter = np.mean(np.square(slopes), axis=0) * prior_sds(problem) ** 2
    # 250 squares of normal numbers have a mean to 9 %; the quadruple, and a little for what first order leaves out.
    np.testing.assert_allclose(scatter / found, 1.0, atol=0.4)
    # What sums over columns, each with the scatter of the incidence to itself, made of it.
    k = problem.free_names.index("spin_sd")
    whole = shared_covariance(problem, columns, problem.rebound(at))
    beside = np.sqrt(whole[0, :, 2, 2])
    apart = np.sum(2.0 / (1.0 + (beside / VALUES["spin_sd"]) ** 2) ** 2) * problem.prior.width[k] ** 2
    assert scatter[k] > 1.8 * apart


def test_new_measurements_of_an_impact_share_the_errors_of_its_incidence():
    """Their correlation is that of impacts simulated from scattered incident states."""
    table = simulated("grip-slip", np.array([20.0, 60.0]), covariances(2, 0.6, 25.0), 7)
    problem = problem_of(table, "grip-slip")
    draws, rng = 4000, np.random.default_rng(3)
    drawn = replicated(problem, np.repeat(at_truth(problem), draws, axis=0), rng)
    columns, root = problem.all_values(at_truth(problem)), regime_mixture.roots(problem.errors.incident)
    for row in range(2):
        moves = rng.standard_normal((draws, 3)) @ root[row].T
        rows = np.full(draws, row)
        made = problem.rebound_like(columns, regime_mixture.shifted(problem.impacts, moves, rows), rows)
        seen_there = [
            item.predict(made)[0] + VALUES[item.noise] * rng.standard_normal(draws) for item in problem.observables
        ]
        expected, found = (
            np.corrcoef(seen_there),
            np.corrcoef([drawn[item.name][:, row] for item in problem.observables]),
        )
        np.testing.assert_allclose(found, expected, atol=0.1)
        assert np.abs(expected - np.eye(3)).max() > 0.4


def test_errors_of_the_incidence_no_longer_count_as_noise():
    table = simulated("grip-slip", np.linspace(10.0, 70.0, 24), covariances(24, 0.6, 25.0), 7)
    known = fitball.calibrate(table, "grip-slip", scene=Scene(), seed=1, point_only=True)
    ignored = fitball.calibrate(table, "grip-slip", scene=Scene(), incident_errors=False, seed=1, point_only=True)
    for name in ("v_x_sd", "v_y_sd"):
        assert known.point.values[name] == pytest.approx(0.25, rel=0.5)
        assert ignored.point.values[name] > 1.4 * known.point.values[name]
    assert any("marginalised" in note for note in known.problem.notes)
    assert any("ignored" in note for note in ignored.problem.notes)


def test_the_posterior_agrees_with_one_over_all_latent_states():
    """Full sampling of the true incident states beside the parameters, against the marginal likelihood."""
    table = simulated("grip-slip", np.array([16.0, 24.0, 32.0, 50.0]), covariances(4, 0.3, 10.0), 11)
    names = fitball.model("grip-slip").parameter_names
    fix = {name: VALUES[name] for name in (*names, "velocity_sd", "spin_sd") if name not in ("mu", "cor_10")}
    found = compare(problem_of(table, "grip-slip", fix=fix), steps=600, seed=2)
    assert set(found.index) == {"mu", "cor_10"}
    assert (np.abs(found["shift"]) < 0.25).all()
    assert (np.abs(np.log(found["width"])) < 0.3).all()


def test_the_command_line_can_ignore_them(tmp_path, monkeypatch, capsys, without_figures):
    monkeypatch.chdir(tmp_path)
    rows = "\n".join(
        f"{x},{y},0,0.3,0.3,{x - 0.55 * 1.7 * y:.3f},{0.75 * y:.3f},{200 + 5 * k}"
        for k, (x, y) in enumerate(((16, 4), (15, 5), (14, 6), (13, 5.5)))
    )
    (tmp_path / "t.csv").write_text(
        f"v_x1,v_y1,omega_1,v_x1_sd,v_y1_sd,v_x2,v_y2,omega_2\n{rows}\n", encoding="utf-8"
    )
    words = ["calibrate", "t.csv", "--model", "grip-slip", "--point-only", "--out"]
    assert main([*words, "a"]) == 0
    assert "marginalised" in capsys.readouterr().err
    assert main([*words, "b", "--exact-incidence"]) == 0
    assert "ignored on request" in capsys.readouterr().err


def test_posteriors_with_incident_errors_are_weighed_and_others_walk():
    """Where a density costs mixtures; a given number of walkers asks for ensembles."""
    angles = np.linspace(20.0, 60.0, 8)
    problem = problem_of(simulated("grip-slip", angles, covariances(8, 0.1, 4.0), 1), model="grip-slip")
    plain = replace(problem, errors=None)
    assert weighs(problem, Effort()) and not weighs(problem, Effort(walkers=40)) and not weighs(plain, Effort())
