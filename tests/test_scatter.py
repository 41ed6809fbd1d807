"""Scatter that is integrated out: its integral by SciPy, its draws, the posterior without it."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.stats import ks_2samp, kstest
from support.line import line_problem

from fitball.base.priors import ParameterSpec, parse_prior
from fitball.inference.density import log_posterior
from fitball.inference.sampling.importance import Student
from fitball.inference.sampling.target import Integrated, Target, target_of
from fitball.inference.scatter import ScatterIntegral


def integral(text, low, high, count):
    spec = ParameterSpec("x", "", low, high, text, "", "x", logarithmic=True)
    return ScatterIntegral(parse_prior(spec), count)


def normal(s, location, width):
    return -0.5 * ((s - location) / width) ** 2 - np.log(width) - 0.5 * np.log(2.0 * np.pi)


def by_quadrature(scatter, log_squares):
    """The log marginal by SciPy, in pieces about the highest place of a fine grid."""
    prior = scatter.prior
    share = quad(
        lambda s: np.exp(normal(s, prior.location, prior.width)),
        prior.lower,
        prior.upper,
        epsabs=0.0,
        epsrel=1e-13,
        limit=500,
        points=[prior.location],
    )[0]

    def joint(s):
        density = normal(s, prior.location, prior.width) - np.log(share)
        likelihood = -scatter.count * (s + 0.5 * np.log(2.0 * np.pi))
        return density + likelihood - 0.5 * np.exp(log_squares - 2.0 * s)

    s = np.linspace(prior.lower, prior.upper, 400_001)
    at = joint(s)
    peak = at.max()
    inside = s[at > peak - 60.0]
    step = s[1] - s[0]
    low = max(inside[0] - 2.0 * step, prior.lower)
    high = min(inside[-1] + 2.0 * step, prior.upper)
    edges = np.linspace(low, high, 41)
    pieces = [
        quad(lambda s: np.exp(joint(s) - peak), *edges[k : k + 2], epsabs=0.0, epsrel=1e-10)[0]
        for k in range(40)
    ]
    return peak + np.log(sum(pieces))


@pytest.mark.parametrize("count", [1, 4, 60, 3000])
@pytest.mark.parametrize(
    ("text", "low", "high"),
    [
        ("lognormal(0.25, 0.7)", 1e-3, 20.0),
        ("lognormal(0.25, 0.1)", 1e-3, 20.0),
        # The likelihood is cut off at either bound.
        ("lognormal(0.25, 0.7)", 0.2, 0.3),
    ],
)
def test_integrals_are_those_by_quadrature(text, low, high, count):
    scatter = integral(text, low, high, count)
    usual = np.log(count * 0.25**2)
    within = np.array([-2.0, -0.3, 0.0, 0.01234, 0.6, 2.0])
    # Beyond the table; of many residuals as large the density has no digits for an integral.
    beyond = np.array([-60.0, 12.0] if count < 100 else [-60.0])
    for shift in (*within, *beyond):
        expected = by_quadrature(scatter, usual + shift)
        found = scatter.log_marginal(np.array([usual + shift]))[0]
        assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)
    nothing = scatter.log_marginal(np.array([-np.inf]))[0]
    assert nothing == pytest.approx(scatter.log_marginal(np.array([-400.0]))[0], rel=1e-9)


@pytest.mark.parametrize("count", [1, 6, 200])
@pytest.mark.parametrize(
    ("text", "low", "high"),
    [
        ("lognormal(0.25, 0.7)", 1e-3, 20.0),
        # Draws beside the bounds are refused.
        ("lognormal(0.25, 0.7)", 0.2, 0.3),
        # Of a narrow prior draws of the likelihood's gamma density are mostly refused.
        ("lognormal(0.25, 0.02)", 1e-3, 20.0),
        ("lognormal(0.25, 3)", 1e-6, 20.0),
    ],
)
def test_draws_have_the_conditional_density(text, low, high, count):
    scatter = integral(text, low, high, count)
    log_squares = math.log(count * 0.3**2)
    drawn = scatter.draw(np.full(4000, log_squares), np.random.default_rng(0))
    s = np.linspace(max(np.log(low), -12.0), min(np.log(high), 3.0), 200_001)
    height = scatter.joint(s, np.array(log_squares))
    density = np.exp(height - height.max())
    cumulative = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    cumulative /= cumulative[-1]
    assert kstest(drawn, lambda x: np.interp(x, s, cumulative)).pvalue > 1e-3
    assert np.log(low) <= drawn.min()
    assert drawn.max() <= np.log(high)


def test_draws_without_any_residual_are_those_of_tiny_ones():
    scatter = integral("lognormal(0.25, 0.7)", 1e-3, 20.0, 6)
    nothing = scatter.draw(np.full(2000, -np.inf), np.random.default_rng(0))
    tiny = scatter.draw(np.full(2000, -60.0), np.random.default_rng(1))
    assert np.isfinite(nothing).all()
    assert ks_2samp(nothing, tiny).pvalue > 1e-3


def test_a_posterior_without_its_scatter_is_the_integral_of_the_whole_one():
    problem = line_problem(noise=None)
    target = target_of(problem)
    assert isinstance(target, Integrated)
    assert target.names == ("slope", "shift")
    kept = [problem.free.index(name) for name in target.names]
    place = problem.free.index("v_x_sd")
    q = np.array([[0.6, 1.0], [0.55, 1.4], [0.7, -1.0]])
    evaluated = target.evaluate(q)
    for coordinates, found in zip(q, evaluated[:, 0], strict=True):
        whole = np.empty((1, 3))
        whole[0, kept] = coordinates

        def density(s, whole=whole, found=found):
            whole[0, place] = s
            return np.exp(log_posterior(problem, whole)[0] - found)

        low, high = problem.prior.low[place], problem.prior.high[place]
        area = sum(
            quad(density, *edges, epsabs=1e-13, limit=200)[0]
            for edges in zip(
                np.linspace(low, high, 21)[:-1], np.linspace(low, high, 21)[1:], strict=True
            )
        )
        assert area == pytest.approx(1.0, abs=1e-9)
    completed, scores = target.complete(q, evaluated, np.random.default_rng(1))
    assert_allclose(completed[:, kept], q)
    assert_allclose(scores, log_posterior(problem, completed), rtol=1e-9)
    outside = target.evaluate(np.array([[np.nan, 0.0], [0.6, np.inf]]))
    assert np.all(outside[:, 0] == -np.inf)


def test_proposals_without_scatter_are_margins():
    problem = line_problem(noise=None)
    target = target_of(problem)
    factor = np.array([[1.0, 0.0, 0.0], [0.4, 0.5, 0.0], [-0.3, 0.2, 0.7]])
    centre = np.array([0.1, 0.2, 0.3])
    (margin,) = target.begin([Student(centre, factor)])
    kept = [problem.free.index(name) for name in target.names]
    covariance = (factor @ factor.T)[np.ix_(kept, kept)]
    assert_allclose(margin.factor @ margin.factor.T, covariance)
    assert np.all(np.diagonal(margin.factor) > 0.0)
    assert_allclose(margin.centre, centre[kept])


@pytest.mark.parametrize(
    "choices",
    [
        {"noise": None, "prior": {"v_x_sd": "uniform(0.01, 1)"}},
        {"noise": 0.2},
    ],
)
def test_what_is_not_integrated(choices):
    target = target_of(line_problem(**choices))
    assert type(target) is Target
