"""Court pace by ITF CS 01/02 as measured, straight from the table. `report.lab` has the columns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from fitball.base import itf
from fitball.base.values import DataFrame, FloatArray, IntArray
from fitball.data.kinematics import AnalyticArray, AnalyticColumns, velocity
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.inference.effort import Effort
from fitball.uses.lab import NO_PRIORS, groups_of, interval, labels_of, prior_of_spread, with_errors
from fitball.uses.means import Means, means

# Impacts of the test that a rating needs.
LEAST_IMPACTS_RATED = 3


def measured_pace(
    table: ImpactTable,
    scene: Scene,
    priors: Mapping[str, str] = NO_PRIORS,
) -> DataFrame:
    """Court pace by ITF CS 01/02: a row a surface and place, of the impacts within tolerances:
    rating, interval, share in each category; of a surface the largest difference of location means,
    its `variation`, and the chance that places which are alike differ as much. With repeats at
    several places a surface is the centre of these, and `rating_spread` has a prior. Empty where
    such impacts are too few.

    Raises:
        ParameterError: the prior of `rating_spread` cannot be read (`prior`, `unknown-key`).
    """
    import pandas as pd

    heads = ["surface", "place", "impacts", "rating", "q025", "q975", *itf.PACE_CATEGORIES]
    heads += ["variation", "by_chance"]
    rows = [row for tested in pace_of(table, scene, priors) for row in _pace_rows(tested)]
    return pd.DataFrame(rows, columns=heads)


class TestedPace(NamedTuple):
    """The pace test of a `surface`, "" where there is one: its `rows` (row numbers), names of
    `places` and the `place` (rows,) among them, and the `means` of ratings.
    """

    surface: str
    rows: IntArray
    places: list[str]
    place: IntArray
    means: Means


def pace_of(
    table: ImpactTable,
    scene: Scene,
    priors: Mapping[str, str] = NO_PRIORS,
) -> Iterator[TestedPace]:
    """The pace tests of a table's surfaces. Raises ParameterError as `measured_pace` does."""
    after = velocity(table.values, "2")
    if not (itf.is_tennis_ball(scene.ball_value()) and {"v_x2", "v_y2"} <= after.keys()):
        return
    rebounded = np.isfinite(after["v_x2"] + after["v_y2"])
    usable = np.flatnonzero(itf.is_pace_impact(table.impacts.forwards) & rebounded)
    side = table.impacts.side
    temperature = scene.ball.temperature
    ratings, sds = with_errors(table, lambda columns: rating(columns, side, temperature))
    prior = prior_of_spread("rating_spread", "place", scene, priors)
    rng = Effort().stream("pace")
    surfaces = labels_of(table, "surface")
    places = labels_of(table, "place", "group")
    for surface in dict.fromkeys(surfaces):
        rows = usable[[surfaces[row] == surface for row in usable.tolist()]]
        if len(rows) < LEAST_IMPACTS_RATED:
            continue
        names, group = groups_of(places, rows)
        of_surface = means(ratings[rows], group, prior, rng, np.zeros(len(rows)), sds[rows])
        name = surface if len({*surfaces}) > 1 else ""
        yield TestedPace(name, rows, names, group, of_surface)


def rating(
    columns: AnalyticColumns,
    side: FloatArray,
    temperature: float | None,
) -> AnalyticArray:
    """Ratings (impacts,) of columns of a table, of balls that fly to a `side` (impacts,)."""
    leaving = velocity(columns, "2")
    slowed = side * (columns["v_x1"] - leaving["v_x2"])
    friction = slowed / (columns["v_y1"] + leaving["v_y2"])
    restitution = leaving["v_y2"] / columns["v_y1"]
    return itf.pace_rating(friction, restitution, temperature)


def _pace_rows(tested: TestedPace) -> Iterator[dict[str, object]]:
    """A row of a surface, then one of each place on it."""
    of_surface = tested.means
    levels = of_surface.levels
    yield {
        **_pace_row(tested.surface, "", len(tested.rows), of_surface.point, of_surface.mean),
        "variation": float(np.ptp(levels)) if len(levels) > 1 else np.nan,
        "by_chance": of_surface.by_chance,
    }
    for k, level in enumerate(levels.tolist() if len(levels) > 1 else []):
        count = int(np.sum(tested.place == k))
        # A place with one impact is no better known than by that.
        draws = of_surface.each[k] if len(of_surface.each) else of_surface.mean[:0]
        value = float(np.median(draws)) if draws.size else level
        yield _pace_row(tested.surface, tested.places[k], count, value, draws)


def _pace_row(
    surface: str,
    place: str,
    impacts: int,
    value: float,
    draws: FloatArray,
) -> dict[str, object]:
    """A row of the pace test: a rating of so many impacts; its draws (draws,) may be none."""
    low, high = interval(draws)
    shares = itf.pace_categories(draws if draws.size else np.array([value]))
    lead = {"surface": surface, "place": place, "impacts": impacts}
    return {**lead, "rating": value, "q025": low, "q975": high, **shares}
