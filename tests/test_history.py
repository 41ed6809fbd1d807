"""Courses of one impact: forces and velocities are integrals of each other, phases those of the
rebound.
"""

from itertools import groupby, pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

import fitball
from fitball.base.errors import FitballError
from fitball.base.values import Ball
from fitball.models.types import Phase

BALL = Ball()
INERTIA = BALL.inertia_ratio * BALL.mass * BALL.radius**2
VALUES = {
    "mass_ratio": 0.9,
    "k_y": 2.0e4,
    "k_theta": 20.0,
    "mu": 0.56,
    "eps_10": 2.4e-3,
    "eps_slope": 1e-4,
    "cor_10": 0.776,
    "cor_slope": -0.0158,
    "zeta_theta": 0.3,
    "inertia_split": 0.5,
}
# Text, values that differ, impact, and the phases it must pass through.
CASES = [
    ("two-mass", {}, (20.0, 6.0, -100.0), "slide"),
    ("two-mass", {}, (12.0, 10.0, 50.0), "slide, grip, slide back"),
    (
        "two-mass",
        {"k_theta": 206.1, "mu": 0.23, "eps_10": 0.0106, "eps_slope": 0.0, "mass_ratio": 0.81},
        (12.9, 10.2, 481.0),
        "slide, slide back, grip, slide, grip, slide back",
    ),
    (
        "two-mass+torsion=free",
        {
            "k_theta": 94.2,
            "mu": 0.69,
            "eps_10": 0.0022,
            "eps_slope": 0.0,
            "mass_ratio": 0.94,
            "zeta_theta": 0.324,
        },
        (8.1, 8.6, 185.0),
        "grip, slide, grip, slide back",
    ),
    ("two-mass+inertia=table", {}, (16.0, 8.6, 185.0), "slide, grip, slide back"),
    (
        "two-mass+normal=total+offset=grip+torsion=free+spin=shell",
        {"k_theta": 161.4, "mu": 0.7, "eps_10": 0.0108, "eps_slope": 0.0, "zeta_theta": 0.222},
        (18.6, 13.9, 356.0),
        "slide, hold, grip, hold, slide",
    ),
    (
        "thesis-exact",
        {"k_theta": 26.2, "mu": 0.59, "eps_10": 0.0117, "eps_slope": 0.0},
        (16.0, 10.4, -204.0),
        "slide, hold, grip, slide back, free",
    ),
]
NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)


def solved(case):
    """Model, values, impact and rebound of a case."""
    text, changes, components, _ = case
    model = fitball.model(text)
    all_values = {**VALUES, **changes}
    values = {spec.name: all_values[spec.name] for spec in model.parameters}
    impact = fitball.impacts(*components)
    return model, values, impact, model.rebound(values, impact)


def spans(course, end):
    """Ends of the phases, by bisection."""
    grid = np.linspace(0.0, end, 401)
    phases = course(grid).phase
    edges = [0.0]
    for k in np.flatnonzero(np.diff(phases)):
        low = grid[k]
        high = grid[k + 1]
        for _ in range(60):
            middle = 0.5 * (low + high)
            if course([middle]).phase[0] == phases[k]:
                low = middle
            else:
                high = middle
        edges.append(high)
    return [*edges, end]


def offset_of(case, values, v_y1, phases):
    """Offset of the normal force in one phase: of some models it acts in grip alone."""
    text, *_ = case
    only_in_grip = "offset=grip" in text or "thesis" in text
    if only_in_grip and Phase.GRIP not in phases:
        return 0.0
    return values["eps_10"] + values["eps_slope"] * (v_y1 - 10.0)


def check_forces(courses, phases, mu):
    """Coulomb's law, the direction of slip and friction, and a ground that does not pull."""
    friction = courses["friction_force"]
    normal = courses["normal_force"]
    slip = courses["slip"]
    limit = mu * normal * (1.0 + 1e-9) + 1e-9
    assert np.all(abs(friction) <= limit)
    assert np.all(normal >= -1e-9)
    assert np.all(slip * friction <= 1e-9)
    if phases & {Phase.GRIP, Phase.HOLD}:
        assert abs(slip).max() < 1e-11
    surface = courses["v_x"] - BALL.radius * courses["omega_shell"]
    assert_allclose(slip, surface, atol=1e-11)


@pytest.mark.parametrize("case", CASES, ids=[case[3] for case in CASES])
def test_momentum_spin_and_place_are_integrals(case):
    text, _, _, names_of_phases = case
    model, values, impact, rebound = solved(case)

    def course(times):
        return model.history(values, impact, np.asarray(times))

    def v_y_at(time):
        return course([time]).courses["v_y"][0]

    end = float(rebound.contact_time[0])
    edges = spans(course, end)
    first = course([0.0]).courses
    last = course([end]).courses
    change = {name: float(last[name][0] - first[name][0]) for name in first}
    total = {
        "normal_force": 0.0,
        "friction_force": 0.0,
        "moment": 0.0,
        "v_y": 0.0,
        "turning": 0.0,
        "v_x": 0.0,
    }
    for low, high in pairwise(edges):
        half = 0.5 * (high - low)
        history = course(0.5 * (low + high) + half * NODES)
        courses = history.courses
        phases = set(history.phase.tolist())
        assert len(phases) == 1
        check_forces(courses, phases, values["mu"])
        eps = offset_of(case, values, impact.v_y1[0], phases)
        of_friction = -BALL.radius * courses["friction_force"]
        courses["moment"] = of_friction - eps * courses["normal_force"]
        courses["turning"] = courses["omega_core"] - courses["omega_shell"]
        for name in total:
            total[name] += half * float(WEIGHTS @ courses[name])
    core = BALL.mass
    if "total" not in text:
        core *= values["mass_ratio"]
    normal_impulse = -core * change["v_y"]
    if "free" in names_of_phases:
        # Once it is free the ball meets no force of the ground.
        normal_impulse += core * (last["v_y"][0] - v_y_at(edges[-2]))
    friction_impulse = BALL.mass * change["v_x"]
    assert total["normal_force"] == pytest.approx(normal_impulse, rel=1e-9)
    assert total["friction_force"] == pytest.approx(friction_impulse, rel=1e-8, abs=1e-12)
    assert total["v_y"] == pytest.approx(change["y"], rel=1e-9, abs=1e-13)
    assert total["turning"] == pytest.approx(change["twist"], rel=1e-8, abs=1e-12)
    share = values.get("inertia_split") or split(values["mass_ratio"])
    change_of_spin = share * change["omega_core"] + (1.0 - share) * change["omega_shell"]
    assert total["moment"] == pytest.approx(INERTIA * change_of_spin, rel=1e-7, abs=1e-12)
    # Path over the contact, of which gap_path has what the flight makes of it besides.
    late = float(rebound.gap_time[0]) - end
    path = total["v_x"] + late * rebound.v_x2[0]
    assert path == pytest.approx(rebound.gap_path[0], rel=1e-9)


def split(ratio):
    """A solid core in a thin shell (Jafri 2004, Eqs 67 and 69 with their fractions in the right
    order).
    """
    solid = 0.4 * 0.97**2 * ratio
    thin = 2.0 / 3.0 * (1.0 - ratio)
    return solid / (solid + thin)


@pytest.mark.parametrize("case", CASES, ids=[case[3] for case in CASES])
def test_phases_of_a_course_are_those_of_the_rebound(case):
    *_, names_of_phases = case
    model, values, impact, rebound = solved(case)
    times = np.linspace(0.0, float(rebound.contact_time[0]), 2001)
    phases = model.history(values, impact, times).phase
    # Three bits for each phase, the first in the lowest.
    code = 0
    for k, (phase, _) in enumerate(groupby(phases.tolist())):
        code += phase << 3 * k
    assert fitball.regime_name(rebound.regime[0]) == names_of_phases
    assert fitball.regime_name(code) == names_of_phases


def test_what_has_no_courses_says_so_by_code():
    model, values, impact, rebound = solved(CASES[0])
    brody = {"mu": 0.5, "cor_10": 0.7, "cor_slope": 0.0}
    start = np.zeros(1)
    late = np.array([0.0, 1.01 * rebound.contact_time[0]])
    no_number = np.array([np.nan])
    two_impacts = fitball.impacts([20.0, 20.0], 6.0)
    two_draws = {**values, "mu": [0.5, 0.6]}
    no_answer = {**values, "cor_10": 0.95}
    for code, history, arguments in (
        ("no-history", fitball.model("brody").history, (brody, impact, start)),
        ("times", model.history, (values, impact, late)),
        ("times", model.history, (values, impact, no_number)),
        ("parameters", model.history, (values, two_impacts, start)),
        ("parameters", model.history, (two_draws, impact, start)),
        ("no-answer", model.history, (no_answer, impact, start)),
    ):
        with pytest.raises(FitballError) as caught:
            history(*arguments)
        assert caught.value.code == code
