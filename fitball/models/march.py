"""The march of the oracle along a linear phase: kinds of number to solve with, double precision or any number of
decimal digits, and matrix exponentials on a grid, events bracketed there and polished.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import hyp2f1

from fitball.values import FloatArray

# A float or an mpmath number; mpmath has no types of its own to name here.
Number = Any
Row = list[Any]
Matrix = list[Row]
GUARD_DIGITS = 20
ROOT_SPACING = 1e-17
# Diagonal Pade approximant of the exponential: below a norm of 1/2 its error is far under rounding.
PADE_DEGREE = 8
PADE = [
    math.factorial(2 * PADE_DEGREE - j) * math.comb(PADE_DEGREE, j) / math.factorial(2 * PADE_DEGREE)
    for j in range(PADE_DEGREE + 1)
]


@dataclass(frozen=True)
class Arithmetic:
    """`unit_roundoff` is the spacing of its numbers at 1, `rounding` the relative size below which a sum counts as
    zero, `noise` that by which half a dozen products after some hundred steps may be off.

    `array` holds numbers. `growth` gives `exp(a) - 1` of a matrix: without the 1, because a hundred steps of a matrix
    close to it would add up their rounding; `carried(a, z, time)` gives `exp(a time) z`. `root` is the zero of a
    function that changes sign between 0 and an end.
    """

    number: Callable[[Any], Number]
    sqrt: Callable[[Number], Number]
    log: Callable[[Number], Number]
    log1p: Callable[[Number], Number]
    hyp2f1: Callable[[int, int, Number, Number], Number]
    pi: Number
    unit_roundoff: Number
    rounding: Number
    noise: Number
    array: Callable[[Any], FloatArray]
    growth: Callable[[FloatArray], FloatArray]
    carried: Callable[[FloatArray, FloatArray, Number], FloatArray]
    root: Callable[[Callable[[Number], Number], Number], Number]


def _growth(a: FloatArray) -> FloatArray:
    """By scaling, Pade approximation and squaring.

    Numpy alone: scipy's `expm` solves through a threaded library, which costs milliseconds when cores are busy.
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


DOUBLE = Arithmetic(
    number=float,
    sqrt=math.sqrt,
    log=math.log,
    log1p=math.log1p,
    hyp2f1=hyp2f1,
    pi=math.pi,
    unit_roundoff=float(np.finfo(float).eps),
    rounding=1e-12,
    noise=2e-14,
    array=lambda rows: np.array(rows, dtype=np.float64),
    growth=_growth,
    carried=lambda a, z, time: np.asarray(z + _growth(a * time) @ z),
    root=lambda function, end: float(brentq(function, 0.0, end, xtol=ROOT_SPACING, rtol=4 * np.finfo(float).eps)),
)


def digits_arithmetic(digits: int) -> Arithmetic:
    """Arithmetic of `digits` decimal digits and some to spare, in a context of its own."""
    import mpmath

    context: Any = mpmath.MPContext()
    context.dps = digits + GUARD_DIGITS
    unit_roundoff = context.mpf(10) ** (-digits - GUARD_DIGITS)

    def carried(a: FloatArray, z: FloatArray, time: Number) -> FloatArray:
        """By Taylor series over parts of the time."""
        parts = max(1, math.ceil(float(np.abs(a).sum(axis=1).max() * time)))
        for _ in range(parts):
            term, order = z, 0
            while np.abs(term).max() > unit_roundoff:
                order += 1
                term = a @ term * (time / parts / order)
                z = z + term
        return z

    def growth(a: FloatArray) -> FloatArray:
        one = np.array([[context.mpf(j == k) for j in range(len(a))] for k in range(len(a))], dtype=object)
        return np.asarray(carried(a, one, context.mpf(1)) - one)

    return Arithmetic(
        number=context.mpf,
        sqrt=context.sqrt,
        log=context.log,
        log1p=context.log1p,
        hyp2f1=context.hyp2f1,
        pi=+context.pi,
        unit_roundoff=unit_roundoff,
        rounding=context.mpf(10) ** (-digits),
        noise=100 * unit_roundoff,
        array=lambda rows: np.array(rows, dtype=object),
        growth=growth,
        carried=carried,
        root=lambda function, end: context.findroot(
            function, (context.mpf(0), end), solver="anderson", tol=unit_roundoff * end, maxsteps=200, verify=False
        ),
    )


# Over a twentieth of the fastest pole's time a guard is as good as a parabola: it can touch zero
# twice inside a step only around one extremum, which is looked for.
STEPS_PER_POLE_TIME = 20.0
STEPS_A_BLOCK = 64
# A phase may begin at a zero of its own guard; samples that crowd towards the start see a guard
# that rises and falls again within the first step.
START_SAMPLES: FloatArray = 0.25 ** np.arange(10.0, 0.0, -1.0)


class ExpmMarch:
    """Carries a state along one linear phase up to its first event, with numbers of one kind; arrays hold them as
    objects where they are no doubles. `rounding` is the relative size below which a sum counts as zero.
    """

    def __init__(self, kind: Arithmetic) -> None:
        self.kind, self.rounding = kind, kind.rounding

    def __call__(self, matrix: Matrix, state: Row, guards: list[Row], duration: Number) -> tuple[Number, Row, bool]:
        """Elapsed time, state there, and whether a guard row fell below zero before `duration`."""
        a, z = self.kind.array(matrix), self.kind.array(state)
        rows = self.kind.array(guards).reshape(-1, z.size)
        fastest = float(np.max(np.abs(np.linalg.eigvals(a.astype(np.float64)))))
        count = max(1, int(np.ceil(float(duration * fastest * STEPS_PER_POLE_TIME))))
        step = duration / count
        if not len(rows):
            return duration, list(self.kind.carried(a, z, duration)), False
        growths = _repeated(self.kind.growth(a * step), min(count, STEPS_A_BLOCK))
        reached = np.zeros((1, len(rows)))
        for block in range(0, count, STEPS_A_BLOCK):
            size = min(STEPS_A_BLOCK, count - block)
            times: FloatArray = np.arange(size + 1, dtype=np.float64) * step
            states = np.vstack([z, z + growths[:size] @ z])
            if block == 0:
                early = np.array([self.kind.carried(a, z, step * share) for share in START_SAMPLES.tolist()])
                times = np.concatenate([times[:1], START_SAMPLES * step, times[1:]])
                states = np.vstack([states[:1], early, states[1:]])
            sizes = np.maximum(_sizes(rows, a, states, block * step + times), reached)
            sizes = np.maximum.accumulate(sizes, axis=0)
            reached = sizes[-1:]
            first_falls = [
                self._first_fall(row, a, times, states, self.kind.noise * size)
                for row, size in zip(rows, sizes.T, strict=True)
            ]
            falls = [fall for fall in first_falls if fall is not None]
            if falls:
                index, beyond = min(falls, key=lambda fall: times[fall[0]] + fall[1])
                elapsed = block * step + times[index] + beyond
                return elapsed, list(self.kind.carried(a, states[index], beyond)), True
            z = states[-1]
        return duration, list(z), False

    def _first_fall(
        self, row: FloatArray, a: FloatArray, times: FloatArray, states: FloatArray, noise: FloatArray
    ) -> tuple[int, Number] | None:
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
            gap, at = gaps[index], states[index]
            bottom = self._root(a.T @ row, a, at, gap)
            if row @ self.kind.carried(a, at, bottom) < -noise[index + 1]:
                return int(index), self._root(row, a, at, bottom)
        if not below.size:
            return None
        above = np.flatnonzero(values[:last] > 0)
        if not above.size:
            return 0, self.kind.number(0.0)
        index = int(above[-1])
        return index, self._root(row, a, states[index], gaps[index])

    def _root(self, row: FloatArray, a: FloatArray, z: FloatArray, span: Number) -> Number:
        """When a guard that changes sign within `span` is zero, or the end at which it is zero already."""

        def guard(time: Number) -> Number:
            return self.kind.number(row @ self.kind.carried(a, z, time))

        nothing, span = self.kind.number(0.0), self.kind.number(span)
        start, end = guard(nothing), guard(span)
        if (start > 0) == (end > 0):
            return nothing if abs(start) < abs(end) else span
        return self.kind.root(guard, span)


def _repeated(growth: FloatArray, count: int) -> FloatArray:
    """`exp(k a h) - 1` for k = 1, ..., count, given that of one step."""
    growths = [growth]
    for _ in range(count - 1):
        growths.append(growth + growths[-1] + growth @ growths[-1])
    return np.array(growths)


def _sizes(rows: FloatArray, a: FloatArray, states: FloatArray, elapsed: FloatArray) -> FloatArray:
    """Summands of each guard and of its growth since the phase began, shape (samples, guards)."""
    weights = np.abs(rows).T
    growth = np.abs(states) @ np.abs(a).T @ weights
    sizes: FloatArray = np.abs(states) @ weights + growth * elapsed[:, None]
    return sizes
