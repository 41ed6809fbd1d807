"""How a profile is walked: outwards from the best optimum, each search from where its neighbours point to, until the
drop passes 1.92 with a margin or a bound is met, and from other optima that are nearly as high and lie beyond. Then
every point is tried again from the other optima, and one above its neighbours from these. So the profile is that of
the highest of several optima. All paths of all parameters advance together: each round of searches is one batch of
the kernel.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitball.inference.identifiability.information import inverse
from fitball.inference.point.gauss_newton import Reached, Searches, descend
from fitball.inference.point.surface import Surface
from fitball.values import FloatArray

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

Paths = dict[int, list["Point"]]


class SurpassedError(Exception):
    """A higher maximum than the one from which a profile is walked; `x` (columns,) is where."""

    def __init__(self, x: FloatArray) -> None:
        super().__init__("a higher maximum was found")
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
