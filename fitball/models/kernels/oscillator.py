"""The damped oscillator and its response to an exponentially damped sinusoid, as kernels.

An oscillator `x'' + 2 a x' + b x = 0` is held as the pole pair `(a, w2, b, w)` with
`w2 = b - a^2` (negative when overdamped) and `w = sqrt(|w2|)`. Its motions are spanned by

    C(t) = exp(-a t) cos(w t),    S(t) = exp(-a t) sin(w t)/w,

which are entire in `w2`: critical damping is no special case. A function of time is held by its
coefficients in such a basis; differentiation maps coefficients to coefficients.

The response of one oscillator to another has a removable singularity where a pole of the one meets a
pole of the other. There the partial fractions cancel, and a Taylor series (`series_response`) takes over.
"""

from __future__ import annotations

from fitball.models.kernels.compiled import compiled
from fitball.models.kernels.dual import Number, NumberArray, cos, exp, sin

# |w2| t^2 below which sin(wt)/w is summed as a series; five terms leave an error of 3e-18.
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


@compiled
def damped_pair(a: Number, w2: Number, b: Number, w: Number, t: Number) -> tuple[Number, Number, Number]:
    """Return `(C, S, envelope)` at time `t`, where `envelope` bounds exp(-a t) times any cos or cosh."""
    x = w2 * t * t
    if x.real > SMALL_PHASE:
        envelope = exp(-a * t)
        return envelope * cos(w * t), envelope * sin(w * t) / w, envelope
    if x.real < -SMALL_PHASE:
        # a - w by way of the product of the poles, because the difference cancels when overdamped.
        slow = exp(-b / (a + w) * t)
        fast = exp(-(a + w) * t)
        return 0.5 * (slow + fast), 0.5 * (slow - fast) / w, slow
    envelope = exp(-a * t)
    cosine = 1.0 - x * (1.0 / 2 - x * (1.0 / 24 - x * (1.0 / 720 - x * (1.0 / 40320))))
    sine = 1.0 - x * (1.0 / 6 - x * (1.0 / 120 - x * (1.0 / 5040 - x * (1.0 / 362880))))
    # An overdamped pair in this branch grows by at most cosh(0.1) over its envelope.
    return envelope * cosine, envelope * t * sine, envelope * 1.01


@compiled
def shift_pair(a: float, w2: float, b: float, w: float, t: float) -> tuple[float, float]:
    """`(C, S)` at a short time `t` of either sign: by short series where `damped_pair` would call three functions."""
    u = a * t
    x = w2 * t * t
    if abs(u) > SMALL_DECAY or abs(x) > SMALL_PHASE:
        cosine, sine, _envelope = damped_pair(a, w2, b, w, t)
        return cosine, sine
    decay = 1.0 - u * (1.0 - u * (1.0 / 2 - u * (1.0 / 6 - u * (1.0 / 24 - u * (1.0 / 120 - u * (1.0 / 720))))))
    cosine = 1.0 - x * (1.0 / 2 - x * (1.0 / 24 - x * (1.0 / 720 - x * (1.0 / 40320))))
    sine = 1.0 - x * (1.0 / 6 - x * (1.0 / 120 - x * (1.0 / 5040 - x * (1.0 / 362880))))
    return decay * cosine, decay * t * sine


@compiled
def resultant(a: float, w2: float, sigma: float, w2_force: float) -> float:
    """Product of the differences between the two pole pairs, free of cancellation [1/s^4]."""
    gap = a - sigma
    rho = gap * gap + (w2 - w2_force)
    return rho * rho + 4.0 * gap * gap * w2_force


@compiled
def forced_response(
    a: Number,
    w2: Number,
    sigma: Number,
    w2_force: Number,
    kappa: Number,
    force_c: Number,
    force_s: Number,
    x0: Number,
    v0: Number,
) -> tuple[Number, Number, Number, Number]:
    """Solve `x'' + 2 a x' + b x = kappa (force_c C_f + force_s S_f)`, `x(0) = x0`, `x'(0) = v0`.

    Returns `(h_c, h_s, p_c, p_s)` with `x = h_c C + h_s S + p_c C_f + p_s S_f`, by partial fractions:
    the caller keeps away from resonance.
    """
    gap = a - sigma
    rho = gap * gap + (w2 - w2_force)
    alpha = 2.0 * gap
    scale = kappa / (rho * rho + alpha * alpha * w2_force)
    p_c = (rho * force_c - alpha * force_s) * scale
    p_s = (rho * force_s + alpha * w2_force * force_c) * scale
    h_c = x0 - p_c
    h_s = v0 + sigma * p_c - p_s + a * h_c
    return h_c, h_s, p_c, p_s


@compiled
def series_length(reach: float) -> int:
    """Number of Taylor terms after which the rest is below 1e-17 for `|pole| * time <= reach`."""
    return min(SERIES_LENGTH, 13 + int(7.0 * reach))


@compiled
def series_free(c0: Number, s0: Number, sigma: Number, omega2: Number, h: float, n: int, out: NumberArray) -> None:
    """Taylor coefficients in `t/h` of `c0 C + s0 S` for the pair with decay `sigma` and `b = omega2`."""
    out[0] = c0
    out[1] = (s0 - sigma * c0) * h
    for k in range(n - 2):
        out[k + 2] = -(2.0 * sigma * h * (k + 1) * out[k + 1] + omega2 * h * h * out[k]) / ((k + 1) * (k + 2))


@compiled
def series_response(
    a: Number,
    b: Number,
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
        pull = kappa * force[k] - b * out[k]
        out[k + 2] = (h * h * pull - 2.0 * a * h * (k + 1) * out[k + 1]) / ((k + 1) * (k + 2))


@compiled
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
