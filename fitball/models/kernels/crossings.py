"""The first zero, proved, of a contact function over a piece of a contact.

A contact function (slip, or distance to a side of the friction cone) is a constant and a weighted
sum over twist, its rate, normal force and impulse. Between two times the quintic through values,
slopes and curvatures at both is off by at most `max|f6| h^6/46080`, its slope by `max|f6| h^5
sqrt(5)/30000` (Birkhoff and Priver 1967), and the sixth derivative is bounded in closed form: an
interval is proved free of zeros, proved to hold exactly one, or halved.
"""

import math
from typing import NamedTuple

from fitball.models.kernels.compiled import inlined, kernel
from fitball.models.kernels.motion import (
    NONE,
    SMALL,
    START,
    Mix,
    Piece,
    Spring,
    Swing,
    changed,
    joined,
    load_of,
    rate_of,
    series_changes,
    stepped,
    swings_anew,
    swings_at,
)


class Weights(NamedTuple):
    """A contact function as a sum: a constant, and its weights of twist, twist rate, normal force,
    and impulse since the start of the piece. It has `order` zeros at the start itself, and is
    positive just after.
    """

    order: int
    constant: float
    angle: float
    rate: float
    force: float
    impulse: float


class Jet(NamedTuple):
    """Value, slope and curvature of a function of time at one instant."""

    value: float
    slope: float
    curvature: float


class Curve(NamedTuple):
    """A contact function over a piece: where it starts, its changes in the basis (not of a series),
    and bounds of the sixth derivative over the exponentials of both swings.
    """

    weights: Weights
    start: Jet
    value: Mix
    slope: Mix
    curvature: Mix
    slow: float
    fast: float
    slow_f: float
    fast_f: float


# The contact function zero, which stands in for a second one where there is none.
FLAT = Curve(
    Weights(0, 0.0, 0.0, 0.0, 0.0, 0.0),
    Jet(0.0, 0.0, 0.0),
    NONE,
    NONE,
    NONE,
    0.0,
    0.0,
    0.0,
    0.0,
)
# In place of a time: there is no zero. No time is negative.
NO_ZERO = -1.0
# Error of the quintic's value, over the sixth derivative times width^6 (Birkhoff and Priver 1967).
OFF = 1.0 / 46080
# That error over the share of the interval since its start, where one zero there is divided out.
OFF_ONCE = 1.0 / 20833
# That error over the square of the share, where two zeros are divided out.
OFF_TWICE = 1.0 / 6826
# Error of its slope times width: sqrt(5)/30000 (Birkhoff and Priver 1967).
OFF_SLOPE = 7.4536e-5
# Sixth derivative times width^6 over value from which the first width is halved at once. It saves
# time only: every interval is proved or halved anyway.
WIDE = 700.0
# Intervals after which a search is given up (status TOO_MANY_PHASES).
MAX_STEPS = 10000
# Steps after which rounding of the swings that were put together matters enough to compute them
# anew.
MANY_STEPS = 8


@inlined
def sixth_bounds(o: Spring, c: float, s: float, span: float) -> tuple[float, float]:
    """Bounds of |d^6/dt^6 (c C + s S)| of an oscillator up to the time `span`, over the slow and
    over the fast exponential of its swing.
    """
    turn = o.damped_squared * span * span
    if turn > 1.0:
        poles = o.natural_squared * o.natural_squared * o.natural_squared
        return poles * (abs(c) + abs(s) * o.period), 0.0
    if turn < -1.0:
        # Each exponential with its own pole: or the fast one's sixth power would outlive its share.
        fast = o.decay + o.frequency
        slow = o.natural_squared / fast
        lead = s * o.period
        return 0.5 * abs(c + lead) * slow**6, 0.5 * abs(c - lead) * fast**6
    for _ in range(6):
        # The derivative of c C + s S in the basis.
        c, s = s - o.decay * c, -o.damped_squared * c - o.decay * s
    return abs(c) + abs(s) * span, 0.0


@inlined
def jet_of(
    piece: Piece,
    w: Weights,
    value: float,
    y: float,
    y_rate: float,
    angle: float,
    rate: float,
) -> Jet:
    """A contact function that has this `value` where compression and twist, each with its rate, are
    these: slope and curvature follow from the equations of motion.
    """
    torsion = piece.torsion
    vertical = piece.vertical
    riding = piece.riding
    force, force_rate = load_of(vertical, riding, y, y_rate)
    accel = piece.kappa * force - 2.0 * torsion.decay * rate - torsion.natural_squared * angle
    jerk = piece.kappa * force_rate - 2.0 * torsion.decay * accel - torsion.natural_squared * rate
    bend = -2.0 * vertical.decay * force_rate - vertical.natural_squared * force
    slope = w.angle * rate + w.rate * accel + w.force * force_rate + w.impulse * force
    curvature = w.angle * accel + w.rate * jerk + w.force * bend + w.impulse * force_rate
    return Jet(value, slope, curvature)


@inlined
def curve_of(piece: Piece, w: Weights) -> Curve:
    """A contact function over a piece, from its weights."""
    torsion = piece.torsion
    vertical = piece.vertical
    x = piece.twist
    r = piece.twisting
    s = piece.start
    value = w.constant + w.angle * s.angle + w.rate * s.rate + w.force * piece.force
    # The rounding of what is zero would outweigh it for a while.
    value = 0.0 if w.order > 0 else value
    if piece.terms > 0:
        j = jet_of(piece, w, value, s.y, s.y_rate, s.angle, s.rate)
        start = Jet(value, 0.0 if w.order > 1 else j.slope, j.curvature)
        return Curve(w, start, NONE, NONE, NONE, series_bound(piece, w), 0.0, 0.0, 0.0)
    momentum = piece.riding * s.y_rate
    force_s = piece.force_rate + vertical.decay * piece.force
    impulse_s = piece.force - vertical.decay * momentum
    f = Mix(
        w.angle * x.c + w.rate * r.c,
        w.angle * x.s + w.rate * r.s,
        w.angle * x.c_f + w.rate * r.c_f + w.force * piece.force - w.impulse * momentum,
        w.angle * x.s_f + w.rate * r.s_f + w.force * force_s + w.impulse * impulse_s,
    )
    slope = rate_of(torsion, vertical, f)
    bend = rate_of(torsion, vertical, slope)
    start = Jet(value, 0.0 if w.order > 1 else slope.c + slope.c_f, bend.c + bend.c_f)
    slow, fast = sixth_bounds(torsion, f.c, f.s, piece.length)
    slow_f, fast_f = sixth_bounds(vertical, f.c_f, f.s_f, piece.length)
    return Curve(w, start, f, slope, bend, slow, fast, slow_f, fast_f)


@kernel
def series_bound(piece: Piece, w: Weights) -> float:
    """Bound of the sixth derivative of a contact function over a piece that is a series, term by
    term. `f1` and `a1` are the terms of force and twist in `h^k`, `f0` and `a0` those before.
    """
    vertical = piece.vertical
    torsion = piece.torsion
    h = piece.length
    drag = 2.0 * vertical.decay * h
    pull = vertical.natural_squared * h * h
    drag_twist = 2.0 * torsion.decay * h
    pull_twist = torsion.natural_squared * h * h
    f0 = piece.force
    f1 = piece.force_rate * h
    a0 = piece.start.angle
    a1 = piece.start.rate * h
    before = 0.0
    bound = 0.0
    for k in range(1, piece.terms - 1):
        if k > 6:
            n = k - 1.0
            c = w.angle * a0 + w.rate / h * k * a1 + w.force * f0 + w.impulse * h / n * before
            bound += abs(c) * (n * (n - 1.0) * (n - 2.0) * (n - 3.0) * (n - 4.0) * (n - 5.0))
        per = 1.0 / (k * (k + 1.0))
        before = f0
        torque = piece.kappa * h * h * f0 - pull_twist * a0 - drag_twist * k * a1
        a0 = a1
        a1 = torque * per
        load = drag * k * f1 + pull * f0
        f0 = f1
        f1 = -load * per
    return bound / h**6


@inlined
def jet_at(piece: Piece, c: Curve, t: float, p: Swing, q: Swing) -> Jet:
    """A contact function at the time `t` of a piece, where the swings are `p` and `q`."""
    if piece.terms == 0:
        value = c.start.value + changed(c.value, p, q)
        slope = c.start.slope + changed(c.slope, p, q)
        return Jet(value, slope, c.start.curvature + changed(c.curvature, p, q))
    w = c.weights
    s = piece.start
    vertical = piece.vertical
    # These are changes since the start.
    y, y_rate, angle, rate = series_changes(piece, t)
    force = piece.riding * (2.0 * vertical.decay * y_rate + vertical.natural_squared * y)
    value = c.start.value + w.angle * angle + w.rate * rate
    value = value + w.force * force - w.impulse * piece.riding * y_rate
    return jet_of(piece, w, value, s.y + y, s.y_rate + y_rate, s.angle + angle, s.rate + rate)


@inlined
def off_of(c: Curve, p: Swing, q: Swing, h: float) -> float:
    """Bound of the sixth derivative of a contact function, times h^6, over the time `h` that
    follows where the swings are `p` and `q`.
    """
    return (c.slow * p.slow + c.fast * p.fast + c.slow_f * q.slow + c.fast_f * q.fast) * h**6


@inlined
def proved(f: Jet, g: Jet, h: float, order: int, off: float) -> tuple[float, bool]:
    """A number that is positive where a function from `f` to `g`, `h` apart, is proved to be, and
    whether it is proved to fall through zero, once: by the Bernstein coefficients of the quintic.
    `order` zeros at the start are divided out; `off` bounds the sixth derivative times h^6.
    """
    x0 = 0.2 * h * f.slope
    x1 = 0.2 * h * g.slope
    h2 = 0.05 * h * h
    b0 = f.value
    b5 = g.value
    b1 = b0 + x0
    b2 = b0 + 2.0 * x0 + h2 * f.curvature
    b3 = b5 - 2.0 * x1 + h2 * g.curvature
    b4 = b5 - x1
    if order == 1:
        # Coefficients of the quartic that remains when the zero at the start is divided out.
        early = min(5.0 * b1, 2.5 * b2)
        late = min(min(5.0 / 3.0 * b3, 1.25 * b4), b5)
        return min(early, late) - OFF_ONCE * off, False
    if order == 2:
        # Coefficients of the cubic that remains without two zeros.
        early = min(10.0 * b2, 10.0 / 3.0 * b3)
        late = min(5.0 / 3.0 * b4, b5)
        return min(early, late) - OFF_TWICE * off, False
    early = min(min(b0, b1), b2)
    late = min(min(b3, b4), b5)
    lowest = min(early, late) - OFF * off
    steepest = max(b1 - b0, b2 - b1)
    steepest = max(steepest, max(b3 - b2, max(b4 - b3, b5 - b4)))
    return lowest, b5 <= 0.0 and 5.0 * steepest < -OFF_SLOPE * off


@inlined
def guess(f: Jet, g: Jet, h: float) -> float:
    """About where the quintic that falls from `f` to `g` over a time `h` is zero, as a share of
    that time.
    """
    drop = f.value - g.value
    half = 0.5 * h * h
    x0 = h * f.slope
    x1 = h * g.slope
    y0 = half * f.curvature
    y1 = half * g.curvature
    # Inverse interpolation: the cubic in the value that has the quintic's ends and slopes, at value
    # zero; the straight line if that is outside.
    u = f.value / drop
    s0 = -drop / x0
    s1 = -drop / x1
    x = u * (s0 + u * (3.0 - 2.0 * s0 - s1 + u * (s0 + s1 - 2.0)))
    x = x if abs(x - 0.5) < 0.5 else u
    # One step of Halley, on the quintic's coefficients p3, p4, p5 above the parabola of the start.
    rest = -drop - x0 - y0
    turn = x1 - x0 - 2.0 * y0
    bend = y1 - y0
    z = x * x
    p3 = 10.0 * rest - 4.0 * turn + bend
    p5 = 6.0 * rest - 3.0 * turn + bend
    p4 = 7.0 * turn - 15.0 * rest - 2.0 * bend
    value = (f.value + x * x0) + z * ((y0 + x * p3) + z * (p4 + x * p5))
    slope = (x0 + 2.0 * x * y0) + z * ((3.0 * p3 + 4.0 * x * p4) + 5.0 * z * p5)
    bent = (y0 + 3.0 * x * p3) + z * (6.0 * p4 + 10.0 * x * p5)
    better = x - value * slope / (slope * slope - value * bent)
    return better if abs(better - 0.5) < 0.5 else x


@inlined
def polished(
    piece: Piece,
    c: Curve,
    low: float,
    high: float,
    t: float,
) -> tuple[float, Swing, Swing]:
    """The one zero of a contact function between the times `low` and `high`, to rounding, from a
    first guess `t`, and the swings there: steps of Halley, which do not leave the interval.
    """
    torsion = piece.torsion
    vertical = piece.vertical
    h = high - low
    pole = max(torsion.decay, torsion.frequency)
    pole = max(pole, max(vertical.decay, vertical.frequency))
    p = START
    q = START
    step = t
    done = False
    for _ in range(60):
        if pole * abs(step) < SMALL:
            p = stepped(torsion, p, step)
            q = stepped(vertical, q, step)
        else:
            p, q = swings_at(piece, t)
        if done:
            break
        f = jet_at(piece, c, t, p, q)
        if f.value > 0.0:
            low = t
        else:
            high = t
        step = -f.value * f.slope / (f.slope * f.slope - 0.5 * f.value * f.curvature)
        if not low <= t + step <= high:
            step = 0.5 * (low + high) - t
        t += step
        # Halley's error is the cube of the step, in units of an interval on which f is nearly a
        # parabola.
        short_step = abs(step) <= 1e-5 * h
        straight = abs(step * f.curvature) <= 2e-5 * abs(f.slope)
        done = (short_step and straight) or high - low <= 2.3e-16 * high
    return t, p, q


# Compiled in one piece: its state is 15 values, which parts would hand to each other.
@inlined
def first_fall(  # noqa: C901
    piece: Piece,
    a: Curve,
    b: Curve,
    paired: bool,
    end: float,
) -> tuple[float, bool, Swing, Swing]:
    """First time in (0, end] at which `a`, or `b` if they are `paired`, falls to zero, whether it
    is `b` that does, and the swings there; NO_ZERO with the swings at the end if there is no such
    time, NaN if the search does not end.

    The piece is gone through in intervals of width `h`, of which `passed` of `total` are done. An
    interval without proof is halved, and two are joined again where the proof was easy.
    """
    torsion = piece.torsion
    vertical = piece.vertical
    f = a.start
    g = b.start
    f_order = a.weights.order
    g_order = b.weights.order
    if (f_order == 0 and f.value <= 0.0) or (paired and g_order == 0 and g.value <= 0.0):
        return 0.0, f_order > 0 or f.value > 0.0, START, START
    bound = a.slow + a.fast + a.slow_f + a.fast_f
    size = abs(f.value) + abs(g.value) + bound
    if not size + b.slow + b.fast + b.slow_f + b.fast_f < math.inf:
        return math.nan, False, START, START
    p = START
    q = START
    passed = 0
    total = 1
    h = end
    while f_order == 0 and bound * h**6 > WIDE * f.value and h * 3.0 > end:
        h = 0.5 * h
        total = 2 * total
    step_p, step_q = swings_at(piece, h)
    for step in range(MAX_STEPS):
        begin = passed * h
        p1 = joined(torsion, p, step_p)
        q1 = joined(vertical, q, step_q)
        f1 = jet_at(piece, a, begin + h, p1, q1)
        g1 = g
        off = off_of(a, p, q, h)
        f_clear, f_falls = proved(f, f1, h, f_order, off)
        g_clear = math.inf
        g_falls = False
        if paired:
            g1 = jet_at(piece, b, begin + h, p1, q1)
            g_off = off_of(b, p, q, h)
            g_clear, g_falls = proved(g, g1, h, g_order, g_off)
            off = max(off, g_off)
        if min(f_clear, g_clear) <= 0.0:
            if (f_falls and g_clear > 0.0) or (g_falls and f_clear > 0.0):
                if g_falls:
                    a = b
                    f = g
                    f1 = g1
                t = begin + h * guess(f, f1, h)
                t, p, q = polished(piece, a, begin, begin + h, t)
                return t, g_falls, p, q
            if h > 4.5e-16 * (begin + h):
                h = 0.5 * h
                passed = 2 * passed
                total = 2 * total
                step_p, step_q = swings_at(piece, h)
                continue
            # Narrower than rounding can resolve: what the right end shows is all there is to know.
            if f1.value <= 0.0 or (paired and g1.value <= 0.0):
                return begin + h, f1.value > 0.0, p1, q1
        f = f1
        g = g1
        p = p1
        q = q1
        f_order = 0
        g_order = 0
        passed += 1
        if passed == total:
            if step > MANY_STEPS:
                p, q = swings_anew(piece, end)
            return NO_ZERO, False, p, q
        if passed % 2 == 0 and min(f_clear, g_clear) > 50.0 * OFF * off:
            h = 2.0 * h
            passed = passed // 2
            total = total // 2
            step_p, step_q = swings_anew(piece, h)
    return math.nan, False, START, START
