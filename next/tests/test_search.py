"""Searches: cost and slopes, steps within bounds and walls, maxima against scipy's, long tables by parts."""

import numpy as np
import pytest
from scipy.optimize import approx_fprime, minimize
from support.density import REBOUND, TIMED, near, problem_of, scene_of, table_of, truth_of
from support.line import exact, line_problem

from fitball.errors import FitError
from fitball.inference import density
from fitball.inference.search import best_fit as search
from fitball.inference.search.best_fit import best_fit
from fitball.inference.search.objective import Objective, constrained_step, descend


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
    np.testing.assert_allclose(objective.cost(x), -density.log_posterior(problem, x), rtol=1e-12)
    gradient, curvature = objective.linearised(x)
    for row, found in zip(x, gradient, strict=True):
        wanted = approx_fprime(row, lambda q: objective.cost(q[None])[0], 1e-7 * problem.prior.width)
        np.testing.assert_allclose(found, wanted, atol=2e-5 * np.abs(wanted).max())
    assert np.all(np.linalg.eigvalsh(curvature) > 0.0)


def test_the_curvature_of_a_straight_line_is_its_precision():
    problem = line_problem()
    centre, covariance = exact(problem)
    x = np.array([[0.4, 2.0]])
    gradient, curvature = Objective(problem).linearised(x)
    np.testing.assert_allclose(np.linalg.inv(curvature[0]), covariance, rtol=1e-6)
    np.testing.assert_allclose(x[0] - np.linalg.solve(curvature[0], gradient[0]), centre, rtol=1e-6)


def test_not_penalised_only_evidence_counts():
    problem = form("timed")
    x = near(problem, 2)
    likelihood, time = density.log_likelihood(problem, x)
    evidence = likelihood + density.scene_density(problem, time)
    for name in ("ball_mass", "inertia_ratio"):
        k = problem.free.index(name)
        evidence -= 0.5 * ((x[:, k] - problem.prior.location[k]) * problem.prior.rate[k]) ** 2
    found = Objective(problem, penalised=False)
    np.testing.assert_allclose(np.diff(found.cost(x)), -np.diff(evidence), rtol=1e-9)
    wanted = approx_fprime(x[0], lambda q: found.cost(q[None])[0], 1e-7 * problem.prior.width)
    np.testing.assert_allclose(found.linearised(x)[0][0], wanted, atol=2e-5 * np.abs(wanted).max())


def test_impacts_that_do_not_count():
    problem = form("camera")
    counted = np.ones((2, 10), dtype=bool)
    counted[0, 3] = counted[1, 5:8] = False
    start = near(problem, 2, 0.02)
    found = descend(Objective(problem, counted=counted), start)
    for row, rows in enumerate(([3], [5, 6, 7])):
        alone = descend(Objective(problem.without(np.array(rows))), start[row : row + 1])
        np.testing.assert_allclose(found[0][row], alone[0][0], atol=1e-9 * problem.prior.width.max())
        assert found[1][row] == pytest.approx(alone[1][0], rel=1e-12)
    assert abs(found[1][0] - found[1][1]) > 0.1


def test_what_is_held_stays_to_the_last_bit():
    problem = form("timed")
    start = near(problem, len(problem.free))
    place = np.arange(len(problem.free))
    x, cost, _ = descend(Objective(problem, penalised=False, held=place), start)
    np.testing.assert_array_equal(x[place, place], start[place, place])
    top = descend(Objective(problem, penalised=False), x)[1].min()
    assert np.all(cost >= top - 1e-6) and np.all(cost < np.inf)
    several = np.tile([[0, 3, -1]], (2, 1))
    x, _, _ = descend(Objective(problem, held=several), start[:2])
    np.testing.assert_array_equal(x[:, [0, 3]], start[:2, [0, 3]])
    assert np.all(x[:, [1, 2]] != start[:2, [1, 2]])


def test_walls_and_bounds_are_kept():
    problem = form("timed")
    names = list(problem.free)
    ratio, cor = names.index("mass_ratio"), names.index("cor_10")
    start = np.repeat(near(problem, 1), 5, axis=0)
    start[:4, ratio], start[4, names.index("mu")] = [0.6, 0.7, 0.75, 0.77], 6.0
    held = np.array([ratio, ratio, ratio, ratio, -1])
    # Held below what the data say of COR, which then lies against the wall; outside of the bounds it starts inside.
    x, cost, _ = descend(Objective(problem, penalised=False, held=held), start)
    assert np.isfinite(cost).all() and np.all(np.diff(cost[:4]) < 0.0)
    assert np.all(x[:, cor] < x[:, ratio]) and np.all(x[:2, ratio] - x[:2, cor] < 0.01)
    assert np.all((x >= problem.prior.low) & (x <= problem.prior.high))
    # What is drawn over a bound ends exactly on it.
    prior = {"mu": "uniform(0.6, 0.9)", "offset": "uniform(0, 0.001)"}
    point = best_fit(problem_of(table_of(REBOUND), scene_of(), prior=prior), seeded()).optima[0]
    assert (point["mu"], point["offset"]) == (0.6, 0.001)


@pytest.mark.parametrize("seed", range(4))
def test_steps_solve_the_quadratic_programme(seed):
    rng = seeded(seed)
    root = rng.standard_normal((5, 5))
    curvature, slope = root @ root.T + 0.1 * np.eye(5), rng.standard_normal(5)
    a, b = rng.standard_normal((7, 5)), rng.uniform(-0.2, 0.5, 7)
    found = constrained_step(curvature, slope, a, b)
    assert np.all(a @ found <= b + 1e-9)
    other = minimize(
        lambda d: 0.5 * d @ curvature @ d + slope @ d, np.zeros(5), jac=lambda d: curvature @ d + slope,
        constraints={"type": "ineq", "fun": lambda d: b - a @ d, "jac": lambda _: -a}, method="SLSQP",
        options={"ftol": 1e-12, "maxiter": 500},
    )  # fmt: skip
    np.testing.assert_allclose(found, other.x, atol=1e-5)
    assert constrained_step(curvature, slope, np.array([a[0], -a[0]]), np.array([-1.0, 0.5])) is None


@pytest.mark.parametrize("name", ["simple", "camera"])
def test_no_maximum_of_scipy_is_higher(name):
    problem = form(name)
    found, width = best_fit(problem, seeded()), problem.prior.width
    begin = problem.coordinates(found.optima[0])

    def cost(steps):
        score = density.log_posterior(problem, (begin + width * steps)[None])[0]
        return -score if np.isfinite(score) else 1e10

    assert -cost(np.zeros(begin.size)) == found.log_posterior[0]
    truth = (problem.coordinates(truth_of(problem)) - begin) / width
    options = {"maxfev": 1200, "xatol": 1e-4, "fatol": 1e-7, "adaptive": True}
    other = -minimize(cost, truth, method="Nelder-Mead", options=options).fun
    assert found.log_posterior[0] - 1.0 < other < found.log_posterior[0] + 1e-4
    assert found.log_likelihood == pytest.approx(density.log_likelihood(problem, begin[None])[0][0], abs=1e-9)
    made = density.cells(problem, begin[None])
    for k, item in enumerate(problem.observables):
        wanted = np.sqrt(np.nanmean((problem.rows.y[:, k] - made.mean[0, :, k]) ** 2))
        assert found.rms[item.column.name] == pytest.approx(wanted, rel=1e-12)


def test_long_tables_by_parts_end_at_the_same_maximum(monkeypatch):
    problem = line_problem(60, noise=0.0)
    whole, tall = best_fit(problem, seeded()), form("levels")
    other = best_fit(tall, seeded())
    monkeypatch.setattr(search, "FIRST", 6)
    monkeypatch.setattr(search, "GROWTH", 2)
    assert [len(part.rows.y) for part in search._growing(problem, seeded())] == [6, 12, 24, 60]
    for one, before in ((problem, whole), (tall, other)):
        monkeypatch.setattr(density, "AT_ONCE", 400)
        assert best_fit(one, seeded()).log_posterior[0] == pytest.approx(before.log_posterior[0], abs=1e-5)


def test_the_same_seed_gives_the_same_bytes_and_another_the_same_maximum():
    problem = form("simple")
    one, two, three = (best_fit(problem, seeded(seed)) for seed in (3, 3, 4))
    assert one == two and one != three
    assert one.log_posterior[0] == pytest.approx(three.log_posterior[0], abs=1e-6)


def test_a_better_place_known_beside_is_taken(monkeypatch):
    problem = line_problem(noise=0.0)
    found = best_fit(problem, seeded())
    monkeypatch.setattr(search, "_optima", lambda _problem, x: (x, Objective(problem).cost(x)))
    again = best_fit(problem, seeded(), [found.optima[0]])
    assert again.optima[-1] == pytest.approx(found.optima[0], rel=1e-12)


def test_a_model_without_an_answer():
    problem = problem_of(table_of(REBOUND), scene_of(), "two-mass", fix={"mass_ratio": 0.4, "cor_10": 0.9})
    with pytest.raises(FitError) as caught:
        best_fit(problem, seeded())
    assert caught.value.code == "no-answer"
