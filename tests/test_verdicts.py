"""Verdicts where the right answer is known without them: closed forms, scaling laws, refits."""

from dataclasses import replace

import numpy as np
import pytest
from made_tables import made
from support.density import REBOUND, problem_of, scene_of, table_of, truth_of
from support.fits import at, bounded, drops_of, line

import fitball
from fitball.data.scene import BallSection, Quantity, Scene
from fitball.inference import derived
from fitball.inference.judgement import verdict as module
from fitball.inference.judgement.first_order import first_order
from fitball.inference.judgement.profile import profiles
from fitball.inference.judgement.verdict import Seen, judge, qualified
from fitball.inference.schema import Adequacy, Judgement
from fitball.inference.search.objective import Objective, descend

SPEEDS = np.linspace(5.0, 17.0, 9)
NOISE = 0.05 * np.random.default_rng(1).standard_normal(9)


def idle(v_x1, v_y1, omega_1, ball, a="normal(0, 10)", b="normal(0, 1)"):
    return v_x1, a * v_y1 + 1e-4 * b * v_y1, omega_1


def dropped(function, y=None, speeds=SPEEDS, **choices):
    y = 0.7 * speeds - 0.02 * (speeds - 10.0) + NOISE[: speeds.size] if y is None else y
    return drops_of(function, speeds, y, **choices)


def fitted(problem, **start):
    x, _, converged = descend(Objective(problem), problem.coordinates(start)[None])
    assert converged.all()
    return at(problem, x[0]), x


def judged(problem, **start):
    """Every verdict of a problem, searched from some values."""
    point, x = fitted(problem, **start)
    return judge(
        problem,
        point,
        first_order(problem, point),
        profiles(problem, x)[0],
        problem.derived,
    )


def of_line(problem, **start):
    found = judged(problem, **{"a": 0.7, "b": 0.01, "v_y_sd": 0.05, **start})
    return {name: (found[name].verdict, found[name].rule, found[name].given) for name in ("a", "b")}


@pytest.mark.parametrize(
    ("function", "prior", "a", "b"),
    [
        (line, {}, ("identified", "determined", ()), ("identified", "determined", ())),
        (bounded, {}, ("identified", "determined", ()), ("one-sided", "bounded", ())),
        # It moves no rebound by a tenth of a noise.
        (idle, {}, ("identified", "determined", ()), ("prior-dominated", "traded", ())),
        # The data say 0.7 to 0.01; priors far off hold it, one nearer meets it half way.
        (line, {"a": "normal(0.9, 1e-3)"}, ("prior-dominated", "held-off", ()), None),
        (line, {"a": "normal(0.74, 0.01)"}, ("given", "determined", ("the prior of a",)), None),
        (line, {"a": "normal(0.7, 1e-5)"}, ("prior-dominated", "unchanged", ()), None),
    ],
)
def test_lines_whose_verdict_is_known(function, prior, a, b):
    far = {"a": 0.9, "v_y_sd": 1.0} if "0.9" in prior.get("a", "") else {}
    found = of_line(dropped(function, prior=prior), **far)
    if function is idle:
        # Both act alike: neither is known without the prior of the other.
        assert {one[:2] for one in found.values()} == {("prior-dominated", "traded")}
    else:
        assert found["a"] == a and (b is None or found["b"] == b)


def test_contraction_is_that_of_a_linear_model():
    problem = dropped(line, fix={"v_y_sd": 0.05, "b": -0.02}, prior={"a": "normal(0.7, 0.004)"})
    point, _ = fitted(problem, a=0.7)
    spec = problem.prior.parameters[0].spec
    first = first_order(problem, point)
    asked = [derived.Quantity(spec, lambda values, by=by: by * values["a"]) for by in (-3.0, 0.0)]
    linear = module._linear(problem, first, asked)
    left = 1.0 / (1.0 + 0.004**2 * np.sum((SPEEDS / 0.05) ** 2))
    np.testing.assert_allclose(linear.contraction, [1.0 - left, 1.0 - left, 0.0], atol=1e-6)
    np.testing.assert_allclose(linear.shares[:2, 0], 1.0)


def test_few_measurements_leave_no_noise():
    found = judged(dropped(line, speeds=SPEEDS[::3]), a=0.7, b=0.0, v_y_sd=0.05)
    assert (found["v_y_sd"].verdict, found["v_y_sd"].rule) == ("prior-dominated", "no-freedom")
    found = judged(dropped(line), a=0.7, b=0.0, v_y_sd=0.05)
    assert found["v_y_sd"].rule == "determined"


def test_what_is_reproduced_exactly_rests_on_the_prior_of_the_noise():
    problem = dropped(line, 0.7 * SPEEDS)
    found = judged(problem, a=0.7, b=0.0, v_y_sd=1e-3)
    assert (found["a"].verdict, found["a"].given) == ("given", ("the prior of the noise",))
    assert found["v_y_sd"].verdict == "prior-dominated"
    # Of a long table profiles are left out, and nothing rests on that.
    many = np.tile(SPEEDS, 40)
    y = 0.7 * many + 0.05 * np.random.default_rng(2).standard_normal(many.size)
    assert of_line(dropped(line, y, many))["a"] == ("identified", "determined", ())


def two_mass(time=None, **choices):
    scene = scene_of(time=time is not None, ball=False)
    return problem_of(table_of(REBOUND, count=21), scene, "two-mass", **choices)


def test_stiffnesses_rest_on_the_contact_time_and_without_one_on_priors():
    told = two_mass(time=True)
    silent = two_mass()
    known = judged(told, **truth_of(told))
    unknown = judged(silent, **truth_of(silent))
    for name in ("k_y", "k_theta"):
        assert (known[name].verdict, known[name].given) == ("given", ("contact_time",))
        assert (unknown[name].verdict, unknown[name].rule) == ("prior-dominated", "traded")
    assert unknown["k_theta/k_y"].verdict == known["k_theta/k_y"].verdict == "identified"
    for name in ("mass_ratio", "mu", "cor_10", "spin_sd"):
        assert known[name].verdict == unknown[name].verdict == "identified", name
    assert known["court_pace"].verdict == "extrapolated"


def test_errors_without_the_contact_time_are_those_of_a_problem_without():
    """By Sherman and Morrison, against the linearisation made again."""
    told = two_mass(time=True)
    point, _ = fitted(told, **truth_of(told))
    first = first_order(told, point)
    silent = first_order(replace(told, contact_time=None), point)
    ratio = np.linalg.norm(silent.root, axis=1) / np.linalg.norm(first.root, axis=1)
    timed = module._linear(told, first, ()).timed
    by_name = dict(zip(told.free, timed.tolist(), strict=True))
    assert [by_name[name] for name in first.names] == (ratio > 2.0).tolist()
    assert {name for name, rests in by_name.items() if rests} == {"k_y", "k_theta"}


def test_what_moves_with_a_stated_constant_is_given_its_prior():
    """As a refit with the constant's prior two of its sds away says."""
    balls = [BallSection(inertia_ratio=Quantity(value, 0.015)) for value in (0.56, 0.59)]
    problem, moved, held = (
        problem_of(table_of(REBOUND, count=21), Scene(ball=ball), "grip-slip")
        for ball in (*balls, BallSection())
    )
    point, x = fitted(problem, **truth_of(problem))
    _, there = fitted(moved, **point.optima[0])
    own = first_order(held, fitted(held, **truth_of(held))[0])
    found = judged(problem, **truth_of(problem))
    for name in ("mu", "e_x", "offset", "cor_10"):
        k = problem.free.index(name)
        j = own.names.index(name)
        shift = abs(there[0, k] - x[0, k]) / (np.linalg.norm(own.root[j]) * own.sds[j])
        assert (found[name].given == ("the prior of inertia_ratio",)) is bool(shift > 1.0), (
            name,
            shift,
        )
    assert found["offset"].verdict == "given" and found["cor_10"].verdict == "identified"


def bounces(v_x, v_y, omega, mu):
    """A table of grip-slip, and its truth."""
    values = {"mu": mu, "e_x": 0.15, "offset": 0.002, "cor_10": 0.77, "cor_slope": -0.012}
    made_by = fitball.model("grip-slip").rebound(values, fitball.impacts(v_x, v_y, omega))
    rng = np.random.default_rng(3)
    sizes = {"v_x2": 0.03, "v_y2": 0.03, "omega_2": 1.5}
    rebound = {
        name: made_by.column(name) + size * rng.standard_normal(16) for name, size in sizes.items()
    }
    problem = problem_of(
        made({"v_x1": v_x, "v_y1": v_y, "omega_1": omega, **rebound}),
        None,
        "grip-slip",
    )
    return problem, {**values, "v_x_sd": 0.03, "v_y_sd": 0.03, "spin_sd": 1.5}


SPINS = np.tile([-40.0, 0.0, 40.0, 10.0], 4)


def test_an_anchor_that_was_not_measured_is_extrapolated():
    problem, truth = bounces(
        np.linspace(6.0, 1.0, 16),
        np.tile(np.linspace(0.8, 2.7, 8), 2),
        SPINS,
        0.4,
    )
    found = judged(problem, **truth)
    assert found["cor_10"].verdict == "extrapolated"
    assert (
        found["cor_slope"].verdict
        == found["mu"].verdict
        == found["cor_median"].verdict
        == "identified"
    )
    fixed = problem_of(problem.table, None, "grip-slip", fix={"cor_slope": 0.0})
    held = judged(fixed, **{name: value for name, value in truth.items() if name != "cor_slope"})
    assert (held["cor_10"].verdict, held["cor_slope"].verdict) == ("identified", "fixed")


def test_a_friction_that_no_impact_feels_leaves_what_follows_from_it():
    problem, truth = bounces(np.linspace(2.0, 6.0, 16), np.linspace(15.0, 24.0, 16), SPINS, 0.6)
    found = judged(problem, **truth)
    assert (found["mu"].verdict, found["e_x"].verdict) == ("one-sided", "identified")
    # At 16 degrees a ball would slide.
    assert (found["court_pace"].verdict, found["court_pace"].rule) == ("one-sided", "bounded-part")


RANKED = [
    ({"traded": ("k_y",), "interval": (None, None), "freedom": 1.0}, "traded"),
    ({"missing": True, "freedom": 1.0}, "no-maximum"),
    ({"freedom": 2.0, "interval": (None, None)}, "no-freedom"),
    ({"interval": (None, None), "contraction": 0.1}, "open"),
    ({"open": ("mu",), "bounded": ("mu",)}, "open-part"),
    ({"interval": (None, 2.0), "contraction": 0.1}, "bounded"),
    ({"bounded": ("mu",), "extrapolated": "far"}, "bounded-part"),
    (
        {"contraction": 0.19, "within": False, "interval": (1.0, 2.0), "extrapolated": "far"},
        "held-off",
    ),
    ({"contraction": 0.19, "extrapolated": "far"}, "unchanged"),
    ({"extrapolated": "far", "missing": True}, "extrapolated"),
    ({"missing": True}, "exact"),
    ({"contraction": 0.2, "interval": (1.0, 2.0)}, "determined"),
]


@pytest.mark.parametrize(("numbers", "rule"), RANKED)
def test_the_first_rule_that_holds_decides(numbers, rule):
    spec = problem_of(table_of(REBOUND)).prior.parameters[0].spec
    made_of = module._judged(Seen(**{"spec": spec, "contraction": 0.9, **numbers}), ())
    assert made_of.rule == rule and made_of.reason.endswith(".") is (rule != "extrapolated")


def adequacy(answer="describes", **moved):
    return Adequacy(answer, "", (), (), moved, {})


def test_adequacy_and_assumptions_qualify_what_is_determined():
    within = {
        "mu": Judgement("identified", "determined", "."),
        "pace": Judgement("identified", "determined", "."),
        "k_y": Judgement("given", "determined", ".", ("contact_time",)),
        "cor_10": Judgement("extrapolated", "extrapolated", "."),
    }

    def said(*asked):
        return {name: (one.verdict, one.given) for name, one in qualified(within, *asked).items()}

    rests = {
        "mu": ("offset=contact",),
        "k_y": ("spin=mean", "contact_time"),
        "cor_10": ("spin=mean",),
    }
    plain = said(adequacy(), {})
    assert plain == {name: (one.verdict, one.given) for name, one in within.items()}
    given = {"mu": ("given", ("offset=contact",)), "k_y": ("given", ("contact_time", "spin=mean"))}
    assert said(adequacy(), rests) == plain | given
    untested = said(adequacy("undecided"), rests)
    assert untested["mu"] == ("given", ("offset=contact", "model"))
    assert untested["pace"] == ("given", ("model",)) and untested["cor_10"] == ("extrapolated", ())
    moved = said(adequacy("describes except", mu=1.1, k_y=0.9, pace=1.2), rests)
    assert moved["mu"][0] == moved["pace"][0] == "conditional" and moved["k_y"][0] == "given"
    fails = said(adequacy("does not describe"), rests)
    assert {name for name, one in fails.items() if one == ("conditional", ())} == {
        "mu",
        "k_y",
        "pace",
    }
