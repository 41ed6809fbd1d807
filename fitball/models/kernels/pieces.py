"""One piece of a contact: slide, or grip or hold, up to the first zero of the function that ends it, as kernels.

The motion is that of `two_mass`. What ends a piece, with `L = I1 omega_1 + I2 omega_2` and `v_x` at its start and `P`
the impulse of the normal force since:

    slide         the slip,  s (v_x - R L/I) + s R I1/I th' - (mu/M + s R (s mu R - eps)/I) P
    grip, hold    the margin of the friction cone,  mu F -+ M R/J (T - eps F)
    hold          besides, the same with eps, on the side where it is outside: there it gives way to grip
"""

from __future__ import annotations

import math

from fitball.models.kernels.compiled import inlined, inner
from fitball.models.kernels.events import AT_START, NO_ZERO, basis_at, first_zero
from fitball.models.kernels.phases import (
    CONE_ROUNDING,
    EVENT,
    FORCE_ENDED,
    GRIP,
    RESUMED,
    UNDECIDED,
    UNFINISHED,
    slide_phase,
)
from fitball.models.kernels.quantities import (
    Basis,
    Contact,
    Coupling,
    Load,
    Mode,
    Oscillators,
    Piece,
    Scratch,
    Series,
    State,
    Weights,
)
from fitball.models.kernels.twist import compose, twist_at, twist_motion, vertical_after

# Share of what is left of the contact below which a zero that follows another at the start may be the work of
# cancellation: it is looked for again in a series.
DOUBTFUL_SHARE = 1e-3
# At the end of the contact the normal force and with it both sides of the cone vanish: a zero this near to it is
# the end itself, to the rounding of the times.
FORCE_END_SHARE = 1.0 - 1e-13
# Pieces that were not solved: a zero doubtful enough to be looked for again, or none that could be found.
DOUBTFUL, LOST = -1, -2


@inner
def first_fall(
    weights: Weights,
    load: Load[float],
    oscillators: Oscillators[float],
    series: Series,
    order: int,
    end: float,
    end_basis: Basis[float],
    scratch: Scratch,
) -> tuple[float, Basis[float]]:
    """When a contact function of this piece first falls to zero, and the basis there; see `first_zero`."""
    function = scratch.function
    bound = compose(weights, load, oscillators, series, scratch.twist, scratch.drive, function)
    if order > 0:
        # The rounding of its constant would otherwise outweigh the zero at its start for a while.
        function[0] = 0.0 if series.terms > 0 else -(function[1] + function[3])
    return first_zero(function, oscillators, series, bound, order, end, end_basis, scratch.stack)


@inlined
def slide(
    contact: Contact[float],
    coupling: Coupling[float],
    state: State,
    mode: Mode,
    load: Load[float],
    careful: bool,
    scratch: Scratch,
) -> tuple[State, Mode, Piece]:
    """Slip until it comes to zero or the normal force ends: state and mode after it, and what it was."""
    joint, radius, direction = contact.joint, contact.radius, mode.side
    vertical = contact.vertical
    span = vertical.t_force - state.time
    oscillators = Oscillators(coupling.slide, vertical.spring)
    spinning_up = direction * contact.mu * radius - coupling.eps_slide
    series = twist_motion(
        state.angle, state.omega_1 - state.omega_2, -spinning_up / joint.shell, load, oscillators, span, careful,
        scratch.twist, scratch.drive,
    )  # fmt: skip
    basis = AT_START if series.terms > 0 else basis_at(oscillators, series.length)
    event = NO_ZERO
    if contact.mu > 0.0:
        slip = Weights(
            direction * (state.v_x - radius * state.spin_sum / coupling.inertia),
            0.0,
            direction * radius * joint.core / coupling.inertia,
            0.0,
            -contact.mu / contact.mass - direction * radius * spinning_up / coupling.inertia,
        )
        event, there = first_fall(slip, load, oscillators, series, mode.order, series.length, basis, scratch)
        if math.isnan(event):
            return state, mode, Piece(mode.phase, LOST, direction, 0.0, series)
        if event >= FORCE_END_SHARE * span:
            event = NO_ZERO
        elif event >= 0.0:
            basis = there
        if series.terms == 0 and mode.order > 0 and 0.0 <= event < DOUBTFUL_SHARE * span:
            return state, mode, Piece(mode.phase, DOUBTFUL, direction, 0.0, series)
    elapsed = series.length if event < 0.0 else event
    ending = FORCE_ENDED if series.length >= span else UNFINISHED
    if event >= 0.0:
        ending = EVENT
    y, y_rate = vertical_after(vertical.spring, series.terms, state.y, state.y_rate, elapsed, basis)
    impulse = load.momentum - vertical.riding_mass * y_rate
    v_x = state.v_x - direction * contact.mu / contact.mass * impulse
    spin_sum = state.spin_sum + spinning_up * impulse
    angle, omega_1, omega_2 = state.angle, state.omega_1, state.omega_2
    if contact.shell_spin or ending != FORCE_ENDED:
        angle, rate = twist_at(scratch.twist, oscillators, series, elapsed, basis)
        omega_2 = (spin_sum - joint.core * rate) / coupling.inertia
        omega_1 = omega_2 + rate
    after = Mode(mode.phase, direction, 0, False)
    if ending == EVENT:
        after = Mode(UNDECIDED, direction, 0, False)
        omega_2 = v_x / radius
        omega_1 = (spin_sum - joint.shell * omega_2) / joint.core
    moved = State(state.time + elapsed, y, y_rate, angle, v_x, omega_1, omega_2, spin_sum)
    return moved, after, Piece(mode.phase, ending, direction, elapsed, series)


@inlined
def grip(
    contact: Contact[float],
    coupling: Coupling[float],
    state: State,
    mode: Mode,
    load: Load[float],
    careful: bool,
    scratch: Scratch,
) -> tuple[State, Mode, Piece]:
    """Grip, or hold, until friction leaves its cone, a hold can grip, or the normal force ends; as `slide`."""
    joint, vertical, lever, force = contact.joint, contact.vertical, coupling.lever, load.force
    span = vertical.t_force - state.time
    oscillators = Oscillators(coupling.grip, vertical.spring)
    gripping = mode.phase == GRIP
    offset = contact.eps if gripping else 0.0
    rate = state.omega_1 - state.omega_2
    series = twist_motion(
        state.angle, rate, offset / coupling.gyration, load, oscillators, span, careful, scratch.twist, scratch.drive
    )
    basis = AT_START if series.terms > 0 else basis_at(oscillators, series.length)
    friction = lever * (joint.stiffness * state.angle + joint.damping * rate - offset * force)
    near = 1.0 if friction >= 0.0 else -1.0
    event, event_side, end = NO_ZERO, 0.0, series.length
    resumed, lost, doubtful = False, False, False
    for attempt in range(2 if gripping else 3):
        # Either side of the cone, the nearer first; then, of a hold, where the grip with offset comes back inside.
        resuming = attempt == 2
        side = mode.side if resuming else -near if attempt == 1 else near
        sign = -1.0 if resuming else 1.0
        acting = contact.eps if resuming else offset
        margin = Weights(
            0.0,
            -sign * side * lever * joint.stiffness,
            -sign * side * lever * joint.damping,
            sign * (contact.mu + side * lever * acting),
            0.0,
        )
        if resuming:
            order = 1 if mode.broke else 0
        else:
            limit = contact.mu * force
            at_edge = abs(limit - side * friction) <= CONE_ROUNDING * (limit + abs(friction))
            order = 1 if at_edge or (gripping and mode.side * side > 0.0) else 0
        t, there = first_fall(margin, load, oscillators, series, order, end, basis, scratch)
        lost = lost or math.isnan(t)
        if 0.0 <= t < FORCE_END_SHARE * span:
            event, event_side, end, basis, resumed = t, side, t, there, resuming
            doubtful = doubtful or (order > 0 and t < DOUBTFUL_SHARE * span)
    if lost:
        return state, mode, Piece(mode.phase, LOST, 0.0, 0.0, series)
    if doubtful and series.terms == 0:
        return state, mode, Piece(mode.phase, DOUBTFUL, 0.0, 0.0, series)
    elapsed = series.length if event < 0.0 else event
    y, y_rate = vertical_after(vertical.spring, series.terms, state.y, state.y_rate, elapsed, basis)
    impulse = load.momentum - vertical.riding_mass * y_rate
    angle, rate = twist_at(scratch.twist, oscillators, series, elapsed, basis)
    total = joint.core * state.omega_1 + coupling.gyration * state.omega_2 - offset * impulse
    omega_2 = (total - joint.core * rate) / (joint.core + coupling.gyration)
    omega_1 = omega_2 + rate
    spin_sum = joint.core * omega_1 + joint.shell * omega_2
    moved = State(state.time + elapsed, y, y_rate, angle, contact.radius * omega_2, omega_1, omega_2, spin_sum)
    if event < 0.0:
        ending = FORCE_ENDED if series.length >= span else UNFINISHED
        after = Mode(mode.phase, 0.0 if gripping else mode.side, 0, False)
    elif resumed:
        ending, after = RESUMED, Mode(GRIP, mode.side, 0, False)
    elif gripping and not contact.eps_in_slide:
        ending, after = EVENT, Mode(UNDECIDED, 0.0, 0, True)
    else:
        ending, after = EVENT, Mode(slide_phase(-event_side), -event_side, 2, False)
    return moved, after, Piece(mode.phase, ending, event_side, elapsed, series)
