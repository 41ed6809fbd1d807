"""Courses of one impact: forces and velocities are integrals of each other, phases those of the
rebound.
"""

from itertools import pairwise

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
    text, changes, impact, _ = case
    model = fitball.model(text)
    values = {spec.name: {**VALUES, **changes}[spec.name] for spec in model.parameters}
    return model, values, fitball.impacts(*impact), model.rebound(values, fitball.impacts(*impact))


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
            low, high = (middle, high) if course([middle]).phase[0] == phases[k] else (low, middle)
        edges.append(high)
    return [*edges, end]


@pytest.mark.parametrize("case", CASES, ids=[case[3] for case in CASES])
def test_momentum_spin_and_place_are_integrals(case):
    model, values, impact, rebound = solved(case)

    def course(times):
        return model.history(values, impact, np.asarray(times))

    end = float(rebound.contact_time[0])
    edges = spans(course, end)
    first, last = (course([time]).courses for time in (0.0, end))
    change = {name: float(last[name][0] - first[name][0]) for name in first}
    total = dict.fromkeys(
        ("normal_force", "friction_force", "moment", "v_y", "turning", "v_x"),
        0.0,
    )
    most = 0.0
    for low, high in pairwise(edges):
        half = 0.5 * (high - low)
        found = course(0.5 * (low + high) + half * NODES)
        at = found.courses
        phase = set(found.phase.tolist())
        assert len(phase) == 1
        acts = Phase.GRIP in phase or ("offset=grip" not in case[0] and "thesis" not in case[0])
        eps = (values["eps_10"] + values["eps_slope"] * (impact.v_y1[0] - 10.0)) * acts
        at["moment"] = -BALL.radius * at["friction_force"] - eps * at["normal_force"]
        at["turning"] = at["omega_core"] - at["omega_shell"]
        for name in total:
            total[name] += half * float(WEIGHTS @ at[name])
        # Coulomb; slip is against friction; no slip in grip and hold; the ground does not pull.
        limit = values["mu"] * at["normal_force"] * (1.0 + 1e-9) + 1e-9
        assert np.all(abs(at["friction_force"]) <= limit)
        assert np.all(at["normal_force"] >= -1e-9)
        assert np.all(at["slip"] * at["friction_force"] <= 1e-9)
        if phase & {Phase.GRIP, Phase.HOLD}:
            most = max(most, abs(at["slip"]).max())
        assert_allclose(
            at["slip"],
            at["v_x"] - BALL.radius * at["omega_shell"],
            atol=1e-11,
        )
    assert most < 1e-11
    core = (1.0 if "total" in case[0] else values["mass_ratio"]) * BALL.mass
    freed = (
        core * (last["v_y"][0] - course([edges[-2]]).courses["v_y"][0])
        if "free" in case[3]
        else 0.0
    )
    assert total["normal_force"] == pytest.approx(-core * change["v_y"] + freed, rel=1e-9)
    assert total["friction_force"] == pytest.approx(BALL.mass * change["v_x"], rel=1e-8, abs=1e-12)
    assert total["v_y"] == pytest.approx(change["y"], rel=1e-9, abs=1e-13)
    assert total["turning"] == pytest.approx(change["twist"], rel=1e-8, abs=1e-12)
    share = values.get("inertia_split") or split(values["mass_ratio"])
    turned = INERTIA * (share * change["omega_core"] + (1.0 - share) * change["omega_shell"])
    assert total["moment"] == pytest.approx(turned, rel=1e-7, abs=1e-12)
    # Path over the contact, of which gap_path has what the flight makes of it besides.
    late = float(rebound.gap_time[0]) - end
    assert total["v_x"] + late * rebound.v_x2[0] == pytest.approx(rebound.gap_path[0], rel=1e-9)


def split(ratio):
    """A solid core in a thin shell (Jafri 2004, Eqs 67 and 69 with their fractions in the right
    order).
    """
    solid = 0.4 * 0.97**2 * ratio
    thin = 2.0 / 3.0 * (1.0 - ratio)
    return solid / (solid + thin)


@pytest.mark.parametrize("case", CASES, ids=[case[3] for case in CASES])
def test_phases_of_a_course_are_those_of_the_rebound(case):
    model, values, impact, rebound = solved(case)
    phase = model.history(
        values,
        impact,
        np.linspace(0.0, float(rebound.contact_time[0]), 2001),
    ).phase
    packed = sum(int(one) << 3 * k for k, one in enumerate(phase[np.r_[True, np.diff(phase) != 0]]))
    assert fitball.regime_name(rebound.regime[0]) == case[3] == fitball.regime_name(packed)


def test_what_has_no_courses_says_so_by_code():
    model, values, impact, rebound = solved(CASES[0])
    brody = {"mu": 0.5, "cor_10": 0.7, "cor_slope": 0.0}
    none = np.zeros(1)
    late = np.array([0.0, 1.01 * rebound.contact_time[0]])
    for code, call in (
        ("no-history", lambda: fitball.model("brody").history(brody, impact, none)),
        ("times", lambda: model.history(values, impact, late)),
        ("times", lambda: model.history(values, impact, np.array([np.nan]))),
        ("parameters", lambda: model.history(values, fitball.impacts([20.0, 20.0], 6.0), none)),
        ("parameters", lambda: model.history({**values, "mu": [0.5, 0.6]}, impact, none)),
        ("no-answer", lambda: model.history({**values, "cor_10": 0.95}, impact, none)),
    ):
        with pytest.raises(FitballError) as caught:
            call()
        assert caught.value.code == code
