"""The court pace rating of a fitted surface: formulas and values, nothing of a problem.

ITF CS 01/02, "Court pace" (earlier CS 01/01), in *ITF Guide to Test Methods for Tennis Court Surfaces*: a ball meets
the court at 30 m/s and 16 degrees with hardly any spin. From its velocities follow `e = v_y2/v_y1`,
`mu = (v_x1 - v_x2)/(v_y1 (1 + e))` and the rating `100 (1 - mu) + 150 (0.81 - e_T)`.

That `mu` is the apparent one: the ratio of the impulses, the coefficient of sliding friction only while the ball
slides throughout. At 16 degrees it may grip, so the rating with the fitted coefficient stands beside it. The method
brings the restitution to 23 degrees Celsius, `e_T = e + 0.003 (23 - T)`; where no ball temperature is known `e_T =
e`. It takes nine impacts at a place, the mean of all as the value of the court, and the largest difference between
the means of places as its variation (ITF Technical Booklet 2015, p. 40).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitball.inference.results.quantiles import Spread
from fitball.values import FloatArray, Impacts

TEST_SPEED = 30.0
TEST_ANGLE = float(np.radians(16.0))
SPEED_TOLERANCE = 2.0
# What the method allows: +-2 m/s, +-2 degrees, 3 revolutions a second. A table that ends nearer than this is no
# further from the test impact than one test impact from the next.
TOLERANCE: Mapping[str, float] = {
    "v_y1": SPEED_TOLERANCE * float(np.sin(TEST_ANGLE)),
    "theta_1": float(np.radians(2.0)),
    "omega_1": 6.0 * float(np.pi),
}
PACE_CONSTANT = 150.0
MEAN_RESTITUTION = 0.81
# What the method adds to a restitution for each degree Celsius that the ball was colder than 23, and the points of
# the rating that this is.
PER_DEGREE = 0.003
TEST_TEMPERATURE = 23.0
PER_KELVIN = PACE_CONSTANT * PER_DEGREE
# Whole ratings at which a category begins (ITF: up to 29, 30 to 34, 35 to 39, 40 to 44, from 45 on).
CATEGORIES = ("slow", "medium-slow", "medium", "medium-fast", "fast")
BEGINS = (30, 35, 40, 45)


@dataclass(frozen=True)
class Reach:
    """How far the test impact lies from the impacts on a surface.

    `beyond` is by how much it lies above (positive) or below (negative) their limits (`v_y1` [m/s], `theta_1` [rad],
    `omega_1` [rad/s]), named where that is more than `TOLERANCE`; `distance` [m/s] is that from every mixture of
    them, and counts from `slack` on. `lines` (COR, eps) are continued beyond the vertical speeds of the table.
    """

    outside: bool
    beyond: Mapping[str, float]
    distance: float
    slack: float
    lines: tuple[str, ...]


@dataclass(frozen=True)
class PaceRating:
    """The rating of one surface, fitted to so many `impacts`; `labels` are its levels, none where there are none.

    `friction` is the apparent one of the test impact; `sliding_friction` the fitted coefficient and `sliding_rating`
    what it would give. `categories` and `regimes` are probabilities, `slides` that of sliding throughout, all among
    the draws that can be evaluated; `failed` is the share of the others. `saturated` is the probability that the
    ball grips in the test impact, or nearly, in a model that then gives all rougher courts the same rating.
    """

    labels: tuple[str, ...]
    impacts: int
    rating: Spread
    friction: Spread
    restitution: Spread
    sliding_friction: Spread
    sliding_rating: Spread
    categories: Mapping[str, float]
    regimes: Mapping[str, float]
    slides: float
    failed: float
    reach: Reach
    saturated: float = 0.0


@dataclass(frozen=True)
class CourtMean:
    """A court as the mean of its tested places: so many `places`, labels of `column`; the mean `rating`; standard
    deviations `between` places and `within` one, and the rating `elsewhere`, of a place that was not tested (None
    where repeats do not tell them apart; a model has no repeats); the largest difference between places, and
    probabilities of the categories.
    """

    column: str
    places: int
    rating: Spread
    elsewhere: Spread | None
    between: Spread | None
    within: Spread | None
    largest_difference: float | None
    categories: Mapping[str, float]


@dataclass(frozen=True)
class PlaceRating:
    """One place of a court: its measured impacts, mean rating, friction and restitution as measured, and the
    `rating` beyond the noise of its repeats (None where places cannot be told from that).
    """

    label: str
    impacts: int
    mean: float
    friction: float
    restitution: float
    rating: Spread | None


@dataclass(frozen=True)
class MeasuredPace:
    """The test as the ITF makes it, no model between: of the `impacts` within its tolerances the rating of each, the
    mean of the court, and the places.
    """

    impacts: int
    of: int
    court: CourtMean
    places: tuple[PlaceRating, ...]
    remark: str


@dataclass(frozen=True)
class CourtPace:
    """Ratings surface by surface, or `missing`: why there is none.

    `court` is the mean of the ratings of several places on one court, `measured` that of the impacts themselves,
    where they are those of the test. `temperature` of the ball and its sd are in degrees Celsius; ratings are brought
    to 23 where it is known.
    """

    ratings: tuple[PaceRating, ...]
    missing: str
    temperature: float | None = None
    temperature_sd: float | None = None
    court: CourtMean | None = None
    measured: MeasuredPace | None = None


def itf_impact() -> Impacts:
    """The test impact, (1,)."""
    speed, angle = TEST_SPEED, TEST_ANGLE
    return Impacts.polar(speed, np.array([angle]), np.zeros(1))


def apparent_friction(v_x1: FloatArray, v_y1: FloatArray, v_x2: FloatArray, v_y2: FloatArray) -> FloatArray:
    """Horizontal over vertical impulse, `(v_x1 - v_x2)/(v_y1 (1 + e))`; velocities in m/s, any one shape."""
    return np.asarray((v_x1 - v_x2) / (v_y1 + v_y2))


def adjusted(restitution: FloatArray, temperature: FloatArray | float | None) -> FloatArray:
    """The restitution of a ball of that `temperature` [degrees Celsius] brought to 23; as it is without one."""
    if temperature is None:
        return restitution
    return np.asarray(restitution + PER_DEGREE * (TEST_TEMPERATURE - temperature))


def pace_rating(friction: FloatArray, restitution: FloatArray) -> FloatArray:
    """`100 (1 - mu) + 150 (0.81 - e_T)`; large is fast."""
    return np.asarray(100.0 * (1.0 - friction) + PACE_CONSTANT * (MEAN_RESTITUTION - restitution))


def pace_categories(rating: FloatArray) -> dict[str, float]:
    """Share of ratings (draws,) in each category, in the order of `CATEGORIES`.

    The ITF classes whole numbers, so a rating is rounded first (29.5 and more is 30).
    """
    place = np.searchsorted(BEGINS, np.floor(rating + 0.5), side="right")
    return {name: float(np.mean(place == k)) for k, name in enumerate(CATEGORIES)}
