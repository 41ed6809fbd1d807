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

ENDS = (0.025, 0.16, 0.84, 0.975)


def summary(median, sd=1.0):
    """That of a normal distribution."""
    law = norm(median, sd)
    return Summary(median, median, sd, *law.ppf(ENDS).tolist())


def point(value):
    """That of draws that are all the same."""
    return Summary(value, value, 0.0, value, value, value, value)


def variant(score, error=1.0, **values):
    """A variant with summaries of `values` by name."""
    return Alternative("a=2", "a=1", "", {}, values, score, error, True, "")


def variants(names, score, **values):
    """As many variants as there are names, of different choices."""
    made = []
    for name in names:
        one = variant(score, **values)
        made.append(replace(one, choice=f"{name}=2"))
    return made


@pytest.mark.parametrize("score", [-8.0, -2.0, 0.0, 1.0, 6.0])
@pytest.mark.parametrize("error", [0.3, 2.0, 5.0])
def test_a_weight_is_the_mean_probability_over_the_error_of_a_score(score, error):
    law = norm(score, error)

    def weighted(x):
        return expit(x) * law.pdf(x)

    low = score - 12.0 * error
    high = score + 12.0 * error
    mean, _ = quad(weighted, low, high, points=[0.0], limit=200)
    weight = expit(log_odds(variant(score, error)))
    assert weight == pytest.approx(mean, abs=0.02)


def test_weights_without_a_score_and_beyond_the_range_of_an_exponential():
    assert log_odds(variant(None)) == 0.0
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


def test_a_point_is_inside_or_outside():
    fit = summary(0.7, 0.5)
    assert share_outside(fit, point(0.7)) == 0.0
    assert share_outside(fit, point(9.0)) == 1.0


def test_no_value_rests_on_a_variant_that_is_improbable():
    fit = {"mu": summary(0.0)}
    near = variant(-1.0, mu=summary(2.5))
    assert what_values_rest_on([near], (), fit) == {"mu": ("a=1",)}
    # Its score is uncertain: it is not surely worse, but hardly as good.
    far = variant(-8.0, 4.5, mu=summary(50.0))
    assert what_values_rest_on([far], (), fit) == {}
    # So little weight leaves intervals right in 85 %, wherever it puts the value.
    assert 0.95 * (1.0 - LEAST_WEIGHT) >= 0.85


def test_a_value_that_most_of_the_weight_puts_elsewhere_is_doubted():
    fit = {
        "mu": summary(0.0),
        "e_x": summary(0.0),
    }
    far = {
        "mu": summary(6.0),
        "e_x": summary(0.1),
    }
    assert {*outvoted(variants("abc", 3.0, **far), fit)} == {"mu"}
    assert {*outvoted(variants("abc", 1e4, **far), fit)} == {"mu"}
    # Where scores are the same all variants together have half of the weight.
    assert outvoted(variants("abc", 0.0, **far), fit) == {}
    lower = variant(-0.5, mu=summary(6.0))
    higher = variant(0.5, mu=summary(6.0))
    assert outvoted([lower], fit) == {}
    assert {*outvoted([higher], fit)} == {"mu"}
    # Others that leave the value where it is count, too.
    same = variants("de", 0.5, mu=summary(0.0))
    assert outvoted([higher, *same], fit) == {}


def test_a_variant_that_could_not_be_tried_says_nothing():
    failed = replace(variant(None), reason="no answer")
    assert outvoted([failed], {"mu": summary(0.0)}) == {}


# A fit, and values that a variant moves by 1.4 and by 0.9 sds.
FIT = {
    "mu": summary(0.0),
    "e_x": summary(0.0),
}
MOVED = {
    "mu": summary(1.4),
    "e_x": summary(-0.9),
}


def test_a_better_variant_casts_doubt_as_a_pattern_does():
    better = replace(variant(10.0, 4.0, **MOVED), better=True)
    assert {*outvoted([better], FIT)} == {"mu"}
    assert outvoted([variant(3.0, 4.0, **MOVED)], FIT) == {}


def test_a_value_rests_on_a_move_that_may_be_beyond_the_limit():
    near = variant(1.0, mu=summary(1.9), e_x=summary(1.9))
    assert what_values_rest_on([near], (), FIT) == {}
    doubtful = replace(near, unsure={"mu": (1.9, 0.05)})
    assert what_values_rest_on([doubtful], (), FIT) == {"mu": ("a=1",)}
