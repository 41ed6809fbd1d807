"""The ITF's court pace of the impacts that are those of its test: the rating as measured, no model between."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fitball.data.labels import Role, role_of
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.inference.prediction.drop_test import DRAWN, one_way, plain_mean
from fitball.inference.problem.parameters import Prior
from fitball.inference.problem.pooling import FEW_LEVELS
from fitball.inference.problem.spreads import published_spread
from fitball.inference.results.lab import (
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

RATING = "rating"
# A label column that may name places on a court, where none is sure to.
GROUP = "group"
# Fewer impacts say nothing of their scatter.
LEAST = 3


def names_places(column: str) -> bool:
    """Whether the labels of a column may be places on a court."""
    return role_of(column) is Role.PLACE or column == GROUP


def measured_paces(
    table: ImpactTable, scene: Scene, rng: np.random.Generator, spread: Prior | None = None
) -> tuple[MeasuredPace, ...]:
    """The rating of each surface that has impacts of the test (30 +- 2 m/s, 16 +- 2 degrees, at most 3 revolutions a
    second), at least three of them. `spread` is the prior of the standard deviation between places, by default that
    of the literature.
    """
    several = [name for name, cells in table.labels.items() if role_of(name) is Role.SURFACE and len({*cells}) > 1]
    column = several[0] if several else ""
    surfaces = tuple(dict.fromkeys(table.labels[column])) if column else ("",)
    found = []
    for surface in surfaces:
        own = np.array([label == surface for label in table.labels[column]]) if column else np.full(len(table), True)
        found.append(_measured(table, scene, rng, spread, surface, own))
    return tuple(one for one in found if one is not None)


def _measured(
    table: ImpactTable,
    scene: Scene,
    rng: np.random.Generator,
    spread: Prior | None,
    surface: str,
    own: NDArray[np.bool_],
) -> MeasuredPace | None:
    """The rating of the test's impacts among `own` (impacts,), those on a surface."""
    impacts = table.impacts
    v_x2, v_y2 = _rebound(table)
    valid = (
        own
        & (np.abs(impacts.speed - TEST_SPEED) <= SPEED_TOLERANCE)
        & (np.abs(impacts.angle - TEST_ANGLE) <= TOLERANCE["theta_1"])
        & (np.abs(impacts.omega_1) <= TOLERANCE["omega_1"])
        & np.isfinite(v_x2 + v_y2)
    )
    rows = np.flatnonzero(valid)
    if rows.size < LEAST:
        return None
    friction = apparent_friction(impacts.v_x1[rows], impacts.v_y1[rows], v_x2[rows], v_y2[rows])
    restitution = v_y2[rows] / impacts.v_y1[rows]
    rating = pace_rating(friction, adjusted(restitution, scene.ball_temperature))
    # Names of places are surer than those of groups.
    columns = sorted((name for name in table.labels if names_places(name)), key=lambda name: name == GROUP)
    column = next((name for name in columns if len({table.labels[name][k] for k in rows}) > 1), "")
    named = [table.labels[column][k] for k in rows] if column else [""] * rows.size
    labels = tuple(dict.fromkeys(named))
    index = np.array([labels.index(name) for name in named], dtype=np.int64)
    between = elsewhere = levels = None
    remark = ""
    known = published_spread(RATING, Role.PLACE)
    assert known is not None
    prior = spread or known.prior
    found = one_way(rating, np.ones((rating.size, 1)), index, prior, rng) if len(labels) > 1 else ""
    if isinstance(found, str):
        mean, within = plain_mean(rating, rng)
        remark = found and f"differences between places cannot be separated from noise: {found}"
    else:
        # Few places say nothing firm of another one.
        if len(labels) >= FEW_LEVELS:
            elsewhere = found.coefficients[:, 0] + found.between * rng.standard_normal(DRAWN)
        mean, within = found.levels @ (np.bincount(index) / index.size), found.within
        between, levels = found.between, found.levels
    # The thermometer's error is one for all impacts.
    warm = PER_KELVIN * (scene.ball_temperature_sd or 0.0) * rng.standard_normal(DRAWN)
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
        prior="" if between is None else prior.text,
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
    return MeasuredPace(rows.size, int(own.sum()), court, places if column else (), remark, surface)


def _rebound(table: ImpactTable) -> tuple[FloatArray, FloatArray]:
    """Rebound velocity (impacts,) along the court and away from it; NaN where it was not measured."""
    known = {item.name: item.values for item in (*table.measurements, *table.redundant)}
    none = np.full(len(table), np.nan)
    v_x2, v_y2 = known.get("v_x2", none), known.get("v_y2", none)
    if "v_2" in known and "theta_2" in known:
        v_x2 = np.where(np.isfinite(v_x2), v_x2, known["v_2"] * np.cos(known["theta_2"]))
        v_y2 = np.where(np.isfinite(v_y2), v_y2, known["v_2"] * np.sin(known["theta_2"]))
    return v_x2, v_y2
