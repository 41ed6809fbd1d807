"""Damped Gauss-Newton on the likelihood objective, many searches at once: one batch of the kernel a round."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from fitball.inference.point.surface import Conditions, Surface
from fitball.values import FloatArray

MOST_ROUNDS = 60
# Rounds as good as the last one that a search with a goal may still need, and rounds that any search has which only
# must come near another.
PATIENCE, UNHURRIED = 10.0, 12
GENTLE, MAX_DAMPING = 1e-3, 1e9
# The longest step in widths of the priors.
REACH = 1.0
# Curvature added to directions that the table does not see, in widths of the priors: far below anything measured.
UNSEEN = 1e-8
# Two optima that differ by less than this in each parameter, in widths of the priors, are one.
SAME_OPTIMUM = 1e-2


@dataclass(frozen=True)
class Searches:
    """Where searches stand: `x` (rows, columns), the column each holds (-1: none), and what holds (see
    Conditions).
    """

    x: FloatArray
    held: NDArray[np.int64]
    given: Conditions

    def take(self, rows: NDArray[np.int64]) -> Searches:
        """Some of them."""
        return Searches(self.x[rows], self.held[rows], self.given.take(rows))


@dataclass(frozen=True)
class Reached:
    """Where searches ended: `x` (rows, columns), negative log likelihood `cost` (rows,), inf where no feasible point
    was found, and whether a lower point is promised nowhere near (`settled`).
    """

    x: FloatArray
    cost: FloatArray
    settled: NDArray[np.bool_]


def descend(
    objective: Surface, searches: Searches, goal: FloatArray | None = None, rivals: float = math.inf
) -> Reached:
    """Lower every row's cost as far as damped Gauss-Newton steps go, held columns as they are, bounds and walls kept.

    Starts outside the walls are first moved to the nearest point inside. With a `goal` (rows,), rows that advance too
    slowly to get below theirs are given up; so are, after some rounds, those that creep along far above the lowest
    that has settled, where only what ends within `rivals` of it is asked for.
    """
    x = feasible(objective, searches)
    rows = x.shape[0]
    cost = objective.cost(x, searches.given)
    settled = np.zeros(rows, dtype=bool)
    damping = np.full(rows, GENTLE)
    gradient = np.zeros(x.shape)
    curvature = np.zeros((*x.shape, x.shape[1]))
    stale = np.ones(rows, dtype=bool)
    running, promised = np.isfinite(cost), objective.promised
    for round_ in range(MOST_ROUNDS):
        fresh = np.flatnonzero(running & stale)
        if fresh.size:
            gradient[fresh], curvature[fresh] = objective.linearised(x[fresh], searches.given.take(fresh))
            stale[fresh] = False
            # A point so close to where the model ends that no difference exists goes no further.
            running[fresh] &= np.isfinite(gradient[fresh]).all(axis=1)
        busy = np.flatnonzero(running)
        if busy.size == 0:
            break
        step, promise = _steps(
            objective, searches.take(busy), x[busy], gradient[busy], curvature[busy], damping[busy]
        )
        done = (promise < promised) & (damping[busy] <= GENTLE)
        settled[busy[done]] = True
        # A strongly damped step promises little whatever the slope: such a search is stuck, not settled.
        stuck = (promise < promised) & (damping[busy] > 1.0) | (damping[busy] > MAX_DAMPING)
        running[busy[done | stuck]] = False
        tried, step = busy[~done & ~stuck], step[~done & ~stuck]
        trial = objective.moved(x[tried], step)
        lower = objective.cost(trial, searches.given.take(tried))
        better = lower < cost[tried]
        moved, refused = tried[better], tried[~better]
        gained = cost[moved] - lower[better]
        if goal is not None:
            running[moved] = lower[better] - PATIENCE * gained < goal[moved]
        elif round_ >= UNHURRIED and settled.any():
            # At this pace it would not get there in the rounds that are left.
            reached = lower[better] - (MOST_ROUNDS - round_) * gained
            running[moved] = reached < cost[settled].min() + rivals
        x[moved], cost[moved] = trial[better], lower[better]
        stale[moved] = True
        damping[moved] = np.maximum(damping[moved] / 10.0, 1e-6)
        damping[refused] = np.maximum(10.0 * damping[refused], GENTLE)
    return Reached(x, cost, settled)


def _steps(
    objective: Surface,
    searches: Searches,
    x: FloatArray,
    gradient: FloatArray,
    curvature: FloatArray,
    damping: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Damped steps (rows, columns) and the decrease each promises, (rows,)."""
    count = x.shape[1]
    diagonal = damping[:, None] * np.einsum("bkk->bk", curvature) + UNSEEN / objective.width**2
    damped = curvature + diagonal[:, :, None] * np.eye(count)
    moving = np.arange(count) != searches.held[:, None]
    # Held columns neither move nor couple.
    coupled = np.where(moving[:, :, None] & moving[:, None, :], damped, np.eye(count))
    slope = np.where(moving, gradient, 0.0)
    step = -np.linalg.solve(coupled, slope[..., None])[..., 0]
    low, high = objective.limits
    a, b = objective.walls
    reach = REACH * objective.width
    trial = x + step
    crossed = np.any(((trial < low) | (trial > high) | (np.abs(step) > reach)) & moving, axis=1)
    for row in np.flatnonzero(crossed | np.any(trial @ a.T > b, axis=1)):
        free = moving[row]
        best = _within(objective, x[row], free, damped[row], slope[row], reach)
        step[row] = 0.0
        if best is not None:
            step[row, free] = best
    promise = -np.einsum("bk,bk->b", slope, step) - 0.5 * np.einsum("bk,bkl,bl->b", step, coupled, step)
    return step, promise


def _within(
    objective: Surface,
    x: FloatArray,
    free: NDArray[np.bool_],
    curvature: FloatArray,
    slope: FloatArray,
    reach: FloatArray,
) -> FloatArray | None:
    """The best step (free columns,) of one row within bounds, walls and reach; None when nothing is within."""
    low, high = objective.limits
    a, b = objective.walls
    identity = np.eye(x.size)
    conditions = np.vstack([identity, -identity, a])[:, free]
    room = np.concatenate([np.minimum(high - x, reach), np.minimum(x - low, reach), b - a @ x])
    # Columns that do not move have no bounds to keep.
    kept = np.any(conditions, axis=1)
    step = constrained_step(curvature[np.ix_(free, free)], slope[free], conditions[kept], room[kept])
    # Rounding may carry a step a unit in the last place over a bound.
    return None if step is None else np.clip(x[free] + step, low[free], high[free]) - x[free]


def apart(places: FloatArray, ranked: Sequence[int], least: float) -> list[int]:
    """Rows of `places` (rows, columns), in the order of `ranked`, each further than `least` in some column from all
    that were taken before it.
    """
    taken: list[int] = []
    for k in ranked:
        if np.all(np.max(np.abs(places[taken] - places[k]), axis=1, initial=0.0) > least):
            taken.append(int(k))
    return taken


def feasible(objective: Surface, searches: Searches) -> FloatArray:
    """The nearest points (rows, columns), in widths of the priors, within bounds and walls; a row for which there is
    none stays where it is, outside.
    """
    low, high = objective.limits
    a, b = objective.walls
    count = searches.x.shape[1]
    moving = np.arange(count) != searches.held[:, None]
    x = np.where(moving, np.clip(searches.x, low, high), searches.x)
    metric = np.diag(objective.width**-2.0)
    for row in np.flatnonzero(np.any(x @ a.T > b, axis=1)):
        best = _within(objective, x[row], moving[row], metric, np.zeros(count), np.full(count, np.inf))
        if best is not None:
            x[row, moving[row]] += best
    return x


# Distance (relative) from a contradiction below which conditions count as contradicting each other: rounding of the
# non-negative least squares it is read from.
CONTRADICTION = 1e-10


def constrained_step(curvature: FloatArray, gradient: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray | None:
    """Minimise `d' curvature d/2 + gradient' d` over d (n,) subject to `a d <= b`, curvature positive definite; None
    when no d satisfies the conditions.

    With `curvature = L L'` and `y = L' d + L^-1 gradient` it is a least-distance problem, solved by non-negative
    least squares (Lawson and Hanson 1974, chapter 23).
    """
    factor = np.linalg.cholesky(curvature)
    shift = np.linalg.solve(factor, gradient)
    # Conditions on y, as `normals y >= offsets`, each scaled to unit length.
    normals = -np.linalg.solve(factor, a.T).T
    offsets = -(b - normals @ shift)
    lengths = np.maximum(np.linalg.norm(normals, axis=1), np.finfo(float).tiny)
    normals, offsets = normals / lengths[:, None], offsets / lengths
    size = max(float(np.max(np.abs(offsets), initial=0.0)), np.finfo(float).tiny)
    stacked = np.vstack([normals.T, offsets / size])
    target = np.zeros(gradient.size + 1)
    target[-1] = 1.0
    residual = stacked @ nnls(stacked, target)[0] - target
    if -residual[-1] < CONTRADICTION:
        return None
    nearest = size * residual[:-1] / -residual[-1]
    step: FloatArray = np.linalg.solve(factor.T, nearest - shift)
    return step
