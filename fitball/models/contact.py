"""Vertical motion of the core on its spring and damper, from landing to release, as kernels.

`M1 y'' + C_y y' + K_y y = 0`, `y(0) = 0`, `y'(0) = v` (Jafri 2004, Eqs 1-2). The coefficient of
restitution fixes the damping; which equation does so depends on when the ball is taken to leave.
"""

from __future__ import annotations

import math

from fitball.models.compiled import compiled
from fitball.models.types import Status

OK = int(Status.OK)
COR_OUT_OF_RANGE = int(Status.COR_OUT_OF_RANGE)
COR_EXCEEDS_MASS_RATIO = int(Status.COR_EXCEEDS_MASS_RATIO)

# b*cot(b) = x is solved for b near pi/2 below this x, and for b^2 (of either sign) above it.
NEAR_UNDAMPED = 0.9


@compiled
def angle_complement(x: float) -> float:
    """Solve `(pi/2 - d) tan(d) = x` for d in [0, pi/2), 0 <= x < 0.9, by Halley's method."""
    d = 2.0 * x / math.pi
    d += 2.0 / math.pi * d * d
    for _ in range(30):
        tangent = math.tan(d)
        arm = 0.5 * math.pi - d
        secant2 = 1.0 + tangent * tangent
        f = arm * tangent - x
        f1 = arm * secant2 - tangent
        f2 = 2.0 * (arm * tangent - 1.0) * secant2
        step = f / (f1 - 0.5 * f * f2 / f1)
        d -= step
        if abs(step) <= 1e-6 * d:
            break
    return d


@compiled
def squared_angle(x: float) -> float:
    """Solve `sqrt(z) cot(sqrt(z)) = x` for z, x >= 0.9; z < 0 (hyperbolic) where x > 1."""
    # x = 1 - z/3 - z^2/45 - ... near critical damping; x -> sqrt(-z) far beyond it.
    z = 3.0 * (1.0 - x) if x < 2.0 else -x * x
    for _ in range(60):
        if abs(z) < 1e-3:
            f = 1.0 - z * (1.0 / 3 + z * (1.0 / 45 + z * (2.0 / 945 + z / 4725)))
            slope = -(1.0 / 3 + z * (2.0 / 45 + z * (6.0 / 945 + z * 4.0 / 4725)))
        elif z > 0.0:
            b = math.sqrt(z)
            cot = 1.0 / math.tan(b)
            f = b * cot
            slope = 0.5 * (cot / b - 1.0 - cot * cot)
        else:
            b = math.sqrt(-z)
            coth = 1.0 / math.tanh(b)
            f = b * coth
            slope = -0.5 * (coth / b + 1.0 - coth * coth)
        step = (f - x) / slope
        z -= step
        if abs(step) <= 1e-15 + 4e-16 * abs(z):
            break
    return z


@compiled
def zero_force_release(e: float) -> tuple[float, float, float]:
    """Damping for which the core leaves at restitution `e` when its force returns to zero.

    With `zeta = cos(b)` the force vanishes at `omega_y t = 2 b/sin(b)` and `-ln e = 2 b cot(b)`; beyond
    critical damping `b` is imaginary. Returns `(zeta, 1 - zeta^2, omega_y t)`.
    """
    x = -0.5 * math.log(e)
    if x < NEAR_UNDAMPED:
        d = angle_complement(x)
        sine = math.cos(d)
        return math.sin(d), sine * sine, (math.pi - 2.0 * d) / sine
    z = squared_angle(x)
    if z > 0.0:
        b = math.sqrt(z)
        sine = math.sin(b)
        return math.cos(b), sine * sine, 2.0 * b / sine
    if z < 0.0:
        b = math.sqrt(-z)
        sine = math.sinh(b)
        return math.cosh(b), -sine * sine, 2.0 * b / sine
    return 1.0, 0.0, 2.0


@compiled
def zero_displacement_release(e: float) -> tuple[float, float, float, float]:
    """Damping for `e = exp(-pi zeta/sqrt(1-zeta^2))` (Eq. 3): `(zeta, 1-zeta^2, omega_y t_f, omega_y t_c)`.

    The force turns tensile at `t_f`, before the displacement returns to zero at `t_c`.
    """
    log_e = -math.log(e)
    norm = math.hypot(math.pi, log_e)
    zeta = log_e / norm
    root = math.pi / norm
    return zeta, root * root, 2.0 * math.atan2(root, zeta) / root, math.pi / root


@compiled
def vertical_contact(
    cor: float, cor_over_e: float, omega2: float, zero_force: bool
) -> tuple[int, float, float, float, float]:
    """Vertical motion for a measured or modelled `cor`; `omega2 = K_y/M_eff` [1/s^2].

    `cor_over_e` is the share of the core's restitution `e` that the whole ball keeps (`M1/M` under
    momentum balance, 1 otherwise). Returns `(status, sigma, w2, t_force, t_contact)`: decay [1/s], damped
    frequency squared [1/s^2, negative beyond critical damping], end of the compressive force, release [s].
    """
    if not 0.0 < cor <= 1.0:
        return COR_OUT_OF_RANGE, math.nan, math.nan, math.nan, math.nan
    e = cor / cor_over_e
    if e > 1.0:
        return COR_EXCEEDS_MASS_RATIO, math.nan, math.nan, math.nan, math.nan
    omega = math.sqrt(omega2)
    if zero_force:
        zeta, root2, angle = zero_force_release(e)
        return OK, zeta * omega, root2 * omega2, angle / omega, angle / omega
    zeta, root2, angle_force, angle = zero_displacement_release(e)
    return OK, zeta * omega, root2 * omega2, angle_force / omega, angle / omega
