"""Verdicts where the right answer is known without them: closed forms, scaling laws, refits."""

from dataclasses import replace

import numpy as np
import pytest
from made_tables import impact_table
from numpy.testing import assert_allclose
from support.density import REBOUND, problem_of, scene_of, table_of, truth_of
from support.fits import at, bounded, drops_of, line

import fitball
from fitball.data.scene import BallSection, Scene, ValueWithSd
from fitball.inference import derived
from fitball.inference.judgement import verdict as module
from fitball.inference.judgement.first_order import first_order
from fitball.inference.judgement.profile import profiles
from fitball.inference.judgement.verdict import Evidence, judge, qualify
from fitball.inference.schema import Adequacy, Judgement
from fitball.inference.search.objective import Objective, descend

SPEEDS = np.linspace(5.0, 17.0, 9)
NOISE = 0.05 * np.random.default_rng(1).standard_normal(9)
SPINS = np.tile([-40.0, 0.0, 40.0, 10.0], 4)
IDENTIFIED = ("identified", "determined", ())


def idle(v_x1, v_y1, omega_1, ball, a="normal(0, 10)", b="normal(0, 1)"):
    """A model of which b moves no rebound by a tenth of a noise."""
    return v_x1, a * v_y1 + 1e-4 * b * v_y1, omega_1


def dropped(function, y=None, speeds=SPEEDS, **choices):
    """A problem of drops; without `y` on the line with a = 0.7, b = -0.02, with noise of 0.05."""
    if y is None:
        slope = 0.7 * speeds
        bend = 0.02 * (speeds - 10.0)
        y = slope - bend + NOISE[: speeds.size]
    return drops_of(function, speeds, y, **choices)


def fitted(problem, **start):
    """The maximum that is reached from some values, as a point fit and as coordinates."""
    x, _, converged = descend(Objective(problem), problem.coordinates(start)[None])
    assert converged.all()
    return at(problem, x[0]), x


def verdicts_of(problem, **start):
    """Every verdict of a problem, searched from some values."""
    point, x = fitted(problem, **start)
    linear = first_order(problem, point)
    profiled = profiles(problem, x)
    return judge(problem, point, linear, profiled, problem.derived)


def verdicts_of_line(problem, **start):
    """Verdict, rule and what it rests on, of a and of b."""
    start = {
        "a": 0.7,
        "b": 0.01,
        "v_y_sd": 0.05,
        **start,
    }
    judged = verdicts_of(problem, **start)
    answers = {}
    for name in ("a", "b"):
        answers[name] = (judged[name].verdict, judged[name].rule, judged[name].given)
    return answers


@pytest.mark.parametrize(
    ("function", "prior", "a", "b"),
    [
        (line, {}, IDENTIFIED, IDENTIFIED),
        (bounded, {}, IDENTIFIED, ("one-sided", "bounded", ())),
        # It moves no rebound by a tenth of a noise.
        (idle, {}, ("identified", "determined", ()), ("prior-dominated", "traded", ())),
        # The data say 0.7 to 0.01; priors far off hold it, one nearer meets it half way.
        (line, {"a": "normal(0.9, 1e-3)"}, ("prior-dominated", "held-off", ()), None),
        (line, {"a": "normal(0.74, 0.01)"}, ("given", "determined", ("the prior of a",)), None),
        (line, {"a": "normal(0.7, 1e-5)"}, ("prior-dominated", "unchanged", ()), None),
    ],
)
def test_lines_whose_verdicts_follow_by_hand(function, prior, a, b):
    start = {}
    if "0.9" in prior.get("a", ""):
        start = {"a": 0.9, "v_y_sd": 1.0}
    judged = verdicts_of_line(dropped(function, prior=prior), **start)
    if function is idle:
        # Both act alike: neither is known without the prior of the other.
        assert {answer[:2] for answer in judged.values()} == {("prior-dominated", "traded")}
    else:
        assert judged["a"] == a
        assert b is None or judged["b"] == b


def test_contraction_is_that_of_a_linear_model():
    """Of a slope with a normal prior the posterior's variance is known in closed form."""
    problem = dropped(line, fix={"v_y_sd": 0.05, "b": -0.02}, prior={"a": "normal(0.7, 0.004)"})
    point, _ = fitted(problem, a=0.7)
    spec = problem.prior.parameters[0].spec
    first = first_order(problem, point)
    multiples = []
    for factor in (-3.0, 0.0):
        multiple = derived.Quantity(spec, lambda values, factor=factor: factor * values["a"])
        multiples.append(multiple)
    linear = module._linear_of(problem, first, multiples)
    information = np.sum((SPEEDS / 0.05) ** 2)
    contraction = 1.0 - 1.0 / (1.0 + 0.004**2 * information)
    assert_allclose(linear.contraction, [contraction, contraction, 0.0], atol=1e-6)
    assert_allclose(linear.shares[:2, 0], 1.0)


def test_few_measurements_leave_no_noise():
    start = {"a": 0.7, "b": 0.0, "v_y_sd": 0.05}
    judged = verdicts_of(dropped(line, speeds=SPEEDS[::3]), **start)
    assert judged["v_y_sd"].verdict == "prior-dominated"
    assert judged["v_y_sd"].rule == "no-freedom"
    judged = verdicts_of(dropped(line), **start)
    assert judged["v_y_sd"].rule == "determined"


def test_what_is_reproduced_exactly_rests_on_the_prior_of_the_noise():
    problem = dropped(line, 0.7 * SPEEDS)
    judged = verdicts_of(problem, a=0.7, b=0.0, v_y_sd=1e-3)
    assert judged["a"].verdict == "given"
    assert judged["a"].given == ("the prior of the noise",)
    assert judged["v_y_sd"].verdict == "prior-dominated"
    # Of a long table profiles are left out, and nothing rests on that.
    many = np.tile(SPEEDS, 40)
    noise = 0.05 * np.random.default_rng(2).standard_normal(many.size)
    problem = dropped(line, 0.7 * many + noise, many)
    assert verdicts_of_line(problem)["a"] == IDENTIFIED


def two_mass(time=None, **choices):
    scene = scene_of(time=time is not None, ball=False)
    return problem_of(table_of(REBOUND, count=21), scene, "two-mass", **choices)


def test_stiffnesses_rest_on_the_contact_time_and_without_it_on_priors():
    timed = two_mass(time=True)
    untimed = two_mass()
    with_time = verdicts_of(timed, **truth_of(timed))
    without_time = verdicts_of(untimed, **truth_of(untimed))
    for name in ("k_y", "k_theta"):
        assert with_time[name].verdict == "given"
        assert with_time[name].given == ("contact_time",)
        assert without_time[name].verdict == "prior-dominated"
        assert without_time[name].rule == "traded"
    for name in ("k_theta/k_y", "mass_ratio", "mu", "cor_10", "spin_sd"):
        assert with_time[name].verdict == "identified", name
        assert without_time[name].verdict == "identified", name
    assert with_time["court_pace"].verdict == "extrapolated"


def test_errors_without_the_contact_time_are_those_of_a_problem_without():
    """By Sherman and Morrison, against the linearisation made again."""
    problem = two_mass(time=True)
    point, _ = fitted(problem, **truth_of(problem))
    timed = first_order(problem, point)
    untimed = first_order(replace(problem, contact_time=None), point)
    ratio = np.linalg.norm(untimed.root, axis=1) / np.linalg.norm(timed.root, axis=1)
    rests_on_time = module._linear_of(problem, timed, ()).timed
    by_name = dict(zip(problem.free, rests_on_time.tolist(), strict=True))
    assert [by_name[name] for name in timed.names] == (ratio > 2.0).tolist()
    assert {name for name, rests in by_name.items() if rests} == {"k_y", "k_theta"}


def test_what_moves_with_a_stated_constant_rests_on_its_prior():
    """As a refit with the constant's prior two of its sds away says."""

    def of_ball(ball):
        return problem_of(table_of(REBOUND, count=21), Scene(ball=ball), "grip-slip")

    problem = of_ball(BallSection(inertia_ratio=ValueWithSd(0.56, 0.015)))
    moved = of_ball(BallSection(inertia_ratio=ValueWithSd(0.59, 0.015)))
    fixed = of_ball(BallSection())
    point, x = fitted(problem, **truth_of(problem))
    _, x_moved = fitted(moved, **point.optima[0])
    point_fixed, _ = fitted(fixed, **truth_of(fixed))
    linear = first_order(fixed, point_fixed)
    judged = verdicts_of(problem, **truth_of(problem))
    for name in ("mu", "e_x", "offset", "cor_10"):
        k = problem.free.index(name)
        j = linear.names.index(name)
        sd = np.linalg.norm(linear.root[j]) * linear.sds[j]
        shift = abs(x_moved[0, k] - x[0, k]) / sd
        rests_on_prior = judged[name].given == ("the prior of inertia_ratio",)
        assert rests_on_prior is bool(shift > 1.0), (name, shift)
    assert judged["offset"].verdict == "given"
    assert judged["cor_10"].verdict == "identified"


def bounces(v_x, v_y, omega, mu):
    """A table of grip-slip, and its truth."""
    values = {
        "mu": mu,
        "e_x": 0.15,
        "offset": 0.002,
        "cor_10": 0.77,
        "cor_slope": -0.012,
    }
    rebounds = fitball.model("grip-slip").rebound(values, fitball.impacts(v_x, v_y, omega))
    rng = np.random.default_rng(3)
    sizes = {"v_x2": 0.03, "v_y2": 0.03, "omega_2": 1.5}
    rebound = {}
    for name, size in sizes.items():
        noise = size * rng.standard_normal(16)
        rebound[name] = rebounds.column(name) + noise
    table = impact_table(
        {
            "v_x1": v_x,
            "v_y1": v_y,
            "omega_1": omega,
            **rebound,
        }
    )
    problem = problem_of(table, None, "grip-slip")
    return problem, {
        **values,
        "v_x_sd": 0.03,
        "v_y_sd": 0.03,
        "spin_sd": 1.5,
    }


def test_an_anchor_that_was_not_measured_is_extrapolated():
    """The COR at 10 m/s is known of slow impacts only if its slope is."""
    v_x = np.linspace(6.0, 1.0, 16)
    v_y = np.tile(np.linspace(0.8, 2.7, 8), 2)
    problem, truth = bounces(v_x, v_y, SPINS, 0.4)
    judged = verdicts_of(problem, **truth)
    assert judged["cor_10"].verdict == "extrapolated"
    assert judged["cor_slope"].verdict == "extrapolated"
    for name in ("cor_slope_median", "mu", "cor_median"):
        assert judged[name].verdict == "identified", name
    fixed = problem_of(problem.table, None, "grip-slip", fix={"cor_slope": 0.0})
    start = {name: value for name, value in truth.items() if name != "cor_slope"}
    without_slope = verdicts_of(fixed, **start)
    assert without_slope["cor_10"].verdict == "identified"
    assert without_slope["cor_slope"].verdict == "fixed"


def test_a_friction_that_no_impact_feels_leaves_what_follows_from_it():
    v_x = np.linspace(2.0, 6.0, 16)
    v_y = np.linspace(15.0, 24.0, 16)
    problem, truth = bounces(v_x, v_y, SPINS, 0.6)
    judged = verdicts_of(problem, **truth)
    assert judged["mu"].verdict == "one-sided"
    assert judged["mu"].open_side == "above"
    # More friction is a slower court.
    assert judged["court_pace"].open_side == "below"
    assert judged["e_x"].verdict == "identified"
    # At 16 degrees a ball would slide.
    assert judged["court_pace"].verdict == "one-sided"
    assert judged["court_pace"].rule == "bounded-part"


RANKED = [
    ({"traded": ("k_y",), "interval": (None, None), "freedom": 1.0}, "traded"),
    ({"missing": True, "freedom": 1.0}, "no-maximum"),
    ({"freedom": 2.0, "interval": (None, None)}, "no-freedom"),
    ({"interval": (None, None), "contraction": 0.1}, "open"),
    ({"open": ("mu",), "bounded": ("mu",)}, "open-part"),
    ({"interval": (None, 2.0), "bound": "Its best value lies on a bound."}, "at-bound"),
    ({"interval": (None, None), "bound": "Its best value lies on a bound."}, "open"),
    ({"interval": (None, 2.0), "contraction": 0.1}, "bounded"),
    ({"bounded": ("mu",), "extrapolated": "far"}, "bounded-part"),
    ({"bounded": ("mu",), "opposed": True, "interval": (None, 2.0)}, "opposed-parts"),
    (
        {"contraction": 0.19, "within": False, "interval": (1.0, 2.0), "extrapolated": "far"},
        "held-off",
    ),
    ({"within": False, "elsewhere": True, "interval": (1.0, 2.0), "wide": True}, "elsewhere"),
    ({"contraction": 0.19, "extrapolated": "far", "wide": True}, "unchanged"),
    ({"wide": True, "extrapolated": "far", "interval": (1.0, 2.0)}, "wide"),
    ({"extrapolated": "far", "missing": True}, "extrapolated"),
    ({"missing": True}, "exact"),
    ({"contraction": 0.2, "interval": (1.0, 2.0)}, "determined"),
]


@pytest.mark.parametrize(("numbers", "rule"), RANKED)
def test_the_first_rule_that_holds_decides(numbers, rule):
    spec = problem_of(table_of(REBOUND)).prior.parameters[0].spec
    seen = Evidence(**{"spec": spec, "contraction": 0.9, **numbers})
    judgement = module._judgement_of(seen, ())
    assert judgement.rule == rule
    assert judgement.reason.endswith(".") is (rule != "extrapolated")


def adequacy(answer="describes", **moved):
    return Adequacy(answer, "", (), (), moved, {})


def test_adequacy_and_assumptions_qualify_what_is_determined():
    within = {
        "mu": Judgement("identified", "determined", "."),
        "pace": Judgement("identified", "determined", "."),
        "k_y": Judgement("given", "determined", ".", ("contact_time",)),
        "cor_10": Judgement("extrapolated", "extrapolated", "."),
    }

    def answers(judgements):
        return {
            name: (judgement.verdict, judgement.given) for name, judgement in judgements.items()
        }

    def answers_after(*qualifications):
        return answers(qualify(within, *qualifications))

    rests = {
        "mu": ("offset=contact",),
        "k_y": ("spin=mean", "contact_time"),
        "cor_10": ("spin=mean",),
    }
    plain = answers_after(adequacy(), {})
    assert plain == answers(within)
    changed = {
        "mu": ("given", ("offset=contact",)),
        "k_y": ("given", ("contact_time", "spin=mean")),
    }
    assert answers_after(adequacy(), rests) == plain | changed
    denied = answers_after(adequacy(), rests, {}, {"mu": "But offset=grip moves it."})
    assert denied == plain | changed | {"mu": ("conditional", ("offset=contact",))}
    untested = answers_after(adequacy("undecided"), rests)
    assert untested["mu"] == ("given", ("offset=contact", "model"))
    assert untested["pace"] == ("given", ("model",))
    assert untested["cor_10"] == ("extrapolated", ())
    moved = answers_after(adequacy("describes except", mu=1.1, k_y=0.9, pace=1.2), rests)
    assert moved["mu"][0] == "conditional"
    assert moved["pace"][0] == "conditional"
    assert moved["k_y"][0] == "given"
    fails = answers_after(adequacy("does not describe"), rests)
    conditional = {name for name, answer in fails.items() if answer == ("conditional", ())}
    assert conditional == {"mu", "k_y", "pace"}
