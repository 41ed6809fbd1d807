"""Best values on bounds of priors, profiles as wide as priors: against least squares by numpy."""

from dataclasses import replace

import numpy as np
import pytest
from made_tables import impact_table
from msgspec import structs
from support.fits import at, bounded, drops_of, line

import fitball
from fitball.inference.judgement.bounds import NO_BOUNDS, at_bounds
from fitball.inference.judgement.first_order import first_order
from fitball.inference.judgement.profile import profiles
from fitball.inference.judgement.verdict import judge, qualify
from fitball.inference.schema import UNDETERMINED, Adequacy, PointFit
from fitball.inference.search.objective import Objective, descend
from fitball.report import fit_words
from fitball.report.frame_rows import frame_rows

SPEEDS = np.linspace(5.0, 17.0, 9)
SD = 0.05
NOISE = SD * np.random.default_rng(1).standard_normal(9)
# Rebounds by the line a = 0.7, b = -0.02, and the columns that a and b are factors of.
REBOUNDS = 0.7 * SPEEDS - 0.02 * (SPEEDS - 10.0) + NOISE
COLUMNS = np.stack([SPEEDS, SPEEDS - 10.0], axis=1)
COVARIANCE = SD**2 * np.linalg.inv(COLUMNS.T @ COLUMNS)
DESCRIBES = Adequacy("describes", "", (), (), {}, {})


def judged(function, x, **choices):
    """The bounds and judgements of the drops with known noise, searched from (a, b)."""
    problem = drops_of(function, SPEEDS, REBOUNDS, fix={"v_y_sd": SD}, **choices)
    reached, _, _ = descend(Objective(problem), np.array([x]), 1e-10)
    point = at(problem, reached[0])
    linear = first_order(problem, point)
    bounds = at_bounds(problem, point, linear, ())
    profiled = profiles(problem, reached)
    return bounds, judge(problem, point, linear, profiled, (), bounds)


@pytest.mark.parametrize("bound", [0.0, 0.02])
def test_a_bound_that_the_data_pass_is_named_with_what_they_favour(bound):
    prior = {"b": f"uniform({bound:g}, 1)"}
    bounds, within = judged(line, [0.7, bound + 0.1], prior=prior)
    assert bounds.bound == {"b": bound}
    free, *_ = np.linalg.lstsq(COLUMNS, REBOUNDS)
    assert bounds.beyond["b"] == pytest.approx(free[1], rel=1e-3)
    held = np.sum(SPEEDS * (REBOUNDS - bound * COLUMNS[:, 1])) / np.sum(SPEEDS**2)
    moved = abs(free[0] - held) / COVARIANCE[0, 0] ** 0.5
    assert bounds.moves["a"] == pytest.approx(moved, rel=0.01)
    assert (within["b"].verdict, within["b"].rule) == ("prior-dominated", "at-bound")
    assert moved > 1.0
    final = qualify(within, DESCRIBES, {}, bounds.doubts())
    assert final["a"].verdict == "conditional"
    assert final["b"] == within["b"]


def test_limits_of_the_parameter_itself_are_no_bounds_of_a_prior():
    """That they end where they do is no choice of the user."""
    bounds, within = judged(bounded, [0.7, 0.1])
    assert bounds == NO_BOUNDS
    assert (within["b"].verdict, within["b"].open_side) == ("one-sided", "below")


def test_bounds_far_from_the_best_value_change_nothing():
    bounds, within = judged(line, [0.7, 0.1], prior={"b": "uniform(-1, 1)"})
    assert bounds == NO_BOUNDS
    assert within["b"].verdict == "identified"


@pytest.mark.parametrize(("ratio", "rule"), [(0.9, "wide"), (1.1, "determined")])
def test_a_profile_counts_if_it_is_narrower_than_the_prior(ratio, rule):
    """With known noise the profile is normal with the standard error of least squares."""
    free, *_ = np.linalg.lstsq(COLUMNS, REBOUNDS)
    width = ratio * COVARIANCE[1, 1] ** 0.5
    _, within = judged(line, [0.7, 0.0], prior={"b": f"normal({free[1]:.6f}, {width:.8f})"})
    assert within["b"].rule == rule
    assert within["b"].verdict == ("prior-dominated" if rule == "wide" else "identified")


def test_a_profile_about_another_peak_determines_nothing():
    """The median lies elsewhere, or the best value of most of the posterior does."""
    problem = drops_of(line, SPEEDS, REBOUNDS, fix={"v_y_sd": SD})
    reached, _, _ = descend(Objective(problem), np.array([[0.7, 0.0]]), 1e-10)
    point = at(problem, reached[0])
    profiled = profiles(problem, reached)
    best = point.optima[0]

    def rule(point, medians=()):
        linear = first_order(problem, point)
        given = {"medians": medians} if medians else {}
        judgement = judge(problem, point, linear, profiled, (), **given)["b"]
        return judgement.rule, judgement.verdict

    assert rule(point) == ("determined", "identified")
    assert rule(point, {"b": best["b"]}) == ("determined", "identified")
    assert rule(point, {"b": 0.1}) == ("elsewhere", "conditional")
    far = {**best, "b": 0.1}
    two = PointFit((far, best), (0.0, 0.1), 0.0, {})
    assert rule(two) == ("elsewhere", "conditional")
    # Without a peak within the profile it is the prior that holds the value off.
    assert rule(PointFit((far,), (0.0,), 0.0, {})) == ("held-off", "prior-dominated")


def test_a_value_that_is_bounded_is_shown_by_its_bound():
    columns = {"v_y1": SPEEDS, "v_y2": REBOUNDS}
    table = impact_table({"v_x1": 0.0 * SPEEDS, "omega_1": 0.0 * SPEEDS, **columns})
    fit = fitball.calibrate(table, model=fitball.model_from(bounded), cores=1)
    rows = {row.text("name"): row for row in frame_rows(fit.summary)}
    unit = fit.quantity("b").spec.display_unit
    value, interval = fit_words.shown_texts(fit, rows["b"], unit)
    sign, _, number = value.partition(" ")
    assert (sign, interval) == ("<", "")
    rounding = 5.0 * max(fit.end_errors["b"])
    assert float(number) == pytest.approx(fit.parameters["b"].q975, abs=rounding)
    assert "=" not in fit_words.value_words(fit, ["b"])[0]
    assert "[" in fit_words.shown_texts(fit, rows["a"], unit)[1]


def test_least_squares_and_verdicts_that_differ_are_explained():
    fit = fitball.calibrate("synthetic_drop", point_only=True, cores=1)
    assert not fit_words.least_squares_differs(fit)
    squares = structs.replace(fit.least_squares, missing={"cor_10": UNDETERMINED})
    (line_of_text,) = fit_words.least_squares_differs(replace(fit, least_squares=squares))
    assert line_of_text.startswith("cor_10:")
    open_value = structs.replace(fit.parameters["cor_10"], verdict="one-sided")
    parameters = {**fit.parameters, "cor_10": open_value}
    (line_of_text,) = fit_words.least_squares_differs(replace(fit, parameters=parameters))
    assert line_of_text.startswith("cor_10:")


def test_a_fit_on_a_bound_says_so():
    prior = {"mu": "uniform(0.62, 0.9)"}
    fit = fitball.calibrate("wang_all", model="grip-slip", prior=prior, point_only=True, cores=1)
    note = next(note.text for note in fit.notes if note.code == "at-bound")
    assert note.startswith("mu:")
    assert " ".join(note.replace("`", "").split()) in " ".join(fit.report().split())
    assert fit.parameters["mu"].verdict == "prior-dominated"
    free = fitball.calibrate("wang_all", model="grip-slip", point_only=True, cores=1)
    without = float(note.partition("it is ")[2].partition(". ")[0])
    assert without == pytest.approx(free.parameters["mu"].point, rel=0.01)
    # The sd of a value about the bound: those that it moves farther are conditional.
    assert fit.parameters["offset"].verdict == "conditional"
    assert not any(note.code == "at-bound" for note in free.notes)
