"""Double-precision march along a linear phase: matrix exponentials on a grid, events polished by Brent."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq

from fitball.models.oracle.phases import Matrix, Row
from fitball.values import FloatArray

# Over a twentieth of the fastest pole's time a guard is as good as a parabola: it can touch zero
# twice inside a step only around one extremum, which is looked for.
STEPS_PER_POLE_TIME = 20.0
STEPS_A_BLOCK = 64
# A phase may begin at a zero of its own guard; samples that crowd towards the start see a guard
# that rises and falls again within the first step.
START_SAMPLES: FloatArray = 0.25 ** np.arange(10.0, 0.0, -1.0)
# Guards are sums of half a dozen products after some hundred steps: a dip below zero by less than
# this share of the summands, or of what their rates can add up to, cannot be told from rounding.
GUARD_NOISE = 2e-14
ROOT_SPACING = 1e-17

# Diagonal Pade approximant of the exponential: below a norm of 1/2 its error is far under rounding.
PADE_DEGREE = 8
PADE = [
    math.factorial(2 * PADE_DEGREE - j) * math.comb(PADE_DEGREE, j) / math.factorial(2 * PADE_DEGREE)
    for j in range(PADE_DEGREE + 1)
]

Guard = Callable[[float], float]


class ExpmMarch:
    """`March` in double precision."""

    rounding: float = 1e-12

    def __call__(self, matrix: Matrix, state: Row, guards: list[Row], duration: float) -> tuple[float, Row, bool]:
        """See `March`."""
        a, z = np.array(matrix, dtype=np.float64), np.array(state, dtype=np.float64)
        rows = np.array(guards, dtype=np.float64).reshape(-1, z.size)
        fastest = float(np.max(np.abs(np.linalg.eigvals(a))))
        count = max(1, int(np.ceil(duration * fastest * STEPS_PER_POLE_TIME)))
        step = duration / count
        if not len(rows):
            return duration, list(_carried(a, z, duration)), False
        growths = _repeated(growth_over(a * step), min(count, STEPS_A_BLOCK))
        reached = np.zeros((1, len(rows)))
        for block in range(0, count, STEPS_A_BLOCK):
            size = min(STEPS_A_BLOCK, count - block)
            times: FloatArray = step * np.arange(size + 1, dtype=np.float64)
            states = np.vstack([z, z + growths[:size] @ z])
            if block == 0:
                early = np.array([_carried(a, z, step * share) for share in START_SAMPLES])
                times = np.concatenate([times[:1], step * START_SAMPLES, times[1:]])
                states = np.vstack([states[:1], early, states[1:]])
            sizes = np.maximum(_sizes(rows, a, states, block * step + times), reached)
            sizes = np.maximum.accumulate(sizes, axis=0)
            reached = sizes[-1:]
            first_falls = [
                _first_fall(row, a, times, states, GUARD_NOISE * size)
                for row, size in zip(rows, sizes.T, strict=True)
            ]
            falls = [fall for fall in first_falls if fall is not None]
            if falls:
                index, beyond = min(falls, key=lambda fall: float(times[fall[0]]) + fall[1])
                elapsed = block * step + float(times[index]) + beyond
                return elapsed, list(_carried(a, states[index], beyond)), True
            z = states[-1]
        return duration, list(z), False


def _sizes(rows: FloatArray, a: FloatArray, states: FloatArray, elapsed: FloatArray) -> FloatArray:
    """Summands of each guard and of its growth since the phase began, shape (samples, guards)."""
    weights = np.abs(rows).T
    growth = np.abs(states) @ np.abs(a).T @ weights
    sizes: FloatArray = np.abs(states) @ weights + growth * elapsed[:, None]
    return sizes


def _first_fall(
    row: FloatArray, a: FloatArray, times: FloatArray, states: FloatArray, noise: FloatArray
) -> tuple[int, float] | None:
    """Where the guard first falls through zero: index of the sample before it and the time beyond that."""
    values, slopes = states @ row, states @ (a.T @ row)
    below = np.flatnonzero(values < -noise)
    last = int(below[0]) if below.size else len(values) - 1
    gaps = np.diff(times)
    # A guard that falls and rises again within a step reaches zero only if its tangent does.
    dips = np.flatnonzero(
        (values[:-1] > 0) & (slopes[:-1] < 0) & (slopes[1:] > 0) & (values[:-1] + slopes[:-1] * gaps < 0)
    )
    for index in dips[dips < last]:
        gap, at = float(gaps[index]), states[index]
        bottom = _root(_along(a.T @ row, a, at), gap)
        if row @ _carried(a, at, bottom) < -noise[index + 1]:
            return int(index), _root(_along(row, a, at), bottom)
    if not below.size:
        return None
    above = np.flatnonzero(values[:last] > 0)
    if not above.size:
        return 0, 0.0
    index = int(above[-1])
    return index, _root(_along(row, a, states[index]), float(gaps[index]))


def _along(row: FloatArray, a: FloatArray, z: FloatArray) -> Guard:
    return lambda time: float(row @ _carried(a, z, time))


def _root(guard: Guard, span: float) -> float:
    """The zero of a function that changes sign over (0, span), or the end at which it is zero already."""
    start, end = guard(0.0), guard(span)
    if (start > 0) == (end > 0):
        return 0.0 if abs(start) < abs(end) else span
    return float(brentq(guard, 0.0, span, xtol=ROOT_SPACING, rtol=4 * np.finfo(float).eps))


def growth_over(a: FloatArray) -> FloatArray:
    """`exp(a) - 1` for a matrix, by scaling, Pade approximation and squaring.

    Without the 1, because a hundred steps of a matrix close to it would add up their rounding. Numpy
    alone: scipy's `expm` solves through a threaded library, which costs milliseconds per 6x6 matrix
    when the machine's cores are busy.
    """
    norm = float(np.abs(a).sum(axis=1).max())
    halvings = max(0, math.frexp(norm)[1] + 1)
    x: FloatArray = a / 2.0**halvings
    power: FloatArray = np.eye(len(a))
    even, odd = np.zeros_like(x), np.zeros_like(x)
    for degree, weight in enumerate(PADE):
        (odd if degree % 2 else even)[...] += weight * power
        power = power @ x
    result: FloatArray = np.linalg.solve(even - odd, 2.0 * odd).astype(np.float64)
    for _ in range(halvings):
        result = result + result + result @ result
    return result


def _carried(a: FloatArray, z: FloatArray, time: float) -> FloatArray:
    moved: FloatArray = z + growth_over(a * time) @ z
    return moved


def _repeated(growth: FloatArray, count: int) -> FloatArray:
    """`exp(k a h) - 1` for k = 1, ..., count, given that of one step."""
    growths = [growth]
    for _ in range(count - 1):
        growths.append(growth + growths[-1] + growth @ growths[-1])
    return np.array(growths)
