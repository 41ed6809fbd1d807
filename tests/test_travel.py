"""Balls that fly either way and straight down: mirror images to the last digit, one smooth rule for
the offset, whatever the model and whoever asks.
"""

import numpy as np
import pytest
from support.travel import acting

import fitball
from fitball.base.values import Ball, Impacts
from fitball.models.registry import MODELS, option_variants
from fitball.models.types import Status

RADIUS = Ball().radius
RATIO = Ball().inertia_ratio
OFFSETS = ("eps_10", "eps_slope", "offset")
TURNED = ("v_x2", "omega_2", "gap_path", "gap_turn")
KEPT = ("v_y2", "contact_time", "gap_time", "regime", "status")
FULL = np.tan(np.radians(2.0))
VALUES = {
    "eps_10": 2.4e-3,
    "eps_slope": 1e-4,
    "offset": 2.4e-3,
    "e_x": 0.1,
    "cor_10": 0.76,
    "cor_slope": -0.01,
    "mu": 0.55,
}


def pushed(v_x1, v_y1, omega_1, ball, mu="uniform(0, 1)", offset="normal(0, 0.005)"):
    """A user's model: a ball that slides or grips, and is turned by an offset."""
    push = 1.7 * v_y1
    a = ball.inertia / (ball.mass * ball.radius**2)
    grip = a / (1.0 + a) * (v_x1 - ball.radius * omega_1)
    lost = np.clip(grip, -mu * push, mu * push)
    turned = (ball.radius * lost - offset * push) * ball.mass / ball.inertia
    return v_x1 - lost, 0.7 * v_y1, omega_1 + turned


VARIED = [fitball.model(text) for text in ("two-mass", "thesis-exact")]
MADE = [*MODELS, *option_variants(VARIED[0]), *option_variants(VARIED[1])]


def of_text(text):
    return fitball.model_from(pushed) if text == "pushed" else fitball.model(text)


def values_of(model, **changes):
    values = {spec.name: VALUES.get(spec.name, spec.typical) for spec in model.parameters}
    return values | changes


def draws_of(model, count=20):
    """Names and values (draws, names) near the typical ones, with offsets of either sign."""
    rng = np.random.default_rng(3)
    values = values_of(model)
    columns = []
    for name, value in values.items():
        spread = rng.normal(1.0, 0.02, count)
        if name in OFFSETS:
            spread = rng.normal(0.0, 1.0, count)
        columns.append(value * spread)
    return [*values], np.stack(columns, axis=1)


def impacts_of(count=60):
    """Impacts all around the vertical, of which some fall straight down."""
    rng = np.random.default_rng(4)
    v_y1 = rng.uniform(3.0, 20.0, count)
    slopes = rng.choice([0.0, 0.01, 0.03, 0.2, 3.0], count)
    v_x1 = v_y1 * slopes * rng.uniform(-1.0, 1.0, count)
    omega_1 = rng.choice([0.0, 400.0], count) * rng.uniform(-1.0, 1.0, count)
    return Impacts(v_x1, v_y1, omega_1)


def mirrored(impacts):
    return Impacts(-impacts.v_x1, impacts.v_y1, -impacts.omega_1)


@pytest.mark.parametrize("text", [*MADE, "pushed"])
def test_mirrored_impacts_have_mirrored_rebounds_to_the_last_digit(text):
    model = of_text(text)
    names, draws = draws_of(model)
    for impacts in (impacts_of(), Impacts(*np.random.default_rng(1).normal(9.0, 4.0, (3, 20, 30)))):
        right = model.evaluate(names, draws, impacts)
        left = model.evaluate(names, draws, mirrored(impacts))
        assert (right.status == 0).mean() > 0.5
        for name in TURNED:
            assert np.array_equal(getattr(right, name), -getattr(left, name), equal_nan=True), name
        for name in KEPT:
            assert np.array_equal(getattr(right, name), getattr(left, name), equal_nan=True), name


@pytest.mark.parametrize("text", [*MADE, "pushed"])
def test_beyond_two_degrees_of_the_vertical_nothing_changes(text):
    model = of_text(text)
    names, draws = draws_of(model)
    rng = np.random.default_rng(5)
    v_y1 = rng.uniform(3.0, 20.0, 30)
    v_x1 = v_y1 * FULL * (1.0 + 10.0 ** rng.uniform(-9.0, 2.0, 30))
    impacts = Impacts(v_x1, v_y1, rng.uniform(-300.0, 300.0, 30))
    rebound = model.evaluate(names, draws, impacts)
    solved = model.solve(model.ball, names, draws, impacts, None)
    for name in (*TURNED, *KEPT):
        assert np.array_equal(getattr(rebound, name), getattr(solved, name), equal_nan=True), name


@pytest.mark.parametrize("text", [*MADE, "pushed"])
def test_near_the_vertical_the_solver_has_the_offset_of_the_manual(text):
    """Each draw of each impact with its own: impacts of all draws, of each, and restitution of
    each.
    """
    model = of_text(text)
    names, draws = draws_of(model, 5)
    impacts = impacts_of()
    of_each = Impacts(*(np.tile(state, (5, 1)) for state in vars(impacts).values()))
    cor = np.where(np.arange(60) % 2, 0.7, np.nan)
    steep = np.abs(impacts.v_x1) < FULL * impacts.v_y1
    assert 10 < steep.sum() < 50
    for law in (None, cor):
        rebound = model.evaluate(names, draws, impacts, law)
        again = model.evaluate(names, draws, of_each, law)
        for name in (*TURNED, *KEPT):
            same = np.array_equal(getattr(rebound, name), getattr(again, name), equal_nan=True)
            assert same, name
        for k in np.flatnonzero(steep):
            one = impacts.take(np.array([k]))
            share = abs(acting(one.v_x1, one.v_y1))
            less = draws.copy()
            for column, name in enumerate(names):
                if name in OFFSETS:
                    less[:, column] *= share
            side = one.side
            forwards = Impacts(side * one.v_x1, one.v_y1, side * one.omega_1)
            given = None if law is None else law[[k]]
            wanted = model.solve(model.ball, names, less, forwards, given)
            good = wanted.status[:, 0] == 0
            for name, turn in (("v_x2", side), ("v_y2", 1.0), ("omega_2", side)):
                answer = getattr(rebound, name)[good, k]
                expected = turn * getattr(wanted, name)[good, 0]
                assert answer == pytest.approx(expected, rel=1e-12, abs=1e-12), name


@pytest.mark.parametrize("text", MADE)
def test_no_rebound_jumps_through_the_vertical(text):
    """Two steps are together less than 2e-3 of what the whole range changes, and so is the change
    of the slope at the ends of the rule.
    """
    model = fitball.model(text)
    values = values_of(model)
    v_x1 = np.linspace(-1.5, 1.5, 6001)
    rebound = model.rebound(values, fitball.impacts(v_x1, 12.0))
    for course in (rebound.v_x2, rebound.omega_2):
        assert course[3000] == 0.0
        size = np.ptp(course)
        assert np.abs(np.diff(course)).max() < 5e-3 * size
    assert rebound.v_x2[3001] == -rebound.v_x2[2999]


def test_at_the_vertical_the_slope_is_that_of_the_closed_form():
    """Of a ball without spin that grips: v_x2 = v_x1 - H/M with the share of the offset there."""
    model = fitball.model("grip-slip")
    values = values_of(model, mu=3.0, cor_slope=0.0)
    share_per_slope = 15.0 / 8.0 / FULL
    a = RATIO
    grip = a * (1.0 + values["e_x"]) / (1.0 + a)
    offset = values["offset"] * (1.0 + values["cor_10"]) / ((1.0 + a) * RADIUS)
    wanted = 1.0 - grip - share_per_slope * offset
    for step in (1e-3, 1e-6, 1e-9):
        pair = model.rebound(values, fitball.impacts([-step, step], 12.0))
        slope = float(np.diff(pair.v_x2)[0]) / (2.0 * step)
        assert slope == pytest.approx(wanted, rel=1e-9 + (step / 12.0 / FULL) ** 2)


def test_where_the_rule_ends_slope_and_curvature_are_those_beyond():
    model = fitball.model("grip-slip")
    values = values_of(model, mu=3.0, cor_slope=0.0)
    h = 1e-3
    end = 12.0 * FULL
    inside = model.rebound(values, fitball.impacts(end - h * np.arange(4), 12.0)).v_x2
    beyond = model.rebound(values, fitball.impacts(end + h * np.arange(4), 12.0)).v_x2
    # The share is short of 1 by 5/2 of the cube of the distance from its end.
    short = 2.5 * (h * np.arange(4) / end) ** 3
    pushed_by = values["offset"] * (1.0 + values["cor_10"]) * 12.0 / ((1.0 + RATIO) * RADIUS)
    straight = inside[0] - (beyond - beyond[0])
    assert inside == pytest.approx(straight + pushed_by * short, abs=1e-7)


@pytest.mark.parametrize("text", ["two-mass", "thesis-exact"])
def test_courses_mirror_and_end_with_the_rebound(text):
    model = fitball.model(text)
    values = values_of(model)
    for v_x1, omega_1 in ((10.0, 50.0), (0.1, 20.0), (0.0, 40.0), (0.0, 0.0)):
        right = fitball.impacts(v_x1, 12.0, omega_1)
        left = fitball.impacts(-v_x1, 12.0, -omega_1)
        rebound = model.rebound(values, right)
        times = np.linspace(0.0, 1.0, 7) * rebound.contact_time[0]
        here = model.history(values, right, times)
        there = model.history(values, left, times)
        assert here.courses["v_x"][-1] == pytest.approx(rebound.v_x2[0], abs=1e-12)
        for name in ("v_x", "omega_core", "omega_shell", "twist", "slip", "friction_force"):
            assert np.array_equal(here.courses[name], -there.courses[name]), name
        for name in ("y", "v_y", "normal_force"):
            assert np.array_equal(here.courses[name], there.courses[name]), name
        assert np.array_equal(here.phase, there.phase)


def test_what_has_no_answer_has_none_on_either_side():
    model = fitball.model("two-mass")
    names, draws = draws_of(model, 3)
    impacts = Impacts(
        np.array([0.1, -0.1, 0.0, np.nan, -5.0]),
        np.array([-1.0, 0.0, -1.0, 5.0, -2.0]),
        np.zeros(5),
    )
    rebound = model.evaluate(names, draws, impacts)
    assert np.isnan(rebound.v_x2).all()
    assert (rebound.status[:, [0, 1, 2, 4]] == Status.NO_IMPACT).all()


@pytest.mark.parametrize("text", ["two-mass", "pushed"])
def test_a_table_of_drops_with_spin_has_the_rebounds_of_its_impacts(text):
    """All impacts are steep, of some draws or of all."""
    model = of_text(text)
    names, draws = draws_of(model, 4)
    rng = np.random.default_rng(6)
    v_x1 = np.array([[0.0, 0.1, -0.2], [0.1, 0.2, 0.0], [0.0, 0.0, 0.0], [-0.1, 0.1, 0.2]])
    v_y1 = rng.uniform(8.0, 12.0, (4, 3))
    omega_1 = rng.uniform(-300.0, 300.0, (4, 3))
    together = model.evaluate(names, draws, Impacts(v_x1, v_y1, omega_1))
    for i in range(4):
        for j in range(3):
            # Beside one that is far from the vertical.
            states = (
                np.array([column[i, j], far])
                for column, far in ((v_x1, 20.0), (v_y1, 8.0), (omega_1, 0.0))
            )
            alone = model.evaluate(names, draws[[i]], Impacts(*states))
            for name in (*TURNED, *KEPT):
                expected = getattr(alone, name)[0, 0]
                answer = getattr(together, name)[i, j]
                assert answer == expected or (np.isnan(answer) and np.isnan(expected)), name
