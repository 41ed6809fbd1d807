"""Proofs that a quintic has no zero in an interval, held exactly at their edge by binomials and rational numbers."""

from __future__ import annotations

from fractions import Fraction
from math import comb

import pytest

from fitball.models.kernels.oscillator import falls_once, zero_free

# Largest of x^3 (1 - x)^3 / 720 divided by x^order in [0, 1].
WORST = {0: Fraction(1, 64) / 720, 1: Fraction(2**2 * 3**3, 5**5) / 720, 2: Fraction(3**3, 4**4) / 720}


def reduced(coefficients, order):
    """Bernstein coefficients of a quintic divided by x to the `order`."""
    return [
        Fraction(comb(5, k + order), comb(5 - order, k)) * Fraction(coefficients[k + order]) for k in range(6 - order)
    ]


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("place", range(6))
def test_a_zero_is_excluded_just_beyond_the_error_and_not_before(order, place):
    """One coefficient at a time is the smallest; the proof must change its mind where binomials say."""
    if place < order:
        return
    coefficients = [0.0] * order + [100.0] * (6 - order)
    coefficients[place] = 1.0
    least = float(min(reduced(coefficients, order)))
    for share, proved in ((0.995, True), (1.005, False)):
        error = share * least / float(WORST[order])
        assert zero_free.py_func(order, *coefficients, error) is proved, share
        assert zero_free(order, *coefficients, error) is proved, share


@pytest.mark.parametrize("place", range(5))
def test_a_fall_is_proved_just_beyond_the_error_and_not_before(place):
    """The derivative's coefficients are five times the differences; its error is at most x^2 (1-x)^2 |1-2x| / 240."""
    worst = max(x**2 * (1 - x) ** 2 * abs(1 - 2 * x) for x in (k / 100000 for k in range(100001))) / 240
    drops = [10.0] * 5
    drops[place] = 1.0
    coefficients = [100.0]
    for drop in drops:
        coefficients.append(coefficients[-1] - drop)
    for share, proved in ((0.995, True), (1.005, False)):
        assert falls_once(*coefficients, share * 5.0 / worst) is proved, share
