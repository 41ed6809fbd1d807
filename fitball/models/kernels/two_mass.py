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

from fitball.models.kernels.compiled import inlined, inner, inner_allocating
from fitball.models.kernels.events import HALVINGS_LEFT, MAX_DEPTH, MAX_HALVINGS, SIZE
from fitball.models.kernels.landing import landed
from fitball.models.kernels.oscillator import SERIES_LENGTH
from fitball.models.kernels.phases import (
    CONE_ROUNDING,
    FORCE_ENDED,
    FREE,
    GRIP,
    HOLD,
    UNDECIDED,
    UNFINISHED,
    append_phase,
    cone_margin,
    log_piece,
    slide_phase,
)
from fitball.models.kernels.pieces import DOUBTFUL, LOST, grip, slide
from fitball.models.kernels.quantities import Contact, Coupling, Load, Mode, Scratch, State
from fitball.models.kernels.twist import coupling_of, free_twist, load_of
from fitball.models.types import Status
from fitball.values import FloatArray

OK = int(Status.OK)
TOO_MANY_PHASES = int(Status.TOO_MANY_PHASES)
TOO_RAPID = int(Status.TOO_RAPID)
# A lightly damped torsional spring can break and renew the grip at each of its periods; each costs well
# under a microsecond, so the bound only stops a contact that will not settle.
MAX_PHASES = 4096

# Slip below this share of its two terms is none: their rounding.
SLIP_ROUNDING = 4.5e-16


@inner_allocating
def make_scratch() -> Scratch:
    """Scratch for one thread."""
    return Scratch(
        np.zeros(max(SERIES_LENGTH, SIZE)),
        np.zeros(SERIES_LENGTH),
        np.zeros(SERIES_LENGTH),
        np.zeros((MAX_DEPTH + 1, 5)),
    )


@inner
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
    at_rest = contact.mu > 0.0 and (stuck or abs(slip) <= SLIP_ROUNDING * (abs(v_x) + contact.radius * abs(omega_2)))
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
    order = 1 if abs(needed) - limit > CONE_ROUNDING * (limit + abs(needed)) else 2
    return Mode(slide_phase(direction), direction, order, False)


@inner
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
    scratch.stack[HALVINGS_LEFT, 0] = MAX_HALVINGS

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
