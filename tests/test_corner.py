"""Posteriors whose maximum is in a corner of the bounds, as that of scatter which data do not show."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fitball.inference.sampling.importance import importance_posterior, within_bounds
from fitball.inference.sampling.moves import StudentProposal

FREE, AT_ZERO = 9, 6


def corner() -> Any:
    """A normal distribution of nine coordinates, of which six are positive."""

    def log_density(coordinates: np.ndarray) -> np.ndarray:
        inside = (coordinates[:, :AT_ZERO] >= 0.0).all(axis=1)
        return np.where(inside, -0.5 * np.sum(coordinates**2, axis=1), -np.inf)

    return SimpleNamespace(
        dimension=FREE, prior=SimpleNamespace(log_density=log_density), to_values=lambda coordinates: coordinates
    )


def proposal() -> StudentProposal:
    return StudentProposal(np.zeros(FREE), np.eye(FREE))


def test_the_share_inside_is_that_of_the_corner() -> None:
    rng = np.random.default_rng(1)
    drawn, share = within_bounds(corner(), lambda count: proposal().draw(rng, count), 500)
    assert drawn.shape == (500, FREE) and (drawn[:, :AT_ZERO] >= 0.0).all()
    assert share == pytest.approx(0.5**AT_ZERO, rel=0.15)


def test_draws_that_are_mostly_inside_are_left_as_they_are() -> None:
    wide = StudentProposal(np.r_[np.full(AT_ZERO, 9.0), np.zeros(FREE - AT_ZERO)], np.eye(FREE))
    drawn, share = within_bounds(corner(), lambda count: wide.draw(np.random.default_rng(2), count), 300)
    assert share == 1.0 and np.array_equal(drawn, wide.draw(np.random.default_rng(2), 300))


def test_importance_sampling_finds_a_corner() -> None:
    problem = corner()
    found = importance_posterior(
        problem, [proposal()], np.random.default_rng(3), 2000.0, lambda one, at: one.prior.log_density(at)
    )
    assert found.effective >= 2000.0
    weights = np.exp(found.log_weights)
    means, squares = weights @ found.values, weights @ found.values**2
    # Of half a normal distribution the mean is sqrt(2/pi), the mean square 1.
    assert np.allclose(means[:AT_ZERO], np.sqrt(2.0 / np.pi), atol=0.1)
    assert np.allclose(means[AT_ZERO:], 0.0, atol=0.12) and np.allclose(squares, 1.0, atol=0.2)


def test_two_proposals_are_weighed_by_what_is_inside() -> None:
    """In one round, before any is fitted: 0.80 of 1 +- 0.04, and 0.47 where the shares are turned over."""
    problem = corner()
    within = StudentProposal(np.r_[np.full(AT_ZERO, 1.2), np.zeros(FREE - AT_ZERO)], 0.7 * np.eye(FREE))
    found = importance_posterior(
        problem, [proposal(), within], np.random.default_rng(4), 20.0, lambda one, at: one.prior.log_density(at)
    )
    means = np.exp(found.log_weights) @ found.values
    assert np.mean(means[:AT_ZERO]) == pytest.approx(np.sqrt(2.0 / np.pi), abs=0.12)
