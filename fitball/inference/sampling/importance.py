"""Weights of importance sampling, Pareto-smoothed by ArviZ where the largest of them have a tail to be fitted."""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp

from fitball.values import FloatArray

# Draws in a tail that a Pareto distribution can be fitted to, at least.
LEAST_TAIL = 5
# Above this shape of the fitted Pareto tail the importance sampling estimate is not to be trusted (Vehtari, Simpson,
# Gelman, Yao and Gabry 2024).
K_TRUSTED = 0.7


def smoothed(log_ratios: FloatArray, efficiency: float) -> tuple[FloatArray, float]:
    """Logarithms of weights (draws,) that add up to one, from those of importance ratios (draws,), and the Pareto k.

    Where the draws have no tail to be fitted, because walkers sat there or the ratios hardly differ, the weights are
    the ratios themselves and k is infinite, "not to be trusted"; it is -infinite where all ratios are equal, for
    those are exact. `efficiency` is the effective sample size over the number of draws.
    """
    from fitball.inference.sampling.array_stats import array_stats

    ratios = np.exp(log_ratios - log_ratios.max())
    if np.ptp(ratios) <= 0.0:
        return np.full(ratios.shape, -np.log(ratios.size)), -np.inf
    if not has_tail(ratios, efficiency):
        return log_ratios - logsumexp(log_ratios), np.inf
    weights, k = array_stats.psislw(-log_ratios, r_eff=efficiency, axis=-1)
    return weights, float(k)


def smoothed_elpd(
    whole: FloatArray, scored: FloatArray, efficiency: float, log_weights: FloatArray | float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Leave-one-out log densities (impacts,) by Pareto smoothed importance sampling, and the Pareto k (impacts,).

    `whole` (draws, impacts) is the log likelihood of all measurements of an impact, which is what leaving it out
    takes away; `scored` (draws, impacts) that of the measurements to be scored, the same or a part of it.
    `efficiency` is the effective sample size over the number of draws (Vehtari, Gelman and Gabry 2017);
    `log_weights` (draws,) are those of draws that are weighted already.
    """
    count = whole.shape[1]
    elpd, pareto_k = np.empty(count), np.empty(count)
    for row in range(count):
        own, pareto_k[row] = smoothed(log_weights - whole[:, row], efficiency)
        elpd[row] = logsumexp(own + scored[:, row])
    return elpd, pareto_k


def has_tail(ratios: FloatArray, efficiency: float) -> bool:
    """Whether a Pareto distribution can be fitted to the largest of the ratios (draws,).

    The fit divides by how far the first quartile of the tail lies above its edge, the largest ratio outside: draws
    that are tied there make it zero. Sizes as Vehtari, Simpson, Gelman, Yao and Gabry (2024) have them.
    """
    count = ratios.size
    size = int(min(count / 5.0, 3.0 * np.sqrt(count / efficiency)))
    if size < LEAST_TAIL:
        return False
    tail = np.sort(ratios)[-size - 1 :]
    return bool(tail[int(size / 4 + 0.5)] > tail[0] and tail[-1] > tail[1])
