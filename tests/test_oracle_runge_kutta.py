"""The oracle against a Runge-Kutta integration in SI units, with all events left to scipy.

Written from the equations of motion alone: it shares no line, no units and no formula for release or
damping with the oracle.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from integrated import Contact
from oracle_case import AS_THE_THESIS, BALL, DEFAULT, PARAMETERS

from fitball.models.oracle import oracle_rebound
from fitball.models.types import Closures, Phase, unpack_regime
from fitball.values import Impacts, impacts


def runge_kutta(
    closures: Closures, p: dict[str, float], at: Impacts, core_return: float, contact_time: float
) -> tuple[float, float, float, tuple[Phase, ...]]:
    """v_x2, omega_2, the core's final speed over v_y1, and the phases."""
    contact, v_y1 = Contact(closures, p, at, core_return, contact_time), float(at.v_y1[0])
    mu, eps, in_slide = contact.mu, contact.eps, contact.in_slide

    def at_rest(z: Any, broken: Phase | None, ending: int) -> Phase:
        limit = mu * contact.forces(z)[0]
        if broken is Phase.HOLD and ending == 2:
            return Phase.GRIP
        if broken is not Phase.GRIP and broken is not Phase.HOLD and abs(contact.needed(z, eps)) <= limit:
            return Phase.GRIP
        if broken is not Phase.HOLD and not in_slide and abs(contact.needed(z, 0.0)) <= limit:
            return Phase.HOLD
        against = contact.needed(z, eps if in_slide else 0.0) > 0
        return Phase.SLIDE_BACKWARD if against else Phase.SLIDE_FORWARD

    z = np.array([0.0, v_y1, at.v_x1[0], at.omega_1[0], at.omega_1[0], 0.0])
    if closures.normal == "momentum":
        _land(z, (1 - p["mass_ratio"]) * BALL.mass * v_y1, mu, eps, in_slide, contact.shell)
    slip, time, phases = z[2] - BALL.radius * z[4], 0.0, list[Phase]()
    phase = Phase.SLIDE_FORWARD if slip > 0 else Phase.SLIDE_BACKWARD
    if abs(slip) < 1e-12 * v_y1:
        phase = at_rest(z, None, 0)

    def advance(phase: Phase, ends: list[Any]) -> Any:
        phases.append(phase)
        return contact.run(phase, time, z, 2 * contact_time, ends, 1e-13, 1e-16)

    for _ in range(20):
        run = advance(phase, contact.endings(phase))
        z, time = run.y[:, -1], run.t[-1]
        if run.t_events[0].size:
            break
        ending = next(place for place, times in enumerate(run.t_events[1:]) if times.size)
        phase = at_rest(z, phase, ending)
    else:
        pytest.fail(f"no end of phases: {phases}")
    if closures.release == "zero_displacement":
        run = advance(Phase.FREE, [lambda z: z[0]])
        z, time = run.y[:, -1], run.t[-1]
    assert time == pytest.approx(contact_time, rel=1e-10, abs=0)
    turn = z[4] if closures.spin == "shell" else (contact.core * z[3] + contact.shell * z[4]) / BALL.inertia
    return float(z[2]), float(turn), float(-z[1] / v_y1), tuple(phases)


def _land(z: Any, impulse: float, mu: float, eps: float, in_slide: bool, shell: float) -> None:
    """Landing impulse in two pieces, parted where the slip is used up; each by trial and clipping."""
    radius, mass = BALL.radius, BALL.mass
    yielding = 1 / mass + radius**2 / shell
    slip = z[2] - radius * z[4]
    rate = -mu * yielding + (math.copysign(eps, slip * eps) * radius / shell if in_slide else 0.0)
    first = min(impulse, abs(slip / rate)) if rate < 0 else impulse
    for piece in (first, impulse - first):
        lever = eps
        friction = -(z[2] - radius * z[4] + radius * lever * piece / shell) / yielding
        if abs(friction) > mu * piece and not in_slide:
            lever = 0.0
            friction = -(z[2] - radius * z[4]) / yielding
        friction = min(max(friction, -mu * piece), mu * piece)
        z[2] += friction / mass
        z[4] -= (radius * friction + lever * piece) / shell


RUNGE_KUTTA_CASES = [
    (DEFAULT, {}, (20.0, 5.0, 0.0)),
    (DEFAULT, {}, (15.0, 10.0, 100.0)),
    (DEFAULT, {"mu": 0.3, "k_theta": 150.0}, (1.0, 15.0, 300.0)),
    (DEFAULT, {"eps_10": -4e-3}, (-3.0, 20.0, 50.0)),
    (replace(DEFAULT, torsion="free", spin="shell"), {"zeta_theta": 0.05, "mu": 0.2}, (4.0, 12.0, -40.0)),
    (AS_THE_THESIS, {}, (15.0, 10.0, 100.0)),
    (AS_THE_THESIS, {"k_theta": 150.0, "mu": 0.3}, (-5.0, 18.0, 20.0)),
    (replace(AS_THE_THESIS, torsion="free"), {}, (1.0, 15.0, 300.0)),
    (replace(AS_THE_THESIS, torsion="free"), {"eps_10": -2e-3}, (0.5, 20.0, -200.0)),
    (replace(AS_THE_THESIS, normal="total", inertia="table"), {"k_theta": 200.0}, (8.0, 10.0, 0.0)),
    (replace(DEFAULT, normal="total", offset="grip", torsion="free"), {"eps_10": 8e-3}, (2.0, 10.0, -90.0)),
    (replace(DEFAULT, offset="grip", torsion="free"), {"eps_10": 6e-3, "mu": 0.4}, (3.0, 12.0, 10.0)),
    (replace(DEFAULT, normal="inner", torsion="free"), {"zeta_theta": 1.5}, (0.0, 10.0, 0.0)),
    (replace(DEFAULT, offset="grip", torsion="free"), {"eps_10": 3e-3}, (0.4, 12.0, 10.0)),
    (replace(DEFAULT, torsion="free"), {"eps_10": 0.012, "mu": 0.2}, (-0.1, 12.0, 1.0)),
]


@pytest.mark.parametrize(("closures", "changes", "incident"), RUNGE_KUTTA_CASES)
def test_agrees_with_runge_kutta(
    closures: Closures, changes: dict[str, float], incident: tuple[float, float, float]
) -> None:
    parameters, at = PARAMETERS | changes, impacts(*incident)
    rebound = oracle_rebound(closures, BALL, parameters, at)
    cor = rebound.v_y2[0] / at.v_y1[0]
    core_return = cor / parameters["mass_ratio"] if closures.normal == "momentum" else cor
    v_x2, omega_2, returned, phases = runge_kutta(closures, parameters, at, core_return, rebound.contact_time[0])
    assert unpack_regime(int(rebound.regime[0])) == phases
    assert returned == pytest.approx(core_return, rel=1e-10)
    assert rebound.v_x2[0] == pytest.approx(v_x2, rel=1e-10, abs=1e-10)
    assert rebound.omega_2[0] == pytest.approx(omega_2, rel=1e-10, abs=1e-9)


def test_runge_kutta_cases_reach_every_regime() -> None:
    seen = [
        unpack_regime(int(oracle_rebound(closures, BALL, PARAMETERS | changes, impacts(*incident)).regime[0]))
        for closures, changes, incident in RUNGE_KUTTA_CASES
    ]
    assert {phase for phases in seen for phase in phases} == set(Phase)
    assert any(phases[:3] == (Phase.SLIDE_FORWARD, Phase.GRIP, Phase.SLIDE_BACKWARD) for phases in seen)
    assert any(pair == (Phase.GRIP, Phase.HOLD) for phases in seen for pair in pairwise(phases))
    assert any(pair == (Phase.HOLD, Phase.GRIP) for phases in seen for pair in pairwise(phases))
