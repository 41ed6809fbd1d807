"""Are ranks uniform? Pointwise and simultaneous tests of the empirical distribution, chi-square, coverage.

The simultaneous band around the empirical distribution of uniform ranks is that of Sailynoja, Burkner and Vehtari
(2022, Statistics and Computing 32:32): pointwise binomial intervals, their level adjusted so that a uniform sample
leaves the band anywhere with the stated probability. The level comes from seeded simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom, chi2

from fitball.values import FloatArray
from validation.harness import Rate

IntArray = NDArray[np.int64]

SIMULATIONS = 20_000
SIMULATION_SEED = 2022
# Least expected count of a bin for the chi-square distribution to hold (Cochran 1954).
LEAST_EXPECTED = 5


@dataclass(frozen=True)
class NullDistribution:
    """What uniform ranks of `count` replicates among `values` values do.

    `pointwise` (values - 1, count + 1): two-sided probability of `c` ranks at or below each value but the last.
    `smallest` (simulations,): the smallest such probability over all values, for uniform samples, sorted.
    """

    count: int
    values: int
    pointwise: FloatArray
    smallest: FloatArray

    def statistic(self, ranks: IntArray) -> float:
        """Smallest pointwise probability of ranks (count,)."""
        return float(_smallest(self.pointwise, ranks[None, :], self.values)[0])

    def p_value(self, ranks: IntArray) -> float:
        """Share of uniform samples whose statistic is as small; never below that of one in all simulations."""
        below = np.searchsorted(self.smallest, self.statistic(ranks), side="right")
        return float((below + 1) / (self.smallest.size + 1))

    def band(self, confidence: float) -> tuple[FloatArray, FloatArray]:
        """Least and greatest empirical distribution at each value but the last that uniform ranks keep to."""
        level = float(np.quantile(self.smallest, 1.0 - confidence, method="lower"))
        inside = self.pointwise >= level
        low = np.argmax(inside, axis=1)
        high = self.count - np.argmax(inside[:, ::-1], axis=1)
        return low / self.count, high / self.count


def null_distribution(count: int, values: int) -> NullDistribution:
    """Simulate it; the same numbers every time."""
    probability = np.arange(1, values)[:, None] / values
    held = np.arange(count + 1)
    at_most = binom.cdf(held, count, probability)
    at_least = binom.sf(held - 1, count, probability)
    pointwise = np.minimum(1.0, 2.0 * np.minimum(at_most, at_least))
    rng = np.random.default_rng(SIMULATION_SEED)
    parts = [_smallest(pointwise, rng.integers(values, size=(SIMULATIONS // 20, count)), values) for _ in range(20)]
    return NullDistribution(count, values, pointwise, np.sort(np.concatenate(parts)))


def empirical(ranks: IntArray, values: int) -> IntArray:
    """Number of ranks (samples, count) at or below each value but the last, (samples, values - 1)."""
    samples = ranks.shape[0]
    cells = ranks + values * np.arange(samples)[:, None]
    counts = np.bincount(cells.ravel(), minlength=samples * values).reshape(samples, values)
    cumulative: IntArray = np.cumsum(counts, axis=1, dtype=np.int64)[:, :-1]
    return cumulative


def _smallest(pointwise: FloatArray, ranks: IntArray, values: int) -> FloatArray:
    held = empirical(ranks, values)
    smallest: FloatArray = pointwise[np.arange(values - 1), held].min(axis=1)
    return smallest


def bins_for(count: int, values: int) -> int:
    """Most equal bins of at least LEAST_EXPECTED expected ranks, at most 20."""
    return max(bins for bins in range(1, 21) if values % bins == 0 and (bins <= 2 or count >= LEAST_EXPECTED * bins))


def chi_square(ranks: IntArray, values: int) -> tuple[float, float]:
    """Pearson's statistic of binned ranks and its probability for uniform ones."""
    bins = bins_for(ranks.size, values)
    counts = np.bincount(ranks * bins // values, minlength=bins)
    expected = ranks.size / bins
    statistic = float(np.sum((counts - expected) ** 2) / expected)
    return statistic, float(chi2.sf(statistic, bins - 1))


def coverage(ranks: IntArray, values: int, nominal: float) -> Rate:
    """How often the central interval of probability `nominal` held the truth, by ranks.

    `values` times `nominal` must be whole and leave as many values below as above. Raises ValueError.
    """
    outside = round(values * (1.0 - nominal))
    if outside % 2 or abs(values * (1.0 - nominal) - outside) > 1e-9 * values:
        raise ValueError(f"no central interval of {nominal} among {values} values")
    edge = outside // 2
    return Rate(int(np.count_nonzero((ranks >= edge) & (ranks < values - edge))), ranks.size)


def holm(p_values: Sequence[float]) -> list[float]:
    """Adjusted probabilities of a family of tests (Holm 1979), in the order given."""
    order = np.argsort(p_values, kind="stable")
    adjusted = [1.0] * len(p_values)
    largest = 0.0
    for position, k in enumerate(order):
        largest = max(largest, min(1.0, (len(p_values) - position) * p_values[int(k)]))
        adjusted[int(k)] = largest
    return adjusted
