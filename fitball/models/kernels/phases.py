"""One contact along the court through its phases: slide, grip, hold and slip again, as kernels.

A contact is solved in pieces: each lasts until the first zero of the function that ends it (`equations`), and then
the friction cone `|F_x| <= mu F` decides what follows. The cone is not in the thesis, whose ball rolls to the end of
the contact once it has begun to. The phases are given as a packed sequence, and the pieces in a log.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from fitball.models.kernels.compiled import inlined, inner
from fitball.models.kernels.contact import OK, Contact, impulsive_friction, landed, spring_integrals
from fitball.models.kernels.dual import Number, exp
from fitball.models.kernels.equations import (
    Coupling,
    Drive,
    Load,
    State,
    Weights,
    advance,
    compose,
    coupling_of,
    drive_of,
    free_twist,
    gaps_of,
    load_of,
    series_for,
    solve_twist,
    swung_to,
)
from fitball.models.kernels.oscillator import (
    AT_START,
    HALVINGS_LEFT,
    MAX_HALVINGS,
    Basis,
    Oscillators,
    Series,
    Stack,
    basis_at,
    first_zero,
)
from fitball.models.types import (
    FREE,
    GRIP,
    HOLD,
    MAX_PACKED_PHASES,
    PHASE_BITS,
    SLIDE_BACKWARD,
    SLIDE_FORWARD,
    Status,
)
from fitball.values import FloatArray

# In place of a phase: the friction cone decides which one follows.
UNDECIDED = 0

# Columns of the phase log, one row a piece; terms are 0, and the length idle, where there is no series.
PIECE_PHASE, PIECE_ENDING, PIECE_SIDE, PIECE_TIME, PIECE_TERMS, PIECE_LENGTH, PIECE_SIZE = range(7)
# Endings: the series reached its length (in a log also: nothing at all, where an event comes at once), the normal
# force ended, slip came to zero or friction to the edge of its cone, a hold gave way to grip.
UNFINISHED, FORCE_ENDED, EVENT, RESUMED = range(4)

# Relative distance to the edge of the friction cone that rounding of the forces alone can make.
CONE_ROUNDING = 1e-13


@inner
def append_phase(regime: int, count: int, phase: int) -> int:
    """Append a phase to a packed sequence that already holds `count` phases."""
    if count >= MAX_PACKED_PHASES:
        return regime
    return regime | (phase << (PHASE_BITS * count))


@inner
def slide_phase(direction: float) -> int:
    """The phase of slip in `direction`."""
    return SLIDE_FORWARD if direction > 0.0 else SLIDE_BACKWARD


@inner
def cone_margin(friction: float, friction_slope: float, limit: float, limit_slope: float) -> float:
    """Positive when `|friction| <= limit` now and just after, negative when not.

    At the edge itself, to rounding, the rates decide: that is where contact starts (both vanish), and where
    a phase hands over to the next.
    """
    margin = limit - abs(friction)
    noise = CONE_ROUNDING * (limit + abs(friction))
    if margin > noise or margin < -noise:
        return margin
    if friction > noise:
        return limit_slope - friction_slope
    if friction < -noise:
        return limit_slope + friction_slope
    return limit_slope - abs(friction_slope)


@inner
def log_piece(phase_log: FloatArray, place: int, piece: Piece) -> None:
    """Write a piece into its row of the log."""
    at_once = piece.ending != FORCE_ENDED and not piece.time > 0.0
    phase_log[place, PIECE_PHASE], phase_log[place, PIECE_SIDE] = piece.phase, piece.side
    phase_log[place, PIECE_ENDING] = UNFINISHED if at_once else piece.ending
    phase_log[place, PIECE_TIME] = piece.time
    phase_log[place, PIECE_TERMS], phase_log[place, PIECE_LENGTH] = piece.series.terms, piece.series.length


@inlined
def logged_piece(phase_log: FloatArray, place: int) -> Piece:
    """Read a piece from its row of the log."""
    row = phase_log[place]
    series = Series(int(row[PIECE_TERMS]), row[PIECE_LENGTH])
    return Piece(int(row[PIECE_PHASE]), int(row[PIECE_ENDING]), row[PIECE_SIDE], row[PIECE_TIME], series)


class Mode(NamedTuple):
    """What the contact point does next: a phase, or UNDECIDED.

    `side`: direction of slip; of a hold, and of the grip it gives way to, the side of the cone on which the grip with
    offset lies outside. `order`: zeros of the slip known to be at the start. `broke`: a grip has just ended.
    """

    phase: int
    side: float
    order: int
    broke: bool


class Piece(NamedTuple):
    """A contact is solved in pieces: phases, or near resonance parts of them. Phase, what ended it and to which side,
    how long it lasted [s], and how it was held.
    """

    phase: int
    ending: int
    side: float
    time: float
    series: Series


class Scratch(NamedTuple):
    """Scratch of one thread: contact function, twist and force as coefficients, the stack of `first_zero`."""

    function: FloatArray
    twist: FloatArray
    drive: FloatArray
    stack: Stack


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
def search(
    contact: Contact[float],
    coupling: Coupling[float],
    drive: Drive[float],
    state: State[float],
    mode: Mode,
    load: Load[float],
    careful: bool,
    scratch: Scratch,
) -> tuple[Piece, Basis[float]]:
    """How long a phase goes on from `state`, and the basis at its end; leaves its twist in the scratch.

    Slip lasts until it comes to zero; a grip or a hold until friction leaves its cone, or a hold can grip; each at
    most until the normal force ends.
    """
    joint, lever, force = contact.joint, coupling.lever, load.force
    span = contact.vertical.t_force - state.time
    oscillators = Oscillators(drive.torsion, contact.vertical.spring)
    series = series_for(oscillators, span, careful)
    solve_twist(drive, oscillators, state, load, series, scratch.twist, scratch.drive)
    end, elapsed = series.length, series.length
    basis = AT_START if series.terms > 0 else basis_at(oscillators, end)
    ending, event_side = FORCE_ENDED if end >= span else UNFINISHED, mode.side if not drive.resting else 0.0
    friction = lever * (joint.stiffness * state.angle + joint.damping * state.rate - drive.eps * force)
    near = 1.0 if friction >= 0.0 else -1.0
    attempts = 2 if mode.phase == GRIP else 3
    if not drive.resting:
        attempts = 1 if contact.mu > 0.0 else 0
    lost, doubtful = False, False
    for attempt in range(attempts):
        # Either side of the cone, the nearer first; then, of a hold, where the grip with offset comes back inside.
        resuming = attempt == 2
        side = mode.side if resuming or not drive.resting else -near if attempt == 1 else near
        if not drive.resting:
            order = mode.order
            weights = Weights(
                side * (state.v_x - contact.radius * state.spin_sum / coupling.inertia),
                0.0,
                side * contact.radius * joint.core / coupling.inertia,
                0.0,
                -side * (drive.braking + contact.radius * drive.spinning_up / coupling.inertia),
            )
        else:
            inside = -1.0 if resuming else 1.0
            eps = contact.eps if resuming else drive.eps
            weights = Weights(
                0.0,
                -inside * side * lever * joint.stiffness,
                -inside * side * lever * joint.damping,
                inside * (contact.mu + side * lever * eps),
                0.0,
            )
            limit = contact.mu * force
            at_edge = abs(limit - side * friction) <= CONE_ROUNDING * (limit + abs(friction))
            order = 1 if at_edge or (mode.phase == GRIP and mode.side * side > 0.0) else 0
            if resuming:
                order = 1 if mode.broke else 0
        t, there = first_fall(weights, load, oscillators, series, order, end, basis, scratch)
        lost = lost or math.isnan(t)
        if 0.0 <= t < FORCE_END_SHARE * span:
            ending, event_side, elapsed, end, basis = RESUMED if resuming else EVENT, side, t, t, there
            doubtful = doubtful or (order > 0 and t < DOUBTFUL_SHARE * span)
    if lost:
        ending = LOST
    elif doubtful and series.terms == 0:
        ending = DOUBTFUL
    return Piece(mode.phase, ending, event_side, elapsed, series), basis


@inlined
def following(contact: Contact[float], mode: Mode, piece: Piece) -> Mode:
    """What the contact point does after a piece."""
    gripping = mode.phase == GRIP
    if piece.ending == UNFINISHED or piece.ending == FORCE_ENDED:
        return Mode(mode.phase, 0.0 if gripping else mode.side, 0, False)
    if piece.ending == RESUMED:
        return Mode(GRIP, mode.side, 0, False)
    if not gripping and mode.phase != HOLD:
        return Mode(UNDECIDED, mode.side, 0, False)
    if gripping and not contact.eps_in_slide:
        return Mode(UNDECIDED, 0.0, 0, True)
    return Mode(slide_phase(-piece.side), -piece.side, 2, False)


TOO_MANY_PHASES = int(Status.TOO_MANY_PHASES)
TOO_RAPID = int(Status.TOO_RAPID)
# A lightly damped torsional spring can break and renew the grip at each of its periods; each costs well
# under a microsecond, so the bound only stops a contact that will not settle.
MAX_PHASES = 4096

# An impulse that stops no slip that a float can hold [N s].
FIRST_IMPULSE = 1e-300
# Slip below this share of its two terms is none: their rounding.
SLIP_ROUNDING = 4.5e-16


@inner
def contrary(value: float, rate: float) -> float:
    """-1 where `value` is positive, +1 where negative; where it is zero its rate decides."""
    if value > 0.0:
        return -1.0
    if value < 0.0:
        return 1.0
    return -1.0 if rate > 0.0 else 1.0


@inlined
def land(contact: Contact[float]) -> tuple[State[float], Mode]:
    """State and mode just after the landing impulse."""
    v_x, omega_2, stuck = contact.v_x, contact.omega, False
    if contact.landing > 0.0:
        v_x, omega_2, stuck = landed(contact)
    slip = v_x - contact.radius * omega_2
    direction = 1.0 if slip > 0.0 else -1.0
    # At zero slip, to the rounding of its two terms, the friction cone decides.
    at_rest = contact.mu > 0.0 and (stuck or abs(slip) <= SLIP_ROUNDING * (abs(v_x) + contact.radius * abs(omega_2)))
    spin_sum = contact.joint.core * contact.omega + contact.joint.shell * omega_2
    state = State(0.0, 0.0, contact.v_y, 0.0, contact.omega - omega_2, v_x, spin_sum, 0.0, 0.0)
    return state, Mode(UNDECIDED if at_rest else slide_phase(direction), direction, 0, False)


@inlined
def decide(
    contact: Contact[float], coupling: Coupling[float], state: State[float], load: Load[float], broke: bool
) -> Mode:
    """What a contact point without slip does next: grip if friction can, else hold if it can, else slip.

    After a grip that `broke` it does not grip at once.
    """
    joint, lever, force = contact.joint, coupling.lever, load.force
    rate = state.rate
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
    # Without an offset to speak of a hold is the grip that has just broken.
    other = not broke or abs(full - free) > CONE_ROUNDING * (limit + abs(full))
    if not contact.eps_in_slide and other and cone_margin(free, free_rate, limit, limit_rate) > 0.0:
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
) -> tuple[int, float, float, float, float, int, int]:
    """Follow one contact; returns `(status, v_x2, omega_2, gap_path, gap_turn, regime, pieces)`.

    The pieces of the contact are written into `phase_log` (MAX_PHASES, PIECE_SIZE), unless that is None, and counted.
    """
    joint = contact.joint
    gyration = joint.shell + contact.mass * contact.radius * contact.radius
    coupling = coupling_of(contact, gyration, 1.0 / joint.core + 1.0 / joint.shell, 1.0 / joint.core + 1.0 / gyration)
    state, mode = land(contact)
    careful, lasted = False, False
    regime, count, pieces = 0, 0, 0
    scratch.stack[HALVINGS_LEFT, 0] = MAX_HALVINGS

    for _ in range(MAX_PHASES):
        load = load_of(contact.vertical, state.y, state.y_rate)
        if mode.phase == UNDECIDED:
            mode = decide(contact, coupling, state, load, mode.broke)
        drive = drive_of(contact, coupling, mode.phase)
        piece, basis = search(contact, coupling, drive, state, mode, load, careful, scratch)
        if piece.ending == LOST:
            return TOO_RAPID, math.nan, math.nan, math.nan, math.nan, regime, 0
        careful = piece.ending == DOUBTFUL
        if careful:
            continue
        oscillators = Oscillators(drive.torsion, contact.vertical.spring)
        twisting = contact.shell_spin or piece.ending != FORCE_ENDED or drive.resting
        moved = swung_to(oscillators, piece.series, scratch.twist, state, piece.time, basis, twisting)
        state = advance(contact, coupling, drive, state, load, moved)
        if piece.ending == EVENT and not drive.resting:
            # What the search leaves of the slip is rounding.
            omega_2 = state.v_x / contact.radius
            rate = (state.spin_sum - joint.shell * omega_2) / joint.core - omega_2
            state = State(
                state.time,
                state.y,
                state.y_rate,
                state.angle,
                rate,
                state.v_x,
                state.spin_sum,
                state.path,
                state.turn,
            )
        mode = following(contact, mode, piece)
        if phase_log is not None:
            log_piece(phase_log, pieces, piece)
            pieces += 1
        lasted = lasted or piece.time > 0.0
        if piece.ending != UNFINISHED:
            if lasted:
                regime = append_phase(regime, count, piece.phase)
                count += 1
            lasted = False
        if piece.ending == FORCE_ENDED:
            flight = contact.vertical.t_contact - contact.vertical.t_force
            if contact.vertical.t_contact > contact.vertical.t_force:
                regime = append_phase(regime, count, FREE)
            omega_2 = state.spin_sum / coupling.inertia
            if contact.shell_spin:
                _angle, rate = free_twist(coupling.slide, state.angle, state.rate, flight)
                omega_2 = (state.spin_sum - joint.core * rate) / coupling.inertia
            path, turn = gaps_of(contact, coupling, state, omega_2)
            return OK, state.v_x, omega_2, path, turn, regime, pieces
    return TOO_MANY_PHASES, math.nan, math.nan, math.nan, math.nan, regime, 0


@inner
def rigid_phase(contact: Contact[Number], impulse: Number) -> tuple[int, Number, Number]:
    """`(phase, friction, acting)` once the normal impulse has grown to `impulse`, core and shell turning as one.

    `friction` [N s] retards the ball; `acting` is the share of the impulse during which the offset acted.
    """
    slip = contact.v_x - contact.radius * contact.omega
    direction = 1.0 if slip.real > 0.0 else -1.0
    if not contact.mu.real > 0.0:
        friction = direction * contact.mu * impulse
        return slide_phase(direction), friction, impulse if contact.eps_in_slide else 0.0 * impulse
    # Where nothing has happened yet, what is about to shows with the first impulse.
    grown = impulse if impulse.real > 0.0 else impulse + FIRST_IMPULSE
    friction, slipped, held, onward = impulsive_friction(contact, grown)
    phase = HOLD if held.real > 0.0 else GRIP
    if abs(onward) > 0.5:
        phase = slide_phase(onward)
    elif slipped.real >= grown.real and abs(slip.real) > 0.0:
        phase = slide_phase(direction)
    return phase, friction, grown if contact.eps_in_slide else grown - slipped - held


@inner
def rigid_contact(contact: Contact[Number]) -> tuple[Number, Number, Number, Number, int]:
    """Return `(v_x2, omega_2, gap_path, gap_turn, regime)`; the shell of `contact` is the whole ball.

    Slip that ends within the landing impulse takes no time and is no phase of the contact.
    """
    vertical, inertia = contact.vertical, contact.joint.shell
    # What the core's momentum loses by the time the compressive force ends.
    impulse = vertical.riding_mass * contact.v_y * (1.0 + exp(-vertical.spring.decay * vertical.t_force))
    first, _friction, _acting = rigid_phase(contact, contact.landing)
    last, friction, acting = rigid_phase(contact, contact.landing + impulse)
    regime, count = first, 1
    if last != first:
        regime, count = append_phase(first, 1, last), 2
    if vertical.t_contact.real > vertical.t_force.real:
        regime = append_phase(regime, count, FREE)
    v_x2 = contact.v_x - friction / contact.mass
    omega_2 = contact.omega + (contact.radius * friction - contact.eps * acting) / inertia
    braked, pushed = rigid_integrals(contact, contact.landing + impulse)
    after = vertical.t_flight - vertical.t_force
    path = contact.v_x * vertical.t_force - braked / contact.mass + v_x2 * after
    turn = contact.omega * vertical.t_force + (contact.radius * braked - contact.eps * pushed) / inertia
    return v_x2, omega_2, path, turn + omega_2 * after, regime


# Halvings of the contact in which the end of slip is looked for: what is integrated has no jump there, so that half
# of the digits do.
STOP_HALVINGS = 30


@inlined
def rigid_integrals(contact: Contact[Number], whole: Number) -> tuple[Number, Number]:
    """Time integrals [N s^2], until the force ends, of the `friction` and the `acting` share of `rigid_phase`.

    Both are two straight lines over the impulse, which meet where the slip has used up its share of the `whole`.
    """
    vertical, inertia, radius = contact.vertical, contact.joint.shell, contact.radius
    nothing, t_force = 0.0 * whole, vertical.t_force
    slip = contact.v_x - radius * contact.omega
    direction = 1.0 if slip.real > 0.0 else -1.0
    compliance = 1.0 / contact.mass + radius * radius / inertia
    need = radius * contact.eps / (inertia * compliance)
    rate = compliance * (contact.mu - direction * (need if contact.eps_in_slide else nothing))
    lead = 1.0 if contact.eps_in_slide else 0.0
    _impulse, passed = spring_integrals(vertical, contact.v_y, t_force)
    total = contact.landing * t_force + passed
    if not (contact.mu.real > 0.0 and rate.real * whole.real > abs(slip.real)):
        return direction * contact.mu * total, lead * total
    # Slip that is zero stops at once, and what it carries with it.
    moving = abs(slip.real) > 0.0
    stop = direction * slip / rate if moving else nothing
    at_stop = direction * contact.mu * stop if moving else slip / compliance
    left, right = 0.0, t_force.real
    for _ in range(STOP_HALVINGS):
        middle = 0.5 * (left + right)
        impulse, _passed = spring_integrals(vertical, contact.v_y, middle + nothing)
        if contact.landing.real + impulse.real < stop.real:
            left = middle
        else:
            right = middle
    t_stop = nothing + (right if stop.real > contact.landing.real else 0.0)
    _impulse, passed = spring_integrals(vertical, contact.v_y, t_stop)
    early = contact.landing * t_stop + passed
    late = total - early - stop * (t_force - t_stop)
    _friction, _slipped, held, onward = impulsive_friction(contact, whole)
    steepness, share = need, 1.0
    if abs(onward) > 0.5:
        steepness, share = onward * contact.mu, lead
    elif held.real > 0.0:
        steepness, share = nothing, lead
    braked = direction * contact.mu * early + at_stop * (t_force - t_stop) + steepness * late
    return braked, lead * (early + stop * (t_force - t_stop)) + share * late
