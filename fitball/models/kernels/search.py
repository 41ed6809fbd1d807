"""The first zero of a contact function, certified: no earlier zero is missed, however close a pair.

A contact function (slip `v_x - R omega_2`, or the margin `mu F -+ F_x` of the friction cone) is

    f(t) = c0 + A1 C(t) + A2 S(t) + B1 C_f(t) + B2 S_f(t)

with the swings of the torsional and the vertical oscillator, or near resonance a polynomial. Between
two times the quintic through values, slopes and curvatures at both is off by at most `max|f6| h^6/46080`, its slope
by `max|f6| h^5 sqrt(5)/30000` (Birkhoff and Priver 1967), and the sixth derivative `f6` is bounded in closed form;
so an interval is either proved free of zeros, proved to hold exactly one, or halved.
"""

from __future__ import annotations

import math

from fitball.models.kernels.compiled import inner
from fitball.models.kernels.dual import Number, NumberArray, choose
from fitball.models.kernels.oscillator import (
    AT_START,
    Basis,
    Oscillator,
    Oscillators,
    Series,
    basis_at,
    series_value,
    shift_swing,
)
from fitball.values import FloatArray

# A float array of two dimensions: ports lay it out by rows.
Stack = FloatArray

# Layout of a function's coefficient array: its value (5, from 0), two derivatives, and bounds of the sixth over the
# envelopes, and over the fast poles of what is overdamped.
SLOPE, CURVE, BOUND, FAST_BOUND, SIZE = 5, 9, 13, 15, 17
# Halvings after which an undecided interval is narrower than the rounding of its ends.
MAX_DEPTH = 56
# The row behind the stack of `first_zero` holds how many halvings are left to the contact. A ball of the field needs
# some tens; a joint with a million oscillations in one contact would need seconds.
HALVINGS_LEFT, MAX_HALVINGS = MAX_DEPTH, 1.0e6
NO_ZERO = -1.0
# Decay over one step back beyond which the basis is computed afresh: undoing it amplifies rounding by its inverse.
LARGEST_DECAY_UNDONE = 0.5


@inner
def sixth_derivative_bounds(o: Oscillator[float], c: float, s: float, span: float) -> tuple[float, float]:
    """Bounds of |d^6/dt^6 (c C + s S)| for times up to `span`: of the share that dies like the swing's envelope, and
    of that which dies like its fast exponential, both over these.
    """
    turn = o.damped_squared * span * span
    if turn > 1.0:
        cube = o.natural_squared * o.natural_squared * o.natural_squared
        return cube * math.sqrt(c * c + s * s / o.damped_squared), 0.0
    if turn < -1.0:
        # Two exponentials, each with its own pole: one envelope for both would keep the sixth power of the fast pole
        # long after its share has died.
        fast = o.decay + o.frequency
        slow = o.natural_squared / fast
        lead = s / o.frequency
        return 0.5 * abs(c + lead) * slow**6, 0.5 * abs(c - lead) * fast**6
    for _ in range(6):
        c, s = s - o.decay * c, -o.damped_squared * c - o.decay * s
    return abs(c) + abs(s) * span, 0.0


@inner
def prepare_swing(c: FloatArray, place: int, o: Oscillator[float], span: float) -> None:
    """Fill in derivatives and bound of the share that one oscillator (0, 1) has in `c`."""
    first, second = c[1 + 2 * place], c[2 + 2 * place]
    c[BOUND + place], c[FAST_BOUND + place] = sixth_derivative_bounds(o, first, second, span)
    swing_derivatives(c, place, o)


@inner
def swing_derivatives(c: NumberArray, place: int, o: Oscillator[Number]) -> None:
    """Fill in the derivatives of the share that one oscillator (0, 1) has in `c`."""
    first, second = c[1 + 2 * place], c[2 + 2 * place]
    first, second = second - o.decay * first, -o.damped_squared * first - o.decay * second
    c[SLOPE + 2 * place] = first
    c[SLOPE + 2 * place + 1] = second
    c[CURVE + 2 * place] = second - o.decay * first
    c[CURVE + 2 * place + 1] = -o.damped_squared * first - o.decay * second


@inner
def prepare_series(c: FloatArray, n: int, h: float) -> float:
    """Bound of the sixth time derivative of a polynomial in `t/h` on [0, h]."""
    bound = 0.0
    for k in range(6, n):
        bound += abs(c[k]) * (k * (k - 1.0) * (k - 2.0) * (k - 3.0) * (k - 4.0) * (k - 5.0))
    return bound / h**6


@inner
def evaluate(
    c: FloatArray, basis: Basis[float], series: Series, series_bound: float, t: float
) -> tuple[float, float, float, float]:
    """Value, slope, curvature at `t`, where the basis is `basis`, and a bound of the sixth derivative from `t` on.

    A series does not need the basis.
    """
    if series.terms > 0:
        h = series.length
        f, d, dd = series_value(c, series.terms, t / h)
        return f, d / h, dd / (h * h), series_bound
    return evaluate_basis(c, basis)


@inner
def evaluate_basis(c: NumberArray, basis: Basis[Number]) -> tuple[Number, Number, Number, Number]:
    """Value, slope, curvature where the basis is `basis`, and a bound of the sixth derivative from there on."""
    torsion, vertical = basis.torsion, basis.vertical
    p, q, r, s = torsion.cosine, torsion.sine, vertical.cosine, vertical.sine
    return (
        c[0] + c[1] * p + c[2] * q + c[3] * r + c[4] * s,
        c[SLOPE] * p + c[SLOPE + 1] * q + c[SLOPE + 2] * r + c[SLOPE + 3] * s,
        c[CURVE] * p + c[CURVE + 1] * q + c[CURVE + 2] * r + c[CURVE + 3] * s,
        c[BOUND] * torsion.envelope
        + c[BOUND + 1] * vertical.envelope
        + c[FAST_BOUND] * torsion.fast
        + c[FAST_BOUND + 1] * vertical.fast,
    )


@inner
def bernstein(
    f0: Number, d0: Number, s0: Number, f1: Number, d1: Number, s1: Number, h: Number
) -> tuple[Number, Number, Number, Number]:
    """Inner Bernstein coefficients of the quintic through values, slopes and curvatures at both ends."""
    d0, d1 = 0.2 * h * d0, 0.2 * h * d1
    s0, s1 = 0.05 * h * h * s0, 0.05 * h * h * s1
    return f0 + d0, f0 + 2.0 * d0 + s0, f1 - 2.0 * d1 + s1, f1 - d1


@inner
def zero_free(order: int, b0: float, b1: float, b2: float, b3: float, b4: float, b5: float, error: float) -> bool:
    """Whether f > 0 on the interval is proved; `order` counts the zeros known to sit at its left end.

    Bernstein coefficients bound the quintic from below; `error` is max|f6| h^6. The interpolation error
    `x^3 (1-x)^3 error/720` is divided by the same power of `x` as the quintic.
    """
    if order == 0:
        return min(min(b0, min(b1, b2)), min(b3, min(b4, b5))) > error * (1.0 / 46080.0)
    if order == 1:
        return min(min(5.0 * b1, 2.5 * b2), min(5.0 / 3.0 * b3, min(1.25 * b4, b5))) > error * (1.0 / 20833.0)
    return min(min(10.0 * b2, 10.0 / 3.0 * b3), min(5.0 / 3.0 * b4, b5)) > error * (1.0 / 6826.0)


@inner
def falls_once(b0: float, b1: float, b2: float, b3: float, b4: float, b5: float, error: float) -> bool:
    """Whether f decreases throughout the interval is proved: then a sign change means one zero."""
    steepest = max(max(b1 - b0, b2 - b1), max(b3 - b2, max(b4 - b3, b5 - b4)))
    return 5.0 * steepest < -error * 7.4536e-5


@inner
def guess(b0: float, b1: float, b2: float, b3: float, b4: float, b5: float) -> float:
    """Where the falling quintic with these Bernstein coefficients is about zero, within (0, 1)."""
    # Inverse interpolation: the cubic in the value that has the quintic's ends and slopes, at value zero.
    fall = 1.0 / (b0 - b5)
    u = b0 * fall
    g0 = 1.0 / (5.0 * (b0 - b1) * fall)
    g1 = 1.0 / (5.0 * (b4 - b5) * fall)
    x = u * (g0 + u * (3.0 - 2.0 * g0 - g1 + u * (g0 + g1 - 2.0)))
    x = choose(abs(x - 0.5) < 0.5, x, u)
    # One step of Halley on the quintic itself, by de Casteljau.
    y = 1.0 - x
    c0, c1, c2, c3, c4 = y * b0 + x * b1, y * b1 + x * b2, y * b2 + x * b3, y * b3 + x * b4, y * b4 + x * b5
    c0, c1, c2, c3 = y * c0 + x * c1, y * c1 + x * c2, y * c2 + x * c3, y * c3 + x * c4
    c0, c1, c2 = y * c0 + x * c1, y * c1 + x * c2, y * c2 + x * c3
    f = y * (y * c0 + x * c1) + x * (y * c1 + x * c2)
    d = 5.0 * (y * (c1 - c0) + x * (c2 - c1))
    dd = 20.0 * (c2 - 2.0 * c1 + c0)
    better = x - f * d / (d * d - 0.5 * f * dd)
    return choose(abs(better - 0.5) < 0.5, better, x)


@inner
def polish(
    c: FloatArray, oscillators: Oscillators[float], series: Series, left: float, right: float, t: float
) -> tuple[float, Basis[float]]:
    """The zero between `left` (f > 0) and `right` (f <= 0), to rounding: Halley from `t`, kept in the bracket.

    Returns it with the basis there (a series has none).
    """
    h = right - left
    basis = AT_START if series.terms > 0 else basis_at(oscillators, t)
    for _ in range(60):
        f, d, dd, _bound = evaluate(c, basis, series, 0.0, t)
        if f > 0.0:
            left = t
        else:
            right = t
        step = -f * d / (d * d - 0.5 * f * dd)
        following = t + step
        if not left <= following <= right:
            following = 0.5 * (left + right)
            step = following - t
        t = following
        if series.terms == 0:
            if -step * max(oscillators.torsion.decay, oscillators.vertical.decay) > LARGEST_DECAY_UNDONE:
                basis = basis_at(oscillators, t)
            else:
                basis = Basis(
                    shift_swing(oscillators.torsion, basis.torsion, step),
                    shift_swing(oscillators.vertical, basis.vertical, step),
                )
        # Halley's error is the cube of the step, in units of an interval on which f is nearly a cubic.
        if abs(step) <= 1e-6 * h or right - left <= 2.3e-16 * right:
            break
    return t, basis


@inner
def first_zero(
    c: FloatArray,
    oscillators: Oscillators[float],
    series: Series,
    series_bound: float,
    order: int,
    end: float,
    end_basis: Basis[float],
    stack: Stack,
) -> tuple[float, Basis[float]]:
    """First time in (0, end] at which f, positive just after 0, falls to zero; NO_ZERO if there is none.

    Returns it with the basis there; NaN if f overflows or the halvings allowed run out. `order` zeros are known to
    sit at 0 itself (0: f(0) > 0; 1: f' > 0 there; 2: f'' > 0). `end_basis` is the basis at `end`, which a series does
    not need. `stack` is scratch of shape (MAX_DEPTH + 1, 5).
    """
    left = 0.0
    f0, d0, s0, m0 = evaluate(c, AT_START, series, series_bound, 0.0)
    if order > 0:
        f0 = 0.0
    elif f0 <= 0.0:
        return 0.0, AT_START
    if order > 1:
        d0 = 0.0
    depth = 0
    right = end
    f1, d1, s1, m1 = evaluate(c, end_basis, series, series_bound, right)
    if not abs(f0) + abs(f1) + m0 < math.inf:
        return math.nan, AT_START
    while True:
        h = right - left
        h2 = h * h
        error = m0 * h2 * h2 * h2
        b1, b2, b3, b4 = bernstein(f0, d0, s0, f1, d1, s1, h)
        if zero_free(order, f0, b1, b2, b3, b4, f1, error):
            crossed = False
        elif order == 0 and f1 <= 0.0 and falls_once(f0, b1, b2, b3, b4, f1, error):
            t = left + h * guess(f0, b1, b2, b3, b4, f1)
            return polish(c, oscillators, series, left, right, t)
        elif depth >= MAX_DEPTH - 1 or h <= 4.5e-16 * right:
            # Narrower than rounding can resolve: what the right end shows is all there is to know.
            crossed = f1 <= 0.0 and order == 0
            if crossed:
                return right, AT_START if series.terms > 0 else basis_at(oscillators, right)
        elif stack[HALVINGS_LEFT, 0] <= 0.0:
            return math.nan, AT_START
        else:
            stack[HALVINGS_LEFT, 0] -= 1.0
            stack[depth, 0], stack[depth, 1], stack[depth, 2] = right, f1, d1
            stack[depth, 3], stack[depth, 4] = s1, m1
            depth += 1
            right = left + 0.5 * h
            middle = AT_START if series.terms > 0 else basis_at(oscillators, right)
            f1, d1, s1, m1 = evaluate(c, middle, series, series_bound, right)
            continue
        if depth == 0:
            return NO_ZERO, end_basis
        left, f0, d0, s0, m0, order = right, f1, d1, s1, m1, 0
        depth -= 1
        right, f1, d1 = stack[depth, 0], stack[depth, 1], stack[depth, 2]
        s1, m1 = stack[depth, 3], stack[depth, 4]
