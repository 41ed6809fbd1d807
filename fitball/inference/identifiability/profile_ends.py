"""What closes a profile: the table, or a bound that another parameter rests on there.

A bound of physics (a mass ratio of one, a restitution between zero and one) is part of the model: what is known with
it is known. A bound that only ends a search is nobody's knowledge. Where it is all that makes a profile fall, the
table leaves that side open: so it is found by searching further.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fitball.inference.identifiability.profile_path import Point, Top, free_searches, searches
from fitball.inference.point.gauss_newton import descend
from fitball.inference.point.surface import Surface
from fitball.inference.problem.parameters import NOISE_SPECS, Prior
from fitball.inference.results.evidence import Profile
from fitball.values import FloatArray

Names = tuple[str, ...]
# Share of its drop that a profile keeps at least where bounds that only end a search move out by one width of their
# prior; below it those bounds were most of what closed it.
KEPT = 0.5
# Distance from a bound, in widths of the prior, below which a parameter lies on it.
NEAR = 1e-6
# Quantiles of a prior over which a profile is weighed.
LEVELS = 4000


def ended_by_range(
    objective: Surface, paths: Mapping[int, Sequence[Point]], top: Top, lowest: float, scene: bool
) -> dict[int, tuple[Names, Names]]:
    """For each profiled free parameter and side the other parameters whose ends of search are what makes the profile
    fall there; none where it falls by itself, or does not fall.
    """
    low, high = objective.searched_for
    found: dict[int, list[Names]] = {column: [(), ()] for column in paths}
    asked: list[tuple[int, int, Point, Names]] = []
    for column, points in paths.items():
        ordered = sorted(points, key=lambda point: point.at)
        for side in (0, 1):
            point = ordered[-side]
            below, above = _resting(objective, column, point.x)
            names = _names(objective, (below & low) | (above & high))
            if names:
                asked.append((column, side, point, names))
    if asked:
        wide = replace(objective, stretched=True)
        at = np.array([point.at for _, _, point, _ in asked])
        x = np.array([point.x for _, _, point, _ in asked])
        reached = descend(wide, searches(wide, [column for column, *_ in asked], at, x, scene))
        # The maximum itself may gain by the same room.
        best = float(descend(wide, free_searches(wide, top.x[None, :], scene)).cost[0])
        for row, (column, side, point, names) in enumerate(asked):
            if reached.cost[row] - best < KEPT * (point.cost - lowest):
                found[column][side] = names
    return {column: (sides[0], sides[1]) for column, sides in found.items()}


def at_bounds(objective: Surface, column: int, point: Point) -> Names:
    """Names of other parameters that lie on a bound of their own at a point that ends a profile."""
    below, above = _resting(objective, column, point.x)
    return _names(objective, below | above)


def _resting(objective: Surface, column: int, x: FloatArray) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which columns but that of a free parameter, and of noise, lie on their lower, and on their upper bound."""
    low, high = objective.limits
    others = np.array([k != column and objective.problem.free[k].name not in NOISE_SPECS for k in objective.columns])
    return (x - low < NEAR * objective.width) & others, (high - x < NEAR * objective.width) & others


def _names(objective: Surface, chosen: NDArray[np.bool_]) -> Names:
    return tuple(objective.problem.free[objective.columns[k]].name for k in np.flatnonzero(chosen))


def profile_contraction(profile: Profile, prior: Prior) -> float:
    """One minus the variance of prior times profile likelihood over that of the prior, in the prior's coordinate: the
    contraction that the table promises by itself, without the first order. Below its ends the root of the drop goes
    on as a line.
    """
    coordinate = prior.coordinate(prior.quantile((np.arange(LEVELS) + 0.5) / LEVELS))
    at, root = prior.coordinate(profile.values), np.sqrt(profile.drop)
    inner = np.interp(coordinate, at, root)
    slopes = [abs((root[k] - root[j]) / (at[k] - at[j])) if len(at) > 1 else 0.0 for j, k in ((1, 0), (-2, -1))]
    beyond = np.maximum(at[0] - coordinate, 0.0) * slopes[0] + np.maximum(coordinate - at[-1], 0.0) * slopes[1]
    drop = (inner + beyond) ** 2
    weight = np.exp(np.min(drop) - drop)
    mean = np.sum(weight * coordinate) / np.sum(weight)
    return 1.0 - float(np.sum(weight * (coordinate - mean) ** 2) / np.sum(weight) / np.var(coordinate))
