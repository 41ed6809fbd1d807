"""Derivatives of the thesis's own computation, slips included, as kernels.

The formulas of `thesis` are written with complex numbers, and so a derivative needs a second imaginary unit: a
complex quantity is held here as its real and imaginary part, each a number that carries a derivative (see `dual`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.compiled import compiled, compiled_allocating
from fitball.models.kernels.dual import STEP, cos, exp, sin, sqrt
from fitball.models.thesis.kernel import (
    BALL_MASS,
    C_Y,
    EPS,
    INERTIA_UNIT,
    K_Y,
    MASS_RATIO,
    OK,
    contact_of,
    thesis_bounce,
    thesis_damping,
    thesis_motion,
)
from fitball.values import FloatArray

ComplexArray = NDArray[np.complex128]
# Real and imaginary part, each with what it carries.
Pair = tuple[complex, complex]


@compiled
def times(x: Pair, y: Pair) -> Pair:
    """Product."""
    return x[0] * y[0] - x[1] * y[1], x[0] * y[1] + x[1] * y[0]


@compiled
def over(x: Pair, y: Pair) -> Pair:
    """Quotient."""
    magnitude_squared = y[0] * y[0] + y[1] * y[1]
    return (x[0] * y[0] + x[1] * y[1]) / magnitude_squared, (x[1] * y[0] - x[0] * y[1]) / magnitude_squared


@compiled
def power(z: Pair, t: complex) -> Pair:
    """`e^{zt}`."""
    envelope = exp(z[0] * t)
    return envelope * cos(z[1] * t), envelope * sin(z[1] * t)


@compiled
def swing(amplitude: Pair, late: Pair, early: Pair) -> complex:
    """`Re(amplitude (late - early))`."""
    return amplitude[0] * (late[0] - early[0]) - amplitude[1] * (late[1] - early[1])


@compiled
def driven_spin_pair(
    inertia_core: complex,
    inertia_shell: complex,
    k_theta: complex,
    damped_squared: complex,
    drive: complex,
    z: Pair,
    g: Pair,
) -> Pair:
    """`thesis.driven_spin` for a joint known to be stiff enough."""
    reduced = inertia_core * inertia_shell / (inertia_core + inertia_shell)
    damping = 2.0 * reduced * sqrt(k_theta / reduced - damped_squared)
    square = times(z, z)
    below = reduced * square[0] + damping * z[0] + k_theta, reduced * square[1] + damping * z[1]
    scale = reduced * drive / (inertia_shell * inertia_shell)
    stiffness = over((k_theta, 0.0 * k_theta), z)
    driven = times(over(g, below), (damping + stiffness[0], stiffness[1]))
    return scale * driven[0], scale * driven[1]


@compiled
def thesis_derivative(
    row: ComplexArray,
    damping_formula: int,
    eps: complex,
    cor: complex,
    v_x: complex,
    v_y: complex,
    omega: complex,
    sign: float,
    t_r: float,
) -> tuple[complex, complex, complex, complex]:
    """`(v_x2, v_y2, omega_2, contact_time)` as `thesis_bounce` finds them.

    `sign` of the slip and start `t_r` of the rolling (NaN: never) as `thesis_motion` finds them.
    """
    mass_ratio, k_y, k_theta, mu, _eps, c_y, split, mass, radius, inertia = row
    core_mass = mass_ratio * mass
    inertia_core, inertia_shell = split * inertia, (1.0 - split) * inertia
    sigma = thesis_damping(damping_formula, c_y, core_mass, k_y, mass_ratio, cor)
    damped_squared = k_y / core_mass - sigma * sigma
    w = sqrt(damped_squared)
    z = (-sigma, w)
    damping = 2.0 * core_mass * sigma
    g = (damping * v_y, -(k_y - damping * sigma) * v_y / w)
    t_c = math.pi / w
    impulse = over(g, z)
    friction = sign * mu / mass * impulse[0], sign * mu / mass * impulse[1]
    driven = driven_spin_pair(inertia_core, inertia_shell, k_theta, damped_squared, sign * mu * radius, z, g)
    leak = inertia_core / (inertia_core + inertia_shell) / INERTIA_UNIT * sign * mu * radius
    slide = driven[0] + leak * impulse[0], driven[1] + leak * impulse[1]
    one = (1.0 + 0.0 * w, 0.0 * w)
    end = power(z, t_c)
    if math.isnan(t_r):
        stray = -damping * v_y * sigma / damped_squared * end[0]
        v_x2 = v_x - swing(friction, end, one) - sign * mu / mass * stray
        return v_x2, cor * v_y, omega + swing(slide, end, one), t_c
    roll = driven_spin_pair(inertia_core, inertia_shell + mass * radius * radius, k_theta, damped_squared, -eps, z, g)
    slipping = friction[0] + radius * slide[0], friction[1] + radius * slide[1]
    start = power(z, complex(t_r, 0.0))
    slip = v_x - radius * omega - swing(slipping, start, one)
    nothing = (0.0 * w, 0.0 * w)
    rate = times(z, start)
    t_moved = complex(t_r, slip.imag / swing(slipping, rate, nothing).real)
    start = power(z, t_moved)
    omega_2 = omega + swing(slide, start, one) + swing(roll, end, start)
    return radius * omega_2, cor * v_y, omega_2, t_c


@compiled_allocating
def thesis_slopes(
    rows: ComplexArray,
    damping_formula: int,
    eps: ComplexArray,
    cor: ComplexArray,
    v_x1: ComplexArray,
    v_y1: ComplexArray,
    omega_1: ComplexArray,
    slopes: FloatArray,
) -> None:
    """Fill `slopes` (draws, impacts, 4) with what the outputs gain per unit of what the arguments carry.

    Arguments as those of `thesis.thesis_batch`. NaN where the status is not OK.
    """
    row = np.empty(rows.shape[1])
    for i in range(rows.shape[0]):
        row[:] = rows[i].real
        own = i if v_x1.shape[0] > 1 else 0
        for j in range(v_x1.shape[1]):
            row[EPS] = eps[i, j].real
            v_x, v_y, omega = v_x1[own, j].real, v_y1[own, j].real, omega_1[own, j].real
            status = thesis_bounce(row, damping_formula, cor[i, j].real, v_x, v_y, omega)[0]
            if status != OK:
                slopes[i, j, :] = math.nan
                continue
            core_mass = row[MASS_RATIO] * row[BALL_MASS]
            sigma = thesis_damping(damping_formula, row[C_Y], core_mass, row[K_Y], row[MASS_RATIO], cor[i, j].real)
            motion = thesis_motion(contact_of(row, sigma, v_x, v_y, omega))
            moved = thesis_derivative(
                rows[i],
                damping_formula,
                eps[i, j],
                cor[i, j],
                v_x1[own, j],
                v_y1[own, j],
                omega_1[own, j],
                motion.sign,
                motion.t_r,
            )
            for output in range(4):
                slopes[i, j, output] = moved[output].imag / STEP
