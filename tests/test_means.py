"""Means of what laboratories measure, weighted by stated errors: against dense linear algebra,
Student's t, and tables of known truth. What is counted in these has limits by its own distribution:
a right rule fails a test by chance once in `FALSE_FAILURES`.
"""

from functools import cache

import numpy as np
import pytest
from made_tables import impact_table
from scipy.optimize import minimize_scalar
from scipy.stats import binom, chi2, t

from fitball.base import air, itf
from fitball.base.priors import ParameterSpec, parse_prior
from fitball.base.values import Ball
from fitball.data.read import load_table
from fitball.data.scene import Scene
from fitball.uses.lab import drop_test, measured_pace
from fitball.uses.means import means

# The chance that a right rule fails a test that counts.
FALSE_FAILURES = 1e-4
# Tables whose intervals are counted.
TABLES = 400
# Values of restitution that the tables have.
TRUTH = 0.75
SPREAD = parse_prior(ParameterSpec("spread", "", 0.0, np.inf, "half-t(0.01, 4)", "", ""))
# Twelve normal impacts of a restitution of 0.75, four of them measured badly.
LABORATORY = """v_y1 [m/s],v_y2 [m/s],v_y2_sd
7.57,5.416,0.5
10.89,8.091,0.03
9.60,7.235,0.03
7.13,5.732,0.5
7.65,5.721,0.03
9.37,7.021,0.03
8.60,6.051,0.5
8.54,6.400,0.03
11.80,8.835,0.03
8.35,5.816,0.5
8.08,6.062,0.03
11.35,8.523,0.03
"""
# Of a restitution: four rows measured badly, eight well.
UNEQUAL = np.array([0.06, 0.004, 0.004] * 4)
# Six values whose errors differ less.
MILD = np.array([0.005, 0.01, 0.02] * 2)
STATED = {"unequal": UNEQUAL, "mild": MILD, "equal": np.full(4, 0.01)}


def mean_of(values, sd=None, group=None, x=None):
    """Means of values with stated errors, on a line in x."""
    count = len(values)
    group = np.zeros(count, np.int64) if group is None else group
    x = np.zeros(count) if x is None else x
    return means(values, group, SPREAD, np.random.default_rng(1), x, sd)


def by_hand(values, sd, x):
    """Level and slope, their covariance, degrees of freedom: weights by the mode of the restricted
    likelihood times the root of the scatter, with dense matrices.
    """
    design = np.column_stack([np.ones(len(values)), x])[:, : 1 + bool(np.ptp(x))]
    freedom = len(values) - design.shape[1]

    def fitted(scatter):
        inverse = np.diag(1.0 / (sd**2 + scatter**2))
        information = design.T @ inverse @ design
        level = np.linalg.solve(information, design.T @ inverse @ values)
        residual = values - design @ level
        return level, information, residual @ inverse @ residual

    def minus_log(log_scatter):
        scatter = np.exp(log_scatter)
        _, information, squares = fitted(scatter)
        variances = np.sum(np.log(sd**2 + scatter**2))
        likelihood = variances + np.linalg.slogdet(information)[1] + squares
        return 0.5 * likelihood - 0.5 * log_scatter

    ends = np.log([1e-2 * sd.min(), 10.0 * values.std()])
    best = minimize_scalar(minus_log, bounds=ends, method="bounded", options={"xatol": 1e-9})
    level, information, squares = fitted(np.exp(best.x))
    return level, np.linalg.inv(information) * squares / freedom, freedom


def tables_of(errors):
    """Tables (tables, values) of one truth with these errors (values,)."""
    rng = np.random.default_rng(12)
    return TRUTH + errors * rng.standard_normal((TABLES, len(errors)))


def intervals_of(tables, sd):
    """Ends (tables, 2) of the 95 % intervals of tables whose errors are stated as `sd`."""
    ends = [np.quantile(mean_of(values, sd).mean, (0.025, 0.975)) for values in tables]
    return np.array(ends)


@cache
def intervals_where_errors_are_stated(name):
    """Ends (tables, 2) of tables whose errors are as stated."""
    sd = STATED[name]
    return intervals_of(tables_of(sd), sd)


def intervals_by_stated_errors(tables, sd):
    """Ends (tables, 2) where stated errors are all: the weighted mean ± 1.96/sqrt(sum of weights),
    which knows no scatter.
    """
    weights = sd**-2.0
    means_of_tables = tables @ weights / weights.sum()
    reach = 1.96 / np.sqrt(weights.sum())
    return np.column_stack([means_of_tables - reach, means_of_tables + reach])


def share_of_true(ends):
    """The share of intervals (tables, 2) that contain the truth."""
    low, high = ends.T
    return np.mean((low <= TRUTH) & (high >= TRUTH))


def least_share(nominal):
    """The share of true intervals below which a rule with that nominal share fails."""
    return binom.ppf(FALSE_FAILURES, TABLES, nominal) / TABLES


@pytest.mark.parametrize("sloped", [False, True])
def test_stated_errors_weigh_a_mean_as_dense_matrices_do(sloped):
    rng = np.random.default_rng(4)
    x = np.linspace(-1.0, 2.0, 12) * sloped
    values = 0.75 + 0.01 * x + UNEQUAL * rng.standard_normal(12)
    level, covariance, freedom = by_hand(values, UNEQUAL, x)
    weighted = mean_of(values, UNEQUAL, x=x)
    assert weighted.point == pytest.approx(level[0], abs=1e-6)
    low, high = t.interval(0.95, freedom, level[0], np.sqrt(covariance[0, 0]))
    width = high - low
    ends = np.quantile(weighted.mean, (0.025, 0.975))
    assert ends == pytest.approx([low, high], abs=0.01 * width)
    # Without weights the bad rows count as much as the good ones.
    plain = mean_of(values, x=x)
    level, covariance, freedom = by_hand(values, np.ones(12), x)
    low, high = t.interval(0.95, freedom, level[0], np.sqrt(covariance[0, 0]))
    assert high - low > 2.0 * width
    assert np.quantile(plain.mean, (0.025, 0.975)) == pytest.approx([low, high], abs=0.01 * width)


def test_equal_stated_errors_are_students():
    values = np.array([0.741, 0.747, 0.738, 0.744, 0.749])
    for sd in (0.001, 0.004, 0.1):
        weighted = mean_of(values, np.full(5, sd))
        plain = mean_of(values)
        assert weighted.point == pytest.approx(plain.point, rel=1e-12)
        assert weighted.mean == pytest.approx(plain.mean, rel=1e-9)
    # Repeats that agree in all digits have the errors that they state.
    same = mean_of(np.full(4, 0.75), np.full(4, 0.01))
    assert np.ptp(np.quantile(same.mean, (0.025, 0.975))) == pytest.approx(3.92 * 0.005, rel=0.01)
    assert mean_of(np.full(4, 0.75)).mean.size == 0


@pytest.mark.parametrize("name", STATED)
def test_intervals_contain_the_truth_in_95_percent(name):
    ends = intervals_where_errors_are_stated(name)
    assert share_of_true(ends) >= least_share(0.95)


@pytest.mark.parametrize("name", ["unequal", "mild"])
def test_weights_make_intervals_nearly_as_short_as_they_can_be(name):
    """In the middle of the tables they are nearer to those of known weights than to those of equal
    ones: both by Student's t, with the median of a mean square.
    """
    sd = STATED[name]
    low, high = intervals_where_errors_are_stated(name).T
    freedom = len(sd) - 1
    middle = 2.0 * t.ppf(0.975, freedom) * np.sqrt(chi2.median(freedom) / freedom)
    known = middle / np.sqrt(np.sum(sd**-2.0))
    equal = middle * np.sqrt(np.mean(sd**2) / len(sd))
    assert np.median(high - low) < np.sqrt(known * equal)


@pytest.mark.parametrize(("sd", "errors"), [(UNEQUAL, 2.0 * UNEQUAL), (MILD, np.hypot(MILD, 0.01))])
def test_intervals_hold_where_errors_are_larger_than_stated(sd, errors):
    """Six values hardly show a scatter as large as their errors: of 10,000 tables 93 % are true.
    Stated errors alone are trusted too far.
    """
    tables = tables_of(errors)
    least = least_share(0.925)
    assert share_of_true(intervals_of(tables, sd)) >= least
    assert share_of_true(intervals_by_stated_errors(tables, sd)) < least


def test_repeats_of_balls_are_weighed_by_stated_errors():
    """Each ball has a bad drop and two good ones: it is as their weighted mean says, drawn to the
    others by less than its error.
    """
    sd = np.array([0.05, 0.002, 0.002] * 5)
    group = np.repeat(np.arange(5), 3)
    truth = np.array([0.74, 0.75, 0.76, 0.745, 0.755])
    bad = np.array([0.06, -0.05, 0.04, -0.06, 0.05])
    good = np.array([[2, -2], [-1, 1], [3, -3], [0, 1], [0, 1]]) * 1e-3
    values = truth[group] + np.column_stack([bad, good]).ravel()
    weighted = mean_of(values, sd, group)
    by_ball = values.reshape(5, 3)
    weights = sd.reshape(5, 3) ** -2.0
    means_of_balls = np.average(by_ball, axis=1, weights=weights)
    error = weights.sum(axis=1)[0] ** -0.5
    assert weighted.each.mean(axis=1) == pytest.approx(means_of_balls, abs=error)
    assert weighted.point == pytest.approx(means_of_balls.mean(), abs=error)
    plain = mean_of(values, group=group)
    assert np.abs(plain.each.mean(axis=1) - means_of_balls).max() > 3.0 * error
    # The noise of repeats that happen to agree is what they state, but for what others add.
    agreeing = truth[group] + np.array([1e-5, -1e-5, 0.0] * 5)
    each = mean_of(agreeing, np.full(15, 0.004), group).each
    stated = 0.004 / np.sqrt(3.0)
    drawn = (stated**-2.0 + truth.var() ** -1.0) ** -0.5
    assert each.std(axis=1).min() > 0.95 * drawn
    assert each.std(axis=1).max() < 1.05 * stated


@pytest.mark.parametrize(("balls", "drops", "within"), [(2, 2, 0.25), (5, 2, 0.1), (6, 5, 0.1)])
def test_balls_that_differ_are_no_better_known_than_their_pooled_noise(balls, drops, within):
    """Where nothing is known of the spread of balls each is as Student's t of the pooled noise
    says, whose degrees of freedom are few.
    """
    rng = np.random.default_rng(6)
    wide = parse_prior(ParameterSpec("spread", "", 0.0, np.inf, "half-t(100, 4)", "", ""))
    group = np.repeat(np.arange(balls), drops)
    noise = rng.standard_normal((balls, drops))
    values = (np.arange(balls)[:, None] * 50.0 + noise).ravel()
    each = means(values, group, wide, rng, np.zeros(len(values))).each
    freedom = balls * (drops - 1)
    levels = values.reshape(balls, drops).mean(axis=1)
    squares = np.sum((values - levels[group]) ** 2)
    error = np.sqrt(squares / freedom / drops)
    away = ((each - levels[:, None]) / error).ravel()
    ends = np.quantile(away, (0.025, 0.975))
    assert 0.5 * np.ptp(ends) == pytest.approx(t.ppf(0.975, freedom), rel=within)


def test_balls_dropped_once_differ_by_more_than_their_errors():
    """Another ball lies about the mean by the spread of balls, without the errors of bad drops. The
    spread is known as well as by the values that show it.
    """
    rng = np.random.default_rng(8)
    spread = 0.01
    sd = np.array([0.002, 0.03] * 20)
    values = TRUTH + np.hypot(sd, spread) * rng.standard_normal(40)
    dropped_once = mean_of(values, sd, np.arange(40))
    shown = (spread**2 / (spread**2 + sd**2)) ** 2
    freedom = shown.sum() - 1.0
    ends = [FALSE_FAILURES / 2.0, 1.0 - FALSE_FAILURES / 2.0]
    low, high = spread * np.sqrt(chi2.ppf(ends, freedom) / freedom)
    assert low < dropped_once.another.std() < high
    plain = mean_of(values, group=np.arange(40))
    assert plain.another.std() > high


def test_a_drop_test_weighs_the_errors_of_its_table(tmp_path):
    """Slower and faster impacts of one restitution lead to the drop from 254 cm by a line."""
    path = tmp_path / "lab_errors.csv"
    path.write_text(LABORATORY)
    v_y1, v_y2, v_y2_sd = np.loadtxt(path, delimiter=",", skiprows=1, unpack=True)
    braking = 0.55 * air.braking_per_drag(Ball(), {})
    test_speed = air.landing_speed(2.54, braking)
    level, covariance, freedom = by_hand(v_y2 / v_y1, v_y2_sd / v_y1, v_y1 - test_speed)
    low, high = t.interval(0.95, freedom, level[0], np.sqrt(covariance[0, 0]))
    width = high - low
    (row,) = drop_test(load_table(path), Scene()).to_dict("records")
    assert row["cor"] == pytest.approx(level[0], abs=1e-4)
    ends = [row["cor_q025"], row["cor_q975"]]
    assert ends == pytest.approx([low, high], abs=0.01 * width)
    assert low < TRUTH < high
    # What leaves the ground so fast rises through air.
    rebound = air.rebound_height(level[0] * test_speed, braking)
    assert row["rebound"] == pytest.approx(rebound, abs=1e-4)
    level, covariance, freedom = by_hand(v_y2 / v_y1, np.ones(12), v_y1 - test_speed)
    low, high = t.interval(0.95, freedom, level[0], np.sqrt(covariance[0, 0]))
    plain = drop_test(load_table(path, ignore=("v_y2_sd",)), Scene()).iloc[0]
    ends = [plain["cor_q025"], plain["cor_q975"]]
    assert ends == pytest.approx([low, high], abs=0.01 * (high - low))
    assert high - low > 2.0 * width


def test_errors_of_a_restitution_are_those_of_both_speeds_and_their_correlation():
    rng = np.random.default_rng(3)
    first = np.full(9, 7.0)
    second = 5.2 + 0.1 * rng.standard_normal(9)
    sds = {"v_y1": np.array([0.02, 0.2, 0.05] * 3), "v_y2": np.array([0.1, 0.02, 0.05] * 3)}
    for correlation in (0.0, 0.9):
        corr = {("v_y1", "v_y2"): correlation}
        table = impact_table({"v_y1": first, "v_y2": second}, sd=sds, corr=corr)
        cor = second / first
        relative_1 = sds["v_y1"] / first
        relative_2 = sds["v_y2"] / second
        together = relative_1**2 + relative_2**2 - 2.0 * correlation * relative_1 * relative_2
        expected = mean_of(cor, cor * np.sqrt(together))
        row = drop_test(table, Scene()).iloc[0]
        assert row["cor"] == pytest.approx(expected.point, rel=1e-9)


def test_errors_of_heights_weigh_drops():
    """As the weighted mean of heights does, within its error, though COR is what is averaged."""
    heights = np.array([140.0, 141.0, 139.0, 120.0, 140.5, 139.5])
    sd = np.array([0.5, 0.5, 0.5, 20.0, 0.5, 0.5])
    table = {
        "drop_height [cm]": np.full(6, 254.0),
        "rebound_height [cm]": heights,
        "rebound_height_sd [cm]": sd,
    }
    row = drop_test(load_table(table), Scene()).iloc[0]
    weights = sd**-2.0
    mean = np.average(heights, weights=weights)
    assert 100.0 * row["rebound"] == pytest.approx(mean, abs=weights.sum() ** -0.5)
    assert row["rebound_q025"] < 0.01 * mean < row["rebound_q975"]
    assert row["passes"] > 0.95


def test_a_court_pace_weighs_the_errors_of_its_table():
    angle = np.radians(16.0)
    v_x1 = np.full(6, 30.0 * np.cos(angle))
    v_y1 = np.full(6, 30.0 * np.sin(angle))
    friction = np.array([0.60, 0.61, 0.59, 0.75, 0.60, 0.60])
    cor = 0.8
    v_x2 = v_x1 - friction * v_y1 * (1.0 + cor)
    v_y2 = cor * v_y1
    impacts = {"v_x1": v_x1, "v_y1": v_y1, "omega_1": 0.0, "v_x2": v_x2, "v_y2": v_y2}
    v_x2_sd = np.array([0.1, 0.1, 0.1, 3.0, 0.1, 0.1])
    sds = {"v_x2": v_x2_sd, "v_y2": 0.05}
    rated = measured_pace(impact_table(impacts, sd=sds), Scene()).iloc[0]
    # ITF CS 01/02: 100 (1 - mu) + 150 (0.81 - e), and its slopes with v_x2 and v_y2.
    ratings = 100.0 * (1.0 - friction) + 150.0 * (0.81 - cor)
    of_v_x2 = 100.0 / (v_y1 + v_y2)
    of_v_y2 = 100.0 * friction / (v_y1 + v_y2) - 150.0 / v_y1
    level, _, _ = by_hand(ratings, np.hypot(of_v_x2 * v_x2_sd, of_v_y2 * 0.05), np.zeros(6))
    assert rated["rating"] == pytest.approx(level[0], abs=1e-3)
    plain = measured_pace(impact_table(impacts), Scene()).iloc[0]
    assert plain["rating"] == pytest.approx(ratings.mean(), abs=1e-3)
    assert sum(rated[name] for name in itf.PACE_CATEGORIES) == pytest.approx(1.0)
