"""Alternatives against whole searches, left-out scores and shifts of constants against real
refits.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import lognorm
from support.density import REBOUND, TRUTH, near, problem_of, scene_of, table_of
from support.fits import NOISE, at, best

from fitball.data.scene import BallSection, CameraSection, Scene
from fitball.inference.density import log_posterior, pointwise
from fitball.inference.derived import Quantity
from fitball.inference.judgement import assumptions as module
from fitball.inference.judgement import variant_draws
from fitball.inference.judgement.assumptions import (
    alternatives,
    what_values_rest_on,
)
from fitball.inference.judgement.constants import constants
from fitball.inference.judgement.first_order import first_order, proposal
from fitball.inference.judgement.variants import leave_one_out_density
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.inference.sampling.importance import importance
from fitball.inference.schema import Alternative, Constant, Judgement, Summary
from fitball.inference.search.best_fit import best_fit
from fitball.inference.search.objective import Objective, descend


def alternatives_of(problem, seed=1):
    """Alternatives to the choices of a problem by choice."""
    # A kink may stop this search, as it may stop any.
    optima, *_ = descend(Objective(problem), near(problem, 1, 0.0))
    point = at(problem, optima[0])
    results, _ = alternatives(problem, point, np.random.default_rng(seed))
    return {result.choice: result for result in results}


@pytest.fixture(scope="module")
def two_mass():
    problem = problem_of(
        table_of(REBOUND, count=30),
        scene_of(time=True),
        "two-mass",
        fix={"k_theta": 19.0},
    )
    return problem, alternatives_of(problem)


def test_each_choice_is_changed_by_itself(two_mass):
    _, by_choice = two_mass
    assert {*by_choice} == {
        "normal=inner",
        "normal=total",
        "offset=grip",
        "torsion=free",
        "inertia=table",
        "spin=shell",
        "release=zero_displacement",
        "cor=power",
        "cor=line",
        "cor=root",
        "noise=student-t",
    }
    for choice, alternative in by_choice.items():
        option, _, _ = choice.partition("=")
        assert not alternative.reason
        assert alternative.values["k_theta"] == 19.0
        assert alternative.instead_of.partition("=")[0] == option
    grip = by_choice["offset=grip"]
    heavy_tails = by_choice["noise=student-t"]
    assert grip.model == "two-mass+offset=grip"
    assert "zeta_theta" in by_choice["torsion=free"].summaries
    # The scale of another kind of noise is another quantity.
    assert "spin_sd" in by_choice["normal=total"].summaries
    assert "spin_sd" not in heavy_tails.summaries
    assert "degrees_of_freedom" not in heavy_tails.summaries
    # Impacts are of the model itself: nothing is surely better, a contact point that is the shell's
    # is worse.
    for alternative in by_choice.values():
        assert alternative.score <= max(4.0, 2.0 * alternative.error)
    shell = by_choice["spin=shell"]
    assert shell.score < -4.0
    # No value rests on it.
    assert not shell.summaries


@pytest.mark.parametrize("choice", ["offset=grip", "normal=total"])
def test_a_quick_fit_is_the_best_of_all_searches(two_mass, choice):
    problem, by_choice = two_mass
    alternative = by_choice[choice]
    choices = Choices(alternative.model, fix={"k_theta": 19.0})
    changed = build_problem(problem.table, problem.scene, choices)
    full_search = best_fit(changed, np.random.default_rng(3))

    def score(values):
        x = changed.coordinates(values)
        return log_posterior(changed, x[None])[0]

    quick = score(alternative.values)
    assert quick > full_search.log_posterior[0] - 0.02
    # Not the fit's own values.
    (values_of_fit,) = at(problem, best(problem)).optima
    assert score(values_of_fit) < quick - 0.1


NEW_PARAMETERS = {
    "zeta_theta": (Choices("two-mass+torsion=free"), lognorm(1.0, scale=0.5), (0.0, 10.0)),
    "degrees_of_freedom": (
        Choices("two-mass", noise="student-t"),
        lognorm(0.8, scale=8.0),
        (2.0, 100.0),
    ),
}


@pytest.mark.parametrize("name", NEW_PARAMETERS)
def test_a_new_parameter_is_searched_from_quantiles_of_its_prior(name):
    choices, law, bounds = NEW_PARAMETERS[name]
    problem = problem_of(table_of(REBOUND, count=8), None, "two-mass")
    changed = build_problem(problem.table, problem.scene, choices)
    assert {*changed.free} - {*problem.free} == {name}
    starts = module.search_starts(changed, at(problem, near(problem, 1, 0.0)[0]))
    below, up_to = law.cdf(bounds)
    expected = law.ppf(below + np.array([0.16, 0.5, 0.84]) * (up_to - below))
    assert_allclose(np.unique(changed.values(starts)[name].round(6)), expected, atol=1e-6)


def test_a_score_is_that_of_real_refits():
    problem = problem_of(
        table_of(REBOUND, count=8, seed=3),
        None,
        "grip-slip",
        fix={**NOISE, "mu": 0.56},
    )
    x = best(problem)
    scores = leave_one_out_density(problem, proposal(problem, x))
    exact = np.empty(8)
    rng = np.random.default_rng(1)
    for k in range(8):
        others = problem.without_rows(np.array([k]))
        begin = [proposal(others, best(others, x))]
        q, weights, _ = importance(partial(log_posterior, others), begin, rng, 3000.0)
        densities = pointwise(problem, q, REBOUND)[:, k]
        exact[k] = np.logaddexp.reduce(weights + densities)
    inside = pointwise(problem, x[None], REBOUND)[0]
    assert_allclose(scores, exact, atol=0.05 * np.max(inside - exact))


def test_outliers_ask_for_heavy_tails():
    table = table_of(REBOUND, count=80)
    wild = heavy_tails_of(problem_of(with_outliers(table), None, "grip-slip"))
    tame = heavy_tails_of(problem_of(table, None, "grip-slip"))
    assert wild.score > 4.0 > abs(tame.score)
    # Among five rows nothing is surely worse.
    few = heavy_tails_of(problem_of(table_of(REBOUND, count=5), None, "grip-slip"))
    assert few.score is None
    assert few.as_good
    # What was stated of degrees of freedom is left behind with them.
    for stated in (
        {"prior": {"degrees_of_freedom": "lognormal(5, 0.5)"}},
        {"fix": {"degrees_of_freedom": 5.0}},
    ):
        problem = problem_of(table, None, "grip-slip", noise="student-t", **stated)
        assert not alternatives_of(problem)["noise=normal"].reason


def heavy_tails_of(problem):
    """The alternative of Student's noise."""
    return alternatives_of(problem)["noise=student-t"]


def with_outliers(table):
    v_x2 = table.values["v_x2"].copy()
    v_x2[::8] += 4.0 * (-1.0) ** np.arange(10)
    return replace(table, values={**table.values, "v_x2": v_x2})


def test_of_long_tables_a_part_says_the_same(monkeypatch):
    problem = problem_of(table_of(REBOUND, count=400), None, "grip-slip")
    of_all_rows = heavy_tails_of(problem).summaries
    monkeypatch.setattr(module, "ALTERNATIVE_ROWS", 100)
    of_few_rows = heavy_tails_of(problem).summaries
    for name in ("mu", "cor_10", "offset"):
        exact = of_all_rows[name]
        thinned = of_few_rows[name]
        assert thinned.sd == pytest.approx(exact.sd, rel=0.2)
        assert abs(thinned.median - exact.median) < 1.0 * exact.sd


# Values of constants where a scene states none.
USUAL = {
    "inertia_ratio": 0.56,
    "ball_radius": 0.03302,
    "ball_mass": 0.0576,
    "tilt": 0.0,
}


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
    observables = problem_of(table, None, text).observables
    noises = {observable.noise: TRUTH[observable.noise] for observable in observables}

    def problem_with(constant):
        if name == "tilt":
            scene = Scene(scene_of().ball, camera=CameraSection(tilt=constant))
        else:
            stated = {"inertia_ratio": USUAL["inertia_ratio"]}
            ball = BallSection(**stated | {name.removeprefix("ball_"): constant})
            scene = Scene(ball=ball, contact_time=scene_of(time=True).contact_time)
        return problem_of(table, scene, text, fix=noises)

    usual = USUAL[name]
    problem = problem_with(usual)
    x = best(problem)
    first = first_order(problem, at(problem, x))
    # One that the constant moves directly, beside what it does to mu.
    spec = replace(problem.prior.parameters[0].spec, name="itself")
    direct = Quantity(spec, lambda values: values["mu"] + values.get(name, usual))
    derived = [*problem.derived, direct]
    by_name = {constant.name: constant for constant in constants(problem, first, derived)}
    constant = by_name[name]
    half = max(constant.high - usual, usual - constant.low)
    # What turns a difference between the two refits into the move within its range.
    reach = half / (2.0 * step)
    x_up = best(problem_with(usual + step), x)
    x_down = best(problem_with(usual - step), x)
    sds = np.linalg.norm(first.root, axis=1) * first.sds
    exact = (x_up - x_down) * reach / sds
    largest = np.abs(exact).max()
    moved = np.array([constant.moves[parameter] for parameter in problem.free])
    assert_allclose(moved, exact, atol=0.05 * largest)
    assert largest > 0.1

    # What follows from parameters moves with them, and by what the constant does to it itself.
    def refitted(x, constant):
        values = problem_with(constant).values(x[None])
        return {**values, name: np.array([constant])}

    up = refitted(x_up, usual + step)
    down = refitted(x_down, usual - step)
    root = first.root * first.sds[:, None]
    small = 1e-3 * np.diag(sds)
    above = problem.values(x + small)
    below = problem.values(x - small)
    for quantity in derived:
        slope = (quantity.rule(above) - quantity.rule(below)) / (2e-3 * sds)
        (difference,) = quantity.rule(up) - quantity.rule(down)
        expected = difference * reach / np.linalg.norm(slope @ root)
        move = constant.moves[quantity.spec.name]
        assert move == pytest.approx(expected, abs=0.05 * largest)
    assert "court_pace" in constant.moves


def test_constants_that_act_nowhere_or_are_fitted_are_none():
    table = table_of(REBOUND, count=12)
    # A stated ball has a ratio of its own, which is fitted.
    for scene, expected in (
        (None, {"ball_radius", "inertia_ratio", "tilt"}),
        (scene_of(ball=True), {"ball_radius", "tilt"}),
    ):
        problem = problem_of(table, scene, "grip-slip", fix=NOISE)
        first = first_order(problem, at(problem, best(problem)))
        names = {constant.name for constant in constants(problem, first, ())}
        assert names == expected


def test_ends_of_intervals_do_not_hang_on_single_draws(two_mass):
    """Those of two streams, 95 % ends of heavy tails among them, agree far better than what a
    choice must move.
    """
    problem, by_choice = two_mass
    of_other_stream = alternatives_of(problem, seed=2)
    for choice in ("offset=grip", "normal=total"):
        for name, here in by_choice[choice].summaries.items():
            there = of_other_stream[choice].summaries[name]
            assert abs(here.q025 - there.q025) < here.sd
            assert abs(here.q975 - there.q975) < here.sd


def test_a_choice_whose_draws_are_not_reliable_was_not_tried(monkeypatch):
    problem = problem_of(table_of(REBOUND, count=12), None, "grip-slip", fix=NOISE)
    fit = dict.fromkeys(problem.free, Summary(0.0, 0.0, 1.0, -2.0, -1.0, 1.0, 2.0))
    for reliable in (0.7, -1.0):
        monkeypatch.setattr(variant_draws, "RELIABLE_K", reliable)
        monkeypatch.setattr(variant_draws, "DOUBTFUL_K", reliable)
        heavy_tails = heavy_tails_of(problem)
        assert bool(heavy_tails.reason) == (reliable < 0.0)
        assert bool(heavy_tails.summaries) != bool(heavy_tails.reason)
    assert what_values_rest_on((heavy_tails,), (), fit) == dict.fromkeys(problem.free, ("model",))


def test_it_is_said_of_given_values_too_that_a_move_is_at_the_limit(monkeypatch):
    """All moves are at a limit that none of them reaches within its error."""
    problem = problem_of(table_of(REBOUND, count=12), scene_of(), "grip-slip")
    point = at(problem, best(problem))
    monkeypatch.setattr(module, "SURE_BY_ERRORS", np.inf)
    judged = {
        "mu": Judgement("identified", "determined", "."),
        "e_x": Judgement("given", "determined", ".", ("radius",)),
        "cor_10": Judgement("one-sided", "one-sided", "."),
    }
    results, _ = alternatives(problem, point, np.random.default_rng(1), judged)
    tried = [result for result in results if result.as_good and not result.reason]
    assert tried
    for result in tried:
        assert {*result.unsure} == {"mu"}
        assert {*result.unsure_given} == {"e_x"}


def test_of_spins_that_nobody_saw_other_sizes_are_tried():
    table = table_of(REBOUND, count=16)
    unseen = replace(
        table,
        values={name: column for name, column in table.values.items() if name != "omega_1"},
    )
    assert "omega_1_sd=300" not in alternatives_of(problem_of(table, scene_of()))
    tried = alternatives_of(problem_of(unseen, scene_of()))["omega_1_sd=300"]
    assert tried.instead_of == "omega_1_sd=100"
    stated = replace(
        unseen,
        values={**unseen.values, "omega_1": np.zeros(16)},
        sd={**unseen.sd, "omega_1": np.full(16, 300.0)},
    )
    as_stated = problem_of(stated, scene_of())
    found = log_posterior(as_stated, as_stated.coordinates(tried.values)[None])[0]
    _, cost, _ = descend(Objective(as_stated), near(as_stated, 8, 0.5))
    # Kinks stop searches: within an sd.
    assert found == pytest.approx(-cost.min(), abs=1.0)
    of_usual = best_fit(problem_of(unseen, scene_of()), np.random.default_rng(1)).optima[0]
    usual = log_posterior(as_stated, as_stated.coordinates(of_usual)[None])[0]
    assert usual < -cost.min() - 2.0


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

    def alternative(choice, instead_of, as_good=True, reason="", **values):
        return Alternative(choice, instead_of, "", {}, values, 0.0, 0.0, as_good, reason)

    fit = {"mu": summary(0.0), "e_x": summary(0.0)}
    far_end = Summary(0.0, 0.0, 1.0, -6.0, -1.0, 1.0, 2.0)
    results = (
        alternative("a=2", "a=1", mu=summary(2.5)),
        alternative("b=2", "b=1", mu=summary(-1.9)),
        alternative("c=2", "c=1", mu=far_end),
        alternative("d=2", "d=1", mu=summary(0.0, 0.1)),
        alternative("a=3", "a=1", mu=summary(5.0), zeta=summary(9.0)),
        alternative("e=2", "e=1", as_good=False, mu=summary(9.0), e_x=summary(9.0)),
    )
    held = (
        Constant("radius", 0.0, 1.0, {"mu": -3.0, "e_x": 0.9}),
        Constant("mass", 0.0, 1.0, {"mu": 0.2}),
    )
    assert what_values_rest_on(results, held, fit) == {"mu": ("a=1", "c=1", "radius")}
    missing = alternative("f=2", "f=1", reason="no answer")
    assert what_values_rest_on((*results, missing), held, fit) == {
        "mu": ("a=1", "c=1", "radius", "model"),
        "e_x": ("model",),
    }


def test_a_model_without_choices_is_an_assumption_of_all_values():
    problem = problem_of(table_of(REBOUND, count=12), None, "grip-slip")
    point = at(problem, best(problem))
    (values,) = point.optima
    results, _ = alternatives(problem, point, np.random.default_rng(1))
    far = (np.inf, -np.inf, -np.inf, np.inf, np.inf)
    fit = {name: Summary(values[name], values[name], *far) for name in problem.free}
    assert what_values_rest_on(results, (), fit) == dict.fromkeys(problem.free, ("model",))
