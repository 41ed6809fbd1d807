"""Profile likelihoods against exact formulas, brute force and coverage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from samples import GRIP_SLIP, TWO_MASS, drop_table, linear_problem, polar_problem, problem_of, synthetic
from scipy.optimize import brentq, minimize
from scipy.stats import chi2, norm

from fitball.data.table import Measurement
from fitball.inference.identifiability import profile
from fitball.inference.identifiability.profile import coverage, profiles
from fitball.inference.identifiability.profile_walk import best_top, profile_paths, searches, sweep
from fitball.inference.likelihood.posterior import log_likelihood, log_posterior
from fitball.inference.point.gauss_newton import constrained_step, descend
from fitball.inference.point.point_fit import maximum_posterior
from fitball.inference.point.surface import Conditions, Surface, surface_of
from fitball.inference.problem.subsample import withheld
from fitball.inference.results.evidence import End

DROP_95 = 0.5 * chi2.ppf(0.95, 1)


def start(problem, **values):
    known = {**GRIP_SLIP, "cor_slope": -0.014, **values}
    return [{item.name: known.get(item.name, item.fixed) for item in problem.parameters}]


def design(table):
    """`v_y2 = cor_10 v + cor_slope v (v - 10)`: linear, with bounds so far that none matters."""
    v = table.impacts.v_y1
    return np.stack([v, v * (v - 10.0)], axis=1)


def test_known_noise_gives_the_normal_interval():
    table = drop_table(np.random.default_rng(1), 8)
    problem = linear_problem(table, velocity_sd=0.05)
    found = profiles(problem, start(problem))
    x = design(table)
    inverse = np.linalg.inv(x.T @ x)
    best = inverse @ x.T @ table.measurement("v_y2").values
    for k, name in enumerate(("cor_10", "cor_slope")):
        profile = found.by_name[name]
        reach = 0.05 * np.sqrt(inverse[k, k])
        for level, interval in ((1.0, profile.interval_68), (norm.ppf(0.975), profile.interval_95)):
            np.testing.assert_allclose(interval, [best[k] - level * reach, best[k] + level * reach], rtol=1e-4)
        np.testing.assert_allclose(profile.drop, 0.5 * ((profile.values - best[k]) / reach) ** 2, atol=1e-3)
        assert profile.ends == (End.CLOSED, End.CLOSED)
        assert profile.unsettled == 0


def test_fitted_noise_gives_the_exact_profile():
    """`n/2 ln(RSS(b)/RSS)` for a coefficient, `n (ln(s/s0) + (s0^2/s^2 - 1)/2)` for the noise."""
    table = drop_table(np.random.default_rng(2), 8)
    problem = linear_problem(table)
    found = profiles(problem, start(problem))
    x, y = design(table), table.measurement("v_y2").values
    count = y.size
    inverse = np.linalg.inv(x.T @ x)
    best = inverse @ x.T @ y
    least = np.sum((y - x @ best) ** 2)
    profile = found.by_name["cor_10"]
    reach = np.sqrt(least * inverse[0, 0] * np.expm1(2.0 * DROP_95 / count))
    np.testing.assert_allclose(profile.interval_95, [best[0] - reach, best[0] + reach], rtol=3e-4)
    sd = np.sqrt(least / count)

    def drop(s):
        return count * (np.log(s / sd) + 0.5 * ((sd / s) ** 2 - 1.0)) - DROP_95

    expected = [brentq(drop, 0.2 * sd, sd), brentq(drop, sd, 10.0 * sd)]
    np.testing.assert_allclose(found.by_name["velocity_sd"].interval_95, expected, rtol=5e-3)
    assert found.by_name["velocity_sd"].best == pytest.approx(sd, rel=1e-6)
    assert found.log_likelihood == pytest.approx(norm.logpdf(y, x @ best, sd).sum(), abs=1e-5)


def intervals_that_hold(count, replicates, seed, **scene):
    rng = np.random.default_rng(seed)
    table = drop_table(rng, count)
    truth = design(table) @ [0.76, -0.014]
    inside = 0
    for _ in range(replicates):
        made = Measurement("v_y2", truth + 0.05 * rng.standard_normal(count))
        problem = linear_problem(replace(table, measurements=(made,)), **scene)
        low, high = profiles(problem, start(problem), names=["cor_slope"]).by_name["cor_slope"].interval_95
        inside += low < -0.014 < high
    return inside / replicates


def test_intervals_cover_and_those_of_half_the_noise_do_not():
    # Two standard deviations of 80 draws at 95 % are 5 %; half the noise covers 67 %.
    assert 0.90 <= intervals_that_hold(8, 80, 3, velocity_sd=0.05) < 1.0
    assert intervals_that_hold(8, 80, 3, velocity_sd=0.025) < 0.80


def test_the_coverage_of_few_rows_is_foretold():
    """Four rows and two parameters with a fitted noise: the formula says 71 %, not 95 %."""
    table = drop_table(np.random.default_rng(0), 4)
    foretold = coverage(linear_problem(table))
    assert foretold == pytest.approx(0.71, abs=0.08)
    assert intervals_that_hold(4, 80, 4) == pytest.approx(foretold, abs=0.1)
    assert coverage(linear_problem(table, velocity_sd=0.05)) == pytest.approx(0.95)
    # Seven spins of a fitted noise beside fourteen velocities of a known one, which carry most parameters: 89 %
    # of 960 simulated linear models.
    known = problem_of("wang_zero_spin.csv", "grip-slip", fix={"velocity_sd": 0.25})
    assert coverage(known) == pytest.approx(0.89, abs=0.03)


@pytest.fixture(scope="module")
def grip_slip():
    return synthetic(problem_of("wang_all.csv", "grip-slip"), GRIP_SLIP, 5)


def brute_force(problem, name, value, guesses):
    """The smallest negative log likelihood with one parameter held, written out and minimised by scipy."""
    k = problem.free_names.index(name)
    logs = [item.prior.log for item in problem.free]

    def cost(coordinates):
        values = np.where(logs, np.exp(np.where(logs, coordinates, 0.0)), coordinates)
        values = np.insert(values, k, value)[None, :] if values.size < problem.dimension else values[None, :]
        rebound = problem.rebound(values)
        if rebound.status.any():
            return 1e10
        columns = problem.all_values(values)
        total = 0.0
        for observable in problem.observables:
            total -= norm.logpdf(
                observable.observed, observable.predict(rebound)[0], columns[observable.noise][0]
            ).sum()
        if problem.contact_time is not None:
            total -= norm.logpdf(rebound.contact_time.mean(), *problem.contact_time)
        return total

    logs = [log for j, log in enumerate(logs) if j != k]
    found = []
    for guess in guesses:
        coordinates = np.delete(problem.to_coordinates(guess[None, :])[0], k)
        scale = np.delete(problem.prior.width, k)
        simplex = np.vstack([coordinates, coordinates + 0.03 * np.diag(scale)])
        options = {"initial_simplex": simplex, "adaptive": True, "maxfev": 2000, "xatol": 1e-5, "fatol": 1e-5}
        found.append(minimize(cost, coordinates, method="Nelder-Mead", options=options).fun)
    return min(found)


@pytest.mark.parametrize("name", ["mu", "e_x", "cor_slope", "spin_sd"])
def test_grip_slip_agrees_with_brute_force(grip_slip, name):
    problem = grip_slip
    found = profiles(problem, start(problem), names=[name])
    profile = found.by_name[name]
    truth = np.array([GRIP_SLIP[key] for key in problem.free_names])
    rng = np.random.default_rng(6)
    for k in (len(profile.values) // 3, -1):
        guess = truth * (1.0 + 0.1 * rng.standard_normal(truth.size))
        lowest = brute_force(problem, name, profile.values[k], [truth, guess])
        assert found.log_likelihood - profile.drop[k] == pytest.approx(-lowest, abs=2e-3)


@pytest.fixture(scope="module")
def two_mass():
    """The default problem and its best point, from a start near it."""
    problem = problem_of("wang_zero_spin.csv")
    point = maximum_posterior(problem, np.array([[TWO_MASS[key] for key in problem.free_names]]))
    return problem, point


def test_two_mass_agrees_with_brute_force_along_its_walls(two_mass):
    """The mass ratio of this table lies near the wall mass_ratio = COR, which moves with the restitution."""
    problem, point = two_mass
    found = profiles(problem, point.optima, names=["mass_ratio", "k_theta"])
    best = np.array([point.values[key] for key in problem.free_names])
    for name in ("mass_ratio", "k_theta"):
        profile = found.by_name[name]
        for k in (1, -2):
            guess = best.copy()
            # From inside the wall, where the simplex can move.
            guess[problem.free_names.index("cor_10")] = 0.72
            lowest = brute_force(problem, name, profile.values[k], [guess])
            # Brute force may fall short on eight parameters; it must never be better.
            assert found.log_likelihood - profile.drop[k] > -lowest - 2e-3
    assert found.by_name["mass_ratio"].open_sides == (False, False)


def test_without_the_scene_the_stiffness_is_open(two_mass):
    problem, point = two_mass
    touched = ["k_y", "k_theta"]
    alone = profiles(problem, point.optima, names=touched, scene=False)
    assert alone.by_name["k_y"].ends == (End.BOUND, End.BOUND)
    # k_theta ends only where k_y, with which it moves, ends.
    assert alone.by_name["k_theta"].leans_on == (("k_y",), ("k_y",))
    assert alone.by_name["k_theta"].open_sides == (True, True)
    whole = profiles(problem, point.optima, names=touched)
    assert whole.by_name["k_y"].open_sides == (False, False)
    # A contact time known to 10 %, which goes with one over the root of k_y: 20 % of k_y.
    low, high = whole.by_name["k_y"].interval_68
    assert 0.5 * np.log(high / low) == pytest.approx(0.2, abs=0.01)


def test_a_maximum_that_keeps_being_surpassed_ends_in_words(grip_slip, monkeypatch):
    """Each search meets a higher maximum: after so many there is no profile, and it says so."""
    walked = []

    def surpassed(objective, columns, top, others):
        walked.append(columns)
        raise profile.SurpassedError(top.x)

    monkeypatch.setattr(profile, "profile_paths", surpassed)
    found = profiles(grip_slip, start(grip_slip), names=["mu"])
    assert len(walked) == profile.RESTARTS
    assert not found.by_name
    assert f"after {profile.RESTARTS} searches" in found.missing
    assert not profiles(grip_slip, start(grip_slip), names=[]).missing


def test_the_best_noise_is_no_worse_than_any_other(grip_slip):
    objective, values = Surface(grip_slip), np.array([[GRIP_SLIP[key] for key in grip_slip.free_names]])
    x, held = objective.from_values(values), grip_slip.to_coordinates(values)[:, objective.noise_columns]
    given = objective.free(x)
    cost = objective.cost(x, replace(given, noise=held))
    assert cost[0] == pytest.approx(-log_likelihood(grip_slip, values, grip_slip.rebound(values))[0], rel=1e-12)
    assert objective.cost(x, given)[0] < cost[0]


def uncertain_incidence():
    """Mixtures at kinks."""
    table, covariance = problem_of("wang_all.csv", "grip-slip").table, np.zeros((21, 3, 3))
    covariance[:, range(3), range(3)] = np.square([0.3, 0.3, 10.0])
    return problem_of(
        replace(table, incident_covariance=covariance, incident_sd={"v_x1": np.full(21, 0.3)}), "grip-slip"
    )


@pytest.mark.parametrize(
    ("posed", "truth", "penalised"),
    [
        (polar_problem, GRIP_SLIP, False),
        # As a posterior without one impact noise is a column too.
        (polar_problem, GRIP_SLIP, True),
        (lambda _folder: uncertain_incidence(), GRIP_SLIP, False),
        (
            lambda _folder: problem_of("wang_zero_spin.csv", noise="student-t"),
            TWO_MASS | {"degrees_of_freedom": 4.0},
            False,
        ),
    ],
    ids=["polar", "left-out", "incidence", "heavy-tails"],
)
def test_a_surface_is_the_likelihood_and_its_gradient_that_of_the_cost(tmp_path, posed, truth, penalised):
    problem = posed(tmp_path)
    objective = Surface(problem, penalised=True) if penalised else surface_of(problem)
    values = np.array([[truth[name] for name in problem.free_names]])
    x = objective.from_values(values)
    given = objective.free(x)
    if penalised:
        given = replace(given, counted=np.array([[True, False, True, True]]))
    elif not objective.closed:
        rebound = problem.rebound(values)
        expected = -log_likelihood(problem, values, rebound)[0]
        if problem.contact_time is not None:
            expected -= norm(*problem.contact_time).logpdf(rebound.contact_time.mean())
        assert objective.cost(x, given)[0] == pytest.approx(expected, rel=1e-12)
    gradient, _ = objective.linearised(x, given)
    for k in range(x.shape[1]):
        step = np.zeros(x.shape[1])
        step[k] = (1e-5 if objective.closed else 1e-4) * objective.width[k]
        slope = (objective.cost(x + step, given)[0] - objective.cost(x - step, given)[0]) / (2.0 * step[k])
        width = 1.0 if objective.closed else objective.width[k]
        assert gradient[0, k] * width == pytest.approx(
            slope * width, rel=1e-4 if objective.closed else 1e-3, abs=1e-3 if objective.closed else 0.02
        )


@pytest.mark.parametrize("closed", [True, False])
def test_a_penalised_surface_is_the_posterior_without_what_is_left_out(two_mass, closed):
    problem, rows = two_mass[0], np.array([1, 5])
    surface = Surface(problem, penalised=True, closed=closed)
    values = np.array([[two_mass[1].values[name] for name in problem.free_names]]) * np.array([[1.0], [1.001]])
    counted = np.ones((2, len(problem.impacts)), dtype=bool)
    counted[:, rows] = False
    given = Conditions(np.empty((2, 0)), True, counted)
    cost = surface.cost(surface.from_values(values), given)
    density = log_posterior(withheld(problem, rows), problem.to_coordinates(values))
    assert density[1] - density[0] == pytest.approx(cost[0] - cost[1], abs=1e-8)


def test_a_poor_point_is_mended_from_its_neighbours(grip_slip):
    objective = Surface(grip_slip)
    x = objective.from_values(np.array([[GRIP_SLIP[key] for key in grip_slip.free_names]]))
    top, others = best_top(objective, x)
    points = profile_paths(objective, [0], top, others)
    good = points[0][2]
    points[0][2] = replace(good, cost=good.cost + 1.0, settled=False)
    mended, changed = sweep(objective, points, {0: {1, 3}}, others, top)
    assert changed[0] == {2}
    assert mended[0][2].cost == pytest.approx(good.cost, abs=1e-3)


def test_a_start_outside_the_walls_is_led_inside(two_mass):
    problem, point = two_mass
    objective = Surface(problem)
    x = objective.from_values(np.array([[point.values[key] for key in problem.free_names]]))
    column = problem.free_names.index("mass_ratio")
    given = searches(objective, [column], np.array([0.7]), x)
    # At a mass ratio of 0.7 the restitution found would be impossible.
    assert not np.isfinite(objective.cost(given.x, given.given))[0]
    found = descend(objective, given)
    assert np.isfinite(found.cost[0])
    names = [parameter.name for parameter in objective.parameters]
    line = dict(zip(names, found.x[0], strict=True))
    speeds = problem.impacts.v_y1
    assert np.all(line["cor_10"] + line["cor_slope"] * (speeds - 10.0) <= 0.7)


def test_constrained_steps_are_those_of_scipy():
    rng = np.random.default_rng(9)
    for _ in range(20):
        root = rng.standard_normal((4, 4))
        curvature, gradient = root @ root.T + 0.1 * np.eye(4), 3.0 * rng.standard_normal(4)
        a, b = rng.standard_normal((6, 4)), rng.uniform(-0.1, 1.0, 6)
        expected = minimize(
            lambda d, h=curvature, g=gradient: 0.5 * d @ h @ d + g @ d,
            np.zeros(4),
            jac=lambda d, h=curvature, g=gradient: h @ d + g,
            method="SLSQP",
            constraints={"type": "ineq", "fun": lambda d, a=a, b=b: b - a @ d},
            options={"ftol": 1e-14, "maxiter": 300},
        )
        step = constrained_step(curvature, gradient, a, b)
        if expected.success:
            np.testing.assert_allclose(step, expected.x, atol=1e-5)
    assert constrained_step(np.eye(1), np.zeros(1), np.array([[1.0], [-1.0]]), np.array([-1.0, -1.0])) is None
