"""Grip-slip against the balances it is made of, and what books say of a rigid ball that slides or rolls."""

import numpy as np
import pytest

import fitball
from fitball.values import Ball

BALL = Ball()
INERTIA = BALL.inertia_ratio * BALL.mass * BALL.radius**2
RNG = np.random.default_rng(4)
STATES = fitball.impacts(RNG.uniform(-30, 30, 300), RNG.uniform(3, 25, 300), RNG.uniform(-500, 500, 300))
VALUES = {"mu": 0.45, "e_x": 0.15, "offset": 0.004, "cor_10": 0.75, "cor_slope": 0.0}


def slip(v_x, omega, radius=BALL.radius):
    return v_x - radius * omega


def balanced(v_x1, v_y1, omega_1, mu, e_x, offset, cor):
    """Momentum, spin and tangential restitution as three linear equations (Walton 1993; Cross 2002), unless they take
    more friction than there is.
    """
    normal = BALL.mass * (1.0 + cor) * v_y1
    # Unknowns: v_x2, omega_2, friction impulse (it retards).
    equations = [[BALL.mass, 0.0, 1.0], [0.0, INERTIA, -BALL.radius], [1.0, -BALL.radius, 0.0]]
    given = [BALL.mass * v_x1, INERTIA * omega_1 - offset * normal, -e_x * slip(v_x1, omega_1)]
    v_x2, omega_2, friction = np.linalg.solve(equations, given)
    if abs(friction) > mu * normal:
        friction = np.copysign(mu * normal, friction)
        v_x2, omega_2 = v_x1 - friction / BALL.mass, omega_1 + (BALL.radius * friction - offset * normal) / INERTIA
        return v_x2, omega_2, "slide" if friction > 0.0 else "slide back"
    return v_x2, omega_2, "grip"


def test_it_solves_its_balances():
    found = fitball.model("grip-slip").rebound(VALUES, STATES)
    regimes = set()
    for k in range(len(STATES)):
        state = STATES.v_x1[k], STATES.v_y1[k], STATES.omega_1[k]
        v_x2, omega_2, regime = balanced(*state, VALUES["mu"], VALUES["e_x"], VALUES["offset"], VALUES["cor_10"])
        assert found.v_x2[k] == pytest.approx(v_x2, rel=1e-12, abs=1e-12)
        assert found.omega_2[k] == pytest.approx(omega_2, rel=1e-12, abs=1e-10)
        assert fitball.regime_name(found.regime[k]) == regime
        regimes.add(regime)
    assert regimes == {"grip", "slide", "slide back"}


def test_brody_is_it_without_restitution_and_offset():
    found = fitball.model("brody").rebound({"mu": 0.45, "cor_10": 0.75, "cor_slope": 0.0}, STATES)
    other = fitball.model("grip-slip").rebound({**VALUES, "e_x": 0.0, "offset": 0.0}, STATES)
    np.testing.assert_array_equal([found.v_x2, found.omega_2], [other.v_x2, other.omega_2])
    # It rolls (Brody 1984), or has lost mu (1 + e) v_y.
    rolls = np.array([fitball.regime_name(code) == "grip" for code in found.regime])
    np.testing.assert_allclose(slip(found.v_x2, found.omega_2)[rolls], 0.0, atol=1e-12)
    lost = abs(STATES.v_x1 - found.v_x2)[~rolls]
    np.testing.assert_allclose(lost, 0.45 * 1.75 * STATES.v_y1[~rolls], rtol=1e-12)


def test_a_solid_ball_without_spin_rolls_at_five_sevenths():
    model = fitball.model("brody", ball=Ball(inertia_ratio=0.4))
    found = model.rebound({"mu": 5.0, "cor_10": 0.75, "cor_slope": 0.0}, fitball.impacts(7.0, 10.0))
    assert found.v_x2[0] == pytest.approx(5.0, rel=1e-15)


def test_a_superball_keeps_its_energy():
    """With both restitutions one (Garwin 1969)."""
    found = fitball.model("grip-slip").rebound(
        {"mu": 5.0, "e_x": 1.0, "offset": 0.0, "cor_10": 1.0, "cor_slope": 0.0}, STATES
    )
    grips = np.array([fitball.regime_name(code) == "grip" for code in found.regime])

    def energy(v_x, v_y, omega):
        return BALL.mass * (v_x**2 + v_y**2) + INERTIA * omega**2

    before = energy(STATES.v_x1, STATES.v_y1, STATES.omega_1)
    np.testing.assert_allclose(energy(found.v_x2, found.v_y2, found.omega_2)[grips], before[grips], rtol=1e-12)
    assert grips.sum() > 200


def test_mirror_no_friction_and_scale():
    model = fitball.model("grip-slip")
    even = {**VALUES, "offset": 0.0}
    one = model.rebound(even, STATES)
    mirrored = model.rebound(even, fitball.impacts(-STATES.v_x1, STATES.v_y1, -STATES.omega_1))
    np.testing.assert_array_equal(
        [-one.v_x2, one.v_y2, -one.omega_2], [mirrored.v_x2, mirrored.v_y2, mirrored.omega_2]
    )
    free = model.rebound({**even, "mu": 0.0}, STATES)
    np.testing.assert_array_equal([free.v_x2, free.omega_2], [STATES.v_x1, STATES.omega_1])
    twice = model.rebound(VALUES, fitball.impacts(2 * STATES.v_x1, 2 * STATES.v_y1, 2 * STATES.omega_1))
    once = model.rebound(VALUES, STATES)
    np.testing.assert_array_equal([twice.v_x2, twice.omega_2], [2 * once.v_x2, 2 * once.omega_2])
