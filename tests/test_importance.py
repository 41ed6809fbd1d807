"""Weighted draws: a mixture with known moments, a proposal that is no good, Pareto smoothing,
Student's t.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from fitball.inference.sampling.importance import (
    RELIABLE_K,
    Student,
    effective_size,
    fit_mixture,
    fit_student,
    importance,
    pareto_smoothed,
)

NEAR = np.array([0.0, 1.0])
FAR = np.array([4.0, -2.0])
SPREAD_NEAR = np.array(
    [
        [1.0, 0.6],
        [0.6, 0.5],
    ]
)
SPREAD_FAR = 0.25 * np.eye(2)


def mixture(x):
    """0.3 N(NEAR, SPREAD_NEAR) + 0.7 N(FAR, SPREAD_FAR), and a constant."""
    near = stats.multivariate_normal(NEAR, SPREAD_NEAR)
    far = stats.multivariate_normal(FAR, SPREAD_FAR)
    log_near = np.log(0.3) + near.logpdf(x)
    log_far = np.log(0.7) + far.logpdf(x)
    return np.logaddexp(log_near, log_far) + 7.0


def proposals():
    """Two that lie beside the two parts of the mixture."""
    return [
        Student(NEAR + 0.5, np.eye(2)),
        Student(FAR - 0.5, np.eye(2)),
    ]


def test_moments_of_a_mixture():
    rng = np.random.default_rng(0)
    x, log_weights, k = importance(mixture, proposals(), rng, 4000.0)
    weights = np.exp(log_weights)
    assert weights.sum() == pytest.approx(1.0)
    assert effective_size(log_weights) >= 4000.0
    assert k < RELIABLE_K
    mean = 0.3 * NEAR + 0.7 * FAR
    square_near = SPREAD_NEAR + np.outer(NEAR, NEAR)
    square_far = SPREAD_FAR + np.outer(FAR, FAR)
    square_of_mean = np.outer(mean, mean)
    covariance = 0.3 * square_near + 0.7 * square_far - square_of_mean
    # Of 4,000 effective draws.
    standard_error = np.sqrt(covariance.max() / 4000.0)
    assert_allclose(weights @ x, mean, atol=4.0 * standard_error)
    square_of_draws = (x * weights[:, None]).T @ x
    assert_allclose(square_of_draws - square_of_mean, covariance, rtol=0.1)
    share_beyond = weights[x[:, 0] > 2.0].sum()
    exact = 0.7 + 0.3 * stats.norm.sf(2.0)
    assert share_beyond == pytest.approx(exact, abs=0.03)


def test_bounds_cost_draws_and_nothing_else():
    def positive_normal(x):
        log_density = -0.5 * np.sum(x**2, axis=1)
        within = np.all(x > 0.0, axis=1)
        return np.where(within, log_density, -np.inf)

    rng = np.random.default_rng(2)
    proposal = [Student(np.zeros(3), np.eye(3))]
    x, log_weights, k = importance(positive_normal, proposal, rng, 2000.0)
    assert np.all(x > 0.0)
    assert k < RELIABLE_K
    means = np.exp(log_weights) @ x
    exact = np.full(3, np.sqrt(2.0 / np.pi))
    assert_allclose(means, exact, atol=0.06)


def pareto_k_of_proposal(width):
    """Of a standard normal density in four dimensions, drawn with another width."""
    z = np.random.default_rng(3).standard_normal((2000, 4))
    x = width * z
    log_density = -0.5 * np.sum(x**2, axis=1)
    log_proposal = -0.5 * np.sum(z**2, axis=1)
    _, k = pareto_smoothed(log_density - log_proposal, 1.0)
    return k


def test_a_bad_proposal_shows():
    # Ten times too narrow: the largest weights have no mean.
    assert pareto_k_of_proposal(0.1) > RELIABLE_K
    # A good one.
    assert pareto_k_of_proposal(1.2) < 0.3


def test_a_mixture_follows_a_bent_distribution():
    rng = np.random.default_rng(6)
    x = rng.standard_normal((8000, 2)) * [1.0, 0.2]
    x[:, 1] += x[:, 0] ** 2
    x *= 1e3
    shares, students = zip(*fit_mixture(x, rng), strict=True)
    first, second = x.T
    log_first = stats.norm.logpdf(first, scale=1e3)
    log_second = stats.norm.logpdf(second, first**2 / 1e3, 200.0)
    truth = log_first + log_second
    by_single = fit_student(x).log_density(x)
    densities = [np.exp(student.log_density(x)) for student in students]
    by_mixture = np.log(np.array(shares) @ np.array(densities))
    loss_of_mixture = np.mean(truth - by_mixture)
    loss_of_single = np.mean(truth - by_single)
    assert sum(shares) == pytest.approx(1.0)
    assert 0.0 < loss_of_mixture < 0.3 * loss_of_single
    three_on_line = x[:3] * [1.0, 0.0]
    assert fit_mixture(three_on_line, rng) == []


def test_a_density_that_no_proposal_meets():
    def nowhere(x):
        return np.full(len(x), -np.inf)

    rng = np.random.default_rng(4)
    proposal = [Student(np.zeros(2), np.eye(2))]
    x, log_weights, k = importance(nowhere, proposal, rng, 1000.0)
    assert not len(x)
    assert not len(log_weights)
    assert k == np.inf


def test_smoothing():
    rng = np.random.default_rng(5)
    # Ratios with a Pareto tail of shape 0.5 have k 0.5 but for chance.
    heavy = -0.5 * np.log(rng.uniform(size=20_000))
    weights, k = pareto_smoothed(heavy, 1.0)
    assert k == pytest.approx(0.5, abs=0.15)
    assert np.exp(weights).sum() == pytest.approx(1.0)
    raw_weights = heavy - np.logaddexp.reduce(heavy)
    assert weights.max() < raw_weights.max() + 0.5
    # Order is kept; shape of the body too.
    body = np.argsort(heavy)[:15_000]
    steps = np.diff(heavy[body])
    assert_allclose(np.diff(weights[body]), steps, atol=1e-9)
    weights, k = pareto_smoothed(np.full(50, 3.0), 1.0)
    assert k == -np.inf
    assert np.allclose(weights, -np.log(50.0))
    _, k_of_three = pareto_smoothed(np.array([0.0, 1.0, 2.0]), 1.0)
    assert k_of_three == np.inf
    # Walkers that sat there: the largest is outside by chance.
    _, k_of_two_values = pareto_smoothed(np.repeat([0.0, 1.0], 500), 1.0)
    assert k_of_two_values == np.inf
    # All but a few ratios are zero to rounding.
    far_apart = np.append(np.linspace(-3000.0, -2000.0, 500), [-1.0, 0.0])
    assert pareto_smoothed(far_apart, 1.0)[1] == np.inf


def test_a_student_distribution():
    factor = np.linalg.cholesky(SPREAD_NEAR)
    ours = Student(NEAR, factor, 6.0)
    scipys = stats.multivariate_t(NEAR, SPREAD_NEAR, df=6.0)
    x = ours.draw(np.random.default_rng(6), 20_000)
    few = x[:50]
    assert_allclose(ours.log_density(few), scipys.logpdf(few), rtol=1e-10)
    covariance = SPREAD_NEAR * 6.0 / 4.0
    assert_allclose(np.cov(x.T), covariance, rtol=0.08)
    refitted = fit_student(x)
    assert_allclose(refitted.centre, NEAR, atol=0.05)
    scale = refitted.factor @ refitted.factor.T
    assert_allclose(scale, 1.1 * covariance, rtol=0.08)
    # Weights that rest on one draw are flattened until there are enough.
    on_first = -50.0 - np.arange(len(x)) * 1e-3
    on_first[0] = 0.0
    assert fit_student(x, on_first) is not None
    # Draws on a line span nothing.
    first = x[:, 0]
    on_line = np.column_stack([first, 2.0 * first])
    assert fit_student(on_line) is None
