"""Joints whose twist dies without turning: bounds of the certificate, rebounds against an independent solution."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from test_oracle import random_case

from fitball.models.kernels.oscillator import Oscillator, sixth_derivative_bounds
from fitball.models.oracle import oracle_rebound
from fitball.models.registry import model
from fitball.models.types import Status

SPAN = 5e-3
BALL = model("two-mass").ball


@pytest.mark.parametrize("zeta", [0.3, 1.0 - 1e-7, 1.0, 1.02, 1.5, 4.0, 10.0])
@pytest.mark.parametrize(("c", "s"), [(1.0, 0.0), (0.0, 900.0), (1.0, -2500.0), (-0.2, 60.0)])
def test_bounds_of_the_sixth_derivative_hold_and_follow_each_pole(zeta, c, s):
    """Never below the derivative; where one exponential has died not far above that of the other."""
    natural = 900.0
    damped = natural**2 * (1.0 - zeta) * (1.0 + zeta)
    spring = Oscillator(zeta * natural, damped, natural**2, abs(damped) ** 0.5)
    bound, fast_bound = sixth_derivative_bounds.py_func(spring, c, s, SPAN)
    with mpmath.workdps(40):
        root = mpmath.sqrt(mpmath.mpf(damped) + mpmath.mpc(0, 1e-30))
        poles = [-mpmath.mpf(spring.decay) + sign * 1j * root for sign in (1, -1)]
        shares = [(c + sign * s / (1j * root)) / 2 for sign in (1, -1)]
        slow, fast = sorted(poles, key=lambda pole: -pole.real)
        for t in np.linspace(0.0, SPAN, 41):
            sixth = [a * p**6 * mpmath.exp(p * t) for a, p in zip(shares, poles, strict=True)]
            certified = bound * mpmath.exp(slow.real * t) + fast_bound * mpmath.exp(fast.real * t)
            assert certified >= abs(sum(sixth)) * (1 - mpmath.mpf(1e-12))
            if zeta >= 1.5:
                assert certified <= 1.001 * sum(map(abs, sixth)) + 1e-12 * bound


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_an_overdamped_joint_agrees_with_the_independent_solution(seed):
    """Regimes and statuses equal, rebounds to the oracle's own rounding: damping 2 to 10 times the critical."""
    rng = np.random.default_rng(seed)
    solved = 0
    for _ in range(16):
        closures, parameters, impact = random_case(rng, torsion="free")
        parameters |= {"zeta_theta": rng.uniform(2.0, 10.0), "k_theta": 10 ** rng.uniform(0.5, 2.5)}
        chosen = model("two-mass", **closures.__dict__)
        names = chosen.parameter_names
        found = chosen.evaluate(names, np.array([[parameters[name] for name in names]]), impact)
        slow = oracle_rebound(closures, BALL, parameters, impact)
        assert found.status[0, 0] == slow.status[0]
        if slow.status[0] != Status.OK:
            continue
        solved += 1
        assert int(found.regime[0, 0]) == int(slow.regime[0])
        size = float(np.hypot(impact.v_x1[0], impact.v_y1[0]) + BALL.radius * abs(impact.omega_1[0]))
        assert abs(found.v_x2[0, 0] - slow.v_x2[0]) < 1e-11 * size
        assert BALL.radius * abs(found.omega_2[0, 0] - slow.omega_2[0]) < 1e-11 * size
    assert solved >= 8
