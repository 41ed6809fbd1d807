"""Alternatives against whole searches, left-out scores and shifts of constants against real
refits.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from support.density import REBOUND, TRUTH, near, problem_of, scene_of, table_of
from support.fits import NOISE, at, best

from fitball.data.scene import BallSection, CameraSection, Scene
from fitball.inference.density import log_posterior, pointwise
from fitball.inference.derived import Quantity
from fitball.inference.judgement import assumptions as module
from fitball.inference.judgement.assumptions import alternatives, given, left_out
from fitball.inference.judgement.constants import constants
from fitball.inference.judgement.first_order import first_order, proposal
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.inference.sampling.importance import importance
from fitball.inference.schema import Alternative, Constant, Summary
from fitball.inference.search.best_fit import best_fit
from fitball.inference.search.objective import Objective, descend


def tried(problem, seed=1):
    # A kink may stop this search, as it may stop any.
    point = at(problem, descend(Objective(problem), near(problem, 1, 0.0))[0][0])
    return {one.choice: one for one in alternatives(problem, point, np.random.default_rng(seed))[0]}


@pytest.fixture(scope="module")
def two_mass():
    problem = problem_of(
        table_of(REBOUND, count=30),
        scene_of(time=True),
        "two-mass",
        fix={"k_theta": 19.0},
    )
    return problem, tried(problem)


def test_each_choice_is_changed_by_itself(two_mass):
    _, found = two_mass
    assert {*found} == {
        "normal=inner",
        "normal=total",
        "offset=grip",
        "torsion=free",
        "inertia=table",
        "spin=shell",
        "release=zero_displacement",
        "noise=student-t",
    }
    for one in found.values():
        assert not one.reason
        assert one.values["k_theta"] == 19.0
        assert one.instead_of.partition("=")[0] == one.choice.partition("=")[0]
    assert found["offset=grip"].model == "two-mass+offset=grip"
    assert "zeta_theta" in found["torsion=free"].summaries
    # The scale of another kind of noise is another quantity.
    assert "spin_sd" in found["offset=grip"].summaries
    assert {"spin_sd", "degrees_of_freedom"}.isdisjoint(found["noise=student-t"].summaries)
    # Impacts are of the model itself: nothing is surely better, a contact point that is the shell's
    # is worse.
    assert not any(one.score > 4.0 and one.score > 2.0 * one.error for one in found.values())
    assert found["spin=shell"].score < -4.0


@pytest.mark.parametrize("choice", ["offset=grip", "normal=total"])
def test_a_quick_fit_is_the_best_of_all_searches(two_mass, choice):
    problem, found = two_mass
    posed = build_problem(
        problem.table,
        problem.scene,
        Choices(found[choice].model, fix={"k_theta": 19.0}),
    )
    whole = best_fit(posed, np.random.default_rng(3))
    quick = log_posterior(posed, posed.coordinates(found[choice].values)[None])[0]
    assert quick > whole.log_posterior[0] - 0.02
    # Not the fit's own values.
    x = posed.coordinates(at(problem, best(problem)).optima[0])
    assert log_posterior(posed, x[None])[0] < quick - 0.1


def test_a_score_is_that_of_real_refits():
    problem = problem_of(
        table_of(REBOUND, count=8, seed=3),
        None,
        "grip-slip",
        fix={**NOISE, "mu": 0.56},
    )
    x = best(problem)
    found = left_out(problem, proposal(problem, x))
    exact = np.empty(8)
    rng = np.random.default_rng(1)
    for k in range(8):
        others = problem.without(np.array([k]))
        q, weights, _ = importance(
            partial(log_posterior, others),
            [proposal(others, best(others, x))],
            rng,
            3000.0,
        )
        exact[k] = np.logaddexp.reduce(weights + pointwise(problem, q, REBOUND)[:, k])
    inside = pointwise(problem, x[None], REBOUND)[0]
    np.testing.assert_allclose(found, exact, atol=0.05 * np.max(inside - exact))


def test_outliers_ask_for_heavy_tails():
    table = table_of(REBOUND, count=80)
    tame, wild = (problem_of(one, None, "grip-slip") for one in (table, with_outliers(table)))
    tails = tried(wild)["noise=student-t"]
    none = tried(tame)["noise=student-t"]
    assert tails.score > 4.0 > abs(none.score)
    # Among five rows nothing is surely worse.
    few = tried(problem_of(table_of(REBOUND, count=5), None, "grip-slip"))["noise=student-t"]
    assert few.score is None
    assert few.as_good
    # What was stated of degrees of freedom is left behind with them.
    heavy = problem_of(
        table,
        None,
        "grip-slip",
        noise="student-t",
        prior={"degrees_of_freedom": "lognormal(5, 0.5)"},
    )
    held = problem_of(table, None, "grip-slip", noise="student-t", fix={"degrees_of_freedom": 5.0})
    assert not any(tried(one)["noise=normal"].reason for one in (heavy, held))


def with_outliers(table):
    values = {**table.values, "v_x2": table.values["v_x2"].copy()}
    values["v_x2"][::8] += 4.0 * (-1.0) ** np.arange(10)
    return replace(table, values=values)


def test_of_long_tables_a_part_says_the_same(monkeypatch):
    problem = problem_of(table_of(REBOUND, count=400), None, "grip-slip")
    whole = tried(problem)["noise=student-t"]
    monkeypatch.setattr(module, "ALTERNATIVES", 100)
    part = tried(problem)["noise=student-t"]
    for name in ("mu", "cor_10", "offset"):
        one = whole.summaries[name]
        other = part.summaries[name]
        assert other.sd == pytest.approx(one.sd, rel=0.2)
        assert abs(other.median - one.median) < 1.0 * one.sd


@pytest.mark.parametrize(
    ("name", "text", "columns", "step"),
    [
        ("inertia_ratio", "grip-slip", REBOUND, 0.002),
        ("ball_radius", "grip-slip", REBOUND, 1e-5),
        ("ball_mass", "two-mass", REBOUND, 1e-4),
        ("tilt", "grip-slip", REBOUND, 5e-4),
    ],
)
def test_a_constant_moves_values_as_a_refit_does(name, text, columns, step):
    table = table_of(columns, count=20)
    timed = scene_of(time=True).contact_time
    noises = {item.noise: TRUTH[item.noise] for item in problem_of(table, None, text).observables}

    def posed(value):
        if name == "tilt":
            return problem_of(table, Scene(camera=CameraSection(tilt=value)), text, fix=noises)
        ball = BallSection(**{name.removeprefix("ball_"): value})
        return problem_of(table, Scene(ball=ball, contact_time=timed), text, fix=noises)

    usual = {"inertia_ratio": 0.56, "ball_radius": 0.03302, "ball_mass": 0.0576, "tilt": 0.0}[name]
    problem = posed(usual)
    x = best(problem)
    first = first_order(problem, at(problem, x))
    spec = replace(problem.prior.parameters[0].spec, name="itself")
    derived = [
        *problem.derived,
        Quantity(spec, lambda values: values["mu"] + values.get(name, usual)),
    ]
    (found,) = (one for one in constants(problem, first, derived) if one.name == name)
    half = max(found.high - usual, usual - found.low)
    refits = [best(posed(usual + sign * step), x) for sign in (1.0, -1.0)]
    sds = np.linalg.norm(first.root, axis=1) * first.sds
    exact = (refits[0] - refits[1]) / (2.0 * step) * half / sds
    moved = np.array([found.moves[one] for one in problem.free])
    np.testing.assert_allclose(moved, exact, atol=0.05 * np.abs(exact).max())
    assert np.abs(exact).max() > 0.1
    # What follows from parameters moves with them, and by what the constant does to it itself.
    root = first.root * first.sds[:, None]
    small = 1e-3 * np.diag(sds)
    for one in derived:
        up, down = (
            {**posed(usual + sign * step).values(x[None]), name: np.array([usual + sign * step])}
            for x, sign in zip(refits, (1.0, -1.0), strict=True)
        )
        ends = [problem.values(x + sign * small) for sign in (1.0, -1.0)]
        slope = (one.rule(ends[0]) - one.rule(ends[1])) / (2e-3 * sds)
        expected = (
            (one.rule(up) - one.rule(down))[0] / (2.0 * step) * half / np.linalg.norm(slope @ root)
        )
        assert found.moves[one.spec.name] == pytest.approx(expected, abs=0.05 * np.abs(exact).max())
    assert "court_pace" in found.moves


def test_constants_that_act_nowhere_or_are_fitted_are_none():
    table = table_of(REBOUND, count=12)
    # A stated ball has a ratio of its own, which is fitted.
    for scene, fitted in ((None, set()), (scene_of(ball=True), {"inertia_ratio"})):
        problem = problem_of(table, scene, "grip-slip", fix=NOISE)
        found = constants(problem, first_order(problem, at(problem, best(problem))), ())
        assert {one.name for one in found} == {"ball_radius", "inertia_ratio", "tilt"} - fitted


def test_ends_of_intervals_do_not_hang_on_single_draws(two_mass):
    """Those of two streams, 95 % ends of heavy tails among them, agree far better than what a
    choice must move.
    """
    problem, found = two_mass
    other = tried(problem, seed=2)
    for name in ("offset=grip", "normal=total"):
        for one, here in found[name].summaries.items():
            there = other[name].summaries[one]
            assert abs(here.q025 - there.q025) < here.sd
            assert abs(here.q975 - there.q975) < here.sd


def test_a_choice_whose_draws_are_not_reliable_was_not_tried(monkeypatch):
    problem = problem_of(table_of(REBOUND, count=12), None, "grip-slip", fix=NOISE)
    fit = dict.fromkeys(problem.free, Summary(0.0, 0.0, 1.0, -2.0, -1.0, 1.0, 2.0))
    for reliable in (0.7, -1.0):
        monkeypatch.setattr(module, "RELIABLE", reliable)
        found = tried(problem)
        (one,) = (each for each in found.values() if each.choice == "noise=student-t")
        assert bool(one.reason) == (reliable < 0.0)
        assert bool(one.summaries) != bool(one.reason)
    assert given((one,), (), fit) == dict.fromkeys(problem.free, ("model",))


def test_what_a_value_is_given():
    def summary(median, sd=1.0):
        return Summary(
            median,
            median,
            sd,
            median - 2.0 * sd,
            median - sd,
            median + sd,
            median + 2.0 * sd,
        )

    def other(choice, instead_of, as_good=True, reason="", **values):
        return Alternative(choice, instead_of, "", {}, values, 0.0, 0.0, as_good, reason)

    fit = {"mu": summary(0.0), "e_x": summary(0.0)}
    found = (
        other("a=2", "a=1", mu=summary(2.5)),
        other("b=2", "b=1", mu=summary(-1.9)),
        other("c=2", "c=1", mu=Summary(0.0, 0.0, 1.0, -6.0, -1.0, 1.0, 2.0)),
        other("d=2", "d=1", mu=summary(0.0, 0.1)),
        other("a=3", "a=1", mu=summary(5.0), zeta=summary(9.0)),
        other("e=2", "e=1", as_good=False, mu=summary(9.0), e_x=summary(9.0)),
    )
    held = (
        Constant("radius", 0.0, 1.0, {"mu": -3.0, "e_x": 0.9}),
        Constant("mass", 0.0, 1.0, {"mu": 0.2}),
    )
    assert given(found, held, fit) == {"mu": ("a=1", "c=1", "radius")}
    missing = other("f=2", "f=1", reason="no answer")
    assert given((*found, missing), held, fit) == {
        "mu": ("a=1", "c=1", "radius", "model"),
        "e_x": ("model",),
    }


def test_a_model_without_choices_is_an_assumption_of_all_values():
    problem = problem_of(table_of(REBOUND, count=12), None, "grip-slip")
    point = at(problem, best(problem))
    found, _ = alternatives(problem, point, np.random.default_rng(1))
    far = (np.inf, -np.inf, -np.inf, np.inf, np.inf)
    fit = {name: Summary(*[point.optima[0][name]] * 2, *far) for name in problem.free}
    assert given(found, (), fit) == dict.fromkeys(problem.free, ("model",))
