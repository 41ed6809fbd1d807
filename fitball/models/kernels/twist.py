"""The twist between core and shell within one phase, and the functions whose first zero ends it, as kernels.

`th = theta_1 - theta_2` is a damped oscillator driven by the normal force (Jafri 2004, Eqs 11-19, 31 and 42-45, with
the initial conditions that continuity asks for). It is held in the basis of `oscillator`, or near resonance as a
Taylor series.
"""

from __future__ import annotations

import math

from fitball.models.kernels.compiled import compiled
from fitball.models.kernels.dual import Number, NumberArray, size, sqrt
from fitball.models.kernels.events import TORSION, VERTICAL, Basis, prepare, prepare_series
from fitball.models.kernels.oscillator import (
    NEAR_RESONANCE,
    SERIES_REACH,
    damped_pair,
    forced_response,
    resultant,
    series_free,
    series_length,
    series_response,
    series_value,
)
from fitball.values import FloatArray


@compiled
def twist_motion(
    th: float,
    rate: float,
    kappa: float,
    force: float,
    force_rate: float,
    poles: FloatArray,
    span: float,
    careful: bool,
    twist: FloatArray,
    drive: FloatArray,
) -> tuple[int, float]:
    """Solve for the twist in one phase that lasts at most `span`.

    Returns `(n, length)`. With `n = 0`, `twist[:4]` holds the coefficients in the basis of both pole pairs and
    `length` is `span`. Near resonance `twist[:n]` holds a Taylor series in `t/length`, `drive[:n]` that of the
    force, and `length` may be shorter than `span`: the phase is then solved in pieces. `careful` asks for the
    series, which loses nothing to cancellation just after the start.
    """
    a, w2, b = poles[TORSION], poles[TORSION + 1], poles[TORSION + 2]
    sigma, w2_force, b_force = poles[VERTICAL], poles[VERTICAL + 1], poles[VERTICAL + 2]
    span2 = span * span
    if not careful and resultant(a, w2, sigma, w2_force) * span2 * span2 > NEAR_RESONANCE:
        twist[0], twist[1], twist[2], twist[3] = forced_response(
            a, w2, sigma, w2_force, kappa, force, force_rate + sigma * force, th, rate
        )
        return 0, span
    pole = max(
        a + poles[TORSION + 3] if w2 < 0.0 else math.sqrt(b),
        sigma + poles[VERTICAL + 3] if w2_force < 0.0 else math.sqrt(b_force),
    )
    length = span if pole * span <= SERIES_REACH else SERIES_REACH / pole
    n = series_length(pole * length)
    series_free(force, force_rate + sigma * force, sigma, b_force, length, n, drive)
    series_response(a, b, kappa, drive, th, rate, length, n, twist)
    return n, length


@compiled
def twist_at(
    twist: NumberArray, poles: NumberArray, n: int, length: float, t: Number, basis: Basis[Number]
) -> tuple[Number, Number]:
    """Twist and its rate at time `t` of the phase, where the basis is `basis` (not needed by a series)."""
    if n > 0:
        th, rate, _ = series_value(twist, n, t / length)
        return th, rate / length
    p, q, _e, r, s, _g = basis
    a, w2, sigma, w2_force = poles[0], poles[1], poles[4], poles[5]
    th = twist[0] * p + twist[1] * q + twist[2] * r + twist[3] * s
    rate = (
        (twist[1] - a * twist[0]) * p
        - (w2 * twist[0] + a * twist[1]) * q
        + (twist[3] - sigma * twist[2]) * r
        - (w2_force * twist[2] + sigma * twist[3]) * s
    )
    return th, rate


@compiled
def vertical_after(
    poles: NumberArray, n: int, y: Number, y_rate: Number, elapsed: Number, basis: Basis[Number]
) -> tuple[Number, Number]:
    """Displacement and velocity of the core `elapsed` after they were `y`, `y_rate`."""
    sigma, b = poles[VERTICAL], poles[VERTICAL + 2]
    r, s = basis[3], basis[4]
    if n > 0:
        r, s, _envelope = damped_pair(sigma, poles[VERTICAL + 1], b, poles[VERTICAL + 3], elapsed)
    return y * r + (y_rate + sigma * y) * s, y_rate * r - (sigma * y_rate + b * y) * s


@compiled
def compose(
    constant: float,
    on_twist: float,
    on_rate: float,
    on_force: float,
    on_impulse: float,
    force: float,
    force_rate: float,
    momentum: float,
    poles: FloatArray,
    twist: FloatArray,
    drive: FloatArray,
    n: int,
    length: float,
    out: FloatArray,
) -> float:
    """Write `constant + on_twist th + on_rate th' + on_force F + on_impulse int F dt` into `out`.

    `momentum` is that of the core at the start of the phase, towards the court; the impulse is what it has
    lost since. Returns the bound of the sixth derivative where the function is a series.
    """
    if n > 0:
        for k in range(n):
            value = on_twist * twist[k] + on_force * drive[k]
            if k + 1 < n:
                value += on_rate * (k + 1) * twist[k + 1] / length
            if k > 0:
                value += on_impulse * drive[k - 1] * length / k
            out[k] = value
        out[0] += constant
        return prepare_series(out, n, length)
    a, w2, sigma, w2_force = poles[0], poles[1], poles[4], poles[5]
    out[0] = constant + on_impulse * momentum
    out[1] = on_twist * twist[0] + on_rate * (twist[1] - a * twist[0])
    out[2] = on_twist * twist[1] - on_rate * (w2 * twist[0] + a * twist[1])
    out[3] = on_twist * twist[2] + on_rate * (twist[3] - sigma * twist[2])
    out[3] += on_force * force - on_impulse * momentum
    out[4] = on_twist * twist[3] - on_rate * (w2_force * twist[2] + sigma * twist[3])
    out[4] += on_force * (force_rate + sigma * force) - on_impulse * (sigma * momentum - force)
    prepare(out, poles, length)
    return 0.0


@compiled
def pin(function: FloatArray, n: int, order: int) -> int:
    """Let the function be exactly zero at the start of its phase when `order` zeros are known to be there.

    The rounding of its constant would otherwise outweigh it for a while. Returns `order`.
    """
    if order > 0:
        function[0] = 0.0 if n > 0 else -(function[1] + function[3])
    return order


@compiled
def set_torsion(poles: NumberArray, stiffness: Number, damping: Number, compliance: Number, w2: Number) -> None:
    """Torsional poles for the relative compliance `1/I1 + 1/I_shell`; `w2` as given where it is known."""
    poles[TORSION] = 0.5 * damping * compliance
    poles[TORSION + 1] = w2
    poles[TORSION + 2] = stiffness * compliance
    poles[TORSION + 3] = sqrt(size(w2))


@compiled
def free_twist_rate(
    poles: NumberArray,
    stiffness: Number,
    damping: Number,
    compliance: Number,
    w2: Number,
    th: Number,
    rate: Number,
    t: Number,
) -> Number:
    """Rate of the twist after `t` seconds without ground force."""
    set_torsion(poles, stiffness, damping, compliance, w2)
    a = poles[TORSION]
    p, q, _envelope = damped_pair(a, w2, poles[TORSION + 2], poles[TORSION + 3], t)
    swing = rate + a * th
    after: Number = rate * p - (w2 * th + a * swing) * q
    return after
