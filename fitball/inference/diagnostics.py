"""Effective sample sizes of chains, nested R-hat, and Pareto smoothing of weights.

They are those of ArviZ, to rounding. Its import alone takes a tenth of the time of a small fit.
"""

from __future__ import annotations

from typing import Annotated, TypeAlias

import numpy as np
from scipy.special import exprel, ndtri

from fitball.base.values import FloatArray

# Of one quantity; a chain is of a walker.
Chains: TypeAlias = Annotated[FloatArray, "chains steps"]
# Steps of a chain from which its halves have a variance.
LEAST_STEPS = 4
# The prior of the shape of a Pareto tail (Zhang and Stephens 2009): the quantile of the excesses
# that it is scaled by, and the power of the scale.
_PRIOR_QUANTILE = 0.25
_PRIOR_POWER = 3.0
# Excesses that the prior of Pareto k counts as, with the mean 0.5 (Vehtari et al. 2024, app. G).
_PRIOR_EXCESSES = 10.0


def bulk_size(chains: Chains) -> float:
    """The effective sample size of the bulk (Vehtari et al. 2021, section 4.3): that of the
    rank-normalised halves of chains. NaN of too few steps, or where a value is not finite.
    """
    if not _has_statistics(chains):
        return np.nan
    return _size(_normal_scores(_halves(chains)))


def tail_size(chains: Chains, ends: tuple[float, float]) -> float:
    """The effective sample size of two quantiles, the smaller one; NaN as in `bulk_size`."""
    if not _has_statistics(chains):
        return np.nan
    sizes = []
    for end in np.quantile(chains, ends):
        below = (chains <= end).astype(np.float64)
        sizes.append(_size(_halves(below)))
    return min(sizes)


def nested_r_hat(chains: Chains, ensembles: int) -> float:
    """The rank-normalised nested R-hat (Margossian et al. 2024, Eqs. 4 to 8) of chains that are in
    the order of their ensembles: the larger one, of values and of distances from the median. NaN as
    in `bulk_size`, and where no chain moves.
    """
    if not _has_statistics(chains):
        return np.nan
    halves = _halves(chains)
    distances = np.abs(halves - np.median(halves))
    of_values = _r_hat(_normal_scores(halves), ensembles)
    of_distances = _r_hat(_normal_scores(distances), ensembles)
    return max(of_values, of_distances)


def pareto_smoothed_tail(
    log_ratios: Annotated[FloatArray, "draws"],
    size: int,
) -> tuple[Annotated[FloatArray, "draws"], float]:
    """Log weights, which add up to one, whose `size` largest ratios are replaced by expected order
    statistics of the generalised Pareto distribution that is fitted to them, none above the largest
    ratio; its shape, Pareto k (Vehtari et al. 2024). `size` is at least 5, and the ratios of the
    tail differ.
    """
    log_weights = log_ratios - log_ratios.max()
    order = np.argsort(log_weights)
    tail = order[-size:]
    below = order[-size - 1]
    cutoff = np.exp(log_weights[below])
    excesses = np.exp(log_weights[tail]) - cutoff
    k, scale = _pareto(excesses)
    if np.isfinite(k):
        expected = cutoff + scale * _pareto_quantiles(k, size)
        log_weights[tail] = np.minimum(np.log(expected), 0.0)
    total = np.logaddexp.reduce(log_weights)
    return log_weights - total, k


def _pareto_quantiles(k: float, count: int) -> Annotated[FloatArray, "excesses"]:
    """The quantiles of the generalised Pareto distribution of unit scale in the middles of so many
    equal shares. With those x of the exponential distribution, its limit of no shape, they are
    (e^(k x) - 1)/k.
    """
    share = (np.arange(count) + 0.5) / count
    exponential = -np.log1p(-share)
    return np.asarray(exponential * exprel(k * exponential))


def _pareto(excesses: Annotated[FloatArray, "excesses"]) -> tuple[float, float]:
    """Shape and scale of the generalised Pareto distribution of rising excesses, by the posterior
    mean of Zhang and Stephens (2009), whose shape is drawn to 0.5.
    """
    count = len(excesses)
    points = 30 + int(np.sqrt(count))
    quartile = excesses[int(_PRIOR_QUANTILE * count + 0.5) - 1]
    middle = np.arange(points) + 0.5
    spread = 1.0 - np.sqrt(points / middle)
    # Their parameter is the shape over the scale, with the sign turned; of each the most likely
    # shape follows.
    inverse = 1.0 / excesses[-1] + spread / (_PRIOR_POWER * quartile)
    scaled = inverse[:, None] * excesses
    shape = np.log1p(-scaled).mean(axis=1)
    log_likelihood = count * (np.log(-inverse / shape) - shape - 1.0)
    weights = np.exp(log_likelihood - np.logaddexp.reduce(log_likelihood))
    # What rounding leaves of a weight counts nothing.
    rounding = 10.0 * np.finfo(np.float64).eps
    weights[weights < rounding] = 0.0
    mean = float(weights @ inverse / weights.sum())
    k = float(np.log1p(-mean * excesses).mean())
    total = count * k + 0.5 * _PRIOR_EXCESSES
    shrunk = total / (count + _PRIOR_EXCESSES)
    return shrunk, -k / mean


def _has_statistics(chains: Chains) -> bool:
    """Whether there are enough steps, all of them finite."""
    if chains.shape[1] < LEAST_STEPS:
        return False
    return bool(np.isfinite(chains).all())


def _halves(chains: Chains) -> Chains:
    """First and last halves of chains, each as a chain: a trend within one is then seen."""
    half = chains.shape[1] // 2
    first = chains[:, :half]
    last = chains[:, -half:]
    return np.concatenate([first, last])


def _normal_scores(chains: Chains) -> Chains:
    """Quantiles of the normal distribution at the ranks of all values (Blom 1958); equal values
    have their mean rank.
    """
    _, place, counts = np.unique(chains, return_inverse=True, return_counts=True)
    rank = np.cumsum(counts) - 0.5 * (counts - 1)
    share = (rank - 0.375) / (chains.size + 0.25)
    scores = ndtri(share)
    return np.asarray(scores[place].reshape(chains.shape))


def _size(chains: Chains) -> float:
    """The effective sample size of a mean, by Geyer's (1992) initial monotone sequence of the
    correlations of all chains together.
    """
    if np.ptp(chains) < np.finfo(np.float64).resolution:
        return float(chains.size)
    steps = chains.shape[1]
    within, covariance = _covariances(chains)
    total = within * (steps - 1) / steps
    if len(chains) > 1:
        means = chains.mean(axis=1)
        total += np.var(means, ddof=1)
    correlation = 1.0 - (within - covariance) / total
    correlation[0] = 1.0
    time = _correlation_time(correlation)
    # Effective draws are not many more than there are.
    shortest = 1.0 / np.log10(chains.size)
    return float(chains.size / max(time, shortest))


def _correlation_time(correlation: Annotated[FloatArray, "steps"]) -> float:
    """The sum of correlations over all lags, of either sign, by pairs that never rise, up to the
    first that is not positive.
    """
    # The last pair that is looked at.
    last = max((len(correlation) - 1) // 2 - 1, 0)
    looked_at = correlation[: 2 * last + 2]
    pairs = looked_at.reshape(-1, 2).sum(axis=1)
    ended = np.flatnonzero(pairs <= 0.0)
    end = int(ended[0]) if ended.size else last
    falling = np.minimum.accumulate(pairs[:end])
    # Half of the pair that ends the sequence counts where it is positive.
    after = max(float(correlation[2 * end]), 0.0)
    return 2.0 * float(falling.sum()) - 1.0 + after


def _covariances(chains: Chains) -> tuple[float, Annotated[FloatArray, "steps"]]:
    """The mean variance within chains, and their mean autocovariances by lag."""
    steps = chains.shape[1]
    means = chains.mean(axis=1, keepdims=True)
    # Padded, so that no lag reaches around to the begin.
    length = 1 << (2 * steps - 1).bit_length()
    spectra = np.fft.rfft(chains - means, length)
    power = np.mean(np.abs(spectra) ** 2, axis=0)
    sums = np.fft.irfft(power, length)[:steps]
    covariance = sums / steps
    within = covariance[0] * steps / (steps - 1)
    return float(within), covariance


def _r_hat(halves: Chains, ensembles: int) -> float:
    """Nested R-hat of halves of chains: first halves of all ensembles, then second ones."""
    steps = halves.shape[1]
    # Both halves of a chain are of its ensemble.
    by_half = halves.reshape(2, ensembles, -1, steps)
    by_ensemble = by_half.transpose(1, 0, 2, 3)
    of_ensemble = by_ensemble.reshape(ensembles, -1, steps)
    means = of_ensemble.mean(axis=2)
    variances = of_ensemble.var(axis=2, ddof=1)
    within = variances.mean(axis=1) + means.var(axis=1, ddof=1)
    between = means.mean(axis=1).var(ddof=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = between / within.mean()
    return float(np.sqrt(1.0 + ratio))
