"""Grip-slip against the balances it is made of, and what books say of a rigid ball that slides or
rolls.
"""

import numpy as np
import pytest
from support.travel import acting

import fitball
from fitball.base.values import Ball

BALL = Ball()
INERTIA = BALL.inertia_ratio * BALL.mass * BALL.radius**2
RNG = np.random.default_rng(4)
STATES = fitball.impacts(
    RNG.uniform(-30, 30, 300),
    RNG.uniform(3, 25, 300),
    RNG.uniform(-500, 500, 300),
)
VALUES = {
    "mu": 0.45,
    "e_x": 0.15,
    "offset": 0.004,
    "cor_10": 0.75,
    "cor_slope": 0.0,
}


def slip(v_x, omega, radius=BALL.radius):
    return v_x - radius * omega


def balanced(v_x1, v_y1, omega_1, mu, e_x, offset, cor):
    """Momentum, spin and tangential restitution as three linear equations (Walton 1993; Cross
    2002), unless they take more friction than there is.
    """
    normal = BALL.mass * (1.0 + cor) * v_y1
    # Unknowns: v_x2, omega_2, friction impulse (it retards).
    equations = [
        [BALL.mass, 0.0, 1.0],
        [0.0, INERTIA, -BALL.radius],
        [1.0, -BALL.radius, 0.0],
    ]
    right_side = [
        BALL.mass * v_x1,
        INERTIA * omega_1 - offset * normal,
        -e_x * slip(v_x1, omega_1),
    ]
    v_x2, omega_2, friction = np.linalg.solve(equations, right_side)
    if abs(friction) <= mu * normal:
        return v_x2, omega_2, "grip"
    friction = np.copysign(mu * normal, friction)
    v_x2 = v_x1 - friction / BALL.mass
    omega_2 = omega_1 + (BALL.radius * friction - offset * normal) / INERTIA
    regime = "slide" if friction > 0.0 else "slide back"
    return v_x2, omega_2, regime


@pytest.mark.parametrize(
    ("text", "changes"),
    [
        ("grip-slip", {}),
        ("grip-slip", {"e_x": 1.0, "offset": -0.01, "cor_10": 1.0}),
        ("brody", {}),
    ],
)
def test_it_solves_its_balances(text, changes):
    values = {**VALUES, **changes}
    if text == "brody":
        values |= {"e_x": 0.0, "offset": 0.0}
    model = fitball.model(text)
    parameters = {spec.name: values[spec.name] for spec in model.parameters}
    rebound = model.rebound(parameters, STATES)
    regimes = set()
    for k in range(len(STATES)):
        v_x2, omega_2, regime = balanced(
            STATES.v_x1[k],
            STATES.v_y1[k],
            STATES.omega_1[k],
            values["mu"],
            values["e_x"],
            values["offset"] * acting(STATES.v_x1[k], STATES.v_y1[k]),
            values["cor_10"],
        )
        assert rebound.v_x2[k] == pytest.approx(v_x2, rel=1e-12, abs=1e-12)
        assert rebound.omega_2[k] == pytest.approx(omega_2, rel=1e-12, abs=1e-10)
        if STATES.side[k] < 0.0:
            regime = {"slide": "slide back", "slide back": "slide"}.get(regime, regime)
        assert fitball.regime_name(rebound.regime[k]) == regime
        regimes.add(regime)
    assert regimes == {"grip", "slide", "slide back"}


def test_a_solid_ball_without_spin_rolls_at_five_sevenths():
    model = fitball.model("brody", ball=Ball(inertia_ratio=0.4))
    values = {"mu": 5.0, "cor_10": 0.75, "cor_slope": 0.0}
    rebound = model.rebound(values, fitball.impacts(7.0, 10.0))
    assert rebound.v_x2[0] == pytest.approx(5.0, rel=1e-15)
