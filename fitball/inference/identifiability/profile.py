"""The profile of each parameter: the likelihood with it held, all others at their best, and how its two ends close.

It is walked outwards from the best optimum, each search from where its neighbours point to, until the drop passes
1.92 with a margin or a bound is met, and from other optima that are nearly as high and lie beyond. Then every point
is tried again from the other optima, and one that stands out from its neighbours from these, so that the profile is
that of the highest of several optima. A better optimum met on the way begins it all anew. All paths of all parameters
advance together: each round of searches is one batch of the kernel.

A bound of physics (a mass ratio of one, a restitution between zero and one) is part of the model: what is known with
it is known. A bound that only ends a search is nobody's knowledge. Where it is all that makes a profile fall, the
table leaves that side open: so it is found by searching further.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv, ndtr, stdtr

from fitball.inference.identifiability.information import inverse
from fitball.inference.point.gauss_newton import Reached, Searches, descend
from fitball.inference.point.surface import Surface, surface_of
from fitball.inference.problem.parameters import NOISE_SPECS, SD_SPECS
from fitball.inference.problem.priors import Prior
from fitball.inference.problem.problem import Problem
from fitball.inference.results.evidence import End, Interval, Profile, Profiles
from fitball.scheduling.engine import Engine, in_order
from fitball.values import FloatArray

# Half the quantiles of chi-square with one degree of freedom.
DROP_68, DROP_95 = 0.5, float(gammaincinv(0.5, 0.95))
# How often a better optimum met on the way may begin the search anew.
RESTARTS = 8
SWEEPS = 3
# Where a path ends: a 95 % interval ends at 1.92.
DEPTH = 2.5
# The change of the log likelihood that a step aims at, and what it accepts: between points the root of the drop is
# close to a line.
AIM, COARSE = 0.6, 1.5
# A drop below this says nothing of how a profile goes on.
FLAT = 0.03
# Halvings of a step after which what cannot be evaluated counts as the end of what the model can do.
HALVINGS = 8
# Standard errors by which single parameters are moved to find a way round a wall, and ways that are tried.
ASIDE, DETOURS = (0.3, 1.0, 3.0), 3
# A step below this share of the prior's width creeps towards a wall that it will never pass.
CREEPING = 1e-9
MOST_POINTS = 80
# A likelihood higher than this above the maximum is a better optimum; a change below it is none.
HIGHER = 0.01
# Optima nearer than this, in widths of the priors, are one.
SAME = 1e-2
# How far a point stands out, in the root of the drop over the line through its neighbours', that is worth a trial.
STANDS_OUT = 0.03
# Share of its drop that a profile keeps at least where bounds that only end a search move out by one width of their
# prior; below it those bounds were most of what closed it.
KEPT = 0.5
# Distance from a bound, in widths of the prior, below which a parameter lies on it.
NEAR = 1e-6
# Quantiles of a prior over which a profile is weighed.
LEVELS = 4000

Names = tuple[str, ...]
Paths = dict[int, list["Point"]]


class SurpassedError(Exception):
    """A higher maximum than the one from which a profile is walked; `x` (columns,) is where."""

    def __init__(self, x: FloatArray) -> None:
        super().__init__("a higher maximum was met")
        self.x = x


@dataclass(frozen=True)
class Point:
    """A point of a profile: the held coordinate, all columns, the cost; `bound` where a bound of the parameter is."""

    at: float
    x: FloatArray
    cost: float
    settled: bool
    bound: bool


@dataclass(frozen=True)
class Top:
    """The maximum: columns, cost, coordinates of all free parameters as profiles have them, their standard errors."""

    x: FloatArray
    cost: float
    at: FloatArray
    errors: FloatArray


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
    starts = objective.from_values(np.array([[optimum[name] for name in problem.free_names] for optimum in optima]))
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
            report("outwards and from both sides")
            found = list(in_order(engine, follow, [[column] for column in columns]))
        better = next((part for part in found if not isinstance(part, dict)), None)
        if better is None:
            paths = {column: line for part in found if isinstance(part, dict) for column, line in part.items()}
            break
        top, others = best_top(objective, np.concatenate([better[None, :], top.x[None, :], others]))
    if columns and not paths:
        return Profiles(-top.cost, timed, {}, f"after {RESTARTS} searches a higher maximum is still met on the way")
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
            report("from both sides")
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
    """In words, that the likelihood has no maximum because a noise shrinks to nothing; empty when it does not."""
    for k, parameter in enumerate(objective.problem.free):
        # A noise within a thousandth of its bound, on its own scale, is there.
        if parameter.name in SD_SPECS and top.at[k] <= objective.ends(k)[0] + 1e-3:
            return (
                f"the likelihood has no maximum: the parameters pass through the measurements, and {parameter.name} "
                "falls to its bound; only its prior keeps it from there"
            )
    return ""


def _profile(
    objective: Surface, column: int, ordered: Sequence[Point], lowest: float, ranged: tuple[Names, Names]
) -> Profile:
    parameter = objective.problem.free[column]
    at, cost = (np.array(part) for part in zip(*((point.at, point.cost) for point in ordered), strict=True))
    # What counts of a level, a bias or a constant of the ball besides the table does so for all others; for itself it
    # is a prior, and taken off again.
    precision = centre = 0.0
    if column in objective.columns:
        precision, centre = (float(part[objective.columns.index(column)]) for part in objective.knowledge_apart)
    drop = np.maximum(cost - lowest, 0.0)
    if precision > 0.0:
        own = cost - 0.5 * precision * (at - centre) ** 2
        drop = own - own.min()
    shown = (lambda place: place) if objective.is_value(column) else parameter.prior.value
    ends, leans = [], []
    for k in (0, -1):
        end = End.BOUND if ordered[k].bound else End.SCATTER if precision > 0.0 else End.MODEL
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


# --- how it is walked


@dataclass
class _Path:
    """One direction of one parameter; steps below `least` end it."""

    column: int
    direction: float
    end: float
    step: float
    least: float
    points: list[Point]
    halvings: int = 0
    running: bool = True

    def proposal(self) -> float:
        """The next value to hold."""
        following = self.points[-1].at + self.direction * self.step
        return min(following, self.end) if self.direction > 0.0 else max(following, self.end)

    def start(self) -> FloatArray:
        """Where the next search begins: where the last two points point to."""
        if len(self.points) < 2:
            return self.points[-1].x
        before, last = self.points[-2:]
        return last.x + (self.proposal() - last.at) / (last.at - before.at) * (last.x - before.x)

    def accept(self, point: Point, lowest: float) -> None:
        """Take a point or go back half a step; stop where the drop is enough, at the bound, or at the model's end."""
        last = self.points[-1]
        rise = point.cost - last.cost
        far = last.cost - lowest > DEPTH
        if not np.isfinite(point.cost) or (rise > COARSE and not far and self.halvings < HALVINGS):
            self.halvings += 1
            self.step = 0.5 * abs(point.at - last.at)
            self.running = self.halvings <= HALVINGS and self.step >= self.least
            return
        self.points.append(point)
        self.halvings = 0
        self.step = self._next_step(point, lowest)
        self.running = point.cost - lowest < DEPTH and not point.bound and len(self.points) < MOST_POINTS

    def _next_step(self, point: Point, lowest: float) -> float:
        """The step that lowers a parabola from the top through this point by the aim; at most twice the last."""
        last = abs(point.at - self.points[-2].at)
        drop = point.cost - lowest
        if drop < FLAT:
            return 2.0 * last
        away = abs(point.at - self.points[0].at)
        return min(max(away * (float(np.sqrt(1.0 + AIM / drop)) - 1.0), 0.25 * last), 2.0 * last)


def searches(objective: Surface, columns: Sequence[int], at: FloatArray, x: FloatArray) -> Searches:
    """Searches from `x` (rows, columns) that hold the free parameters `columns` (rows,) at `at` (rows,)."""
    free = free_searches(objective, x.copy())
    for row, column in enumerate(columns):
        if column in objective.noise_columns:
            free.given.noise[row, objective.noise_columns.index(column)] = at[row]
        else:
            free.held[row] = objective.columns.index(column)
            free.x[row, free.held[row]] = at[row]
    return free


def free_searches(objective: Surface, x: FloatArray) -> Searches:
    """Searches that hold nothing."""
    return Searches(x, np.full(x.shape[0], -1), objective.free(x))


def best_top(objective: Surface, starts: FloatArray) -> tuple[Top, FloatArray]:
    """The highest maximum reached from `starts` (rows, columns), and the other ones that may matter."""
    # A profile followed down to DEPTH cannot meet an optimum that lies below that; twice as deep, lest one is missed.
    reached = descend(objective, free_searches(objective, starts), rivals=2.0 * DEPTH)
    best, *rest = map(int, np.argsort(reached.cost, kind="stable"))
    others: list[int] = []
    for k in rest:
        apart = [np.max(np.abs(reached.x[k] - reached.x[j]) / objective.width) > SAME for j in (best, *others)]
        if all(apart) and reached.settled[k] and reached.cost[k] < reached.cost[best] + DEPTH:
            others.append(k)
    x = reached.x[best]
    errors = standard_errors(objective, x[None, :])
    return Top(x, float(reached.cost[best]), _places(objective, x[None, :])[0], errors), reached.x[others]


def _places(objective: Surface, x: FloatArray) -> FloatArray:
    """Coordinates (rows, free) as profiles have them, the noise at its best."""
    at = objective.problem.to_coordinates(objective.values(x, objective.free(x)))
    at[:, objective.columns] = x
    return at


def standard_errors(objective: Surface, x: FloatArray) -> FloatArray:
    """Standard errors (free,) to first order at `x` (1, columns), at most the widths of the priors."""
    problem = objective.problem
    _, curvature = objective.linearised(x, objective.free(x))
    errors = problem.prior.width.copy()
    # The width of the prior as a weak measurement keeps unseen directions finite; where there is no derivative, it is
    # all there is.
    shares = np.sqrt(np.diag(inverse(curvature[0] * np.outer(objective.width, objective.width), 1.0)))
    errors[objective.columns] = objective.width * np.where(np.isfinite(shares), shares, 1.0)
    for k in objective.noise_columns:
        name = problem.free[k].name
        count = sum(observable.observed.size for observable in problem.observables if observable.noise == name)
        scale = 1.0 if problem.free[k].prior.log else float(problem.free[k].prior.quantile(np.array([0.5]))[0])
        errors[k] = scale / np.sqrt(2.0 * count)
    return errors


def profile_paths(objective: Surface, columns: Sequence[int], top: Top, others: FloatArray) -> Paths:
    """Points of the free parameters `columns` from the maximum outwards, and from those of the `others` (rows,
    columns), maxima that are nearly as high, that lie further out. Raises SurpassedError.
    """
    found: Paths = {column: [] for column in columns}
    origins = [(k, Point(float(top.at[k]), top.x, top.cost, True, bound=False)) for k in columns]
    remaining: list[tuple[int, Point]] = []
    if len(others):
        at, cost = _places(objective, others), objective.cost(others, objective.free(others))
        remaining = [
            (k, Point(float(at[row, k]), others[row], float(cost[row]), True, bound=False))
            for k in columns
            for row in range(len(others))
        ]
    while origins:
        for path in _walk(objective, origins, top):
            found[path.column] += path.points[1:] if path.direction > 0.0 else path.points
        # What lies between the ends of a path was on its way.
        remaining = [(k, point) for k, point in remaining if not _within(found[k], point.at)]
        # One of each parameter, as its paths may come across the next.
        origins = list(dict(remaining).items())
    return {k: sorted(points, key=lambda point: point.at) for k, points in found.items()}


def _within(points: Sequence[Point], at: float) -> bool:
    return min(point.at for point in points) <= at <= max(point.at for point in points)


def _walk(objective: Surface, origins: Sequence[tuple[int, Point]], top: Top) -> list[_Path]:
    """Paths from `origins` to both sides until the drop is enough. Raises SurpassedError."""
    paths = []
    for k, origin in origins:
        low, high = objective.ends(k)
        for direction, end in ((-1.0, low), (1.0, high)):
            begin = replace(origin, bound=origin.at in (low, high))
            # On a parabola a drop of the aim.
            first = float(np.sqrt(2.0 * AIM)) * float(top.errors[k])
            least = CREEPING * float(objective.problem.prior.width[k])
            paths.append(_Path(k, direction, end, first, least, [begin], running=origin.at != end))
    while running := [path for path in paths if path.running]:
        at = np.array([path.proposal() for path in running])
        x = np.array([path.start() for path in running])
        held = [path.column for path in running]
        reached = _around_walls(objective, held, at, x, descend(objective, searches(objective, held, at, x)), top)
        _surpassed(reached, top)
        for row, path in enumerate(running):
            # The proposal is the end itself when it is cut there.
            bound = abs(float(at[row]) - path.end) <= 0.0
            point = Point(float(at[row]), reached.x[row], float(reached.cost[row]), bool(reached.settled[row]), bound)
            path.accept(point, top.cost)
    return paths


def _surpassed(reached: Reached, top: Top) -> None:
    better = int(np.argmin(reached.cost))
    if reached.cost[better] < top.cost - HIGHER:
        raise SurpassedError(reached.x[better])


def _around_walls(
    objective: Surface, columns: Sequence[int], at: FloatArray, x: FloatArray, reached: Reached, top: Top
) -> Reached:
    """What searches that began where the model has no answer reach from beside there: a wall that others make, as
    levels of a restitution that the mass ratio must exceed do, is no end of a profile where they give way.
    """
    errors = top.errors[objective.columns]
    moves = np.concatenate([sign * far * np.diag(errors) for far in ASIDE for sign in (1.0, -1.0)])
    low, high = objective.limits
    owners: list[int] = []
    starts: list[FloatArray] = []
    for row in map(int, np.flatnonzero(~np.isfinite(reached.cost))):
        beside = np.clip(x[row] + moves, low, high)
        given = searches(objective, [columns[row]] * len(beside), np.full(len(beside), at[row]), beside)
        cost = objective.cost(given.x, given.given)
        best = np.argsort(cost, kind="stable")[:DETOURS]
        starts += [beside[k] for k in best if np.isfinite(cost[k])]
        owners += [row] * int(np.sum(np.isfinite(cost[best])))
    if not owners:
        return reached
    given = searches(objective, [columns[row] for row in owners], at[owners], np.array(starts))
    found = descend(objective, given)
    # The lowest of each row, which comes last.
    order = np.argsort(-found.cost, kind="stable")
    rows = np.array(owners)[order]
    whole = Reached(reached.x.copy(), reached.cost.copy(), reached.settled.copy())
    whole.x[rows], whole.cost[rows], whole.settled[rows] = found.x[order], found.cost[order], found.settled[order]
    return whole


def _stand_out(line: Sequence[Point], top: Top) -> Sequence[int]:
    """Places of the points of a profile that a search from their neighbours may lower."""
    if len(line) < 3:
        return range(len(line))
    at = np.array([point.at for point in line])
    root = np.sqrt(np.maximum([point.cost - top.cost for point in line], 0.0))
    # On either side of the maximum the root of the drop is close to a line.
    signed = np.where(np.arange(len(line)) < int(np.argmin(root)), -root, root)
    between = signed[:-2] + (signed[2:] - signed[:-2]) * (at[1:-1] - at[:-2]) / (at[2:] - at[:-2])
    beyond = np.abs(signed[1:-1]) - np.abs(between)
    out = [k for k in range(1, len(line) - 1) if beyond[k - 1] > STANDS_OUT or not line[k].settled]
    return [k for k in range(len(line)) if k in out or (k in (0, len(line) - 1) and not line[k].settled)]


def sweep(
    objective: Surface, points: Paths, changed: Mapping[int, set[int]], others: FloatArray, top: Top
) -> tuple[Paths, dict[int, set[int]]]:
    """Try every point again from `others`, other optima, and points that stand out from those of their neighbours
    that have `changed`; what was gained, and which points changed now. Raises SurpassedError.
    """
    owners: list[tuple[int, int]] = []
    starts: list[FloatArray] = []
    for column, line in points.items():
        out = _stand_out(line, top)
        for k in range(len(line)):
            beside = (k - 1, k + 1) if k in out else ()
            neighbours = [line[j].x for j in beside if 0 <= j < len(line) and j in changed[column]]
            starts += [*neighbours, *others]
            owners += [(column, k)] * (len(neighbours) + len(others))
    if not owners:
        return points, {}
    at, goal = np.array([(points[column][k].at, points[column][k].cost) for column, k in owners]).T
    given = searches(objective, [column for column, _ in owners], at, np.array(starts))
    reached = descend(objective, given, goal)
    _surpassed(reached, top)
    result = {column: list(line) for column, line in points.items()}
    gained: dict[int, set[int]] = {column: set() for column in points}
    for row, (column, k) in enumerate(owners):
        old, cost = result[column][k], float(reached.cost[row])
        if cost < old.cost:
            if cost < old.cost - HIGHER:
                gained[column].add(k)
            result[column][k] = replace(old, x=reached.x[row], cost=cost, settled=bool(reached.settled[row]))
    return result, gained
