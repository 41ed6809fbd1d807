"""Weights of variants beside a fit, and values that most of the weight puts elsewhere."""

import pytest
from msgspec.structs import replace
from scipy.integrate import quad
from scipy.special import expit
from scipy.stats import norm

from fitball.inference.judgement.assumptions import what_values_rest_on
from fitball.inference.judgement.weights import (
    LEAST_WEIGHT,
    counts,
    log_odds,
    outvoted,
    share_outside,
)
from fitball.inference.schema import Alternative, Summary


def summary(median, sd=1.0):
    ends = norm(median, sd).ppf([0.025, 0.16, 0.84, 0.975])
    return Summary(median, median, sd, *ends.tolist())


def variant(score, error=1.0, choice="a=2", reason="", better=False, **values):
    return Alternative(choice, "a=1", "", {}, values, score, error, True, reason, better)


@pytest.mark.parametrize("score", [-8.0, -2.0, 0.0, 1.0, 6.0])
@pytest.mark.parametrize("error", [0.3, 2.0, 5.0])
def test_a_weight_is_the_mean_probability_over_the_error_of_a_score(score, error):
    law = norm(score, error)
    wide = (score - 12.0 * error, score + 12.0 * error)
    mean, _ = quad(lambda x: expit(x) * law.pdf(x), *wide, points=[0.0], limit=200)
    assert expit(log_odds(variant(score, error))) == pytest.approx(mean, abs=0.02)
    assert log_odds(variant(None)) == 0.0
    # Beyond the range of an exponential.
    assert counts(variant(1e6, 0.1))
    assert not counts(variant(-1e6, 0.1))


@pytest.mark.parametrize("shift", [-5.0, -1.0, 0.0, 2.0, 30.0])
@pytest.mark.parametrize("sd", [0.2, 1.0, 4.0])
def test_the_share_outside_is_that_of_draws(shift, sd):
    fit = summary(0.7, 0.5)
    law = norm(0.7 + 0.5 * shift, 0.5 * sd)
    expected = law.cdf(fit.q025) + law.sf(fit.q975)
    there = summary(float(law.mean()), float(law.std()))
    # The quantile 16 % is 0.994 sds below a median.
    assert share_outside(fit, there) == pytest.approx(expected, abs=4e-3)
    # A point is inside or outside.
    assert share_outside(fit, Summary(*[0.7] * 2, 0.0, *[0.7] * 4)) == 0.0
    assert share_outside(fit, Summary(*[9.0] * 2, 0.0, *[9.0] * 4)) == 1.0


def test_no_value_rests_on_a_variant_that_is_improbable():
    fit = {"mu": summary(0.0)}
    near, far = summary(2.5), summary(50.0)
    assert what_values_rest_on([variant(-1.0, mu=near)], (), fit) == {"mu": ("a=1",)}
    # Its score is uncertain: it is not surely worse, but hardly as good.
    assert what_values_rest_on([variant(-8.0, 4.5, mu=far)], (), fit) == {}
    # So little weight leaves intervals right in 85 %, wherever it puts the value.
    assert 0.95 * (1.0 - LEAST_WEIGHT) >= 0.85


def test_a_value_that_most_of_the_weight_puts_elsewhere_is_doubted():
    fit = {"mu": summary(0.0), "e_x": summary(0.0)}
    far = {"mu": summary(6.0), "e_x": summary(0.1)}
    several = [variant(3.0, choice=f"{name}=2", **far) for name in "abc"]
    assert {*outvoted(several, fit)} == {"mu"}
    # Where scores are the same all variants together have half of the weight.
    equal = [variant(0.0, choice=f"{name}=2", **far) for name in "abc"]
    assert outvoted(equal, fit) == {}
    assert outvoted([variant(-0.5, mu=summary(6.0))], fit) == {}
    assert {*outvoted([variant(0.5, mu=summary(6.0))], fit)} == {"mu"}
    # Others that leave the value where it is count, too.
    same = [variant(0.5, choice=f"{name}=3", mu=summary(0.0)) for name in "de"]
    assert outvoted([variant(0.5, mu=summary(6.0)), *same], fit) == {}
    # What could not be tried says nothing.
    assert outvoted([variant(None, reason="no answer")], fit) == {}
    far_better = [variant(1e4, choice=f"n{k}=2", **far) for k in range(3)]
    assert {*outvoted(far_better, fit)} == {"mu"}


def test_a_better_variant_casts_doubt_as_a_pattern_does():
    fit = {"mu": summary(0.0), "e_x": summary(0.0)}
    moved = {"mu": summary(1.4), "e_x": summary(-0.9)}
    assert {*outvoted([variant(10.0, 4.0, better=True, **moved)], fit)} == {"mu"}
    assert outvoted([variant(3.0, 4.0, **moved)], fit) == {}


def test_a_value_rests_on_a_move_that_may_be_beyond_the_limit():
    fit = {"mu": summary(0.0), "e_x": summary(0.0)}
    near = variant(1.0, mu=summary(1.9), e_x=summary(1.9))
    assert what_values_rest_on([near], (), fit) == {}
    doubtful = replace(near, unsure={"mu": (1.9, 0.05)})
    assert what_values_rest_on([doubtful], (), fit) == {"mu": ("a=1",)}
