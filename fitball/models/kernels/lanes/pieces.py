"""One piece of eight contacts, each slide or grip as its own mode is: the equations are those of `pieces`.

All lanes look for the first zero of one contact function with the torsional oscillator of their own phase; gripping
lanes then look at the other side of the friction cone too. Lanes near resonance do the same in a Taylor series.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from fitball.models.kernels.compiled import inlined
from fitball.models.kernels.dual import choose
from fitball.models.kernels.events import BOUND, FAST_BOUND, swing_derivatives
from fitball.models.kernels.lanes.series import compose_lanes, series_lanes, terms_of
from fitball.models.kernels.lanes.start import ROUNDING
from fitball.models.kernels.lanes.swings import basis_lanes, chosen_basis, get_basis
from fitball.models.kernels.lanes.vector import Lanes, Mask, any_of
from fitball.models.kernels.lanes.zeros import Held, LaneScratch, first_zeros, halve
from fitball.models.kernels.oscillator import NEAR_RESONANCE, SERIES_REACH, forced_response, resultant, series_value
from fitball.models.kernels.pieces import DOUBTFUL_SHARE, FORCE_END_SHARE
from fitball.models.kernels.quantities import Contact, Coupling, Load, Oscillator, Oscillators, State, Weights
from fitball.models.kernels.twist import compose_basis, swung, twist_in_basis


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
    state: State,
    terms: int,
    among: Mask,
    scratch: LaneScratch,
) -> Reached:
    """Follow the lanes `among` to an event or the end of their span, in the basis or in a series of some `terms`."""
    mode, load, oscillators, span = task.mode, task.load, task.oscillators, task.span
    twist, function, spring = scratch.twist, scratch.function, contact.vertical.spring
    rate = state.omega_1 - state.omega_2
    if terms > 0:
        series_lanes(task.kappa, load, oscillators, state.angle, rate, span, task.reach, terms, scratch)
    else:
        force_s = load.force_rate + spring.decay * load.force
        forced_response(oscillators, task.kappa, load.force, force_s, state.angle, rate, twist)
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
    state: State,
    mode: LaneMode,
    load: Load[Lanes],
    active: Mask,
    scratch: LaneScratch,
) -> tuple[State, LaneMode, Mask, Mask]:
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
    rate = state.omega_1 - state.omega_2
    friction = coupling.lever * (joint.stiffness * state.angle + joint.damping * rate - eps * load.force)
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
    reached = Reached(none, none, span, mode.side, state.angle, rate, state.y, state.y_rate)
    for terms in (0, terms_of(reach, close)):
        among = distant if terms == 0 else close
        if any_of(among):
            found = follow(contact, coupling, task, state, terms, among, scratch)
            reached = merged(among, found, reached)
    lost = lost | reached.lost
    # What either phase makes of the impulse.
    event, impulse, rate = reached.event, load.momentum - contact.vertical.riding_mass * reached.y_rate, reached.rate
    total = joint.core * state.omega_1 + coupling.gyration * state.omega_2 - eps * impulse
    stuck = (total - joint.core * rate) / (joint.core + coupling.gyration)
    v_x = state.v_x - mode.side * contact.mu / contact.mass * impulse
    spin_sum = state.spin_sum + spinning_up * impulse
    stopped = event & ~grips
    rolling = v_x / radius
    omega_2 = choose(stopped, rolling, (spin_sum - joint.core * rate) / coupling.inertia)
    omega_1 = choose(stopped, (spin_sum - joint.shell * rolling) / joint.core, omega_2 + rate)
    omega_2, omega_1 = choose(grips, stuck, omega_2), choose(grips, stuck + rate, omega_1)
    v_x = choose(grips, radius * stuck, v_x)
    spin_sum = choose(grips, joint.core * omega_1 + joint.shell * stuck, spin_sum)
    moved = State(
        state.time + reached.elapsed, reached.y, reached.y_rate, reached.angle, v_x, omega_1, omega_2, spin_sum
    )
    broken = event & grips
    if contact.eps_in_slide:
        after = LaneMode(stopped, none, none, none, broken, choose(broken, -reached.side, mode.side))
    else:
        after = LaneMode(event, none, broken, none, none, mode.side)
    return moved, after, active & ~event & ~lost, lost
