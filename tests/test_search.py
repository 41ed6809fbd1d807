"""Searches: cost and slopes, steps within bounds and walls, maxima against scipy's, long tables by
parts.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import approx_fprime, minimize
from support.density import REBOUND, TIMED, near, problem_of, scene_of, table_of, truth_of
from support.line import exact, line_problem

from fitball.base.errors import FitError
from fitball.inference import density
from fitball.inference.calibrate import _beside
from fitball.inference.effort import Effort
from fitball.inference.schema import Posterior
from fitball.inference.search import best_fit as search
from fitball.inference.search.best_fit import best_fit
from fitball.inference.search.objective import Objective, constrained_step, descend
from fitball.models.registry import model


def seeded(seed=0):
    return np.random.default_rng(seed)


def form(name):
    if name == "simple":
        return problem_of(table_of(REBOUND), scene_of())
    if name == "levels":
        table = table_of(REBOUND, labels=("surface",), gaps=True, count=14)
        return problem_of(table, scene_of(), noise="student-t")
    if name == "timed":
        return problem_of(table_of(TIMED, "sd"), scene_of(time=True, ball=True), "two-mass")
    return problem_of(table_of(REBOUND, "corr"), scene_of(camera=True), noise="student-t")


FORMS = ("simple", "levels", "timed", "camera")


@pytest.mark.parametrize("name", FORMS)
def test_cost_is_minus_the_posterior_and_its_slopes_are_right(name):
    problem = form(name)
    x = near(problem)
    objective = Objective(problem)
    # Without the spike of the prior where all levels agree, which is none elsewhere.
    raised = replace(problem, prior=problem.prior.smooth)
    assert_allclose(objective.cost(x), -density.log_posterior(raised, x), rtol=1e-12)
    assert (name == "levels") == bool(
        np.any(objective.cost(x) != -density.log_posterior(problem, x))
    )
    gradient, curvature = objective.linearised(x)
    for row, found in zip(x, gradient, strict=True):
        wanted = approx_fprime(
            row,
            lambda q: objective.cost(q[None])[0],
            1e-7 * problem.prior.width,
        )
        assert_allclose(found, wanted, atol=2e-5 * np.abs(wanted).max())
    assert np.all(np.linalg.eigvalsh(curvature) > 0.0)


def test_the_curvature_of_a_straight_line_is_its_precision():
    problem = line_problem()
    centre, covariance = exact(problem)
    x = np.array([[0.4, 2.0]])
    gradient, curvature = Objective(problem).linearised(x)
    assert_allclose(np.linalg.inv(curvature[0]), covariance, rtol=1e-6)
    assert_allclose(x[0] - np.linalg.solve(curvature[0], gradient[0]), centre, rtol=1e-6)
    # A logarithm of a normal scale has twice the information of a measurement, and nothing in
    # common with the mean.
    free = line_problem(noise=0.0)
    _, curvature = Objective(free).linearised(np.array([[0.4, 2.0, np.log(0.3)]]))
    assert_allclose(
        curvature[0, 2],
        [0.0, 0.0, 2.0 * 12 + 0.7**-2],
        rtol=1e-6,
        atol=1e-6,
    )


def test_not_penalised_only_evidence_counts():
    problem = form("timed")
    x = near(problem, 2)
    likelihood, time = density.log_likelihood(problem, x)
    evidence = likelihood + density.scene_density(problem, time)
    for name in ("ball_mass", "inertia_ratio"):
        k = problem.free.index(name)
        evidence -= 0.5 * ((x[:, k] - problem.prior.location[k]) * problem.prior.rate[k]) ** 2
    found = Objective(problem, penalised=False)
    assert_allclose(np.diff(found.cost(x)), -np.diff(evidence), rtol=1e-9)
    pooled = form("levels")
    at = near(pooled, 2)
    cost = Objective(pooled, penalised=False).cost(at)
    assert_allclose(cost, -density.log_likelihood(pooled, at)[0], rtol=1e-12)
    wanted = approx_fprime(x[0], lambda q: found.cost(q[None])[0], 1e-7 * problem.prior.width)
    assert_allclose(found.linearised(x)[0][0], wanted, atol=2e-5 * np.abs(wanted).max())


def test_impacts_that_do_not_count(monkeypatch):
    problem = form("camera")
    counted = np.ones((2, 10), dtype=bool)
    counted[0, 3] = counted[1, 5:8] = False
    start = near(problem, 2, 0.02)
    found = descend(Objective(problem, counted=counted), start)
    for row, rows in enumerate(([3], [5, 6, 7])):
        alone = descend(Objective(problem.without(np.array(rows))), start[row : row + 1])
        assert_allclose(
            found[0][row],
            alone[0][0],
            atol=1e-9 * problem.prior.width.max(),
        )
        assert found[1][row] == pytest.approx(alone[1][0], rel=1e-12)
    assert abs(found[1][0] - found[1][1]) > 0.1
    whole = Objective(problem, counted=counted)
    cost = whole.cost(start)
    gradient, _ = whole.linearised(start)
    monkeypatch.setattr(density, "AT_ONCE", 50)
    assert_allclose(whole.cost(start), cost, rtol=1e-12)
    assert_allclose(whole.linearised(start)[0], gradient, rtol=1e-9, atol=1e-9)


def test_what_is_held_stays_to_the_last_bit():
    problem = form("timed")
    start = near(problem, len(problem.free))
    place = np.arange(len(problem.free))
    mu = problem.free.index("mu")
    start[mu, mu] = np.nextafter(problem.prior.high[mu], 0.0)
    x, cost, _ = descend(Objective(problem, penalised=False, held=place), start)
    assert_array_equal(x[place, place], start[place, place])
    top = descend(Objective(problem, penalised=False), x)[1].min()
    assert np.all(cost >= top - 1e-6)
    assert np.all(cost < np.inf)
    several = np.tile([[0, 3, -1]], (2, 1))
    x, _, _ = descend(Objective(problem, held=several), start[:2])
    assert_array_equal(x[:, [0, 3]], start[:2, [0, 3]])
    assert np.all(x[:, [1, 2]] != start[:2, [1, 2]])


def test_walls_and_bounds_are_kept():
    problem = form("timed")
    names = list(problem.free)
    ratio = names.index("mass_ratio")
    cor = names.index("cor_10")
    start = np.repeat(near(problem, 1), 5, axis=0)
    start[:4, ratio], start[4, names.index("mu")] = [0.6, 0.7, 0.75, 0.77], 6.0
    held = np.array([ratio, ratio, ratio, ratio, -1])
    # Held below what the data say of COR, which then lies against the wall; outside of the bounds
    # it starts inside.
    x, cost, _ = descend(Objective(problem, penalised=False, held=held), start)
    assert np.isfinite(cost).all()
    assert np.all(np.diff(cost[:4]) < 0.0)
    assert np.all(x[:, cor] < x[:, ratio])
    assert np.all(x[:2, ratio] - x[:2, cor] < 0.01)
    assert np.all((x >= problem.prior.low) & (x <= problem.prior.high))
    # What is drawn over a bound ends exactly on it.
    prior = {"mu": "uniform(0.6, 0.9)", "offset": "uniform(0, 0.001)"}
    point = best_fit(problem_of(table_of(REBOUND), scene_of(), prior=prior), seeded()).optima[0]
    assert point["mu"] == 0.6
    assert point["offset"] == 0.001


@pytest.mark.parametrize("seed", range(4))
def test_steps_solve_the_quadratic_programme(seed):
    rng = seeded(seed)
    root = rng.standard_normal((5, 5))
    curvature = root @ root.T + 0.1 * np.eye(5)
    slope = rng.standard_normal(5)
    a = rng.standard_normal((7, 5))
    b = rng.uniform(-0.2, 0.5, 7)
    found = constrained_step(curvature, slope, a, b)
    assert np.all(a @ found <= b + 1e-9)
    other = minimize(
        lambda d: 0.5 * d @ curvature @ d + slope @ d,
        np.zeros(5),
        jac=lambda d: curvature @ d + slope,
        constraints={"type": "ineq", "fun": lambda d: b - a @ d, "jac": lambda _: -a},
        method="SLSQP",
        options={"ftol": 1e-12, "maxiter": 500},
    )
    assert_allclose(found, other.x, atol=1e-5)
    assert (
        constrained_step(curvature, slope, np.array([a[0], -a[0]]), np.array([-1.0, 0.5])) is None
    )


@pytest.mark.parametrize("name", ["simple", "camera"])
def test_no_maximum_of_scipy_is_higher(name):
    problem = form(name)
    found = best_fit(problem, seeded())
    width = problem.prior.width
    begin = problem.coordinates(found.optima[0])

    def cost(steps):
        score = density.log_posterior(problem, (begin + width * steps)[None])[0]
        return -score if np.isfinite(score) else 1e10

    assert -cost(np.zeros(begin.size)) == found.log_posterior[0]
    truth = (problem.coordinates(truth_of(problem)) - begin) / width
    options = {
        "maxfev": 1200,
        "xatol": 1e-4,
        "fatol": 1e-7,
        "adaptive": True,
    }
    other = -minimize(cost, truth, method="Nelder-Mead", options=options).fun
    assert found.log_posterior[0] - 1.0 < other < found.log_posterior[0] + 1e-4
    assert found.log_likelihood == pytest.approx(
        density.log_likelihood(problem, begin[None])[0][0],
        abs=1e-9,
    )
    made = density.cells(problem, begin[None])
    for k, item in enumerate(problem.observables):
        wanted = np.sqrt(np.nanmean((problem.rows.y[:, k] - made.mean[0, :, k]) ** 2))
        assert found.rms[item.column.name] == pytest.approx(wanted, rel=1e-12)


def test_the_mode_in_which_all_impacts_grip_is_found():
    # Nothing there depends on friction, and searches from plain draws of the priors end elsewhere.
    table = table_of(REBOUND, count=20, seed=1)
    rng = seeded(101)
    truth = {
        "mass_ratio": 0.99,
        "k_y": 2.2e4,
        "k_theta": 24.0,
        "mu": 2.0,
        "eps_10": -7e-4,
        "eps_slope": 1.4e-4,
        "cor_10": 0.78,
        "cor_slope": -0.0156,
        "v_x_sd": 0.25,
        "v_y_sd": 0.2,
        "spin_sd": 8.0,
    }
    made = model("two-mass").rebound(dict(list(truth.items())[:8]), table.impacts)
    for name, sd in zip(REBOUND, list(truth.values())[8:], strict=True):
        table.values[name][:] = made.column(name) + sd * rng.standard_normal(20)
    problem = problem_of(table, scene_of(), "two-mass")
    known = descend(Objective(problem), problem.coordinates(truth)[None])[1][0]
    assert best_fit(problem, seeded()).log_posterior[0] > -known - 1e-4


def test_a_ridge_is_climbed_by_points_at_random():
    problem = form("simple")
    top = problem.coordinates(best_fit(problem, seeded()).optima[0])
    objective = Objective(problem)
    beside = top + 0.05 * np.sqrt(np.diagonal(np.linalg.inv(objective.linearised(top[None])[1][0])))
    found = search._climbed(problem, beside[None], seeded())
    lowest, begun, ended = objective.cost(np.stack([top, beside, found[0]]))
    assert begun - lowest > 1e-3
    assert ended - lowest < 1e-5


def test_long_tables_by_parts_end_at_the_same_maximum(monkeypatch):
    problem = line_problem(60, noise=0.0)
    whole = best_fit(problem, seeded())
    tall = form("levels")
    other = best_fit(tall, seeded())
    monkeypatch.setattr(search, "FIRST", 6)
    monkeypatch.setattr(search, "GROWTH", 2)
    assert [len(part.rows.y) for part in search._growing(problem, seeded())] == [6, 12, 24, 60]
    for one, before in ((problem, whole), (tall, other)):
        monkeypatch.setattr(density, "AT_ONCE", 400)
        assert best_fit(one, seeded()).log_posterior[0] == pytest.approx(
            before.log_posterior[0],
            abs=1e-5,
        )


def test_the_same_seed_gives_the_same_bytes_and_another_the_same_maximum():
    problem = form("simple")
    one, two, three = (best_fit(problem, seeded(seed)) for seed in (3, 3, 4))
    assert one == two
    assert one != three
    assert one.log_posterior[0] == pytest.approx(three.log_posterior[0], abs=1e-6)


def test_a_better_place_known_beside_is_taken(monkeypatch):
    problem = line_problem(noise=0.0)
    found = best_fit(problem, seeded())
    monkeypatch.setattr(search, "_optima", lambda _problem, x: (x, Objective(problem).cost(x)))
    again = best_fit(problem, seeded(), [found.optima[0]])
    assert again.optima[-1] == pytest.approx(found.optima[0], rel=1e-12)


def test_a_model_without_an_answer():
    problem = problem_of(
        table_of(REBOUND),
        scene_of(),
        "two-mass",
        fix={"mass_ratio": 0.4, "cor_10": 0.9},
    )
    with pytest.raises(FitError) as caught:
        best_fit(problem, seeded())
    assert caught.value.code == "no-answer"
    stated = problem_of(
        table_of(REBOUND, "corr"),
        scene_of(),
        fix={"v_x_sd": 0.0, "v_y_sd": 0.0, "spin_sd": 0.0},
    )
    assert np.isfinite(best_fit(stated, seeded()).log_posterior[0])


def test_levels_that_differ_are_not_found_to_agree(monkeypatch):
    """Two surfaces, 1.8 m/s apart: with its spike the prior has the highest density where both
    agree.
    """
    table = table_of(REBOUND, labels=("surface",), count=24)
    first = np.array(table.labels["surface"]) == table.labels["surface"][0]
    moved = table.values["v_x2"] + np.where(first, 0.9, -0.9)
    problem = problem_of(replace(table, values={**table.values, "v_x2": moved}), scene_of())

    def apart():
        point = best_fit(problem, seeded()).optima[0]
        return abs(np.subtract(*(point[name] for name in problem.free if name.startswith("mu["))))

    assert apart() > 0.005
    # A draw where both agree, higher than any other, is no reason to search there.
    point = best_fit(problem, seeded())
    agreeing = problem.coordinates(point.optima[0])[None]
    names = [k for k, name in enumerate(problem.free) if name.startswith(("mu[", "cor_10["))]
    for one, other in zip(names[::2], names[1::2], strict=True):
        agreeing[0, [one, other]] = agreeing[0, [one, other]].mean() + np.array([0.0, 1e-9])
    height = density.log_posterior(problem, agreeing)
    assert height[0] > point.log_posterior[0] + 0.01
    drawn = Posterior(problem.free, problem.prior.value(agreeing)[None, None], height[None, None])
    assert _beside(problem, point, drawn, Effort()) is point
    monkeypatch.setattr(type(problem.prior), "smooth", property(lambda prior: prior))
    assert apart() < 0.001
