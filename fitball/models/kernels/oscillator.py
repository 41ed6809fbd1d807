"""The damped oscillator and its response to an exponentially damped sinusoid, as kernels.

The motions of `x'' + 2 a x' + b x = 0` are spanned, with `w^2 = b - a^2`, by

    C(t) = exp(-a t) cos(w t),    S(t) = exp(-a t) sin(w t)/w,

which are entire in `w^2`: critical damping is no special case. A function of time is held by its coefficients in such
a basis; differentiation maps coefficients to coefficients. The plainest case is `y = v S(t)` (Jafri 2004, Eq. 2).

The response of one oscillator to another has a removable singularity where a pole of the one meets a
pole of the other. There the partial fractions cancel, and a Taylor series (`series_response`) takes over.
"""

from __future__ import annotations

from typing import Generic, NamedTuple

from fitball.models.kernels.compiled import inner
from fitball.models.kernels.dual import Number, NumberArray, cos, exp, magnitude, sin, sqrt


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
