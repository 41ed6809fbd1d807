"""What laboratories rate, as formulas and values, nothing of a problem: the court pace of a fitted surface, and drop
tests.

ITF CS 01/02, "Court pace" (earlier CS 01/01), in *ITF Guide to Test Methods for Tennis Court Surfaces*. A ball hits
the court at 30 m/s and 16 degrees with hardly any spin. From its velocities follow `e = v_y2/v_y1`, `mu = (v_x1 -
v_x2)/(v_y1 (1 + e))` and the rating `100 (1 - mu) + 150 (0.81 - e_T)`.

That `mu` is the apparent one: the ratio of the impulses, the coefficient of sliding friction only while the ball
slides throughout. At 16 degrees it may grip, so the rating with the fitted coefficient is given beside it. The method
brings the restitution to 23 degrees Celsius, `e_T = e + 0.003 (23 - T)`. Where no ball temperature is known `e_T =
e`. It takes nine impacts at a place. The mean of all is the value of the court, the largest difference between
the means of places its variation (ITF Technical Booklet 2015, p. 40).

Without air a ball dropped from height h lands with `v = sqrt(2 g h)` and rises to `v^2/(2 g)`. A drop and its
rebound, both as heights, have the restitution `sqrt(h_2/h_1)`. Air takes part of it: with `k = rho c_d pi R^2/(2 M)`
a ball lands with `v^2 = (g/k) (1 - exp(-2 k h))` and rises to `ln(1 + k v^2/g)/(2 k)`. For a tennis ball from 254 cm
that is 2 % of the speed and 7 % of the rebound. Rebound heights that were turned into speeds without air and are
turned back without air come out as measured. Speeds measured at the floor need the air.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitball.data.heights import AIR_DENSITY, BALL_TYPES, DRAG_COEFFICIENT, GRAVITY
from fitball.inference.results.quantiles import Spread
from fitball.values import Ball, FloatArray, Impacts

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
    `omega_1` [rad/s]), if by more than `TOLERANCE`. `distance` [m/s] is that from every mixture of them, and counts
    from `slack` on. `lines` (COR, eps) are extrapolated beyond the vertical speeds of the table.
    """

    outside: bool
    beyond: Mapping[str, float]
    distance: float
    slack: float
    lines: tuple[str, ...]


@dataclass(frozen=True)
class PaceRating:
    """The rating of one surface, fitted to so many `impacts`; `labels` are its levels, if there are any.

    `friction` is the apparent one of the test impact. `sliding_friction` is the fitted coefficient, `sliding_rating`
    the rating by that. `categories` and `regimes` are probabilities, `slides` that of sliding throughout, among the
    draws that can be evaluated. `failed` is the share of the others. `saturated` is the probability that the ball
    grips in the test impact, or nearly. The model then gives all rougher courts the same rating.
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
    """A court as the mean of its tested places: so many `places`, labels of `column`, with the mean `rating`.

    `between` places and `within` one are standard deviations. `elsewhere` is the rating of a place that was not
    tested, None with fewer than five places. They are None where repeats do not separate them, and in a model, which
    has no repeats.
    `largest_difference` is that between places; `categories` are probabilities. `prior` is that of `between`, empty
    in a model.
    """

    column: str
    places: int
    rating: Spread
    elsewhere: Spread | None
    between: Spread | None
    within: Spread | None
    largest_difference: float | None
    categories: Mapping[str, float]
    prior: str = ""


@dataclass(frozen=True)
class PlaceRating:
    """One place of a court: its measured impacts, mean rating, friction and restitution as measured. The
    `rating` is beyond the noise of its repeats (None where places cannot be separated from that).
    """

    label: str
    impacts: int
    mean: float
    friction: float
    restitution: float
    rating: Spread | None


@dataclass(frozen=True)
class MeasuredPace:
    """The test as the ITF makes it, without a model. Of the `impacts` within its tolerances (among `total`) the
    rating of each, the mean of the court, and the places. `surface` is the label of the surface, if the table has
    several.
    """

    impacts: int
    total: int
    court: CourtMean
    places: tuple[PlaceRating, ...]
    remark: str
    surface: str = ""


@dataclass(frozen=True)
class CourtPace:
    """Ratings surface by surface, or `missing`: why there is none. `columns` are the label columns of the labels of
    each.

    `court` is the mean of the ratings of several places on one court. `measured` is that of the impacts themselves on
    each surface, where they are those of the test. `temperature` of the ball and its sd are in degrees Celsius;
    ratings are brought to 23 where it is known.
    """

    ratings: tuple[PaceRating, ...]
    missing: str
    temperature: float | None = None
    temperature_sd: float | None = None
    court: CourtMean | None = None
    measured: tuple[MeasuredPace, ...] = ()
    columns: tuple[str, ...] = ()

    @property
    def classes(self) -> tuple[CourtClass, ...]:
        """The classification of each surface: of the test's impacts as measured where there are any, else of the
        model.
        """
        stated = [_class(one.surface, one.court.rating, one.court.categories, True) for one in self.measured]
        known = {one.surface for one in self.measured}
        if self.court is not None:
            left = [] if known else [_class("", self.court.rating, self.court.categories, False)]
        else:
            left = [
                _class(", ".join(one.labels), one.rating, one.categories, False)
                for one in self.ratings
                if not known & {"", *one.labels}
            ]
        return (*stated, *left)


@dataclass(frozen=True)
class CourtClass:
    """The category of a `surface` with its probability, None without draws; `measured`: of the test's own impacts."""

    surface: str
    category: str
    probability: float | None
    measured: bool


def _class(surface: str, rating: Spread, categories: Mapping[str, float], measured: bool) -> CourtClass:
    name, share = max(categories.items(), key=lambda pair: pair[1])
    return CourtClass(surface, name, None if rating.median is None else share, measured)


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


@dataclass(frozen=True)
class TestedSpeed:
    """The restitution `cor` at a tested `speed` [m/s], the mean of so many `impacts` from `lowest` to `highest`.
    `measured` is the mean of their measured restitutions, `scatter` its standard deviation (None for one impact).
    """

    speed: float
    lowest: float
    highest: float
    impacts: int
    cor: Spread
    measured: float
    scatter: float | None


@dataclass(frozen=True)
class Passing:
    """Probabilities that a rebound is within the limits of a type, None without draws. `mean` is that of the
    mean, then of one more `ball` of the make, of one more measured `drop`. `ball` is None where
    balls cannot be separated from noise.
    """

    mean: float | None
    ball: float | None
    drop: float | None


@dataclass(frozen=True)
class StandardRebound:
    """The rebound from 254 cm [m]: `height` of the mean ball, and `drop`, of one more measured drop; `passing` is by
    type.

    `with_air` is the height if the speeds were measured at the floor, `passing_with_air` the probability for the
    stated type then. If the speeds were computed from heights, restitutions are larger by `air_share` of themselves.
    `beyond` is by how much the landing speed [m/s] lies above (positive) or below the tested ones.
    """

    speed: float
    height: Spread
    drop: Spread
    passing: Mapping[str, Passing]
    with_air: Spread
    passing_with_air: float | None
    air_share: float
    beyond: float


@dataclass(frozen=True)
class BallRebound:
    """One ball: its rebound from 254 cm [m] without measurement noise and the probability that it passes."""

    label: str
    impacts: int
    height: Spread
    passes: float


@dataclass(frozen=True)
class Level:
    """One label: so many `impacts`, their `mean` as measured, and `value`, what it is beyond their noise."""

    label: str
    impacts: int
    mean: float
    value: Spread


@dataclass(frozen=True)
class Variation:
    """A quantity over the labels of a `column`: standard deviations `between` labels and `within` one, and `levels`.

    Where repeats cannot separate the two, `missing` has the reason, and there are no levels. `prior` is that of
    `between`.
    """

    column: str
    between: Spread | None
    within: Spread | None
    levels: tuple[Level, ...]
    missing: str
    prior: str = ""


@dataclass(frozen=True)
class DropTest:
    """Restitution at each tested speed, the rebound from 254 cm, and how balls differ, or `missing`: why there is
    none.

    `balls_counted`: the restitutions take balls as a sample of their make, not impacts as independent.
    `from_heights`: both speeds were computed from heights, with `v = sqrt(2 g h)`. `shared_error` is by how much
    a restitution is off if the stated sd of `v_y1` is one error of all drops.
    """

    speeds: tuple[TestedSpeed, ...]
    rebound: StandardRebound | None
    ball_type: str
    type_stated: bool
    balls_counted: bool
    from_heights: bool
    variation: Variation | None
    balls: tuple[BallRebound, ...]
    shared_error: float | None
    temperature: float | None
    missing: str


def fall_speed(height: float) -> float:
    """Landing speed [m/s] from a height [m], without air."""
    return float(np.sqrt(2.0 * GRAVITY * height))


def rise_height(speed: FloatArray) -> FloatArray:
    """Height [m] that a ball of this speed [m/s] rises to, without air."""
    return np.asarray(speed**2 / (2.0 * GRAVITY))


def drag(ball: Ball) -> float:
    """Deceleration by air over the square of the speed [1/m]."""
    return AIR_DENSITY * DRAG_COEFFICIENT * float(np.pi) * ball.radius**2 / (2.0 * ball.mass)


def launch_speed_in_air(height: float, k: float) -> float:
    """Speed [m/s] from which a ball rises to a height [m] with drag `k` [1/m]."""
    return float(np.sqrt(GRAVITY / k * np.expm1(2.0 * k * height)))


def fall_speed_in_air(height: float, k: float) -> float:
    """Landing speed [m/s] from a height [m] with drag `k` [1/m]."""
    return float(np.sqrt(GRAVITY / k * -np.expm1(-2.0 * k * height)))


def rise_height_in_air(speed: FloatArray, k: float) -> FloatArray:
    """Height [m] that a ball of this speed [m/s] rises to with drag `k` [1/m]."""
    return np.asarray(np.log1p(k * speed**2 / GRAVITY) / (2.0 * k))


def share_within(heights: FloatArray, name: str) -> float:
    """Share of rebounds [m] within the limits of a type of ball."""
    limits, known = BALL_TYPES[name], heights[np.isfinite(heights)]
    return float(np.mean((known >= limits.lowest) & (known <= limits.highest)))
