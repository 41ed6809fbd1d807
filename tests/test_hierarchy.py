"""Centre and spread between groups, against integrals by scipy and simulated populations."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import binom, lognorm, norm
from scipy.stats import t as student
from support.fit_by_hand import fit_by_hand, table_of

from fitball.base.priors import ParameterSpec, parse_prior
from fitball.uses.groups import group_near, group_of, is_log, spread_prior
from fitball.uses.hierarchy import (
    DRAWS_OF_EACH,
    Group,
    Hierarchy,
    drawn_group,
    hierarchy,
    measured_group,
)

# Eight schools (Rubin 1981, J. Educ. Stat. 6, 377): effects of coaching and their standard errors.
SCHOOLS = [
    (28.0, 15.0),
    (8.0, 10.0),
    (-3.0, 16.0),
    (7.0, 11.0),
    (-1.0, 9.0),
    (1.0, 11.0),
    (18.0, 10.0),
    (12.0, 18.0),
]
EFFECTS, ERRORS = np.transpose(SCHOOLS)


def half_t(scale):
    text = f"half-t({scale}, 4)"
    spec = ParameterSpec("spread", "", 0.0, np.inf, text, "", "")
    return parse_prior(spec)


def normal_quantiles(count):
    """Evenly likely values of a standard normal distribution."""
    return norm.ppf((np.arange(count) + 0.5) / count)


def test_populations_within_ends_are_truncated():
    """Centre and groups near an end: quantiles of the draws between the ends, and none beyond."""
    groups = [measured_group(value, 0.05) for value in (0.9, 0.97, 0.93)]
    rng = np.random.default_rng(3)
    free = hierarchy(groups, half_t(0.05), rng)
    kept = free.within(0.0, 1.0, rng)
    for name in ("centre", "new", "each"):
        before, after = getattr(free, name), getattr(kept, name)
        assert before.max() > 1.0
        assert after.shape == before.shape
        assert after.max() <= 1.0
    inside = free.new[(free.new >= 0.0) & (free.new <= 1.0)]
    assert np.quantile(kept.new, (0.1, 0.5, 0.9)) == pytest.approx(
        np.quantile(inside, (0.1, 0.5, 0.9)), abs=0.01
    )
    # Groups that all lie beyond an end are not moved.
    assert free.within(2.0, 3.0, rng) is free


def test_centre_spread_and_groups_are_those_of_an_integral():
    """Given tau the centre is normal (Gelman et al., Bayesian Data Analysis, sect. 5.4); the rest
    is one integral.
    """

    def centre_at(tau):
        """Weights of the schools, mean and variance of the centre."""
        weight = 1.0 / (tau**2 + ERRORS**2)
        mean = weight @ EFFECTS / weight.sum()
        return weight, mean, 1.0 / weight.sum()

    def density(tau):
        weight, mean, variance = centre_at(tau)
        square = weight @ (EFFECTS - mean) ** 2
        prior = student.pdf(tau / 10.0, 4)
        likelihood = np.sqrt(variance * np.prod(weight)) * np.exp(-0.5 * square)
        return prior * likelihood

    def integral(function):
        return quad(function, 0.0, 400.0, limit=300)[0]

    def mean_of(function):
        weighted = integral(lambda tau: density(tau) * function(tau))
        return weighted / integral(density)

    def centre_mean(tau):
        _, mean, _ = centre_at(tau)
        return mean

    def centre_square(tau):
        _, mean, variance = centre_at(tau)
        return variance + mean**2

    rng = np.random.default_rng(1)
    schools = list(map(measured_group, EFFECTS, ERRORS))
    result = hierarchy(schools, half_t(10.0), rng)
    tau = mean_of(lambda tau: tau)
    tau_square = mean_of(np.square)
    tau_sd = np.sqrt(tau_square - tau**2)
    centre = mean_of(centre_mean)
    centre_variance = mean_of(centre_square) - centre**2
    centre_sd = np.sqrt(centre_variance)
    # Of 4,000 draws a mean errs by 0.016 sd, an sd by at most 0.05 of itself where tails are heavy.
    assert result.spread.mean() == pytest.approx(tau, abs=0.07 * tau_sd)
    assert result.spread.std() == pytest.approx(tau_sd, rel=0.12)
    assert result.centre.mean() == pytest.approx(centre, abs=0.07 * centre_sd)
    assert result.centre.std() == pytest.approx(centre_sd, rel=0.07)
    assert result.new.var() == pytest.approx(centre_variance + tau_square, rel=0.15)
    # A group given the others lies between its own value and the centre.
    spread = result.spread[:DRAWS_OF_EACH]
    centres = result.centre[:DRAWS_OF_EACH]
    variances = ERRORS[:, None] ** 2
    share = spread**2 / (spread**2 + variances)
    exact = centres + share * (EFFECTS[:, None] - centres)
    means = result.each.mean(axis=1)
    assert means == pytest.approx(exact.mean(axis=1), abs=1.2)
    assert result.each.shape == (8, DRAWS_OF_EACH)
    assert np.all(result.pareto_k == -np.inf)


@pytest.mark.parametrize(
    ("spread", "errors"),
    [
        (1.0, 1e-3),
        (1e-3, 1.0),
    ],
)
def test_spreads_far_from_the_errors_are_found(spread, errors):
    rng = np.random.default_rng(2)
    values = spread * normal_quantiles(40)
    groups = [measured_group(value, errors) for value in values]
    result = hierarchy(groups, half_t(1.0), rng)
    low, middle, high = np.quantile(result.spread, (0.025, 0.5, 0.975))
    if spread > errors:
        # Of 40 values an sd is known to 11 %.
        assert middle == pytest.approx(1.0, abs=0.1)
        assert 0.35 < high - low < 0.6
    else:
        assert low < 0.03
        assert high < 0.4


def test_an_interim_prior_is_divided_out():
    """A normal posterior under a normal prior, over that prior, is the measurement again."""
    rng = np.random.default_rng(3)
    values = np.array([0.52, 0.6, 0.66, 0.71, 0.55, 0.63])
    error = 0.03
    prior = norm(0.45, 0.06)
    variance = 1.0 / (1.0 / error**2 + 1.0 / 0.06**2)
    sd = np.sqrt(variance)
    groups = []
    with_prior = []
    for value in values:
        mean = variance * (value / error**2 + 0.45 / 0.06**2)
        draws = rng.permutation(mean + sd * normal_quantiles(4000))
        group = drawn_group(draws, prior.logpdf)
        # Places with their width have the variance of the draws, one in ten of which count.
        group_sd = np.hypot(group.places.std(), group.width)
        assert group_sd == pytest.approx(draws[::10].std(), rel=1e-9)
        groups.append(group)
        with_prior.append(group._replace(interim=np.zeros_like(group.interim)))
    measurements = [measured_group(value, error) for value in values]
    exact = hierarchy(measurements, half_t(0.2), rng)
    divided = hierarchy(groups, half_t(0.2), rng)
    control = hierarchy(with_prior, half_t(0.2), rng)
    width = exact.centre.std()
    centre = exact.centre.mean()
    spread = exact.spread.mean()
    assert divided.centre.mean() == pytest.approx(centre, abs=0.3 * width)
    assert divided.spread.mean() == pytest.approx(spread, rel=0.2)
    assert centre - control.centre.mean() > 0.5 * width
    assert np.all(divided.pareto_k < 0.7)


def test_intervals_hold_their_truth_and_with_the_priors_left_in_they_do_not():
    """Skewed posteriors of eight tables under a prior beside the population. `scripts/validation`
    has 200.
    """
    rng = np.random.default_rng(4)
    count = 30
    centre = 0.62
    spread = 0.05
    prior = norm(0.35, 0.09)

    def group_about(truth):
        sd = rng.uniform(0.02, 0.06)
        skewed = rng.gamma(6.0, size=4001)
        error, *others = (skewed - 6.0) / np.sqrt(6.0)
        draws = truth - sd * error + sd * np.array(others)
        weight = prior.pdf(draws)
        probability = weight / weight.sum()
        of_posterior = rng.choice(draws, 400, p=probability)
        return drawn_group(of_posterior, prior.logpdf)

    missed = np.zeros((2, 3), int)
    for _ in range(count):
        truths = centre + spread * rng.standard_normal(8)
        groups = [group_about(truth) for truth in truths]
        with_prior = []
        for group in groups:
            undivided = np.zeros(len(group.places))
            with_prior.append(Group(group.places, group.width, undivided))
        for k, study in enumerate((groups, with_prior)):
            result = hierarchy(study, half_t(0.1), rng)
            new = centre + spread * rng.standard_normal()
            for j, true in enumerate((centre, spread, new)):
                low, high = np.quantile(result[j], (0.025, 0.975))
                missed[k, j] += not low <= true <= high
    # One of a thousand studies misses more often than this.
    most = binom.ppf(0.999, count, 0.05)
    assert np.all(missed[0] <= most), missed
    assert missed[1, 0] > most, missed


def test_groups_of_a_fit_have_the_density_of_their_prior():
    fit = fit_by_hand(table_of(24, ("clay", "hard")), prior={"e_x": "uniform(-1, 1)"})
    for quantity in fit.reported:
        # Whatever the verdict: one that depends on the value would choose by it.
        assert group_of(fit, quantity.name) is not None, quantity.name
    assert {quantity.verdict for quantity in fit.reported} >= {"one-sided", "prior-dominated"}
    assert group_of(fit, "no_such") is None
    held = fit_by_hand(fix={"e_x": 0.1})
    assert group_of(held, "e_x") is None
    assert group_of(held, "mu") is not None
    assert group_of(fit_by_hand(sampled=False), "mu") is None
    plain = fit_by_hand(prior={"e_x": "lognormal(0.2, 0.5)", "mu": "normal(0.6, 0.3)"})
    assert is_log(fit.quantity("mu[clay]").spec)
    assert not is_log(fit.quantity("cor_slope").spec)

    def density_of_log_mu(x):
        return norm(0.6, 0.3).logpdf(np.exp(x)) + x

    density_of_e_x = lognorm(0.5, scale=0.2).logpdf
    draws = plain.draws.values
    for name, places, density in (
        ("mu", np.log(draws["mu"]), density_of_log_mu),
        ("e_x", draws["e_x"], density_of_e_x),
    ):
        group = group_of(plain, name)
        mean = places.mean()
        sd = places.std()
        group_sd = np.hypot(group.places.std(), group.width)
        assert group.places.mean() == pytest.approx(mean, abs=0.2 * sd)
        assert group_sd == pytest.approx(sd, rel=0.2)
        # Bounds cut a little off both.
        assert np.ptp(group.interim - density(group.places)) < 1e-12


def test_a_fit_is_drawn_anew_near_the_population():
    """Drops of a constant restitution: its likelihood is one integral, over the noise."""
    drops = table_of(9, drop=True)
    options = {"cor_slope": 0.0}
    fit = fit_by_hand(drops, model="brody", fix=options, prior={"cor_10": "normal(0.5, 0.1)"})
    noise = {parameter.spec.name: parameter.prior for parameter in fit.problem.parameters}["v_y_sd"]
    v_y1 = drops["v_y1"].to_numpy()
    v_y2 = drops["v_y2"].to_numpy()

    def likelihood(cor):
        def at(log_sd):
            z = (v_y2 - cor * v_y1) / np.exp(log_sd)
            prior = noise.log_density(noise.coordinate(np.exp(log_sd)))
            return np.exp(prior - 0.5 * z @ z - 9.0 * log_sd)

        return quad(at, -5.0, 3.0, limit=200)[0]

    # Where the posterior has all but none of its draws.
    new = 0.45 + 0.01 * normal_quantiles(500)
    population = Hierarchy(new, new, new, np.empty((0, 0)), np.empty(0))
    group = group_near(fit, "cor_10", population, np.random.default_rng(5))
    at = np.linspace(0.25, 0.85, 301)
    interim = norm(0.5, 0.1).logpdf(at) + norm(new.mean(), 2.0 * new.std()).logpdf(at)
    density = np.array([likelihood(cor) for cor in at]) * np.exp(interim)
    density /= density.sum()
    mean = density @ at
    sd = np.sqrt(density @ (at - mean) ** 2)
    posterior = density / np.exp(norm(new.mean(), 2.0 * new.std()).logpdf(at))
    assert posterior @ at / posterior.sum() > mean + 2.0 * sd
    assert group.places.mean() == pytest.approx(mean, abs=0.25 * sd)
    assert np.hypot(group.places.std(), group.width) == pytest.approx(sd, rel=0.15)
    divided = norm(0.5, 0.1).logpdf(group.places)
    divided += norm(new.mean(), 2.0 * new.std()).logpdf(group.places)
    assert np.ptp(group.interim - divided) < 1e-9


def test_the_spread_between_tables_is_expected_as_between_levels():
    fit = fit_by_hand()
    assert spread_prior(fit, "mu").width == pytest.approx(0.3, rel=1e-6)
    # A share of the median, 0.75, of 4,000 prior draws.
    assert spread_prior(fit, "cor_10").width == pytest.approx(0.3 * 0.75, rel=0.02)
    # About zero the width of the prior.
    assert spread_prior(fit, "e_x").width == pytest.approx(0.4, rel=0.15)
