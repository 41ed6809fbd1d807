"""Weighted draws: a mixture with known moments, a proposal that is no good, Pareto smoothing,
Student's t.
"""

import numpy as np
import pytest
from scipy import stats

from fitball.inference.sampling.importance import (
    RELIABLE,
    Student,
    effective,
    fitted,
    importance,
    parted,
    smoothed,
)

NEAR = np.array([0.0, 1.0])
FAR = np.array([4.0, -2.0])
SPREAD = np.array([[1.0, 0.6], [0.6, 0.5]])


def mixture(x):
    """0.3 N(NEAR, SPREAD) + 0.7 N(FAR, I/4), and a constant."""
    parts = [np.log(0.3) + stats.multivariate_normal(NEAR, SPREAD).logpdf(x)]
    parts.append(np.log(0.7) + stats.multivariate_normal(FAR, 0.25 * np.eye(2)).logpdf(x))
    return np.logaddexp(*parts) + 7.0


def begin():
    return [Student(NEAR + 0.5, np.eye(2)), Student(FAR - 0.5, np.eye(2))]


def test_moments_of_a_mixture():
    x, log_weights, k = importance(mixture, begin(), np.random.default_rng(0), 4000.0)
    weights = np.exp(log_weights)
    assert weights.sum() == pytest.approx(1.0)
    assert effective(log_weights) >= 4000.0
    assert k < RELIABLE
    mean = 0.3 * NEAR + 0.7 * FAR
    second = 0.3 * (SPREAD + np.outer(NEAR, NEAR)) + 0.7 * (0.25 * np.eye(2) + np.outer(FAR, FAR))
    covariance = second - np.outer(mean, mean)
    # Four standard errors of 4,000 effective draws.
    np.testing.assert_allclose(weights @ x, mean, atol=4.0 * np.sqrt(covariance.max() / 4000.0))
    np.testing.assert_allclose(
        (x * weights[:, None]).T @ x - np.outer(mean, mean),
        covariance,
        rtol=0.1,
    )
    assert weights[x[:, 0] > 2.0].sum() == pytest.approx(0.7 + 0.3 * stats.norm.sf(2.0), abs=0.03)


def test_bounds_cost_draws_and_nothing_else():
    def half(x):
        return np.where(np.all(x > 0.0, axis=1), -0.5 * np.sum(x**2, axis=1), -np.inf)

    x, log_weights, k = importance(
        half,
        [Student(np.zeros(3), np.eye(3))],
        np.random.default_rng(2),
        2000.0,
    )
    assert np.all(x > 0.0)
    assert k < RELIABLE
    np.testing.assert_allclose(np.exp(log_weights) @ x, np.full(3, np.sqrt(2.0 / np.pi)), atol=0.06)


def test_a_bad_proposal_shows():
    # Ten times too narrow: the largest weights have no mean.
    x = 0.1 * np.random.default_rng(3).standard_normal((2000, 4))
    ratios = -0.5 * np.sum(x**2, axis=1) + 0.5 * np.sum((x / 0.1) ** 2, axis=1)
    assert smoothed(ratios, 1.0)[1] > RELIABLE
    # A good one.
    x = 1.2 * np.random.default_rng(3).standard_normal((2000, 4))
    ratios = -0.5 * np.sum(x**2, axis=1) + 0.5 * np.sum((x / 1.2) ** 2, axis=1)
    assert smoothed(ratios, 1.0)[1] < 0.3


def test_parts_follow_a_bent_distribution():
    rng = np.random.default_rng(6)
    x = rng.standard_normal((8000, 2)) * [1.0, 0.2]
    x[:, 1] += x[:, 0] ** 2
    x, (shares, parts) = 1e3 * x, zip(*parted(1e3 * x, rng), strict=True)
    truth = stats.norm.logpdf(x[:, 0], scale=1e3) + stats.norm.logpdf(
        x[:, 1],
        x[:, 0] ** 2 / 1e3,
        200.0,
    )
    one = fitted(x).log_density(x)
    each = np.array([np.exp(part.log_density(x)) for part in parts])
    many = np.log(np.array(shares) @ each)
    assert sum(shares) == pytest.approx(1.0)
    assert 0.0 < np.mean(truth - many) < 0.3 * np.mean(truth - one)
    assert parted(x[:3] * [1.0, 0.0], rng) == []


def test_a_density_that_no_proposal_meets():
    proposal = [Student(np.zeros(2), np.eye(2))]
    x, log_weights, k = importance(
        lambda x: np.full(len(x), -np.inf),
        proposal,
        np.random.default_rng(4),
        1000.0,
    )
    assert not len(x)
    assert not len(log_weights)
    assert k == np.inf


def test_smoothing():
    rng = np.random.default_rng(5)
    # Ratios with a Pareto tail of shape 0.5 have k 0.5 but for chance.
    heavy = -0.5 * np.log(rng.uniform(size=20_000))
    weights, k = smoothed(heavy, 1.0)
    assert k == pytest.approx(0.5, abs=0.15)
    assert np.exp(weights).sum() == pytest.approx(1.0)
    assert weights.max() < (heavy - np.logaddexp.reduce(heavy)).max() + 0.5
    # Order is kept; shape of the body too.
    body = np.argsort(heavy)[:15_000]
    np.testing.assert_allclose(np.diff(weights[body]), np.diff(heavy[body]), atol=1e-9)
    weights, k = smoothed(np.full(50, 3.0), 1.0)
    assert k == -np.inf
    assert np.allclose(weights, -np.log(50.0))
    assert smoothed(np.array([0.0, 1.0, 2.0]), 1.0)[1] == np.inf
    # Walkers that sat there: the largest is outside by chance.
    assert smoothed(np.repeat([0.0, 1.0], 500), 1.0)[1] == np.inf


def test_a_student_distribution():
    own = Student(NEAR, np.linalg.cholesky(SPREAD), 6.0)
    other = stats.multivariate_t(NEAR, SPREAD, df=6.0)
    x = own.draw(np.random.default_rng(6), 20_000)
    np.testing.assert_allclose(own.log_density(x[:50]), other.logpdf(x[:50]), rtol=1e-10)
    np.testing.assert_allclose(np.cov(x.T), SPREAD * 6.0 / 4.0, rtol=0.08)
    taught = fitted(x)
    np.testing.assert_allclose(taught.centre, NEAR, atol=0.05)
    np.testing.assert_allclose(taught.factor @ taught.factor.T, 1.1 * SPREAD * 6.0 / 4.0, rtol=0.08)
    # Weights that rest on one draw are flattened until there are enough; draws on a line span
    # nothing.
    alone = np.where(np.arange(len(x)) == 0, 0.0, -50.0 - np.arange(len(x)) * 1e-3)
    assert fitted(x, alone) is not None
    assert fitted(np.column_stack([x[:, 0], 2.0 * x[:, 0]])) is None
