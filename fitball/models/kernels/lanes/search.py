"""First zeros of the contact functions of all lanes, certified as in `oscillator`, and the functions themselves.

All lanes walk through one tree of halved intervals, each from its own start to its own end; an interval is halved as
long as some lane there is undecided. A lane looks only at intervals that it would look at alone, so that its result
does not depend on its neighbours. Near resonance each lane has its own number of Taylor terms and zeros behind them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from fitball.models.kernels.compiled import inlined, inner
from fitball.models.kernels.dual import choose
from fitball.models.kernels.equations import Load, Weights
from fitball.models.kernels.lanes.number import LaneArray, Lanes, Mask, any_of, exp, largest, sin_cos, spread_lanes
from fitball.models.kernels.oscillator import (
    SMALL_DECAY,
    SMALL_PHASE,
    Basis,
    Oscillator,
    Oscillators,
    Stack,
    Swing,
    bernstein,
    evaluate_basis,
    falls_once,
    guess,
    joined_swing,
    series_length,
    series_value,
    short_phase,
    short_swing,
    zero_free,
)

# Places that a basis takes in an array.
BASIS = 7


@inlined
def swing_lanes(o: Oscillator[Lanes], t: Lanes) -> Swing[Lanes]:
    """`swing_at` of lanes with `damped_squared > 0`, whose fast exponential is idle."""
    envelope = exp(-o.decay * t)
    sine, cosine = sin_cos(o.frequency * t)
    return Swing(envelope * cosine, envelope * sine / o.frequency, envelope, envelope)


@inlined
def swing_of_any(o: Oscillator[Lanes], t: Lanes) -> Swing[Lanes]:
    """`swing_at` of lanes of either sign of `damped_squared`, not zero."""
    swing = swing_lanes(o, t)
    overdamped = o.damped_squared < 0.0
    if any_of(overdamped):
        pole = o.decay + o.frequency
        slow, fast = exp(-o.natural_squared / pole * t), exp(-pole * t)
        pair = Swing(0.5 * (slow + fast), 0.5 * (slow - fast) / o.frequency, slow, fast)
        x = o.damped_squared * t * t
        cosine, sine = short_phase(x)
        near = Swing(swing.envelope * cosine, swing.envelope * t * sine, swing.envelope * 1.11, swing.envelope)
        swing = chosen_swing(overdamped, chosen_swing(x < -SMALL_PHASE, pair, near), swing)
    return swing


@inner
def basis_lanes(oscillators: Oscillators[Lanes], t: Lanes) -> Basis[Lanes]:
    """`basis_at` of lanes whose vertical motion is underdamped."""
    torsion, vertical = oscillators.torsion, oscillators.vertical
    rise = swing_lanes(vertical, t)
    if any_of((torsion.frequency < vertical.frequency) | (torsion.frequency > vertical.frequency)):
        return Basis(swing_of_any(torsion, t), rise)
    # Matched joints that slide: sine and cosine are the same.
    envelope = exp(-torsion.decay * t)
    sine, cosine = sin_cos(vertical.frequency * t)
    return Basis(Swing(envelope * cosine, envelope * sine / vertical.frequency, envelope, envelope), rise)


@inlined
def added_swing(o: Oscillator[Lanes], first: Swing[Lanes], second: Swing[Lanes]) -> Swing[Lanes]:
    """The swing at the sum of two times."""
    joined = joined_swing(o, first, second.cosine, second.sine)
    return Swing(joined.cosine, joined.sine, first.envelope * second.envelope, first.fast * second.fast)


@inlined
def added_basis(oscillators: Oscillators[Lanes], first: Basis[Lanes], second: Basis[Lanes]) -> Basis[Lanes]:
    """The basis at the sum of two times."""
    return Basis(
        added_swing(oscillators.torsion, first.torsion, second.torsion),
        added_swing(oscillators.vertical, first.vertical, second.vertical),
    )


@inlined
def is_short(o: Oscillator[Lanes], t: Lanes) -> Mask:
    """Where `short_swing` serves."""
    return (abs(o.decay * t) <= SMALL_DECAY) & (abs(o.damped_squared * t * t) <= SMALL_PHASE)


@inlined
def shifted_basis(oscillators: Oscillators[Lanes], basis: Basis[Lanes], step: Lanes, t: Lanes) -> Basis[Lanes]:
    """The basis a step of either sign later, at `t`: afresh in lanes that go far, whatever their neighbours do."""
    torsion, vertical = oscillators.torsion, oscillators.vertical
    c, s = short_swing(torsion, step)
    u, v = short_swing(vertical, step)
    shifted = Basis(joined_swing(torsion, basis.torsion, c, s), joined_swing(vertical, basis.vertical, u, v))
    far = ~(is_short(torsion, step) & is_short(vertical, step))
    if any_of(far):
        shifted = chosen_basis(far, basis_lanes(oscillators, t), shifted)
    return shifted


@inner
def put_basis(array: LaneArray, place: int, basis: Basis[Lanes]) -> None:
    """Write a basis into `BASIS` places of an array."""
    torsion, vertical = basis.torsion, basis.vertical
    array[place], array[place + 1], array[place + 2] = torsion.cosine, torsion.sine, torsion.envelope
    array[place + 3], array[place + 4], array[place + 5] = vertical.cosine, vertical.sine, vertical.envelope
    array[place + 6] = torsion.fast


@inner
def get_basis(array: LaneArray, place: int) -> Basis[Lanes]:
    """Read it from there."""
    envelope = array[place + 5]
    return Basis(
        Swing(array[place], array[place + 1], array[place + 2], array[place + 6]),
        Swing(array[place + 3], array[place + 4], envelope, envelope),
    )


@inlined
def chosen_swing(mask: Mask, first: Swing[Lanes], second: Swing[Lanes]) -> Swing[Lanes]:
    """The first where the mask holds, else the second."""
    return Swing(
        choose(mask, first.cosine, second.cosine),
        choose(mask, first.sine, second.sine),
        choose(mask, first.envelope, second.envelope),
        choose(mask, first.fast, second.fast),
    )


@inlined
def chosen_basis(mask: Mask, first: Basis[Lanes], second: Basis[Lanes]) -> Basis[Lanes]:
    """The first where the mask holds, else the second."""
    return Basis(
        chosen_swing(mask, first.torsion, second.torsion), chosen_swing(mask, first.vertical, second.vertical)
    )


# Halvings after which a lane is left to the scalar kernel.
MAX_DEPTH = 8
# What an interval's right end takes on the stack: a basis, value, slope, curvature, bound, who needs it.
NODE = BASIS + 5
VALUE, SLOPE, CURVE, BOUND, WANTED = range(BASIS, NODE)
# Halvings of the whole time whose bases are there before any is asked for.
READY = 2
# Row of `marks` behind the stack: how many halvings have their basis.
KNOWN = MAX_DEPTH
MAX_POLISHING = 8


class LaneScratch(NamedTuple):
    """Scratch of one thread, in lanes: contact function, twist and force as coefficients, the stack of `first_zeros`
    and the bases of halved times; `marks` are the right end and the depth of what is on the stack.
    """

    function: LaneArray
    twist: LaneArray
    drive: LaneArray
    stack: LaneArray
    halves: LaneArray
    marks: Stack


class Held(NamedTuple):
    """How the functions of a piece are held: in the basis if `terms` is 0, else as Taylor terms in `t/span`."""

    terms: int
    span: Lanes
    per_span: Lanes
    bound: Lanes


class Zeros(NamedTuple):
    """Lanes that have a zero, lanes that could not be solved, the time of the zero and the basis there."""

    hit: Mask
    lost: Mask
    time: Lanes
    basis: Basis[Lanes]


@inner
def halve(oscillators: Oscillators[Lanes], span: Lanes, scratch: LaneScratch) -> None:
    """Fill in the bases of the span and of its first halves."""
    basis = basis_lanes(oscillators, span * (1.0 / (1 << READY)))
    put_basis(scratch.halves, BASIS * READY, basis)
    for depth in range(READY - 1, -1, -1):
        basis = added_basis(oscillators, basis, basis)
        put_basis(scratch.halves, BASIS * depth, basis)
    scratch.marks[KNOWN, 0] = READY


@inlined
def half(oscillators: Oscillators[Lanes], span: Lanes, depth: int, scratch: LaneScratch) -> Basis[Lanes]:
    """The basis at the span halved `depth` times."""
    if depth > scratch.marks[KNOWN, 0]:
        put_basis(scratch.halves, BASIS * depth, basis_lanes(oscillators, span * (1.0 / (1 << depth))))
        scratch.marks[KNOWN, 0] = depth
    return get_basis(scratch.halves, BASIS * depth)


@inner
def evaluate_lanes(c: LaneArray, held: Held, basis: Basis[Lanes], x: Lanes) -> tuple[Lanes, Lanes, Lanes, Lanes]:
    """`events.evaluate` at the share `x` of the span, where the basis is `basis`."""
    if held.terms > 0:
        f, d, dd = series_value(c, held.terms, x)
        return f, d * held.per_span, dd * held.per_span * held.per_span, held.bound
    return evaluate_basis(c, basis)


@inlined
def first_zeros(
    c: LaneArray,
    oscillators: Oscillators[Lanes],
    held: Held,
    once: Mask,
    twice: Mask,
    among: Mask,
    scratch: LaneScratch,
) -> Zeros:
    """`events.first_zero` of the lanes `among`; lanes `once`, `twice` have so many zeros at the start itself."""
    stack, marks, span = scratch.stack, scratch.marks, held.span
    one, none = spread_lanes(1.0), among & ~among
    at_start = Swing(one, 0.0 * one, one, one)
    left, right = Basis(at_start, at_start), Basis(at_start, at_start)
    if held.terms == 0:
        right = get_basis(scratch.halves, 0)
    f0, d0, s0, m0 = evaluate_lanes(c, held, left, 0.0 * one)
    f1, d1, s1, m1 = evaluate_lanes(c, held, right, one)
    ordered = once | twice
    any_ordered = any_of(ordered & among)
    f0, d0 = choose(ordered, 0.0, f0), choose(twice, 0.0, d0)
    lost = among & ~((ordered | (f0 > 0.0)) & (abs(f0) + abs(f1) + m0 < math.inf))
    active = among & ~lost
    hit = none
    # The interval of each lane's zero, its length and what the quintic is there.
    begins, length = 0.0 * one, one
    g0, g1, g2, g3, g4, g5 = one, 0.6 * one, 0.2 * one, -0.2 * one, -0.6 * one, -one
    depth, waiting, begin, end = 0, 0, 0.0, 1.0
    need = active
    while any_of(need):
        h = span * (end - begin)
        h2 = h * h
        error = m0 * (h2 * h2 * h2)
        b1, b2, b3, b4 = bernstein(f0, d0, s0, f1, d1, s1, h)
        clear = zero_free(0, f0, b1, b2, b3, b4, f1, error)
        open_lanes = need
        if begin == 0.0 and any_ordered:
            clear = (clear & ~ordered) | (once & zero_free(1, f0, b1, b2, b3, b4, f1, error))
            clear = clear | (twice & zero_free(2, f0, b1, b2, b3, b4, f1, error))
            open_lanes = need & ~ordered
        falls = open_lanes & ~clear & (f1 <= 0.0) & falls_once(f0, b1, b2, b3, b4, f1, error)
        if any_of(falls):
            hit, active = hit | falls, active & ~falls
            begins, length = choose(falls, begin, begins), choose(falls, end - begin, length)
            g0, g1, g2 = choose(falls, f0, g0), choose(falls, b1, g1), choose(falls, b2, g2)
            g3, g4, g5 = choose(falls, b3, g3), choose(falls, b4, g4), choose(falls, f1, g5)
        undecided = need & ~clear & ~falls
        if any_of(undecided):
            if depth < MAX_DEPTH:
                place = NODE * waiting
                put_basis(stack, place, right)
                stack[place + VALUE], stack[place + SLOPE] = f1, d1
                stack[place + CURVE], stack[place + BOUND] = s1, m1
                stack[place + WANTED] = choose(undecided, one, 0.0)
                marks[waiting, 0], marks[waiting, 1] = end, depth + 1
                waiting += 1
                depth += 1
                end = begin + 0.5 * (end - begin)
                need = undecided
                if held.terms == 0:
                    right = added_basis(oscillators, left, half(oscillators, span, depth, scratch))
                f1, d1, s1, m1 = evaluate_lanes(c, held, right, end * one)
                continue
            lost, active = lost | undecided, active & ~undecided
        need = none
        while waiting > 0 and not any_of(need):
            waiting -= 1
            place = NODE * waiting
            left, begin = right, end
            f0, d0, s0, m0 = f1, d1, s1, m1
            right = get_basis(stack, place)
            f1, d1 = stack[place + VALUE], stack[place + SLOPE]
            s1, m1 = stack[place + CURVE], stack[place + BOUND]
            end, depth = marks[waiting, 0], int(marks[waiting, 1])
            need = active & (stack[place + WANTED] > 0.5)
    if not any_of(hit):
        return Zeros(hit, lost, span, left)
    low, h = span * begins, span * length
    start = choose(hit, low + h * guess(g0, g1, g2, g3, g4, g5), 0.5 * span)
    return polished(c, oscillators, held, low, h, hit, lost, start, scratch)


@inlined
def polished(
    c: LaneArray,
    oscillators: Oscillators[Lanes],
    held: Held,
    low: Lanes,
    h: Lanes,
    hit: Mask,
    lost: Mask,
    t: Lanes,
    scratch: LaneScratch,
) -> Zeros:
    """`events.polish` of the lanes `hit`, from `t`, in intervals from `low` of length `h`."""
    basis = get_basis(scratch.halves, 0)
    if held.terms == 0:
        basis = basis_lanes(oscillators, t)
    rough = hit
    for _ in range(MAX_POLISHING):
        f, d, dd, _bound = evaluate_lanes(c, held, basis, t * held.per_span)
        step = choose(rough, -f * d / (d * d - 0.5 * f * dd), 0.0)
        t = t + step
        outside = rough & ~((t >= low) & (t <= low + h))
        lost, hit, rough = lost | outside, hit & ~outside, rough & ~outside
        # A lane that is done, or lost, stays where it is.
        step = choose(outside, 0.0, step)
        if held.terms == 0:
            basis = shifted_basis(oscillators, basis, step, t)
        rough = rough & (abs(step) > 1e-6 * h)
        if not any_of(rough):
            break
    return Zeros(hit & ~rough, lost | rough, t, basis)


@inner
def has_term(k: int, reach: Lanes) -> Mask:
    """Whether a series of this `reach` has a term `k`: `k < series_length(reach)`."""
    return 7.0 * reach >= k - 12.0


@inner
def terms_of(reach: Lanes, among: Mask) -> int:
    """The number of terms that the lanes `among` need."""
    return series_length(largest(choose(among, reach, 0.0)))


@inner
def series_lanes(
    kappa: Lanes,
    load: Load[Lanes],
    oscillators: Oscillators[Lanes],
    angle: Lanes,
    rate: Lanes,
    span: Lanes,
    reach: Lanes,
    terms: int,
    scratch: LaneScratch,
) -> None:
    """`oscillator.series_free` and `series_response`: force and twist as Taylor coefficients in `t/span`."""
    drive, twist = scratch.drive, scratch.twist
    torsion, vertical = oscillators.torsion, oscillators.vertical
    span_squared = span * span
    drag, pull = 2.0 * vertical.decay * span, vertical.natural_squared * span_squared
    drag_twist, pull_twist = 2.0 * torsion.decay * span, torsion.natural_squared * span_squared
    push = kappa * span_squared
    drive[0], drive[1] = load.force, load.force_rate * span
    twist[0], twist[1] = angle, rate * span
    for k in range(terms - 2):
        share = 1.0 / ((k + 1.0) * (k + 2.0))
        kept = has_term(k + 2, reach)
        force = -(drag * (k + 1.0) * drive[k + 1] + pull * drive[k]) * share
        turn = (push * drive[k] - pull_twist * twist[k] - drag_twist * (k + 1.0) * twist[k + 1]) * share
        drive[k + 2], twist[k + 2] = choose(kept, force, 0.0), choose(kept, turn, 0.0)


@inner
def compose_lanes(
    weights: Weights, ordered: Mask, span: Lanes, per_span: Lanes, reach: Lanes, terms: int, scratch: LaneScratch
) -> Lanes:
    """`twist.compose` in a series, without the constant in lanes `ordered`; returns the bound of `f6`."""
    drive, twist, out = scratch.drive, scratch.twist, scratch.function
    bound = 0.0 * span
    rate, impulse = weights.rate * per_span, weights.impulse * span
    for k in range(terms):
        value = weights.angle * twist[k] + weights.force * drive[k]
        if k + 1 < terms:
            value = value + rate * (k + 1.0) * twist[k + 1]
        if k > 0:
            value = value + impulse * (1.0 / k) * drive[k - 1]
        value = choose(has_term(k, reach), value, 0.0)
        out[k] = value
        if k >= 6:
            bound = bound + abs(value) * (k * (k - 1.0) * (k - 2.0) * (k - 3.0) * (k - 4.0) * (k - 5.0))
    out[0] = choose(ordered, 0.0, out[0] + weights.constant)
    cube = per_span * per_span * per_span
    return bound * (cube * cube)
