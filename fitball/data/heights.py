"""Drop tests as labs write them: heights of drop and rebound. The limits of the ITF's types of ball are for a drop
from 254 cm (100 inches) on smooth granite.

A ball at rest at a height h above the court arrives with v_y = sqrt(2 g h), one that leaves with v_y rises as high:
energy without air. Heights are those of the bottom of the ball, as ITF rules have it.

International Tennis Federation, *ITF Approved Tennis Balls, Classified Surfaces & Recognised Courts: a guide to
products and test methods* (ITF Technical Booklet; test method ITF TB 04/01), and *Rules of Tennis*, Appendices I and
VI. Limits of 2019 and later; until then those of type 1 were 135 to 147 cm, as those of type 2.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fitball.data.cells import Findings
from fitball.data.columns import COLUMNS, HEIGHTS, SD_SUFFIX
from fitball.data.numbers import Columns, NumberColumn
from fitball.data.units import DEFAULT_UNIT, Dimension
from fitball.values import Ball

# Standard gravity [m/s^2].
GRAVITY = 9.80665
# Dry air at 20 degrees Celsius and 1013 hPa [kg/m^3].
AIR_DENSITY = 1.204
# New tennis balls in free flight, 0.507 +- 0.024 (R. Cross and C. Lindsey, Sports Engineering 17 (2014) 89; wind
# tunnels have 0.6 and more: R. Mehta, F. Alam and A. Subic, Sports Technol. 1 (2008) 7).
DRAG_COEFFICIENT = 0.507
# Deceleration of a tennis ball by air over its speed squared [1/m]: only to tell how much is left out.
DRAG = AIR_DENSITY * DRAG_COEFFICIENT * np.pi * 0.033**2 / (2.0 * 0.0577)
# No averaging or misprint of a late digit explains this much: a unit or a column is wrong.
GROSS = 0.2
SPEED_OF: Mapping[str, str] = {name: f"v_y{COLUMNS[name].end}" for name in HEIGHTS}


def speeds_of_heights(columns: Columns, found: Findings) -> Columns:
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
            found.fault(f"read {height.text(k)}; expected a positive height above the court", name, k)
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
            f"g = {GRAVITY} m/s^2, without air drag, with h at the bottom of the ball{_left_out(columns)}",
            *turned,
        )
    return left


def _left_out(columns: Columns) -> str:
    """What drag would do to the restitution, to first order in heights: exp(k h / 2) falling, and as much rising."""
    if not all(name in columns and np.isfinite(columns[name].values).any() for name in HEIGHTS):
        return ""
    total = sum(float(np.nanmedian(columns[name].values)) for name in HEIGHTS)
    return f" (with the air drag of a tennis ball, restitution would be about {50.0 * DRAG * total:.2g} % larger)"


def _speed(name: str, height: NumberColumn) -> NumberColumn:
    positive = np.where(height.values > 0.0, height.values, np.nan)
    values = np.sqrt(2.0 * GRAVITY * positive)
    with np.errstate(invalid="ignore"):
        slopes = GRAVITY / values
    half_width = height.half_width * float(np.nanmax(slopes, initial=0.0))
    unit = DEFAULT_UNIT[Dimension.SPEED]
    return replace(height, name=name, values=values, half_width=half_width, unit=unit, decimals=3)


def _compare(height: NumberColumn, made: NumberColumn, speed: NumberColumn, found: Findings) -> None:
    """Compare a height with the speed that was measured too; air drag makes a difference of some per cent."""
    found.notice(f"{height.name} is not used, since {speed.name} was measured", height.name, speed.name)
    # A table may count v_y2 downwards, which is turned later; of a ball that stands no height is right.
    with np.errstate(divide="ignore"):
        excess = np.abs(made.values / np.abs(speed.values) - 1.0)
    for k in np.flatnonzero(excess > GROSS).tolist():
        found.fault(
            f"read {height.text(k)}, which gives {made.values[k]:.4g} m/s, but {speed.name} is "
            f"{speed.values[k]:.4g} m/s; expected agreement: check the units and the row",
            height.name, k,
        )  # fmt: skip


SOURCE = "ITF Approved Tennis Balls, Classified Surfaces & Recognised Courts, test method ITF TB 04/01"
DROP_HEIGHT = 2.54
DEFAULT_TYPE = "type-2"
# What the booklet asks of the room in which balls lie for 24 hours and are tested [degrees Celsius].
TEST_TEMPERATURE = 20.0
# Mass [kg] and radius [m] of tennis balls of all types, those of foam among them (Appendix I), with room for wear and
# for a gauge that is off.
MASSES, RADII = (0.024, 0.062), (0.0295, 0.0455)
# Tolerances of mass [kg] and radius [m] of a ball of types 1 and 2 (Appendix I: 56.0 to 59.4 g, 6.54 to 6.86 cm).
ITF_LIMITS: Mapping[str, tuple[float, float]] = {"mass": (0.0560, 0.0594), "radius": (0.0327, 0.0343)}


@dataclass(frozen=True)
class BallType:
    """A type of ball: `words` as people call it, lowest and highest rebound from `DROP_HEIGHT` [m]."""

    name: str
    words: str
    lowest: float
    highest: float


_ALL = (
    BallType("type-1", "type 1 (fast)", 1.38, 1.51),
    BallType("type-2", "type 2 (medium)", 1.35, 1.47),
    BallType("type-3", "type 3 (slow)", 1.35, 1.47),
    BallType("high-altitude", "high altitude", 1.22, 1.35),
    BallType("stage-1", "stage 1 (green)", 1.20, 1.35),
    BallType("stage-2", "stage 2 (orange)", 1.05, 1.20),
    BallType("stage-3", "stage 3 (red)", 0.90, 1.05),
    BallType("stage-3-foam", "stage 3 (red, foam)", 0.85, 1.05),
)
BALL_TYPES: Mapping[str, BallType] = {item.name: item for item in _ALL}


def like_tennis(ball: Ball) -> bool:
    """Whether a ball is one that the ITF's tests are made for, by its mass and size."""
    return MASSES[0] <= ball.mass <= MASSES[1] and RADII[0] <= ball.radius <= RADII[1]
