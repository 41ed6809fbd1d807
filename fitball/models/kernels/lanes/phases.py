"""Eight contacts along the court at once, each through its own phases, with the equations of `kernels.phases`.

All lanes look for the first zero of one contact function with the torsional oscillator of their own phase; gripping
lanes then look at the other side of the friction cone too. Lanes near resonance do the same in a Taylor series.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.compiled import inlined, inner
from fitball.models.kernels.contact import Contact
from fitball.models.kernels.dual import choose
from fitball.models.kernels.equations import (
    Coupling,
    Load,
    State,
    Weights,
    compose_basis,
    coupling_of,
    load_of,
    swung,
    swung_freely,
    twist_in_basis,
)
from fitball.models.kernels.lanes.number import (
    LARGEST_ANGLE,
    LARGEST_EXPONENT,
    LaneArray,
    Lanes,
    Mask,
    any_of,
    lane_array,
)
from fitball.models.kernels.lanes.search import (
    BASIS,
    MAX_DEPTH,
    NODE,
    Held,
    LaneScratch,
    basis_lanes,
    chosen_basis,
    compose_lanes,
    first_zeros,
    get_basis,
    halve,
    series_lanes,
    swing_of_any,
    terms_of,
)
from fitball.models.kernels.lanes.start import ROUNDING, contact_lanes, landed_lanes
from fitball.models.kernels.oscillator import (
    BOUND,
    FAST_BOUND,
    NEAR_RESONANCE,
    SERIES_LENGTH,
    SERIES_REACH,
    SIZE,
    Oscillator,
    Oscillators,
    forced_response,
    resultant,
    series_value,
    swing_derivatives,
)
from fitball.models.kernels.phases import DOUBTFUL_SHARE, FORCE_END_SHARE
from fitball.models.types import FREE, GRIP, PHASE_BITS, SLIDE_BACKWARD, SLIDE_FORWARD
from fitball.values import FloatArray


class LaneMode(NamedTuple):
    """`Mode` of lanes: a lane that is `undecided` is for the friction cone to decide, one that is `gripping` grips,
    another slides towards `side`. `once`, `twice`: zeros of the slip at the start; `broke`: a grip has just ended.
    """

    undecided: Mask
    gripping: Mask
    broke: Mask
    once: Mask
    twice: Mask
    side: Lanes


class Task(NamedTuple):
    """What a piece starts with: contact functions of a slide and their order, of the sides of the cone, the nearer
    first, and the motion that they are functions of.
    """

    mode: LaneMode
    slip: Weights
    near_side: Lanes
    kappa: Lanes
    oscillators: Oscillators[Lanes]
    load: Load[Lanes]
    span: Lanes
    reach: Lanes


class Reached(NamedTuple):
    """Where lanes got to: an event or the end of the span; `side` is that of the cone at which a grip broke."""

    event: Mask
    lost: Mask
    elapsed: Lanes
    side: Lanes
    angle: Lanes
    rate: Lanes
    y: Lanes
    y_rate: Lanes


@inlined
def own_torsion(coupling: Coupling[Lanes], gripping: Mask) -> Oscillator[Lanes]:
    """The torsional oscillator of each lane's phase."""
    grip, slide = coupling.grip, coupling.slide
    return Oscillator(
        choose(gripping, grip.decay, slide.decay),
        choose(gripping, grip.damped_squared, slide.damped_squared),
        choose(gripping, grip.natural_squared, slide.natural_squared),
        choose(gripping, grip.frequency, slide.frequency),
    )


@inlined
def own_weights(contact: Contact[Lanes], coupling: Coupling[Lanes], task: Task, side: Lanes) -> Weights:
    """The contact function of each lane's phase; of a grip that of one side of the cone."""
    joint, slip, grips = contact.joint, task.slip, task.mode.gripping
    arm = side * coupling.lever
    return Weights(
        choose(grips, 0.0, slip.constant),
        choose(grips, -arm * joint.stiffness, 0.0),
        choose(grips, -arm * joint.damping, slip.rate),
        choose(grips, contact.mu + arm * contact.eps, 0.0),
        choose(grips, 0.0, slip.impulse),
    )


@inlined
def bounds_lanes(o: Oscillator[Lanes], c: Lanes, s: Lanes) -> tuple[Lanes, Lanes]:
    """`events.sixth_derivative_bounds` away from critical damping."""
    cube = o.natural_squared * o.natural_squared * o.natural_squared
    slow, fast = cube * math.sqrt(c * c + s * s / o.damped_squared), 0.0 * c
    overdamped = o.damped_squared < 0.0
    if any_of(overdamped):
        pole = o.decay + o.frequency
        other, lead = o.natural_squared / pole, s / o.frequency
        pole_cube, other_cube = pole * pole * pole, other * other * other
        slow = choose(overdamped, 0.5 * abs(c + lead) * (other_cube * other_cube), slow)
        fast = choose(overdamped, 0.5 * abs(c - lead) * (pole_cube * pole_cube), fast)
    return slow, fast


@inlined
def fastest_lanes(o: Oscillator[Lanes]) -> Lanes:
    """`twist.fastest`."""
    return choose(o.damped_squared < 0.0, o.decay + o.frequency, math.sqrt(o.natural_squared))


@inlined
def follow(
    contact: Contact[Lanes],
    coupling: Coupling[Lanes],
    task: Task,
    state: State[Lanes],
    terms: int,
    among: Mask,
    scratch: LaneScratch,
) -> Reached:
    """Follow the lanes `among` to an event or the end of their span, in the basis or in a series of some `terms`."""
    mode, load, oscillators, span = task.mode, task.load, task.oscillators, task.span
    twist, function, spring = scratch.twist, scratch.function, contact.vertical.spring
    if terms > 0:
        series_lanes(task.kappa, load, oscillators, state.angle, state.rate, span, task.reach, terms, scratch)
    else:
        force_s = load.force_rate + spring.decay * load.force
        forced_response(oscillators, task.kappa, load.force, force_s, state.angle, state.rate, twist)
        halve(oscillators, span, scratch)
    event, lost = among & ~among, among & ~among
    elapsed, side, per_span = span, task.near_side, 1.0 / span
    basis = get_basis(scratch.halves, 0)
    once, twice = mode.once & ~mode.gripping, mode.twice & ~mode.gripping
    ordered = once | twice
    for attempt in range(2):
        searched = among if attempt == 0 else among & mode.gripping & ~lost
        if not any_of(searched):
            break
        tried = task.near_side if attempt == 0 else -task.near_side
        weights = own_weights(contact, coupling, task, tried)
        bound = 0.0 * span
        if terms > 0:
            bound = compose_lanes(weights, ordered, span, per_span, task.reach, terms, scratch)
        else:
            compose_basis(weights, load, oscillators, twist, function)
            slow, fast = bounds_lanes(oscillators.torsion, function[1], function[2])
            function[BOUND], function[FAST_BOUND] = slow, fast
            slow, fast = bounds_lanes(spring, function[3], function[4])
            function[BOUND + 1], function[FAST_BOUND + 1] = slow, fast
            swing_derivatives(function, 0, oscillators.torsion)
            swing_derivatives(function, 1, oscillators.vertical)
            function[0] = choose(ordered, -(function[1] + function[3]), function[0])
        held = Held(terms, span, per_span, bound)
        found = first_zeros(function, oscillators, held, once, twice, searched, scratch)
        lost = lost | found.lost
        taken = found.hit & (found.time < FORCE_END_SHARE * span) & ~(event & (found.time >= elapsed))
        if terms == 0:
            lost = lost | (taken & ordered & (found.time < DOUBTFUL_SHARE * span))
        if any_of(taken):
            event, elapsed, side = event | taken, choose(taken, found.time, elapsed), choose(taken, tried, side)
            if terms == 0:
                basis = chosen_basis(taken, found.basis, basis)
    if terms > 0:
        angle, rate, _ = series_value(twist, terms, elapsed * per_span)
        rate = rate * per_span
        basis = basis_lanes(oscillators, elapsed)
    else:
        angle, rate = twist_in_basis(twist, oscillators, basis)
    y, y_rate = swung(spring, basis.vertical, state.y, state.y_rate)
    return Reached(event, lost, elapsed, side, angle, rate, y, y_rate)


@inlined
def merged(mask: Mask, first: Reached, second: Reached) -> Reached:
    """The first where the mask holds, else the second."""
    return Reached(
        (mask & first.event) | (~mask & second.event),
        first.lost | second.lost,
        choose(mask, first.elapsed, second.elapsed),
        choose(mask, first.side, second.side),
        choose(mask, first.angle, second.angle),
        choose(mask, first.rate, second.rate),
        choose(mask, first.y, second.y),
        choose(mask, first.y_rate, second.y_rate),
    )


@inlined
def piece_lanes(
    contact: Contact[Lanes],
    coupling: Coupling[Lanes],
    state: State[Lanes],
    mode: LaneMode,
    load: Load[Lanes],
    active: Mask,
    scratch: LaneScratch,
) -> tuple[State[Lanes], LaneMode, Mask, Mask]:
    """Follow one piece of the `active` lanes: state and mode after it, those finished, those lost; see `pieces`."""
    joint, radius, eps = contact.joint, contact.radius, contact.eps
    grips, span = mode.gripping, contact.vertical.t_force - state.time
    spinning_up = mode.side * contact.mu * radius - coupling.eps_slide
    slip = Weights(
        mode.side * (state.v_x - radius * state.spin_sum / coupling.inertia),
        0.0 * span,
        mode.side * radius * joint.core / coupling.inertia,
        0.0 * span,
        -contact.mu / contact.mass - mode.side * radius * spinning_up / coupling.inertia,
    )
    friction = coupling.lever * (joint.stiffness * state.angle + joint.damping * state.rate - eps * load.force)
    limit = contact.mu * load.force
    kappa = choose(grips, eps / coupling.gyration, -spinning_up / joint.shell)
    oscillators = Oscillators(own_torsion(coupling, grips), contact.vertical.spring)
    reach = max(fastest_lanes(oscillators.torsion), fastest_lanes(oscillators.vertical)) * span
    task = Task(mode, slip, choose(friction >= 0.0, 1.0, -1.0), kappa, oscillators, load, span, reach)
    # At the very edge of the cone a zero may be at the start itself.
    lost = active & grips & ~(abs(limit - abs(friction)) > ROUNDING * (limit + abs(friction)))
    span_squared = span * span
    far = resultant(oscillators) * span_squared * span_squared > NEAR_RESONANCE
    lost = lost | (active & ~far & ~(reach <= SERIES_REACH))
    # Near critical damping the bounds are others.
    turn = oscillators.torsion.damped_squared * span_squared
    lost = lost | (active & far & (turn <= 0.0) & (turn >= -1.0))
    distant, close = active & ~lost & far, active & ~lost & ~far
    none = active & ~active
    reached = Reached(none, none, span, mode.side, state.angle, state.rate, state.y, state.y_rate)
    for terms in (0, terms_of(reach, close)):
        among = distant if terms == 0 else close
        if any_of(among):
            found = follow(contact, coupling, task, state, terms, among, scratch)
            reached = merged(among, found, reached)
    lost = lost | reached.lost
    # What either phase makes of the impulse.
    event, impulse, rate = reached.event, load.momentum - contact.vertical.riding_mass * reached.y_rate, reached.rate
    drift = load.momentum * reached.elapsed - contact.vertical.riding_mass * (reached.y - state.y)
    total, twisted = state.spin_sum + contact.mass * radius * state.v_x, joint.core * (reached.angle - state.angle)
    omega_2 = (total - eps * impulse - joint.core * rate) / (joint.core + coupling.gyration)
    turned = (total * reached.elapsed - eps * drift - twisted) / (joint.core + coupling.gyration)
    v_x = choose(grips, radius * omega_2, state.v_x - mode.side * contact.mu / contact.mass * impulse)
    spin_sum = choose(grips, coupling.inertia * omega_2 + joint.core * rate, state.spin_sum + spinning_up * impulse)
    path = choose(grips, radius * turned, state.v_x * reached.elapsed - mode.side * contact.mu / contact.mass * drift)
    turn = choose(grips, coupling.inertia * turned + twisted, state.spin_sum * reached.elapsed + spinning_up * drift)
    moved = State(
        state.time + reached.elapsed, reached.y, reached.y_rate, reached.angle, rate, v_x, spin_sum,
        state.path + path, state.turn + turn,
    )  # fmt: skip
    stopped = event & ~grips
    broken = event & grips
    if contact.eps_in_slide:
        after = LaneMode(stopped, none, none, none, broken, choose(broken, -reached.side, mode.side))
    else:
        after = LaneMode(event, none, broken, none, none, mode.side)
    return moved, after, active & ~event & ~lost, lost


# Pieces after which a lane is left to the scalar kernel.
MAX_PIECES = 8
# Rows of what is written for eight impacts; `PLAIN` is 1 where it is their answer.
V_X2, V_Y2, OMEGA_2, CONTACT_TIME, GAP_TIME, GAP_PATH, GAP_TURN, REGIME, PLAIN, OUTPUTS = range(10)


# Rows of scratch that one thread needs, and where its parts begin.
FUNCTION = 0
TWIST = FUNCTION + max(SERIES_LENGTH, SIZE)
DRIVE = TWIST + SERIES_LENGTH
STACK = DRIVE + SERIES_LENGTH
HALVES = STACK + NODE * MAX_DEPTH
MARKS = HALVES + BASIS * (MAX_DEPTH + 1)
SCRATCH = MARKS + MAX_DEPTH + 1


@inner
def lane_scratch(room: FloatArray) -> LaneScratch:
    """The scratch in an array (SCRATCH, WIDTH)."""
    return LaneScratch(
        lane_array(room[FUNCTION:TWIST]),
        lane_array(room[TWIST:DRIVE]),
        lane_array(room[DRIVE:STACK]),
        lane_array(room[STACK:HALVES]),
        lane_array(room[HALVES:MARKS]),
        room[MARKS:],
    )


@inlined
def decide_lanes(
    contact: Contact[Lanes],
    coupling: Coupling[Lanes],
    state: State[Lanes],
    mode: LaneMode,
    load: Load[Lanes],
    active: Mask,
) -> tuple[LaneMode, Mask]:
    """`kernels.phases.decide` of the lanes without slip; and those that hold, or are at the edge of the cone."""
    joint, lever, force = contact.joint, coupling.lever, load.force
    free = lever * (joint.stiffness * state.angle + joint.damping * state.rate)
    full = free - lever * contact.eps * force
    limit = contact.mu * force
    margin, noise = limit - abs(full), ROUNDING * (limit + abs(full))
    deciding = active & mode.undecided & ~mode.broke
    lost = deciding & ~(abs(margin) > noise)
    grips = deciding & (margin > noise)
    deciding = (deciding & ~grips) | (active & mode.broke)
    needed = full
    if not contact.eps_in_slide:
        needed = free
        lost = lost | (deciding & ~(abs(free) - limit > ROUNDING * (limit + abs(free))))
    side = choose(deciding, choose(needed > 0.0, -1.0, 1.0), mode.side)
    none = active & ~active
    return LaneMode(
        none, (mode.gripping & ~deciding) | grips, none, (mode.once & ~grips) | deciding, mode.twice & ~deciding, side
    ), lost


@inner
def bounce_lanes(given: LaneArray, codes: NDArray[np.int64], out: LaneArray, room: FloatArray) -> None:
    """Solve eight impacts: `given` (INPUTS) to `out` (OUTPUTS), rows as named in `start` and here.

    Only lanes that are plain have an answer, and each has the one that it would have among any neighbours.
    """
    scratch = lane_scratch(room)
    plain, contact = contact_lanes(given, codes)
    joint, vertical, radius = contact.joint, contact.vertical, contact.radius
    gyration = joint.shell + contact.mass * radius * radius
    coupling = coupling_of(contact, gyration, 1.0 / joint.core + 1.0 / joint.shell, 1.0 / joint.core + 1.0 / gyration)
    time = vertical.t_contact
    for o in (coupling.slide, coupling.grip, vertical.spring):
        plain = plain & (abs(o.damped_squared) > 0.0)
        plain = plain & (o.frequency * time <= LARGEST_ANGLE) & ((o.decay + o.frequency) * time <= LARGEST_EXPONENT)
    none = plain & ~plain
    v_x, omega_2, stuck = contact.v_x, contact.omega, none
    if any_of(contact.landing > 0.0):
        v_x, omega_2, stuck, landed = landed_lanes(contact)
        plain = plain & landed
    slip = v_x - radius * omega_2
    plain = plain & (stuck | (abs(slip) > ROUNDING * (abs(v_x) + abs(radius * omega_2))))
    zero = 0.0 * v_x
    spin_sum = joint.core * contact.omega + joint.shell * omega_2
    state = State(zero, zero, contact.v_y, zero, contact.omega - omega_2, v_x, spin_sum, zero, zero)
    mode = LaneMode(stuck, none, none, none, none, choose(slip > 0.0, 1.0, -1.0))
    active = plain
    v_x2, spin, angle, rate, regime, place, done = zero, zero, zero, zero, zero, zero + 1.0, none
    path, turn = zero, zero
    for _ in range(MAX_PIECES):
        if not any_of(active):
            break
        load = load_of(vertical, state.y, state.y_rate)
        if any_of(active & mode.undecided):
            mode, lost = decide_lanes(contact, coupling, state, mode, load, active)
            active = active & ~lost
        phase = choose(mode.side > 0.0, SLIDE_FORWARD, SLIDE_BACKWARD)
        phase = choose(mode.gripping, GRIP, phase)
        state, mode, finished, lost = piece_lanes(contact, coupling, state, mode, load, active, scratch)
        regime = choose(active, regime + place * phase, regime)
        place = choose(active, place * (1 << PHASE_BITS), place)
        v_x2, spin = choose(finished, state.v_x, v_x2), choose(finished, state.spin_sum, spin)
        if contact.shell_spin:
            angle = choose(finished, state.angle, angle)
            rate = choose(finished, state.rate, rate)
        path, turn = choose(finished, state.path, path), choose(finished, state.turn, turn)
        done = done | finished
        active = active & ~finished & ~lost
    free = vertical.t_contact > vertical.t_force
    regime = choose(free, regime + place * FREE, regime)
    path = path + v_x2 * (vertical.t_flight - vertical.t_force)
    turn = (turn + spin * (vertical.t_contact - vertical.t_force)) / coupling.inertia
    if contact.shell_spin:
        swing = swing_of_any(coupling.slide, vertical.t_contact - vertical.t_force)
        _angle, rate = swung_freely(coupling.slide, swing, angle, rate)
        spin = spin - joint.core * rate
    omega_2 = spin / coupling.inertia
    out[V_X2], out[V_Y2], out[OMEGA_2] = v_x2, vertical.cor * contact.v_y, omega_2
    out[GAP_TIME], out[GAP_PATH] = vertical.t_flight, path
    out[GAP_TURN] = turn + omega_2 * (vertical.t_flight - vertical.t_contact)
    out[CONTACT_TIME], out[REGIME], out[PLAIN] = vertical.t_contact, regime, choose(done, 1.0, zero)
