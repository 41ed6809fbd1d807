"""Taylor series of motions `z' = A z`, in any kind of number, and where sums over them fall."""

import math
from collections.abc import Callable
from decimal import Decimal
from typing import Any, NamedTuple

# Fastest pole times the length of a piece: its series then converges in few terms.
REACH = 2
# Terms that decide what comes next: forces of zero at the start have grown by then.
FIRST = 5


class Numbers(NamedTuple):
    """A kind of number: how one is made, roots, logarithms, and how many `digits` it has."""

    make: Callable[[Any], Any]
    sqrt: Callable[[Any], Any]
    log: Callable[[Any], Any]
    digits: int

    @property
    def rounding(self):
        """Relative size below which a sum of a few terms is zero."""
        return self.make(10) ** (3 - self.digits)

    @property
    def terms(self):
        """Terms after which a series of reach REACH has converged."""
        small = 10 ** (-self.digits - 2)
        return next(n for n in range(999) if REACH**n < math.factorial(n) * small)


DOUBLE = Numbers(float, math.sqrt, math.log, 16)
# Fifty digits of each answer are good.
FIFTY = Numbers(Decimal, Decimal.sqrt, Decimal.ln, 60)


def value(c, x):
    """A polynomial and its slope."""
    f = 0 * x
    d = 0 * x
    for coefficient in reversed(c):
        d = d * x + f
        f = f * x + coefficient
    return f, d


def first_fall(c, zero, least):
    """First x in (0, 1] where a polynomial that is positive at first falls to zero, else None:
    intervals are proved free of zeros, or monotonic, by a bound of the second derivative, or
    halved.
    """
    bend = sum(k * (k - 1) * abs(coefficient) for k, coefficient in enumerate(c))
    parts = [(zero, zero + 1)]
    while parts:
        low, high = parts.pop()
        middle = (low + high) / 2
        half = (high - low) / 2
        f, d = value(c, middle)
        free_of_zeros = abs(f) > abs(d) * half + bend * half * half / 2
        monotonic = abs(d) > bend * half
        if free_of_zeros:
            if f < 0:
                return low
        elif monotonic or half < least:
            if d < 0 and value(c, high)[0] <= 0:
                return falling(c, low, high, least)
            if value(c, low)[0] < 0:
                return low
        else:
            parts += [(middle, high), (low, middle)]
    return None


def falling(c, low, high, least):
    """The zero of a falling polynomial between two points, by Newton's steps that stay between
    them.
    """
    x = (low + high) / 2
    old = high
    for _ in range(400):
        if abs(x - old) <= least / 1000:
            break
        f, d = value(c, x)
        if f > 0:
            low = x
        else:
            high = x
        old = x
        x = (low + high) / 2
        if d < 0:
            x = min(max(old - f / d, low), high)
    return x


def total(*parts):
    """A sum of multiples of weights, `(factor, weights)`; weights are mappings from indices of the
    state.
    """
    indices = sorted({index for _, weights in parts for index in weights})
    sums = {}
    for index in indices:
        sums[index] = sum(factor * weights.get(index, 0) for factor, weights in parts)
    return sums


def weighted(weights, state):
    """The weighted sum over a state."""
    return sum([weight * state[index] for index, weight in weights.items()])


def sizes_of(weights):
    return {index: abs(weight) for index, weight in weights.items()}


def series(rates, z, h, count):
    """Terms in t/h of the motion z' = A z that begins at z; `rates` are the rows of A."""
    terms = [z]
    for k in range(1, count):
        share = h / k
        last = terms[-1]
        terms.append([share * weighted(row, last) for row in rates])
    return terms


class Piece:
    """A piece of a motion: its terms, and the size of what is added up in the first of them."""

    def __init__(self, rates, z, h, kind, count=0):
        self.terms = series(rates, z, h, count or kind.terms)
        self.kind = kind
        self.zero = 0 * z[0]
        sizes = [sizes_of(row) for row in rates]
        self.sizes = series(sizes, [abs(number) for number in z], h, FIRST)

    def leading(self, weights):
        """A weighted sum of the state as terms, and the index of the first that is not rounding
        (None: all are).
        """
        c = [weighted(weights, z) for z in self.terms]
        noise = self.kind.rounding
        absolute = sizes_of(weights)
        for k, z in enumerate(self.sizes):
            if abs(c[k]) > noise * weighted(absolute, z):
                return c, k
        return c, None

    def sign(self, weights):
        """Whether a weighted sum is positive just after the start (1), negative (-1) or neither
        (0).
        """
        c, k = self.leading(weights)
        if k is None:
            return 0
        return 1 if c[k] > 0 else -1

    def fall(self, weights):
        """When a weighted sum falls to zero: None if not here, 0 if it is falling from there."""
        c, k = self.leading(weights)
        if k is None:
            return None
        if c[k] < 0:
            return self.zero
        return first_fall(c[k:], self.zero, self.kind.rounding)

    def at(self, x):
        """The state at x."""
        return [value(column, x)[0] for column in zip(*self.terms, strict=True)]
