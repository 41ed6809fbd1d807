"""How a profile is walked: outwards from the maximum with steps that adapt, then again from both sides.

All paths of all parameters advance together, so that each round of searches is one batch of the kernel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitball.inference.identifiability.fisher import inverse
from fitball.inference.point.gauss_newton import Reached, Searches, descend
from fitball.inference.point.surface import Conditions, Surface
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
    """The maximum: columns, cost, coordinates of the noise there, and the free parameters' standard errors."""

    x: FloatArray
    cost: float
    noise: FloatArray
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


def searches(objective: Surface, columns: Sequence[int], at: FloatArray, x: FloatArray, scene: bool) -> Searches:
    """Searches from `x` (rows, columns) that hold the free parameters `columns` (rows,) at `at` (rows,)."""
    x = x.copy()
    held = np.full(len(columns), -1)
    noise = np.full((len(columns), len(objective.noise_columns)), np.nan)
    for row, column in enumerate(columns):
        if column in objective.noise_columns:
            noise[row, objective.noise_columns.index(column)] = at[row]
        else:
            held[row] = objective.columns.index(column)
            x[row, held[row]] = at[row]
    return Searches(x, held, Conditions(noise, scene))


def free_searches(objective: Surface, x: FloatArray, scene: bool) -> Searches:
    """Searches that hold nothing."""
    noise = np.full((x.shape[0], len(objective.noise_columns)), np.nan)
    return Searches(x, np.full(x.shape[0], -1), Conditions(noise, scene))


def best_top(objective: Surface, starts: FloatArray, scene: bool) -> tuple[Top, FloatArray]:
    """The highest maximum reached from `starts` (rows, columns), and the other ones that may matter."""
    given = free_searches(objective, starts, scene)
    # A profile followed down to DEPTH cannot meet an optimum that lies below that; twice as deep, lest one is missed.
    reached = descend(objective, given, rivals=2.0 * DEPTH)
    order = np.argsort(reached.cost, kind="stable")
    best = int(order[0])
    others: list[int] = []
    for k in order[1:]:
        apart = [np.max(np.abs(reached.x[k] - reached.x[j]) / objective.width) > SAME for j in (best, *others)]
        if all(apart) and reached.settled[k] and reached.cost[k] < reached.cost[best] + DEPTH:
            others.append(int(k))
    top = reached.x[best][None, :]
    values = objective.values(top, given.given.take(np.array([best])))
    noise = objective.problem.to_coordinates(values)[0, objective.noise_columns]
    return Top(top[0], float(reached.cost[best]), noise, standard_errors(objective, top, scene)), reached.x[others]


def standard_errors(objective: Surface, x: FloatArray, scene: bool) -> FloatArray:
    """Standard errors (free,) to first order, at most the widths of the priors."""
    problem = objective.problem
    _, curvature = objective.linearised(x, free_searches(objective, x, scene).given)
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


def profile_paths(
    objective: Surface, columns: Sequence[int], top: Top, others: FloatArray, scene: bool
) -> tuple[dict[int, list[Point]], FloatArray | None]:
    """Points of the free parameters `columns` from the maximum outwards, and from those of the `others` (rows,
    columns), maxima that are nearly as high, that lie further out; or, when a better maximum is met, where.
    """
    found: dict[int, list[Point]] = {column: [] for column in columns}
    start = np.empty(objective.problem.dimension)
    start[objective.columns] = top.x
    start[objective.noise_columns] = top.noise
    origins = [(k, Point(float(start[k]), top.x, top.cost, True, bound=False)) for k in columns]
    remaining = _origins(objective, columns, others, scene)
    while origins:
        paths, better = _walk(objective, origins, top, scene)
        if better is not None:
            return {}, better
        for path in paths:
            found[path.column] += path.points[1:] if path.direction > 0.0 else path.points
        # What lies between the ends of a path was on its way.
        remaining = [(k, point) for k, point in remaining if not _within(found[k], point.at)]
        # One of each parameter, as its paths may come across the next.
        origins = list(dict(remaining).items())
    return {k: sorted(points, key=lambda point: point.at) for k, points in found.items()}, None


def _within(points: Sequence[Point], at: float) -> bool:
    return min(point.at for point in points) <= at <= max(point.at for point in points)


def _origins(objective: Surface, columns: Sequence[int], x: FloatArray, scene: bool) -> list[tuple[int, Point]]:
    """Where paths of `columns` begin at `x` (rows, columns)."""
    if x.shape[0] == 0:
        return []
    given = free_searches(objective, x, scene).given
    values, cost = objective.values(x, given), objective.cost(x, given)
    noise = objective.problem.to_coordinates(values)
    made = []
    for k in columns:
        at = noise[:, k] if k in objective.noise_columns else x[:, objective.columns.index(k)]
        made += [(k, Point(float(at[row]), x[row], float(cost[row]), True, bound=False)) for row in range(len(x))]
    return made


def _walk(
    objective: Surface, origins: Sequence[tuple[int, Point]], top: Top, scene: bool
) -> tuple[list[_Path], FloatArray | None]:
    """Paths from `origins` to both sides until the drop is enough; or, when a better maximum is met, where."""
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
        reached = descend(objective, searches(objective, held, at, x, scene))
        reached = _around_walls(objective, held, at, x, reached, top, scene)
        better = int(np.argmin(reached.cost))
        if reached.cost[better] < top.cost - HIGHER:
            return paths, reached.x[better]
        for row, path in enumerate(running):
            path.accept(_point(reached, row, float(at[row]), path.end), top.cost)
    return paths, None


def _around_walls(
    objective: Surface,
    columns: Sequence[int],
    at: FloatArray,
    x: FloatArray,
    reached: Reached,
    top: Top,
    scene: bool,
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
        given = searches(objective, [columns[row]] * len(beside), np.full(len(beside), at[row]), beside, scene)
        cost = objective.cost(given.x, given.given)
        best = np.argsort(cost, kind="stable")[:DETOURS]
        starts += [beside[k] for k in best if np.isfinite(cost[k])]
        owners += [row] * int(np.sum(np.isfinite(cost[best])))
    if not owners:
        return reached
    given = searches(objective, [columns[row] for row in owners], at[owners], np.array(starts), scene)
    found = descend(objective, given)
    # The lowest of each row, which comes last.
    order = np.argsort(-found.cost, kind="stable")
    rows = np.array(owners)[order]
    whole = Reached(reached.x.copy(), reached.cost.copy(), reached.settled.copy())
    whole.x[rows], whole.cost[rows], whole.settled[rows] = found.x[order], found.cost[order], found.settled[order]
    return whole


def _point(reached: Reached, row: int, at: float, end: float) -> Point:
    # The proposal is the end itself when it is cut there.
    return Point(at, reached.x[row], float(reached.cost[row]), bool(reached.settled[row]), abs(at - end) <= 0.0)


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
    objective: Surface,
    points: dict[int, list[Point]],
    changed: dict[int, set[int]],
    others: FloatArray,
    top: Top,
    scene: bool,
) -> tuple[dict[int, list[Point]], FloatArray | None, dict[int, set[int]]]:
    """Try every point again from `others`, other optima, and points that stand out from those of their neighbours
    that have `changed`; what was gained, where a better maximum was met, and which points changed now.
    """
    owners: list[tuple[int, int]] = []
    starts: list[FloatArray] = []
    for column, line in points.items():
        out = _stand_out(line, top)
        for k in range(len(line)):
            beside = (k - 1, k + 1) if k in out else ()
            neighbours = [line[j].x for j in beside if 0 <= j < len(line) and j in changed[column]]
            for x in (*neighbours, *others):
                owners.append((column, k))
                starts.append(x)
    at = np.array([points[column][k].at for column, k in owners])
    if not owners:
        return points, None, {}
    goal = np.array([points[column][k].cost for column, k in owners])
    given = searches(objective, [column for column, _ in owners], at, np.array(starts), scene)
    reached = descend(objective, given, goal)
    better = int(np.argmin(reached.cost))
    if reached.cost[better] < top.cost - HIGHER:
        return points, reached.x[better], {}
    result = {column: list(line) for column, line in points.items()}
    gained: dict[int, set[int]] = {column: set() for column in points}
    for row, (column, k) in enumerate(owners):
        old = result[column][k]
        if reached.cost[row] < old.cost:
            if reached.cost[row] < old.cost - HIGHER:
                gained[column].add(k)
            result[column][k] = Point(
                old.at, reached.x[row], float(reached.cost[row]), bool(reached.settled[row]), old.bound
            )
    return result, None, gained
