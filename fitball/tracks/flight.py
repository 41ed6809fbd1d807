"""Flight of a ball in the plane of its impact: gravity, drag and Magnus force.

With `K = rho pi R^2/(2 M)` and `rot(v) = (v_y, -v_x)`, which turns a ball with topspin that flies to the right down,

    dv/dt = g - K C_D |v| v + K C_L |v| rot(v).

The spin is constant: it takes seconds to decay. The coefficients of a tennis ball are from free flight (Cross and
Lindsey 2014): `C_D = 0.507`, with 0.024 from shot to shot, and

    C_L = sign(omega)/(2.022 + 0.981/S) + c,    S = R |omega|/|v|,

with `c` about 0.05. Wind tunnels find `C_D` of 0.6 to 0.7 (Mehta, Alam and Subic 2008), so its prior is wide.

Near the impact the flight is a power series in the time from there, with exact derivatives of the acceleration; from
`SHORT` on the equation is integrated. The functions without arrays of times take numbers or arrays of any one shape.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fitball.models.kernels.compiled import inner
from fitball.tracks.kernels import compiled
from fitball.values import Ball, FloatArray

GRAVITY = 9.80665
# Cross and Lindsey 2014: the lift coefficient is S/(LIFT_AT_REST + LIFT_SATURATION S).
LIFT_SATURATION, LIFT_AT_REST = 2.022, 0.981
# Times [s] over which the series is used, and the longest step of an integration.
SHORT, STEP = 0.15, 5e-3

# A number, or arrays of one shape.
Floats: TypeAlias = Any


def resistance(ball: Ball, density: float) -> float:
    """`K` [1/m] of a ball in air of `density` [kg/m^3]: `rho pi R^2/(2 M)`."""
    return density * np.pi * ball.radius**2 / (2.0 * ball.mass)


@inner
def lift_of(omega: Floats, speed: Floats, radius: float) -> Floats:
    """Lift coefficient of spin `omega` [rad/s, topspin positive] at `speed` [m/s], of the sign of the spin.

    Cross and Lindsey 2014, as `S/(0.981 + 2.022 |S|)`, which needs no case for a ball without spin.
    """
    ratio = radius * omega / speed
    return ratio / (LIFT_AT_REST + LIFT_SATURATION * np.abs(ratio))


@inner
def acceleration(v_x: Floats, v_y: Floats, drag: Floats, lift: Floats, k: float) -> tuple[Floats, Floats]:
    """Acceleration [m/s^2] at velocity `v_x, v_y` [m/s], upwards positive, with coefficients `drag` and `lift`."""
    pull = k * np.sqrt(v_x * v_x + v_y * v_y)
    return -pull * (drag * v_x - lift * v_y), -GRAVITY - pull * (drag * v_y + lift * v_x)


@inner
def expansion(
    v_x: Floats, v_y: Floats, drag: Floats, lift: Floats, k: float
) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats]:
    """Acceleration `a_x, a_y` and its first two derivatives by time `j_x, j_y, s_x, s_y`, where the velocity is
    `v_x, v_y`: the position is `r + v d + a d^2/2 + j d^3/6 + s d^4/24` at time `d` from there.
    """
    speed = np.sqrt(v_x * v_x + v_y * v_y)
    # The force is -k |v| w with w = (drag v_x - lift v_y, drag v_y + lift v_x), linear in v.
    w_x, w_y = drag * v_x - lift * v_y, drag * v_y + lift * v_x
    a_x, a_y = -k * speed * w_x, -GRAVITY - k * speed * w_y
    w1_x, w1_y = drag * a_x - lift * a_y, drag * a_y + lift * a_x
    faster = (v_x * a_x + v_y * a_y) / speed
    j_x, j_y = -k * (faster * w_x + speed * w1_x), -k * (faster * w_y + speed * w1_y)
    again = (a_x * a_x + a_y * a_y + v_x * j_x + v_y * j_y - faster * faster) / speed
    s_x = -k * (again * w_x + 2.0 * faster * w1_x + speed * (drag * j_x - lift * j_y))
    s_y = -k * (again * w_y + 2.0 * faster * w1_y + speed * (drag * j_y + lift * j_x))
    return a_x, a_y, j_x, j_y, s_x, s_y


@inner
def series(
    v_x: Floats, v_y: Floats, drag: Floats, lift: Floats, k: float, d: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Path `x, y` [m] and velocity after the time `d` [s, of either sign], by the expansion."""
    a_x, a_y, j_x, j_y, s_x, s_y = expansion(v_x, v_y, drag, lift, k)
    return (
        d * (v_x + d / 2.0 * (a_x + d / 3.0 * (j_x + d / 4.0 * s_x))),
        d * (v_y + d / 2.0 * (a_y + d / 3.0 * (j_y + d / 4.0 * s_y))),
        v_x + d * (a_x + d / 2.0 * (j_x + d / 3.0 * s_x)),
        v_y + d * (a_y + d / 2.0 * (j_y + d / 3.0 * s_y)),
    )


@inner
def integrated(
    v_x: float, v_y: float, drag: float, lift: float, k: float, d: float
) -> tuple[float, float, float, float]:
    """As `series`, by Runge and Kutta's steps of at most `STEP`, for any time."""
    steps = int(np.ceil(abs(d) / STEP))
    h = d / max(steps, 1)
    x, y = 0.0, 0.0
    for _ in range(steps):
        a_x, a_y = acceleration(v_x, v_y, drag, lift, k)
        b_x, b_y = acceleration(v_x + 0.5 * h * a_x, v_y + 0.5 * h * a_y, drag, lift, k)
        c_x, c_y = acceleration(v_x + 0.5 * h * b_x, v_y + 0.5 * h * b_y, drag, lift, k)
        e_x, e_y = acceleration(v_x + h * c_x, v_y + h * c_y, drag, lift, k)
        x += h * v_x + h * h / 6.0 * (a_x + b_x + c_x)
        y += h * v_y + h * h / 6.0 * (a_y + b_y + c_y)
        v_x += h / 6.0 * (a_x + 2.0 * b_x + 2.0 * c_x + e_x)
        v_y += h / 6.0 * (a_y + 2.0 * b_y + 2.0 * c_y + e_y)
    return x, y, v_x, v_y


@compiled
def _fly(start: FloatArray, coefficients: FloatArray, times: FloatArray, out: FloatArray) -> None:
    for i in range(times.size):
        x, y, v_x, v_y = integrated(start[2], start[3], coefficients[0], coefficients[1], coefficients[2], times[i])
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = start[0] + x, start[1] + y, v_x, v_y


def fly(start: ArrayLike, drag: float, lift: float, k: float, times: ArrayLike) -> FloatArray:
    """States `x, y, v_x, v_y` (times, 4) [m, m/s], upwards positive, at `times` [s] of either sign from `start`,
    by integration with constant coefficients.
    """
    wanted = np.ascontiguousarray(times, dtype=np.float64)
    out = np.empty((wanted.size, 4))
    _fly(np.array(start, dtype=np.float64), np.array([drag, lift, k], dtype=np.float64), wanted, out)
    return out
