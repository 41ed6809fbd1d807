"""A parameter over many tables, held against closed forms and against tables of a known population."""

from __future__ import annotations

import numpy as np
import pytest

from fitball.inference.population.trend import outliers, random_effects


def test_with_equal_errors_centre_and_spread_are_those_of_the_textbook():
    """Equal standard errors: the mean, the sample variance less theirs, Student's interval."""
    y = np.array([0.3, 1.1, -0.4, 2.0, 0.9, 0.1])
    sd = 0.2
    line = random_effects(y, np.full(6, sd))
    variance = np.var(y, ddof=1)
    assert line.coefficients[0] == pytest.approx(np.mean(y))
    assert line.spread == pytest.approx(np.sqrt(variance - sd**2), rel=1e-4)
    # Student's t with five degrees of freedom, from a table.
    assert line.high[0] - line.coefficients[0] == pytest.approx(2.570582 * np.sqrt(variance / 6), rel=1e-4)


def test_tables_that_agree_too_well_have_no_spread_and_no_narrower_interval():
    line = random_effects(np.array([1.0, 1.01, 0.99, 1.0]), np.full(4, 0.5))
    assert line.spread == 0.0
    assert line.high[0] - line.coefficients[0] == pytest.approx(3.182446 * 0.5 / 2.0, rel=1e-5)


def test_a_line_is_that_of_weighted_least_squares_where_nothing_else_scatters():
    x = np.linspace(0.0, 9.0, 10)
    sd = np.linspace(0.1, 0.5, 10)
    y = 2.0 - 0.3 * x + sd * np.array([0.5, -0.4, 0.3, -0.2, 0.1, -0.1, 0.2, -0.3, 0.4, -0.5])
    line = random_effects(y, sd, x)
    slope, constant = np.polyfit(x - x.mean(), y, 1, w=1.0 / sd)
    assert line.spread == 0.0
    assert line.coefficients == pytest.approx([constant, slope])


@pytest.mark.parametrize("along", [None, np.zeros(2)])
def test_of_too_few_tables_nothing_is_said(along):
    assert random_effects(np.array([1.0, 2.0]), np.array([0.1, 0.1]), along) is None


@pytest.fixture(scope="module")
def population():
    """Forty tables 400 times over: centre 1, spread 2, errors of various sizes."""
    rng = np.random.default_rng(7)
    sds = np.exp(rng.normal(0.0, 0.4, (400, 40)))
    return 1.0 + 2.0 * rng.standard_normal((400, 40)) + sds * rng.standard_normal((400, 40)), sds


def test_intervals_of_the_centre_hold_it(population):
    lines = [random_effects(y, sd) for y, sd in zip(*population, strict=True)]
    assert 0.92 < np.mean([line.low[0] < 1.0 < line.high[0] for line in lines]) < 0.98
    assert np.median([line.spread for line in lines]) == pytest.approx(2.0, rel=0.05)
    # What the tables scatter beyond their own errors left out, intervals are too narrow.
    alone = np.sum(population[0] / population[1] ** 2, 1) / np.sum(1.0 / population[1] ** 2, 1)
    reach = 1.96 / np.sqrt(np.sum(1.0 / population[1] ** 2, 1))
    assert np.mean(np.abs(alone - 1.0) < reach) < 0.7


def test_a_level_population_is_seldom_called_a_drift_and_a_steep_one_always(population):
    x = np.linspace(-1.0, 1.0, 40)
    level = [random_effects(y, sd, x).p[1] < 0.05 for y, sd in zip(*population, strict=True)]
    steep = [random_effects(y + 4.0 * x, sd, x).p[1] < 0.05 for y, sd in zip(*population, strict=True)]
    assert np.mean(level) < 0.09
    assert np.mean(steep) > 0.98


def test_one_table_far_off_is_found_and_hides_nothing(population):
    far = population[0].copy()
    far[:, 3] += 40.0
    far[:, 5] += 40.0
    found = [
        np.flatnonzero(np.abs(d) > limit)
        for d, limit in (outliers(y, sd) for y, sd in zip(far, population[1], strict=True))
    ]
    assert np.mean([{3, 5} <= set(one) for one in found]) > 0.99
    false = [np.any(np.abs(d) > limit) for d, limit in (outliers(y, sd) for y, sd in zip(*population, strict=True))]
    assert np.mean(false) < 0.16


def test_a_table_known_much_better_than_the_others_is_no_outlier_for_that(population):
    """All of one value: they scatter by their errors alone, and their median by more than the error of the best."""
    sds = population[1][:, :12].copy()
    sds[:, 3] *= 0.02
    y = sds * np.random.default_rng(5).standard_normal(sds.shape)
    y[200:, 3] += 12.0
    named = [np.any(np.abs(d) > limit) for d, limit in (outliers(*one) for one in zip(y, sds, strict=True))]
    assert np.mean(named[:200]) < 0.1
    assert np.mean(named[200:]) > 0.95


def test_equal_tables_have_no_outlier():
    distance, limit = outliers(np.ones(5), np.zeros(5))
    assert np.all(np.abs(distance) < limit)
