"""Drop tests as labs write them: the height a ball is dropped from, and the height it rebounds to.

A ball at rest at a height h above the court arrives with v_y = sqrt(2 g h), one that leaves with v_y rises as high:
energy without air. Heights are those of the bottom of the ball, as ITF rules have it (100 inches).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fitball.data.columns import HEIGHTS, SD_SUFFIX
from fitball.data.findings import Findings
from fitball.data.number_column import NumberColumn
from fitball.data.redundancy import GROSS
from fitball.data.units import DEFAULT_UNIT, Dimension

# Standard gravity [m/s^2].
GRAVITY = 9.80665
# Dry air at 20 degrees Celsius and 1013 hPa [kg/m^3].
AIR_DENSITY = 1.204
# New tennis balls in free flight, 0.507 +- 0.024 (R. Cross and C. Lindsey, Sports Engineering 17 (2014) 89; wind
# tunnels have 0.6 and more: R. Mehta, F. Alam and A. Subic, Sports Technol. 1 (2008) 7).
DRAG_COEFFICIENT = 0.507
# Deceleration of a tennis ball by air over its speed squared [1/m]: only to tell how much is left out.
DRAG = AIR_DENSITY * DRAG_COEFFICIENT * np.pi * 0.033**2 / (2.0 * 0.0577)
SPEED_OF: Mapping[str, str] = dict(zip(HEIGHTS, ("v_y1", "v_y2"), strict=True))


def speeds_of_heights(columns: Mapping[str, NumberColumn], found: Findings) -> dict[str, NumberColumn]:
    """The columns with `v_y1` and `v_y2` in place of heights, sds propagated to first order (sd_v = g sd_h / v).

    A height beside a speed that was measured is only compared with it. Adds a fault for every height that is not
    positive, and for one that the speed beside it contradicts.
    """
    left = dict(columns)
    turned = []
    for name, speed in SPEED_OF.items():
        height = left.pop(name, None)
        sd = left.pop(name + SD_SUFFIX, None)
        if height is None:
            # An sd of nothing, which is a fault of the header.
            left |= {} if sd is None else {sd.name: sd}
            continue
        for k in np.flatnonzero(height.values <= 0.0).tolist():
            found.fault(f"read {height.shown(height.values[k])}; expected a positive height above the court", name, k)
        made = _speed(speed, height)
        if speed in columns:
            _compare(height, made, columns[speed], found)
            if sd is not None:
                found.notice(f"{sd.name} is not used: {speed} was measured", sd.name, speed)
            continue
        turned.append(name)
        left[speed] = made
        if sd is not None:
            left[speed + SD_SUFFIX] = replace(
                sd, name=speed + SD_SUFFIX, values=GRAVITY * sd.values / made.values, unit=made.unit, decimals=4
            )
    if turned:
        found.notice(
            f"{' and '.join(turned)} read as {' and '.join(SPEED_OF[name] for name in turned)} = sqrt(2 g h), "
            f"g = {GRAVITY} m/s^2, without air drag, h up to the bottom of the ball{_left_out(columns)}",
            *turned,
        )
    return left


def _left_out(columns: Mapping[str, NumberColumn]) -> str:
    """What drag would do to the restitution, to first order in heights: exp(k h / 2) falling, and as much rising."""
    if not all(name in columns and np.isfinite(columns[name].values).any() for name in HEIGHTS):
        return ""
    total = sum(float(np.nanmedian(columns[name].values)) for name in HEIGHTS)
    return f" (of a tennis ball drag would make the restitution some {50.0 * DRAG * total:.2g} % larger)"


def _speed(name: str, height: NumberColumn) -> NumberColumn:
    positive = np.where(height.values > 0.0, height.values, np.nan)
    values = np.sqrt(2.0 * GRAVITY * positive)
    with np.errstate(invalid="ignore"):
        slopes = GRAVITY / values
    half_width = height.half_width * float(np.nanmax(slopes, initial=0.0))
    unit = DEFAULT_UNIT[Dimension.SPEED]
    return replace(height, name=name, values=values, half_width=half_width, unit=unit, decimals=3)


def _compare(height: NumberColumn, made: NumberColumn, speed: NumberColumn, found: Findings) -> None:
    """Hold a height against the speed that was measured beside it; air drag makes the two differ by per cents."""
    found.notice(f"{height.name} is not used: {speed.name} is", height.name, speed.name)
    # A table may count v_y2 downwards, which is turned later; of a ball that stands no height is right.
    with np.errstate(divide="ignore"):
        excess = np.abs(made.values / np.abs(speed.values) - 1.0)
    for k in np.flatnonzero(excess > GROSS).tolist():
        found.fault(
            f"read {height.shown(height.values[k])}, which makes {made.values[k]:.4g} m/s, but {speed.name} is "
            f"{speed.values[k]:.4g} m/s; expected agreement: check the units and the row",
            height.name, k,
        )  # fmt: skip
