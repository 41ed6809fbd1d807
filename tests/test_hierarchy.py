"""Centre and spread between groups, against integrals by scipy and simulated populations."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import binom, lognorm, norm
from scipy.stats import t as student
from support.made_fit import made_fit, table_of

from fitball.base.priors import ParameterSpec, parse_prior
from fitball.uses.hierarchy import (
    EACH,
    Group,
    drawn_group,
    group_of,
    hierarchy,
    is_log,
    measured,
    spread_prior,
)

# Eight schools (Rubin 1981, J. Educ. Stat. 6, 377): effects of coaching and their standard errors.
EFFECTS = np.array([28.0, 8.0, -3.0, 7.0, -1.0, 1.0, 18.0, 12.0])
ERRORS = np.array([15.0, 10.0, 16.0, 11.0, 9.0, 11.0, 10.0, 18.0])


def half_t(scale):
    return parse_prior(ParameterSpec("spread", "", 0.0, np.inf, f"half-t({scale}, 4)", "", ""))


def test_centre_spread_and_groups_are_those_of_an_integral():
    """Given tau the centre is normal (Gelman et al., Bayesian Data Analysis, sect. 5.4); the rest
    is one integral.
    """

    def given(tau):
        weight = 1.0 / (tau**2 + ERRORS**2)
        mean = weight @ EFFECTS / weight.sum()
        return weight, mean, 1.0 / weight.sum()

    def density(tau):
        weight, mean, variance = given(tau)
        square = weight @ (EFFECTS - mean) ** 2
        return (
            student.pdf(tau / 10.0, 4) * np.sqrt(variance * np.prod(weight)) * np.exp(-0.5 * square)
        )

    def mean_of(function):
        return (
            quad(lambda tau: density(tau) * function(tau), 0.0, 400.0, limit=300)[0]
            / quad(density, 0.0, 400.0)[0]
        )

    found = hierarchy(
        [measured(*one) for one in zip(EFFECTS, ERRORS, strict=True)],
        half_t(10.0),
        np.random.default_rng(1),
    )
    tau, tau_2 = mean_of(lambda tau: tau), mean_of(lambda tau: tau**2)
    centre = mean_of(lambda tau: given(tau)[1])
    centre_2 = mean_of(lambda tau: given(tau)[2] + given(tau)[1] ** 2)
    # Of 4,000 draws a mean errs by 0.016 sd, an sd by at most 0.05 of itself where tails are heavy.
    assert found.spread.mean() == pytest.approx(tau, abs=0.07 * np.sqrt(tau_2 - tau**2))
    assert found.spread.std() == pytest.approx(np.sqrt(tau_2 - tau**2), rel=0.12)
    assert found.centre.mean() == pytest.approx(centre, abs=0.07 * np.sqrt(centre_2 - centre**2))
    assert found.centre.std() == pytest.approx(np.sqrt(centre_2 - centre**2), rel=0.07)
    assert found.new.var() == pytest.approx(centre_2 - centre**2 + tau_2, rel=0.15)
    # A group given the others lies between its own value and the centre.
    share = found.spread[:EACH] ** 2 / (found.spread[:EACH] ** 2 + ERRORS[:, None] ** 2)
    exact = found.centre[:EACH] + share * (EFFECTS[:, None] - found.centre[:EACH])
    assert found.each.mean(axis=1) == pytest.approx(exact.mean(axis=1), abs=1.2)
    assert found.each.shape == (8, EACH)
    assert np.all(found.pareto_k == -np.inf)


@pytest.mark.parametrize(("spread", "errors"), [(1.0, 1e-3), (1e-3, 1.0)])
def test_spreads_far_from_the_errors_are_found(spread, errors):
    rng = np.random.default_rng(2)
    groups = [measured(value, errors) for value in spread * norm.ppf((np.arange(40) + 0.5) / 40)]
    low, middle, high = np.quantile(hierarchy(groups, half_t(1.0), rng).spread, (0.025, 0.5, 0.975))
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
    sd = np.sqrt(1.0 / (1.0 / error**2 + 1.0 / 0.06**2))
    groups = []
    left = []
    for value in values:
        mean = sd**2 * (value / error**2 + 0.45 / 0.06**2)
        drawn = rng.permutation(mean + sd * norm.ppf((np.arange(4000) + 0.5) / 4000))
        groups.append(drawn_group(drawn, prior.logpdf))
        # Places with their width have the variance of the draws, one in ten of which count.
        assert np.hypot(groups[-1].places.std(), groups[-1].width) == pytest.approx(
            drawn[::10].std(),
            rel=1e-9,
        )
        left.append(groups[-1]._replace(interim=np.zeros_like(groups[-1].interim)))
    exact = hierarchy([measured(value, error) for value in values], half_t(0.2), rng)
    divided, control = (hierarchy(one, half_t(0.2), rng) for one in (groups, left))
    width = exact.centre.std()
    assert divided.centre.mean() == pytest.approx(exact.centre.mean(), abs=0.3 * width)
    assert divided.spread.mean() == pytest.approx(exact.spread.mean(), rel=0.2)
    assert exact.centre.mean() - control.centre.mean() > 0.5 * width
    assert np.all(divided.pareto_k < 0.7)


def test_intervals_hold_their_truth_and_with_the_priors_left_in_they_do_not():
    """Skewed posteriors of eight tables under a prior beside the population. `scripts/validation`
    has 200.
    """
    rng = np.random.default_rng(4)
    count = 30
    missed = np.zeros((2, 3), int)
    prior = norm(0.35, 0.09)
    for _ in range(count):
        groups = []
        spread = 0.05
        for truth in 0.62 + spread * rng.standard_normal(8):
            sd = rng.uniform(0.02, 0.06)
            error = (rng.gamma(6.0, size=4001) - 6.0) / np.sqrt(6.0)
            drawn = truth - sd * error[0] + sd * error[1:]
            weight = prior.pdf(drawn)
            groups.append(
                drawn_group(rng.choice(drawn, 400, p=weight / weight.sum()), prior.logpdf)
            )
        left = [Group(one.places, one.width, np.zeros(len(one.places))) for one in groups]
        for k, asked in enumerate((groups, left)):
            found = hierarchy(asked, half_t(0.1), rng)
            new = 0.62 + spread * rng.standard_normal()
            for j, (draws, true) in enumerate(zip(found[:3], (0.62, spread, new), strict=True)):
                low, high = np.quantile(draws, (0.025, 0.975))
                missed[k, j] += not low <= true <= high
    # One of a thousand studies misses more often than this.
    most = binom.ppf(0.999, count, 0.05)
    assert np.all(missed[0] <= most), missed
    assert missed[1, 0] > most, missed


def test_groups_of_a_fit_have_the_density_of_their_prior():
    fit = made_fit(table_of(24, ("clay", "hard")), prior={"e_x": "uniform(-1, 1)"})
    specs = {one.name: fit.quantity(one.name).spec for one in fit.reported}
    determined = [
        one.name for one in fit.reported if one.verdict in ("identified", "given", "conditional")
    ]
    for one in fit.reported:
        assert (group_of(fit, one.name) is not None) == (one.name in determined), one.name
    assert group_of(fit, "no_such") is None
    assert group_of(made_fit(sampled=False), "mu") is None
    plain = made_fit(prior={"e_x": "lognormal(0.2, 0.5)", "mu": "normal(0.6, 0.3)"})
    assert is_log(specs["mu[clay]"])
    assert not is_log(specs["cor_slope"])
    for name, log, density in (
        ("mu", True, lambda x: norm(0.6, 0.3).logpdf(np.exp(x)) + x),
        ("e_x", False, lognorm(0.5, scale=0.2).logpdf),
    ):
        found = group_of(plain, name)
        wanted = plain.draws.values[name]
        places = np.log(wanted) if log else wanted
        assert found.places.mean() == pytest.approx(places.mean(), abs=0.2 * places.std())
        assert np.hypot(found.places.std(), found.width) == pytest.approx(places.std(), rel=0.2)
        # Bounds cut a little off both.
        assert np.ptp(found.interim - density(found.places)) < 1e-12


def test_the_spread_between_tables_is_expected_as_between_levels():
    fit = made_fit()
    assert spread_prior(fit, "mu").scale == pytest.approx(0.3, rel=1e-6)
    # A share of the median, 0.75, of 4,000 prior draws.
    assert spread_prior(fit, "cor_10").scale == pytest.approx(0.3 * 0.75, rel=0.02)
    # About zero the width of the prior.
    assert spread_prior(fit, "e_x").scale == pytest.approx(0.4, rel=0.15)
