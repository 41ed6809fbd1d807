"""Derived quantities against formulas of the field, the second edition's numbers, and scipy."""

import numpy as np
import pytest
from made_tables import bundled, made
from scipy import stats
from support.density import REBOUND, problem_of, scene_of, table_of, truth_of

from fitball.data.scene import BallSection, Scene
from fitball.inference.derived import anchored, differences, parameter
from fitball.inference.forward import Draws

# Fitted by the second edition to wang_all.csv.
WANG = {
    "mass_ratio": 0.885262676,
    "k_y": 19067.1004,
    "k_theta": 18.3410452,
    "mu": 0.569316969,
    "eps_10": 0.00237668043,
    "eps_slope": -1.33053149e-06,
    "cor_10": 0.776418697,
    "cor_slope": -0.0156190736,
}


def found_in(problem):
    return {one.spec.name: one for one in problem.derived}


def at(problem, values):
    fixed = {item.spec.name: item.fixed for item in problem.parameters if item.fixed is not None}
    return {
        name: np.atleast_1d(np.asarray(value, float)) for name, value in {**fixed, **values}.items()
    }


def grip_slip(v_x, v_y, omega=0.0, labels=None, scene=None, **columns):
    """A table of grip-slip whose rebounds do not matter."""
    size = np.size(v_y)
    columns = columns or {
        "v_x2": np.full(size, 1.0),
        "v_y2": 0.7 * np.asarray(v_y),
        "omega_2": np.ones(size),
    }
    table = made({"v_x1": v_x, "v_y1": v_y, "omega_1": omega, **columns}, labels=labels or {})
    return problem_of(table, scene)


FAST = np.linspace(6.0, 12.0, 10)
SLIDING = {"mu": 0.3, "e_x": 0.1, "offset": 0.0, "cor_10": 0.78, "cor_slope": 0.0}


def test_the_second_editions_numbers():
    problem = problem_of(
        bundled("wang_all.csv", ("v_x1", "v_y1", "omega_1", *REBOUND)),
        None,
        "two-mass",
    )
    found = found_in(problem)
    values = at(problem, {**WANG, "k_y": [19067.1004, 1.0]})
    values = {name: np.broadcast_to(value, 2) for name, value in values.items()}
    np.testing.assert_allclose(
        found["k_theta/k_y"].rule(values),
        [18.3410452 / 19067.1004, 18.3410452],
    )
    assert found["court_pace"].rule(values)[0] == pytest.approx(44.127846906, abs=1e-5)
    assert found["court_pace"].extrapolated
    assert {*found} == {"k_theta/k_y", "court_pace"}


@pytest.mark.parametrize("temperature", [None, 13.0])
def test_pace_of_a_sliding_ball_is_the_itfs_formula(temperature):
    scene = Scene(ball=BallSection(temperature=temperature))
    problem = grip_slip(3.0 * FAST, FAST, scene=scene)
    rating = found_in(problem)["court_pace"].rule(at(problem, SLIDING))
    warmer = 0.0 if temperature is None else 0.003 * 10.0
    assert rating == pytest.approx(100.0 * 0.7 + 150.0 * (0.81 - 0.78 - warmer))


def test_pace_is_asked_of_tennis_balls_at_such_speeds():
    assert "court_pace" in found_in(grip_slip(8.0 * FAST, FAST))
    assert "court_pace" not in found_in(grip_slip(0.5 * FAST, 0.9 * FAST))
    assert "court_pace" not in found_in(grip_slip(14.0 * FAST, FAST))
    heavy = Scene(ball=BallSection(mass=0.06))
    assert "court_pace" not in found_in(grip_slip(3.0 * FAST, FAST, scene=heavy))
    near = grip_slip(
        np.linspace(27.0, 31.0, 10),
        8.27 + 0.3 * np.tile([-1.0, 1.0], 5),
        np.tile([-9, 9], 5),
    )
    assert not found_in(near)["court_pace"].extrapolated


def test_a_drop_test_is_rated_by_its_rebound():
    speed = np.linspace(6.0, 12.0, 6)
    problem = grip_slip(0.0, speed, v_y2=0.75 * speed)
    found = found_in(problem)
    assert {*found} >= {"cor_254cm", "rebound_254cm"}
    assert "court_pace" not in found
    values = at(
        problem,
        {"cor_10": [0.745, 0.76], "cor_slope": [0.0, 0.0], "mass_ratio": [0.9, 0.9]},
    )
    values = {name: np.broadcast_to(value, 2) for name, value in values.items()}
    np.testing.assert_allclose(found["cor_254cm"].rule(values), [0.745, 0.76])
    np.testing.assert_allclose(found["rebound_254cm"].rule(values), 2.54 * np.square([0.745, 0.76]))
    assert not found["rebound_254cm"].extrapolated
    assert found_in(grip_slip(0.0, speed + 6.0, v_y2=speed))["cor_254cm"].extrapolated


def test_what_was_not_measured_at_ten_metres_a_second_has_a_value_at_the_median():
    slow = np.linspace(0.8, 2.7, 8)
    problem = grip_slip(2.0 * slow, slow)
    assert anchored(problem.forward, problem.calibrated) == {"cor_10"}
    cor = found_in(problem)["cor_median"]
    values = at(problem, {**SLIDING, "cor_slope": -0.01})
    states = problem.rows.states
    rebound = problem.forward.rebound(values, states).v_y2[0] / states.v_y1
    assert cor.rule(values)[0] == pytest.approx(np.interp(1.75, slow, rebound), rel=1e-4)
    assert not cor.extrapolated
    problem = problem_of(table_of(REBOUND), scene_of(time=True), "two-mass")
    assert anchored(problem.forward, problem.calibrated) == frozenset()
    same = dict.fromkeys(("v_y1", "v_x2", "omega_2"), slow)
    problem = problem_of(
        made({**same, "v_x1": 2.0 * slow, "omega_1": 0.0, "v_y2": 0.7 * slow}),
        None,
        "two-mass",
    )
    found = found_in(problem)
    assert anchored(problem.forward, problem.calibrated) == {"cor_10", "eps_10"}
    offset = found["eps_median"].rule(at(problem, {**WANG, "eps_slope": 1e-4}))
    assert offset[0] == pytest.approx(0.00237668043 + (1.75 - 10.0) * 1e-4)


def test_each_level_has_its_own_and_is_judged_by_itself():
    both = {"surface": ("clay",) * 8 + ("hard",) * 8}
    v_y = np.concatenate([np.linspace(1.0, 3.0, 8), np.linspace(7.0, 12.0, 8)])
    problem = grip_slip(3.0 * v_y, v_y, labels=both)
    assert {level.parameter for level in problem.forward.levels} == {"mu", "cor_10"}
    assert anchored(problem.forward, problem.calibrated) == {"cor_10[clay]"}
    found = found_in(problem)
    assert {*found} == {
        "cor_median[clay]",
        "cor_median[hard]",
        "court_pace[clay]",
        "court_pace[hard]",
    }
    own = {"mu[clay]": 0.3, "mu[hard]": 0.25, "cor_10[clay]": 0.7, "cor_10[hard]": 0.8}
    values = at(problem, {**SLIDING, **own})
    assert found["court_pace[hard]"].rule(values) == pytest.approx(75.0 + 150.0 * 0.01)
    assert found["cor_median[clay]"].rule(values) == pytest.approx(0.7)
    # The median of all lies between the surfaces.
    assert found["cor_median[clay]"].extrapolated
    assert found["cor_median[hard]"].extrapolated
    spec = problem.prior.parameters[1].spec
    assert parameter(spec).rule(values)[0] == own[spec.name]


def test_the_surfaces_farthest_apart_and_the_chance_of_it():
    labels = {"surface": tuple("abc" * 6)}
    problem = problem_of(
        table_of(REBOUND, count=18),
        None,
        "grip-slip",
        pool={"mu": "none", "cor_10": "none"},
    )
    assert differences(problem.forward, Draws({}, {}, {})).empty
    v_y = np.linspace(6.0, 14.0, 18)
    problem = grip_slip(3.0 * v_y, v_y, labels=labels)
    rng = np.random.default_rng(4)
    point = truth_of(problem) | {"mu[a]": 0.60, "mu[b]": 0.50, "mu[c]": 0.58}
    draws = {name: value + 0.04 * rng.standard_normal(20000) for name, value in point.items()}
    row = differences(problem.forward, Draws(point, draws, {})).loc["mu"]
    assert (row["low"], row["high"], row["column"]) == ("b", "a", "surface")
    law = stats.norm(0.1, 0.04 * np.sqrt(2.0))
    assert row["difference"] == pytest.approx(0.1, abs=2e-3)
    assert row["sd"] == pytest.approx(
        law.std(),
        rel=0.03,
    )
    # Three pairs, on either side.
    assert row["p"] == pytest.approx(2.0 * 3.0 * law.cdf(0.0), rel=0.1)
    none = differences(
        problem.forward,
        Draws(point, {name: np.empty(0) for name in point}, {}),
    ).loc["mu"]
    assert none["difference"] == pytest.approx(0.1)
    assert np.isnan(none["p"])
    assert np.isnan(none["sd"])
