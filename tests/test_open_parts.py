"""Differences, ratios and formulas of frictions that the data limit on one side only.

Rebounds are those of the model without noise, whose size is known, so all verdicts follow by hand.
"""

import numpy as np
import pandas as pd
import pytest
from made_tables import impact_table
from support.density import problem_of
from support.fits import at
from support.fits import best as best_of

import fitball
from fitball.inference.judgement import verdict as module
from fitball.inference.judgement.first_order import first_order
from fitball.inference.judgement.profile import profiles
from fitball.inference.judgement.verdict import judge

GRIP_SLIP = fitball.model("grip-slip")
TRUTH = {"mu": 0.5, "e_x": 0.15, "offset": 0.002, "cor_10": 0.77, "cor_slope": -0.012}
SDS = {"v_x_sd": 0.25, "v_y_sd": 0.25, "spin_sd": 10.0}
COURT = {"court": "mu*(1+cor_10)"}
# Speeds along and towards the court of balls that grip, whatever more friction there is.
STEEP = (np.linspace(2.0, 5.0, 7), np.linspace(14.0, 18.0, 7))
# One that just slides: with a little more friction it grips, which changes it by half a noise.
# With less its change is large, so that to first order the friction is known to 0.015.
MARGINAL = (np.array([16.3]), np.array([8.0]))
# Two that slide with any such friction, and give it to 0.02.
SLIDING = (np.array([12.0, 12.5]), np.array([3.0, 2.5]))


def columns(**surfaces):
    """The columns of impacts on surfaces by name, each with the balls beside the steep ones."""
    labels = []
    v_x = []
    v_y = []
    for name, (along, towards) in surfaces.items():
        labels += [name] * (STEEP[0].size + along.size)
        v_x += [STEEP[0], along]
        v_y += [STEEP[1], towards]
    states = fitball.impacts(np.concatenate(v_x), np.concatenate(v_y), np.zeros(len(labels)))
    rebound = GRIP_SLIP.rebound(TRUTH, states)
    names = ("v_x2", "v_y2", "omega_2")
    rebounds = {name: np.ravel(rebound.column(name)) for name in names}
    incident = {"v_x1": states.v_x1, "v_y1": states.v_y1, "omega_1": states.omega_1}
    return {**incident, **rebounds}, tuple(labels)


def judged_of(**surfaces):
    """The judgements of impacts on surfaces, at the truth."""
    values, labels = columns(**surfaces)
    table = impact_table(values, labels={"surface": labels})
    problem = problem_of(table, None, "grip-slip", fix=SDS, derive=COURT)
    truth = {name: TRUTH[name.partition("[")[0]] for name in problem.free}
    x = best_of(problem, problem.coordinates(truth))
    point = at(problem, x)
    first = first_order(problem, point)
    return judge(problem, point, first, profiles(problem, x[None]), problem.derived)


def answers(judged, *names):
    """Verdict and open side of judgements by name."""
    return [(judged[name].verdict, judged[name].open_side) for name in names]


PAIR = ("mu[a]-mu[b]", "mu[a]/mu[b]")
OPEN = ("one-sided", "above")


def test_a_part_that_is_open_opens_what_is_made_of_it_on_the_right_side():
    first = judged_of(a=MARGINAL, b=SLIDING)
    assert answers(first, "mu[a]", "mu[b]") == [OPEN, ("identified", "")]
    assert answers(first, *PAIR) == [OPEN, OPEN]
    # More friction is a slower court.
    assert answers(first, "court[a]", "court_pace[a]") == [OPEN, ("one-sided", "below")]
    assert answers(first, "court[b]") == [("identified", "")]
    assert first["mu[a]-mu[b]"].rule == "bounded-part"
    second = judged_of(a=SLIDING, b=MARGINAL)
    assert answers(second, *PAIR) == [("one-sided", "below")] * 2
    # What rests on neither is as sure as it was.
    for judged in (first, second):
        assert answers(judged, "cor_10[a]-cor_10[b]") == [("identified", "")]


def test_two_parts_that_are_open_leave_their_difference_open_on_both_sides():
    judged = judged_of(a=MARGINAL, b=MARGINAL)
    assert answers(judged, "mu[a]", "mu[b]", "court[a]", "court[b]") == [OPEN] * 4
    for name in PAIR:
        assert (judged[name].verdict, judged[name].rule) == ("prior-dominated", "opposed-parts")


def test_parts_that_are_determined_leave_a_difference_determined():
    judged = judged_of(a=SLIDING, b=SLIDING)
    assert answers(judged, *PAIR) == [("identified", "")] * 2


def test_to_first_order_alone_the_difference_looks_determined(monkeypatch):
    """That of the open friction is not half of its variance: the control of the tests above."""
    monkeypatch.setattr(module, "_carrying", lambda *_: {})
    judged = judged_of(a=MARGINAL, b=SLIDING)
    assert answers(judged, "mu[a]", *PAIR) == [OPEN, ("identified", ""), ("identified", "")]


@pytest.fixture(scope="module")
def fit():
    values, labels = columns(a=MARGINAL, b=MARGINAL)
    frame = pd.DataFrame({"surface": labels, **values})
    return fitball.calibrate(frame, model="grip-slip", fix=SDS, point_only=True)


def test_formulas_of_a_finished_fit_are_open_where_their_parts_are(fit):
    assert answers(fit.parameters, "mu[a]", "mu[b]") == [OPEN, OPEN]
    more = fit.derive(
        apart="mu[a] - mu[b]",
        both="mu[a] + mu[b]",
        little="1/mu[a]",
        mixed="cor_10[a]*mu[b]",
        of_derived="court_pace[a]/100",
    )
    assert answers(more.derived, "apart") == [("prior-dominated", "")]
    assert answers(more.derived, "both", "mixed") == [OPEN, OPEN]
    assert answers(more.derived, "little") == [("one-sided", "below")]
    # How a rating moves with what it is made of is not known here.
    assert answers(more.derived, "of_derived") == [("one-sided", "")]
