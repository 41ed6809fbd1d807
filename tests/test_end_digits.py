"""Ends of 95 % intervals: their Monte Carlo errors, and the digits that these allow."""

from decimal import Decimal

import numpy as np
import pytest
from arviz_stats.base.array import array_stats
from scipy.stats import expon, norm

import fitball
from fitball.base.numbers import FEWEST_DRAWS, Unit, errors_of_ends
from fitball.inference.effort import TARGET_ESS
from fitball.inference.sampling.convergence import Mixing
from fitball.inference.summary import end_errors
from fitball.report import fit_words
from fitball.report.frame_rows import frame_rows
from fitball.report.quantities import unit_of


def finest(text):
    """The value of the last digit of a printed number; at least that of its last zero before the
    point.
    """
    number = Decimal(text)
    places = -number.as_tuple().exponent
    if places == 0:
        digits = text.strip("-")
        places = len(digits.rstrip("0") or "0") - len(digits)
    return 10.0**-places


@pytest.mark.parametrize("law", [norm(3.0, 2.0), expon(scale=0.1)])
def test_errors_of_ends_are_those_of_quantiles(law):
    """The asymptotic sd of a quantile of S draws is sqrt(p (1 - p)/S) over the density there."""
    draws = law.ppf((np.arange(200_000) + 0.5) / 200_000)
    errors = end_errors(draws, 1000.0)
    for share, error in zip((0.025, 0.975), errors, strict=True):
        expected = np.sqrt(share * (1.0 - share) / 1000.0) / law.pdf(law.ppf(share))
        assert error == pytest.approx(expected, rel=0.05)
    assert np.isnan(end_errors(np.empty(0), 1000.0)).all()


@pytest.mark.parametrize("factor", [1.0, 1e3])
def test_no_printed_digit_is_finer_than_its_error(factor):
    rng = np.random.default_rng(1)
    unit = Unit("", factor)
    for _ in range(500):
        middle, width = rng.normal(0.0, 1.0), 10.0 ** rng.uniform(-3.0, 1.0)
        low, high = middle - width * rng.uniform(0.1, 1.0), middle + width
        errors = width * 10.0 ** rng.uniform(-4.0, -0.5, 2)
        texts = unit.interval(low, high, *errors).strip("[]").split(", ")
        assert float(texts[0]) < float(texts[1])
        for text, end, error in zip(texts, (low, high), errors, strict=True):
            if float(text) == 0.0:
                assert abs(end) <= max(10.0 * errors.max(), 0.5 * width)
                continue
            # Or it is the first of the width, without which both ends would be one number.
            first = 10.0 ** np.floor(np.log10((high - low) * factor))
            assert finest(text) >= min(error * factor, first) * (1.0 - 1e-9)
            # The end is rounded, by no more than five errors, or the digits of the width.
            away = abs(float(text) - end * factor)
            assert away <= 0.5 * finest(text) * (1.0 + 1e-9)
            assert away <= factor * max(5.0 * errors.max(), 0.25 * width)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_end_whose_error_is_large_stays_beyond_the_other(sign):
    rng = np.random.default_rng(2)
    for _ in range(300):
        near = 10.0 ** rng.uniform(-3.0, 3.0)
        far = near * 10.0 ** rng.uniform(0.7, 3.0)
        error = far * 10.0 ** rng.uniform(-1.0, 1.0)
        ends = sorted([sign * near, sign * far])
        errors = (0.01 * near, error) if sign > 0.0 else (error, 0.01 * near)
        texts = Unit("").interval(*ends, *errors).strip("[]").split(", ")
        low, high = map(float, texts)
        assert low < high
        assert max(abs(low), abs(high)) == pytest.approx(far, rel=0.5) or error < 2.0 * far
    assert Unit("", 1e4).interval(1.272e-4, 2.94e-3, 1e-6, 7e-3) == "[1.3, 30]"


def test_without_errors_digits_are_those_of_the_width():
    assert Unit("").interval(0.51649, 0.60751) == "[0.516, 0.608]"
    assert Unit("").interval(0.51649, 0.60751, 0.004, 0.0005) == "[0.52, 0.61]"
    # An end near to zero has digits of its own.
    assert Unit("").interval(15.2, 563.0) == "[15, 560]"
    assert Unit("").interval(15.2, 563.0, 0.8, 40.0) == "[15, 600]"
    assert Unit("").interval(15.2, 563.0, 3.0, 4.0) == "[20, 560]"


@pytest.mark.parametrize("draws", [200.0, 1000.0, 4000.0])
def test_intervals_without_draws_at_hand_have_the_errors_of_a_normal_one(draws):
    """The asymptotic sd of a quantile of S draws is sqrt(p (1 - p)/S) over the density there."""
    law = norm(3.0, 2.0)
    errors = errors_of_ends(*law.ppf([0.5, 0.025, 0.975]), draws)
    expected = np.sqrt(0.025 * 0.975 / draws) / law.pdf(law.ppf(0.025))
    assert errors == pytest.approx((expected, expected), rel=0.01)
    # Sampling ends at no fewer.
    assert FEWEST_DRAWS <= TARGET_ESS
    rng = np.random.default_rng(3)
    for _ in range(200):
        sd = 10.0 ** rng.uniform(-3.0, 2.0)
        middle = rng.normal(0.0, 3.0) * sd
        low, high = middle - 1.96 * sd, middle + 1.96 * sd
        value, interval = Unit("").with_interval(middle, low, high, draws).split(" ", 1)
        for text in interval.strip("[]").split(", "):
            assert finest(text) >= 1.36 * 1.96 * sd / np.sqrt(draws) or float(text) == 0.0
            # A median has no decimal less than the ends.
            assert len(value.partition(".")[2]) >= len(text.partition(".")[2])


def test_a_median_near_to_zero_has_the_digits_that_its_end_needs():
    unit = Unit("")
    assert unit.with_interval(0.31, 0.0203, 30.0, 1e9) == "0.31 [0.020, 30]"
    assert unit.with_interval(3.12, 0.0203, 30.0, 1e9) == "3 [0.020, 30]"
    # Beside two intervals it has the digits of the narrower one.
    assert unit.median(10.743, (10.07, 11.42), (9.5, 12.1)) == "10.74"
    assert unit.median(10.743, (9.5, 12.1), (10.07, 11.42)) == "10.74"
    assert unit.median(10.743, (np.nan, np.nan)) == "10.74"


def test_effective_sizes_of_tails_are_those_of_the_printed_ends():
    rng = np.random.default_rng(2)
    chains = rng.standard_normal((4, 400, 5, 1))
    # What lies outermost stays where it is for long: the ends of a 90 % interval mix well.
    outermost = np.abs(chains) > 2.2
    chains[:, 1:][outermost[:, :-1]] = chains[:, :-1][outermost[:, :-1]]
    by_walker = chains[..., 0].transpose(0, 2, 1).reshape(20, 400)
    sizes = [
        array_stats.ess(by_walker, chain_axis=0, draw_axis=1, method="quantile", prob=share)
        for share in (0.025, 0.975)
    ]
    assert Mixing(("a",), chains).ess_tail["a"] == pytest.approx(min(sizes))


def test_intervals_of_a_fit_have_no_digits_that_another_seed_would_change():
    fit = fitball.calibrate("synthetic_drop", cores=1)
    shown = 0
    for row in frame_rows(fit.summary):
        name = row.text("name")
        unit = unit_of(fit, name)
        value, interval = fit_words.shown_texts(fit, row, unit)
        if not interval or name not in fit.end_errors or value[:1] in "<>":
            continue
        shown += 1
        for text, error in zip(interval.strip("[]").split(", "), fit.end_errors[name], strict=True):
            assert finest(text) >= error * unit.factor or float(text) == 0.0
    assert shown >= 3
