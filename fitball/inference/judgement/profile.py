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

from fitball.base.numbers import counted
from fitball.base.priors import parse_prior
from fitball.base.values import FloatArray
from fitball.inference.effort import PROFILED
from fitball.inference.problem.problem import Problem
from fitball.inference.schema import Interval, Profile
from fitball.inference.search.objective import Objective, descend

# Shares of intervals; in drops of the 95 % level where a path ends, what a step aims at, the
# longest step.
SHARES = (0.6826894921370859, 0.95)
DEPTH = 1.3
AIM = 0.3
COARSE = 0.8
# A drop is good to this, ten times less than a path could notice.
PROMISED = 1e-3
# Tries, every second with half the step, before what cannot be evaluated is the model's end, and
# what is far lower a jump; the share of the way to which that is found; points of a path; a better
# maximum, by its log likelihood; one of its own, by its distance in widths of priors; searches for
# the highest maximum.
TRIES = 16
FINE = 1e-3
MOST = 80
HIGHER = 0.01
SAME = 1e-2
RESTARTS = 8
# A value whose logarithm has no end is zero to rounding so far below the best; a noise is at its
# bound so near to it.
EMPTY = 30.0
AT_BOUND = 1e-3
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
        share = (self.proposal - self.at[-1]) / (self.at[-1] - self.at[-2])
        return np.asarray(self.x[-1] + share * (self.x[-1] - self.x[-2]))

    def take(self, x: FloatArray, cost: float) -> None:
        """Take a point, or go back half a step; stop where the drop is enough, at the bound, or at
        the model's end. What lies between two maxima is passed over.
        """
        at = float(x[self.column])
        aim = AIM * self.level
        far = self.cost[-1] - self.cost[0] > DEPTH * self.level
        step = at - self.at[-1]
        fine = self.tries >= TRIES or 0.0 < abs(step) <= FINE * abs(self.at[-1] - self.at[0])
        jump = (
            cost - self.cost[-1] > COARSE * self.level and not far and not (fine and self.tries % 2)
        )
        if not math.isfinite(cost) or jump:
            self.tries += 1
            # Along a wall there may be an answer from elsewhere.
            self.step = step * (1.0 if self.tries % 2 else 0.5)
            self.running = not (fine and self.tries % 2 == 0)
            return
        last = at - self.at[-1]
        drop = cost - self.cost[0]
        away = abs(at - self.at[0])
        self.at.append(at)
        self.x.append(x)
        self.cost.append(cost)
        self.tries = 0
        # The step that lowers a parabola from the top through this point by the aim.
        aimed = away * (math.sqrt(1.0 + aim / drop) - 1.0) if drop > 0.05 * aim else math.inf
        self.step = math.copysign(min(max(aimed, 0.25 * abs(last)), 2.0 * abs(last)), last)
        if drop >= DEPTH * self.level:
            ahead = (self.others - at) / last
            self.running = bool(np.any(ahead > ROUNDING))
            self.step = (
                last * float(np.min(ahead, where=ahead > ROUNDING, initial=np.inf))
                if self.running
                else last
            )
        self.running &= abs(self.end - at) > 0.0 and len(self.at) < MOST


def profiles(problem: Problem, optima: FloatArray) -> tuple[dict[str, Profile], str]:
    """Of the free parameters, from the coordinates of optima (optima, free); or why there are none
    (more than PROFILED rows, or measurements that leave nothing of the noise).
    """
    if len(problem.rows.y) > PROFILED:
        return (
            {},
            f"Above {PROFILED} impacts standard errors are as good as profiles, which are left "
            "out.",
        )
    levels = drops(problem)
    if not levels:
        return {}, "There are no more measurements than parameters: nothing is left for the noise."
    problem = _widened(problem)
    starts = optima
    for _ in range(RESTARTS):
        x, cost, converged = descend(Objective(problem, penalised=False), starts)
        order = np.argsort(cost, kind="stable")
        top = x[order[0]]
        lowest = float(cost[order[0]])
        rivals = [x[order[0]]]
        for k in order[1:]:
            apart = all(np.max(np.abs(x[k] - one) / problem.prior.width) > SAME for one in rivals)
            if apart and converged[k] and cost[k] < lowest + DEPTH * levels[1]:
                rivals.append(x[k])
        if name := _vanishing(problem, top):
            return (
                {},
                f"The model can reproduce the measurements exactly: {name} goes to its bound.",
            )
        paths = _walk(problem, lowest, np.array(rivals), levels[1], x[order])
        if isinstance(paths, list):
            pairs = zip(problem.free, paths[::2], paths[1::2], strict=True)
            return {name: _profile(problem, down, up, levels) for name, down, up in pairs}, ""
        starts = np.concatenate([paths[None], rivals])
    return (
        {},
        f"After {counted(RESTARTS, 'search')[:-1]}es, higher maxima of the likelihood still "
        "appear.",
    )


def drops(problem: Problem) -> tuple[float, ...]:
    """The drops of the log likelihood of SHARES; none where the noise has no degree of freedom."""
    from scipy.special import ndtri, stdtrit

    measured = np.isfinite(problem.rows.y).sum(axis=0)
    noises = [item.noise for item in problem.observables]
    count = int(measured[[name in problem.free for name in noises]].sum())
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
        if item.spec.name in alone and values[item.spec.name][0] < item.spec.lower * (
            1.0 + AT_BOUND
        ):
            return item.spec.name
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
    first = math.sqrt(2.0 * AIM * level) * _errors(problem, top)
    low = np.where(np.isinf(prior.low), top - EMPTY, prior.low)
    high = np.where(np.isinf(prior.high), top + EMPTY, prior.high)
    ends = np.stack([low, high])
    paths = [
        _Path(
            k,
            ends[right, k],
            (-1, 1)[right] * first[k],
            level,
            [top[k]],
            [top],
            [lowest],
            rivals[:, k],
            reached,
            running=abs(ends[right, k] - top[k]) > 0.0,
        )
        for k in range(top.size)
        for right in (0, 1)
    ]
    while running := [path for path in paths if path.running]:
        each = 1 + len(rivals)
        starts = np.concatenate([np.vstack([path.start(), rivals]) for path in running])
        held = np.repeat([path.column for path in running], each)
        starts[np.arange(len(held)), held] = np.repeat([path.proposal for path in running], each)
        x, cost, _ = descend(Objective(problem, penalised=False, held=held), starts, PROMISED)
        if cost.min() < lowest - HIGHER:
            return np.asarray(x[np.argmin(cost)])
        for k, path in enumerate(running):
            row = k * each + int(np.argmin(cost[k * each : (k + 1) * each]))
            path.take(x[row], float(cost[row]))
    return paths


def _errors(problem: Problem, top: FloatArray) -> FloatArray:
    """Standard errors (free,) to first order, at most the widths of the priors."""
    width = problem.prior.width
    _, curvature = Objective(problem, penalised=False).linearised(top[None])
    scaled = curvature[0] * np.outer(width, width) + np.eye(top.size)
    return np.asarray(width * np.sqrt(np.diag(np.linalg.inv(scaled))))


def _profile(problem: Problem, down: _Path, up: _Path, levels: Sequence[float]) -> Profile:
    at, order = np.unique([*down.at[::-1], *up.at[1:]], return_index=True)
    drop = np.array([*down.cost[::-1], *up.cost[1:]])[order]
    drop = np.maximum(drop - drop.min(), 0.0)
    prior = problem.prior.parameters[down.column].prior

    def crossing(level: float, left: bool) -> float | None:
        """Where the drop passes a level for the last time, linear in its root (Bates and Watts
        1988, section 6.1).
        """
        place, fall = (at[::-1], drop[::-1]) if left else (at, drop)
        if fall[-1] < level:
            return None
        k = int(np.flatnonzero(fall < level)[-1])
        a, b = np.sqrt(fall[k : k + 2])
        end = place[k] + (math.sqrt(level) - a) / (b - a) * (place[k + 1] - place[k])
        # The exponential of the C library, whose last digit numpy's does not always share.
        return math.exp(end) if prior.log else float(prior.value(np.asarray(end)))

    ends: list[Interval] = [(crossing(level, True), crossing(level, False)) for level in levels]
    return Profile(prior.value(at), drop, *ends)
