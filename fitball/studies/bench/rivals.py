"""What one would write without a closed form: the default two-mass ball as differential equations.

The same physics as model `two-mass` with its default closures; landing impulse and release are taken from the kernel,
so that only the integration of the contact is compared.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal

import numpy as np
from scipy.integrate import solve_ivp

from fitball.models.kernels.bounce import tied_inertia_split, tied_shell_share
from fitball.models.kernels.compiled import compiled
from fitball.models.kernels.contact import vertical_contact
from fitball.models.kernels.landing import friction_impulse
from fitball.values import Ball, FloatArray

Method = Literal["RK45", "DOP853", "LSODA", "Radau"]
# Layout of a set-up impact: constants, then the state (y, v_y, v_x, omega_1, omega_2, twist) and the first phase.
RIDING, C_Y, K_Y, K_THETA, C_THETA, CORE, SHELL, MASS, RADIUS, MU, EPS, END, STATE, PHASE = (*range(12), 12, 18)
SIZE = 19


def set_up(ball: Ball, values: Mapping[str, float], v_x: float, v_y: float, omega: float) -> FloatArray:
    """Constants and initial state of one impact, landing impulse included; raises ValueError if there is none."""
    m = values["mass_ratio"]
    riding = m * ball.mass
    omega2 = values["k_y"] / riding
    cor = values["cor_10"] + values["cor_slope"] * (v_y - 10.0)
    status, sigma, w2, _force, end = vertical_contact(cor, m, omega2, True)
    core, shell = tied_inertia_split(m) * ball.inertia, tied_shell_share(m) * ball.inertia
    compliance = 1.0 / core + 1.0 / shell
    gap = values["k_theta"] * compliance - w2
    if status or gap < 0.0:
        raise ValueError("this impact cannot be evaluated")
    eps = values["eps_10"] + values["eps_slope"] * (v_y - 10.0)
    ground = 1.0 / ball.mass + ball.radius**2 / shell
    need = ball.radius * eps / (shell * ground)
    impulse = (1.0 - m) * ball.mass * v_y
    friction, slipped, _held, onward = friction_impulse(
        v_x - ball.radius * omega, impulse, values["mu"], need, need, ground
    )
    v_x -= friction / ball.mass
    spin = omega + (ball.radius * friction - eps * impulse) / shell
    slip = v_x - ball.radius * spin
    stuck = slipped < impulse
    phase = math.copysign(1.0, slip) if abs(slip) > 0.0 else onward
    made = np.empty(SIZE)
    made[:STATE] = (
        riding, 2.0 * sigma * riding, values["k_y"], values["k_theta"], 2.0 * math.sqrt(gap) / compliance,
        core, shell, ball.mass, ball.radius, values["mu"], eps, end,
    )  # fmt: skip
    made[STATE:PHASE] = (0.0, v_y, v_x, omega, spin, 0.0)
    made[PHASE] = next_phase(made, made[STATE:PHASE]) if stuck else phase
    return made


@compiled
def grip_friction(c: FloatArray, z: FloatArray) -> tuple[float, float]:
    """Friction that a grip needs, and the normal force."""
    force = c[K_Y] * z[0] + c[C_Y] * z[1]
    torque = c[K_THETA] * z[5] + c[C_THETA] * (z[3] - z[4])
    gyration = c[SHELL] + c[MASS] * c[RADIUS] * c[RADIUS]
    return c[MASS] * c[RADIUS] * (torque - c[EPS] * force) / gyration, force


@compiled
def rates(c: FloatArray, phase: float, z: FloatArray, out: FloatArray) -> None:
    """Time derivatives of the state; `phase` is 0 while gripping, else the direction of slip."""
    needed, force = grip_friction(c, z)
    torque = c[K_THETA] * z[5] + c[C_THETA] * (z[3] - z[4])
    friction = needed if abs(phase) < 0.5 else -phase * c[MU] * force
    out[0] = z[1]
    out[1] = -force / c[RIDING]
    out[2] = friction / c[MASS]
    out[3] = -torque / c[CORE]
    out[4] = (torque - c[EPS] * force - c[RADIUS] * friction) / c[SHELL]
    out[5] = z[3] - z[4]


@compiled
def next_phase(c: FloatArray, z: FloatArray) -> float:
    """Grip or slip from zero slip, by the friction cone."""
    needed, force = grip_friction(c, z)
    if abs(needed) <= c[MU] * force:
        return 0.0
    return -1.0 if needed > 0.0 else 1.0


@compiled
def stepped(setups: FloatArray, steps: int, work: FloatArray, out: FloatArray) -> None:
    """Classical Runge-Kutta of fourth order with fixed steps, phases changed between them; `out` (impacts, 2)."""
    for i in range(setups.shape[0]):
        c = setups[i]
        z, a, b, k, d = work[0], work[1], work[2], work[3], work[4]
        for j in range(6):
            z[j] = c[STATE + j]
        phase = c[PHASE]
        h = c[END] / steps
        for _ in range(steps):
            rates(c, phase, z, k)
            for j in range(6):
                a[j] = z[j] + 0.5 * h * k[j]
                b[j] = k[j]
            rates(c, phase, a, k)
            for j in range(6):
                a[j] = z[j] + 0.5 * h * k[j]
                b[j] += 2.0 * k[j]
            rates(c, phase, a, k)
            for j in range(6):
                a[j] = z[j] + h * k[j]
                b[j] += 2.0 * k[j]
            rates(c, phase, a, d)
            for j in range(6):
                z[j] += h / 6.0 * (b[j] + d[j])
            slip = z[2] - c[RADIUS] * z[4]
            if abs(phase) < 0.5 or phase * slip <= 0.0:
                phase = next_phase(c, z)
        out[i, 0] = z[2]
        out[i, 1] = (c[CORE] * z[3] + c[SHELL] * z[4]) / (c[CORE] + c[SHELL])


def adaptive(setup: FloatArray, method: Method, rtol: float) -> tuple[float, float]:
    """Scipy's `solve_ivp` with events for the end of slip and of grip; returns `(v_x2, omega_2)`."""
    c = setup
    z = c[STATE:PHASE].copy()
    phase = float(c[PHASE])
    out = np.empty(6)
    time = 0.0
    scale = np.array([1e-3, 10.0, 10.0, 300.0, 300.0, 0.1])

    def slipping(_t: float, z: FloatArray) -> float:
        return float(phase * (z[2] - c[RADIUS] * z[4]))

    def holding(_t: float, z: FloatArray) -> float:
        needed, force = grip_friction(c, z)
        return float(c[MU] * force - abs(needed))

    def motion(_t: float, z: FloatArray) -> FloatArray:
        rates(c, phase, z, out)
        return out.copy()

    for event in (slipping, holding):
        event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
    for _ in range(50):
        run = solve_ivp(
            motion, (time, float(c[END])), z, method=method, rtol=rtol, atol=rtol * scale,
            events=[slipping if abs(phase) > 0.5 else holding],
        )  # fmt: skip
        z, time = run.y[:, -1].copy(), float(run.t[-1])
        if run.status != 1 or time >= c[END] * (1.0 - 1e-12):
            break
        if abs(phase) > 0.5:
            z[2] = c[RADIUS] * z[4]
            phase = float(next_phase(c, z))
        else:
            phase = -1.0 if grip_friction(c, z)[0] > 0.0 else 1.0
    return float(z[2]), float((c[CORE] * z[3] + c[SHELL] * z[4]) / (c[CORE] + c[SHELL]))
