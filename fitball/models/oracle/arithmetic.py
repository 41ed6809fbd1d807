"""Kinds of number to solve with: double precision, and any number of decimal digits."""

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

    one = np.array([[context.mpf(j == k) for j in range(6)] for k in range(6)], dtype=object)
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
        growth=lambda a: carried(a, one, context.mpf(1)) - one,
        carried=carried,
        root=lambda function, end: context.findroot(
            function, (context.mpf(0), end), solver="anderson", tol=unit_roundoff * end, maxsteps=200, verify=False
        ),
    )
