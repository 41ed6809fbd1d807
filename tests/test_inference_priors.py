"""Priors against scipy's densities, and every way of writing one wrong."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate, stats

from fitball.errors import ParameterError
from fitball.inference.problem.parameters import NOISE_SPECS, JointPrior, parse_prior
from fitball.models.specs import SPECS

CASES = [
    ("normal(0.55, 0.05)", 0.0, 5.0),
    ("normal(0, 0.005)", -0.033, 0.033),
    ("normal(4, 1)", 0.0, 1.0),
    ("normal(-6, 1)", 0.0, 1.0),
    ("lognormal(20000, 1)", 100.0, 1e7),
    ("lognormal(0.6, 0.4)", 0.0, 5.0),
    ("uniform(0.3, 1)", 0.3, 1.0),
    ("uniform(-1, 0.5)", 0.0, 1.0),
    ("loguniform(1, 1000)", 0.0, 100.0),
]


def reference(text, lower, upper):
    """The same density as a frozen scipy distribution of the coordinate, and its ends."""
    family, numbers = text[:-1].split("(")
    a, b = (float(item) for item in numbers.split(","))
    log = family.startswith("log")
    ends = (np.log(lower) if lower > 0 else -np.inf, np.log(upper)) if log else (lower, upper)
    if family.endswith("uniform"):
        low, high = (np.log(a), np.log(b)) if log else (a, b)
        low, high = max(low, ends[0]), min(high, ends[1])
        return log, stats.uniform(low, high - low), low, high
    centre = np.log(a) if log else a
    return log, stats.truncnorm((ends[0] - centre) / b, (ends[1] - centre) / b, centre, b), *ends


@pytest.mark.parametrize(("text", "lower", "upper"), CASES)
def test_density_and_quantiles_agree_with_scipy(text, lower, upper):
    prior = parse_prior("x", text, lower, upper)
    log, expected, _low, high = reference(text, lower, upper)
    levels = np.array([1e-6, 0.01, 0.3, 0.5, 0.9, 0.999])
    coordinates = expected.ppf(levels)
    found = prior.quantile(levels)
    np.testing.assert_allclose(np.log(found) if log else found, coordinates, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(prior.log_density(coordinates), expected.logpdf(coordinates), rtol=1e-9, atol=1e-9)
    outside = np.array([(high if np.isfinite(high) else 50.0) + 1.0])
    assert prior.log_density(outside)[0] == -np.inf


@pytest.mark.parametrize(("text", "lower", "upper"), CASES)
def test_density_integrates_to_one(text, lower, upper):
    prior = parse_prior("x", text, lower, upper)
    low, high = prior.coordinate(prior.quantile(np.array([1e-9, 1.0 - 1e-9])))
    mass, _ = integrate.quad(lambda x: np.exp(prior.log_density(np.array([x]))[0]), low, high, limit=200)
    assert mass == pytest.approx(1.0, abs=1e-6)


def test_draws_follow_the_density():
    prior = parse_prior("mu", "normal(0.1, 0.2)", 0.0, 5.0)
    draws = prior.draw(np.random.default_rng(3), 20000)
    _, expected, _, _ = reference("normal(0.1, 0.2)", 0.0, 5.0)
    assert stats.kstest(draws, expected.cdf).pvalue > 1e-3
    # Negative control: a prior with another width is told apart.
    assert stats.kstest(draws, reference("normal(0.1, 0.22)", 0.0, 5.0)[1].cdf).pvalue < 1e-3


def test_joint_density_is_the_sum():
    priors = tuple(parse_prior("x", *case) for case in CASES)
    rng = np.random.default_rng(1)
    values = np.stack([prior.draw(rng, 50) for prior in priors], axis=1)
    joint = JointPrior(priors)
    coordinates = joint.coordinate(values)
    expected = sum(prior.log_density(coordinates[:, k]) for k, prior in enumerate(priors))
    np.testing.assert_allclose(joint.log_density(coordinates), expected, rtol=1e-12)
    np.testing.assert_allclose(joint.value(coordinates), values, rtol=1e-12)


@pytest.mark.parametrize("spec", [*SPECS.values(), *NOISE_SPECS.values()], ids=lambda spec: spec.name)
def test_every_default_prior_can_be_read(spec):
    prior = parse_prior(spec.name, spec.prior, spec.lower, spec.upper)
    assert spec.lower <= prior.quantile(np.array([0.5]))[0] <= spec.upper


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("gauss(1, 2)", "unknown family 'gauss'"),
        ("normall(1, 2)", "did you mean 'normal'"),
        ("normal 1 2", "expected a form such as"),
        ("normal(1)", "two finite numbers"),
        ("normal(1, two)", "expected numbers"),
        ("normal(1, -2)", "sd > 0"),
        ("normal(1, nan)", "two finite numbers"),
        ("uniform(2, 1)", "lower < upper"),
        ("lognormal(-1, 1)", "expected lognormal"),
        ("lognormal(1, 1e6)", "a sd of at most 50"),
        ("normal(0.5, 1e-300)", "1e-100 to 1e+100 in size"),
        ("loguniform(0.1, 1e300)", "1e-100 to 1e+100 in size"),
        ("normal(50, 1)", "no mass within the bounds [0, 5]"),
        ("uniform(6, 7)", "no mass within the bounds [0, 5]"),
    ],
)
def test_a_bad_prior_is_explained(text, said):
    with pytest.raises(ParameterError, match="prior of mu") as caught:
        parse_prior("mu", text, 0.0, 5.0)
    assert said in str(caught.value)
