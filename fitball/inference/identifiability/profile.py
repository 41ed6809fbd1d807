"""The profile of each parameter: the likelihood with it held, all others at their best, and how its two ends close.

A bound of physics (a mass ratio of one, a restitution between zero and one) is part of the model: what is known with
it is known. A bound that only ends a search is nobody's knowledge. Where it is all that makes a profile fall, the
table leaves that side open: so it is found by searching further.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv, ndtr, stdtr

from fitball.inference.identifiability.profile_walk import (
    Paths,
    Point,
    SurpassedError,
    Top,
    best_top,
    free_searches,
    profile_paths,
    searches,
    sweep,
)
from fitball.inference.point.gauss_newton import descend
from fitball.inference.point.surface import Surface, surface_of
from fitball.inference.problem.parameters import NOISE_SPECS, SD_SPECS, Prior
from fitball.inference.problem.problem import Problem
from fitball.inference.results.evidence import End, Interval, Profile, Profiles
from fitball.scheduling.engine import Engine, in_order
from fitball.values import FloatArray

# Half the quantiles of chi-square with one degree of freedom.
DROP_68, DROP_95 = 0.5, float(gammaincinv(0.5, 0.95))
# How often a better optimum met on the way may begin the search anew.
RESTARTS = 8
SWEEPS = 3
# Share of its drop that a profile keeps at least where bounds that only end a search move out by one width of their
# prior; below it those bounds were most of what closed it.
KEPT = 0.5
# Distance from a bound, in widths of the prior, below which a parameter lies on it.
NEAR = 1e-6
# Quantiles of a prior over which a profile is weighed.
LEVELS = 4000

Names = tuple[str, ...]


def profiles(
    problem: Problem,
    optima: Sequence[Mapping[str, float]],
    *,
    names: Sequence[str] | None = None,
    scene: bool = True,
    report: Callable[[str], None] = lambda _stage: None,
    engine: Engine | None = None,
) -> Profiles:
    """Profile the free parameters `names` (all of them, noise included, when None), starting from `optima`, each all
    parameters by name in SI. With `scene` the scene's contact time counts as a measurement.

    With an `engine` each parameter is a task; without, the searches of all advance together, which is faster on few
    rows. Both find the same.
    """
    objective = surface_of(problem if scene else replace(problem, contact_time=None))
    timed = objective.problem.contact_time is not None
    starts = objective.from_values(problem.free_rows(optima))
    columns = [k for k, name in enumerate(problem.free_names) if names is None or name in names]
    top, others = best_top(objective, starts)
    paths: Paths = {}
    for _ in range(RESTARTS):
        if unbounded := _noise_at_bound(objective, top):
            return Profiles(-top.cost, timed, {}, unbounded)
        follow = partial(_followed, objective=objective, top=top, others=others)
        if engine is None:
            found = [follow(columns, report=report)]
        else:
            report("outwards and inwards")
            found = list(in_order(engine, follow, [[column] for column in columns]))
        better = next((part for part in found if not isinstance(part, dict)), None)
        if better is None:
            paths = {column: line for part in found if isinstance(part, dict) for column, line in part.items()}
            break
        top, others = best_top(objective, np.concatenate([better[None, :], top.x[None, :], others]))
    if columns and not paths:
        return Profiles(
            -top.cost, timed, {}, f"after {RESTARTS} searches, higher maxima of the likelihood still appear"
        )
    lowest = min([top.cost, *(point.cost for points in paths.values() for point in points)])
    ranged = ended_by_range(objective, paths, top, lowest)
    named = {
        problem.free[k].name: _profile(objective, k, points, lowest, (ranged.get((k, 0), ()), ranged.get((k, 1), ())))
        for k, points in paths.items()
    }
    return Profiles(-lowest, timed, named)


def _followed(
    columns: Sequence[int],
    objective: Surface,
    top: Top,
    others: FloatArray,
    report: Callable[[str], None] = lambda _stage: None,
) -> Paths | FloatArray:
    """Points of the free parameters `columns`; or, when a better maximum is met, where."""
    report("outwards")
    try:
        paths = profile_paths(objective, columns, top, others)
        changed = {column: set(range(len(points))) for column, points in paths.items()}
        tried = others
        for _ in range(SWEEPS):
            report("inwards")
            paths, changed = sweep(objective, paths, changed, tried, top)
            tried = others[:0]
            if not any(changed.values()):
                break
    except SurpassedError as better:
        return better.x
    return paths


def coverage(problem: Problem) -> float:
    """How often a drop of 1.92 holds the truth, for a linear model with one fitted noise of as many measurements and
    parameters: there twice the drop is `n ln(1 + t^2/(n - p))` with Student's t of `n - p` degrees of freedom.
    Measurements of a stated noise do not count, nor do the parameters that are theirs by their share.
    """
    fitted = {item.noise for item in problem.observables if item.noise in problem.free_names}
    count = sum(observable.observed.size for observable in problem.observables if observable.noise in fitted)
    if not fitted:
        return 1.0 - 2.0 * float(ndtr(-math.sqrt(2.0 * DROP_95)))
    freedom = degrees_of_freedom(problem, fitted)
    if freedom <= 0:
        return 0.0
    return 1.0 - 2.0 * float(stdtr(freedom, -math.sqrt(freedom * math.expm1(2.0 * DROP_95 / count))))


def degrees_of_freedom(problem: Problem, noises: Collection[str | None]) -> float:
    """How many measurements of these noises are left when the parameters took their share; infinite for what is the
    noise of none.
    """
    sizes = {observable.name: observable.observed.size for observable in problem.observables}
    count = sum(sizes[observable.name] for observable in problem.observables if observable.noise in noises)
    if not count:
        return math.inf
    spent = sum(name not in NOISE_SPECS for name in problem.free_names)
    return count - spent * count / sum(sizes.values())


def _noise_at_bound(objective: Surface, top: Top) -> str:
    """In words, that the likelihood has no maximum because a noise shrinks to nothing; empty when it does not.
    Scatter beyond stated errors may.
    """
    alone = {item.noise for item in objective.problem.observables if not item.scatters}
    for k, parameter in enumerate(objective.problem.free):
        # A noise within a thousandth of its bound, on its own scale, is there.
        if parameter.name in SD_SPECS and parameter.name in alone and top.at[k] <= objective.ends(k)[0] + 1e-3:
            return (
                "the likelihood has no maximum: the model can reproduce the measurements exactly, so "
                f"{parameter.name} "
                "goes to its bound unless its prior prevents that"
            )
    return ""


def _distinct(ordered: Sequence[Point], shown: Callable[[FloatArray], FloatArray]) -> list[Point]:
    """The points whose values rise: of those at one value, as a bound that two paths reached within rounding, the
    lowest.
    """
    values = np.asarray(shown(np.array([point.at for point in ordered])))
    kept: list[tuple[float, Point]] = []
    for value, point in zip(values.tolist(), ordered, strict=True):
        if kept and value <= kept[-1][0]:
            other = kept.pop()[1]
            point = replace(min(point, other, key=lambda one: one.cost), bound=point.bound or other.bound)
        kept.append((value, point))
    return [point for _value, point in kept]


def _profile(
    objective: Surface, column: int, ordered: Sequence[Point], lowest: float, ranged: tuple[Names, Names]
) -> Profile:
    parameter = objective.problem.free[column]
    shown = (lambda place: place) if objective.is_value(column) else parameter.prior.value
    ordered = _distinct(ordered, shown)
    at, cost = (np.array(part) for part in zip(*((point.at, point.cost) for point in ordered), strict=True))
    # What counts of a level, a bias or a constant of the ball besides the table does so for all others; for itself it
    # is a prior, and taken off again.
    apart, drop = False, np.maximum(cost - lowest, 0.0)
    if column in objective.columns:
        known = objective.knowledge_apart.take(objective.columns.index(column))
        apart = bool(known.precision[0] > 0.0)
        own = cost - known.cost(at[:, None])[:, 0]
        drop = own - own.min() if apart else drop
    ends, leans = [], []
    for k in (0, -1):
        end = End.BOUND if ordered[k].bound else End.SCATTER if apart else End.MODEL
        if drop[k] >= DROP_95:
            end = End.RANGE if ranged[k] else End.CLOSED
        ends.append(end)
        leans.append(ranged[k] or _names(objective, np.logical_or(*_resting(objective, column, ordered[k].x))))

    def interval(level: float) -> Interval:
        sides = _crossing(at[::-1], drop[::-1], level), _crossing(at, drop, level)
        # What closes by the range of another search is no end of an interval.
        left, right = (
            None if side is None or end is End.RANGE else float(shown(np.array(side)))
            for side, end in zip(sides, ends, strict=True)
        )
        return left, right

    return Profile(
        name=parameter.name,
        values=np.asarray(shown(at)),
        drop=drop,
        best=float(shown(at[np.argmin(drop)])),
        interval_68=interval(DROP_68),
        interval_95=interval(DROP_95),
        ends=(ends[0], ends[1]),
        leans_on=(leans[0], leans[1]),
        unsettled=sum(not point.settled for point in ordered),
    )


def _crossing(at: FloatArray, drop: FloatArray, level: float) -> float | None:
    """Where the drop, followed outwards, passes `level` for the last time, or None when it ends below.

    Linear in the root of the drop, which for a normal likelihood is exact (Bates and Watts 1988, section 6.1).
    """
    if drop[-1] < level:
        return None
    inside = int(np.flatnonzero(drop < level)[-1])
    root = np.sqrt(drop[inside : inside + 2])
    share = (math.sqrt(level) - root[0]) / (root[1] - root[0])
    return float(at[inside] + share * (at[inside + 1] - at[inside]))


def ended_by_range(
    objective: Surface, paths: Mapping[int, Sequence[Point]], top: Top, lowest: float
) -> dict[tuple[int, int], Names]:
    """By profiled free parameter and side (0, 1) the other parameters whose ends of search are what makes the profile
    fall there, where there are some.
    """
    low, high = objective.searched_for
    asked = []
    for column, points in paths.items():
        for side in (0, 1):
            below, above = _resting(objective, column, points[-side].x)
            if names := _names(objective, (below & low) | (above & high)):
                asked.append((column, side, points[-side], names))
    if not asked:
        return {}
    wide = replace(objective, stretched=True)
    at, x = (np.array(part) for part in zip(*((point.at, point.x) for _, _, point, _ in asked), strict=True))
    reached = descend(wide, searches(wide, [column for column, *_ in asked], at, x))
    # The maximum itself may gain by the same room.
    best = float(descend(wide, free_searches(wide, top.x[None, :])).cost[0])
    return {
        (column, side): names
        for cost, (column, side, point, names) in zip(reached.cost, asked, strict=True)
        if cost - best < KEPT * (point.cost - lowest)
    }


def _resting(objective: Surface, column: int, x: FloatArray) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which columns but that of a free parameter, and of noise, lie on their lower, and on their upper bound."""
    low, high = objective.limits
    others = np.array([k != column and objective.problem.free[k].name not in NOISE_SPECS for k in objective.columns])
    return (x - low < NEAR * objective.width) & others, (high - x < NEAR * objective.width) & others


def _names(objective: Surface, chosen: NDArray[np.bool_]) -> Names:
    return tuple(objective.problem.free[objective.columns[k]].name for k in np.flatnonzero(chosen))


def profile_contraction(profile: Profile, prior: Prior) -> float:
    """The contraction that the table promises by itself, without the first order: of prior times profile likelihood.
    Below its ends the root of the drop goes on as a line.
    """
    at, root = prior.coordinate(profile.values), np.sqrt(profile.drop)
    slopes = [abs((root[k] - root[j]) / (at[k] - at[j])) if len(at) > 1 else 0.0 for j, k in ((1, 0), (-2, -1))]

    def drop(place: FloatArray) -> FloatArray:
        beyond = np.maximum(at[0] - place, 0.0) * slopes[0] + np.maximum(place - at[-1], 0.0) * slopes[1]
        return np.asarray((np.interp(place, at, root) + beyond) ** 2)

    return left_of(prior, drop)


def left_of(prior: Prior, drop: Callable[[FloatArray], FloatArray]) -> float:
    """One minus the variance of a prior times a likelihood over that of the prior, in its coordinate; `drop` is that
    of the log likelihood at coordinates (levels,).
    """
    coordinate = prior.coordinate(prior.quantile((np.arange(LEVELS) + 0.5) / LEVELS))
    dropped = drop(coordinate)
    weight = np.exp(np.min(dropped) - dropped)
    mean = np.average(coordinate, weights=weight)
    return 1.0 - float(np.average((coordinate - mean) ** 2, weights=weight) / np.var(coordinate))
