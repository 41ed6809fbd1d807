"""Profile likelihoods: paths of all parameters walk outwards together.

The likelihood with one parameter held, all others at their best; what the scene measured counts
with the data. One batch of searches a step, until the drop passes the 95 % level with a margin or a
bound is met. Each search begins where the last two points of its path point to, and at every other
maximum that is nearly as high: so the profile is that of the highest.

With an unknown noise the log likelihood of a linear model drops by n/2 ln(1 + t^2/(n-p)), n
measurements and p parameters, where Student's t of n-p is t: at 95 % that is 1.92 of many
measurements, and 3.0 of 7 with 2 parameters.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitball.base.priors import parse_prior
from fitball.base.values import FloatArray
from fitball.inference.effort import PROFILED_ROWS
from fitball.inference.problem.problem import Problem
from fitball.inference.schema import Interval, Profile
from fitball.inference.search.objective import Objective, descend

# Shares of the intervals: one sd of a normal distribution to either side, and 95 %.
SHARES = (0.6826894921370859, 0.95)
# Where a path ends, in drops of the 95 % level: a margin, so that the level is crossed between two
# points of it.
DEPTH = 1.3
# What a step aims at, in drops of the 95 % level: some five points to either side.
AIM = 0.3
# The longest step, in drops of the 95 % level: what falls further at once may be a jump, and is
# tried again in shorter steps.
COARSE = 0.8
# A drop is good to this, ten times less than a path could notice.
PROMISED = 1e-3
# Tries, every second with half the step, before what cannot be evaluated is the model's end, and
# what is far lower a jump: after 8 halvings a step is 1/256 of what it was.
TRIES = 16
# The share of the way from the best value to which the model's end, or a jump, is found.
FINE = 1e-3
# Points of a path at most: where steps go as they aim it has five.
MOST = 80
# A maximum is higher from this gain of the log likelihood on: ten times what a drop is good to.
HIGHER = 0.01
# A maximum is one of its own from this distance in widths of priors on: nearer to each other lie
# ends of searches that climbed the same one.
SAME = 1e-2
# Searches for the highest maximum, each from a higher one that a path met.
RESTARTS = 8
# A value whose logarithm has no end is zero to rounding so far below the best.
EMPTY = 30.0
# A noise is at its bound from this share above it on.
AT_BOUND = 1e-3
# The shortest step after another, in lengths of that: one point may lie off the parabola.
SHRINK = 0.25
# The longest step after another, in lengths of that: a parabola is not trusted further out.
GROW = 2.0
# Share of the aim from which a drop tells of a parabola; a smaller one is flat to all purposes.
FLAT = 0.05
# A maximum that is nearer, in steps, is one that was just passed.
ROUNDING = 1e-9


@dataclass
class _Path:
    """One direction of one parameter: `at` (points,) where it was held, `x` the best coordinates
    there, `cost`; the `others` (rivals,) are where further maxima have it; searches `reached`
    (rows, free).
    """

    column: int
    end: float
    step: float
    level: float
    at: list[float]
    x: list[FloatArray]
    cost: list[float]
    others: FloatArray
    reached: FloatArray
    tries: int = 0
    running: bool = True

    @property
    def proposal(self) -> float:
        """Where the parameter is held next: a step ahead, at most at the end."""
        ahead = self.at[-1] + self.step
        return min(ahead, self.end) if self.step > 0.0 else max(ahead, self.end)

    def start(self) -> FloatArray:
        """Where the last two points point to; where that led nowhere, what searches reached
        before.
        """
        if self.tries % 2:
            return np.asarray(self.reached[self.tries // 2 % len(self.reached)])
        if len(self.at) < 2:
            return self.x[0]
        before, last = self.at[-2:]
        x_before, x_last = self.x[-2:]
        share = (self.proposal - last) / (last - before)
        return np.asarray(x_last + share * (x_last - x_before))

    def take(self, x: FloatArray, cost: float) -> None:
        """Take a point, or go back half a step; stop where the drop is enough, at the bound, or at
        the model's end. What lies between two maxima is passed over.
        """
        at = float(x[self.column])
        step = at - self.at[-1]
        way = abs(self.at[-1] - self.at[0])
        fine = self.tries >= TRIES or 0.0 < abs(step) <= FINE * way
        far = self.cost[-1] - self.cost[0] > DEPTH * self.level
        jump = cost - self.cost[-1] > COARSE * self.level
        sure = fine and self.tries % 2 == 1
        if not math.isfinite(cost) or (jump and not far and not sure):
            self.tries += 1
            # Along a wall there may be an answer from elsewhere.
            self.step = step if self.tries % 2 else 0.5 * step
            self.running = not (fine and self.tries % 2 == 0)
            return
        self.at.append(at)
        self.x.append(x)
        self.cost.append(cost)
        self.tries = 0
        self.step = self._next_step(step)
        if cost - self.cost[0] >= DEPTH * self.level:
            self._go_to_next_maximum(step)
        self.running &= abs(self.end - at) > 0.0 and len(self.at) < MOST

    def _next_step(self, step: float) -> float:
        """The step after one of `step`: it lowers the parabola from the top through the last point
        by the aim.
        """
        aim = AIM * self.level
        drop = self.cost[-1] - self.cost[0]
        aimed = math.inf
        if drop > FLAT * aim:
            away = abs(self.at[-1] - self.at[0])
            aimed = away * (math.sqrt(1.0 + aim / drop) - 1.0)
        length = max(aimed, SHRINK * abs(step))
        length = min(length, GROW * abs(step))
        return math.copysign(length, step)

    def _go_to_next_maximum(self, step: float) -> None:
        """After a drop that is enough, `step` the last: go on to the next maximum, or stop."""
        steps_ahead = (self.others - self.at[-1]) / step
        steps_ahead = steps_ahead[steps_ahead > ROUNDING]
        self.running = steps_ahead.size > 0
        self.step = step * float(steps_ahead.min()) if self.running else step


def profiles(problem: Problem, optima: FloatArray) -> tuple[dict[str, Profile], str]:
    """Of the free parameters, from the coordinates of optima (optima, free); or why there are none
    (more than PROFILED_ROWS, or measurements that leave nothing of the noise).
    """
    if len(problem.rows.y) > PROFILED_ROWS:
        as_good = f"Above {PROFILED_ROWS} impacts standard errors are as good as profiles"
        return {}, f"{as_good}, which are left out."
    levels = drops(problem)
    if not levels:
        return {}, "There are no more measurements than parameters: nothing is left for the noise."
    problem = _widened(problem)
    starts = optima
    for _ in range(RESTARTS):
        x, cost, converged = descend(Objective(problem, penalised=False), starts)
        order = np.argsort(cost, kind="stable")
        top = order[0]
        lowest = float(cost[top])
        maxima = [x[top]]
        for k in order[1:]:
            high = cost[k] < lowest + DEPTH * levels[1]
            if high and converged[k] and _is_apart(problem, x[k], maxima):
                maxima.append(x[k])
        if name := _vanishing(problem, x[top]):
            exactly = "The model can reproduce the measurements exactly"
            return {}, f"{exactly}: {name} goes to its bound."
        paths = _walk(problem, lowest, np.array(maxima), levels[1], x[order])
        if isinstance(paths, list):
            sides = zip(problem.free, paths[::2], paths[1::2], strict=True)
            return {name: _profile(problem, down, up, levels) for name, down, up in sides}, ""
        starts = np.concatenate([paths[None], maxima])
    return {}, f"After {RESTARTS} searches, higher maxima of the likelihood still appear."


def _is_apart(problem: Problem, x: FloatArray, maxima: Sequence[FloatArray]) -> bool:
    """Whether coordinates (free,) are none of those of the maxima (free,)."""
    distances = [np.max(np.abs(x - maximum) / problem.prior.width) for maximum in maxima]
    return all(distance > SAME for distance in distances)


def drops(problem: Problem) -> tuple[float, ...]:
    """The drops of the log likelihood of SHARES; none where the noise has no degree of freedom."""
    from scipy.special import ndtri, stdtrit

    measured = np.isfinite(problem.rows.y).sum(axis=0)
    noises = [item.noise for item in problem.observables]
    unknown = [name in problem.free for name in noises]
    count = int(measured[unknown].sum())
    fitted = [
        item
        for item in problem.prior.parameters
        if item.spec.name not in noises and not item.measured
    ]
    freedom = count - len(fitted) + (problem.contact_time is not None)
    if not count:
        return tuple(0.5 * float(ndtri(0.5 + 0.5 * share)) ** 2 for share in SHARES)
    if freedom < 1:
        return ()
    ends = (float(stdtrit(freedom, 0.5 + 0.5 * share)) for share in SHARES)
    return tuple(0.5 * count * math.log1p(end**2 / freedom) for end in ends)


def _widened(problem: Problem) -> Problem:
    """The same with steps of searches by the default priors where the user's are narrower: the
    likelihood is not.
    """
    ends = np.array([0.16, 0.84])
    with np.errstate(invalid="ignore", divide="ignore"):
        # A prior about zero says nothing of a logarithm.
        shown = [
            item.prior.coordinate(parse_prior(item.spec).quantile(ends))
            for item in problem.prior.parameters
        ]
    wide = 0.5 * np.ptp(shown, axis=1)
    width = np.fmax(problem.prior.width, np.where(np.isfinite(wide), wide, 0.0))
    return replace(problem, prior=replace(problem.prior, width=width))


def _vanishing(problem: Problem, top: FloatArray) -> str:
    """The noise of a column that goes to its bound; one beyond stated errors may."""
    values = problem.values(top[None])
    alone = {item.noise for item in problem.observables if not item.stated}
    for item in problem.prior.parameters:
        name = item.spec.name
        nearest = item.spec.lower * (1.0 + AT_BOUND)
        if name in alone and values[name][0] < nearest:
            return name
    return ""


def _walk(
    problem: Problem,
    lowest: float,
    maxima: FloatArray,
    level: float,
    reached: FloatArray,
) -> list[_Path] | FloatArray:
    """The paths of all parameters, down and up in turn; or where a higher maximum is met."""
    prior = problem.prior
    top = maxima[0]
    rivals = maxima[1:]
    step = math.sqrt(2.0 * AIM * level) * _errors(problem, top)
    low = np.where(np.isinf(prior.low), top - EMPTY, prior.low)
    high = np.where(np.isinf(prior.high), top + EMPTY, prior.high)
    paths = [
        _Path(
            k,
            end,
            first_step,
            level,
            [top[k]],
            [top],
            [lowest],
            rivals[:, k],
            reached,
            running=abs(end - top[k]) > 0.0,
        )
        for k in range(top.size)
        for end, first_step in ((low[k], -step[k]), (high[k], step[k]))
    ]
    while running := [path for path in paths if path.running]:
        searches = 1 + len(rivals)
        starts = np.concatenate([np.vstack([path.start(), rivals]) for path in running])
        held = np.repeat([path.column for path in running], searches)
        held_at = np.repeat([path.proposal for path in running], searches)
        starts[np.arange(len(held)), held] = held_at
        x, cost, _ = descend(Objective(problem, penalised=False, held=held), starts, PROMISED)
        if cost.min() < lowest - HIGHER:
            return np.asarray(x[np.argmin(cost)])
        best_searches = cost.reshape(-1, searches).argmin(axis=1)
        for k, path in enumerate(running):
            row = k * searches + best_searches[k]
            path.take(x[row], float(cost[row]))
    return paths


def _errors(problem: Problem, top: FloatArray) -> FloatArray:
    """Standard errors (free,) to first order, at most the widths of the priors."""
    width = problem.prior.width
    _, curvature = Objective(problem, penalised=False).linearised(top[None])
    scaled = curvature[0] * np.outer(width, width) + np.eye(top.size)
    variance = np.diag(np.linalg.inv(scaled))
    return np.asarray(width * np.sqrt(variance))


def _profile(problem: Problem, down: _Path, up: _Path, levels: Sequence[float]) -> Profile:
    """The profile of a parameter from its two paths, with an interval for each of the levels."""
    at, order = np.unique([*down.at[::-1], *up.at[1:]], return_index=True)
    drop = np.array([*down.cost[::-1], *up.cost[1:]])[order]
    drop = np.maximum(drop - drop.min(), 0.0)
    prior = problem.prior.parameters[down.column].prior

    def crossing(level: float, at: FloatArray, drop: FloatArray) -> float | None:
        """Where the drop passes a level for the last time on the way outwards, linear in its root
        (Bates and Watts 1988, section 6.1).
        """
        if drop[-1] < level:
            return None
        k = int(np.flatnonzero(drop < level)[-1])
        below, above = np.sqrt(drop[k : k + 2])
        inner, outer = at[k : k + 2]
        share = (math.sqrt(level) - below) / (above - below)
        end = inner + share * (outer - inner)
        # The exponential of the C library, whose last digit numpy's does not always share.
        return math.exp(end) if prior.log else float(prior.value(np.asarray(end)))

    intervals = list[Interval]()
    for level in levels:
        low = crossing(level, at[::-1], drop[::-1])
        high = crossing(level, at, drop)
        intervals.append((low, high))
    return Profile(prior.value(at), drop, *intervals)
