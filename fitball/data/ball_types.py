"""The ITF's types of tennis ball and how high each may rebound from 254 cm (100 inches) off smooth granite.

International Tennis Federation, *ITF Approved Tennis Balls, Classified Surfaces & Recognised Courts: a guide to
products and test methods* (ITF Technical Booklet; test method ITF TB 04/01), and *Rules of Tennis*, Appendices I and
VI. Limits of 2019 and later; until then those of type 1 were 135 to 147 cm, as those of type 2.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fitball.values import Ball

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
