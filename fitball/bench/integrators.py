"""What one would write without a closed form: the default two-mass ball as differential equations, and compiled
Runge-Kutta methods of fixed step for them, careless or careful about where a phase ends; and `solve_ivp` of scipy.

The same physics as model `two-mass` with its default closures; landing impulse and release are taken from the kernel,
so that only the integration of the contact is compared. All is in one file, with whose changes its compiled cache
expires.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal

import numpy as np
from scipy.integrate import DOP853, solve_ivp

from fitball.models.kernels.compiled import compiled, inlined
from fitball.models.kernels.contact import friction_impulse, tied_inertia_split, tied_shell_share, vertical_contact
from fitball.values import Ball, FloatArray

# y, v_y, v_x, omega_1, omega_2, twist.
State = tuple[float, float, float, float, float, float]
# Layout of a set-up impact: constants, then the state and the first phase.
# Reciprocals of masses and inertias, as one would who wants it fast.
PER_RIDING, C_Y, K_Y, K_THETA, C_THETA, PER_CORE, PER_SHELL, PER_MASS, RADIUS, MU, EPS, END, HOLDING = range(13)
STATE, PHASE = 13, 19
SIZE = 20

Method = Literal["RK45", "DOP853", "LSODA"]
# Typical sizes of the state, for absolute tolerances; a short first step, as a share of what is left of the contact.
SCALE, FIRST = np.array([1e-3, 10.0, 10.0, 300.0, 300.0, 0.1]), 1e-6
# Ends of phases in one impact that a rival follows, trials of a search for one, and how near it comes to it, as a
# share of the contact.
MOST_EVENTS, MOST_TRIALS, NEAR = 64, 60, 1e-15


def _entries(row: FloatArray) -> tuple[float, ...]:
    return tuple(float(entry) for entry in row if entry != 0.0)


# Dormand and Prince, order 8 in twelve stages (Hairer, Norsett and Wanner 1993), as scipy has it: what is not zero.
A2, A3, A4, A5, A6, A7, A8, A9, A10, A11, A12 = (_entries(row) for row in DOP853.A[1:12, :12])
B = _entries(DOP853.B[:12])
RK4_B = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)


def set_up(ball: Ball, values: Mapping[str, float], v_x: float, v_y: float, omega: float) -> FloatArray:
    """Constants and initial state of one impact, landing impulse included; raises ValueError if there is none."""
    m = values["mass_ratio"]
    riding = m * ball.mass
    omega2 = values["k_y"] / riding
    cor = values["cor_10"] + values["cor_slope"] * (v_y - 10.0)
    status, sigma, w2, _force, end, _flight = vertical_contact(cor, m, omega2, True)
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


@inlined
def moved(z: State, h: float, weights: tuple[float, ...], slopes: tuple[State, ...]) -> State:
    """`z + h sum(weights slopes)`."""
    y, v_y, v_x, omega_1, omega_2, twist = z
    for r in range(len(weights)):
        a, k = h * weights[r], slopes[r]
        y += a * k[0]
        v_y += a * k[1]
        v_x += a * k[2]
        omega_1 += a * k[3]
        omega_2 += a * k[4]
        twist += a * k[5]
    return y, v_y, v_x, omega_1, omega_2, twist


@compiled
def step_of_order_4(c: FloatArray, phase: float, z: State, h: float) -> State:
    """One step of `h` seconds of the classical method."""
    k1 = rates(c, phase, z)
    k2 = rates(c, phase, moved(z, h, (0.5,), (k1,)))
    k3 = rates(c, phase, moved(z, h, (0.5,), (k2,)))
    k4 = rates(c, phase, moved(z, h, (1.0,), (k3,)))
    return moved(z, h, RK4_B, (k1, k2, k3, k4))


@compiled
def step_of_order_8(c: FloatArray, phase: float, z: State, h: float) -> State:
    """One step of `h` seconds of Dormand and Prince's method."""
    k1 = rates(c, phase, z)
    k2 = rates(c, phase, moved(z, h, A2, (k1,)))
    k3 = rates(c, phase, moved(z, h, A3, (k1, k2)))
    k4 = rates(c, phase, moved(z, h, A4, (k1, k3)))
    k5 = rates(c, phase, moved(z, h, A5, (k1, k3, k4)))
    k6 = rates(c, phase, moved(z, h, A6, (k1, k4, k5)))
    k7 = rates(c, phase, moved(z, h, A7, (k1, k4, k5, k6)))
    k8 = rates(c, phase, moved(z, h, A8, (k1, k4, k5, k6, k7)))
    k9 = rates(c, phase, moved(z, h, A9, (k1, k4, k5, k6, k7, k8)))
    k10 = rates(c, phase, moved(z, h, A10, (k1, k4, k5, k6, k7, k8, k9)))
    k11 = rates(c, phase, moved(z, h, A11, (k1, k4, k5, k6, k7, k8, k9, k10)))
    k12 = rates(c, phase, moved(z, h, A12, (k1, k4, k5, k6, k7, k8, k9, k10, k11)))
    return moved(z, h, B, (k1, k6, k7, k8, k9, k10, k11, k12))


@compiled
def step(order: int, c: FloatArray, phase: float, z: State, h: float) -> State:
    """One step of `h` seconds by the method of this order, 4 or 8."""
    return step_of_order_4(c, phase, z, h) if order == 4 else step_of_order_8(c, phase, z, h)


@compiled
def end_of_phase(order: int, c: FloatArray, phase: float, z: State, h: float, new: State) -> tuple[float, State]:
    """How long after `z` the phase ends, and the state there, if it has ended in `new` after `h`: regula falsi, with
    half the ordinate of an end that stays (Illinois).
    """
    low, high, before, stayed = 0.0, h, h, 0
    at_low, at_high = margin(c, phase, z), margin(c, phase, new)
    for _ in range(MOST_TRIALS):
        middle = high - at_high * (high - low) / (at_high - at_low)
        if not low < middle < high:
            middle = 0.5 * (low + high)
        new = step(order, c, phase, z, middle)
        here = margin(c, phase, new)
        if abs(middle - before) <= NEAR * c[END]:
            break
        before = middle
        if here < 0.0:
            high, at_high = middle, here
            at_low *= 0.5 if stayed == -1 else 1.0
            stayed = -1
        else:
            low, at_low = middle, here
            at_high *= 0.5 if stayed == 1 else 1.0
            stayed = 1
    return middle, new


@compiled
def stepped(setups: FloatArray, order: int, steps: int, located: bool, out: FloatArray) -> None:
    """See `fixed_steps`."""
    for i in range(setups.shape[0]):
        c = setups[i]
        z, phase = first_state(c), c[PHASE]
        events = 0
        for _ in range(steps):
            left = c[END] / steps
            while left > 0.0:
                new = step(order, c, phase, z, left)
                taken = left
                ended = margin(c, phase, new) < 0.0
                if ended and located and events < MOST_EVENTS:
                    taken, new = end_of_phase(order, c, phase, z, left, new)
                    events += 1
                z = new
                left -= taken
                if ended and located:
                    phase, z = after_event(c, phase, z)
                elif ended:
                    phase = next_phase(c, z)
        out[i, 0], out[i, 1] = outgoing(c, z)


def fixed_steps(setups: FloatArray, order: int, steps: int, *, located: bool) -> FloatArray:
    """`v_x2` and `omega_2` of set-up impacts, (impacts, 2), by so many equal steps of a method of order 4 or 8.

    Where ends of phases are `located`, each is searched for inside its step and the integration goes on from there;
    else the phase changes between steps only.
    """
    out = np.empty((len(setups), 2))
    stepped(setups, order, steps, located, out)
    return out


def adaptive(setup: FloatArray, method: Method, rtol: float, most: float = math.inf) -> tuple[float, float]:
    """`(v_x2, omega_2)` of a set-up impact; no step is longer than the share `most` of the contact.

    Events are looked for at the ends of steps: a grip that breaks and could grip again within one is stepped over.
    Who bounds steps makes the first of a phase very short too: slip begins at zero, and may end there soon.
    """
    c = setup
    z, phase, time = first_state(c), float(c[PHASE]), 0.0

    def motion(_t: float, z: FloatArray) -> tuple[float, ...]:
        return rates(c, phase, tuple(z))

    def ended(_t: float, z: FloatArray) -> float:
        return margin(c, phase, tuple(z))

    ended.terminal, ended.direction = True, -1.0  # type: ignore[attr-defined]
    for _ in range(MOST_EVENTS):
        first = None if math.isinf(most) else FIRST * (c[END] - time)
        run = solve_ivp(
            motion, (time, c[END]), z, method, events=ended, rtol=rtol, atol=rtol * SCALE, max_step=most * c[END],
            first_step=first,
        )  # fmt: skip
        y, v_y, v_x, omega_1, omega_2, twist = run.y[:, -1].tolist()
        z, time = (y, v_y, v_x, omega_1, omega_2, twist), float(run.t[-1])
        if run.status != 1 or time >= c[END] * (1.0 - 1e-12):
            break
        phase, z = after_event(c, phase, z)
    return outgoing(c, z)
