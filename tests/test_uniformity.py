"""The statistics of ranks, against exact calculations and published formulas."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom, binomtest, chisquare, kstest
from validation.ranks import bins_for, chi_square, coverage, holm, null_distribution


def exact_probability_within(low, high, count, values):
    """Probability that the empirical distribution of uniform ranks stays within counts low..high at each value.

    The recursion of Sailynoja et al. (2022), Sec. 2.2.2: ranks not yet passed fall below the next value
    independently.
    """
    state = np.zeros(count + 1)
    state[0] = 1.0
    for r in range(values - 1):
        share = 1.0 / (values - r)
        following = np.zeros(count + 1)
        for held in np.flatnonzero(state):
            left = count - held
            following[held:] += state[held] * binom.pmf(np.arange(left + 1), left, share)
        allowed = np.arange(count + 1)
        state = np.where((allowed >= low[r]) & (allowed <= high[r]), following, 0.0)
    return state.sum()


@pytest.mark.parametrize(("count", "values"), [(60, 20), (100, 40)])
def test_the_simultaneous_band_holds_what_it_promises(count, values):
    null = null_distribution(count, values)
    low, high = null.band(0.95)
    found = exact_probability_within(np.rint(low * count), np.rint(high * count), count, values)
    # Counts are whole, so the band cannot have exactly 95 %; simulation adds an error of 0.002.
    assert 0.945 < found < 0.985
    # A pointwise band is narrower and promises much less.
    pointwise = [binom.ppf(level, count, np.arange(1, values) / values) for level in (0.025, 0.975)]
    assert exact_probability_within(*pointwise, count, values) < 0.85


def test_p_values_of_uniform_ranks_are_uniform_and_small_for_others():
    count, values = 100, 200
    null = null_distribution(count, values)
    rng = np.random.default_rng(4)
    found = [null.p_value(rng.integers(values, size=count)) for _ in range(300)]
    assert kstest(found, "uniform").pvalue > 0.01
    steep = np.minimum(values - 1, (values * rng.beta(0.5, 0.5, count)).astype(np.int64))
    assert null.p_value(steep) < 1e-3
    shifted = np.minimum(values - 1, (values * rng.beta(1.0, 1.8, count)).astype(np.int64))
    assert null.p_value(shifted) < 1e-3


def test_chi_square_against_scipy():
    ranks = np.random.default_rng(2).integers(200, size=300)
    statistic, p = chi_square(ranks, 200)
    expected = chisquare(np.histogram(ranks, bins=20, range=(0, 200))[0])
    assert statistic == pytest.approx(expected.statistic)
    assert p == pytest.approx(expected.pvalue)
    assert [bins_for(count, 200) for count in (300, 99, 50, 21, 3)] == [20, 10, 10, 4, 2]


def test_coverage_against_scipy():
    ranks = np.array([0, 4, 5, 19, 20, 49, 50, 149, 150, 194, 195, 199])
    hits = {0.5: 2, 0.8: 5, 0.95: 8}
    for nominal, held in hits.items():
        found = coverage(ranks, 200, nominal)
        exact = binomtest(held, ranks.size).proportion_ci(0.95, method="exact")
        assert found.value == pytest.approx(held / 12)
        assert (found.low, found.high) == pytest.approx((exact.low, exact.high))
    everything = coverage(np.arange(200), 200, 0.95)
    assert everything.value == 0.95
    assert coverage(np.full(5, 100), 200, 0.5).high == 1.0
    assert coverage(np.full(5, 0), 200, 0.5).low == 0.0
    with pytest.raises(ValueError, match="no central interval"):
        coverage(ranks, 100, 0.95)


def test_holm_by_hand():
    # Holm (1979): the smallest times 4, the next times 3, never falling.
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
