"""Constants of the ball: held with their tolerance, stated with an sd, fixed on request."""

import numpy as np
import pytest
from support.density import BALL, REBOUND, TIMED, near, problem_of, table_of
from support.fits import at, best

import fitball
from fitball.data.scene import BallSection, Scene, ValueWithSd
from fitball.inference.judgement.constants import constants
from fitball.inference.judgement.first_order import first_order
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.report import fit_tables


def test_a_tennis_ball_of_which_nothing_is_stated_has_the_inertia_of_both_readings():
    """The bifilar test of Jafri (2004): a cycle took 1.516 s, on strings of 40 in; its
    lever of 1.25 in, or the radius of 1.3 in, makes a ratio of it.
    """
    square = (2.0 * np.pi / 1.516) ** 2
    by_lever = 9.81 / (1.016 * square)
    by_radius = by_lever * (1.25 / 1.3) ** 2
    ball = Scene().ball_value()
    assert ball.inertia_ratio == pytest.approx(0.5 * (by_lever + by_radius), abs=0.005)
    # The thesis's own ball is another.
    assert fitball.Ball().inertia_ratio == pytest.approx(by_lever, abs=0.003)
    problem = build_problem(table_of(REBOUND), Scene(), Choices("grip-slip"))
    first = first_order(problem, at(problem, best(problem)))
    held = {constant.name: constant for constant in constants(problem, first, ())}
    inertia = held["inertia_ratio"]
    assert (inertia.low, inertia.high) == pytest.approx((0.48, 0.60))
    assert inertia.low < min(by_lever, by_radius)
    assert max(by_lever, by_radius) < inertia.high


def test_a_fixed_inertia_is_that_of_a_scene():
    table = table_of(REBOUND)
    stated = fitball.calibrate(
        table, scene=Scene(ball=BallSection(inertia_ratio=0.56)), model="grip-slip", point_only=True
    )
    fixed = fitball.calibrate(
        table, model="grip-slip", fix={"inertia_ratio": 0.56}, point_only=True
    )
    usual = fitball.calibrate(table, model="grip-slip", point_only=True)
    for name in ("mu", "e_x", "offset", "cor_10"):
        wanted = stated.parameters[name].point
        assert fixed.parameters[name].point == pytest.approx(wanted, rel=1e-6, abs=1e-9)
    assert abs(usual.parameters["offset"].point - stated.parameters["offset"].point) > 1e-5
    assert fixed.parameters["inertia_ratio"].verdict == "fixed"
    at_20 = {"impact": "v_x1=20, v_y1=8, omega_1=50"}
    frames = [fit.predict(**at_20).frames["predictions"] for fit in (stated, fixed)]
    assert frames[0]["point"].tolist() == pytest.approx(frames[1]["point"].tolist(), rel=1e-6)
    free = fitball.calibrate(
        table, model="grip-slip", prior={"inertia_ratio": "normal(0.54, 0.03)"}, point_only=True
    )
    assert free.parameters["inertia_ratio"].kind == "ball"


@pytest.mark.parametrize("share", [0.005, 0.02])
def test_the_sd_of_a_mass_is_carried_to_the_stiffness(share):
    """A stiffness is as the mass over the square of the contact time."""
    mass = ValueWithSd(BALL.mass, share * BALL.mass)
    table = table_of(TIMED, count=20)

    def sd_of_log_stiffness(mass):
        scene = Scene(ball=BallSection(mass=mass, inertia_ratio=BALL.inertia_ratio))
        problem = problem_of(table, scene, "two-mass+normal=total")
        first = first_order(problem, at(problem, near(problem, 1, 0.0)[0]))
        k = first.names.index("k_y")
        return np.linalg.norm(first.root[k]) * first.sds[k]

    held = sd_of_log_stiffness(BALL.mass)
    carried = sd_of_log_stiffness(mass)
    assert carried == pytest.approx(np.hypot(held, share), rel=0.02)


def test_the_page_says_how_far_each_constant_moves_each_value():
    fit = fitball.calibrate("wang_zero_spin", max_steps=1000, cores=1)
    table = fit_tables.constant_table(fit)
    rows = {row["value"]: row for row in table.rows}
    heads = {constant.name: fit_tables._range_text(constant) for constant in fit.constants}
    assert {"ball_mass", "ball_radius", "inertia_ratio", "tilt"} <= {*heads}
    for name in ("k_y", "mu", "cor_10", "eps_10"):
        estimate = fit.parameters[name]
        for constant in fit.constants:
            cell = rows[name][heads[constant.name]]
            moved = constant.moves[name]
            if not cell:
                assert abs(moved) < 0.05
                continue
            shift, _, sds = cell.partition(" (")
            factor = fit.quantity(name).spec.display_unit.factor
            assert float(sds.split()[0]) == pytest.approx(moved, abs=0.051)
            wanted = moved * estimate.half * factor
            assert float(shift) == pytest.approx(wanted, rel=0.06)
