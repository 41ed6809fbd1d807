"""Compiled rivals: Runge-Kutta methods of fixed step, careless or careful about where a phase ends."""

from __future__ import annotations

import numpy as np
from scipy.integrate import DOP853

from fitball.models.kernels.compiled import compiled, inlined
from fitball.studies.bench.contact_equations import (
    END,
    PHASE,
    State,
    after_event,
    first_state,
    margin,
    next_phase,
    outgoing,
    rates,
)
from fitball.values import FloatArray

# Ends of phases in one impact that a rival follows, trials of a search for one, and how near it comes to it, as a
# share of the contact.
MOST_EVENTS, MOST_TRIALS, NEAR = 64, 60, 1e-15


def _entries(row: FloatArray) -> tuple[float, ...]:
    return tuple(float(entry) for entry in row if entry != 0.0)


# Dormand and Prince, order 8 in twelve stages (Hairer, Norsett and Wanner 1993), as scipy has it: what is not zero.
A2, A3, A4, A5, A6, A7, A8, A9, A10, A11, A12 = (_entries(row) for row in DOP853.A[1:12, :12])
B = _entries(DOP853.B[:12])
RK4_B = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)


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
