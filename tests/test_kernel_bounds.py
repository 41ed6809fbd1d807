"""Bounds of the sixth derivative, on which it rests that no event of a contact is missed, against
40 digits.
"""

import mpmath
import numba
import numpy as np
import pytest

from fitball.models.kernels.crossings import sixth_bounds
from fitball.models.kernels.motion import spring_of, swing_at


@numba.njit
def bound(decay, damped_squared, c, s, span, begin):  # type: ignore[no-untyped-def]
    """What is promised from `begin` to `span`; parts of kernels have no way in from Python."""
    spring = spring_of(decay, damped_squared, decay * decay + damped_squared)
    slow, fast = sixth_bounds(spring, c, s, span)
    swing = swing_at(spring, begin)
    return slow * swing.slow + fast * swing.fast


RNG = np.random.default_rng(7)


def sixth(decay: float, damped_squared: float, c: float, s: float, t: float) -> float:
    """|d^6/dt^6 (c C + s S)|, with C = e^(-at) cos(wt) and S = e^(-at) sin(wt)/w of either sign of
    w^2.
    """
    with mpmath.workdps(40):
        a = mpmath.mpf(decay)
        square = mpmath.mpf(damped_squared)
        w = mpmath.sqrt(square)
        of_cos = mpmath.mpf(c)
        of_sin = mpmath.mpf(s)
        for _ in range(6):
            slope_of_cos = of_sin - a * of_cos
            slope_of_sin = -square * of_cos - a * of_sin
            of_cos = slope_of_cos
            of_sin = slope_of_sin
        cos = mpmath.cos(w * t)
        sin = mpmath.sin(w * t) / w
        value = mpmath.exp(-a * t) * (of_cos * cos + of_sin * sin)
        return float(abs(value))


@pytest.mark.parametrize(
    ("least", "most"),
    [
        pytest.param(1.5, 400.0, id="swings"),
        pytest.param(-1.0, 1.0, id="critical"),
        pytest.param(-400.0, -1.5, id="overdamped"),
    ],
)
def test_the_sixth_derivative_stays_within_its_bound(least: float, most: float) -> None:
    closest = 0.0
    span = 4e-3
    for turn in RNG.uniform(least, most, 15):
        # Of an overdamped swing the decay is above the rate at which its poles part.
        rate_of_parting = np.sqrt(max(-turn, 0.0)) / span
        decay = rate_of_parting * RNG.uniform(1.0, 1.2) + RNG.uniform(0.0, 300.0)
        damped_squared = turn / span**2
        rate = max(abs(damped_squared), 1.0 / span**2) ** 0.5
        c = RNG.normal()
        s = RNG.normal() * rate
        swing = (decay, damped_squared, c, s)
        for begin in np.linspace(0.0, 0.9 * span, 3):
            promised = bound(*swing, span, begin)
            times = np.linspace(begin, span, 20)
            highest = max(sixth(*swing, t) for t in times)
            assert highest <= promised * (1.0 + 1e-9)
            closest = max(closest, highest / promised)
    # A bound far too large would only cost time, but then this test would see nothing.
    assert closest > 0.5
