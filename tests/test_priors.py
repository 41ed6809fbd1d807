"""Priors against scipy's densities, and every way of writing one wrong."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import integrate, special, stats

from fitball.base.errors import ParameterError
from fitball.base.prior_families import FAMILIES
from fitball.base.priors import ParameterSpec, parse_prior, usual_value


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


class Cut:
    """What is left of a law between two ends of its coordinate, by its own shares."""

    def __init__(self, law, low, high):
        self.law = law
        self.low = law.cdf(low)
        self.mass = law.cdf(high) - law.cdf(low)

    def ppf(self, level):
        return self.law.ppf(self.low + level * self.mass)

    def logpdf(self, x):
        return self.law.logpdf(x) - np.log(self.mass)


class Logit:
    """The law of the logit of a value between zero and one."""

    def __init__(self, law):
        self.law = law

    def cdf(self, x):
        return self.law.cdf(special.expit(x))

    def ppf(self, level):
        return special.logit(self.law.ppf(level))

    def logpdf(self, x):
        share = special.expit(x)
        return self.law.logpdf(share) + np.log(share) + np.log1p(-share)


def beta(a, b, low=0.0, high=1.0):
    return Cut(Logit(stats.beta(a, b)), *special.logit([low, high]))


def gamma(shape, scale, low, high):
    # The logarithm of a gamma variable.
    return Cut(stats.loggamma(shape, np.log(scale)), low, high)


LN = np.log
# Text, bounds, and the law of the coordinate by scipy. A family is tested by a row of it.
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
    ("gamma(9, 0.07)", 0.0, 5.0, gamma(9.0, 0.07, -np.inf, LN(5.0))),
    ("gamma(0.5, 2)", -1.0, 5.0, gamma(0.5, 2.0, -np.inf, LN(5.0))),
    ("gamma(3, 1e-3)", 2e-3, 4e-3, gamma(3.0, 1e-3, LN(2e-3), LN(4e-3))),
    ("gamma(1e6, 1e-6)", 0.0, 5.0, gamma(1e6, 1e-6, -np.inf, LN(5.0))),
    ("beta(30, 10)", -1.0, 5.0, beta(30.0, 10.0)),
    ("beta(0.5, 0.5)", 0.0, 1.0, beta(0.5, 0.5)),
    ("beta(2, 5)", 0.1, 0.4, beta(2.0, 5.0, 0.1, 0.4)),
    ("beta(1e6, 3e5)", 0.0, 1.0, beta(1e6, 3e5)),
    # What a prior must leave, far in a tail and in a narrow window.
    ("normal(0, 1)", 4.6, 9.0, Tail(stats.norm(0.0, 1.0), 4.6, 9.0)),
    ("normal(9, 1)", 0.0, 4.4, normal(0.0, 4.4, 9.0, 1.0)),
    ("normal(0.5, 4e4)", 0.0, 1.0, stats.uniform(0.0, 1.0)),
    ("gamma(9, 0.07)", 0.0, 0.13, gamma(9.0, 0.07, -np.inf, LN(0.13))),
    ("beta(30, 10)", 0.0, 0.45, beta(30.0, 10.0, 0.0, 0.45)),
]
# The value at a coordinate, where it is not the coordinate itself.
VALUES = {
    "lognormal": np.exp,
    "loguniform": np.exp,
    "gamma": np.exp,
    "beta": special.expit,
}
SHARES = np.array([1e-6, 0.01, 0.3, 0.5, 0.9, 0.999])
every_family = pytest.mark.parametrize(
    ("text", "lower", "upper", "law"),
    CASES,
    ids=[f"{text} of {lower:g} to {upper:g}" for text, lower, upper, _ in CASES],
)


def pull_of(prior, q):
    """Slope and curvature (n,) at coordinates (n,)."""
    slope, curvature = prior.pull(q[:, None], *np.array(prior.constants)[:, None])
    return slope[:, 0], curvature[:, 0]


def test_each_family_has_a_row():
    assert {text.partition("(")[0] for text, *_ in CASES} == {*FAMILIES}


@every_family
def test_density_and_quantiles_agree_with_scipy(text, lower, upper, law):
    prior = prior_of(text, lower, upper)
    coordinates = law.ppf(SHARES)
    assert_allclose(
        prior.coordinate(prior.quantile(SHARES)),
        coordinates,
        rtol=1e-8,
        atol=1e-9,
    )
    assert_allclose(
        prior.log_density(coordinates),
        law.logpdf(coordinates),
        rtol=1e-9,
        atol=2e-9,
    )


@every_family
def test_coordinates_values_and_their_stretch_belong_together(text, lower, upper, law):
    prior = prior_of(text, lower, upper)
    value = VALUES.get(text.partition("(")[0], lambda q: q)
    q = law.ppf(SHARES)
    step = 1e-6 * prior.width
    assert_allclose(prior.value(q), value(q))
    assert_allclose(prior.coordinate(value(q)), q, rtol=1e-10, atol=1e-9)
    rates = (value(q + step) - value(q - step)) / (2.0 * step)
    assert_allclose(prior.stretch(value(q)), rates, rtol=1e-5)


@every_family
def test_all_of_a_density_lies_between_its_bounds(text, lower, upper, law):
    prior = prior_of(text, lower, upper)
    ends = prior.coordinate(prior.quantile(np.array([0.01, 0.99])))
    mass, _ = integrate.quad(lambda x: np.exp(prior.log_density(np.array([x]))[0]), *ends)
    assert mass == pytest.approx(0.98, abs=1e-7)
    beyond = np.array([prior.lower - 1e-9, prior.upper + 1e-9])
    outside = prior.log_density(beyond[np.isfinite(beyond)])
    assert_array_equal(outside, -np.inf)
    within = prior.coordinate(prior.quantile(np.array([0.001, 1.0 - 1e-6])))
    assert np.all(np.isfinite(prior.log_density(within)))
    values = prior.quantile(np.array([0.0, 1.0]))
    assert np.all((values >= lower) & (values <= upper * (1.0 + 1e-15)))


@every_family
def test_slope_and_curvature_are_derivatives_of_scipys_density(text, lower, upper, law):
    prior = prior_of(text, lower, upper)
    q = law.ppf(np.array([0.01, 0.1, 0.3, 0.5, 0.9, 0.99]))
    slope, curvature = pull_of(prior, q)

    def below(at):
        return -law.logpdf(at)

    scale = np.ptp(law.ppf(np.array([0.1, 0.9])))
    step = 1e-3 * scale
    slopes = (below(q + step) - below(q - step)) / (2.0 * step)
    assert_allclose(scale * slope, scale * slopes, rtol=1e-4, atol=1e-4)
    bends = (below(q + step) - 2.0 * below(q) + below(q - step)) / step**2
    if np.all(scale**2 * bends > -1e-3):
        assert_allclose(scale**2 * curvature, scale**2 * bends, rtol=1e-3, atol=1e-3)
        return
    # Not log-concave: a parabola that touches on both sides of the peak, and nowhere lies lower.
    parabola = below(q) + slope * (q[:, None] - q) + 0.5 * curvature * (q[:, None] - q) ** 2
    assert np.all(parabola > below(q)[:, None] - 1e-9)
    assert_allclose(slope, curvature * (q - prior.location), rtol=1e-12)


@every_family
def test_the_peak_is_the_highest_place(text, lower, upper, law):
    prior = prior_of(text, lower, upper)
    peak = np.array([prior.location])
    assert_allclose(pull_of(prior, peak)[0] * prior.width, 0.0, atol=1e-8)
    constants = np.array(prior.constants)[:, None]
    assert_array_equal(prior.deviance(peak[:, None], *constants), 0.0)
    far = peak[:, None] + prior.width * np.array([[-2.0], [0.1], [40.0], [800.0]])
    assert np.all(prior.deviance(far, *constants) >= (0.0 if prior.flat else 1e-3))


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
        "gamma(2)",
        "gamma(-2, 1)",
        "gamma(2, 0)",
        "gamma(0.4, 1)",
        "gamma(1e7, 1)",
        "gamma(2, 1e-3, 1)",
        "gamma(1e5, 1)",
        "beta(2)",
        "beta(0, 1)",
        "beta(2, -1)",
        "beta(0.4, 3)",
        "beta(3, 1e7)",
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


def test_a_beta_prior_leaves_nothing_where_no_share_may_lie():
    for lower, upper in ((1.0, 5.0), (-2.0, 0.0), (0.999, 5.0)):
        with pytest.raises(ParameterError) as caught:
            prior_of("beta(2, 8)", lower, upper)
        assert caught.value.code == "prior"


def test_draws_of_the_widest_shapes_are_apart_from_their_ends():
    shares = np.random.default_rng(1).uniform(size=4000)
    for text in ("beta(0.5, 0.5)", "gamma(0.5, 1)"):
        prior = prior_of(text, 0.0, 1e9)
        q = prior.coordinate(prior.quantile(shares))
        assert np.all(np.isfinite(q))
        assert np.all(np.isfinite(prior.log_density(q)))


def test_both_ends_of_a_beta_prior_have_their_digits():
    prior = prior_of("beta(0.5, 0.5)", 0.0, 1.0)
    low, high = prior.ppf(np.array([1e-9, 1.0 - 1e-9]))
    # A share of (pi/2 * 1e-9)^2, closer to one than doubles are.
    assert low == pytest.approx(2.0 * np.log(np.pi / 2.0 * 1e-9), rel=1e-9)
    assert high == pytest.approx(-low, rel=1e-6)


def test_draws_of_a_beta_prior_are_finite_where_the_value_rounds_to_one():
    prior = prior_of("beta(1e6, 0.5)", 0.0, 1.0)
    shares = np.concatenate(
        [[1.0 - 1e-5, 1.0 - 1e-9], np.random.default_rng(1).uniform(size=10**6)]
    )
    assert np.any(prior.quantile(shares) == 1.0)
    q = prior.coordinate_quantile(shares)
    assert np.all(np.isfinite(prior.log_density(q)))
    # Near its end 1 - x is chi-square with one degree of freedom, over twice the first number.
    exact = -np.log(stats.chi2(1).ppf([1e-5, 1e-9]) / 2e6)
    assert_allclose(q[:2], exact, rtol=1e-6)


@every_family
def test_draws_of_other_families_are_the_coordinates_of_their_values(text, lower, upper, law):
    prior = prior_of(text, lower, upper)
    q = prior.coordinate_quantile(SHARES)
    through_value = prior.coordinate(prior.quantile(SHARES))
    if text.startswith("beta"):
        assert_allclose(q, through_value, rtol=1e-9, atol=1e-12)
    else:
        assert_array_equal(q, through_value)


@pytest.mark.parametrize(
    ("text", "lower", "upper", "low", "high"),
    [
        ("loguniform(1, 1000)", 3.0, 100.0, 3.0, 100.0),
        ("loguniform(0.3, 0.7)", 0.1, 5.0, 0.3, 0.7),
        ("lognormal(0.6, 0.4)", 0.0, 5.0, 0.0, 5.0),
        ("gamma(3, 1e-3)", 2e-3, 4e-3, 2e-3, 4e-3),
        ("beta(2, 5)", 0.1, 0.4, 0.1, 0.4),
        ("half-t(0.2, 4)", -1.0, 0.7, 0.0, 0.7),
        ("uniform(-1, 0.3)", 0.1, 1.0, 0.1, 0.3),
    ],
)
def test_the_whole_of_a_density_lies_within_its_limits(text, lower, upper, low, high):
    prior = prior_of(text, lower, upper)
    assert prior.limits == (low, high)
    ends = prior.quantile(np.array([0.0, 1.0]))
    assert low <= ends[0] < ends[1] <= high
    assert_allclose(ends, (low, high), rtol=4e-16 if text.startswith("log") else 1e-12)


def test_a_page_says_how_each_family_is_written():
    page = (Path(__file__).parent.parent / "docs" / "reference.md").read_text(encoding="utf-8")
    assert [f.form for f in FAMILIES.values() if f"`{f.form}`" not in page] == []


@pytest.mark.parametrize("family", ["lognormal(0.3, 0.5)", "normal(1, 0.1)", "gamma(2, 3)"])
def test_the_usual_value_is_that_at_the_location(family):
    spec = ParameterSpec("x", "m", 0.0, 5.0, family, "x", "x")
    prior = parse_prior(spec)
    assert usual_value(spec) == float(prior.value(np.array(prior.location)))
