"""The damped oscillator, its response to an exponentially damped sinusoid, and the first zero of what both make, as
kernels.

The motions of `x'' + 2 a x' + b x = 0` are spanned, with `w^2 = b - a^2`, by

    C(t) = exp(-a t) cos(w t),    S(t) = exp(-a t) sin(w t)/w,

which are entire in `w^2`: critical damping is no special case. A function of time is held by its coefficients in such
a basis; differentiation maps coefficients to coefficients. The plainest case is `y = v S(t)` (Jafri 2004, Eq. 2).

The response of one oscillator to another has a removable singularity where a pole of the one equals a pole of the
other. There the partial fractions cancel, and a Taylor series (`series_response`) takes over.

The first zero of a contact function is certified: no earlier zero is missed, however close a pair.
A contact function (slip `v_x - R omega_2`, or the margin `mu F -+ F_x` of the friction cone) is

    f(t) = c0 + A1 C(t) + A2 S(t) + B1 C_f(t) + B2 S_f(t)

with the swings of the torsional and the vertical oscillator, or near resonance a polynomial. Between
two times the quintic through values, slopes and curvatures at both is off by at most `max|f6| h^6/46080`, its slope
by `max|f6| h^5 sqrt(5)/30000` (Birkhoff and Priver 1967), and the sixth derivative `f6` is bounded in closed form;
so an interval is either proved free of zeros, proved to hold exactly one, or halved.
"""

from __future__ import annotations

import math
from typing import Generic, NamedTuple

from fitball.models.kernels.compiled import inner
from fitball.models.kernels.dual import Number, NumberArray, choose, cos, exp, magnitude, sin, sqrt
from fitball.values import FloatArray


class Oscillator(NamedTuple, Generic[Number]):
    """`x'' + 2 decay x' + natural_squared x = 0`: `damped_squared = natural_squared - decay^2`, negative when
    overdamped; `frequency = sqrt(|damped_squared|)` [1/s].
    """

    decay: Number
    damped_squared: Number
    natural_squared: Number
    frequency: Number


class Oscillators(NamedTuple, Generic[Number]):
    """The twist of core against shell, and the vertical motion that drives it."""

    torsion: Oscillator[Number]
    vertical: Oscillator[Number]


class Swing(NamedTuple, Generic[Number]):
    """An oscillator's `C = exp(-a t) cos(w t)` and `S = exp(-a t) sin(w t)/w` [s] at a time, and a bound of `C`.

    Overdamped, `envelope` and `fast` are the exponentials of the two poles, their mean is `C`; else `fast` is idle.
    """

    cosine: Number
    sine: Number
    envelope: Number
    fast: Number


class Basis(NamedTuple, Generic[Number]):
    """The swings of both oscillators at one time."""

    torsion: Swing[Number]
    vertical: Swing[Number]


class Series(NamedTuple):
    """How the functions of one piece are held: in the basis if `terms` is 0, else as that many Taylor terms in
    `t/length`; `length` [s] is how long they are good for.
    """

    terms: int
    length: float


# |w^2| t^2 below which sin(wt)/w is summed as a series; five terms leave an error of 3e-18.
SMALL_PHASE = 0.01
# |a t| below which exp(-a t) is summed as a series; seven terms leave an error of 3e-16 times 1e-2.
SMALL_DECAY = 0.02
# Below this resultant (times time^4) a torsional pole is within about 0.3/time of a vertical one and
# partial fractions would lose more than a digit.
NEAR_RESONANCE = 4.0
# Longest |pole| * time over which the series is summed: its largest term is then below e^4, so that
# rounding stays below 1e-14 of the motion's scale.
SERIES_REACH = 4.0
SERIES_LENGTH = 44


@inner
def oscillator(decay: Number, damped_squared: Number, natural_squared: Number) -> Oscillator[Number]:
    """An oscillator whose squared frequencies are both known."""
    return Oscillator(decay, damped_squared, natural_squared, sqrt(magnitude(damped_squared)))


@inner
def swing_at(o: Oscillator[Number], t: Number) -> Swing[Number]:
    """The oscillator's swing at time `t`."""
    x = o.damped_squared * t * t
    if x.real > SMALL_PHASE:
        envelope = exp(-o.decay * t)
        sine = envelope * sin(o.frequency * t) / o.frequency
        return Swing(envelope * cos(o.frequency * t), sine, envelope, 0.0 * envelope)
    if x.real < -SMALL_PHASE:
        # a - w by way of the product of the poles, because the difference cancels when overdamped.
        slow = exp(-o.natural_squared / (o.decay + o.frequency) * t)
        fast = exp(-(o.decay + o.frequency) * t)
        return Swing(0.5 * (slow + fast), 0.5 * (slow - fast) / o.frequency, slow, fast)
    envelope = exp(-o.decay * t)
    cosine, sine = short_phase(x)
    # An overdamped pair in this branch grows by at most exp(0.1) over its envelope, and neither pole is far from it.
    return Swing(envelope * cosine, envelope * t * sine, envelope * 1.11, envelope)


@inner
def short_phase(x: Number) -> tuple[Number, Number]:
    """`cos(wt)` and `sin(wt)/(wt)` for `x = w^2 t^2` of either sign within `SMALL_PHASE`."""
    cosine = 1.0 - x * (1.0 / 2 - x * (1.0 / 24 - x * (1.0 / 720 - x * (1.0 / 40320))))
    sine = 1.0 - x * (1.0 / 6 - x * (1.0 / 120 - x * (1.0 / 5040 - x * (1.0 / 362880))))
    return cosine, sine


@inner
def shift_swing(o: Oscillator[float], swing: Swing[float], t: float) -> Swing[float]:
    """The swing a short time `t` (of either sign) later, by the addition theorem; the bounds are left as they are.

    Short series take the place of the three functions that `swing_at` would call.
    """
    if abs(o.decay * t) > SMALL_DECAY or abs(o.damped_squared * t * t) > SMALL_PHASE:
        step = swing_at(o, t)
        return joined_swing(o, swing, step.cosine, step.sine)
    c, s = short_swing(o, t)
    return joined_swing(o, swing, c, s)


@inner
def short_swing(o: Oscillator[Number], t: Number) -> tuple[Number, Number]:
    """`C` and `S` a time `t` from 0 that is within `SMALL_DECAY` and `SMALL_PHASE`."""
    u = o.decay * t
    x = o.damped_squared * t * t
    decay = 1.0 - u * (1.0 - u * (1.0 / 2 - u * (1.0 / 6 - u * (1.0 / 24 - u * (1.0 / 120 - u * (1.0 / 720))))))
    cosine, sine = short_phase(x)
    return decay * cosine, decay * t * sine


@inner
def joined_swing(o: Oscillator[Number], swing: Swing[Number], c: Number, s: Number) -> Swing[Number]:
    """The swing a step later of which `C` and `S` are `c` and `s`; the envelope is left as it is."""
    return Swing(
        swing.cosine * c - o.damped_squared * swing.sine * s,
        swing.sine * c + swing.cosine * s,
        swing.envelope,
        swing.fast,
    )


@inner
def resultant(oscillators: Oscillators[Number]) -> Number:
    """Product of the differences between the two pole pairs, free of cancellation [1/s^4]."""
    torsion, vertical = oscillators.torsion, oscillators.vertical
    gap = torsion.decay - vertical.decay
    rho = gap * gap + (torsion.damped_squared - vertical.damped_squared)
    return rho * rho + 4.0 * gap * gap * vertical.damped_squared


@inner
def forced_response(
    oscillators: Oscillators[Number],
    kappa: Number,
    force_c: Number,
    force_s: Number,
    x0: Number,
    v0: Number,
    out: NumberArray,
) -> None:
    """Solve `x'' + 2 a x' + b x = kappa (force_c C_f + force_s S_f)`, `x(0) = x0`, `x'(0) = v0` for the torsion.

    Writes `(h_c, h_s, p_c, p_s)` with `x = h_c C + h_s S + p_c C_f + p_s S_f` into `out`, by partial fractions: the
    caller keeps away from resonance.
    """
    torsion, vertical = oscillators.torsion, oscillators.vertical
    gap = torsion.decay - vertical.decay
    rho = gap * gap + (torsion.damped_squared - vertical.damped_squared)
    alpha = 2.0 * gap
    scale = kappa / (rho * rho + alpha * alpha * vertical.damped_squared)
    p_c = (rho * force_c - alpha * force_s) * scale
    p_s = (rho * force_s + alpha * vertical.damped_squared * force_c) * scale
    h_c = x0 - p_c
    out[0], out[2], out[3] = h_c, p_c, p_s
    out[1] = v0 + vertical.decay * p_c - p_s + torsion.decay * h_c


@inner
def series_length(reach: float) -> int:
    """Number of Taylor terms after which the rest is below 1e-17 for `|pole| * time <= reach`."""
    return min(SERIES_LENGTH, 13 + int(7.0 * reach))


@inner
def series_free(c0: Number, s0: Number, o: Oscillator[Number], h: float, n: int, out: NumberArray) -> None:
    """Taylor coefficients in `t/h` of `c0 C + s0 S`."""
    out[0] = c0
    out[1] = (s0 - o.decay * c0) * h
    for k in range(n - 2):
        pull = 2.0 * o.decay * h * (k + 1) * out[k + 1] + o.natural_squared * h * h * out[k]
        out[k + 2] = -pull / ((k + 1) * (k + 2))


@inner
def series_response(
    o: Oscillator[Number],
    kappa: Number,
    force: NumberArray,
    x0: Number,
    v0: Number,
    h: float,
    n: int,
    out: NumberArray,
) -> None:
    """Taylor coefficients in `t/h` of the response to `kappa * force`, itself given in that form."""
    out[0] = x0
    out[1] = v0 * h
    for k in range(n - 2):
        pull = kappa * force[k] - o.natural_squared * out[k]
        out[k + 2] = (h * h * pull - 2.0 * o.decay * h * (k + 1) * out[k + 1]) / ((k + 1) * (k + 2))


@inner
def series_value(c: NumberArray, n: int, x: Number) -> tuple[Number, Number, Number]:
    """Value and first two derivatives with respect to `x` of the polynomial with coefficients `c`."""
    f: Number = c[n - 1]
    d = 0.0 * x
    dd = 0.0 * x
    for k in range(n - 2, -1, -1):
        dd = dd * x + d
        d = d * x + f
        f = f * x + c[k]
    return f, d, 2.0 * dd


AT_START: Basis[float] = Basis(Swing(1.0, 0.0, 1.0, 1.0), Swing(1.0, 0.0, 1.0, 1.0))


@inner
def basis_at(oscillators: Oscillators[Number], t: Number) -> Basis[Number]:
    """The swings of both oscillators at time `t`."""
    return Basis(swing_at(oscillators.torsion, t), swing_at(oscillators.vertical, t))


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
