"""Profile likelihoods against classical intervals, likelihoods written down, scipy's constrained
search.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats
from scipy.optimize import minimize
from support.density import REBOUND, near, problem_of, scene_of, table_of, truth_of
from support.fits import bounded, drops_of, line

from fitball.inference.judgement.profile import drops, profiles
from fitball.inference.search.objective import Objective, descend

SPEEDS = np.linspace(5.0, 17.0, 7)
DESIGN = np.stack([SPEEDS, SPEEDS - 10.0], axis=1)


def wells(v_x1, v_y1, omega_1, ball, a="normal(0, 10)", c="normal(0, 10)"):
    return v_x1, v_y1 * (0.7 + 0.1 * (a * a - 1.0)) + c * a * (v_y1 - 10.0), omega_1


def dropped(function, y, speeds=SPEEDS, **choices):
    return drops_of(function, speeds, y, **choices)


def from_values(problem, *rows):
    return np.array([problem.coordinates({"v_y_sd": 0.05, **row}) for row in rows])


def noisy(seed, count=7):
    return np.random.default_rng(seed).standard_normal(count) * 0.05


# What is known before, however well, is left aside.
@pytest.mark.parametrize("noise", [None, 0.05])
@pytest.mark.parametrize("prior", [{}, {"a": "normal(0.7, 1e-5)"}])
def test_intervals_of_a_line_are_the_classical_ones(noise, prior):
    y = DESIGN @ [0.7, -0.02] + noisy(1)
    problem = dropped(line, y, prior=prior, fix={} if noise is None else {"v_y_sd": noise})
    found, why = profiles(problem, from_values(problem, {"a": 0.5, "b": 0.1}))
    assert why == ""
    inverse = np.linalg.inv(DESIGN.T @ DESIGN)
    best = inverse @ DESIGN.T @ y
    squares = np.sum((y - DESIGN @ best) ** 2)
    law = stats.t(5, 0.0, np.sqrt(squares / 5.0)) if noise is None else stats.norm(0.0, noise)
    for k, name in enumerate(("a", "b")):
        profile = found[name]
        for share, ends in ((0.6826894921, profile.interval_68), (0.95, profile.interval_95)):
            reach = law.ppf(0.5 + 0.5 * share) * np.sqrt(inverse[k, k])
            # A crossing between two points is linear in the root of the drop.
            assert_allclose(
                np.subtract(ends, best[k]),
                [-reach, reach],
                rtol=0.03 if share < 0.9 else 0.01,
            )
        more = (profile.values - best[k]) ** 2 / inverse[k, k]
        exact = 3.5 * np.log1p(more / squares) if noise is None else 0.5 * more / noise**2
        assert_allclose(profile.drop, exact, atol=2e-3)
        assert np.all(np.diff(profile.values) > 0.0)
        assert profile.drop.min() == 0.0
    if noise is None:
        # n ln(s/s0) + n (s0^2/s^2 - 1)/2.
        profile = found["v_y_sd"]
        size = np.sqrt(squares / 7.0)
        exact = 7.0 * np.log(profile.values / size) + 3.5 * ((size / profile.values) ** 2 - 1.0)
        assert_allclose(profile.drop, exact, atol=2e-3)


def test_the_drop_covers_with_seven_rows_and_that_of_many_does_not():
    rng = np.random.default_rng(5)
    y = 0.05 * rng.standard_normal((4000, 7))
    left = np.sum((y - y @ DESIGN @ np.linalg.inv(DESIGN.T @ DESIGN) @ DESIGN.T) ** 2, axis=1)
    known = np.sum(
        (y - y @ np.outer(DESIGN[:, 1], DESIGN[:, 1]) / np.sum(DESIGN[:, 1] ** 2)) ** 2,
        axis=1,
    )
    # Of a held at the truth.
    drop = 3.5 * np.log(known / left)
    problem = dropped(line, y[0])
    # Three standard errors of 4000 are 1 %.
    assert np.mean(drop < drops(problem)[1]) == pytest.approx(0.95, abs=0.01)
    assert np.mean(drop < drops(problem)[0]) == pytest.approx(0.683, abs=0.022)
    assert np.mean(drop < 1.92) < 0.90
    assert drops(dropped(line, y[0], fix={"v_y_sd": 0.05}))[1] == pytest.approx(
        0.5 * stats.chi2(1).ppf(0.95)
    )


def of_wells(y, a, c):
    return np.sum((y - SPEEDS * (0.7 + 0.1 * (a * a - 1.0)) - c * a * (SPEEDS - 10.0)) ** 2)


# Wells apart by a barrier that no search passes, and one that it does.
@pytest.mark.parametrize(("c", "sd", "starts"), [(0.003, 0.05, (1.0, -1.0)), (0.08, 1.0, (-1.0,))])
def test_two_optima_the_highest_counts_wherever_the_search_began(c, sd, starts):
    y = SPEEDS * 0.7 + c * (SPEEDS - 10.0) + sd / 0.05 * noisy(2)
    problem = dropped(wells, y, fix={"c": c})
    found, _ = profiles(problem, from_values(problem, *({"a": a} for a in starts)))
    profile = found["a"]
    low, high = profile.interval_95
    assert low < -0.9
    assert high > 1.0
    squares = np.array([of_wells(y, a, c) for a in profile.values])
    least = min(of_wells(y, a, c) for a in np.linspace(-2.0, 2.0, 20001))
    assert_allclose(profile.drop, 3.5 * np.log(squares / least), atol=2e-3)
    # The noise of the better one.
    at = found["v_y_sd"].values[np.argmin(found["v_y_sd"].drop)]
    assert at == pytest.approx(np.sqrt(least / 7.0), rel=1e-3)


def test_mirrored_wells_are_found_by_every_profile():
    """The same with both signs changed: each of the two is nothing by itself."""
    y = SPEEDS * 0.7 + 0.1 * (SPEEDS - 10.0) + noisy(2)
    problem = dropped(wells, y)
    found, _ = profiles(problem, from_values(problem, {"a": 1.0, "c": 0.1}, {"a": -1.0, "c": -0.1}))
    for name in ("a", "c"):
        low, high = found[name].interval_95
        assert low == pytest.approx(-high, rel=0.03)
        assert high > 0.1


def two_mass(count=21, seed=0, scene=None, sizes=(0.1, 0.1, 4.0), **values):
    """Impacts of a ball with other values."""
    table = table_of(REBOUND, count=count)
    problem = problem_of(table, scene, "two-mass")
    truth = {**truth_of(problem), **values}
    rebound = problem.seen(problem.values(problem.coordinates(truth)[None]))
    rng = np.random.default_rng(seed)
    made_of = {
        n: rebound.column(n)[0] + s * rng.standard_normal(count)
        for n, s in zip(REBOUND, sizes, strict=True)
    }
    return problem_of(replace(table, values={**table.values, **made_of}), scene, "two-mass"), truth


def test_along_a_wall_the_profile_is_scipys():
    problem, truth = two_mass(mass_ratio=0.78, seed=3)
    x, _, _ = descend(Objective(problem, penalised=False), problem.coordinates(truth)[None])
    found, _ = profiles(problem, x)
    profile = found["mass_ratio"]
    free = list(problem.free)
    k = free.index("mass_ratio")
    wall = free.index("cor_10")
    others = np.delete(np.arange(len(free)), k)
    width = problem.prior.width
    lowest = Objective(problem, penalised=False).cost(x)[0]
    for point in (0, -1):
        held = x[0].copy()
        held[k] = profile.values[point]
        held[wall] = min(held[wall], held[k] - 1e-3)

        def at(u, held=held):
            q = held.copy()
            q[others] += u * width[others]
            return q

        def cost(u, at=at):
            return Objective(problem, penalised=False).cost(at(u)[None])[0]

        kept = {"type": "ineq", "fun": lambda u, at=at: at(u)[k] - at(u)[wall] - 1e-9}
        scipys = minimize(
            cost,
            np.zeros(len(others)),
            method="SLSQP",
            constraints=kept,
            options={"ftol": 1e-9},
        )
        assert profile.drop[point] == pytest.approx(scipys.fun - lowest, abs=5e-3)
    # The lower end was held by the restitution.
    assert held[wall] < held[k]
    low, high = profile.interval_95
    assert low < 0.78 < high


def test_a_best_value_at_its_bound_is_open_there():
    y = DESIGN @ [0.7, -0.02] + noisy(1)
    problem = dropped(bounded, y)
    found, _ = profiles(problem, from_values(problem, {"a": 0.5, "b": 0.1}))
    low, high = found["b"].interval_95
    assert low is None
    assert 0.0 < high < 0.02
    assert found["b"].values[np.argmin(found["b"].drop)] == 0.0
    assert None not in found["a"].interval_95


def test_what_was_measured_beside_the_table_stays():
    free = problem_of(table_of(REBOUND), None, "two-mass")
    assert profiles(free, near(free, 1, 0.0))[0]["k_y"].interval_95 == (None, None)
    problem = problem_of(table_of(REBOUND), scene_of(camera=True, time=True), "two-mass")
    found, _ = profiles(problem, near(problem, 1, 0.0))
    # Eight parameters, of which the contact time shows one; the camera's are stated.
    assert drops(problem)[1] == pytest.approx(15.0 * np.log1p(stats.t(23).ppf(0.975) ** 2 / 23.0))
    reach = np.sqrt(2.0 * drops(problem)[0])
    # A contact time known to 10 % goes with one over the root of the stiffness.
    low, high = found["k_y"].interval_68
    assert 0.5 * np.log(high / low) == pytest.approx(0.2 * reach, rel=0.05)
    low, high = found["clock"].interval_68
    assert 0.5 * (high - low) == pytest.approx(0.001 * reach, rel=0.05)


def test_some_tables_have_none():
    y = np.tile(DESIGN @ [0.7, -0.02], 50)
    problem = dropped(line, y + noisy(1, 350), np.tile(SPEEDS, 50))
    assert profiles(problem, from_values(problem, {"a": 0.7, "b": 0.0}))[0] == {}
    problem = dropped(line, DESIGN @ [0.7, -0.02])
    found, why = profiles(problem, from_values(problem, {"a": 0.7, "b": 0.0}))
    assert found == {}
    assert "v_y_sd" in why
    problem = dropped(line, y[:2], SPEEDS[:2])
    assert drops(problem) == ()
    assert profiles(problem, from_values(problem, {"a": 0.7, "b": 0.0}))[0] == {}
