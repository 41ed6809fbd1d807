"""Means of what laboratories measure, weighted by stated errors: against dense linear algebra,
Student's t, and tables of known truth. What is counted in these has limits by its own distribution:
a right rule fails a test by chance once in `FALSE_FAILURES`.
"""

from functools import cache, partial
from typing import NamedTuple

import numpy as np
import pytest
from made_tables import impact_table
from scipy.optimize import minimize_scalar
from scipy.stats import binom, chi2, t
from support.near import assert_near, assert_within

from fitball.base import air, itf
from fitball.base.priors import ParameterSpec, parse_prior
from fitball.base.values import Ball
from fitball.data.read import load_table
from fitball.data.scene import Scene
from fitball.uses.drops import drop_test
from fitball.uses.means import means
from fitball.uses.pace import measured_pace

# The chance that a right rule fails a test that counts.
FALSE_FAILURES = 1e-4
# Tables whose intervals are counted.
TABLES = 400
# Values of restitution that the tables have.
TRUTH = 0.75
# Probabilities of the ends of a 95 % interval.
ENDS = (0.025, 0.975)
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


class Mean(NamedTuple):
    """A mean by hand with its standard error, and degrees of freedom for Student's t."""

    level: float
    error: float
    freedom: int

    @property
    def interval(self):
        """The ends of its 95 % interval."""
        reach = self.error * t.ppf(0.975, self.freedom)
        return np.array([self.level - reach, self.level + reach])


def prior_of_spread(text):
    spec = ParameterSpec("spread", "", 0.0, np.inf, text, "", "")
    return parse_prior(spec)


def mean_of(values, sd=None, group=None, x=None, spread="half-t(0.01, 4)"):
    """Means of values with stated errors, on a line in x."""
    count = len(values)
    group = np.zeros(count, np.int64) if group is None else group
    x = np.zeros(count) if x is None else x
    prior = prior_of_spread(spread)
    rng = np.random.default_rng(1)
    return means(values, group, prior, rng, x, sd)


def minus_log_density(values, sd, design, log_scatter):
    """Of a scatter: the restricted likelihood times the root of the scatter."""
    variances = sd**2 + np.exp(2.0 * log_scatter)
    level, covariance = least_squares(values, variances, design)
    residual = values - design @ level
    squares = np.sum(residual**2 / variances)
    _, log_of_covariance = np.linalg.slogdet(covariance)
    deviance = np.sum(np.log(variances)) - log_of_covariance + squares
    return 0.5 * deviance - 0.5 * log_scatter


def least_squares(values, variances, design):
    """Level and slope, and their covariance, with dense matrices."""
    inverse = np.diag(1.0 / variances)
    covariance = np.linalg.inv(design.T @ inverse @ design)
    level = covariance @ design.T @ inverse @ values
    return level, covariance


def by_hand(values, sd, x=None):
    """The mean where x is zero, with weights by the mode of the scatter."""
    columns = [np.ones(len(values))]
    if x is not None:
        columns.append(x)
    design = np.column_stack(columns)
    freedom = len(values) - len(columns)
    smallest = 1e-2 * sd.min()
    largest = 10.0 * values.std()
    best = minimize_scalar(
        partial(minus_log_density, values, sd, design),
        bounds=np.log([smallest, largest]),
        method="bounded",
        options={"xatol": 1e-9},
    )
    variances = sd**2 + np.exp(2.0 * best.x)
    level, covariance = least_squares(values, variances, design)
    residual = values - design @ level
    mean_square = np.sum(residual**2 / variances) / freedom
    error = np.sqrt(mean_square * covariance[0, 0])
    return Mean(level[0], error, freedom)


def without_weights(values, x=None):
    """The mean where x is zero, of values that count alike."""
    return by_hand(values, np.ones(len(values)), x)


def assert_interval(ends, expected):
    """The ends of an interval are within 1 % of its width."""
    margin = 0.01 * np.ptp(expected)
    assert_within(ends, expected, margin)


def tables_of(errors):
    """Tables (tables, values) of one truth with these errors (values,)."""
    rng = np.random.default_rng(12)
    shape = (TABLES, len(errors))
    return TRUTH + errors * rng.standard_normal(shape)


def intervals_of(tables, sd):
    """Ends (tables, 2) of the 95 % intervals of tables whose errors are stated as `sd`."""
    draws = (mean_of(values, sd).mean for values in tables)
    ends = [np.quantile(each, ENDS) for each in draws]
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
    total = weights.sum()
    centres = tables @ weights / total
    reach = 1.96 / np.sqrt(total)
    return np.column_stack([centres - reach, centres + reach])


def share_of_true(ends):
    """The share of intervals (tables, 2) that contain the truth."""
    low, high = ends.T
    is_true = (low <= TRUTH) & (high >= TRUTH)
    return is_true.mean()


def least_share(nominal):
    """The share of true intervals below which a rule with that nominal share fails."""
    count = binom.ppf(FALSE_FAILURES, TABLES, nominal)
    return count / TABLES


@pytest.mark.parametrize("sloped", [False, True])
def test_stated_errors_weigh_a_mean_as_dense_matrices_do(sloped):
    rng = np.random.default_rng(4)
    x = np.linspace(-1.0, 2.0, 12) if sloped else None
    values = TRUTH + UNEQUAL * rng.standard_normal(12)
    if sloped:
        values += 0.01 * x
    weighted = mean_of(values, UNEQUAL, x=x)
    expected = by_hand(values, UNEQUAL, x)
    assert_within(weighted.point, expected.level, 1e-6)
    assert_interval(np.quantile(weighted.mean, ENDS), expected.interval)
    # Without weights the bad rows count as much as the good ones.
    plain = mean_of(values, x=x)
    of_plain = without_weights(values, x)
    assert_interval(np.quantile(plain.mean, ENDS), of_plain.interval)
    assert of_plain.error > 2.0 * expected.error


@pytest.mark.parametrize("sd", [0.001, 0.004, 0.1])
def test_equal_stated_errors_are_students(sd):
    values = np.array([0.741, 0.747, 0.738, 0.744, 0.749])
    stated = np.full(5, sd)
    weighted = mean_of(values, stated)
    plain = mean_of(values)
    assert_near(weighted.point, plain.point, 1e-12)
    assert_near(weighted.mean, plain.mean, 1e-9)


def test_repeats_that_agree_in_all_digits_have_the_errors_that_they_state():
    values = np.full(4, TRUTH)
    stated = np.full(4, 0.01)
    same = mean_of(values, stated)
    width = np.ptp(np.quantile(same.mean, ENDS))
    assert_near(width, 3.92 * 0.005, 0.01)
    assert mean_of(values).mean.size == 0


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
    count = len(sd)
    freedom = count - 1
    error_by_weights = 1.0 / np.sqrt(np.sum(sd**-2.0))
    error_of_equal = np.sqrt(np.mean(sd**2) / count)
    between = np.sqrt(error_by_weights * error_of_equal)
    median_of_scale = np.sqrt(chi2.median(freedom) / freedom)
    limit = 2.0 * t.ppf(0.975, freedom) * median_of_scale * between
    low, high = intervals_where_errors_are_stated(name).T
    assert np.median(high - low) < limit


@pytest.mark.parametrize(
    ("sd", "errors"),
    [
        (UNEQUAL, 2.0 * UNEQUAL),
        (MILD, np.hypot(MILD, 0.01)),
    ],
    ids=["twice", "scatter"],
)
def test_intervals_hold_where_errors_are_larger_than_stated(sd, errors):
    """Six values hardly show a scatter as large as their errors: of 10,000 tables 93 % are true.
    Stated errors alone are trusted too far.
    """
    tables = tables_of(errors)
    least = least_share(0.925)
    share = share_of_true(intervals_of(tables, sd))
    share_by_stated_errors = share_of_true(intervals_by_stated_errors(tables, sd))
    assert share_by_stated_errors < least <= share


# Five balls, with one bad drop and two good ones each.
BALLS = np.repeat(np.arange(5), 3)
RESTITUTIONS = np.array([0.74, 0.75, 0.76, 0.745, 0.755])


def test_repeats_of_balls_are_weighed_by_stated_errors():
    """Each ball is as its weighted mean says, drawn to the others by less than its error."""
    errors = np.array(
        [
            [0.06, 0.002, -0.002],
            [-0.05, -0.001, 0.001],
            [0.04, 0.003, -0.003],
            [-0.06, 0.0, 0.001],
            [0.05, 0.0, 0.001],
        ]
    )
    by_ball = RESTITUTIONS[:, None] + errors
    sd = np.array([0.05, 0.002, 0.002])
    weights = sd**-2.0
    error = weights.sum() ** -0.5
    expected = np.average(by_ball, axis=1, weights=weights)
    values = by_ball.ravel()
    weighted = mean_of(values, np.tile(sd, 5), BALLS)
    each = weighted.each.mean(axis=1)
    assert_within(each, expected, error)
    assert_within(weighted.point, expected.mean(), error)
    plain = mean_of(values, group=BALLS)
    off = plain.each.mean(axis=1) - expected
    assert np.abs(off).max() > 3.0 * error


def test_the_noise_of_repeats_that_happen_to_agree_is_what_they_state():
    """But for what the other balls add."""
    values = RESTITUTIONS[BALLS] + np.array([1e-5, -1e-5, 0.0] * 5)
    agreeing = mean_of(values, np.full(15, 0.004), BALLS)
    sds = agreeing.each.std(axis=1)
    stated = 0.004 / np.sqrt(3.0)
    information = 1.0 / stated**2 + 1.0 / RESTITUTIONS.var()
    drawn = information**-0.5
    assert sds.min() > 0.95 * drawn
    assert sds.max() < 1.05 * stated


@pytest.mark.parametrize(
    ("balls", "drops", "within"),
    [
        (2, 2, 0.25),
        (5, 2, 0.1),
        (6, 5, 0.1),
    ],
)
def test_balls_that_differ_are_no_better_known_than_their_pooled_noise(balls, drops, within):
    """Where nothing is known of the spread of balls each is as Student's t of the pooled noise
    says, whose degrees of freedom are few.
    """
    rng = np.random.default_rng(6)
    noise = rng.standard_normal((balls, drops))
    far_apart = 50.0 * np.arange(balls)
    by_ball = far_apart[:, None] + noise
    group = np.repeat(np.arange(balls), drops)
    each = mean_of(by_ball.ravel(), group=group, spread="half-t(100, 4)").each
    levels = by_ball.mean(axis=1, keepdims=True)
    freedom = balls * (drops - 1)
    variance = np.sum((by_ball - levels) ** 2) / freedom
    error = np.sqrt(variance / drops)
    away = (each - levels) / error
    width = np.ptp(np.quantile(away, ENDS))
    expected = 2.0 * t.ppf(0.975, freedom)
    assert_near(width, expected, within)


def test_balls_dropped_once_differ_by_more_than_their_errors():
    """Another ball lies about the mean by the spread of balls, without the errors of bad drops. The
    spread is known as well as by the values that show it.
    """
    spread = 0.01
    sd = np.array([0.002, 0.03] * 20)
    rng = np.random.default_rng(8)
    values = TRUTH + np.hypot(sd, spread) * rng.standard_normal(40)
    each_of_its_own = np.arange(40)
    weighted = mean_of(values, sd, each_of_its_own)
    plain = mean_of(values, group=each_of_its_own)
    share_of_spread = spread**2 / (spread**2 + sd**2)
    freedom = np.sum(share_of_spread**2) - 1.0
    tails = [0.5 * FALSE_FAILURES, 1.0 - 0.5 * FALSE_FAILURES]
    squares = chi2.ppf(tails, freedom) / freedom
    low, high = spread * np.sqrt(squares)
    assert low < weighted.another.std() < high
    assert plain.another.std() > high


@pytest.fixture
def laboratory(tmp_path):
    path = tmp_path / "lab_errors.csv"
    path.write_text(LABORATORY)
    return path


def only_row(frame):
    """The only row of a frame."""
    (row,) = frame.to_dict("records")
    return row


def test_a_drop_test_weighs_the_errors_of_its_table(laboratory):
    """Slower and faster impacts of one restitution lead to the drop from 254 cm by a line."""
    v_y1, v_y2, v_y2_sd = np.loadtxt(laboratory, delimiter=",", skiprows=1).T
    braking = 0.55 * air.braking_per_drag(Ball(), {})
    test_speed = air.landing_speed(2.54, braking)
    cor = v_y2 / v_y1
    sd = v_y2_sd / v_y1
    expected = by_hand(cor, sd, v_y1 - test_speed)
    row = only_row(drop_test(load_table(laboratory), Scene()))
    assert_within(row["cor"], expected.level, 1e-4)
    low, high = row["cor_q025"], row["cor_q975"]
    assert_interval([low, high], expected.interval)
    assert low < TRUTH < high
    # What leaves the ground so fast rises through air.
    rebound = air.rebound_height(expected.level * test_speed, braking)
    assert_within(row["rebound"], rebound, 1e-4)


def test_a_drop_test_without_stated_errors_counts_rows_alike(laboratory):
    v_y1, v_y2, _ = np.loadtxt(laboratory, delimiter=",", skiprows=1).T
    braking = 0.55 * air.braking_per_drag(Ball(), {})
    test_speed = air.landing_speed(2.54, braking)
    expected = without_weights(v_y2 / v_y1, v_y1 - test_speed)
    weighted = only_row(drop_test(load_table(laboratory), Scene()))
    table = load_table(laboratory, ignore=("v_y2_sd",))
    plain = only_row(drop_test(table, Scene()))
    width = plain["cor_q975"] - plain["cor_q025"]
    width_by_weights = weighted["cor_q975"] - weighted["cor_q025"]
    assert_interval([plain["cor_q025"], plain["cor_q975"]], expected.interval)
    assert width > 2.0 * width_by_weights


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_errors_of_a_restitution_are_those_of_both_speeds_and_their_correlation(correlation):
    rng = np.random.default_rng(3)
    v_y1 = np.full(9, 7.0)
    v_y2 = 5.2 + 0.1 * rng.standard_normal(9)
    v_y1_sd = np.array([0.02, 0.2, 0.05] * 3)
    v_y2_sd = np.array([0.1, 0.02, 0.05] * 3)
    table = impact_table(
        {"v_y1": v_y1, "v_y2": v_y2},
        sd={"v_y1": v_y1_sd, "v_y2": v_y2_sd},
        corr={("v_y1", "v_y2"): correlation},
    )
    relative_1 = v_y1_sd / v_y1
    relative_2 = v_y2_sd / v_y2
    in_common = 2.0 * correlation * relative_1 * relative_2
    variance = relative_1**2 + relative_2**2 - in_common
    cor = v_y2 / v_y1
    expected = by_hand(cor, cor * np.sqrt(variance))
    row = only_row(drop_test(table, Scene()))
    assert_near(row["cor"], expected.level, 1e-6)


def test_errors_of_heights_weigh_drops():
    """As the weighted mean of heights does, within its error, though COR is what is averaged."""
    heights = np.array([140.0, 141.0, 139.0, 120.0, 140.5, 139.5])
    sd = np.array([0.5, 0.5, 0.5, 20.0, 0.5, 0.5])
    table = {
        "drop_height [cm]": np.full(6, 254.0),
        "rebound_height [cm]": heights,
        "rebound_height_sd [cm]": sd,
    }
    row = only_row(drop_test(load_table(table), Scene()))
    weights = sd**-2.0
    error = weights.sum() ** -0.5
    mean = np.average(heights, weights=weights)
    assert_within(100.0 * row["rebound"], mean, error)
    assert row["rebound_q025"] < 0.01 * mean < row["rebound_q975"]
    assert row["passes"] > 0.95


def test_a_court_pace_weighs_the_errors_of_its_table():
    angle = np.radians(16.0)
    v_x1 = 30.0 * np.cos(angle)
    v_y1 = 30.0 * np.sin(angle)
    friction = np.array([0.60, 0.61, 0.59, 0.75, 0.60, 0.60])
    cor = 0.8
    v_y2 = cor * v_y1
    impacts = {
        "v_x1": np.full(6, v_x1),
        "v_y1": np.full(6, v_y1),
        "omega_1": 0.0,
        "v_x2": v_x1 - friction * (v_y1 + v_y2),
        "v_y2": np.full(6, v_y2),
    }
    v_x2_sd = np.array([0.1, 0.1, 0.1, 3.0, 0.1, 0.1])
    # ITF CS 01/02: 100 (1 - mu) + 150 (0.81 - e), and its slopes with v_x2 and v_y2.
    ratings = 100.0 * (1.0 - friction) + 150.0 * (0.81 - cor)
    of_v_x2 = 100.0 / (v_y1 + v_y2)
    of_v_y2 = friction * of_v_x2 - 150.0 / v_y1
    errors = np.hypot(of_v_x2 * v_x2_sd, of_v_y2 * 0.05)
    expected = by_hand(ratings, errors)
    table = impact_table(impacts, sd={"v_x2": v_x2_sd, "v_y2": 0.05})
    rated = only_row(measured_pace(table, Scene()))
    assert_within(rated["rating"], expected.level, 1e-3)
    shares = [rated[name] for name in itf.PACE_CATEGORIES]
    assert_near(sum(shares), 1.0, 1e-6)
    plain = only_row(measured_pace(impact_table(impacts), Scene()))
    assert_within(plain["rating"], ratings.mean(), 1e-3)
