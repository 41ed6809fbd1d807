"""Stacking weights of models: the best on the simplex."""

from __future__ import annotations

import numpy as np
import pytest

from fitball.inference.comparison.compare import stacking_weights


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
