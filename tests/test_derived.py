"""Derived quantities against formulas of the field, the second edition's numbers, and scipy."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from made_tables import bundled, impact_table
from numpy.testing import assert_allclose
from scipy import stats
from support.density import INCIDENT, REBOUND, problem_of, scene_of, table_of, truth_of

import fitball
from fitball.base import air
from fitball.base.errors import ParameterError
from fitball.base.values import Ball
from fitball.data.scene import BallSection, Scene
from fitball.inference.derived import anchored, level_differences, quantity_of
from fitball.inference.forward import Draws
from fitball.models.specs import SPECS

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


def derived_in(problem):
    """Derived quantities of a problem by name."""
    return {quantity.spec.name: quantity for quantity in problem.derived}


def draws_of(problem, values):
    """Arrays (draws,) of all parameters; a number counts for all draws."""
    fixed = {}
    for calibrated in problem.parameters:
        if calibrated.fixed is not None:
            fixed[calibrated.spec.name] = calibrated.fixed
    columns = {**fixed, **values}
    arrays = np.broadcast_arrays(*map(np.atleast_1d, columns.values()))
    return {name: array.astype(float) for name, array in zip(columns, arrays, strict=True)}


def evaluated(problem, name, values):
    """A derived quantity (draws,) at values of the parameters."""
    return derived_in(problem)[name].rule(draws_of(problem, values))


def grip_slip(v_x, v_y, omega=0.0, labels=None, scene=None, **columns):
    """A table of grip-slip whose rebounds do not matter."""
    size = np.size(v_y)
    columns = columns or {
        "v_x2": np.full(size, 1.0),
        "v_y2": 0.7 * np.asarray(v_y),
        "omega_2": np.ones(size),
    }
    table = impact_table(
        {"v_x1": v_x, "v_y1": v_y, "omega_1": omega, **columns}, labels=labels or {}
    )
    return problem_of(table, scene)


FAST = np.linspace(6.0, 12.0, 10)
SLIDING = {
    "mu": 0.3,
    "e_x": 0.1,
    "offset": 0.0,
    "cor_10": 0.78,
    "cor_slope": 0.0,
}


def test_the_second_editions_numbers():
    wang = bundled("wang_all.csv", (*INCIDENT, *REBOUND))
    problem = problem_of(wang, None, "two-mass")
    values = {**WANG, "k_y": [19067.1004, 1.0]}
    ratio = evaluated(problem, "k_theta/k_y", values)
    assert_allclose(ratio, [18.3410452 / 19067.1004, 18.3410452])
    pace = evaluated(problem, "court_pace", values)
    assert pace[0] == pytest.approx(44.127846906, abs=1e-5)
    derived = derived_in(problem)
    assert derived["court_pace"].extrapolated
    assert {*derived} == {"k_theta/k_y", "court_pace"}


@pytest.mark.parametrize("temperature", [None, 13.0])
def test_pace_of_a_sliding_ball_is_the_itfs_formula(temperature):
    scene = Scene(ball=BallSection(temperature=temperature))
    problem = grip_slip(3.0 * FAST, FAST, scene=scene)
    rating = evaluated(problem, "court_pace", SLIDING)
    warmer = 0.0 if temperature is None else 0.003 * 10.0
    assert rating == pytest.approx(100.0 * 0.7 + 150.0 * (0.81 - 0.78 - warmer))


def test_pace_follows_for_tennis_balls_at_such_speeds():
    flat = grip_slip(8.0 * FAST, FAST)
    assert "court_pace" in derived_in(flat)
    slow = grip_slip(0.5 * FAST, 0.9 * FAST)
    assert "court_pace" not in derived_in(slow)
    too_flat = grip_slip(14.0 * FAST, FAST)
    assert "court_pace" not in derived_in(too_flat)
    heavy_ball = Scene(ball=BallSection(mass=0.06))
    heavy = grip_slip(3.0 * FAST, FAST, scene=heavy_ball)
    assert "court_pace" not in derived_in(heavy)
    v_x = np.linspace(27.0, 31.0, 10)
    v_y = 8.27 + 0.3 * np.tile([-1.0, 1.0], 5)
    omega = np.tile([-9, 9], 5)
    as_in_the_test = grip_slip(v_x, v_y, omega)
    assert not derived_in(as_in_the_test)["court_pace"].extrapolated


def test_a_drop_test_is_rated_by_its_rebound():
    speed = np.linspace(6.0, 12.0, 6)
    problem = grip_slip(0.0, speed, v_y2=0.75 * speed)
    derived = derived_in(problem)
    assert {*derived} >= {"cor_254cm", "rebound_254cm"}
    assert "court_pace" not in derived
    cor = np.array([0.745, 0.76])
    values = {"cor_10": cor, "cor_slope": 0.0, "mass_ratio": 0.9}
    assert_allclose(evaluated(problem, "cor_254cm", values), cor)
    # By an integration of the fall and the rise, drag coefficient 0.55: see test_air.
    braking = 0.55 * air.braking_per_drag(Ball(), {})
    landing = air.landing_speed(2.54, braking)
    heights = air.rebound_height(cor * landing, braking)
    assert_allclose(evaluated(problem, "rebound_254cm", values), heights)
    # Published: some 6.6 to 7.2 % below 254 cm times the square of COR.
    assert_allclose(heights / (2.54 * cor**2), 0.928, atol=0.003)
    assert not derived["rebound_254cm"].extrapolated
    faster = grip_slip(0.0, speed + 6.0, v_y2=speed)
    assert derived_in(faster)["cor_254cm"].extrapolated


def test_a_figure_tells_quantities_apart_by_their_symbols():
    slow = np.linspace(2.0, 6.0, 8)
    problem = grip_slip(0.0, slow, v_y2=0.75 * slow)
    specs = [parameter.spec for parameter in problem.parameters if parameter.fixed is None]
    specs += [quantity.spec for quantity in problem.derived]
    symbols = [spec.symbol for spec in specs if spec.symbol]
    assert len({*symbols}) == len(symbols)
    # What is said of a value before the first comma is all that a table shows.
    meanings = [spec.meaning.partition(",")[0] for spec in specs]
    assert len({*meanings}) == len(meanings)


def test_what_was_not_measured_at_ten_metres_a_second_has_a_value_at_the_median():
    slow = np.linspace(0.8, 2.7, 8)
    problem = grip_slip(2.0 * slow, slow)
    assert anchored(problem.forward, problem.calibrated) == {"cor_10", "cor_slope"}
    cor = derived_in(problem)["cor_median"]
    values = draws_of(problem, {**SLIDING, "cor_slope": -0.01})
    states = problem.rows.states
    rebound = problem.forward.rebound(values, states)
    ratio = rebound.v_y2[0] / states.v_y1
    exact = np.interp(1.75, slow, ratio)
    assert cor.rule(values)[0] == pytest.approx(exact, rel=1e-4)
    assert not cor.extrapolated
    slope = derived_in(problem)["cor_slope_median"]
    line, _, _ = np.gradient(np.interp([1.5, 1.75, 2.0], slow, ratio), 0.25)
    assert slope.rule(values)[0] == pytest.approx(line, rel=0.1)
    assert not slope.extrapolated
    measured_there = problem_of(table_of(REBOUND), scene_of(time=True), "two-mass")
    assert anchored(measured_there.forward, measured_there.calibrated) == frozenset()
    columns = {
        "v_x1": 2.0 * slow,
        "v_y1": slow,
        "omega_1": 0.0,
        "v_x2": slow,
        "v_y2": 0.7 * slow,
        "omega_2": slow,
    }
    two_mass = problem_of(impact_table(columns), None, "two-mass")
    anchors = {"cor_10", "cor_slope", "eps_10", "eps_slope"}
    assert anchored(two_mass.forward, two_mass.calibrated) == anchors
    assert evaluated(two_mass, "eps_slope_median", {**WANG, "eps_slope": 1e-4})[0] == 1e-4
    offset = evaluated(two_mass, "eps_median", {**WANG, "eps_slope": 1e-4})
    assert offset[0] == pytest.approx(0.00237668043 + (1.75 - 10.0) * 1e-4)


def test_a_slope_that_is_held_at_zero_has_no_rounding_errors():
    slow = np.linspace(0.8, 2.7, 8)
    problem = grip_slip(2.0 * slow, slow)
    cor = np.linspace(0.6, 0.9, 200)
    slopes = evaluated(problem, "cor_slope_median", {**SLIDING, "cor_10": cor, "cor_slope": 0.0})
    assert_allclose(slopes, np.zeros(200), rtol=0.0, atol=0.0)
    # One that is as small as any measured is not lost.
    slopes = evaluated(problem, "cor_slope_median", {**SLIDING, "cor_10": cor, "cor_slope": -1e-6})
    assert (slopes < 0.0).all()


def test_each_level_has_its_quantity_and_is_judged_by_itself():
    both = {"surface": ("clay",) * 8 + ("hard",) * 8}
    slow = np.linspace(1.0, 3.0, 8)
    fast = np.linspace(7.0, 12.0, 8)
    v_y = np.concatenate([slow, fast])
    problem = grip_slip(3.0 * v_y, v_y, labels=both)
    pooled = {level.parameter for level in problem.forward.levels}
    assert pooled == {"mu", "cor_10"}
    # The slope is that of both, and measured where the one is.
    assert anchored(problem.forward, problem.calibrated) == {"cor_10[clay]"}
    derived = derived_in(problem)
    assert {*derived} == {
        "cor_median[clay]",
        "cor_median[hard]",
        "court_pace[clay]",
        "court_pace[hard]",
        "mu[clay]-mu[hard]",
        "mu[clay]/mu[hard]",
        "cor_10[clay]-cor_10[hard]",
        "cor_10[clay]/cor_10[hard]",
    }
    assert derived["cor_10[clay]-cor_10[hard]"].extrapolated
    assert not derived["mu[clay]-mu[hard]"].extrapolated
    of_levels = {
        "mu[clay]": 0.3,
        "mu[hard]": 0.25,
        "cor_10[clay]": 0.7,
        "cor_10[hard]": 0.8,
    }
    values = draws_of(problem, {**SLIDING, **of_levels})
    pace_of_hard = derived["court_pace[hard]"].rule(values)
    assert pace_of_hard == pytest.approx(75.0 + 150.0 * 0.01)
    cor_of_clay = derived["cor_median[clay]"].rule(values)
    assert cor_of_clay == pytest.approx(0.7)
    # The median of all lies between the surfaces.
    assert derived["cor_median[clay]"].extrapolated
    assert derived["cor_median[hard]"].extrapolated
    spec = problem.prior.parameters[1].spec
    assert quantity_of(spec).rule(values)[0] == of_levels[spec.name]


def test_the_surfaces_farthest_apart_and_the_chance_of_it():
    labels = {"surface": tuple("abc" * 6)}
    problem = problem_of(
        table_of(REBOUND, count=18),
        None,
        "grip-slip",
        pool={"mu": "none", "cor_10": "none"},
    )
    assert level_differences(problem.forward, Draws({}, {}, {})).empty
    v_y = np.linspace(6.0, 14.0, 18)
    problem = grip_slip(3.0 * v_y, v_y, labels=labels)
    rng = np.random.default_rng(4)
    point = truth_of(problem) | {"mu[a]": 0.60, "mu[b]": 0.50, "mu[c]": 0.58}
    draws = {name: value + 0.04 * rng.standard_normal(20000) for name, value in point.items()}
    row = level_differences(problem.forward, Draws(point, draws, {})).loc["mu"]
    assert row["low"] == "b"
    assert row["high"] == "a"
    assert row["column"] == "surface"
    law = stats.norm(0.1, 0.04 * np.sqrt(2.0))
    assert row["difference"] == pytest.approx(0.1, abs=2e-3)
    assert row["sd"] == pytest.approx(law.std(), rel=0.03)
    # Three pairs, on either side.
    chance = 2.0 * 3.0 * law.cdf(0.0)
    assert row["p"] == pytest.approx(chance, rel=0.1)
    no_draws = dict.fromkeys(point, np.empty(0))
    only_point = level_differences(problem.forward, Draws(point, no_draws, {})).loc["mu"]
    assert only_point["difference"] == pytest.approx(0.1)
    assert np.isnan(only_point["p"])
    assert np.isnan(only_point["sd"])


def _two_surfaces(**choices):
    """A problem of two surfaces with friction of their own, and draws of its parameters."""
    v_y = np.linspace(6.0, 14.0, 18)
    labels = {"surface": tuple("ab" * 9)}
    problem = grip_slip(3.0 * v_y, v_y, labels=labels)
    problem = replace(problem, choices=msgspec.structs.replace(problem.choices, **choices))
    rng = np.random.default_rng(5)
    truth = truth_of(problem) | {"mu[a]": 0.6, "mu[b]": 0.5}
    draws = {name: value + 0.01 * rng.standard_normal(500) for name, value in truth.items()}
    return problem, draws


def test_two_levels_have_a_difference_and_a_ratio():
    problem, draws = _two_surfaces()
    derived = derived_in(problem)
    difference = derived["mu[a]-mu[b]"]
    assert difference.rule(draws) == pytest.approx(draws["mu[a]"] - draws["mu[b]"])
    ratio = derived["mu[a]/mu[b]"]
    assert ratio.rule(draws) == pytest.approx(draws["mu[a]"] / draws["mu[b]"])
    assert "cor_slope[a]-cor_slope[b]" not in derived
    three = grip_slip(
        np.linspace(18.0, 42.0, 18),
        np.linspace(6.0, 14.0, 18),
        labels={"surface": tuple("abc" * 6)},
    )
    assert not any("]-" in name for name in derived_in(three))


def test_a_formula_may_use_what_follows_from_parameters():
    formulas = {"loss": "1 - court_pace[a]/100", "lever": "offset/2"}
    problem, draws = _two_surfaces(derive=formulas)
    derived = derived_in(problem)
    pace = derived["court_pace[a]"]
    assert derived["loss"].rule(draws) == pytest.approx(1.0 - pace.rule(draws) / 100.0)
    assert derived["loss"].extrapolated == pace.extrapolated
    assert derived["lever"].spec.unit == "m"


def test_a_formula_without_labels_is_taken_at_every_level():
    formulas = {"court": "mu*(1 + cor_10)", "loss": "1 - court_pace/100", "lever": "2*offset"}
    problem, draws = _two_surfaces(derive=formulas)
    problem.refuse_unknown_names()
    derived = derived_in(problem)
    assert "court" not in derived
    for label in "ab":
        expected = draws[f"mu[{label}]"] * (1.0 + draws[f"cor_10[{label}]"])
        assert derived[f"court[{label}]"].rule(draws) == pytest.approx(expected, rel=1e-15)
        pace = derived[f"court_pace[{label}]"]
        loss = derived[f"loss[{label}]"]
        assert loss.rule(draws) == pytest.approx(1.0 - pace.rule(draws) / 100.0, rel=1e-15)
        assert loss.extrapolated == pace.extrapolated
        assert loss.parts == (f"court_pace[{label}]",)
    # What surfaces share has one value.
    assert "lever[a]" not in derived
    assert derived["lever"].rule(draws) == pytest.approx(2.0 * draws["offset"])
    assert derived["lever"].spec.display_unit == SPECS["offset"].display_unit


def test_a_label_in_a_formula_stays_at_every_level():
    problem, draws = _two_surfaces(derive={"rel": "mu/mu[b]", "shared": "mu*offset"})
    derived = derived_in(problem)
    assert derived["rel[a]"].rule(draws) == pytest.approx(draws["mu[a]"] / draws["mu[b]"])
    assert np.unique(derived["rel[b]"].rule(draws)).tolist() == [1.0]
    assert derived["shared[a]"].rule(draws) == pytest.approx(draws["mu[a]"] * draws["offset"])
    assert derived["shared[a]"].spec.unit == "m"


def test_levels_of_two_columns_are_taken_as_they_were_measured_together():
    v_y = np.linspace(6.0, 14.0, 24)
    # Ball 1 was never measured on surface b.
    labels = {"surface": tuple("ab" * 12), "ball": tuple("1232" * 6)}
    incident = {"v_x1": 3.0 * v_y, "v_y1": v_y, "omega_1": 0.0}
    rebound = {"v_x2": np.ones(24), "v_y2": 0.7 * v_y, "omega_2": np.ones(24)}
    table = impact_table({**incident, **rebound}, labels=labels)
    pool = {"mu": "surface", "cor_10": "ball"}
    problem = problem_of(table, None, "grip-slip", pool=pool)
    formulas = {"court": "mu*(1 + cor_10)"}
    problem = replace(problem, choices=msgspec.structs.replace(problem.choices, derive=formulas))
    derived = derived_in(problem)
    names = {name for name in derived if name.startswith("court[")}
    assert names == {"court[a, 1]", "court[b, 2]", "court[a, 3]"}
    values = {name: np.array([value]) for name, value in truth_of(problem).items()}
    values |= {"mu[a]": np.array([0.6]), "cor_10[3]": np.array([0.7])}
    assert derived["court[a, 3]"].rule(values) == pytest.approx([0.6 * 1.7], rel=1e-15)


def test_a_quantity_of_held_values_is_fixed():
    fit = fitball.calibrate(
        "wang_zero_spin",
        model="grip-slip",
        fix={"mu": 0.6},
        derive={"twice": "2*mu"},
        point_only=True,
    )
    held = fit.derived["twice"]
    assert held.verdict == "fixed"
    assert held.point == pytest.approx(1.2, rel=1e-15)
    assert np.isnan(held.sd)
    assert all("twice" not in tried.summaries for tried in fit.alternatives)


@pytest.mark.parametrize(
    ("name", "text", "code"),
    [
        ("own", "k_y*mu[a]", "unknown-parameter"),
        ("own", "mu[c]*cor_10", "unknown-parameter"),
        ("mu", "cor_10", "derive"),
        ("court_pace", "cor_10", "derive"),
        ("mu[a]", "mu[b]", "derive"),
        ("court_pace[a]", "mu[b]", "derive"),
        ("", "mu[b]", "derive"),
        ("own", "offset + mu[b]", "derive"),
    ],
)
def test_formulas_that_derive_nothing_are_refused(name, text, code):
    problem, _ = _two_surfaces(derive={name: text})
    with pytest.raises(ParameterError) as caught:
        problem.refuse_unknown_names()
    assert caught.value.code == code


def test_a_variant_leaves_out_formulas_of_other_parameters():
    problem, _ = _two_surfaces(derive={"own": "k_y*mu[a]", "other": "2*mu[a]"})
    assert {"own", "other"} & {*derived_in(problem)} == {"other"}
