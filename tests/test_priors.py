"""Priors against scipy's densities, and every way of writing one wrong."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import integrate, stats

from fitball.base.errors import ParameterError
from fitball.base.priors import ParameterSpec, parse_prior


def prior_of(text, lower=0.0, upper=5.0):
    return parse_prior(ParameterSpec("x", "m", lower, upper, "uniform(0, 1)", "x", "x"), text)


class Tail:
    """What is left of a law between two ends above its median; upper shares keep the digits
    there.
    """

    def __init__(self, law, low, high):
        self.law = law
        self.low = low
        self.mass = law.sf(low) - law.sf(high)

    def ppf(self, level):
        return self.law.isf(self.law.sf(self.low) - level * self.mass)

    def logpdf(self, x):
        return self.law.logpdf(x) - np.log(self.mass)


def normal(low, high, centre, sd):
    return stats.truncnorm((low - centre) / sd, (high - centre) / sd, centre, sd)


LN = np.log
# Text, bounds, and the law of the coordinate by scipy.
CASES = [
    ("normal(0.55, 0.05)", 0.0, 5.0, normal(0.0, 5.0, 0.55, 0.05)),
    ("normal(0, 0.005)", -0.033, 0.033, normal(-0.033, 0.033, 0.0, 0.005)),
    ("normal(4, 1)", 0.0, 1.0, normal(0.0, 1.0, 4.0, 1.0)),
    ("normal(-3, 1)", 0.0, 1.0, normal(0.0, 1.0, -3.0, 1.0)),
    ("lognormal(20000, 1)", 100.0, 1e7, normal(LN(100.0), LN(1e7), LN(2e4), 1.0)),
    ("lognormal(0.6, 0.4)", 0.0, 5.0, normal(-np.inf, LN(5.0), LN(0.6), 0.4)),
    ("uniform(0.3, 1)", 0.3, 1.0, stats.uniform(0.3, 0.7)),
    ("uniform(-1, 0.5)", 0.0, 1.0, stats.uniform(0.0, 0.5)),
    ("loguniform(1, 1000)", 0.0, 100.0, stats.uniform(0.0, LN(100.0))),
    ("half-normal(0.3)", -1.0, 5.0, normal(0.0, 5.0, 0.0, 0.3)),
    ("half-t(0.2, 4)", 0.0, 4.0, Tail(stats.t(4.0, 0.0, 0.2), 0.0, 4.0)),
    ("half-t(0.2, 1)", -5.0, 0.5, Tail(stats.t(1.0, 0.0, 0.2), 0.0, 0.5)),
    ("half-t(0.2, 4)", 1.0, 30.0, Tail(stats.t(4.0, 0.0, 0.2), 1.0, 30.0)),
    ("half-t(0.2, 1e11)", 0.0, 4.0, Tail(stats.norm(0.0, 0.2), 0.0, 4.0)),
    # What a prior must leave, far in a tail and in a narrow window.
    ("normal(0, 1)", 4.6, 9.0, Tail(stats.norm(0.0, 1.0), 4.6, 9.0)),
    ("normal(9, 1)", 0.0, 4.4, normal(0.0, 4.4, 9.0, 1.0)),
    ("normal(0.5, 4e4)", 0.0, 1.0, stats.uniform(0.0, 1.0)),
]


@pytest.mark.parametrize(("text", "lower", "upper", "law"), CASES, ids=[case[0] for case in CASES])
def test_density_and_quantiles_agree_with_scipy(text, lower, upper, law):
    prior = prior_of(text, lower, upper)
    shares = np.array([1e-6, 0.01, 0.3, 0.5, 0.9, 0.999])
    coordinates = law.ppf(shares)
    assert_allclose(
        prior.coordinate(prior.quantile(shares)),
        coordinates,
        rtol=1e-8,
        atol=1e-9,
    )
    assert_allclose(
        prior.value(coordinates),
        np.exp(coordinates) if "log" in text else coordinates,
    )
    assert_allclose(
        prior.log_density(coordinates),
        law.logpdf(coordinates),
        rtol=1e-9,
        atol=1e-9,
    )
    ends = prior.coordinate(prior.quantile(np.array([0.01, 0.99])))
    mass, _ = integrate.quad(lambda x: np.exp(prior.log_density(np.array([x]))[0]), *ends)
    assert mass == pytest.approx(0.98, abs=1e-7)
    assert list(prior.log_density(np.array([prior.lower - 1e-9, prior.upper + 1e-9]))) == [
        -np.inf,
        -np.inf,
    ]
    assert np.all(
        np.isfinite(prior.log_density(prior.coordinate(prior.quantile(np.array([0.001, 1.0])))))
    )


@pytest.mark.parametrize(
    "text",
    [
        "gauss(1, 2)",
        "normal 1 2",
        "normal(1)",
        "normal(1, two)",
        "normal(1, -2)",
        "normal(1, nan)",
        "normal(1, inf)",
        "uniform(2, 1)",
        "lognormal(-1, 1)",
        "lognormal(1, 1e6)",
        "normal(0.5, 1e-300)",
        "loguniform(0.1, 1e300)",
        "loguniform(0, 1)",
        "normal(50, 1)",
        "uniform(6, 7)",
        "half-t(0.2)",
        "half-normal(0.2, 4)",
        "half-t(-0.2, 4)",
        "half-t(0.2, 0)",
        "half-normal(0)",
        "normal(10, 1)",
        "literature:clay",
    ],
)
def test_a_bad_prior_is_refused(text):
    with pytest.raises(ParameterError) as caught:
        prior_of(text)
    assert caught.value.code == "prior"
    assert text in str(caught.value)


def test_half_priors_have_no_negative_side_and_defaults_are_the_specs():
    assert prior_of("half-normal(0.3)", -1.0, 5.0).lower == 0.0
    assert prior_of("half-t(0.3, 4)", 0.1, 5.0).lower == 0.1
    assert prior_of("").text == "uniform(0, 1)"
    with pytest.raises(ParameterError):
        prior_of("loguniform(0.1, 1)", -2.0, 0.0)
