"""Weights of several models from their pointwise predictive densities (Yao, Vehtari, Simpson and Gelman 2018)."""

from __future__ import annotations

import numpy as np

from fitball.errors import FitError
from fitball.values import FloatArray

# Largest gain in mean log score an impact that any other mixture could still bring; far below what matters.
GAP = 1e-5
# The score comes within ln(models)/steps of the best (Cover 1984).
STEPS = 300_000


def stacking_weights(elpd: FloatArray) -> FloatArray:
    """Weights (models,) on the simplex that maximise the mean log score of the mixture.

    `elpd` is (impacts, models): log predictive density of each left-out impact. Cover's (1984) multiplicative steps
    raise the score each time. It is concave, so the largest mean ratio of a model's density to the mixture's, less 1,
    bounds what is left to gain. Raises FitError when that bound does not come down.
    """
    # Scaled by the best model of each impact: the weights do not change, and nothing overflows.
    density = np.exp(elpd - elpd.max(axis=1, keepdims=True))
    weights: FloatArray = np.full(elpd.shape[1], 1.0 / elpd.shape[1])
    for _ in range(STEPS):
        ratio = (density / (density @ weights)[:, None]).mean(axis=0)
        if float(ratio.max()) - 1.0 < GAP:
            return weights
        weights = weights * ratio
    raise FitError(f"stacking weights did not settle (a gain of {ratio.max() - 1.0:.1g} an impact is left)")
