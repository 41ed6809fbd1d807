"""The court pace test as the ITF makes it: the rating of each measured impact, places on the court, their mean.

No model stands between: impacts within the tolerances of the test (30 +- 2 m/s, 16 +- 2 degrees, at most 3
revolutions a second) are rated as they were measured.
"""

from __future__ import annotations

import numpy as np

from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.inference.prediction.one_way import DRAWS, one_way, plain_mean
from fitball.inference.results.pace_rating import (
    PER_KELVIN,
    SPEED_TOLERANCE,
    TEST_ANGLE,
    TEST_SPEED,
    TOLERANCE,
    CourtMean,
    MeasuredPace,
    PlaceRating,
    adjusted,
    apparent_friction,
    pace_categories,
    pace_rating,
)
from fitball.inference.results.quantiles import spread_of
from fitball.values import FloatArray

# Label columns that may name places on a court, the surest first.
PLACES = ("location", "group")
# Fewer impacts say nothing of their scatter.
LEAST = 3


def temperatures(scene: Scene, draws: int, rng: np.random.Generator) -> FloatArray:
    """The temperature of the ball (draws,) [degrees Celsius] with its error; zeros where none is known."""
    return (scene.ball_temperature or 0.0) + (scene.ball_temperature_sd or 0.0) * rng.standard_normal(draws)


def measured_pace(table: ImpactTable, scene: Scene, rng: np.random.Generator) -> MeasuredPace | None:
    """The rating of the impacts that are those of the test; None where fewer than three of them are, or where they
    are on several surfaces, of which there is no mean.
    """
    if len(set(table.labels.get("surface", ()))) > 1:
        return None
    impacts = table.impacts
    v_x2, v_y2 = _rebound(table)
    speed, angle = impacts.speed, impacts.angle
    valid = (
        (np.abs(speed - TEST_SPEED) <= SPEED_TOLERANCE)
        & (np.abs(angle - TEST_ANGLE) <= TOLERANCE["theta_1"])
        & (np.abs(impacts.omega_1) <= TOLERANCE["omega_1"])
        & np.isfinite(v_x2 + v_y2)
    )
    rows = np.flatnonzero(valid)
    if rows.size < LEAST:
        return None
    friction = apparent_friction(impacts.v_x1[rows], impacts.v_y1[rows], v_x2[rows], v_y2[rows])
    restitution = v_y2[rows] / impacts.v_y1[rows]
    rating = pace_rating(friction, adjusted(restitution, scene.ball_temperature))
    column = next((name for name in PLACES if len(set(table.labels.get(name, ()))) > 1), "")
    named = [table.labels[column][k] for k in rows] if column else [""] * rows.size
    labels = tuple(dict.fromkeys(named))
    index = np.array([labels.index(name) for name in named], dtype=np.int64)
    between = elsewhere = levels = None
    remark = ""
    found = one_way(rating, np.ones((rating.size, 1)), index, rng) if len(labels) > 1 else ""
    if isinstance(found, str):
        mean, within = plain_mean(rating, rng)
        remark = found and f"differences between places are not told from noise: {found}"
    else:
        elsewhere = found.coefficients[:, 0] + found.between * rng.standard_normal(DRAWS)
        mean, within = found.levels @ (np.bincount(index) / index.size), found.within
        between, levels = found.between, found.levels
    # The thermometer's error is one for all impacts.
    warm = PER_KELVIN * (scene.ball_temperature_sd or 0.0) * rng.standard_normal(DRAWS)
    means = np.array([rating[index == k].mean() for k in range(len(labels))])
    court = CourtMean(
        column=column,
        places=len(labels),
        rating=spread_of(mean + warm, float(rating.mean())),
        elsewhere=None if elsewhere is None else spread_of(elsewhere + warm),
        between=None if between is None else spread_of(between),
        within=spread_of(within),
        largest_difference=float(np.ptp(means)) if len(labels) > 1 else None,
        categories=pace_categories(mean + warm),
    )
    places = tuple(
        PlaceRating(
            label=name,
            impacts=int(np.sum(index == k)),
            mean=float(means[k]),
            friction=float(friction[index == k].mean()),
            restitution=float(restitution[index == k].mean()),
            rating=None if levels is None else spread_of(levels[:, k] + warm),
        )
        for k, name in enumerate(labels)
    )
    return MeasuredPace(rows.size, len(table), court, places if column else (), remark)


def _rebound(table: ImpactTable) -> tuple[FloatArray, FloatArray]:
    """Rebound velocity (impacts,) along the court and away from it; NaN where it was not measured."""
    known = {item.name: item.values for item in (*table.measurements, *table.redundant)}
    none = np.full(len(table), np.nan)
    v_x2, v_y2 = known.get("v_x2", none), known.get("v_y2", none)
    if "v_2" in known and "theta_2" in known:
        v_x2 = np.where(np.isfinite(v_x2), v_x2, known["v_2"] * np.cos(known["theta_2"]))
        v_y2 = np.where(np.isfinite(v_y2), v_y2, known["v_2"] * np.sin(known["theta_2"]))
    return v_x2, v_y2
