"""What the ITF's court pace test would find on a fitted surface, draw by draw (see `pace_rating`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fitball.inference.prediction.drop_test import chosen_spread
from fitball.inference.prediction.measured_pace import RATING, measured_paces, names_places
from fitball.inference.prediction.posterior_predictive import by_level, levels_of, regime_shares
from fitball.inference.prediction.reach import calibrated_range, lines_of
from fitball.inference.problem.problem import Problem
from fitball.inference.results.lab import (
    TOLERANCE,
    CourtMean,
    CourtPace,
    PaceRating,
    Reach,
    adjusted,
    apparent_friction,
    itf_impact,
    pace_categories,
    pace_rating,
)
from fitball.inference.results.quantiles import MOST_UNSOLVED, spread_of
from fitball.inference.results.results import PointFit, Posterior, thinned
from fitball.models.types import STATUS_REASON, Rebound, Status
from fitball.values import FloatArray, Impacts

DRAWS = 4000
NO_TENNIS = "the test uses a tennis ball, and this ball has {:.3g} g and a radius of {:.3g} mm"
SLIDING = ("slide", "slide back")
# The lines of restitution and offset in vertical speed are continued to at most so many times the fastest measured,
# or the slowest over this.
CONTINUED = 2.0
# Where the apparent friction is this share of what gripping allows a model does not tell courts apart.
SATURATED = 0.95


def court_pace(
    problem: Problem, point: PointFit, posterior: Posterior | None, rng: np.random.Generator
) -> CourtPace | None:
    """The rating of every surface of the problem; None where no motion along the court was measured."""
    if not problem.table.has_tangential:
        return None
    scene = problem.scene
    if not scene.tennis:
        return CourtPace((), NO_TENNIS.format(1e3 * scene.ball.mass, 1e3 * scene.ball.radius))
    known = CourtPace(
        (),
        "",
        scene.ball_temperature,
        scene.ball_temperature_sd,
        columns=tuple(dict.fromkeys(pooling.column for pooling in problem.pooling)),
        measured=measured_paces(problem.table, scene, rng, chosen_spread(problem, RATING, "")),
    )
    if missing := _unrated(problem):
        return replace(known, missing=missing)
    # The point estimate, and the draws behind it.
    columns = {name: np.array([value]) for name, value in point.values.items()}
    temperature: FloatArray | float | None = scene.ball_temperature
    if posterior is not None:
        drawn = problem.all_values(thinned(posterior, DRAWS))
        columns = {name: np.append(columns[name], draws) for name, draws in drawn.items()}
        if scene.ball_temperature is not None:
            # One error of the thermometer for all surfaces.
            errors = (scene.ball_temperature_sd or 0.0) * rng.standard_normal(len(next(iter(drawn.values()))))
            temperature = scene.ball_temperature + np.append(0.0, errors)
    rated = []
    for labels, rows in by_level(problem).items():
        found = _rate(problem, labels, rows, columns, temperature)
        if isinstance(found, str):
            return replace(known, missing=found)
        rated.append(found)
    ratings = tuple(rating for rating, _ in rated)
    return replace(known, ratings=ratings, court=_court(problem, ratings, [draws for _, draws in rated]))


def _unrated(problem: Problem) -> str:
    """Why a model gives no rating; empty where it does."""
    if problem.model.needs_cor:
        return "cor = measured takes the restitution of each impact from the table"
    missing = "mu" not in problem.model.parameter_names
    return f"model {problem.model.name} has no coefficient of sliding friction" if missing else ""


def _court(problem: Problem, ratings: Sequence[PaceRating], draws: Sequence[FloatArray]) -> CourtMean | None:
    """The mean over the places of one court; None where the problem distinguishes no places."""
    columns = {pooling.column for pooling in problem.pooling}
    column = next(iter(columns), "")
    if len(columns) != 1 or not names_places(column):
        return None
    points = np.array([rating.rating.point for rating in ratings])
    sampled = ratings[0].rating.median is not None
    joint = np.stack(draws, axis=1)
    mean, between = joint.mean(axis=1), joint.std(axis=1, ddof=1)
    return CourtMean(
        column=column,
        places=len(ratings),
        rating=spread_of(mean if sampled else None, float(points.mean())),
        elsewhere=None,
        between=spread_of(between if sampled else None, float(points.std(ddof=1))),
        within=None,
        largest_difference=float(np.ptp(points)),
        categories=pace_categories(mean[np.isfinite(mean)]),
    )


def pace_by_surface(problem: Problem, values: FloatArray) -> dict[str, FloatArray]:
    """Ratings (draws,) of every surface by its labels at free values (draws, free); NaN where the model cannot be
    evaluated. Empty where there are none.
    """
    if not (problem.table.has_tangential and problem.scene.tennis) or _unrated(problem):
        return {}
    columns, impact = dict(problem.all_values(values)), itf_impact()
    ratings = {}
    for labels, rows in by_level(problem).items():
        rebound = problem.rebound_like(columns, impact, rows[:1])
        told = _quantities(problem, labels, columns, rebound, problem.scene.ball_temperature)
        name = ", ".join(levels_of(problem, labels).values())
        ratings[name] = np.where(rebound.status[:, 0] == 0, told["rating"], np.nan)
    return ratings


def _rate(
    problem: Problem,
    labels: tuple[str, ...],
    rows: NDArray[np.int64],
    columns: Mapping[str, FloatArray],
    temperature: FloatArray | float | None,
) -> tuple[PaceRating, FloatArray] | str:
    """One rating with its draws (NaN where there is none), or the reason why there is none. Parameters
    and temperature are those of the point estimate, before any draws.
    """
    impact = itf_impact()
    measured, test = problem.table.impacts.v_y1[rows], float(impact.v_y1[0])
    if not measured.min() / CONTINUED <= test <= CONTINUED * measured.max():
        return (
            f"the impacts have vertical speeds of {measured.min():.2g} to {measured.max():.2g} m/s, too far from the "
            f"test's {test:.2g} m/s (limit: {CONTINUED:g} × a measured speed)"
        )
    rebound = problem.rebound_like(columns, impact, rows[:1])
    status = rebound.status[:, 0]
    # A point fit has one row, which is also its summary.
    sampled = len(status) > 1
    draws = slice(1 if sampled else 0, None)
    solved = status[draws] == 0
    if status[0] != 0 or not np.any(solved):
        return f"the model cannot be evaluated at the test impact: {_cause(status[status != 0][0])}"
    if np.mean(~solved) > MOST_UNSOLVED:
        cause = _cause(status[status != 0][0])
        share = 100.0 * np.mean(~solved)
        return f"the model cannot be evaluated at the test impact for {share:.0f} % of the draws: {cause}"
    told = _quantities(problem, labels, columns, rebound, temperature)
    drawn = {name: array[draws] for name, array in told.items()}
    most = _gripping(problem, columns, impact, rows[:1])[draws]
    shares = regime_shares(rebound.each(lambda array: array[draws]))[0]
    rated = PaceRating(
        labels=tuple(levels_of(problem, labels).values()),
        impacts=len(rows),
        **{
            name: spread_of(drawn[name][solved] if sampled else None, float(array[0])) for name, array in told.items()
        },
        categories=pace_categories(drawn["rating"][solved]),
        regimes=shares,
        slides=sum(share for name, share in shares.items() if name in SLIDING),
        failed=float(np.mean(~solved)),
        reach=_reach(problem, rows),
        saturated=float(np.mean(drawn["friction"][solved] >= SATURATED * most[solved])),
    )
    return rated, np.where(solved, drawn["rating"], np.nan)


def _cause(status: int) -> str:
    return STATUS_REASON[Status(int(status))]


def _gripping(
    problem: Problem, columns: Mapping[str, FloatArray], impact: Impacts, row: NDArray[np.int64]
) -> FloatArray:
    """The apparent friction (draws,) of a ball that grips to the end, the most of a model in which it then rolls;
    inf of one with a time axis, or with a tangential restitution, which fit what a gripping ball does.
    """
    if problem.model.has_time or "e_x" in problem.model.parameter_names:
        return np.full(len(columns["mu"]), np.inf)
    rough = np.full(len(columns["mu"]), problem.model.specs["mu"].upper)
    pooled = {pooling.spread_name: np.zeros(len(rough)) for pooling in problem.pooling if pooling.parameter == "mu"}
    made = problem.rebound_like({**columns, **pooled, "mu": rough}, impact, row)
    return apparent_friction(impact.v_x1, impact.v_y1, made.v_x2[:, 0], made.v_y2[:, 0])


def _quantities(
    problem: Problem,
    labels: tuple[str, ...],
    columns: Mapping[str, FloatArray],
    rebound: Rebound,
    temperature: FloatArray | float | None,
) -> dict[str, FloatArray]:
    """Rating of a surface and what it is made of, each (draws,), from the rebound of the test impact."""
    impact, v_x2, v_y2 = itf_impact(), rebound.v_x2[:, 0], rebound.v_y2[:, 0]
    sliding = columns["mu"]
    for pooling, label in zip(problem.pooling, labels, strict=True):
        if pooling.parameter == "mu":
            sliding = pooling.value(columns, label)
    friction = apparent_friction(impact.v_x1, impact.v_y1, v_x2, v_y2)
    restitution = v_y2 / impact.v_y1
    brought = adjusted(restitution, temperature)
    return {
        "rating": pace_rating(friction, brought),
        "friction": friction,
        "restitution": restitution,
        "sliding_friction": sliding,
        "sliding_rating": pace_rating(sliding, brought),
    }


def _reach(problem: Problem, rows: NDArray[np.int64]) -> Reach:
    """How far the test impact lies from the impacts on this surface."""
    known = problem.table.impacts.take(rows)
    lines = lines_of(problem.model.parameter_names)
    calibrated = calibrated_range(known, itf_impact(), problem.model.ball.radius, True, lines)
    over = {name: float(column[0]) for name, column in calibrated.beyond.items()}
    beyond = {name: value for name, value in over.items() if abs(value) > TOLERANCE[name]}
    distance = 0.0 if calibrated.hull_distance is None else float(calibrated.hull_distance[0])
    return Reach(
        outside=bool(beyond) or distance > calibrated.slack,
        beyond=beyond,
        distance=distance,
        slack=calibrated.slack,
        lines=calibrated.lines if "v_y1" in beyond else (),
    )
