"""March along a linear phase at any number of digits: Taylor series, events isolated in Bernstein form.

A Taylor step gives every guard as a polynomial on [0, 1]. Its Bernstein coefficients bound it and, by
Descartes' rule, count its zeros, so that no zero inside a step is missed, double ones included.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

from fitball.models.oracle.phases import Matrix, Row, dot
from fitball.models.oracle.setup import Arithmetic, Number

GUARD_DIGITS = 20


def digits_arithmetic(digits: int) -> Arithmetic:
    """Arithmetic of `digits` decimal digits and some to spare, in a context of its own."""
    import mpmath

    context: Any = mpmath.MPContext()
    context.dps = digits + GUARD_DIGITS
    return Arithmetic(
        number=context.mpf,
        sqrt=context.sqrt,
        log=context.log,
        log1p=context.log1p,
        hyp2f1=context.hyp2f1,
        pi=+context.pi,
        unit_roundoff=context.mpf(10) ** (-digits - GUARD_DIGITS),
    )


class TaylorMarch:
    """`March` with the numbers of `kind`."""

    def __init__(self, kind: Arithmetic, digits: int) -> None:
        self.kind = kind
        self.rounding: Number = kind.number(10.0) ** (-digits)

    def __call__(self, matrix: Matrix, state: Row, guards: list[Row], duration: Number) -> tuple[Number, Row, bool]:
        """See `March`."""
        sparse = [[(j, value) for j, value in enumerate(line) if value] for line in matrix]
        norm = max(sum(abs(value) for _, value in line) for line in sparse)
        count = max(1, math.ceil(duration * norm))
        step = duration / count
        for index in range(count):
            series = self._series(sparse, state, step, step * norm)
            sizes = self._sizes(sparse, series, step) if index == 0 else []
            shares = [self._first_fall([dot(row, term) for term in series], row, sizes) for row in guards]
            falls = [share for share in shares if share is not None]
            if falls:
                share = min(falls)
                return (index + share) * step, _summed(series, share), True
            state = _summed(series, self.kind.number(1.0))
        return duration, state, False

    def _series(self, sparse: list[list[tuple[int, Number]]], state: Row, step: Number, reach: Number) -> list[Row]:
        """Taylor terms of the state over one step, as many as the precision can feel."""
        series, bound, order = [state], self.kind.number(1.0), 0
        while bound > self.kind.unit_roundoff:
            order += 1
            bound = bound * reach / order
            last = series[-1]
            series.append([step / order * sum(value * last[j] for j, value in line) for line in sparse])
        return series

    def _sizes(self, sparse: list[list[tuple[int, Number]]], series: list[Row], step: Number) -> list[Row]:
        """Summands behind each Taylor term, signs left out."""
        sizes = [[abs(value) for value in series[0]]]
        for order, last in enumerate(series[:-1], start=1):
            sizes.append([step / order * sum(abs(value * last[j]) for j, value in line) for line in sparse])
        return sizes

    def _first_fall(self, terms: Row, row: Row, sizes: list[Row]) -> Number | None:
        """Share of the step after which the guard with these Taylor terms falls below zero, if it does.

        A phase that begins at a zero of its guard holds rounding there instead: given the `sizes` of
        what was summed, the terms that vanish are made to, up to the first that does not.
        """
        weights = [abs(value) for value in row]
        for order, size in enumerate(sizes):
            if abs(terms[order]) > self.rounding * dot(weights, size):
                break
            terms[order] = self.kind.number(0.0)
        zero, one = self.kind.number(0.0), self.kind.number(1.0)
        return self._isolated(_bernstein(terms), terms, zero, one)

    def _isolated(self, coefficients: Row, terms: Row, left: Number, right: Number) -> Number | None:
        signs = [value > 0 for value in coefficients if value != 0]
        if all(signs):
            return None
        if not signs[0]:
            return left
        changes = sum(a != b for a, b in pairwise(signs))
        if changes == 1 and coefficients[-1] < 0:
            return self._polished(terms, left, right)
        if right - left <= self.rounding:
            # A dip this narrow is a touch: its depth is the square of its width.
            return None if signs[-1] else left
        lower, upper = _halved(coefficients)
        middle = (left + right) / 2
        fall = self._isolated(lower, terms, left, middle)
        return self._isolated(upper, terms, middle, right) if fall is None else fall

    def _polished(self, terms: Row, left: Number, right: Number) -> Number:
        """The single fall through zero between `left` and `right`: Newton, halving where it would leave."""
        slopes = [order * term for order, term in enumerate(terms)][1:]
        low, high = left, right
        share = (low + high) / 2
        while high - low > self.kind.unit_roundoff * 4:
            value, slope = _polynomial(terms, share), _polynomial(slopes, share)
            if value > 0:
                low = share
            else:
                high = share
            guess = share - value / slope if slope < 0 else low
            if not low < guess < high:
                guess = (low + high) / 2
            if abs(guess - share) <= self.kind.unit_roundoff * 4:
                return guess
            share = guess
        return share


def _polynomial(terms: Row, share: Number) -> Number:
    total = terms[-1]
    for term in reversed(terms[:-1]):
        total = total * share + term
    return total


def _summed(series: list[Row], share: Number) -> Row:
    return [_polynomial([term[place] for term in series], share) for place in range(len(series[0]))]


def _bernstein(terms: Row) -> Row:
    """Bernstein coefficients on [0, 1] of the polynomial with these coefficients of the powers."""
    degree = len(terms) - 1
    scaled = [term / math.comb(degree, order) for order, term in enumerate(terms)]
    return [sum(math.comb(place, order) * scaled[order] for order in range(place + 1)) for place in range(degree + 1)]


def _halved(coefficients: Row) -> tuple[Row, Row]:
    """Bernstein coefficients on the two halves of the interval (de Casteljau)."""
    lower, upper, rest = [coefficients[0]], [coefficients[-1]], coefficients
    while len(rest) > 1:
        rest = [(a + b) / 2 for a, b in pairwise(rest)]
        lower.append(rest[0])
        upper.append(rest[-1])
    return lower, upper[::-1]
