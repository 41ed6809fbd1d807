"""Priors against scipy's densities, and every way of writing one wrong."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate, stats

from fitball.errors import ParameterError
from fitball.inference.problem.parameters import NOISE_SPECS, JointPrior, Pull, parse_prior
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
    ("half-normal(0.3)", -1.0, 5.0),
    ("half-t(0.2, 4)", 0.0, 4.0),
    ("half-t(0.2, 1)", -5.0, 0.5),
    ("half-t(0.2, 4)", 1.0, 30.0),
]


class HalfT:
    """Student's t about zero, of which the part between two positive ends is left."""

    def __init__(self, scale, freedom, low, high):
        self.law, self.low, self.high = stats.t(freedom, 0.0, scale), low, high
        self.mass = self.law.sf(low) - self.law.sf(high)

    def ppf(self, level):
        return self.law.isf(self.law.sf(self.low) - level * self.mass)

    def logpdf(self, x):
        return self.law.logpdf(x) - np.log(self.mass)


def reference(text, lower, upper):
    """The same density as a frozen scipy distribution of the coordinate, and its ends."""
    family, numbers = text[:-1].split("(")
    if family.startswith("half"):
        scale, *freedom = (float(item) for item in numbers.split(","))
        lower = max(lower, 0.0)
        law = HalfT(scale, *freedom, lower, upper) if freedom else stats.truncnorm(0.0, upper / scale, 0.0, scale)
        return False, law, lower, upper
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
    residual, rate = prior.residual(coordinates) if prior.bell else (np.zeros(6), None)
    np.testing.assert_allclose(-0.5 * np.diff(residual**2), np.diff(expected.logpdf(coordinates)), atol=1e-8)
    if prior.bell:
        ahead, behind = (prior.residual(coordinates + step)[0] for step in (1e-6 * prior.b, -1e-6 * prior.b))
        np.testing.assert_allclose((ahead - behind) / (2e-6 * prior.b), rate, rtol=1e-6)
    outside = np.array([(high if np.isfinite(high) else 50.0) + 1.0])
    assert prior.log_density(outside)[0] == -np.inf


@pytest.mark.parametrize(("text", "lower", "upper"), CASES)
def test_density_integrates_to_one(text, lower, upper):
    prior = parse_prior("x", text, lower, upper)
    low, high = prior.coordinate(prior.quantile(np.array([1e-9, 1.0 - 1e-9])))
    mass, _ = integrate.quad(lambda x: np.exp(prior.log_density(np.array([x]))[0]), low, high, limit=200)
    assert mass == pytest.approx(1.0, abs=1e-6)


def test_priors_hold_a_surface_by_their_own_density():
    priors = [parse_prior("x", *case) for case in CASES]
    known = Pull.from_priors(priors, [True] * len(priors))
    x = np.array([[prior.coordinate(prior.quantile(level)) for prior in priors] for level in (0.2, 0.6)])
    cost = known.cost(x)
    for k, prior in enumerate(priors):
        assert np.diff(cost[:, k]) == pytest.approx(-np.diff(prior.log_density(x[:, k])), abs=1e-9)
    step = 1e-6 * np.array([prior.width for prior in priors])
    slope = (known.cost(x + step) - known.cost(x - step)) / (2.0 * step)
    np.testing.assert_allclose(known.weight(x) * (x - known.centre), slope, rtol=1e-5, atol=1e-5)
    # The touching normal density lies below: steps that it promises are kept.
    far = x + np.linspace(-3.0, 3.0, 2)[:, None] * step * 1e6
    least = known.cost(x) + 0.5 * known.weight(x) * ((far - known.centre) ** 2 - (x - known.centre) ** 2)
    assert np.all(known.cost(far) <= least + 1e-9)
    assert not np.any(Pull.from_priors(priors, [False] * len(priors)).cost(x))


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
        ("half-t(0.2)", "expected two finite numbers: half-t(scale, degrees of freedom)"),
        ("half-normal(0.2, 4)", "expected one finite number: half-normal(scale)"),
        ("half-t(-0.2, 4)", "expected half-t(scale, degrees of freedom), positive"),
    ],
)
def test_a_bad_prior_is_explained(text, said):
    with pytest.raises(ParameterError, match="prior of mu") as caught:
        parse_prior("mu", text, 0.0, 5.0)
    assert said in str(caught.value)
