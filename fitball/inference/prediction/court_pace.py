"""What the ITF's court pace test would find on a fitted surface, draw by draw (see `pace_rating`)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from fitball.inference.prediction.extrapolation import calibrated_range
from fitball.inference.prediction.posterior_predictive import regime_shares
from fitball.inference.problem.problem import Problem
from fitball.inference.results.pace_rating import (
    TOLERANCE,
    CourtPace,
    PaceRating,
    Reach,
    Spread,
    apparent_friction,
    itf_impact,
    pace_categories,
    pace_rating,
)
from fitball.inference.results.quantiles import MEDIAN_FIRST, MOST_UNSOLVED, quantiles
from fitball.inference.results.results import PointFit, Posterior, thinned
from fitball.models.types import STATUS_REASON, Rebound, Status
from fitball.values import FloatArray, Impacts

DRAWS = 4000
SLIDING = ("slide", "slide back")
LINES = {"cor_slope": "COR", "eps_slope": "eps"}


def court_pace(problem: Problem, point: PointFit, posterior: Posterior | None) -> CourtPace | None:
    """The rating of every surface the problem tells apart; None where no motion along the court was measured."""
    if not problem.table.has_tangential:
        return None
    if problem.model.needs_cor:
        return CourtPace((), "closure cor = measured takes the restitution of each impact from the table")
    if "mu" not in problem.model.parameter_names:
        return CourtPace((), f"model {problem.model.name} has no coefficient of sliding friction")
    at_point = {name: np.array([value]) for name, value in point.values.items()}
    drawn = at_point if posterior is None else dict(problem.all_values(thinned(posterior, DRAWS)))
    ratings = []
    for labels, rows in _surfaces(problem).items():
        rating = _rate(problem, labels, rows, at_point, drawn, posterior is not None)
        if isinstance(rating, str):
            return CourtPace((), rating)
        ratings.append(rating)
    return CourtPace(tuple(ratings), "")


def pace_by_surface(problem: Problem, values: FloatArray) -> dict[str, FloatArray]:
    """Ratings (draws,) of every surface by its labels at free values (draws, free); NaN where the model cannot be
    evaluated. Empty where there are none.
    """
    rated = problem.table.has_tangential and not problem.model.needs_cor
    if not rated or "mu" not in problem.model.parameter_names:
        return {}
    columns, impact = dict(problem.all_values(values)), itf_impact()
    ratings = {}
    for labels, rows in _surfaces(problem).items():
        rebound = problem.rebound_like(columns, impact, np.array([rows[0]]))
        quantities = _quantities(impact, rebound, _sliding_friction(problem, labels, columns))
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
    sampled: bool,
) -> PaceRating | str:
    """One rating, or the sentence that says why there is none."""
    impact, row = itf_impact(), np.array([rows[0]])
    best = problem.rebound_like(at_point, impact, row)
    rebound = problem.rebound_like(drawn, impact, row)
    solved = rebound.status[:, 0] == 0
    if best.status[0, 0] != 0 or not np.any(solved):
        cause = STATUS_REASON[Status(int(best.status[0, 0] or rebound.status[0, 0]))]
        return f"the model cannot be evaluated at the test impact: {cause}"
    if np.mean(~solved) > MOST_UNSOLVED:
        cause = STATUS_REASON[Status(int(rebound.status[~solved, 0][0]))]
        return f"{100.0 * np.mean(~solved):.0f} % of the draws cannot be evaluated at the test impact: {cause}"
    one = _quantities(impact, best, _sliding_friction(problem, labels, at_point))
    many = _quantities(impact, rebound, _sliding_friction(problem, labels, drawn))
    spreads = {name: _spread(one[name], many[name][solved], sampled) for name in one}
    shares = regime_shares(rebound)[0]
    return PaceRating(
        labels=labels,
        impacts=len(rows),
        rating=spreads["rating"],
        friction=spreads["friction"],
        restitution=spreads["restitution"],
        sliding_friction=spreads["sliding_friction"],
        sliding_rating=spreads["sliding_rating"],
        categories=pace_categories(many["rating"][solved]),
        regimes=shares,
        slides=sum(share for name, share in shares.items() if name in SLIDING),
        failed=float(np.mean(~solved)),
        reach=_reach(problem, np.array(rows, dtype=np.int64)),
    )


def _sliding_friction(problem: Problem, labels: tuple[str, ...], columns: Mapping[str, FloatArray]) -> FloatArray:
    """The coefficient of sliding friction (draws,) on a surface."""
    for pooling, label in zip(problem.pooling, labels, strict=True):
        if pooling.parameter == "mu":
            return pooling.value(columns, label)
    return columns["mu"]


def _quantities(impact: Impacts, rebound: Rebound, sliding: FloatArray) -> dict[str, FloatArray]:
    """Rating and what it is made of, each (draws,)."""
    v_x2, v_y2 = rebound.v_x2[:, 0], rebound.v_y2[:, 0]
    friction = apparent_friction(impact.v_x1, impact.v_y1, v_x2, v_y2)
    restitution = v_y2 / impact.v_y1
    return {
        "rating": pace_rating(friction, restitution),
        "friction": friction,
        "restitution": restitution,
        "sliding_friction": sliding,
        "sliding_rating": pace_rating(sliding, restitution),
    }


def _spread(point: FloatArray, draws: FloatArray, sampled: bool) -> Spread:
    spread = quantiles(draws, MEDIAN_FIRST) if sampled else dict.fromkeys(MEDIAN_FIRST)
    return Spread(float(point[0]), **spread)


def _reach(problem: Problem, rows: NDArray[np.int64]) -> Reach:
    """How far the test impact lies from the impacts on this surface."""
    known = problem.table.impacts.take(rows)
    words = tuple(word for name, word in LINES.items() if name in problem.model.parameter_names)
    calibrated = calibrated_range(known, itf_impact(), problem.model.ball.radius, True, words)
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
