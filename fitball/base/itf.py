"""Formulas and limits of the ITF (CS 01/02, TB 04/01, Rules of Tennis), pure.

Scenes, derived quantities, constants of the ball, `uses.lab` and pages meet here. Sources:
International Tennis Federation, *ITF Approved Tennis Balls, Classified Surfaces & Recognised
Courts: a guide to products and test methods* (TB 04/01 drop test, CS 01/02 court pace), and *Rules
of Tennis*, Appendices I and VI.
"""

from collections.abc import Mapping
from typing import Annotated

import numpy as np

from fitball.base.values import Ball, BoolArray, FloatArray, Impacts

# Standard gravity [m/s^2].
GRAVITY = 9.80665
# Drop height of TB 04/01, 100 inches [m].
DROP_HEIGHT = 2.54
# Lowest and highest rebound from 254 cm on smooth granite [m] by type of ball (2019 and later;
# until then type 1 had the limits of type 2).
BALL_TYPES: Mapping[str, tuple[float, float]] = {
    "type-1": (1.38, 1.51),
    "type-2": (1.35, 1.47),
    "type-3": (1.35, 1.47),
    "high-altitude": (1.22, 1.35),
    "stage-1": (1.20, 1.35),
    "stage-2": (1.05, 1.20),
    "stage-3": (0.90, 1.05),
    "stage-3-foam": (0.85, 1.05),
}
# Constants of a ball of types 1 and 2 [SI] that the rules allow (Appendix I: 56.0 to 59.4 g,
# diameter 6.54 to 6.86 cm).
BALL_TOLERANCES: Mapping[str, tuple[float, float]] = {
    "ball_mass": (0.0560, 0.0594),
    "ball_radius": (0.0327, 0.0343),
}
# The same of type 3, which is larger (diameter 7.00 to 7.30 cm).
_LARGE_BALL: Mapping[str, tuple[float, float]] = {
    "ball_mass": (0.0560, 0.0594),
    "ball_radius": (0.0350, 0.0365),
}
# The type of a ball of which none is stated.
USUAL_TYPE = "type-2"
# Mean rebounds [m] over which the ITF's ball rebound of a surface is preferred, as a share of that
# on smooth granite.
PREFERRED_REBOUND = 0.80
# Of a drop test (TB 04/01): balls of a sample, of stages 2 and 3 fewer, valid drops of each ball,
# and the temperature of the room [degrees Celsius] with its tolerance.
TESTED_BALLS = 24
TESTED_STAGE_BALLS = 12
DROPS_OF_A_BALL = 4
ROOM_TEMPERATURE = (20.0, 2.0)
# Of a court test (CS 01/02): impacts of a location, balls, and the range of mean temperatures of
# the balls [degrees Celsius].
PACE_IMPACTS = 9
PACE_BALLS = 3
PACE_BALL_TEMPERATURES = (10.0, 30.0)
# Radii [m] of tennis balls with wear and the errors of a picture.
_RADII = (0.030, 0.037)
# What CS 01/02 allows about its test impact: 2 m/s, 2 degrees, 3 revolutions a second.
PACE_TOLERANCES: Mapping[str, float] = {
    "v_1": 2.0,
    "theta_1": float(np.radians(2.0)),
    "omega_1": 6.0 * np.pi,
}
# Share of a limit that values may lie beyond it: they come from other units and components, which
# rounds them.
_ROUNDING = 1e-9
PACE_CATEGORIES = ("slow", "medium-slow", "medium", "medium-fast", "fast")
# Whole ratings at which the categories after the first begin (CS 01/02: up to 29, 30 to 34, 35 to
# 39, 40 to 44, from 45 on).
_BEGINS = (30.0, 35.0, 40.0, 45.0)
# Restitution of the mean ball in the rating of CS 01/02.
_MEAN_RESTITUTION = 0.81
# What restitution loses for each kelvin above the temperature of the test (CS 01/02).
_PER_KELVIN = 0.003
# Temperature of the test [degrees Celsius].
TEST_TEMPERATURE = 23.0


def is_tennis_radius(radius: float) -> bool:
    """Whether a radius [m] may be that of a tennis ball, worn or measured in a picture; its mass is
    not known.
    """
    return _RADII[0] <= radius <= _RADII[1]


def is_tennis_ball(ball: Ball) -> bool:
    """Whether mass and radius are within the rules, so that what is known of tennis balls holds."""
    return _is_within(ball, BALL_TOLERANCES)


def is_ball_of_type(ball: Ball, ball_type: str) -> bool:
    """Whether mass and radius are those of a type of BALL_TYPES. Of stage balls only the rebound is
    limited here: their masses and sizes were not found.
    """
    if ball_type.startswith("stage"):
        return True
    return _is_within(ball, _LARGE_BALL if ball_type == "type-3" else BALL_TOLERANCES)


def usual_radius(ball_type: str) -> float:
    """The radius [m] of a ball of which only the type is stated."""
    return sum(_LARGE_BALL["ball_radius"]) / 2.0 if ball_type == "type-3" else Ball().radius


def tested_balls(ball_type: str) -> int:
    """Balls of a sample that the drop test of a type takes."""
    few = ball_type.startswith(("stage-2", "stage-3"))
    return TESTED_STAGE_BALLS if few else TESTED_BALLS


def _is_within(ball: Ball, tolerances: Mapping[str, tuple[float, float]]) -> bool:
    """Whether mass and radius lie within tolerances, limits among them."""
    for constant, (low, high) in zip((ball.mass, ball.radius), tolerances.values(), strict=True):
        rounding = _ROUNDING * high
        if not low - rounding <= constant <= high + rounding:
            return False
    return True


def pace_impact() -> Impacts:
    """The impact of the court pace test: 30 m/s, 16 degrees, no spin."""
    speed = np.array([30.0])
    angle = np.radians(16.0)
    return Impacts(speed * np.cos(angle), speed * np.sin(angle), np.zeros(1))


def is_pace_impact(impacts: Impacts) -> BoolArray:
    """Which impacts (impacts,) are those of the court pace test, as far as it tolerates: limits
    count as within.
    """
    test = pace_impact()
    states = (*impacts.polar(), impacts.omega_1)
    nominal = (*test.polar(), test.omega_1)
    tolerated = np.ones(len(impacts), np.bool_)
    for state, value, tolerance in zip(states, nominal, PACE_TOLERANCES.values(), strict=True):
        tolerated &= np.abs(state - value) <= tolerance * (1.0 + _ROUNDING)
    return tolerated


def pace_rating(
    friction: Annotated[FloatArray, "..."],
    restitution: Annotated[FloatArray, "..."],
    temperature: float | None,
) -> Annotated[FloatArray, "..."]:
    """The rating of a court, `100 (1 - mu) + 150 (0.81 - e_T)` with `e_T = e + 0.003 (23 - T)`, T
    in degrees Celsius (None: 23) and the apparent friction `mu = (v_x1 - v_x2)/(v_y1 + v_y2)`, by
    CS 01/02.
    """
    colder = 0.0 if temperature is None else TEST_TEMPERATURE - temperature
    corrected = restitution + _PER_KELVIN * colder
    return np.asarray(100.0 * (1.0 - friction) + 150.0 * (_MEAN_RESTITUTION - corrected))


def pace_categories(rating: Annotated[FloatArray, "draws"]) -> dict[str, float]:
    """Share of ratings, rounded first, in slow, medium-slow, medium, medium-fast, fast."""
    # Half a point counts up.
    places = np.searchsorted(_BEGINS, np.floor(rating + 0.5), side="right")
    return {name: float(np.mean(places == k)) for k, name in enumerate(PACE_CATEGORIES)}
