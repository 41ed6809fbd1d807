"""Laws of the coefficient of restitution in the vertical speed, as kernels."""

from __future__ import annotations

import math

from fitball.models.kernels.compiled import inner
from fitball.models.kernels.dual import Number, exp, log, log1p

# Speed at which every law has the value `cor_10` and the slope `cor_slope` [m/s].
ANCHOR_SPEED = 10.0
# Where the exponential of a double would overflow.
LARGE = 600.0


@inner
def saturating_restitution(cor_10: Number, cor_slope: Number, cap: Number, v_y: Number) -> Number:
    """A restitution within (0, `cap`) at every speed whose rebound speed `COR v_y` grows at every speed.

    With `e = COR/cap` it is `e = (1 + (v_y/v_0)^q)^(-1/q)`: near `cap` for a slow ball, and `v_y COR` tends to
    `cap v_0` for a fast one. `v_0` and `q` are such that value and slope at 10 m/s are `cor_10` and `cor_slope`. The
    share `w = -10 m/s cor_slope/cor_10` is the power of `1/v_y` as which COR falls at 10 m/s: it must be below 1. For
    a COR that rises, `w <= 0`, the odds of `e` are a power of `v_y`; both agree to first order in the slope.
    NaN where there is no such law: `cor_10 <= 0` or `w >= 1`. With `cor_10 >= cap`, `cor_10`.
    """
    e = cor_10 / cap
    w = -ANCHOR_SPEED * cor_slope / cor_10
    if not (e.real > 0.0 and w.real < 1.0):
        return math.nan + 0.0 * cor_10
    if e.real >= 1.0:
        return cor_10
    stretch = log(v_y / ANCHOR_SPEED)
    if w.real <= 0.0:
        return cap * e / (e + (1.0 - e) * exp(w / (1.0 - e) * stretch))
    q = log1p(-w) / log(e)
    x = q * stretch
    odds = w / (1.0 - w)
    growth = log1p(odds * exp(x)) if x.real < LARGE else x + log(odds)
    return cap * exp(-growth / q)
