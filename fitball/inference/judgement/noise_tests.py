"""Tests of the noise in residuals: measurements far off, noise that grows, columns that deviate
together.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Annotated

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import betainc, gammaln, ndtr, stdtr

from fitball.base.values import FloatArray, IntArray
from fitball.inference.judgement import adequacy_words as words
from fitball.inference.judgement.first_order import FirstOrder
from fitball.inference.judgement.patterns import covariates
from fitball.inference.judgement.residuals import FitResiduals, PatternTest

# Rows from which growth, links and outliers are tested: each compares noises, of which fewer rows
# say little. Chosen by hand.
LEAST_TESTED_ROWS = 10
# Largest power of the speed, up or down, by which a noise may grow: it bounds the search. Errors in
# proportion to the speed have 1. Chosen by hand.
STEEPEST_GROWTH = 4.0
# One of so many rows may be far off: most must be usual for a row to be unusual. Chosen by hand.
ROWS_PER_OUTLIER = 6
# Rows of a column that may be far off, at most, so that long tables take no long time. Chosen by
# hand.
MOST_OUTLIERS = 20
# Share of a variance that is taken for all of it: a ratio to the rest stays finite.
FULL_SHARE = 1.0 - 1e-12
# Least chance whose logarithm is taken: it stays finite.
LEAST_CHANCE = 1e-300


def farthest(
    shares: Annotated[FloatArray, "numbers"],
    count: int,
    freedom: float,
) -> tuple[int, float]:
    """How many of the `count` residuals of a column lie farthest off together, and a bound on the
    chance that any so many have as large a share of the variance (Bonferroni over all choices of
    so many, and over the numbers). Tested together they do not hide each other (Rosner 1983).

    `shares` are those of the farthest 1, 2, ... residuals, in a column with so many degrees of
    `freedom`.
    """
    numbers = np.arange(1, shares.size + 1)
    ways = gammaln(count + 1) - gammaln(numbers + 1) - gammaln(count - numbers + 1)
    remaining = 1.0 - np.minimum(shares, FULL_SHARE)
    chance = betainc(0.5 * (freedom - numbers), 0.5 * numbers, remaining)
    logs = ways + np.log(np.maximum(chance, LEAST_CHANCE))
    best = int(np.argmin(logs))
    log_bound = min(logs[best] + np.log(numbers.size), 0.0)
    return best + 1, float(np.exp(log_bound))


def outlier_tests(fit: FitResiduals) -> Iterator[PatternTest]:
    """A test of each column, of the impacts that are far off in it."""
    ids = fit.problem.table.labels["id"]
    studentised = fit.studentised
    for column_index, column in enumerate(fit.first.columns):
        freedom = float(fit.freedom[column_index])
        # A noise with parameters, Student's t, allows outliers. In few rows the residuals of one
        # column are not independent of those of others, with which they share a fit.
        heavy_tailed = bool(fit.problem.forward.noise.parameters)
        if freedom <= 2.0 or len(ids) < LEAST_TESTED_ROWS or heavy_tailed:
            continue
        measurements = np.flatnonzero(fit.first.column == column_index)
        order = measurements[np.argsort(-np.abs(studentised[measurements]))]
        allowed = min(MOST_OUTLIERS, freedom - 1.0)
        most = np.clip(measurements.size // ROWS_PER_OUTLIER, 1, allowed)
        shares = []
        deviations = []
        for k in range(1, int(most) + 1):
            share, deviation = _share_far_off(fit.first, order[:k], order[k:])
            shares.append(share)
            deviations.append(deviation)
        count, p = farthest(np.array(shares), measurements.size, freedom)
        far = order[:count]
        direction = np.zeros(fit.scaled.size)
        direction[far] = deviations[count - 1]
        ids_far_off = [ids[row] for row in fit.first.rows[far]]
        text = words.outliers(fit.measured(column), ids_far_off)
        yield PatternTest("outlier", column, text, p, direction=direction)


def _share_far_off(first: FirstOrder, far: IntArray, others: IntArray) -> tuple[float, FloatArray]:
    """The share of a column's variance that its measurements `far` off (row numbers) have, and how
    far off a fit to all but them has them (far,), in noises.
    """
    residual = first.residual[far]
    basis = first.basis[far]
    remaining = np.eye(far.size) - basis @ basis.T
    off = np.linalg.pinv(remaining) @ residual
    shift = basis.T @ off
    of_others = first.residual[others] + first.basis[others] @ shift
    taken = float(off @ residual)
    rest = float(of_others @ of_others)
    share = taken / (taken + rest) if rest > 0.0 else 0.0
    return share, np.asarray(off)


def growth_test(fit: FitResiduals) -> Iterator[PatternTest]:
    """A test of whether all noises grow as one power of the speed: the likelihood ratio (Harvey
    1976), times the share of degrees of freedom that the fit leaves.
    """
    speeds_differ = not {"v_1", "v_y1"}.isdisjoint(covariates(fit.problem))
    if len(fit.problem.rows.y) < LEAST_TESTED_ROWS or not speeds_differ:
        return
    column = fit.first.column
    speed, _ = fit.problem.rows.states.polar()
    along = np.log(speed)[fit.first.rows]
    count = np.bincount(column)
    mean = np.bincount(column, along) / count
    centred = along - mean[column]
    square = fit.studentised**2

    def misfit(power: float) -> float:
        """Minus twice the log likelihood of noises that grow by that power, but for a constant."""
        over_speed = square * np.exp(-2.0 * power * centred)
        variance = np.bincount(column, over_speed) / count
        return float(count @ np.log(variance))

    limits = (-STEEPEST_GROWTH, STEEPEST_GROWTH)
    power = float(minimize_scalar(misfit, bounds=limits, method="bounded").x)
    gain = misfit(0.0) - misfit(power)
    ratio = gain * fit.freedom.sum() / column.size
    z = np.sqrt(max(ratio, 0.0))
    p = 2.0 * float(ndtr(-z))
    verb = "increases" if power > 0.0 else "decreases"
    yield PatternTest("growth", "", f"the noise {verb} with v_1", p)


def linked_tests(fit: FitResiduals) -> Iterator[PatternTest]:
    """A test of each pair of columns, of whether they deviate together, as they do where the
    incident state has errors.
    """
    first = fit.first
    for k, m in combinations(range(len(first.columns)), 2):
        of_k = np.flatnonzero(first.column == k)
        of_m = np.flatnonzero(first.column == m)
        both, i, j = np.intersect1d(first.rows[of_k], first.rows[of_m], return_indices=True)
        freedom = float(min(fit.freedom[k], fit.freedom[m]))
        if both.size < LEAST_TESTED_ROWS or freedom <= 2.0:
            continue
        a = fit.scaled[of_k[i]] * fit.sides(first.columns[k])[both]
        b = fit.scaled[of_m[j]] * fit.sides(first.columns[m])[both]
        together = float(a @ b) ** 2
        apart = float((a @ a) * (b @ b))
        share = min(together / apart, FULL_SHARE)
        square = share * (freedom - 1.0) / (1.0 - share)
        t = np.sqrt(square)
        p = 2.0 * float(stdtr(freedom - 1.0, -t))
        text = f"{first.columns[k]} and {first.columns[m]} deviate together"
        yield PatternTest("linked", "", text, p)
