"""The two-mass ball along the court: slide, grip, hold and slip again, in closed form, as kernels.

Shell (2) and core (1) are joined by a torsional spring and damper of torque `T = K th + C th'`. With `P` the impulse
of the normal force since a phase began, `s` the direction of slip, `J = I2 + M R^2` (Jafri 2004):

    slide         M v_x' = -s mu F;  I1 omega_1 + I2 omega_2 = const + (s mu R - eps) P     (Eqs 9, 11, 14, 15, 40)
    grip, hold    v_x = R omega_2;   I1 omega_1 + J omega_2 = const - eps P                 (Eqs 10, 14, 17, 42)

so that both spins are algebraic but for the twist between them (see `twist`); `eps` is zero in a hold, and in slip
where it acts while gripping only. Friction at zero slip is `M R (T - eps F)/J`, and must stay below `mu F`, which the
thesis does not ask. What ends a phase is the first zero of a function held in the basis of `oscillator`.
"""

from __future__ import annotations

import math

import numpy as np

from fitball.models.kernels.compiled import compiled, compiled_allocating, inlined
from fitball.models.kernels.events import ALLOWANCE, AT_START, DEPTH, HALVINGS, NO_ZERO, SIZE, basis_at, first_zero
from fitball.models.kernels.landing import landed
from fitball.models.kernels.oscillator import SERIES_LENGTH
from fitball.models.kernels.phases import (
    EVENT,
    FORCE_ENDED,
    FREE,
    GRIP,
    HOLD,
    RESUMED,
    TIE,
    UNDECIDED,
    UNFINISHED,
    append_phase,
    cone_margin,
    log_piece,
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
from fitball.models.kernels.twist import (
    compose,
    coupling_of,
    free_twist,
    load_of,
    twist_at,
    twist_motion,
    vertical_after,
)
from fitball.models.types import Status
from fitball.values import FloatArray

OK = int(Status.OK)
TOO_MANY_PHASES = int(Status.TOO_MANY_PHASES)
TOO_RAPID = int(Status.TOO_RAPID)
# A lightly damped torsional spring can break and renew the grip at each of its periods; each costs well
# under a microsecond, so the bound only stops a contact that will not settle.
MAX_PHASES = 4096

# Share of what is left of the contact below which a zero that follows another at the start may be the work of
# cancellation: it is looked for again in a series.
TOO_SOON = 1e-3
# At the end of the contact the normal force and with it both sides of the cone vanish: a zero this near to it is
# the end itself, to the rounding of the times.
AT_END = 1.0 - 1e-13
# Slip below this share of its two terms is none: their rounding.
NO_SLIP = 4.5e-16
# Pieces that were not solved: a zero doubtful enough to be looked for again, or none that could be found.
DOUBTFUL, LOST = -1, -2


@compiled_allocating
def make_scratch() -> Scratch:
    """Scratch for one thread."""
    return Scratch(
        np.zeros(max(SERIES_LENGTH, SIZE)), np.zeros(SERIES_LENGTH), np.zeros(SERIES_LENGTH), np.zeros((DEPTH + 1, 5))
    )


@compiled
def contrary(value: float, rate: float) -> float:
    """-1 where `value` is positive, +1 where negative; where it is zero its rate decides."""
    if value > 0.0:
        return -1.0
    if value < 0.0:
        return 1.0
    return -1.0 if rate > 0.0 else 1.0


@inlined
def land(contact: Contact[float]) -> tuple[State, Mode]:
    """State and mode just after the landing impulse."""
    v_x, omega_2, stuck = contact.v_x, contact.omega, False
    if contact.landing > 0.0:
        v_x, omega_2, stuck = landed(contact)
    slip = v_x - contact.radius * omega_2
    direction = 1.0 if slip > 0.0 else -1.0
    # At zero slip, to the rounding of its two terms, the friction cone decides.
    at_rest = contact.mu > 0.0 and (stuck or abs(slip) <= NO_SLIP * (abs(v_x) + contact.radius * abs(omega_2)))
    spin_sum = contact.joint.core * contact.omega + contact.joint.shell * omega_2
    state = State(0.0, 0.0, contact.v_y, 0.0, v_x, contact.omega, omega_2, spin_sum)
    return state, Mode(UNDECIDED if at_rest else slide_phase(direction), direction, 0, False)


@inlined
def decide(contact: Contact[float], coupling: Coupling[float], state: State, load: Load[float], broke: bool) -> Mode:
    """What a contact point without slip does next: grip if friction can, else hold if it can, else slip.

    After a grip that `broke` it does not grip at once.
    """
    joint, lever, force = contact.joint, coupling.lever, load.force
    rate = state.omega_1 - state.omega_2
    accel = -2.0 * coupling.grip.decay * rate - coupling.grip.natural_squared * state.angle
    # Friction that holds without the offset, and the full one with it, each with its rate.
    free = lever * (joint.stiffness * state.angle + joint.damping * rate)
    free_rate = lever * (joint.stiffness * rate + joint.damping * accel)
    full = free - lever * contact.eps * force
    full_rate = free_rate + lever * (
        joint.damping * contact.eps * force / coupling.gyration - contact.eps * load.force_rate
    )
    limit, limit_rate = contact.mu * force, contact.mu * load.force_rate
    if not broke and cone_margin(full, full_rate, limit, limit_rate) > 0.0:
        return Mode(GRIP, 0.0, 0, False)
    if not contact.eps_in_slide and cone_margin(free, free_rate, limit, limit_rate) > 0.0:
        return Mode(HOLD, 1.0 if full > 0.0 else -1.0, 0, broke)
    needed = full if contact.eps_in_slide else free
    direction = contrary(needed, full_rate if contact.eps_in_slide else free_rate)
    # Slip starts with the acceleration that friction cannot balance; at the very edge of the
    # cone that is zero and grows.
    order = 1 if abs(needed) - limit > TIE * (limit + abs(needed)) else 2
    return Mode(slide_phase(direction), direction, order, False)


@compiled
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
        if event >= AT_END * span:
            event = NO_ZERO
        elif event >= 0.0:
            basis = there
        if series.terms == 0 and mode.order > 0 and 0.0 <= event < TOO_SOON * span:
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
            at_edge = abs(limit - side * friction) <= TIE * (limit + abs(friction))
            order = 1 if at_edge or (gripping and mode.side * side > 0.0) else 0
        t, there = first_fall(margin, load, oscillators, series, order, end, basis, scratch)
        lost = lost or math.isnan(t)
        if 0.0 <= t < AT_END * span:
            event, event_side, end, basis, resumed = t, side, t, there, resuming
            doubtful = doubtful or (order > 0 and t < TOO_SOON * span)
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


@compiled
def two_mass_contact(
    contact: Contact[float], scratch: Scratch, phase_log: FloatArray | None
) -> tuple[int, float, float, int, int]:
    """Follow one contact; returns `(status, v_x2, omega_2, regime, pieces)`.

    The pieces of the contact are written into `phase_log` (MAX_PHASES, PIECE_SIZE), unless that is None, and counted.
    """
    joint = contact.joint
    gyration = joint.shell + contact.mass * contact.radius * contact.radius
    coupling = coupling_of(contact, gyration, 1.0 / joint.core + 1.0 / joint.shell, 1.0 / joint.core + 1.0 / gyration)
    state, mode = land(contact)
    careful, moved = False, False
    regime, count, pieces = 0, 0, 0
    scratch.stack[HALVINGS, 0] = ALLOWANCE

    for _ in range(MAX_PHASES):
        load = load_of(contact.vertical, state.y, state.y_rate)
        if mode.phase == UNDECIDED:
            mode = decide(contact, coupling, state, load, mode.broke)
        if mode.phase == GRIP or mode.phase == HOLD:
            state, mode, piece = grip(contact, coupling, state, mode, load, careful, scratch)
        else:
            state, mode, piece = slide(contact, coupling, state, mode, load, careful, scratch)
        if piece.ending == LOST:
            return TOO_RAPID, math.nan, math.nan, regime, 0
        careful = piece.ending == DOUBTFUL
        if careful:
            continue
        if phase_log is not None:
            log_piece(phase_log, pieces, piece)
            pieces += 1
        moved = moved or piece.time > 0.0
        if piece.ending != UNFINISHED:
            if moved:
                regime = append_phase(regime, count, piece.phase)
                count += 1
            moved = False
        if piece.ending == FORCE_ENDED:
            flight = contact.vertical.t_contact - contact.vertical.t_force
            if contact.vertical.t_contact > contact.vertical.t_force:
                regime = append_phase(regime, count, FREE)
            if not contact.shell_spin:
                return OK, state.v_x, state.spin_sum / coupling.inertia, regime, pieces
            _angle, rate = free_twist(coupling.slide, state.angle, state.omega_1 - state.omega_2, flight)
            return OK, state.v_x, (state.spin_sum - joint.core * rate) / coupling.inertia, regime, pieces
    return TOO_MANY_PHASES, math.nan, math.nan, regime, 0
