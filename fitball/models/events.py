"""The first zero of a contact function, certified: no earlier zero is missed, however close a pair.

A contact function (slip, or the margin of the friction cone) is

    f(t) = c0 + A1 C(t) + A2 S(t) + B1 C_f(t) + B2 S_f(t)

with the torsional and the vertical pole pair of `oscillator`, or near resonance a polynomial. Between
two times the cubic through both values and slopes is off by at most `max|f''''| h^4/384`, and
the fourth derivative is bounded in closed form; so an interval is either proved free of zeros, proved to
hold exactly one, or halved.
"""

from __future__ import annotations

import math

from fitball.models.compiled import compiled
from fitball.models.oscillator import damped_pair, series_value, shift_pair
from fitball.values import FloatArray

# Layout of a function's coefficient array.
VALUE, SLOPE, CURVE, BOUND, SIZE = 0, 5, 9, 13, 15
# Layout of the pole array: torsional pair, vertical pair.
TORSION, VERTICAL, POLES = 0, 4, 8
# Halvings after which an undecided interval is narrower than the rounding of its ends.
DEPTH = 56
NO_ZERO = -1.0
# `(C, S, envelope)` of the torsional pair, then of the vertical pair.
Basis = tuple[float, float, float, float, float, float]
AT_START: Basis = (1.0, 0.0, 1.0, 1.0, 0.0, 1.0)


@compiled
def fourth_derivative_bound(a: float, w2: float, b: float, c: float, s: float, span: float) -> float:
    """Bound of |d^4/dt^4 (c C + s S)| over its envelope, for times up to `span`."""
    if w2 * span * span > 1.0:
        return b * b * math.sqrt(c * c + s * s / w2)
    for _ in range(4):
        c, s = s - a * c, -w2 * c - a * s
    return abs(c) + abs(s) * span


@compiled
def prepare(c: FloatArray, poles: FloatArray, span: float) -> None:
    """Fill in derivatives and bounds behind the five value coefficients of `c`."""
    for pair in range(2):
        a, w2, b = poles[4 * pair], poles[4 * pair + 1], poles[4 * pair + 2]
        cc, ss = c[1 + 2 * pair], c[2 + 2 * pair]
        c[BOUND + pair] = fourth_derivative_bound(a, w2, b, cc, ss, span)
        cc, ss = ss - a * cc, -w2 * cc - a * ss
        c[SLOPE + 2 * pair] = cc
        c[SLOPE + 2 * pair + 1] = ss
        c[CURVE + 2 * pair] = ss - a * cc
        c[CURVE + 2 * pair + 1] = -w2 * cc - a * ss


@compiled
def prepare_series(c: FloatArray, n: int, h: float) -> float:
    """Bound of the fourth time derivative of a polynomial in `t/h` on [0, h]."""
    bound = 0.0
    for k in range(4, n):
        bound += abs(c[k]) * (k * (k - 1.0) * (k - 2.0) * (k - 3.0))
    return bound / h**4


@compiled
def basis_at(poles: FloatArray, t: float) -> Basis:
    """`(C, S, envelope)` of the torsional and of the vertical pair at time `t`."""
    p, q, e = damped_pair(poles[0], poles[1], poles[2], poles[3], t)
    r, s, g = damped_pair(poles[4], poles[5], poles[6], poles[7], t)
    return p, q, e, r, s, g


@compiled
def shifted(poles: FloatArray, basis: Basis, t: float) -> Basis:
    """The basis a short time `t` (of either sign) later, by the addition theorem; envelopes are left as they are."""
    p, q, e, r, s, g = basis
    c, d = shift_pair(poles[0], poles[1], poles[2], poles[3], t)
    u, v = shift_pair(poles[4], poles[5], poles[6], poles[7], t)
    return p * c - poles[1] * q * d, q * c + p * d, e, r * u - poles[5] * s * v, s * u + r * v, g


@compiled
def evaluate(
    c: FloatArray, basis: Basis, n: int, h: float, series_bound: float, t: float
) -> tuple[float, float, float, float]:
    """Value, slope, curvature at `t`, where the basis is `basis`, and a bound of the fourth derivative from `t` on.

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
def zero_free(order: int, f0: float, d0: float, f1: float, d1: float, h: float, error: float) -> bool:
    """Whether f > 0 on the interval is proved; `order` counts the zeros known to sit at its left end.

    Bernstein coefficients bound the Hermite cubic from below; `error` is max|f''''| h^4. The interpolation
    error `x^2 (1-x)^2 error/24` is divided by the same power of `x` as the cubic.
    """
    b1 = f0 + d0 * h / 3.0
    b2 = f1 - d1 * h / 3.0
    if order == 0:
        return min(min(f0, b1), min(b2, f1)) > error / 384.0
    if order == 1:
        return min(3.0 * b1, min(1.5 * b2, f1)) > error / 162.0
    return min(3.0 * b2, f1) > error / 24.0


@compiled
def falls_once(f0: float, d0: float, f1: float, d1: float, h: float, error: float) -> bool:
    """Whether f decreases throughout the interval is proved: then a sign change means one zero."""
    b0, b1, b2, b3 = f0, f0 + d0 * h / 3.0, f1 - d1 * h / 3.0, f1
    # The slope of the cubic is off by at most sqrt(3)/216 max|f''''| h^3.
    return 3.0 * max(b1 - b0, max(b2 - b1, b3 - b2)) < -error * 0.0080188


@compiled
def polish(
    c: FloatArray,
    poles: FloatArray,
    n: int,
    scale: float,
    left: float,
    f0: float,
    d0: float,
    right: float,
    f1: float,
    d1: float,
) -> tuple[float, Basis]:
    """The zero between `left` (f > 0) and `right` (f <= 0), to rounding: Halley, kept in the bracket.

    Returns it with the basis there (a series has none).
    """
    h = right - left
    # First guess: the zero of the Hermite cubic, by Newton from the secant.
    x = f0 / (f0 - f1)
    c2 = 3.0 * (f1 - f0) - (2.0 * d0 + d1) * h
    c3 = 2.0 * (f0 - f1) + (d0 + d1) * h
    for _ in range(3):
        slope = d0 * h + x * (2.0 * c2 + 3.0 * x * c3)
        if slope >= 0.0:
            break
        x -= (f0 + x * (d0 * h + x * (c2 + x * c3))) / slope
    if not 0.0 < x < 1.0:
        x = f0 / (f0 - f1)
    t = left + x * h
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
            basis = shifted(poles, basis, step)
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
    end_basis: Basis,
    stack: FloatArray,
) -> tuple[float, Basis]:
    """First time in (0, end] at which f, positive just after 0, falls to zero; NO_ZERO if there is none.

    Returns it with the basis there. `order` zeros are known to sit at 0 itself (0: f(0) > 0; 1: f' > 0 there;
    2: f'' > 0). `end_basis` is the basis at `end`, which a series does not need. `stack` is scratch of shape
    (DEPTH, 4).
    """
    left = 0.0
    f0, d0, _dd, m0 = evaluate(c, AT_START, n, scale, series_bound, 0.0)
    if order > 0:
        f0 = 0.0
    elif f0 <= 0.0:
        return 0.0, AT_START
    if order > 1:
        d0 = 0.0
    depth = 0
    right = end
    f1, d1, _dd, m1 = evaluate(c, end_basis, n, scale, series_bound, right)
    while True:
        h = right - left
        error = m0 * h * h * h * h
        if zero_free(order, f0, d0, f1, d1, h, error):
            crossed = False
        elif order == 0 and f1 <= 0.0 and falls_once(f0, d0, f1, d1, h, error):
            return polish(c, poles, n, scale, left, f0, d0, right, f1, d1)
        elif depth >= DEPTH - 1 or h <= 4.5e-16 * right:
            # Narrower than rounding can resolve: what the right end shows is all there is to know.
            crossed = f1 <= 0.0 and order == 0
            if crossed:
                return right, AT_START if n > 0 else basis_at(poles, right)
        else:
            stack[depth, 0], stack[depth, 1], stack[depth, 2], stack[depth, 3] = right, f1, d1, m1
            depth += 1
            right = left + 0.5 * h
            middle = AT_START if n > 0 else basis_at(poles, right)
            f1, d1, _dd, m1 = evaluate(c, middle, n, scale, series_bound, right)
            continue
        if depth == 0:
            return NO_ZERO, end_basis
        left, f0, d0, m0, order = right, f1, d1, m1, 0
        depth -= 1
        right, f1, d1, m1 = stack[depth, 0], stack[depth, 1], stack[depth, 2], stack[depth, 3]
