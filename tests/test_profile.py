"""Profile likelihoods against classical intervals, likelihoods written down, scipy's constrained
search.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from scipy.optimize import minimize
from support.density import REBOUND, near, problem_of, scene_of, table_of, truth_of
from support.fits import best, bounded, drops_of, line

from fitball.inference.judgement import profile
from fitball.inference.judgement.profile import likelihood_drops, profiles
from fitball.inference.learnt import learnt
from fitball.inference.search.objective import Objective, descend

SPEEDS = np.linspace(5.0, 17.0, 7)
DESIGN = np.stack([SPEEDS, SPEEDS - 10.0], axis=1)


def wells(v_x1, v_y1, omega_1, ball, a="normal(0, 10)", c="normal(0, 10)"):
    """A model with two optima, near a = 1 and a = -1."""
    level = 0.7 + 0.1 * (a * a - 1.0)
    return v_x1, v_y1 * level + c * a * (v_y1 - 10.0), omega_1


def dropped(function, y, speeds=SPEEDS, **choices):
    return drops_of(function, speeds, y, **choices)


def from_values(problem, *rows):
    """Coordinates (rows, free) to search from."""
    starts = [problem.coordinates({"v_y_sd": 0.05, **row}) for row in rows]
    return np.array(starts)


def noisy(seed, count=7):
    return np.random.default_rng(seed).standard_normal(count) * 0.05


def drop_of(increase, squares, noise):
    """Of the log likelihood of seven rows where the sum of squares grows, with the noise fitted
    or fixed.
    """
    if noise is None:
        return 3.5 * np.log1p(increase / squares)
    return 0.5 * increase / noise**2


# What is known before, however well, is left aside.
@pytest.mark.parametrize("noise", [None, 0.05])
@pytest.mark.parametrize("prior", [{}, {"a": "normal(0.7, 1e-5)"}])
def test_intervals_of_a_line_are_the_classical_ones(noise, prior):
    y = DESIGN @ [0.7, -0.02] + noisy(1)
    fix = {} if noise is None else {"v_y_sd": noise}
    problem = dropped(line, y, prior=prior, fix=fix)
    start = from_values(problem, {"a": 0.5, "b": 0.1})
    by_name, _, why = profiles(problem, start)
    assert why == ""
    inverse = np.linalg.inv(DESIGN.T @ DESIGN)
    best = inverse @ DESIGN.T @ y
    residuals = y - DESIGN @ best
    squares = np.sum(residuals**2)
    scale = np.sqrt(squares / 5.0)
    law = stats.t(5, 0.0, scale) if noise is None else stats.norm(0.0, noise)
    reach_68 = np.array(law.interval(0.6826894921))
    reach_95 = np.array(law.interval(0.95))
    for k, name in enumerate(("a", "b")):
        profile = by_name[name]
        size = np.sqrt(inverse[k, k])
        ends_68 = np.subtract(profile.interval_68, best[k])
        ends_95 = np.subtract(profile.interval_95, best[k])
        # A crossing between two points is linear in the root of the drop.
        assert_allclose(ends_68, size * reach_68, rtol=0.03)
        assert_allclose(ends_95, size * reach_95, rtol=0.01)
        increase = ((profile.values - best[k]) / size) ** 2
        exact = drop_of(increase, squares, noise)
        assert_allclose(profile.drop, exact, atol=2e-3)
        assert np.all(np.diff(profile.values) > 0.0)
        assert profile.drop.min() == 0.0
    if noise is None:
        # n ln(s/s0) + n (s0^2/s^2 - 1)/2.
        profile = by_name["v_y_sd"]
        ratio = np.sqrt(squares / 7.0) / profile.values
        exact = 3.5 * (ratio**2 - 1.0) - 7.0 * np.log(ratio)
        assert_allclose(profile.drop, exact, atol=2e-3)


def squares_beside(y, columns):
    """Sums of squares (tables,) of what some columns of the design leave of y (tables, rows)."""
    projection = columns @ np.linalg.pinv(columns)
    return np.sum((y - y @ projection) ** 2, axis=1)


def test_the_drop_covers_with_seven_rows_and_that_of_many_does_not():
    rng = np.random.default_rng(5)
    y = 0.05 * rng.standard_normal((4000, 7))
    of_both = squares_beside(y, DESIGN)
    # With a held at the truth, zero.
    of_b = squares_beside(y, DESIGN[:, 1:])
    drop = 3.5 * np.log(of_b / of_both)
    problem = dropped(line, y[0])
    drop_68, drop_95 = likelihood_drops(problem)
    # Three standard errors of 4000 are 1 %.
    assert np.mean(drop < drop_95) == pytest.approx(0.95, abs=0.01)
    assert np.mean(drop < drop_68) == pytest.approx(0.683, abs=0.022)
    assert np.mean(drop < 1.92) < 0.90
    of_known_noise = dropped(line, y[0], fix={"v_y_sd": 0.05})
    classical = 0.5 * stats.chi2(1).ppf(0.95)
    assert likelihood_drops(of_known_noise)[1] == pytest.approx(classical)


def squares_of_wells(y, a, c):
    """Sums of squares for values (values,) of a."""
    _, v_y2, _ = wells(0.0, SPEEDS, 0.0, None, a[:, None], c)
    return np.sum((y - v_y2) ** 2, axis=1)


# Wells apart by a barrier that no search passes, and one that it does.
@pytest.mark.parametrize(
    ("c", "sd", "starts"),
    [
        (0.003, 0.05, (1.0, -1.0)),
        (0.08, 1.0, (-1.0,)),
    ],
)
def test_two_optima_the_highest_counts_wherever_the_search_began(c, sd, starts):
    noise = sd / 0.05 * noisy(2)
    y = SPEEDS * 0.7 + c * (SPEEDS - 10.0) + noise
    problem = dropped(wells, y, fix={"c": c})
    rows = [{"a": a} for a in starts]
    by_name = profiles(problem, from_values(problem, *rows)).by_name
    profile = by_name["a"]
    low, high = profile.interval_95
    assert low < -0.9
    assert high > 1.0
    grid = np.linspace(-2.0, 2.0, 20001)
    least = squares_of_wells(y, grid, c).min()
    squares = squares_of_wells(y, profile.values, c)
    assert_allclose(profile.drop, 3.5 * np.log(squares / least), atol=2e-3)
    # The noise of the better one.
    profile = by_name["v_y_sd"]
    best = profile.values[np.argmin(profile.drop)]
    assert best == pytest.approx(np.sqrt(least / 7.0), rel=1e-3)


def test_every_profile_has_both_of_two_mirrored_wells():
    """The same with both signs changed: each of the two is nothing by itself."""
    y = SPEEDS * 0.7 + 0.1 * (SPEEDS - 10.0) + noisy(2)
    problem = dropped(wells, y)
    first = {"a": 1.0, "c": 0.1}
    second = {"a": -1.0, "c": -0.1}
    by_name = profiles(problem, from_values(problem, first, second)).by_name
    for name in ("a", "c"):
        low, high = by_name[name].interval_95
        assert low == pytest.approx(-high, rel=0.03)
        assert high > 0.1


def two_mass(count=21, seed=0, scene=None, sizes=(0.1, 0.1, 4.0), **values):
    """Impacts of a ball with other values."""
    table = table_of(REBOUND, count=count)
    problem = problem_of(table, scene, "two-mass")
    truth = {**truth_of(problem), **values}
    values = problem.values(problem.coordinates(truth)[None])
    rebound = problem.rebounds(values)
    rng = np.random.default_rng(seed)
    columns = dict(table.values)
    for name, sd in zip(REBOUND, sizes, strict=True):
        noise = sd * rng.standard_normal(count)
        columns[name] = rebound.column(name)[0] + noise
    return problem_of(replace(table, values=columns), scene, "two-mass"), truth


def test_along_a_wall_the_profile_is_scipys():
    problem, truth = two_mass(mass_ratio=0.78, seed=3)
    objective = Objective(problem, penalised=False)
    x, _, _ = descend(objective, problem.coordinates(truth)[None])
    by_name = profiles(problem, x).by_name
    profile = by_name["mass_ratio"]
    free = list(problem.free)
    k = free.index("mass_ratio")
    wall = free.index("cor_10")
    others = np.delete(np.arange(len(free)), k)
    width = problem.prior.width[others]
    lowest = objective.cost(x)[0]
    for end in (0, -1):
        start = x[0].copy()
        start[k] = profile.values[end]
        start[wall] = min(start[wall], start[k] - 1e-3)

        def moved(steps, start=start):
            q = start.copy()
            q[others] += steps * width
            return q

        def cost(steps, moved=moved):
            return objective.cost(moved(steps)[None])[0]

        def room(steps, moved=moved):
            q = moved(steps)
            return q[k] - q[wall] - 1e-9

        scipys = minimize(
            cost,
            np.zeros(len(others)),
            method="SLSQP",
            constraints={"type": "ineq", "fun": room},
            options={"ftol": 1e-9},
        )
        assert profile.drop[end] == pytest.approx(scipys.fun - lowest, abs=5e-3)
    # The lower end was held by the restitution.
    assert start[wall] < start[k]
    low, high = profile.interval_95
    assert low < 0.78 < high


def ended(v_x1, v_y1, omega_1, ball, a="uniform(0.5, 2)", b="uniform(0, 2)"):
    """Drops of one speed show the product alone; there is no answer from b = 0.9 on."""
    return v_x1, np.where(b < 0.9, a * b * v_y1, np.nan), omega_1


def test_along_a_ridge_profiles_go_to_the_end_of_the_model():
    speeds = np.full(7, 10.0)
    y = speeds * 0.7 + 2.0 * noisy(1)
    problem = dropped(ended, y, speeds)
    by_name = profiles(problem, from_values(problem, {"a": 1.0, "b": 0.7})).by_name
    highest = by_name["b"].values[-1]
    assert by_name["b"].interval_95[1] is None
    assert 0.9 - 0.01 * (0.9 - 0.7) < highest < 0.9
    assert by_name["b"].drop[-1] == pytest.approx(0.0, abs=2e-3)

    def crossing(other):
        """Where the drop with the other parameter at its end is that of the 95 % level."""
        least = np.sum((y - y.mean()) ** 2)
        drop = likelihood_drops(problem)[1]
        off = np.sqrt(least * np.expm1(drop / 3.5) / 7.0)
        return (y.mean() - off) / (10.0 * other)

    low, high = by_name["a"].interval_95
    # Searches creep along the end of the model: within 2 % of the way.
    assert low == pytest.approx(crossing(0.9), abs=0.02 * (1.0 - 0.77))
    assert high is None
    low, _ = by_name["b"].interval_95
    assert low == pytest.approx(crossing(2.0), rel=2e-3)


def test_a_best_value_at_its_bound_is_open_there():
    y = DESIGN @ [0.7, -0.02] + noisy(1)
    problem = dropped(bounded, y)
    by_name = profiles(problem, from_values(problem, {"a": 0.5, "b": 0.1})).by_name
    low, high = by_name["b"].interval_95
    assert low is None
    assert 0.0 < high < 0.02
    best = np.argmin(by_name["b"].drop)
    assert by_name["b"].values[best] == 0.0
    assert None not in by_name["a"].interval_95


def test_what_was_measured_beside_the_table_stays():
    without = problem_of(table_of(REBOUND), None, "two-mass")
    by_name = profiles(without, near(without, 1, 0.0)).by_name
    assert by_name["k_y"].interval_95 == (None, None)
    scene = scene_of(camera=True, time=True)
    problem = problem_of(table_of(REBOUND), scene, "two-mass")
    by_name = profiles(problem, near(problem, 1, 0.0)).by_name
    drop_68, drop_95 = likelihood_drops(problem)
    # Eight parameters, of which the contact time shows one; the camera's are stated.
    quantile = stats.t(23).ppf(0.975)
    assert drop_95 == pytest.approx(15.0 * np.log1p(quantile**2 / 23.0))
    reach = np.sqrt(2.0 * drop_68)
    # A contact time known to 10 % goes with one over the root of the stiffness.
    low, high = by_name["k_y"].interval_68
    half = 0.5 * np.log(high / low)
    assert half == pytest.approx(0.2 * reach, rel=0.05)
    low, high = by_name["clock"].interval_68
    half = 0.5 * (high - low)
    assert half == pytest.approx(0.001 * reach, rel=0.05)


def test_some_tables_have_none():
    """Long ones, those without noise, and those with fewer rows than parameters."""
    truth = {"a": 0.7, "b": 0.0}
    y = np.tile(DESIGN @ [0.7, -0.02], 50)
    long = dropped(line, y + noisy(1, 350), np.tile(SPEEDS, 50))
    by_name = profiles(long, from_values(long, truth)).by_name
    assert by_name == {}
    exact = dropped(line, DESIGN @ [0.7, -0.02])
    by_name, _, why = profiles(exact, from_values(exact, truth))
    assert by_name == {}
    assert "v_y_sd" in why
    short = dropped(line, y[:2], SPEEDS[:2])
    assert likelihood_drops(short) == ()
    by_name = profiles(short, from_values(short, truth)).by_name
    assert by_name == {}


def misled(problem, draws):
    """The learnt law of a problem as it must not be: all rebounds lie half a metre a second off."""
    law = learnt(problem, draws)
    offsets = law.rows.learnt._replace(at_centre=law.rows.learnt.at_centre + 0.5)
    return replace(law, rows=replace(law.rows, learnt=offsets))


@pytest.mark.parametrize("law", [learnt, misled])
def test_profiles_by_a_learnt_law_are_those_of_the_exact_likelihood(monkeypatch, law):
    problem = problem_of(table_of(REBOUND, "corr", count=20), scene_of(), "grip-slip")
    start = best(problem)[None]
    monkeypatch.setattr(profile, "learnt", lambda problem, draws: problem)
    exact = profiles(problem, start).by_name
    monkeypatch.setattr(profile, "learnt", law)
    found = profiles(problem, start).by_name
    for name, parameter in zip(problem.free, problem.prior.parameters, strict=True):
        ends, expected = (
            np.array([each.interval_68, each.interval_95], dtype=np.float64)
            for each in (found[name], exact[name])
        )
        assert_array_equal(np.isnan(ends), np.isnan(expected))
        prior = parameter.prior
        width = np.nanmin([*np.ptp(prior.coordinate(expected), axis=1), prior.width])
        off = prior.coordinate(ends) - prior.coordinate(expected)
        assert np.nanmax(np.abs(off), initial=0.0) < 0.02 * width, name
