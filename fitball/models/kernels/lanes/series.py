"""Twist, force and contact functions of lanes near resonance as Taylor series; see `oscillator`.

Each lane has its own number of terms and zeros behind them, so that what its neighbours need leaves it alone.
"""

from __future__ import annotations

from fitball.models.kernels.compiled import inner
from fitball.models.kernels.dual import choose
from fitball.models.kernels.lanes.vector import Lanes, Mask, largest
from fitball.models.kernels.lanes.zeros import LaneScratch
from fitball.models.kernels.oscillator import series_length
from fitball.models.kernels.quantities import Load, Oscillators, Weights


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
