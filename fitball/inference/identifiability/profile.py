"""Profile likelihoods: for each value of one parameter the best that the measurements allow, all others free.

What is maximised is the likelihood of the table, with the scene's contact time as one more measurement (or without
it); no prior takes part but that of a constant of the ball whose sd the scene states, a measurement of its own; the
bounds do, and the noise is at its best at every point. Twice the drop of its logarithm
below the maximum is chi-square distributed with one degree of freedom when rows are many (Wilks 1938; Venzon and
Moolgavkar 1988), so that a drop of 0.5 ends a 68 % interval and one of 1.92 a 95 % interval. With a fitted noise and
few rows the intervals are too narrow: there the posterior is the better guide to size, and the profile to shape.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial

import numpy as np
from scipy.special import gammaincinv, ndtr, stdtr

from fitball.inference.identifiability.profile_ends import at_bounds, ended_by_range
from fitball.inference.identifiability.profile_path import Point, Top, best_top, profile_paths, sweep
from fitball.inference.point.surface import Surface, surface_of
from fitball.inference.problem.parameters import NOISE_SPECS, SD_SPECS
from fitball.inference.problem.problem import Problem
from fitball.inference.results.evidence import End, Interval, Profile, Profiles
from fitball.scheduling.engine import Engine, in_order
from fitball.values import FloatArray

# Half the quantiles of chi-square with one degree of freedom.
DROP_68, DROP_95 = 0.5, float(gammaincinv(0.5, 0.95))
# How often a better optimum met on the way may begin the search anew.
RESTARTS = 8
SWEEPS = 3


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

    Searches go outwards from the best optimum, each from where its neighbours point to, until the drop passes 1.92
    with a margin or a bound is met, and from other optima that are nearly as high and lie beyond. Then every point is
    tried again from the other optima, and one that stands out from its neighbours from these, so that the profile is
    that of the highest of several optima. A better optimum met on the way begins it all anew. With an `engine` each
    parameter is a task; without, the searches of all advance together, which is faster on few rows. Both find the
    same.
    """
    objective = surface_of(problem)
    starts = objective.from_values(problem.free_rows(optima))
    columns = [k for k, name in enumerate(problem.free_names) if names is None or name in names]
    scene = scene and problem.contact_time is not None
    top, others = best_top(objective, starts, scene)
    paths: dict[int, list[Point]] = {}
    for _ in range(RESTARTS):
        unbounded = _noise_at_bound(objective, top)
        if unbounded:
            return Profiles(-top.cost, scene, {}, unbounded)
        follow = partial(_followed, objective=objective, top=top, others=others, scene=scene)
        if engine is None:
            found = [follow(columns, report=report)]
        else:
            report("outwards and from both sides")
            found = list(in_order(engine, follow, [[column] for column in columns]))
        better = next((at for _part, at in found if at is not None), None)
        if better is None:
            paths = {column: line for part, _at in found for column, line in part.items()}
            break
        top, others = best_top(objective, np.concatenate([better[None, :], top.x[None, :], others]), scene)
    if columns and not paths:
        return Profiles(-top.cost, scene, {}, f"after {RESTARTS} searches a higher maximum is still met on the way")
    lowest = min([top.cost, *(point.cost for points in paths.values() for point in points)])
    ranged = ended_by_range(objective, paths, top, lowest, scene)
    named = {problem.free[k].name: _profile(objective, k, points, lowest, ranged[k]) for k, points in paths.items()}
    return Profiles(-lowest, scene, named)


def _followed(
    columns: Sequence[int],
    objective: Surface,
    top: Top,
    others: FloatArray,
    scene: bool,
    report: Callable[[str], None] = lambda _stage: None,
) -> tuple[dict[int, list[Point]], FloatArray | None]:
    """Points of the free parameters `columns`; or, when a better maximum is met, where."""
    report("outwards")
    paths, better = profile_paths(objective, columns, top, others, scene)
    changed = {column: set(range(len(points))) for column, points in paths.items()}
    tried = others
    for _ in range(SWEEPS if better is None else 0):
        report("from both sides")
        paths, better, changed = sweep(objective, paths, changed, tried, top, scene)
        tried = others[:0]
        if better is not None or not any(changed.values()):
            break
    return paths, better


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
    """In words, that the likelihood has no maximum because a noise shrinks to nothing; empty when it does not."""
    at = np.zeros(objective.problem.dimension)
    at[objective.columns], at[objective.noise_columns] = top.x, top.noise
    for k, parameter in enumerate(objective.problem.free):
        # A noise within a thousandth of its bound, on its own scale, is there.
        if parameter.name in SD_SPECS and at[k] <= objective.ends(k)[0] + 1e-3:
            return (
                f"the likelihood has no maximum: the parameters pass through the measurements, and {parameter.name} "
                "falls to its bound; only its prior keeps it from there"
            )
    return ""


def _profile(
    objective: Surface,
    column: int,
    points: list[Point],
    lowest: float,
    ranged: tuple[tuple[str, ...], tuple[str, ...]],
) -> Profile:
    parameter = objective.problem.free[column]
    ordered = sorted(points, key=lambda point: point.at)
    at = np.array([point.at for point in ordered])
    precision, centre = _own_knowledge(objective, column)
    drop = _drop(at - centre, np.array([point.cost for point in ordered]), precision, lowest)
    values = at if objective.is_value(column) else parameter.prior.value(at)
    ends, leans = [], []
    for k in (0, -1):
        closed, bound = drop[k] >= DROP_95, End.BOUND if ordered[k].bound else End.MODEL
        bound = End.SCATTER if precision > 0.0 and not ordered[k].bound else bound
        ends.append((End.RANGE if ranged[k] else End.CLOSED) if closed else bound)
        leans.append(ranged[k] or at_bounds(objective, column, ordered[k]))

    def interval(level: float) -> Interval:
        low, high = _crossing(at[::-1], drop[::-1], level), _crossing(at, drop, level)
        # What closes by the range of another search is no end of an interval.
        sides = np.array(
            [
                math.nan if side is None or end is End.RANGE else side
                for side, end in zip((low, high), ends, strict=True)
            ]
        )
        shown = sides if objective.is_value(column) else parameter.prior.value(sides)
        left, right = (None if math.isnan(side) else float(side) for side in shown)
        return left, right

    return Profile(
        name=parameter.name,
        values=values,
        drop=drop,
        best=float(values[np.argmin(drop)]),
        interval_68=interval(DROP_68),
        interval_95=interval(DROP_95),
        ends=(ends[0], ends[1]),
        leans_on=(leans[0], leans[1]),
        unsettled=sum(not point.settled for point in ordered),
    )


def _own_knowledge(objective: Surface, column: int) -> tuple[float, float]:
    """Precision and centre of what counts in a profile of a level, a bias or a constant of the ball besides the
    table; no precision for all others.
    """
    if column not in objective.columns:
        return 0.0, 0.0
    precision, centre = (part[objective.columns.index(column)] for part in objective.knowledge_apart)
    return float(precision), float(centre)


def _drop(away: FloatArray, cost: FloatArray, precision: float, lowest: float) -> FloatArray:
    """The drop at each point, so far `away` from the centre of what is known apart. That counts for all others, and
    is a prior for itself: there it is taken off again.
    """
    if precision <= 0.0:
        return np.maximum(cost - lowest, 0.0)
    own: FloatArray = cost - 0.5 * precision * away**2
    return np.asarray(own - own.min())


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
