"""Rivals: compiled RK4 and order 8 with located events, `solve_ivp`.

What one would write without a closed form: the default two-mass ball as differential equations.
Landing impulse, damping and release are taken from the kernels, so that only the integration of the
contact is compared.
"""

import math
from typing import Any, TypeAlias

import numpy as np
from scipy.integrate import DOP853, solve_ivp

from fitball.base.values import FloatArray
from fitball.models.kernels.compiled import entry, inlined, kernel
from fitball.models.kernels.contact import Flags, ball_of, contact_of, landed

# y, v_y, v_x, omega_1, omega_2, twist.
State: TypeAlias = tuple[float, float, float, float, float, float]
# A contact as numbers: constants (reciprocals of masses and inertias, as one would who wants it
# fast), then the state after landing and the first phase: 0 while gripping, else the direction of
# slip.
(
    PER_RIDING,
    C_Y,
    K_Y,
    K_THETA,
    C_THETA,
    PER_CORE,
    PER_SHELL,
    PER_MASS,
    RADIUS,
    MU,
    EPS,
    END,
    HOLDING,
) = range(13)
STATE = 13
PHASE = 19
SIZE = 20
# Ends of phases that are located in one contact, trials of a search for one, its precision as a
# share of the contact.
MOST_EVENTS = 64
MOST_TRIALS = 60
NEAR = 1e-15
# Typical sizes of the state, for absolute tolerances; a short first step, as a share of what is
# left of the contact.
SCALE = np.array([1e-3, 10.0, 10.0, 300.0, 300.0, 0.1])
FIRST = 1e-6


def _entries(row: FloatArray) -> tuple[float, ...]:
    return tuple(float(one) for one in row if one != 0.0)


# Dormand and Prince, order 8 in twelve stages (Hairer, Norsett and Wanner 1993), as scipy has it:
# what is not zero.
A2, A3, A4, A5, A6, A7, A8, A9, A10, A11, A12 = (_entries(row) for row in DOP853.A[1:12, :12])
B = _entries(DOP853.B[:12])
RK4_B = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)


@entry
def set_up(row: FloatArray, flags: Flags, v_x: float, v_y: float, omega: float) -> FloatArray:
    """The numbers (SIZE,) of one contact."""
    made = np.empty(SIZE)
    ball = ball_of(row, flags)[1]
    contact = contact_of(ball, flags, v_x, v_y, omega, np.nan)[1]
    v_x, spin, stuck = landed(contact)
    made[PER_RIDING], made[C_Y] = 1.0 / ball.riding, 2.0 * contact.spring.decay * ball.riding
    made[K_Y], made[K_THETA], made[C_THETA] = row[1], ball.stiffness, contact.damping
    made[PER_CORE], made[PER_SHELL], made[PER_MASS] = (
        1.0 / ball.core,
        1.0 / ball.shell,
        1.0 / ball.mass,
    )
    made[RADIUS], made[MU], made[EPS], made[END] = (
        ball.radius,
        ball.mu,
        contact.eps,
        contact.t_contact,
    )
    made[HOLDING] = ball.lever
    made[STATE], made[STATE + 1], made[STATE + 2] = 0.0, v_y, v_x
    made[STATE + 3], made[STATE + 4], made[STATE + 5] = omega, spin, 0.0
    made[PHASE] = (
        next_phase(made, first_state(made))
        if stuck
        else math.copysign(1.0, v_x - ball.radius * spin)
    )
    return made


@kernel
def first_state(c: FloatArray) -> State:
    """The state after landing."""
    return c[STATE], c[STATE + 1], c[STATE + 2], c[STATE + 3], c[STATE + 4], c[STATE + 5]


@kernel
def grip_friction(c: FloatArray, z: State) -> tuple[float, float]:
    """Friction that a grip needs, and the normal force."""
    force = c[K_Y] * z[0] + c[C_Y] * z[1]
    torque = c[K_THETA] * z[5] + c[C_THETA] * (z[3] - z[4])
    return c[HOLDING] * (torque - c[EPS] * force), force


@kernel
def rates(c: FloatArray, phase: float, z: State) -> State:
    """Time derivatives of the state."""
    force = c[K_Y] * z[0] + c[C_Y] * z[1]
    torque = c[K_THETA] * z[5] + c[C_THETA] * (z[3] - z[4])
    turning = torque - c[EPS] * force
    friction = c[HOLDING] * turning if phase == 0.0 else -phase * c[MU] * force
    spin = (turning - c[RADIUS] * friction) * c[PER_SHELL]
    return (
        z[1],
        -force * c[PER_RIDING],
        friction * c[PER_MASS],
        -torque * c[PER_CORE],
        spin,
        z[3] - z[4],
    )


@kernel
def margin(c: FloatArray, phase: float, z: State) -> float:
    """Below zero where the phase has ended: what friction has left while gripping, slip along its
    direction else.
    """
    if phase == 0.0:
        needed, force = grip_friction(c, z)
        return float(c[MU] * force - abs(needed))
    return float(phase * (z[2] - c[RADIUS] * z[4]))


@kernel
def next_phase(c: FloatArray, z: State) -> float:
    """Grip or slip from zero slip, by the friction cone."""
    needed, force = grip_friction(c, z)
    if abs(needed) <= c[MU] * force:
        return 0.0
    return -1.0 if needed > 0.0 else 1.0


@kernel
def after_event(c: FloatArray, phase: float, z: State) -> tuple[float, State]:
    """The phase after one that ended in state `z`, and the state without what is left of slip."""
    if phase == 0.0:
        return (-1.0 if grip_friction(c, z)[0] > 0.0 else 1.0), z
    z = (z[0], z[1], c[RADIUS] * z[4], z[3], z[4], z[5])
    return next_phase(c, z), z


@kernel
def outgoing(c: FloatArray, z: State) -> tuple[float, float]:
    """`v_x2` and `omega_2`: the spin of core and shell together, when their joint has come to
    rest.
    """
    return z[2], (z[3] * c[PER_SHELL] + z[4] * c[PER_CORE]) / (c[PER_SHELL] + c[PER_CORE])


@inlined
def moved(z: State, h: float, weights: tuple[float, ...], slopes: tuple[State, ...]) -> State:
    """`z + h sum(weights slopes)`."""
    y, v_y, v_x, omega_1, omega_2, twist = z
    for r in range(len(weights)):
        a = h * weights[r]
        k = slopes[r]
        y = y + a * k[0]
        v_y = v_y + a * k[1]
        v_x = v_x + a * k[2]
        omega_1 = omega_1 + a * k[3]
        omega_2 = omega_2 + a * k[4]
        twist = twist + a * k[5]
    return y, v_y, v_x, omega_1, omega_2, twist


@kernel
def step(order: int, c: FloatArray, phase: float, z: State, h: float) -> State:
    """One step of `h` seconds, classical or of order 8."""
    k1 = rates(c, phase, z)
    if order == 4:
        k2 = rates(c, phase, moved(z, h, (0.5,), (k1,)))
        k3 = rates(c, phase, moved(z, h, (0.5,), (k2,)))
        k4 = rates(c, phase, moved(z, h, (1.0,), (k3,)))
        return moved(z, h, RK4_B, (k1, k2, k3, k4))
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


@kernel
def end_of_phase(
    order: int,
    c: FloatArray,
    phase: float,
    z: State,
    h: float,
    new: State,
) -> tuple[float, State]:
    """How long after `z` the phase ends, and the state there, if it has ended in `new` after `h`:
    regula falsi, with half the ordinate of an end that stays (Illinois).
    """
    low = 0.0
    high = h
    before = h
    stayed = 0
    at_low = margin(c, phase, z)
    at_high = margin(c, phase, new)
    middle = h
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
            high = middle
            at_high = here
            at_low = at_low * (0.5 if stayed == -1 else 1.0)
            stayed = -1
        else:
            low = middle
            at_low = here
            at_high = at_high * (0.5 if stayed == 1 else 1.0)
            stayed = 1
    return middle, new


@entry
def fixed_steps(setups: FloatArray, order: int, steps: int) -> FloatArray:
    """`v_x2` and `omega_2` (impacts, 2) of contacts (impacts, SIZE) by so many equal steps of order
    4 or 8; a phase that ends within one is located, and the rest of the step goes on from there.
    """
    out = np.empty((setups.shape[0], 2))
    for i in range(setups.shape[0]):
        c = setups[i]
        z = first_state(c)
        phase = c[PHASE]
        events = 0
        for _ in range(steps):
            left = c[END] / steps
            while left > 0.0:
                new = step(order, c, phase, z, left)
                taken = left
                ended = margin(c, phase, new) < 0.0
                if ended and events < MOST_EVENTS:
                    taken, new = end_of_phase(order, c, phase, z, left, new)
                    events += 1
                z = new
                left -= taken
                if ended:
                    phase, z = after_event(c, phase, z)
        out[i, 0], out[i, 1] = outgoing(c, z)
    return out


def adaptive(setups: FloatArray, method: Any, rtol: float, most: float = math.inf) -> FloatArray:
    """The same by `solve_ivp`; no step is longer than the share `most` of the contact: events are
    looked for at the ends of steps, and a grip that breaks and holds again within one is stepped
    over.
    """
    return np.array([_integrated(c, method, rtol, most) for c in setups])


def _integrated(c: FloatArray, method: Any, rtol: float, most: float) -> tuple[float, float]:
    z = first_state(c)
    phase = float(c[PHASE])
    time = 0.0

    def motion(_t: float, z: FloatArray) -> State:
        return rates(c, phase, tuple(z))

    def ended(_t: float, z: FloatArray) -> float:
        return margin(c, phase, tuple(z))

    ended.terminal = True  # type: ignore[attr-defined]
    ended.direction = -1.0  # type: ignore[attr-defined]
    for _ in range(MOST_EVENTS):
        first = None if math.isinf(most) else FIRST * (c[END] - time)
        run = solve_ivp(
            motion,
            (time, c[END]),
            z,
            method,
            events=ended,
            rtol=rtol,
            atol=rtol * SCALE,
            max_step=most * c[END],
            first_step=first,
        )
        y, v_y, v_x, omega_1, omega_2, twist = run.y[:, -1].tolist()
        z = (y, v_y, v_x, omega_1, omega_2, twist)
        time = float(run.t[-1])
        if run.status != 1 or time >= c[END] * (1.0 - 1e-12):
            break
        phase, z = after_event(c, phase, z)
    return outgoing(c, z)
