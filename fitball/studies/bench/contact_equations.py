"""What one would write without a closed form: the default two-mass ball as differential equations.

The same physics as model `two-mass` with its default closures; landing impulse and release are taken from the kernel,
so that only the integration of the contact is compared.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from fitball.models.kernels.bounce import tied_inertia_split, tied_shell_share
from fitball.models.kernels.compiled import compiled
from fitball.models.kernels.contact import vertical_contact
from fitball.models.kernels.landing import friction_impulse
from fitball.values import Ball, FloatArray

# y, v_y, v_x, omega_1, omega_2, twist.
State = tuple[float, float, float, float, float, float]
# Layout of a set-up impact: constants, then the state and the first phase.
# Reciprocals of masses and inertias, as one would who wants it fast.
PER_RIDING, C_Y, K_Y, K_THETA, C_THETA, PER_CORE, PER_SHELL, PER_MASS, RADIUS, MU, EPS, END, HOLDING = range(13)
STATE, PHASE = 13, 19
SIZE = 20


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
        1.0 / riding, 2.0 * sigma * riding, values["k_y"], values["k_theta"], 2.0 * math.sqrt(gap) / compliance,
        1.0 / core, 1.0 / shell, 1.0 / ball.mass, ball.radius, values["mu"], eps, end,
        ball.mass * ball.radius / (shell + ball.mass * ball.radius**2),
    )  # fmt: skip
    made[STATE:PHASE] = (0.0, v_y, v_x, omega, spin, 0.0)
    made[PHASE] = next_phase(made, first_state(made)) if stuck else phase
    return made


@compiled
def first_state(c: FloatArray) -> State:
    """The state after the landing impulse."""
    return c[STATE], c[STATE + 1], c[STATE + 2], c[STATE + 3], c[STATE + 4], c[STATE + 5]


@compiled
def grip_friction(c: FloatArray, z: State) -> tuple[float, float]:
    """Friction that a grip needs, and the normal force."""
    force = c[K_Y] * z[0] + c[C_Y] * z[1]
    torque = c[K_THETA] * z[5] + c[C_THETA] * (z[3] - z[4])
    return float(c[HOLDING] * (torque - c[EPS] * force)), force


@compiled
def rates(c: FloatArray, phase: float, z: State) -> State:
    """Time derivatives of the state; `phase` is 0 while gripping, else the direction of slip."""
    force = c[K_Y] * z[0] + c[C_Y] * z[1]
    torque = c[K_THETA] * z[5] + c[C_THETA] * (z[3] - z[4])
    turning = torque - c[EPS] * force
    friction = c[HOLDING] * turning if phase == 0.0 else -phase * c[MU] * force
    return (
        z[1],
        -force * c[PER_RIDING],
        friction * c[PER_MASS],
        -torque * c[PER_CORE],
        (turning - c[RADIUS] * friction) * c[PER_SHELL],
        z[3] - z[4],
    )


@compiled
def margin(c: FloatArray, phase: float, z: State) -> float:
    """Below zero where the phase has ended: what friction has left while gripping, slip along its direction else."""
    if phase == 0.0:
        needed, force = grip_friction(c, z)
        return float(c[MU] * force - abs(needed))
    return float(phase * (z[2] - c[RADIUS] * z[4]))


@compiled
def next_phase(c: FloatArray, z: State) -> float:
    """Grip or slip from zero slip, by the friction cone."""
    needed, force = grip_friction(c, z)
    if abs(needed) <= c[MU] * force:
        return 0.0
    return -1.0 if needed > 0.0 else 1.0


@compiled
def after_event(c: FloatArray, phase: float, z: State) -> tuple[float, State]:
    """The phase after one that ended in state `z`, and the state without what is left of slip."""
    if phase == 0.0:
        return (-1.0 if grip_friction(c, z)[0] > 0.0 else 1.0), z
    z = (z[0], z[1], c[RADIUS] * z[4], z[3], z[4], z[5])
    return next_phase(c, z), z


@compiled
def outgoing(c: FloatArray, z: State) -> tuple[float, float]:
    """`v_x2` and `omega_2`: the spin of core and shell together, when their joint has come to rest."""
    return z[2], (z[3] * c[PER_SHELL] + z[4] * c[PER_CORE]) / (c[PER_SHELL] + c[PER_CORE])
