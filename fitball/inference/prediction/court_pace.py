"""What the ITF's court pace test would find on a fitted surface, draw by draw (see `pace_rating`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fitball.inference.prediction.extrapolation import calibrated_range, lines_of
from fitball.inference.prediction.measured_pace import PLACES, measured_pace, temperatures
from fitball.inference.prediction.posterior_predictive import regime_shares
from fitball.inference.problem.problem import Problem
from fitball.inference.results.pace_rating import (
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
NO_TENNIS = "the test is made with a tennis ball, and this one has {:.3g} g and a radius of {:.3g} mm"
SLIDING = ("slide", "slide back")
# The lines of restitution and offset in vertical speed are continued to at most so many times the fastest measured,
# or the slowest over this.
CONTINUED = 2.0
# Where the apparent friction is this share of what gripping allows a model does not tell courts apart.
SATURATED = 0.95


def court_pace(
    problem: Problem, point: PointFit, posterior: Posterior | None, rng: np.random.Generator
) -> CourtPace | None:
    """The rating of every surface the problem tells apart; None where no motion along the court was measured."""
    if not problem.table.has_tangential:
        return None
    scene = problem.scene
    if not scene.tennis:
        return CourtPace((), NO_TENNIS.format(1e3 * scene.ball.mass, 1e3 * scene.ball.radius))
    known = CourtPace(
        (), "", scene.ball_temperature, scene.ball_temperature_sd, measured=measured_pace(problem.table, scene, rng)
    )
    if missing := _unrated(problem):
        return replace(known, missing=missing)
    at_point = {name: np.array([value]) for name, value in point.values.items()}
    drawn = at_point if posterior is None else dict(problem.all_values(thinned(posterior, DRAWS)))
    # One error of the thermometer for all surfaces.
    warmth = None
    if posterior is not None and scene.ball_temperature is not None:
        warmth = temperatures(scene, len(next(iter(drawn.values()))), rng)
    rated = []
    for labels, rows in _surfaces(problem).items():
        found = _rate(problem, labels, rows, at_point, drawn, warmth, posterior is not None)
        if isinstance(found, str):
            return replace(known, missing=found)
        rated.append(found)
    ratings = tuple(rating for rating, _ in rated)
    return replace(known, ratings=ratings, court=_court(problem, ratings, [draws for _, draws in rated]))


def _unrated(problem: Problem) -> str:
    """Why a model says nothing of the rating; empty where it does."""
    if problem.model.needs_cor:
        return "closure cor = measured takes the restitution of each impact from the table"
    missing = "mu" not in problem.model.parameter_names
    return f"model {problem.model.name} has no coefficient of sliding friction" if missing else ""


def _court(problem: Problem, ratings: Sequence[PaceRating], draws: Sequence[FloatArray]) -> CourtMean | None:
    """The mean over the places of one court; None where the problem tells no places apart."""
    column = next((pooling.column for pooling in problem.pooling if pooling.parameter == "mu"), None)
    if column not in PLACES or len(problem.pooling) > 1:
        return None
    points = np.array([rating.rating.point for rating in ratings])
    sampled = ratings[0].rating.median is not None
    joint = np.stack(draws, axis=1) if sampled else points[None]
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
    for labels, rows in _surfaces(problem).items():
        rebound = problem.rebound_like(columns, impact, np.array([rows[0]]))
        sliding = _sliding_friction(problem, labels, columns)
        quantities = _quantities(impact, rebound, sliding, problem.scene.ball_temperature)
        ratings[", ".join(labels)] = np.where(rebound.status[:, 0] == 0, quantities["rating"], np.nan)
    return ratings


def _surfaces(problem: Problem) -> dict[tuple[str, ...], list[int]]:
    """Rows of the table by the labels of the levels that the problem tells apart; all together without levels."""
    surfaces: dict[tuple[str, ...], list[int]] = {}
    for row in range(len(problem.table)):
        labels = tuple(pooling.labels[int(pooling.index[row])] for pooling in problem.pooling)
        surfaces.setdefault(labels, []).append(row)
    return surfaces


def _rate(
    problem: Problem,
    labels: tuple[str, ...],
    rows: list[int],
    at_point: Mapping[str, FloatArray],
    drawn: Mapping[str, FloatArray],
    warmth: FloatArray | None,
    sampled: bool,
) -> tuple[PaceRating, FloatArray] | str:
    """One rating with its draws (NaN where there is none), or the sentence that says why there is none; `warmth` is
    the temperature of the ball (draws,), None of a point fit that is not `sampled` or where it is not known.
    """
    impact, row = itf_impact(), np.array([rows[0]])
    measured, test = problem.table.impacts.v_y1[rows], float(impact.v_y1[0])
    if not measured.min() / CONTINUED <= test <= CONTINUED * measured.max():
        return (
            f"the vertical speeds of the impacts, {measured.min():.2g} to {measured.max():.2g} m/s, are too far from "
            f"that of the test, {test:.2g} m/s: no rating is continued beyond {CONTINUED:g} times a speed measured"
        )
    best = problem.rebound_like(at_point, impact, row)
    rebound = problem.rebound_like(drawn, impact, row)
    solved = rebound.status[:, 0] == 0
    if best.status[0, 0] != 0 or not np.any(solved):
        cause = STATUS_REASON[Status(int(best.status[0, 0] or rebound.status[0, 0]))]
        return f"the model cannot be evaluated at the test impact: {cause}"
    if np.mean(~solved) > MOST_UNSOLVED:
        cause = STATUS_REASON[Status(int(rebound.status[~solved, 0][0]))]
        return f"{100.0 * np.mean(~solved):.0f} % of the draws cannot be evaluated at the test impact: {cause}"
    known = problem.scene.ball_temperature
    one = _quantities(impact, best, _sliding_friction(problem, labels, at_point), known)
    many = _quantities(
        impact, rebound, _sliding_friction(problem, labels, drawn), known if warmth is None else warmth
    )
    spreads = {name: spread_of(many[name][solved] if sampled else None, float(one[name][0])) for name in one}
    most = _gripping(problem, drawn, impact, row)
    shares = regime_shares(rebound)[0]
    rated = PaceRating(
        labels=labels,
        impacts=len(rows),
        **spreads,
        categories=pace_categories(many["rating"][solved]),
        regimes=shares,
        slides=sum(share for name, share in shares.items() if name in SLIDING),
        failed=float(np.mean(~solved)),
        reach=_reach(problem, np.array(rows, dtype=np.int64)),
        saturated=float(np.mean(many["friction"][solved] >= SATURATED * most[solved])),
    )
    return rated, np.where(solved, many["rating"], np.nan)


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


def _sliding_friction(problem: Problem, labels: tuple[str, ...], columns: Mapping[str, FloatArray]) -> FloatArray:
    """The coefficient of sliding friction (draws,) on a surface."""
    for pooling, label in zip(problem.pooling, labels, strict=True):
        if pooling.parameter == "mu":
            return pooling.value(columns, label)
    return columns["mu"]


def _quantities(
    impact: Impacts, rebound: Rebound, sliding: FloatArray, temperature: FloatArray | float | None
) -> dict[str, FloatArray]:
    """Rating and what it is made of, each (draws,)."""
    v_x2, v_y2 = rebound.v_x2[:, 0], rebound.v_y2[:, 0]
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
