"""Where another maximum may be: beyond places at which the cost rises less than about one alone."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from fitball.base.values import FloatArray
from fitball.inference.problem.problem import COMMON_PARAMETERS, Problem, base_of
from fitball.inference.search.objective import UNSEEN_CURVATURE, Objective, descend

# Sds from a maximum at which a coordinate is held while all others are fitted: between two modes,
# or beyond the other one.
HELD_SDS = (-8.0, -5.0, 5.0, 8.0)
# A place that bounds move nearer than this, in sds, shows nothing.
LEAST_SDS = 2.0
# Gain promised by a step from which fits with a held coordinate end: of a rise of 12 or more.
ROUGH_GAIN = 1.0
# Rise of the cost to such a place, over that of a normal distribution, below which is searched from
# there. Bent posteriors with one mode have as little: the search then comes back. Chosen by hand.
SMALL_RISE = 0.75
# Searches at most, from where the cost rises least.
MOST_SEARCHES = 4
# Coordinates at most that are held in turn: a table may have many labels.
MOST_HELD = 12
# Sd over the width of the prior up to which the data determine a coordinate.
DETERMINED_SHARE = 0.5


def places_beyond(
    problem: Problem,
    best: Annotated[FloatArray, "coordinates"],
) -> Annotated[FloatArray, "places coordinates"]:
    """The places from which a search may reach another maximum than the `best`. Searches from draws
    of the prior miss a maximum that is reached from few places.
    """
    prior = problem.prior
    sds = _sds(problem, best)
    starts = []
    held = []
    for k in _determined(problem, sds):
        values = best[k] + sds[k] * np.array(HELD_SDS)
        for value in np.clip(values, prior.low[k], prior.high[k]):
            if abs(value - best[k]) >= LEAST_SDS * sds[k]:
                start = best.copy()
                start[k] = value
                starts.append(start)
                held.append(k)
    if not starts:
        return best[None][:0]
    index = np.array(held)
    x, cost, _ = descend(Objective(problem, held=index), np.array(starts), ROUGH_GAIN)
    lowest = Objective(problem).cost(best[None])[0]
    row = np.arange(len(x))
    sds_away = (x[row, index] - best[index]) / sds[index]
    rise = (cost - lowest) / (0.5 * sds_away**2)
    order = np.argsort(rise, kind="stable")[:MOST_SEARCHES]
    small = order[rise[order] < SMALL_RISE]
    return np.asarray(x[small])


def _sds(problem: Problem, best: FloatArray) -> FloatArray:
    """The sds (coordinates,) of a normal distribution about a maximum."""
    _, curvature = Objective(problem).linearised(best[None])
    unseen = np.diag(UNSEEN_CURVATURE / problem.prior.width**2)
    covariance = np.linalg.inv(curvature[0] + unseen)
    return np.asarray(np.sqrt(np.diagonal(covariance)))


def _determined(problem: Problem, sds: FloatArray) -> list[int]:
    """The coordinates of a model's parameters that the data determine, at most MOST_HELD: those of
    all impacts before those of a label.
    """
    known = sds < DETERMINED_SHARE * problem.prior.width
    chosen = []
    for k, name in enumerate(problem.free):
        if known[k] and base_of(name) not in COMMON_PARAMETERS:
            chosen.append(k)
    chosen.sort(key=lambda k: "[" in problem.free[k])
    return chosen[:MOST_HELD]
