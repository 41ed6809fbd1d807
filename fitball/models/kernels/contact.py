"""Vertical motion of the core on its spring and damper, from landing to release, as kernels.

`M1 y'' + C_y y' + K_y y = 0`, `y(0) = 0`, `y'(0) = v` (Jafri 2004, Eqs 1-2). The coefficient of restitution `e` fixes
the damping ratio `zeta`; which equation does so depends on when the ball is taken to leave: at `y = 0`
(`e = exp(-pi zeta/sqrt(1 - zeta^2))`, Eq. 5), or when the force has fallen to zero (not in the thesis).
"""

from __future__ import annotations

import math

from fitball.models.kernels.compiled import inner
from fitball.models.kernels.dual import Number, carry, cos, cosh, log, sin, sinh, sqrt
from fitball.models.types import Status

OK = int(Status.OK)
COR_OUT_OF_RANGE = int(Status.COR_OUT_OF_RANGE)
COR_EXCEEDS_MASS_RATIO = int(Status.COR_EXCEEDS_MASS_RATIO)

# b*cot(b) = x is solved for b near pi/2 below this x, and for b^2 (of either sign) above it.
NEAR_UNDAMPED = 0.9


@inner
def find_angle_complement(x: float) -> float:
    """Solve `(pi/2 - d) tan(d) = x` for d in [0, pi/2), 0 <= x < 0.9, by Halley's method."""
    d = 2.0 * x / math.pi
    d += 2.0 / math.pi * d * d
    for _ in range(30):
        tangent = math.tan(d)
        arm = 0.5 * math.pi - d
        secant_squared = 1.0 + tangent * tangent
        f = arm * tangent - x
        f1 = arm * secant_squared - tangent
        f2 = 2.0 * (arm * tangent - 1.0) * secant_squared
        step = f / (f1 - 0.5 * f * f2 / f1)
        d -= step
        if abs(step) <= 1e-6 * d:
            break
    return d


@inner
def angle_complement(x: Number) -> Number:
    """`find_angle_complement` with what `x` carries."""
    d = find_angle_complement(x.real)
    arm = 0.5 * math.pi - d
    tangent = x.real / arm
    return carry(d, x, 1.0 / (arm * (1.0 + tangent * tangent) - tangent))


@inner
def slope_near_critical(z: float) -> float:
    """Slope of `sqrt(z) cot(sqrt(z))` for |z| below 1e-3."""
    return -(1.0 / 3 + z * (2.0 / 45 + z * (6.0 / 945 + z * 4.0 / 4725)))


@inner
def find_squared_angle(x: float) -> float:
    """Solve `sqrt(z) cot(sqrt(z)) = x` for z, x >= 0.9; z < 0 (hyperbolic) where x > 1."""
    # x = 1 - z/3 - z^2/45 - ... near critical damping; x -> sqrt(-z) far beyond it.
    z = 3.0 * (1.0 - x) if x < 2.0 else -x * x
    for _ in range(60):
        if abs(z) < 1e-3:
            f = 1.0 - z * (1.0 / 3 + z * (1.0 / 45 + z * (2.0 / 945 + z / 4725)))
            slope = slope_near_critical(z)
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


@inner
def squared_angle(x: Number) -> Number:
    """`find_squared_angle` with what `x` carries."""
    z = find_squared_angle(x.real)
    # The slope of sqrt(z) cot(sqrt(z)) where that is x, on either side of critical damping.
    slope = slope_near_critical(z) if abs(z) < 1e-3 else 0.5 * (x.real * (1.0 - x.real) / z - 1.0)
    return carry(z, x, 1.0 / slope)


@inner
def zero_force_release(e: Number) -> tuple[Number, Number, Number]:
    """Damping for which the core leaves at restitution `e` when its force returns to zero.

    With `zeta = cos(b)` the force vanishes at `omega_y t = 2 b/sin(b)` and `-ln e = 2 b cot(b)`; beyond
    critical damping `b` is imaginary. Returns `(zeta, 1 - zeta^2, omega_y t)`.
    """
    x = -0.5 * log(e)
    if x.real < NEAR_UNDAMPED:
        d = angle_complement(x)
        sine = cos(d)
        return sin(d), sine * sine, (math.pi - 2.0 * d) / sine
    z = squared_angle(x)
    if z.real > 0.0:
        b = sqrt(z)
        sine = sin(b)
        return cos(b), sine * sine, 2.0 * b / sine
    if z.real < 0.0:
        b = sqrt(-z)
        sine = sinh(b)
        return cosh(b), -sine * sine, 2.0 * b / sine
    return 1.0 - 0.5 * z, z, 2.0 + z / 3.0


@inner
def zero_displacement_release(e: Number) -> tuple[Number, Number, Number, Number]:
    """Damping for `e = exp(-pi zeta/sqrt(1-zeta^2))` (Eq. 5): `(zeta, 1-zeta^2, omega_y t_f, omega_y t_c)`.

    The force turns tensile at `t_f`, before the displacement returns to zero at `t_c`.
    """
    log_e = -log(e)
    length = math.hypot(math.pi, log_e.real)
    norm = carry(length, log_e, log_e.real / length)
    zeta = log_e / norm
    root = math.pi / norm
    # zeta = sin(d), root = cos(d): the slope of the angle atan2(root, zeta) with zeta is -1/root.
    angle = carry(math.atan2(root.real, zeta.real), zeta, -1.0 / root.real)
    return zeta, root * root, 2.0 * angle / root, math.pi / root


@inner
def vertical_contact(
    cor: Number, cor_over_e: Number, natural_squared: Number, zero_force: bool
) -> tuple[int, Number, Number, Number, Number]:
    """Vertical motion for a measured or modelled `cor`; `natural_squared = K_y/M_eff` [1/s^2].

    `cor_over_e` is the share of the core's restitution `e` that the whole ball keeps (`M1/M` under
    momentum balance, 1 otherwise). Returns `(status, decay, damped_squared, t_force, t_contact)`: decay [1/s], damped
    frequency squared [1/s^2, negative beyond critical damping], end of the compressive force, release [s].
    """
    if not 0.0 < cor.real <= 1.0:
        return COR_OUT_OF_RANGE, math.nan, math.nan, math.nan, math.nan
    e = cor / cor_over_e
    if e.real > 1.0:
        return COR_EXCEEDS_MASS_RATIO, math.nan, math.nan, math.nan, math.nan
    omega_y = sqrt(natural_squared)
    if zero_force:
        zeta, share, angle = zero_force_release(e)
        return OK, zeta * omega_y, share * natural_squared, angle / omega_y, angle / omega_y
    zeta, share, angle_force, angle = zero_displacement_release(e)
    return OK, zeta * omega_y, share * natural_squared, angle_force / omega_y, angle / omega_y
