"""Profile likelihoods: paths of all parameters walk outwards together.

A profile is the likelihood with one parameter held and all others at their best; what the scene
measured counts with the data. A step is one batch of searches, until the drop passes the 95 % level
with a margin or a bound is met. Each search begins where the last two points of its path point to,
and at every other maximum that is nearly as high, so that the profile is that of the highest.

With an unknown noise the log likelihood of a linear model drops by n/2 ln(1 + t^2/(n-p)) where t is
that of Student's t of n-p, for n measurements and p parameters. At 95 % that is 1.92 for many
measurements, and 3.0 for 7 with 2 parameters.

With uncertain incident states searches follow a law that draws about the maximum teach, and drops
are those of the exact likelihood where they end. Where both differ a search goes on by the exact
one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.priors import parse_prior
from fitball.base.values import FloatArray
from fitball.inference.effort import PROFILED_ROWS
from fitball.inference.judgement.first_order import proposal
from fitball.inference.learnt import TEACHING_DRAWS, learnt
from fitball.inference.problem.problem import Problem
from fitball.inference.schema import Interval, Profile
from fitball.inference.search.objective import Objective, descend

# Shares of the intervals: one sd of a normal distribution to either side, and 95 %.
LEVEL_SHARES = (0.6826894921370859, 0.95)
# Where a path ends, in drops of the 95 % level: a margin, so that the level is crossed between two
# points of it.
END_DROP = 1.3
# The drop that a step aims at, in drops of the 95 % level. Paths of bundled tables have 3 to 10
# points with it; with half of it ends of intervals move by 0.2 % of their widths at most.
AIMED_DROP = 0.3
# The largest drop at one step, in drops of the 95 % level: what falls further may be a jump, and is
# tried again in shorter steps. Chosen by hand; with half of it ends of intervals of bundled tables
# move by 0.2 % of their widths at most.
LONGEST_DROP = 0.8
# Gain promised by a step from which a search ends: drops are good to about this, a tenth of
# HIGHER_MAXIMUM.
PROMISED_GAIN = 1e-3
# Rounds of a search of a path at most. Those along a wall beyond which the model has no answer do
# not end; with 60 rounds ends of intervals move by 1.2 % of their widths at most, where the data
# determine nothing.
ROUNDS_OF_PATH = 25
# Difference of the drops by a learnt and by the exact law, in drops of the 95 % level, above which
# a search goes on by the exact one. What another search of it could still gain is of second order
# in that difference: below 1 % of the level.
LEARNT_ERROR = 0.1
# Tries, every second with a shorter step, before what cannot be evaluated is the model's end, and
# what is far lower a jump: after four a step is 1/256 of what it was.
MOST_TRIES = 8
SHORTER = 0.25
# The share of the way from the best value within which the model's end, or a jump, is found: with a
# quarter of it ends of 95 % intervals move by 0.5 % of their widths at most.
FINE_SHARE = 4e-3
# Points of a path at most: a guard, far above the 10 of paths of bundled tables. Chosen by hand.
MOST_POINTS = 80
# Gain of the log likelihood from which a maximum is higher than another: ten times what a drop is
# good to.
HIGHER_MAXIMUM = 0.01
# Largest distance, in widths of priors, within which two maxima are the same. Chosen by hand:
# profiles of bundled tables are the same with a tenth of it and with ten times as much.
SAME_MAXIMUM = 1e-2
# Searches for the highest maximum at most, each from a higher one that a path met.
MOST_RESTARTS = 8
# How far below the best a path goes in a logarithm that has no bound: e^-30 is zero to rounding.
# As much is the end above.
ZERO_LOGARITHM = 30.0
# Share of a bound above it within which a noise is at its bound.
BOUND_SHARE = 1e-3
# The shortest step after another, in lengths of that: one point may lie off the parabola.
SHORTEST_RATIO = 0.25
# The longest step after another, in lengths of that: a parabola is not trusted further out.
LONGEST_RATIO = 2.0
# Share of the aim from which a drop shows a parabola; of a smaller one the curvature is unknown.
FLAT_SHARE = 0.05
# Steps within which a maximum is the one that was just passed, to rounding.
ROUNDED_STEPS = 1e-9


@dataclass
class _Path:
    """The path of the parameter of a `column` in one direction, to an `end`.

    By point it has where the parameter was held (`at`), the best coordinates `x` there, and their
    `cost`. `others` (rivals,) are the values of the parameter at further maxima, `reached`
    (searches, coordinates) the ends of the first searches. `tries` counts searches in a row that
    were not accepted, `refused` is where the last of them held the parameter, until the path gets
    there; it `is_wall` where a shorter step was refused too.
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
    refused: float | None = None
    is_wall: bool = False
    running: bool = True

    @property
    def proposal(self) -> float:
        """The coordinate at which the parameter is held next: a step ahead, at most at the end."""
        ahead = self.at[-1] + self.step
        return min(ahead, self.end) if self.step > 0.0 else max(ahead, self.end)

    @property
    def enough(self) -> float:
        """The cost below which what a search reached is accepted: any beyond the 95 % level."""
        far = self.cost[-1] - self.cost[0] > END_DROP * self.level
        return math.inf if far else self.cost[-1] + LONGEST_DROP * self.level

    def start(self) -> FloatArray:
        """The coordinates (coordinates,) from which the next search begins: where the last two
        points point to, or, where that led nowhere, what searches reached before.
        """
        if self.tries % 2:
            return np.asarray(self.reached[self.tries // 2 % len(self.reached)])
        if len(self.at) < 2:
            return self.x[0]
        before, last = self.at[-2:]
        x_before, x_last = self.x[-2:]
        share = (self.proposal - last) / (last - before)
        return np.asarray(x_last + share * (x_last - x_before))

    def accept(self, x: FloatArray, cost: float) -> None:
        """Add the point that a search reached, or go back most of a step. The path stops where the
        drop is enough, at the bound, or at the model's end; it passes over what lies between two
        maxima.
        """
        at = float(x[self.column])
        step = at - self.at[-1]
        way = abs(self.at[-1] - self.at[0])
        fine = self.tries >= MOST_TRIES or 0.0 < abs(step) <= FINE_SHARE * way
        far = self.cost[-1] - self.cost[0] > END_DROP * self.level
        jump = cost - self.cost[-1] > LONGEST_DROP * self.level
        sure = fine and self.tries % 2 == 1
        if not math.isfinite(cost) or (jump and not far and not sure):
            self._go_back(at, fine)
            return
        if self.refused is not None and (self.refused - at) * step <= 0.0:
            self.refused = None
            self.is_wall = False
        self.at.append(at)
        self.x.append(x)
        self.cost.append(cost)
        self.tries = 0
        self.step = self._next_step(step)
        if cost - self.cost[0] >= END_DROP * self.level:
            self._go_to_next_maximum(step)
        self.running &= abs(self.end - at) > 0.0 and len(self.at) < MOST_POINTS

    def _go_back(self, at: float, fine: bool) -> None:
        """Hold the parameter `at` the same place again, since along a wall there may be an answer
        from elsewhere; at the second time go back most of the step, or stop where it was `fine`.
        """
        self.tries += 1
        self.step = at - self.at[-1]
        if self.tries % 2 == 0:
            self.step *= SHORTER
            self.running = not fine
            self.is_wall = self.refused is not None
            self.refused = at

    def _next_step(self, step: float) -> float:
        """The step after one of `step`: on the parabola from the top through the last point it
        lowers the likelihood by the aim. At a wall it is half of what is left.
        """
        aim = AIMED_DROP * self.level
        drop = self.cost[-1] - self.cost[0]
        aimed = math.inf
        if drop > FLAT_SHARE * aim:
            away = abs(self.at[-1] - self.at[0])
            aimed = away * (math.sqrt(1.0 + aim / drop) - 1.0)
        length = max(aimed, SHORTEST_RATIO * abs(step))
        length = min(length, LONGEST_RATIO * abs(step))
        if self.is_wall and self.refused is not None:
            # The last one is fine.
            half = 0.5 * abs(self.refused - self.at[-1])
            fine = FINE_SHARE * abs(self.at[-1] - self.at[0])
            length = min(length, max(half, fine))
        return math.copysign(length, step)

    def _go_to_next_maximum(self, step: float) -> None:
        """Go on to the next maximum after a drop that is enough, or stop where there is none.
        `step` was the last.
        """
        steps_ahead = (self.others - self.at[-1]) / step
        steps_ahead = steps_ahead[steps_ahead > ROUNDED_STEPS]
        self.running = steps_ahead.size > 0
        self.step = step * float(steps_ahead.min()) if self.running else step


class Profiled(NamedTuple):
    """The profiles of the free parameters by name, or none, and then `why` in words.

    `paths` has the best coordinates (points, coordinates) along the profile of each, from its lower
    end to its upper one, where the likelihood has dropped by less than the 95 % level.
    """

    by_name: Mapping[str, Profile]
    paths: Mapping[str, FloatArray]
    why: str = ""


def profiles(
    problem: Problem,
    optima: Annotated[FloatArray, "optima coordinates"],
) -> Profiled:
    """The profiles of the free parameters, searched from the coordinates of optima; none of more
    than PROFILED_ROWS, or of measurements that leave nothing for the noise.
    """
    if len(problem.rows.y) > PROFILED_ROWS:
        as_good = f"Above {PROFILED_ROWS} impacts standard errors are as good as profiles"
        return Profiled({}, {}, f"{as_good}, which are left out.")
    levels = likelihood_drops(problem)
    if not levels:
        why = "There are no more measurements than parameters: nothing is left for the noise."
        return Profiled({}, {}, why)
    problem = _with_default_widths(problem)
    law = _taught(problem, optima[0])
    starts = optima
    for _ in range(MOST_RESTARTS):
        if law is not problem:
            starts = descend(Objective(law, penalised=False), starts)[0]
        x, cost, converged = descend(Objective(problem, penalised=False), starts)
        order = np.argsort(cost, kind="stable")
        top = order[0]
        lowest = float(cost[top])
        maxima = [x[top]]
        for k in order[1:]:
            high = cost[k] < lowest + END_DROP * levels[1]
            if high and converged[k] and _is_apart(problem, x[k], maxima):
                maxima.append(x[k])
        if name := _vanishing_noise(problem, x[top]):
            exactly = "The model can reproduce the measurements exactly"
            return Profiled({}, {}, f"{exactly}: {name} goes to its bound.")
        paths = _walk_paths(problem, law, lowest, np.array(maxima), levels[1], x[order])
        if isinstance(paths, list):
            sides = [*zip(problem.free, paths[::2], paths[1::2], strict=True)]
            return Profiled(
                {name: _profile(problem, down, up, levels) for name, down, up in sides},
                {name: _way(down, up, levels[1]) for name, down, up in sides},
            )
        starts = np.concatenate([paths[None], maxima])
    why = f"After {MOST_RESTARTS} searches, higher maxima of the likelihood still appear."
    return Profiled({}, {}, why)


def _taught(problem: Problem, x: FloatArray) -> Problem:
    """The problem with a law of uncertain states that draws about coordinates `x` teach; itself
    where there are none. The same draws at each call: profiles have no random numbers.
    """
    rng = np.random.default_rng(0)
    prior = problem.prior
    draws = proposal(problem, x).draw(rng, TEACHING_DRAWS)
    return learnt(problem, np.clip(draws, prior.low, prior.high))


def _is_apart(problem: Problem, x: FloatArray, maxima: Sequence[FloatArray]) -> bool:
    """Whether coordinates (coordinates,) are apart from those of all maxima."""
    distances = [np.max(np.abs(x - maximum) / problem.prior.width) for maximum in maxima]
    return all(distance > SAME_MAXIMUM for distance in distances)


def likelihood_drops(problem: Problem) -> tuple[float, ...]:
    """The drops of the log likelihood at the ends of intervals with LEVEL_SHARES; none where the
    noise has no degree of freedom.
    """
    from scipy.special import ndtri, stdtrit

    measured = np.isfinite(problem.rows.y).sum(axis=0)
    noises = [observable.noise for observable in problem.observables]
    unknown = [name in problem.free for name in noises]
    count = int(measured[unknown].sum())
    fitted = [
        parameter
        for parameter in problem.prior.parameters
        if parameter.spec.name not in noises and not parameter.measured
    ]
    freedom = count - len(fitted) + (problem.contact_time is not None)
    if not count:
        return tuple(0.5 * float(ndtri(0.5 + 0.5 * share)) ** 2 for share in LEVEL_SHARES)
    if freedom < 1:
        return ()
    ends = (float(stdtrit(freedom, 0.5 + 0.5 * share)) for share in LEVEL_SHARES)
    return tuple(0.5 * count * math.log1p(end**2 / freedom) for end in ends)


def _with_default_widths(problem: Problem) -> Problem:
    """The problem with steps of searches by the default priors where the user's are narrower, for
    the likelihood is not.
    """
    ends = np.array([0.16, 0.84])
    with np.errstate(invalid="ignore", divide="ignore"):
        # A prior about zero says nothing of a logarithm.
        shown = [
            parameter.prior.coordinate(parse_prior(parameter.spec).quantile(ends))
            for parameter in problem.prior.parameters
        ]
    wide = 0.5 * np.ptp(shown, axis=1)
    width = np.fmax(problem.prior.width, np.where(np.isfinite(wide), wide, 0.0))
    return replace(problem, prior=replace(problem.prior, width=width))


def _vanishing_noise(problem: Problem, top: FloatArray) -> str:
    """The name of a noise that is at its bound at the coordinates `top`, or "". A scatter beyond
    stated errors may be there.
    """
    values = problem.values(top[None])
    unstated = {observable.noise for observable in problem.observables if not observable.stated}
    for parameter in problem.prior.parameters:
        name = parameter.spec.name
        nearest = parameter.spec.lower * (1.0 + BOUND_SHARE)
        if name in unstated and values[name][0] < nearest:
            return name
    return ""


def _walk_paths(
    problem: Problem,
    law: Problem,
    lowest: float,
    maxima: FloatArray,
    level: float,
    reached: FloatArray,
) -> list[_Path] | FloatArray:
    """The paths of all parameters, down and up in turn, from the highest of the `maxima` (maxima,
    coordinates); or the coordinates (coordinates,) of a higher maximum that one of them met.
    Searches follow the `law`.
    """
    by_law = Objective(law, penalised=False).cost(maxima[:1])[0]
    prior = problem.prior
    top = maxima[0]
    rivals = maxima[1:]
    step = math.sqrt(2.0 * AIMED_DROP * level) * _standard_errors(problem, top)
    low = np.where(np.isinf(prior.low), top - ZERO_LOGARITHM, prior.low)
    high = np.where(np.isinf(prior.high), top + ZERO_LOGARITHM, prior.high)
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
        by_path = Objective(law, penalised=False, held=held)
        enough = np.repeat([path.enough for path in running], searches)
        x, cost, _ = descend(by_path, starts, PROMISED_GAIN, ROUNDS_OF_PATH, enough=enough)
        if law is not problem:
            exact = Objective(problem, penalised=False, held=held)
            cost = _by_exact_law(exact, x, cost + (lowest - by_law), LEARNT_ERROR * level)
        if cost.min() < lowest - HIGHER_MAXIMUM:
            return np.asarray(x[np.argmin(cost)])
        best_searches = cost.reshape(-1, searches).argmin(axis=1)
        for k, path in enumerate(running):
            row = k * searches + best_searches[k]
            path.accept(x[row], float(cost[row]))
    return paths


def _by_exact_law(
    exact: Objective,
    x: FloatArray,
    expected: FloatArray,
    allowed: float,
) -> FloatArray:
    """The exact costs (searches,) at coordinates `x` (searches, coordinates). Searches whose cost
    is not the `expected` one within what is allowed go on from there, and move their `x`.
    """
    cost = exact.cost(x)
    with np.errstate(invalid="ignore"):
        off = np.flatnonzero(~(np.abs(cost - expected) <= allowed))
    if off.size:
        x[off], cost[off], _ = descend(exact.take(off), x[off], PROMISED_GAIN, ROUNDS_OF_PATH)
    return cost


def _standard_errors(problem: Problem, top: FloatArray) -> FloatArray:
    """The standard errors (coordinates,) at a maximum to first order, at most the widths of the
    priors.
    """
    width = problem.prior.width
    _, curvature = Objective(problem, penalised=False).linearised(top[None])
    scaled = curvature[0] * np.outer(width, width) + np.eye(top.size)
    variance = np.diag(np.linalg.inv(scaled))
    return np.asarray(width * np.sqrt(variance))


def _way(down: _Path, up: _Path, level: float) -> FloatArray:
    """The coordinates (points, coordinates) of two paths from the lower end to the upper one, where
    the drop is less than a level.
    """
    x = np.array([*down.x[::-1], *up.x[1:]])
    cost = np.array([*down.cost[::-1], *up.cost[1:]])
    return np.asarray(x[cost - cost.min() < level])


def _profile(problem: Problem, down: _Path, up: _Path, levels: Sequence[float]) -> Profile:
    """The profile of a parameter from its two paths, with an interval for each of the levels."""
    at, order = np.unique([*down.at[::-1], *up.at[1:]], return_index=True)
    drop = np.array([*down.cost[::-1], *up.cost[1:]])[order]
    drop = np.maximum(drop - drop.min(), 0.0)
    prior = problem.prior.parameters[down.column].prior

    def crossing(level: float, at: FloatArray, drop: FloatArray) -> float | None:
        """The value where the drop passes a level for the last time on the way outwards, or None.
        Between points the root of the drop is linear (Bates and Watts 1988, section 6.1).
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
