"""The first zero of a contact function, certified: no earlier zero is missed, however close a pair.

A contact function (slip, or the margin of the friction cone) is

    f(t) = c0 + A1 C(t) + A2 S(t) + B1 C_f(t) + B2 S_f(t)

with the torsional and the vertical pole pair of `oscillator`, or near resonance a polynomial. Between
two times the quintic through values, slopes and curvatures at both is off by at most `max|f6| h^6/46080`, its slope
by `max|f6| h^5 sqrt(5)/30000` (Birkhoff and Priver 1967), and the sixth derivative `f6` is bounded in closed form;
so an interval is either proved free of zeros, proved to hold exactly one, or halved.
"""

from __future__ import annotations

import math

from fitball.models.kernels.compiled import compiled
from fitball.models.kernels.dual import Number, NumberArray
from fitball.models.kernels.oscillator import damped_pair, series_value, shift_pair
from fitball.values import FloatArray

# Layout of a function's coefficient array.
VALUE, SLOPE, CURVE, BOUND, SIZE = 0, 5, 9, 13, 15
# Layout of the pole array: torsional pair, vertical pair.
TORSION, VERTICAL, POLES = 0, 4, 8
# Halvings after which an undecided interval is narrower than the rounding of its ends.
DEPTH = 56
# The row behind the stack of `first_zero` holds how many halvings are left to the contact. A ball of the field needs
# some tens; a joint with a million oscillations in one contact would need seconds.
HALVINGS, ALLOWANCE = DEPTH, 1.0e6
NO_ZERO = -1.0
# Decay over one step back beyond which the basis is computed afresh: undoing it amplifies rounding by its inverse.
UNDONE = 0.5
# `(C, S, envelope)` of the torsional pair, then of the vertical pair.
Basis = tuple[Number, Number, Number, Number, Number, Number]
AT_START: Basis[float] = (1.0, 0.0, 1.0, 1.0, 0.0, 1.0)


@compiled
def sixth_derivative_bound(a: float, w2: float, b: float, c: float, s: float, span: float) -> float:
    """Bound of |d^6/dt^6 (c C + s S)| over its envelope, for times up to `span`."""
    if w2 * span * span > 1.0:
        return b * b * b * math.sqrt(c * c + s * s / w2)
    for _ in range(6):
        c, s = s - a * c, -w2 * c - a * s
    return abs(c) + abs(s) * span


@compiled
def prepare(c: FloatArray, poles: FloatArray, span: float) -> None:
    """Fill in derivatives and bounds behind the five value coefficients of `c`."""
    for pair in range(2):
        a, w2, b = poles[4 * pair], poles[4 * pair + 1], poles[4 * pair + 2]
        cc, ss = c[1 + 2 * pair], c[2 + 2 * pair]
        c[BOUND + pair] = sixth_derivative_bound(a, w2, b, cc, ss, span)
        cc, ss = ss - a * cc, -w2 * cc - a * ss
        c[SLOPE + 2 * pair] = cc
        c[SLOPE + 2 * pair + 1] = ss
        c[CURVE + 2 * pair] = ss - a * cc
        c[CURVE + 2 * pair + 1] = -w2 * cc - a * ss


@compiled
def prepare_series(c: FloatArray, n: int, h: float) -> float:
    """Bound of the sixth time derivative of a polynomial in `t/h` on [0, h]."""
    bound = 0.0
    for k in range(6, n):
        bound += abs(c[k]) * (k * (k - 1.0) * (k - 2.0) * (k - 3.0) * (k - 4.0) * (k - 5.0))
    return bound / h**6


@compiled
def basis_at(poles: NumberArray, t: Number) -> Basis[Number]:
    """`(C, S, envelope)` of the torsional and of the vertical pair at time `t`."""
    p, q, e = damped_pair(poles[0], poles[1], poles[2], poles[3], t)
    r, s, g = damped_pair(poles[4], poles[5], poles[6], poles[7], t)
    return p, q, e, r, s, g


@compiled
def shifted(poles: FloatArray, basis: Basis[float], t: float) -> Basis[float]:
    """The basis a short time `t` (of either sign) later, by the addition theorem; envelopes are left as they are."""
    p, q, e, r, s, g = basis
    c, d = shift_pair(poles[0], poles[1], poles[2], poles[3], t)
    u, v = shift_pair(poles[4], poles[5], poles[6], poles[7], t)
    return p * c - poles[1] * q * d, q * c + p * d, e, r * u - poles[5] * s * v, s * u + r * v, g


@compiled
def evaluate(
    c: FloatArray, basis: Basis[float], n: int, h: float, series_bound: float, t: float
) -> tuple[float, float, float, float]:
    """Value, slope, curvature at `t`, where the basis is `basis`, and a bound of the sixth derivative from `t` on.

    `n > 0` means a series in `t/h`, which does not need the basis.
    """
    if n > 0:
        f, d, dd = series_value(c, n, t / h)
        return f, d / h, dd / (h * h), series_bound
    p, q, e, r, s, g = basis
    return (
        c[0] + c[1] * p + c[2] * q + c[3] * r + c[4] * s,
        c[5] * p + c[6] * q + c[7] * r + c[8] * s,
        c[9] * p + c[10] * q + c[11] * r + c[12] * s,
        c[13] * e + c[14] * g,
    )


@compiled
def bernstein(
    f0: float, d0: float, s0: float, f1: float, d1: float, s1: float, h: float
) -> tuple[float, float, float, float]:
    """Inner Bernstein coefficients of the quintic through values, slopes and curvatures at both ends."""
    d0, d1 = 0.2 * h * d0, 0.2 * h * d1
    s0, s1 = 0.05 * h * h * s0, 0.05 * h * h * s1
    return f0 + d0, f0 + 2.0 * d0 + s0, f1 - 2.0 * d1 + s1, f1 - d1


@compiled
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


@compiled
def falls_once(b0: float, b1: float, b2: float, b3: float, b4: float, b5: float, error: float) -> bool:
    """Whether f decreases throughout the interval is proved: then a sign change means one zero."""
    steepest = max(max(b1 - b0, b2 - b1), max(b3 - b2, max(b4 - b3, b5 - b4)))
    return 5.0 * steepest < -error * 7.4536e-5


@compiled
def guess(b0: float, b1: float, b2: float, b3: float, b4: float, b5: float) -> float:
    """Where the falling quintic with these Bernstein coefficients is about zero, within (0, 1)."""
    # Inverse interpolation: the cubic in the value that has the quintic's ends and slopes, at value zero.
    fall = 1.0 / (b0 - b5)
    u = b0 * fall
    g0 = 1.0 / (5.0 * (b0 - b1) * fall)
    g1 = 1.0 / (5.0 * (b4 - b5) * fall)
    x = u * (g0 + u * (3.0 - 2.0 * g0 - g1 + u * (g0 + g1 - 2.0)))
    if not 0.0 < x < 1.0:
        x = u
    # One step of Halley on the quintic itself, by de Casteljau.
    y = 1.0 - x
    c0, c1, c2, c3, c4 = y * b0 + x * b1, y * b1 + x * b2, y * b2 + x * b3, y * b3 + x * b4, y * b4 + x * b5
    c0, c1, c2, c3 = y * c0 + x * c1, y * c1 + x * c2, y * c2 + x * c3, y * c3 + x * c4
    c0, c1, c2 = y * c0 + x * c1, y * c1 + x * c2, y * c2 + x * c3
    f = y * (y * c0 + x * c1) + x * (y * c1 + x * c2)
    d = 5.0 * (y * (c1 - c0) + x * (c2 - c1))
    dd = 20.0 * (c2 - 2.0 * c1 + c0)
    better = x - f * d / (d * d - 0.5 * f * dd)
    return better if 0.0 < better < 1.0 else x


@compiled
def polish(
    c: FloatArray, poles: FloatArray, n: int, scale: float, left: float, right: float, t: float
) -> tuple[float, Basis[float]]:
    """The zero between `left` (f > 0) and `right` (f <= 0), to rounding: Halley from `t`, kept in the bracket.

    Returns it with the basis there (a series has none).
    """
    h = right - left
    basis = AT_START if n > 0 else basis_at(poles, t)
    for _ in range(60):
        f, d, dd, _bound = evaluate(c, basis, n, scale, 0.0, t)
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
        if n == 0:
            undoes = -step * max(poles[TORSION], poles[VERTICAL]) > UNDONE
            basis = basis_at(poles, t) if undoes else shifted(poles, basis, step)
        # Halley's error is the cube of the step, in units of an interval on which f is nearly a cubic.
        if abs(step) <= 1e-6 * h or right - left <= 2.3e-16 * right:
            break
    return t, basis


@compiled
def first_zero(
    c: FloatArray,
    poles: FloatArray,
    n: int,
    scale: float,
    series_bound: float,
    order: int,
    end: float,
    end_basis: Basis[float],
    stack: FloatArray,
) -> tuple[float, Basis[float]]:
    """First time in (0, end] at which f, positive just after 0, falls to zero; NO_ZERO if there is none.

    Returns it with the basis there; NaN if f overflows or the halvings allowed run out. `order` zeros are known to
    sit at 0 itself (0: f(0) > 0; 1: f' > 0 there; 2: f'' > 0). `end_basis` is the basis at `end`, which a series does
    not need. `stack` is scratch of shape (DEPTH + 1, 5).
    """
    left = 0.0
    f0, d0, s0, m0 = evaluate(c, AT_START, n, scale, series_bound, 0.0)
    if order > 0:
        f0 = 0.0
    elif f0 <= 0.0:
        return 0.0, AT_START
    if order > 1:
        d0 = 0.0
    depth = 0
    right = end
    f1, d1, s1, m1 = evaluate(c, end_basis, n, scale, series_bound, right)
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
            return polish(c, poles, n, scale, left, right, t)
        elif depth >= DEPTH - 1 or h <= 4.5e-16 * right:
            # Narrower than rounding can resolve: what the right end shows is all there is to know.
            crossed = f1 <= 0.0 and order == 0
            if crossed:
                return right, AT_START if n > 0 else basis_at(poles, right)
        elif stack[HALVINGS, 0] <= 0.0:
            return math.nan, AT_START
        else:
            stack[HALVINGS, 0] -= 1.0
            stack[depth, 0], stack[depth, 1], stack[depth, 2] = right, f1, d1
            stack[depth, 3], stack[depth, 4] = s1, m1
            depth += 1
            right = left + 0.5 * h
            middle = AT_START if n > 0 else basis_at(poles, right)
            f1, d1, s1, m1 = evaluate(c, middle, n, scale, series_bound, right)
            continue
        if depth == 0:
            return NO_ZERO, end_basis
        left, f0, d0, s0, m0, order = right, f1, d1, s1, m1, 0
        depth -= 1
        right, f1, d1 = stack[depth, 0], stack[depth, 1], stack[depth, 2]
        s1, m1 = stack[depth, 3], stack[depth, 4]
