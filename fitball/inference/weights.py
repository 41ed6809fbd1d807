"""Weights of several models from their pointwise predictive densities (Yao, Vehtari, Simpson and Gelman 2018)."""

from __future__ import annotations

import numpy as np
from scipy.optimize import LinearConstraint, minimize

from fitball.errors import FitError
from fitball.values import FloatArray

# Draws of the Bayesian bootstrap.
RESAMPLES = 4000
# Largest gain in mean log score an impact that any other mixture could still bring; far below what matters.
GAP = 1e-5


def stacking_weights(elpd: FloatArray) -> FloatArray:
    """Weights (models,) on the simplex that maximise the mean log score of the mixture.

    `elpd` is (impacts, models): log predictive density of each left-out impact. The score is concave, so the largest
    mean ratio of a model's density to the mixture's, less 1, bounds what is left to gain. Raises FitError when that
    bound is not reached.
    """
    count = elpd.shape[1]
    # Scaled by the best model of each impact: the weights do not change, and nothing overflows.
    density = np.exp(elpd - elpd.max(axis=1, keepdims=True))
    tiny = np.finfo(np.float64).tiny

    def cost(weights: FloatArray) -> tuple[float, FloatArray]:
        mixture = np.maximum(density @ weights, tiny)
        return -float(np.mean(np.log(mixture))), -(density / mixture[:, None]).mean(axis=0)

    found = minimize(
        cost,
        np.full(count, 1.0 / count),
        jac=True,
        method="SLSQP",
        bounds=[(0.0, 1.0)] * count,
        constraints=LinearConstraint(np.ones((1, count)), 1.0, 1.0),
        options={"ftol": 1e-14, "maxiter": 1000},
    )
    # SLSQP keeps its constraints to rounding only.
    weights: FloatArray = np.maximum(found.x, 0.0)
    weights = _polished(density, weights / weights.sum())
    gap = float(np.max((density / (density @ weights)[:, None]).mean(axis=0))) - 1.0
    if gap > GAP:
        raise FitError(f"stacking weights did not settle (a gain of {gap:.1g} an impact is left)")
    return weights


def _polished(density: FloatArray, weights: FloatArray) -> FloatArray:
    """Cover's (1984) multiplicative steps, each of which raises the score, from the interior next to `weights`."""
    count = weights.size
    weights = (1.0 - 1e-6) * weights + 1e-6 / count
    for _ in range(2000):
        ratio = (density / (density @ weights)[:, None]).mean(axis=0)
        if ratio.max() - 1.0 < 0.1 * GAP:
            break
        weights = weights * ratio
    total = float(weights.sum())
    return np.asarray(weights / total, dtype=np.float64)


def pseudo_bma_weights(elpd: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Pseudo-BMA weights with the Bayesian bootstrap ("pseudo-BMA+"), (models,); `elpd` is (impacts, models).

    Each replicate weighs the impacts by a flat Dirichlet draw; a model's weight is the mean of its share.
    """
    rows = elpd.shape[0]
    totals = rows * rng.dirichlet(np.ones(rows), RESAMPLES) @ elpd
    shares = np.exp(totals - totals.max(axis=1, keepdims=True))
    weights: FloatArray = (shares / shares.sum(axis=1, keepdims=True)).mean(axis=0)
    return weights
