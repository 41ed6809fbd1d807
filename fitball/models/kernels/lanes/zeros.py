"""First zeros of the contact functions of all lanes, certified as in `events`.

All lanes walk through one tree of halved intervals, each from its own start to its own end; an interval is halved as
long as some lane there is undecided. A lane looks only at intervals that it would look at alone, so that its result
does not depend on its neighbours.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from fitball.models.kernels.compiled import inlined, inner
from fitball.models.kernels.dual import choose
from fitball.models.kernels.events import bernstein, evaluate_basis, falls_once, guess, zero_free
from fitball.models.kernels.lanes.swings import (
    BASIS,
    added_basis,
    basis_lanes,
    get_basis,
    put_basis,
    shifted_basis,
)
from fitball.models.kernels.lanes.vector import LaneArray, Lanes, Mask, any_of, spread_lanes
from fitball.models.kernels.oscillator import series_value
from fitball.models.kernels.quantities import Basis, Oscillators, Stack, Swing

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
