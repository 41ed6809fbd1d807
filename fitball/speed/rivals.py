"""Rivals: compiled RK4 and order 8 with located events, `solve_ivp`.

What one would write without a closed form: the default two-mass ball as differential equations.
Landing impulse, damping and release are taken from the kernels, so that only the integration of the
contact is compared.
"""

import math
from typing import Annotated, Literal, TypeAlias

import numpy as np
from scipy.integrate import DOP853, solve_ivp

from fitball.base.values import FloatArray
from fitball.models.kernels.compiled import entry, inlined, kernel
from fitball.models.kernels.contact import K_Y as STIFFNESS
from fitball.models.kernels.contact import Flags, ball_of, contact_of, landed

# Methods of `solve_ivp` that are rivals.
Method: TypeAlias = Literal["RK45", "DOP853"]
# y, v_y, v_x, omega_1, omega_2, twist.
ContactState: TypeAlias = tuple[float, float, float, float, float, float]
# Places among the numbers of a contact. First constants, SI: reciprocals of masses and
# inertias, because products are faster than quotients.
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
# Then the six numbers of the state after landing.
STATE_BEGIN = 13
# Then the first phase: 0 while gripping, else the direction of slip, 1 or -1.
PHASE = 19
# Numbers of a contact in all.
CONTACT_NUMBERS = 20
# Ends of phases that are located in one contact; more are not, so that a chattering one ends.
MOST_EVENTS = 64
# Trials of a search for the end of a phase; halving alone would reach rounding in them.
MOST_TRIALS = 60
# Precision of that search, as a share of the contact: about rounding.
SEARCH_PRECISION = 1e-15
# Typical sizes of the state (y, v_y, v_x, omega_1, omega_2, twist), SI, for absolute tolerances.
TYPICAL_STATE = np.array([1e-3, 10.0, 10.0, 300.0, 300.0, 0.1])
# First step of an adaptive run with short steps, as a share of the remaining contact.
FIRST_STEP = 1e-6


def _nonzero(row: FloatArray) -> tuple[float, ...]:
    """The entries of a row that are not zero."""
    return tuple(float(entry) for entry in row if entry != 0.0)


# Rows of the tableau of Dormand and Prince, order 8 in twelve stages (Hairer, Norsett and Wanner
# 1993), as scipy has it, without zeros.
A2, A3, A4, A5, A6, A7, A8, A9, A10, A11, A12 = (_nonzero(row) for row in DOP853.A[1:12, :12])
# Its weights, without zeros.
B = _nonzero(DOP853.B[:12])
# Weights of the classical method of order 4.
RK4_B = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)


@entry
def set_up(row: FloatArray, flags: Flags, v_x: float, v_y: float, omega: float) -> FloatArray:
    """The numbers of a contact (CONTACT_NUMBERS,), of a parameter set `row` of the two-mass ball
    that comes with `v_x`, `v_y` [m/s] and `omega` [rad/s].
    """
    c = np.empty(CONTACT_NUMBERS)
    ball = ball_of(row, flags)[1]
    contact = contact_of(ball, flags, v_x, v_y, omega, np.nan)[1]
    v_x, spin, stuck = landed(contact)
    c[PER_RIDING] = 1.0 / ball.riding
    c[C_Y] = 2.0 * contact.spring.decay * ball.riding
    c[K_Y] = row[STIFFNESS]
    c[K_THETA] = ball.stiffness
    c[C_THETA] = contact.damping
    c[PER_CORE] = 1.0 / ball.core
    c[PER_SHELL] = 1.0 / ball.shell
    c[PER_MASS] = 1.0 / ball.mass
    c[RADIUS] = ball.radius
    c[MU] = ball.mu
    c[EPS] = contact.eps
    c[END] = contact.t_contact
    c[HOLDING] = ball.lever
    c[STATE_BEGIN] = 0.0
    c[STATE_BEGIN + 1] = v_y
    c[STATE_BEGIN + 2] = v_x
    c[STATE_BEGIN + 3] = omega
    c[STATE_BEGIN + 4] = spin
    c[STATE_BEGIN + 5] = 0.0
    if stuck:
        c[PHASE] = next_phase(c, first_state(c))
    else:
        c[PHASE] = math.copysign(1.0, v_x - ball.radius * spin)
    return c


@kernel
def first_state(c: FloatArray) -> ContactState:
    """The state after landing, from the numbers `c` of a contact."""
    k = STATE_BEGIN
    return c[k], c[k + 1], c[k + 2], c[k + 3], c[k + 4], c[k + 5]


@kernel
def grip_friction(c: FloatArray, z: ContactState) -> tuple[float, float]:
    """Friction that a grip needs, and the normal force [N], in the state `z`."""
    y, v_y, _, omega_1, omega_2, twist = z
    force = c[K_Y] * y + c[C_Y] * v_y
    torque = c[K_THETA] * twist + c[C_THETA] * (omega_1 - omega_2)
    return c[HOLDING] * (torque - c[EPS] * force), force


@kernel
def rates(c: FloatArray, phase: float, z: ContactState) -> ContactState:
    """Time derivatives of the state `z` in a phase."""
    y, v_y, _, omega_1, omega_2, twist = z
    force = c[K_Y] * y + c[C_Y] * v_y
    torque = c[K_THETA] * twist + c[C_THETA] * (omega_1 - omega_2)
    turning = torque - c[EPS] * force
    friction = c[HOLDING] * turning if phase == 0.0 else -phase * c[MU] * force
    a_y = -force * c[PER_RIDING]
    a_x = friction * c[PER_MASS]
    spin_1 = -torque * c[PER_CORE]
    spin_2 = (turning - c[RADIUS] * friction) * c[PER_SHELL]
    return v_y, a_y, a_x, spin_1, spin_2, omega_1 - omega_2


@kernel
def margin(c: FloatArray, phase: float, z: ContactState) -> float:
    """A number that is below zero where the phase has ended: while gripping the friction in reserve
    [N], else the slip along its direction [m/s].
    """
    if phase == 0.0:
        needed, force = grip_friction(c, z)
        return float(c[MU] * force - abs(needed))
    _, _, v_x, _, omega_2, _ = z
    return float(phase * (v_x - c[RADIUS] * omega_2))


@kernel
def next_phase(c: FloatArray, z: ContactState) -> float:
    """The phase that follows zero slip, grip (0) or slip in a direction, by the friction cone."""
    needed, force = grip_friction(c, z)
    if abs(needed) <= c[MU] * force:
        return 0.0
    return -1.0 if needed > 0.0 else 1.0


@kernel
def after_event(c: FloatArray, phase: float, z: ContactState) -> tuple[float, ContactState]:
    """The phase after one that ended in the state `z`, and that state without its residual slip."""
    if phase == 0.0:
        needed, _ = grip_friction(c, z)
        return (-1.0 if needed > 0.0 else 1.0), z
    y, v_y, _, omega_1, omega_2, twist = z
    z = (y, v_y, c[RADIUS] * omega_2, omega_1, omega_2, twist)
    return next_phase(c, z), z


@kernel
def outgoing(c: FloatArray, z: ContactState) -> tuple[float, float]:
    """`v_x2` [m/s] and `omega_2` [rad/s] of the state `z` at release: the spin of core and shell
    together, when their joint has come to rest.
    """
    _, _, v_x, omega_1, omega_2, _ = z
    weighted = omega_1 * c[PER_SHELL] + omega_2 * c[PER_CORE]
    return v_x, weighted / (c[PER_SHELL] + c[PER_CORE])


@inlined
def moved_state(
    z: ContactState,
    h: float,
    weights: tuple[float, ...],
    slopes: tuple[ContactState, ...],
) -> ContactState:
    """The state `z + h sum(weights slopes)`."""
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
def step(order: int, c: FloatArray, phase: float, z: ContactState, h: float) -> ContactState:
    """The state one step of `h` seconds after `z`, by the classical method of order 4 or that of
    order 8.
    """
    k1 = rates(c, phase, z)
    if order == 4:
        k2 = rates(c, phase, moved_state(z, h, (0.5,), (k1,)))
        k3 = rates(c, phase, moved_state(z, h, (0.5,), (k2,)))
        k4 = rates(c, phase, moved_state(z, h, (1.0,), (k3,)))
        return moved_state(z, h, RK4_B, (k1, k2, k3, k4))
    k2 = rates(c, phase, moved_state(z, h, A2, (k1,)))
    k3 = rates(c, phase, moved_state(z, h, A3, (k1, k2)))
    k4 = rates(c, phase, moved_state(z, h, A4, (k1, k3)))
    k5 = rates(c, phase, moved_state(z, h, A5, (k1, k3, k4)))
    k6 = rates(c, phase, moved_state(z, h, A6, (k1, k4, k5)))
    k7 = rates(c, phase, moved_state(z, h, A7, (k1, k4, k5, k6)))
    k8 = rates(c, phase, moved_state(z, h, A8, (k1, k4, k5, k6, k7)))
    k9 = rates(c, phase, moved_state(z, h, A9, (k1, k4, k5, k6, k7, k8)))
    k10 = rates(c, phase, moved_state(z, h, A10, (k1, k4, k5, k6, k7, k8, k9)))
    k11 = rates(c, phase, moved_state(z, h, A11, (k1, k4, k5, k6, k7, k8, k9, k10)))
    k12 = rates(c, phase, moved_state(z, h, A12, (k1, k4, k5, k6, k7, k8, k9, k10, k11)))
    return moved_state(z, h, B, (k1, k6, k7, k8, k9, k10, k11, k12))


@kernel
def end_of_phase(
    order: int,
    c: FloatArray,
    phase: float,
    z: ContactState,
    h: float,
    new: ContactState,
) -> tuple[float, ContactState]:
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
        if abs(middle - before) <= SEARCH_PRECISION * c[END]:
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
def fixed_steps(
    setups: Annotated[FloatArray, "impacts numbers"],
    order: int,
    steps: int,
) -> Annotated[FloatArray, "impacts 2"]:
    """`v_x2` [m/s] and `omega_2` [rad/s] of contacts by so many equal steps of order 4 or 8. A
    phase that ends within a step is located, and the rest of the step goes on from there.
    """
    out = np.empty((setups.shape[0], 2))
    for i in range(setups.shape[0]):
        c = setups[i]
        z = first_state(c)
        phase = c[PHASE]
        events = 0
        for _ in range(steps):
            remaining = c[END] / steps
            while remaining > 0.0:
                new = step(order, c, phase, z, remaining)
                taken = remaining
                ended = margin(c, phase, new) < 0.0
                if ended and events < MOST_EVENTS:
                    taken, new = end_of_phase(order, c, phase, z, remaining, new)
                    events += 1
                z = new
                remaining -= taken
                if ended:
                    phase, z = after_event(c, phase, z)
        out[i, 0], out[i, 1] = outgoing(c, z)
    return out


def adaptive(
    setups: Annotated[FloatArray, "impacts numbers"],
    method: Method,
    rtol: float,
    most: float = math.inf,
) -> Annotated[FloatArray, "impacts 2"]:
    """`v_x2` [m/s] and `omega_2` [rad/s] of contacts by a `method` of `solve_ivp`. No step is
    longer than the share `most` of the contact: events are looked for at the ends of steps, and a
    grip that breaks and holds again within a step is stepped over.
    """
    return np.array([_integrated(c, method, rtol, most) for c in setups])


def _integrated(c: FloatArray, method: Method, rtol: float, most: float) -> tuple[float, float]:
    """`v_x2` [m/s] and `omega_2` [rad/s] of the contact with numbers `c`, by a `method` of
    `solve_ivp`.
    """
    z = first_state(c)
    phase = float(c[PHASE])
    time = 0.0

    def motion(_t: float, z: FloatArray) -> ContactState:
        return rates(c, phase, tuple(z))

    def ended(_t: float, z: FloatArray) -> float:
        return margin(c, phase, tuple(z))

    ended.terminal = True  # type: ignore[attr-defined]
    ended.direction = -1.0  # type: ignore[attr-defined]
    for _ in range(MOST_EVENTS):
        first = None if math.isinf(most) else FIRST_STEP * (c[END] - time)
        run = solve_ivp(
            motion,
            (time, c[END]),
            z,
            method,
            events=ended,
            rtol=rtol,
            atol=rtol * TYPICAL_STATE,
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
