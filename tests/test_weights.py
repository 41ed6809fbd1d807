"""Weights of models: the best on the simplex, and pseudo-BMA."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import softmax

from fitball.inference.comparison.model_weights import pseudo_bma_weights, stacking_weights


def brute_force(elpd, steps=100):
    """The best of all weights on a grid of the simplex of three models."""
    grid = np.array([(a, b, steps - a - b) for a in range(steps + 1) for b in range(steps + 1 - a)]) / steps
    with np.errstate(divide="ignore"):
        scores = np.log(grid @ np.exp(elpd).T).mean(axis=1)
    return grid[np.argmax(scores)], scores.max()


@pytest.mark.parametrize("seed", range(6))
def test_stacking_weights_are_the_best_on_the_simplex(seed):
    elpd = np.random.default_rng(seed).normal(-3.0, 1.2, (21, 3))
    weights = stacking_weights(elpd)
    best, score = brute_force(elpd)
    assert weights.sum() == pytest.approx(1.0)
    assert np.log(np.exp(elpd) @ weights).mean() >= score - 1e-9
    np.testing.assert_allclose(weights, best, atol=0.03)


def test_stacking_keeps_its_head_far_from_one():
    elpd = np.array([[-900.0, -2000.0], [-850.0, -700.0], [-800.0, -810.0]])
    np.testing.assert_allclose(stacking_weights(elpd), [2 / 3, 1 / 3], atol=1e-3)
    np.testing.assert_allclose(stacking_weights(elpd[:1]), [1.0, 0.0], atol=1e-4)


def test_pseudo_bma_weights():
    # The same gap at every impact: no bootstrap can change the totals, and the weights are those of Akaike's form.
    elpd = np.random.default_rng(0).normal(-3.0, 1.0, (15, 1)) + np.array([[0.0, -0.1, 0.05]])
    rng = np.random.default_rng(1)
    np.testing.assert_allclose(pseudo_bma_weights(elpd, rng), softmax(15 * np.array([0.0, -0.1, 0.05])), rtol=1e-9)
    # An uncertain gap is drawn towards equal weights.
    rough = np.random.default_rng(2).normal(0.0, 3.0, (15, 2))
    rough[:, 0] += 0.3 + rough[:, 1].mean() - rough[:, 0].mean()
    plain = softmax(rough.sum(axis=0))
    assert 0.5 < pseudo_bma_weights(rough, rng)[0] < plain[0]


# --- the truth is found, and only when it is there
