"""The oracle where the answer is known in closed form, at release, and where there is no answer."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from oracle_case import AS_THE_THESIS, BALL, DEFAULT, PARAMETERS, distance
from scipy.integrate import solve_ivp

from fitball.errors import ParameterError
from fitball.models import oracle
from fitball.models.oracle import oracle_rebound
from fitball.models.types import Closures, Phase, Status, unpack_regime
from fitball.values import impacts


def test_rigid_ball_slides_or_rolls() -> None:
    # Brody, The Physics Teacher 22, 494 (1984): friction either lasts or stops at rolling.
    closures = replace(DEFAULT, normal="total", torsion="rigid", cor="mean")
    parameters = {"mass_ratio": 0.8, "k_y": 4e4, "mu": 0.55, "cor_10": 0.75, "eps_10": 0.0, "eps_slope": 0.0}
    at = impacts(np.linspace(-40.0, 40.0, 41), 8.0, 150.0)
    rebound = oracle_rebound(closures, BALL, parameters, at)
    slip = at.v_x1 - BALL.radius * at.omega_1
    rolled = slip / (1 + 1 / BALL.inertia_ratio)
    most = 0.55 * 1.75 * 8.0
    lost = np.clip(rolled, -most, most)
    np.testing.assert_allclose(rebound.v_x2, at.v_x1 - lost, rtol=0, atol=1e-13)
    turned = at.omega_1 + lost / (BALL.inertia_ratio * BALL.radius)
    np.testing.assert_allclose(rebound.omega_2 * BALL.radius, turned * BALL.radius, rtol=0, atol=1e-13)


def test_hold_keeps_a_rigid_ball_rolling_without_offset() -> None:
    # An offset above mu (R + I/(M R)) needs more friction to grip than the cone has, on either side
    # of zero slip; while sliding it is off. So the ball rolls as if there were none.
    closures = Closures("zero_force", "total", "grip", "shell", "tied", "rigid", "mean")
    parameters = PARAMETERS | {"mu": 0.3, "eps_10": 1.1 * 0.3 * BALL.radius * (1 + BALL.inertia_ratio)}
    parameters["eps_slope"] = 0.0
    at = impacts([3.0, 0.0], 10.0, 0.0)
    rebound = oracle_rebound(closures, BALL, parameters, at)
    assert unpack_regime(int(rebound.regime[0])) == (Phase.SLIDE_FORWARD, Phase.HOLD)
    assert unpack_regime(int(rebound.regime[1])) == (Phase.HOLD,)
    rolled = np.array([3.0, 0.0]) / (1 + BALL.inertia_ratio)
    np.testing.assert_allclose(rebound.v_x2, rolled, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(rebound.omega_2 * BALL.radius, rolled, rtol=1e-14, atol=1e-15)


def test_landing_impulse_of_a_ball_that_cannot_return() -> None:
    # Rigid torsion under `momentum`: landing and contact obey one law, so that a slide that stops in
    # either rolls alike, and only the sum of the impulses counts.
    closures = replace(DEFAULT, torsion="rigid", cor="mean")
    parameters = PARAMETERS | {"eps_10": 0.0, "eps_slope": 0.0, "mass_ratio": 0.76}
    at = impacts([1.0, 2.0, 4.0, 12.0], 10.0, 0.0)
    rebound = oracle_rebound(closures, BALL, parameters, at)
    np.testing.assert_allclose(rebound.v_x2, at.v_x1 / (1 + BALL.inertia_ratio), rtol=1e-13)
    assert unpack_regime(int(rebound.regime[0])) == (Phase.GRIP,)
    assert unpack_regime(int(rebound.regime[3])) == (Phase.SLIDE_FORWARD, Phase.GRIP)


# --- Release -------------------------------------------------------------------------------------


@pytest.mark.parametrize("zeta", [0.0, 0.05, 0.3, 0.9, 1.0, 1.1, 5.0])
def test_zero_force_release_is_where_the_force_returns_to_zero(zeta: float) -> None:
    # Whatever the damping, overdamped too: the speed at which the force returns to zero is the COR,
    # the time it takes the contact time.
    def force(_: float, state: Any) -> float:
        return float(state[0] + 2 * zeta * state[1])

    force.terminal, force.direction = True, -1.0  # type: ignore[attr-defined]
    run = solve_ivp(
        lambda t, state: [state[1], -force(t, state)],
        (0.0, 10.0),
        [0.0, 1.0],
        "DOP853",
        events=force,
        rtol=1e-13,
        atol=1e-15,
        max_step=0.05,
    )
    closures = Closures("zero_force", "total", "contact", "mean", "tied", "rigid", "mean")
    # Integration without damping may return one unit of rounding too much.
    cor = min(1.0, -run.y[1, -1])
    rebound = oracle_rebound(closures, BALL, PARAMETERS | {"cor_10": cor}, impacts(5.0, 10.0, 0.0))
    omega_y = math.sqrt(PARAMETERS["k_y"] / BALL.mass)
    assert rebound.contact_time[0] * omega_y == pytest.approx(run.t[-1], rel=1e-11)
    assert rebound.v_y2[0] == 10.0 * cor


def test_zero_displacement_contact_lasts_half_a_damped_period() -> None:
    closures = replace(AS_THE_THESIS, cor="mean")
    rebound = oracle_rebound(closures, BALL, PARAMETERS, impacts(5.0, 10.0, 0.0))
    omega_y = math.sqrt(PARAMETERS["k_y"] / (PARAMETERS["mass_ratio"] * BALL.mass))
    contact_time = float(rebound.contact_time[0])
    omega_dy = math.pi / contact_time
    assert math.exp(-math.sqrt(omega_y**2 - omega_dy**2) * contact_time) == pytest.approx(0.75, rel=1e-13)


def test_undamped_start_without_slip_grips() -> None:
    # Force, torque and slip all vanish at the start: what comes next is decided by their growth.
    closures = Closures("zero_displacement", "total", "contact", "mean", "tied", "free", "mean")
    parameters = PARAMETERS | {"cor_10": 1.0, "eps_10": 1e-3, "eps_slope": 0.0}
    at = impacts(0.0, 10.0, 0.0)
    double, exact = (oracle_rebound(closures, BALL, parameters, at, digits) for digits in (None, 50))
    assert unpack_regime(int(double.regime[0]))[0] is Phase.GRIP
    assert double.regime[0] == exact.regime[0]
    assert distance(double, exact, at) < 1e-13


# --- What has no rebound -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "status"),
    [
        ({"cor_10": 1.2}, Status.COR_OUT_OF_RANGE),
        ({"cor_10": 0.0}, Status.COR_OUT_OF_RANGE),
        ({"mass_ratio": 0.7}, Status.COR_EXCEEDS_MASS_RATIO),
        ({"mass_ratio": 0.75}, Status.OK),
        ({"k_theta": 1.0}, Status.TORSION_TOO_SOFT),
    ],
)
@pytest.mark.parametrize("digits", [None, 50])
def test_status(digits: int | None, changes: dict[str, float], status: Status) -> None:
    rebound = oracle_rebound(DEFAULT, BALL, PARAMETERS | changes, impacts(5.0, 10.0, 0.0), digits)
    assert rebound.status[0] == status
    assert np.isnan(rebound.v_x2[0]) == (status is not Status.OK)
    assert (rebound.regime[0] == 0) == (status is not Status.OK)


def test_a_contact_without_end_is_said_to_be_one(monkeypatch) -> None:
    """More phases than are followed: no number is left that could pass for a rebound."""
    at = impacts([5.0, 5.0], [10.0, 10.0], [0.0, 0.0])
    ended = oracle_rebound(DEFAULT, BALL, PARAMETERS, at)
    assert np.all(ended.status == Status.OK)
    monkeypatch.setattr(oracle, "PHASE_LIMIT", 1)
    rebound = oracle_rebound(DEFAULT, BALL, PARAMETERS, at)
    assert np.all(rebound.status == Status.TOO_MANY_PHASES)
    for column in (rebound.v_x2, rebound.v_y2, rebound.omega_2, rebound.contact_time):
        assert np.all(np.isnan(column))
    assert np.all(rebound.regime == 0)


def test_each_impact_stands_alone() -> None:
    at = impacts([5.0, 20.0, 1.0], [10.0, 120.0, 12.0], [0.0, 10.0, 300.0])
    together = oracle_rebound(DEFAULT, BALL, PARAMETERS, at)
    assert together.status.tolist() == [Status.OK, Status.COR_OUT_OF_RANGE, Status.OK]
    alone = oracle_rebound(DEFAULT, BALL, PARAMETERS, impacts(1.0, 12.0, 300.0))
    assert (together.v_x2[2], together.omega_2[2]) == (alone.v_x2[0], alone.omega_2[0])


def test_measured_restitution_is_each_impacts_own() -> None:
    closures = replace(DEFAULT, cor="measured")
    at = impacts([5.0, 5.0], 10.0, 0.0, cor=[0.6, 0.75])
    rebound = oracle_rebound(closures, BALL, PARAMETERS, at)
    np.testing.assert_allclose(rebound.v_y2, [6.0, 7.5], rtol=1e-15)
    by_line = oracle_rebound(DEFAULT, BALL, PARAMETERS, impacts(5.0, 10.0, 0.0))
    assert rebound.v_x2[1] == by_line.v_x2[0]
    with pytest.raises(ParameterError, match="measured coefficient of restitution"):
        oracle_rebound(closures, BALL, PARAMETERS, impacts(5.0, 10.0, 0.0))


def test_missing_parameter_is_named() -> None:
    parameters = {name: value for name, value in PARAMETERS.items() if name != "k_theta"}
    with pytest.raises(ParameterError, match="k_theta"):
        oracle_rebound(DEFAULT, BALL, parameters, impacts(5.0, 10.0, 0.0))
