"""Ends of 95 % intervals: their Monte Carlo errors, and the digits that these allow."""

from decimal import Decimal

import numpy as np
import pytest
from arviz_stats.base.array import array_stats
from numpy.testing import assert_allclose
from scipy.stats import expon, norm

import fitball
from fitball.base.numbers import FEWEST_DRAWS, Unit, errors_of_ends
from fitball.inference.effort import TARGET_ESS
from fitball.inference.sampling.convergence import Mixing
from fitball.inference.summary import end_errors
from fitball.report import fit_tables, fit_words
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


def places_of(text):
    """How many decimals a printed number has."""
    return len(text.partition(".")[2])


def ends_of(interval):
    """The texts of the ends of a printed interval."""
    return interval.strip("[]").split(", ")


def asymptotic_error(law, share, draws):
    """The sd of a quantile of S draws: sqrt(p (1 - p)/S) over the density there."""
    density = law.pdf(law.ppf(share))
    variance = share * (1.0 - share) / draws
    return np.sqrt(variance) / density


def power_of_ten(rng, low, high, size=None):
    """A number whose logarithm is uniform."""
    return 10.0 ** rng.uniform(low, high, size)


@pytest.mark.parametrize("law", [norm(3.0, 2.0), expon(scale=0.1)])
def test_errors_of_ends_are_those_of_quantiles(law):
    shares = (np.arange(200_000) + 0.5) / 200_000
    draws = law.ppf(shares)
    expected = [asymptotic_error(law, share, 1000.0) for share in (0.025, 0.975)]
    assert_allclose(end_errors(draws, 1000.0), expected, rtol=0.05)
    assert np.isnan(end_errors(np.empty(0), 1000.0)).all()


@pytest.mark.parametrize("factor", [1.0, 1e3])
def test_no_printed_digit_is_finer_than_its_error(factor):
    rng = np.random.default_rng(1)
    unit = Unit("", factor)
    for _ in range(500):
        middle = rng.normal(0.0, 1.0)
        width = power_of_ten(rng, -3.0, 1.0)
        low = middle - width * rng.uniform(0.1, 1.0)
        high = middle + width
        errors = width * power_of_ten(rng, -4.0, -0.5, 2)
        texts = ends_of(unit.interval(low, high, *errors))
        assert float(texts[0]) < float(texts[1])
        # The first digit of the width, without which both ends would be one number.
        power = np.floor(np.log10((high - low) * factor))
        most = max(5.0 * errors.max(), 0.25 * width)
        for text, end, error in zip(texts, (low, high), errors, strict=True):
            if float(text) == 0.0:
                assert abs(end) <= 2.0 * most
                continue
            least = min(error * factor, 10.0**power)
            assert finest(text) >= least * (1.0 - 1e-9)
            # The end is rounded, by no more than five errors, or the digits of the width.
            away = abs(float(text) - end * factor)
            assert away <= 0.5 * finest(text) * (1.0 + 1e-9)
            assert away <= factor * most


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_end_whose_error_is_large_stays_beyond_the_other(sign):
    rng = np.random.default_rng(2)
    for _ in range(300):
        near = power_of_ten(rng, -3.0, 3.0)
        far = near * power_of_ten(rng, 0.7, 3.0)
        error = far * power_of_ten(rng, -1.0, 1.0)
        pairs = sorted([(sign * near, 0.01 * near), (sign * far, error)])
        (first, its_error), (last, last_error) = pairs
        interval = Unit("").interval(first, last, its_error, last_error)
        low, high = map(float, ends_of(interval))
        assert low < high
        if error >= 2.0 * far:
            farthest = max(abs(low), abs(high))
            assert farthest == pytest.approx(far, rel=0.5)


def test_an_end_of_large_error_keeps_a_digit():
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
    law = norm(3.0, 2.0)
    median, low, high = law.ppf([0.5, 0.025, 0.975])
    expected = asymptotic_error(law, 0.025, draws)
    errors = errors_of_ends(median, low, high, draws)
    assert errors == pytest.approx((expected, expected), rel=0.01)


def test_sampling_has_no_fewer_draws_than_digits_expect():
    assert FEWEST_DRAWS <= TARGET_ESS


@pytest.mark.parametrize("draws", [200.0, 1000.0, 4000.0])
def test_a_median_has_no_decimal_less_than_the_ends(draws):
    rng = np.random.default_rng(3)
    for _ in range(200):
        sd = power_of_ten(rng, -3.0, 2.0)
        law = norm(rng.normal(0.0, 3.0) * sd, sd)
        text = Unit("").with_interval(*law.ppf([0.5, 0.025, 0.975]), draws)
        value, interval = text.split(" ", 1)
        error = asymptotic_error(law, 0.025, draws)
        for end in ends_of(interval):
            assert float(end) == 0.0 or finest(end) >= 0.99 * error
            assert places_of(value) >= places_of(end)


def test_a_median_near_to_zero_has_the_digits_that_its_end_needs():
    unit = Unit("")
    wide = (9.5, 12.1)
    narrow = (10.07, 11.42)
    assert unit.with_interval(0.31, 0.0203, 30.0, 1e9) == "0.31 [0.020, 30]"
    assert unit.with_interval(3.12, 0.0203, 30.0, 1e9) == "3 [0.020, 30]"
    # Beside two intervals it has the digits of the narrower one.
    assert unit.median(10.743, narrow, wide) == "10.74"
    assert unit.median(10.743, wide, narrow) == "10.74"
    assert unit.median(10.743, (np.nan, np.nan)) == "10.74"


def test_effective_sizes_of_tails_are_those_of_the_printed_ends():
    rng = np.random.default_rng(2)
    chains = rng.standard_normal((4, 400, 5, 1))
    # What lies outermost stays where it is for long: the ends of a 90 % interval mix well.
    before = chains[:, :-1].copy()
    outermost = np.abs(before) > 2.2
    chains[:, 1:][outermost] = before[outermost]
    by_walker = chains[..., 0].transpose(0, 2, 1).reshape(20, 400)
    axes = {"chain_axis": 0, "draw_axis": 1}
    sizes = [
        array_stats.ess(by_walker, method="quantile", prob=share, **axes)
        for share in (0.025, 0.975)
    ]
    mixing = Mixing(("a",), chains)
    assert mixing.ess_tail["a"] == pytest.approx(min(sizes))


@pytest.fixture(scope="module")
def drop_test():
    return fitball.calibrate("synthetic_drop", cores=1)


def test_intervals_of_a_fit_have_no_digits_that_another_seed_would_change(drop_test):
    shown = 0
    for row in frame_rows(drop_test.summary):
        name = row.text("name")
        unit = unit_of(drop_test, name)
        value, interval = fit_words.shown_texts(drop_test, row, unit)
        if not interval or name not in drop_test.end_errors or value[:1] in "<>":
            continue
        shown += 1
        errors = drop_test.end_errors[name]
        for text, error in zip(ends_of(interval), errors, strict=True):
            assert float(text) == 0.0 or finest(text) >= error * unit.factor
    assert shown >= 3


def test_a_median_has_the_decimals_of_every_interval_beside_it(drop_test):
    shown = 0
    for row in fit_tables.full_table(drop_test).rows:
        for name in ("68 %", "profile, 95 %"):
            interval = str(row[name])
            if row["median"] and interval.startswith("["):
                shown += 1
                most = max(map(places_of, ends_of(interval)))
                assert places_of(str(row["median"])) >= most
    assert shown >= 6
