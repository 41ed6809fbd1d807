"""A drop test: restitution at the tested speeds and the rebound from 254 cm. Formulas and values, nothing of a
problem.

Without air a ball dropped from height h lands with `v = sqrt(2 g h)` and rises to `v^2/(2 g)`, so that a drop and its
rebound, both as heights, have the restitution `sqrt(h_2/h_1)`. Air takes part of it: with `k = rho c_d pi R^2/(2 M)`
a ball lands with `v^2 = (g/k) (1 - exp(-2 k h))` and rises to `ln(1 + k v^2/g)/(2 k)`. For a tennis ball from 254 cm
that is 2 % of the speed and 7 % of the rebound. Rebound heights that were turned into speeds without air and are
turned back without air come out as they were measured; speeds measured at the floor need the air.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitball.data.heights import AIR_DENSITY, BALL_TYPES, DRAG_COEFFICIENT, GRAVITY
from fitball.inference.results.quantiles import Spread
from fitball.values import Ball, FloatArray


@dataclass(frozen=True)
class TestedSpeed:
    """The restitution `cor` at a tested `speed` [m/s], the mean of so many `impacts` from `lowest` to `highest`;
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
    """Probabilities that a rebound lies within the limits of a type: that of the `mean` ball, of one more `ball` of
    the same make (None where balls cannot be told from noise), and of one more measured `drop`. None without draws.
    """

    mean: float | None
    ball: float | None
    drop: float | None


@dataclass(frozen=True)
class StandardRebound:
    """The rebound from 254 cm [m]: of the mean ball, `height`, and of one more measured drop, `drop`; `passing` is by
    type. `with_air` is the height if the speeds were measured at the floor, `passing_with_air` that of the stated
    type; if they were made from heights, restitutions are larger by `air_share` of themselves. `beyond` is by how
    much the landing speed [m/s] lies above (positive) or below the tested ones.
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

    Where repeats cannot tell the two apart `missing` says why, and there are no levels.
    """

    column: str
    between: Spread | None
    within: Spread | None
    levels: tuple[Level, ...]
    missing: str


@dataclass(frozen=True)
class DropTest:
    """Restitution at each tested speed, the rebound from 254 cm, and how balls differ, or `missing`: why there is
    none.

    `balls_counted` says that the restitutions take balls as a sample of their make, not impacts as independent.
    `from_heights` says that both speeds were made from heights, with `v = sqrt(2 g h)`. `shared_error` is by how much
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
