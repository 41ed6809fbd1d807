"""Monte Carlo standard errors: how far a number of a posterior may move when it is sampled anew."""

from __future__ import annotations

import numpy as np

from fitball.inference.results.quantiles import QUANTILES, quantiles
from fitball.values import FloatArray


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
