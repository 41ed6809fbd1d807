"""Time, path and turn between the flights: laws they obey, and the motion itself integrated."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

import fitball
from fitball.models.oracle import oracle_rebound
from fitball.models.types import regime_name

BALL = {
    "mass_ratio": 0.883, "k_y": 2.0e4, "k_theta": 19.0, "mu": 0.568, "eps_10": 2.38e-3, "eps_slope": 0.0,
    "cor_10": 0.774, "cor_slope": -0.0151,
}  # fmt: skip
FAST, STEEP, BACKSPIN = (14.0, 9.0, 40.0), (5.0, 12.0, 0.0), (22.0, 7.0, -250.0)
NODES, WEIGHTS = leggauss(40)


def integrated(model, values, impact, name):
    """The integral of a course over the contact, phase by phase, each smooth."""
    ends = model.history(values, impact, [0.0])
    edges = np.concatenate([[0.0], ends.transition_shares, [1.0]]) * ends.contact_time
    total = 0.0
    for begin, end in pairwise(edges):
        times = np.clip(0.5 * (begin + end) + 0.5 * (end - begin) * NODES, 0.0, ends.contact_time)
        course = getattr(model.history(values, impact, times), name)
        total += 0.5 * (end - begin) * float(WEIGHTS @ np.ravel(course))
    return total


@pytest.mark.parametrize("state", [FAST, STEEP, BACKSPIN])
@pytest.mark.parametrize("release", ["zero_force", "zero_displacement"])
def test_the_gaps_are_what_the_motion_adds_up_to(state, release):
    """T by the height at release, P and Q by quadrature of the courses; Q with its share of the twist."""
    model = fitball.model("two-mass", release=release)
    values, impact = {name: BALL[name] for name in model.parameter_names}, fitball.impacts(*state)
    rebound = model.rebound(values, impact)
    end = model.history(values, impact, rebound.contact_time)
    v_x2, v_y2, omega_2 = (float(getattr(rebound, name)[0]) for name in ("v_x2", "v_y2", "omega_2"))
    late = float(end.y[-1]) / v_y2
    assert rebound.gap_time[0] == pytest.approx(float(rebound.contact_time[0]) + late, rel=1e-12)
    path = integrated(model, values, impact, "v_x") + v_x2 * late
    assert rebound.gap_path[0] == pytest.approx(path, abs=1e-10)
    ratio = BALL["mass_ratio"]
    core, shell = 0.4 * 0.97**2 * ratio, 2.0 / 3.0 * (1.0 - ratio)
    turn = integrated(model, values, impact, "omega_2") + omega_2 * late
    left = core / (core + shell) * float(end.twist[-1])
    assert rebound.gap_turn[0] == pytest.approx(turn + left, abs=1e-9)
    # The twist that is left counts: without it the turn would be another.
    assert abs(left) > 1e-3


def test_a_ball_that_grips_throughout_rolls_its_path():
    model = fitball.model("two-mass")
    values = {**BALL, "mu": 3.0, "eps_10": 0.0}
    impact = fitball.impacts(0.0, 9.0, 0.0)
    spinning = fitball.impacts(model.ball.radius * 90.0, 9.0, 90.0)
    assert model.rebound(values, impact).gap_path[0] == pytest.approx(0.0, abs=1e-15)
    soft = {**values, "k_theta": 19.0}
    rebound = model.rebound(soft, spinning)
    assert regime_name(int(rebound.regime[0])) == "grip"
    rolled = integrated(model, soft, spinning, "omega_2") * model.ball.radius
    own = rebound.gap_path - rebound.v_x2 * (rebound.gap_time - rebound.contact_time)
    assert own[0] == pytest.approx(rolled, rel=1e-10)


@pytest.mark.parametrize("torsion", ["matched", "rigid"])
def test_without_friction_a_ball_goes_on(torsion):
    model = fitball.model("two-mass", torsion=torsion)
    values = {name: {**BALL, "mu": 0.0, "eps_10": 0.0}[name] for name in model.parameter_names}
    impact = fitball.impacts(*FAST)
    rebound = model.rebound(values, impact)
    assert rebound.gap_path[0] == pytest.approx(FAST[0] * rebound.gap_time[0], rel=1e-13)
    assert rebound.gap_turn[0] == pytest.approx(FAST[2] * rebound.gap_time[0], rel=1e-13)


def test_the_press_in_at_release_has_a_closed_form():
    """With `zero_force` the ball leaves pressed in by 2 zeta e v/omega_y, with `zero_displacement` not at all."""
    values, impact = BALL, fitball.impacts(*FAST)
    for release, pressed in (("zero_force", True), ("zero_displacement", False)):
        rebound = fitball.model("two-mass", release=release).rebound(values, impact)
        assert bool(rebound.gap_time[0] - rebound.contact_time[0] > 1e-5) is pressed


@pytest.mark.parametrize("state", [FAST, STEEP, BACKSPIN])
def test_gaps_to_thirty_digits(state):
    model, impact = fitball.model("two-mass"), fitball.impacts(*state)
    found, exact = model.rebound(BALL, impact), oracle_rebound(model.closures, model.ball, BALL, impact, digits=30)
    for name in ("gap_time", "gap_path", "gap_turn"):
        assert getattr(found, name)[0] == pytest.approx(getattr(exact, name)[0], rel=1e-12), name


def test_models_without_a_course_have_no_gaps():
    known = {"mu": 0.5, "e_x": 0.1, "offset": 0.003, "cor_10": 0.75, "cor_slope": -0.014}
    assert np.isnan(fitball.model("grip-slip").rebound(known, fitball.impacts(*FAST)).gap_path[0])
