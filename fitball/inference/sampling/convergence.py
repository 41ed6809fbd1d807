"""Convergence of several ensembles, by ArviZ's statistics, and how far a number of a posterior may move when it is
sampled anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from fitball.errors import FitError
from fitball.inference.results.quantiles import QUANTILES, quantiles
from fitball.inference.results.results import TARGET_ESS, TARGET_R_HAT
from fitball.values import FloatArray
from fitball.wording import spoken

# Quantiles whose effective sample size is the "tail" one.
TAILS = (0.05, 0.95)


@dataclass(frozen=True)
class Convergence:
    """Effective sample sizes (bulk, tail) and rank-normalised nested R-hat by parameter name."""

    ess_bulk: Mapping[str, float]
    ess_tail: Mapping[str, float]
    r_hat: Mapping[str, float]

    @property
    def min_ess(self) -> float:
        """The smallest effective sample size of all."""
        return min(*self.ess_bulk.values(), *self.ess_tail.values())

    @property
    def max_r_hat(self) -> float:
        """The largest R-hat of all."""
        return max(self.r_hat.values())

    @property
    def reached(self) -> bool:
        """Whether every parameter has what it needs."""
        return self.meets(TARGET_ESS, TARGET_R_HAT)

    def meets(self, ess: float, r_hat: float) -> bool:
        """Whether every parameter has that effective sample size and an R-hat below that."""
        return self.min_ess >= ess and self.max_r_hat < r_hat


def convergence(names: tuple[str, ...], coordinates: FloatArray) -> Convergence:
    """Diagnose chains (ensembles, steps, walkers, free).

    Walkers are the chains of the effective sample size; ensembles are the superchains of R-hat (Margossian et al.
    2024), because walkers of one ensemble are not independent starts. Raises FitError for a parameter that never
    moved, for which none of these numbers exists.
    """
    from fitball.inference.sampling.array_stats import array_stats

    ensembles, steps, walkers, _ = coordinates.shape
    chains = coordinates.transpose(0, 2, 1, 3).reshape(ensembles * walkers, steps, -1)
    # R-hat and the size of the bulk are both those of normal scores, which ArviZ would make twice.
    owner = np.tile(np.repeat(np.arange(ensembles), walkers), 2)
    bulk, tail, r_hat = {}, {}, {}
    for k, name in enumerate(names):
        column = np.ascontiguousarray(chains[:, :, k])
        if np.ptp(column) <= 0.0:
            raise FitError(
                f"the sampler never moved {name}: all its draws are equal; widen its prior, or fix it "
                + spoken(f"(--fix {name}=VALUE)", f"(fix={{{name!r}: ...}})")
            )
        halves = np.vstack([column[:, : steps // 2], column[:, -(steps // 2) :]])
        scores, folded = normal_scores(halves), normal_scores(np.abs(halves - np.median(halves)))
        bulk[name] = float(array_stats.ess(scores, chain_axis=0, draw_axis=1, method="identity"))
        tail[name] = float(array_stats.ess(column, chain_axis=0, draw_axis=1, method="tail", prob=TAILS))
        r_hat[name] = max(
            float(array_stats.rhat_nested(z, superchain_ids=owner, chain_axis=0, draw_axis=1, method="identity"))
            for z in (scores, folded)
        )
    return Convergence(bulk, tail, r_hat)


def normal_scores(draws: FloatArray) -> FloatArray:
    """Normal quantiles of the ranks of draws, as Vehtari et al. (2021) have them, in the shape of the draws; tied
    draws, as those of a walker are that sat, share the mean of their ranks.
    """
    flat = draws.ravel()
    order = np.argsort(flat)
    ordered = flat[order]
    first = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]]))
    ends = np.append(first[1:], flat.size)
    scores = np.empty(flat.size)
    scores[order] = np.repeat(ndtri((0.5 * (first + 1 + ends) - 0.375) / (flat.size + 0.25)), ends - first)
    return scores.reshape(draws.shape)


def summaries(draws: FloatArray) -> dict[str, float]:
    """Standard deviation and `QUANTILES` of the draws of one parameter, any shape."""
    flat = draws.ravel()
    return {"sd": float(np.std(flat, ddof=1)), **quantiles(flat)}


def standard_errors(chains: FloatArray) -> dict[str, float]:
    """Monte Carlo standard errors of `summaries`, for chains (ensembles, steps, walkers) of one parameter.

    From effective sample sizes, that of each quantile its own (Vehtari et al. 2021), walkers being the chains as in
    `diagnostics`.
    """
    from fitball.inference.sampling.array_stats import array_stats

    ensembles, steps, walkers = chains.shape
    column = np.ascontiguousarray(chains.transpose(0, 2, 1).reshape(ensembles * walkers, steps))
    errors = {"sd": float(array_stats.mcse(column, chain_axis=0, draw_axis=1, method="sd"))}
    for name, level in QUANTILES.items():
        errors[name] = float(array_stats.mcse(column, chain_axis=0, draw_axis=1, method="quantile", prob=level))
    return errors
