"""Adequacy against regressions written out, scipy's distributions, and tables of other code with a
known fault.
"""

from dataclasses import replace
from math import comb

import numpy as np
import pytest
from scipy import stats
from support.density import REBOUND, TIMED, near, problem_of, scene_of, table_of
from support.fits import at
from support.misread import TENNIS, bounce

from fitball.data.table import ImpactTable
from fitball.inference.judgement import adequacy as module
from fitball.inference.judgement import first_order as thinning
from fitball.inference.judgement import residuals
from fitball.inference.judgement.adequacy import adequacy
from fitball.inference.judgement.adequacy_words import REMEDIES
from fitball.inference.judgement.first_order import first_order
from fitball.inference.judgement.noise_tests import farthest
from fitball.inference.judgement.residuals import OBJECTION_CHANCE, PatternTest
from fitball.inference.search.objective import Objective, descend

START = {
    "mu": 0.6,
    "e_x": 0.15,
    "offset": 2e-3,
    "cor_10": 0.77,
    "cor_slope": -0.012,
    "v_x_sd": 0.3,
    "v_y_sd": 0.2,
    "spin_sd": 8.0,
    "degrees_of_freedom": 8.0,
}


def table_with(fault="", seed=5, rows=24):
    """Impacts of a model of other code, which grip-slip describes but for a fault."""
    rng = np.random.default_rng([seed, rows])
    slow = 10.0
    fast = 25.0
    steep = 70.0
    if fault == "growth":
        slow = 5.0
        fast = 30.0
    elif fault == "surfaces":
        steep = 45.0
    speed = rng.uniform(slow, fast, rows)
    degrees = rng.uniform(15.0, steep, rows)
    angle = np.radians(degrees)
    v_x = speed * np.cos(angle)
    v_y = speed * np.sin(angle)
    omega = rng.uniform(-180.0, 180.0, rows)
    incident = np.stack([v_x, v_y, omega])
    along = np.linspace(-1.0, 1.0, rows)
    clay = np.arange(rows) % 2 == 0
    friction = np.full(rows, 0.6)
    restitution = 0.77 - 0.012 * (v_y - 10.0)
    sds = np.array([[0.2], [0.2], [8.0]])
    noise = sds * rng.standard_normal((3, rows))
    measured = incident
    if fault == "bias":
        noise[0] += 1.5
    elif fault == "growth":
        noise *= (speed / 17.5) ** 1.5
    elif fault == "wild":
        noise[2, [3, 11, 20]] += [120.0, -150.0, 90.0]
    elif fault == "drift":
        friction = friction + 0.1 * along
        restitution = restitution + 0.03 * along
    elif fault == "constant":
        # A slope of restitution is another law here, which so many impacts would show.
        restitution = np.full(rows, 0.77)
    elif fault == "surfaces":
        friction = np.where(clay, 0.75, 0.5)
    elif fault == "law":
        slip = np.abs(v_x - TENNIS[1] * omega)
        friction = 0.6 * (slip / 14.0) ** -0.35
    elif fault == "group":
        noise[1] += 0.4 * clay
    elif fault == "incidence":
        sds_of_impact = np.array([[0.9], [0.0], [0.0]])
        measured = incident + sds_of_impact * rng.standard_normal((3, rows))
    parameters = (friction, 0.15, 2e-3, restitution, 0.0)
    rebound = np.stack(bounce(*incident, TENNIS, parameters)) + noise
    names = ("v_x1", "v_y1", "omega_1", *REBOUND)
    values = dict(zip(names, [*measured, *rebound], strict=True))
    labels = {
        "id": tuple(f"r{k}" for k in range(rows)),
        "group": tuple("clay" if is_clay else "hard" for is_clay in clay),
    }
    return ImpactTable("made", values, {}, {}, labels)


def fitted_and_judged(table, text="grip-slip", **choices):
    """Problem, linearisation at the maximum near the truth, adequacy."""
    problem = problem_of(table, None, text, **choices)
    values = {name: START[name.partition("[")[0]] for name in problem.free}
    start = problem.coordinates(values)
    point = maximum_from(problem, start)
    first = first_order(problem, point)
    return problem, first, adequacy(problem, point, first)


def maximum_from(problem, start):
    """The point fit of a descent from coordinates (free,)."""
    optima, *_ = descend(Objective(problem), start[None])
    return at(problem, optima[0])


def adequacy_of(table, text="grip-slip", **choices):
    """Only the adequacy of a fit to a table."""
    _, _, result = fitted_and_judged(table, text, **choices)
    return result


def with_residual(first, residual):
    """A linearisation with another residual, after its own refit."""
    return first._replace(residual=first.after_refit(residual))


def kinds(result):
    """Kind and column of each test that found something."""
    alarms = [test for test in result.tests if test.found]
    return {(test.kind, test.column) for test in alarms}


def of_kind(tests, kind):
    return [test for test in tests if test.kind == kind]


def judged_drop_test(bend=0.0, rows=12):
    """A drop test under a nearly straight restitution: two parameters of wide priors, one column,
    two groups.
    """
    speed = np.linspace(4.0, 16.0, rows)
    noise = 0.05 * np.random.default_rng(8).standard_normal(rows)
    restitution = 0.76 - 0.012 * (speed - 10.0)
    v_y2 = restitution * speed + noise + bend * (speed - 9.5) ** 2
    labels = {
        "id": tuple(map(str, range(rows))),
        "group": tuple("aab"[k % 3] for k in range(rows)),
        "remark": tuple(f"w{k}" if k % 2 else "" for k in range(rows)),
    }
    table = ImpactTable("drops", {"v_y1": speed, "v_y2": v_y2}, {}, {}, labels)
    wide = {"cor_10": "uniform(0.1, 1)", "cor_slope": "normal(-0.01, 1)"}
    return fitted_and_judged(table, prior=wide)


# Shares of the chance of a false alarm by the kinds of test that a drop test has.
SHARES_OF_DROPS = {
    "trend": 0.25,
    "drift": 0.15,
    "bias": 0.1,
    "row": 0.1,
    "growth": 0.1,
    "outlier": 0.05,
    "group": 0.1,
    "parameter": 0.1,
}


def test_a_trend_is_the_t_test_of_one_more_column():
    problem, first, result = judged_drop_test(bend=0.012)
    speed = problem.rows.states.v_y1
    centred = speed - speed.mean()
    design = np.stack([*first.slopes[:12].T, centred], axis=1)
    design[:, :2] /= np.linalg.norm(design[:, :2], axis=0)
    best, squares = np.linalg.lstsq(design, first.residual, rcond=None)[:2]
    inverse = np.linalg.inv(design.T @ design)
    variance = squares[0] / 9.0 * inverse[2, 2]
    t = best[2] / np.sqrt(variance)
    alone = 2.0 * stats.t.sf(abs(t), 9)
    explained = t**2 / (t**2 + 9.0)
    (trend,) = (test for test in result.tests if test.pattern == "v_y2: trend with v_y1")
    assert trend.explained == pytest.approx(explained, rel=1e-3)
    # Its chance among all: shares of the kinds that there are, of 3/5 of 5 %.
    tested = [test.kind for test in result.tests]
    all_shares = sum(SHARES_OF_DROPS[kind] for kind in {*tested})
    share = 0.6 * SHARES_OF_DROPS["trend"] / all_shares
    among_all = alone * tested.count("trend") / share
    assert trend.p == pytest.approx(min(1.0, among_all), rel=1e-2)
    assert trend.p < 1.0
    assert not any("remark" in test.pattern for test in result.tests)


def test_false_alarms_of_a_linear_model_are_rarer_than_promised():
    """400 tables of the linearised model, and the same with a bias of a group: it is found."""
    problem, first, _ = judged_drop_test(rows=24)
    point = at(problem, first.proposal.centre)
    rng = np.random.default_rng(7)
    size = first.residual.size
    in_group = np.array(problem.table.labels["group"]) == "b"
    bias = first.direction("v_y2", 0.12 * in_group)

    def alarm(residual):
        result = adequacy(problem, point, with_residual(first, residual))
        return any(test.found for test in result.tests)

    alarms = 0
    detected = 0
    for k in range(400):
        clean = rng.standard_normal(size)
        alarms += alarm(clean)
        if k < 40:
            detected += alarm(clean + bias)
    assert 1 <= alarms <= stats.binom.ppf(0.999, 400, OBJECTION_CHANCE)
    assert detected >= 20


def test_how_many_are_far_off_is_the_least_of_beta_bounds():
    residual = np.random.default_rng(3).standard_normal(18)
    residual[[2, 7, 9]] += 9.0
    residual *= np.sqrt(15.0 / np.sum(residual**2))
    descending = np.sort(residual**2)[::-1]
    shares = np.cumsum(descending[:3]) / 15.0
    bounds = []
    for count, share in enumerate(shares, start=1):
        tail = stats.beta.sf(share, count / 2, (15 - count) / 2)
        bounds.append(comb(18, count) * tail)
    least = pytest.approx(3.0 * min(bounds), rel=1e-9)
    assert farthest(shares, 18, 15.0) == (3, least)
    assert 3.0 * bounds[2] < 1e-3 < bounds[0]


def test_growth_is_a_likelihood_ratio():
    """Of normal densities whose sds are a power of the speed, the power on a grid, by scipy."""
    problem, first, result = fitted_and_judged(table_with("growth", 5))
    speed = problem.rows.states.polar()[0][first.rows]
    freedom = 1.0 - np.sum(first.basis**2, axis=1)
    z = first.residual / np.sqrt(freedom)

    def log_likelihood(power):
        total = 0.0
        for k in range(3):
            in_column = first.column == k
            sd = speed[in_column] ** power
            size = np.sqrt(np.mean((z[in_column] / sd) ** 2))
            total += stats.norm.logpdf(z[in_column], scale=sd * size).sum()
        return total

    best = max(map(log_likelihood, np.linspace(-4.0, 4.0, 1601)))
    ratio = 2.0 * (best - log_likelihood(0.0))
    chance = stats.chi2.sf(ratio * freedom.mean(), 1)
    chance *= module._chance_factor(result.tests, "growth")
    (growth,) = of_kind(result.tests, "growth")
    assert growth.found
    assert growth.p == pytest.approx(chance, rel=1e-2)
    assert "increases" in growth.pattern


def test_what_is_far_off_is_judged_by_a_fit_to_all_others():
    """Shares of the variance by least squares without the farthest rows, one of them at the end,
    where it pulls.
    """
    problem, first, _ = judged_drop_test(rows=24)
    residual = first.residual.copy()
    residual[[4, 23]] += 9.0 * np.std(residual)
    spoilt = with_residual(first, residual)
    point = at(problem, first.proposal.centre)
    tests = adequacy(problem, point, spoilt).tests
    (outlier,) = of_kind(tests, "outlier")
    design = first.slopes[:24, :2]
    freedom = 1.0 - np.sum(first.basis**2, axis=1)
    farthest_first = np.argsort(-np.abs(spoilt.residual) / np.sqrt(freedom))

    def squares(rows):
        _, sums, *_ = np.linalg.lstsq(design[rows], residual[rows], rcond=None)
        return sums[0]

    shares = []
    for count in range(1, 5):
        others = squares(farthest_first[count:])
        shares.append(1.0 - others / squares(farthest_first))
    freedom_of_column = float(freedom[:24].sum())
    _, chance = farthest(np.array(shares), 24, freedom_of_column)
    chance *= module._chance_factor(tests, "outlier")
    assert outlier.found
    assert outlier.p == pytest.approx(chance, rel=0.02)


def test_of_noise_alone_no_few_are_far_off():
    """In 900 columns of 24 rows: their residuals, each over its own sd, have more squares than
    there is freedom.
    """
    problem, first, _ = fitted_and_judged(table_with("", 5))
    point = at(problem, first.proposal.centre)
    rng = np.random.default_rng(4)

    def chances(residual):
        result = adequacy(problem, point, with_residual(first, residual))
        return [test.p for test in of_kind(result.tests, "outlier")]

    of_noise = []
    for _ in range(300):
        of_noise += chances(rng.standard_normal(first.residual.size))
    assert len(of_noise) == 900
    assert min(of_noise) > 2e-3
    wild = first.residual.copy()
    wild[np.argmax(np.abs(wild))] *= 20.0
    assert min(chances(wild)) < 2e-3


FAULTS = {
    "bias": ("bias", "v_x2"),
    "growth": ("growth", ""),
    "drift": ("drift", ""),
    "surfaces": ("parameter", ""),
    "group": ("group", "v_y2"),
    "wild": ("outlier", "omega_2"),
    "incidence": ("linked", ""),
    "law": ("law", ""),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_found_by_its_kind(fault):
    """In most of some tables, whatever the draws; in a table without it, it is not."""
    rows = 60 if fault in ("incidence", "group", "growth") else 24

    def is_found(table):
        return FAULTS[fault] in kinds(adequacy_of(table))

    assert sum(is_found(table_with(fault, seed, rows)) for seed in range(4)) >= 3
    assert not any(is_found(table_with("", seed, rows)) for seed in range(2))


def test_answers():
    answers = [adequacy_of(table_with("", seed)).answer for seed in range(4)]
    assert answers.count("describes") >= 3
    biased = adequacy_of(table_with("bias"))
    assert biased.answer == "does not describe"
    assert max(biased.moved.values()) > 5.0
    group = adequacy_of(table_with("group", rows=60))
    assert group.answer == "describes except"
    assert group.moved["cor_10"] > 1.0 > group.moved["mu"]
    few = adequacy_of(table_with(rows=6))
    assert few.answer == "undecided"
    assert min(few.unseen.values()) > 0.6
    # What a bend of the restitution looks like once its slope is fitted.
    for fix, alike in (
        ({}, True),
        ({"cor_slope": -0.012}, False),
    ):
        result = adequacy_of(table_with(seed=1), fix=fix)
        biases = of_kind(result.tests, "bias")
        patterns = [test.pattern for test in biases if test.column == "v_y2"]
        assert ["v_y1" in pattern for pattern in patterns] == [alike]


def test_the_remedy_of_surfaces_removes_the_fault():
    table = table_with("surfaces")
    tests = of_kind(adequacy_of(table).tests, "parameter")
    alarms = [test for test in tests if test.found]
    assert alarms
    assert all("--pool mu=group" in test.pattern for test in alarms)
    assert adequacy_of(table, pool={"mu": "group"}).answer == "describes"


def test_three_outliers_do_not_hide_each_other_and_students_t_allows_them():
    outliers = of_kind(adequacy_of(table_with("wild")).tests, "outlier")
    (alarm,) = (test for test in outliers if test.found)
    for name in ("r3", "r11", "r20"):
        assert name in alarm.pattern
    heavy_tails = adequacy_of(table_with("wild"), noise="student-t")
    assert heavy_tails.answer == "describes"


def test_a_pattern_moves_what_follows_from_parameters_that_it_moves_little():
    """Drops from one height, one of two balls higher: in sds of the rebound, by a regression with
    that ball.
    """
    speed = np.linspace(6.83, 6.93, 12)
    high = np.arange(12) % 2
    wiggle = 0.01 * np.sin(5.0 * speed)
    values = {
        "v_y1": speed,
        "v_y2": 0.74 * speed + 0.1 * high + wiggle,
    }
    labels = {
        "id": tuple("abcdefghijkl"),
        "group": tuple("xy"[k] for k in high),
    }
    table = ImpactTable("drops", values, {}, {}, labels)
    problem, first, _ = fitted_and_judged(table)
    point = at(problem, first.proposal.centre)
    moved = adequacy(problem, point, first, problem.derived).moved

    # Priors are rows of the design too, without a residual and without a pattern.
    rows = len(first.slopes)
    residual = np.zeros(rows)
    residual[:12] = first.residual
    higher = np.zeros(rows)
    higher[:12] = first.direction("v_y2", 1.0 * high)

    def parameters(design):
        solution, *_ = np.linalg.lstsq(design, residual, rcond=None)
        return solution[:2]

    with_ball = np.column_stack([first.slopes, higher])
    shift = parameters(with_ball) - parameters(first.slopes)
    # A drop from 254 cm lands with 6.89 m/s through air, as the seventh does.
    rate = first.slopes[6]
    covariance = np.linalg.inv(first.slopes.T @ first.slopes)
    sd = np.sqrt(rate @ covariance @ rate)
    assert moved["cor_254cm"] == pytest.approx(abs(rate @ shift) / sd, rel=0.05)
    of_parameters = max(moved["cor_10"], moved["cor_slope"])
    assert moved["cor_254cm"] > 1.0 > 2.0 * of_parameters


def test_columns_of_few_measurements_are_not_vouched_for_by_others():
    table = table_with()
    few_spins = table.values["omega_2"].copy()
    few_spins[5:] = np.nan
    values = {**table.values, "omega_2": few_spins}
    result = adequacy_of(replace(table, values=values))
    assert result.answer == "undecided"
    assert result.unseen["omega_2"] > 0.6 > result.unseen["v_y2"]


@pytest.mark.parametrize(
    ("stated", "answer"),
    [
        (0.2, "describes"),
        (0.155, "describes"),
        (0.14, "describes except"),
        (0.06, "does not describe"),
    ],
)
def test_a_stated_noise_is_held_against_chi_square(stated, answer):
    table = table_with(rows=40)
    table = replace(table, sd={"v_y2": np.full(40, stated)})
    _, first, result = fitted_and_judged(table, fix={"v_y_sd": 0.0})
    (check,) = noise_checks(result, "v_y2")
    in_column = first.column == 1
    squares = np.sum(first.residual[in_column] ** 2)
    freedom = 40 - np.sum(first.basis[in_column] ** 2)
    assert check.stated
    assert check.reference == pytest.approx(stated)
    assert check.size == pytest.approx(stated * np.sqrt(squares / freedom))
    assert result.answer == answer
    larger = stats.chi2.sf(squares, freedom) * 7.5 < 0.05
    assert check.found == larger
    assert larger == (answer != "describes")


def noise_checks(result, column):
    return [check for check in result.noise if check.column == column]


def test_an_expected_noise_is_an_exception_from_three_times():
    for size, answer in ((2.0, False), (4.0, True)):
        expected = 0.2 / size
        result = adequacy_of(table_with(), prior={"v_y_sd": f"lognormal({expected}, 0.7)"})
        (check,) = noise_checks(result, "v_y2")
        assert not check.stated
        assert not check.beyond
        assert check.reference == pytest.approx(expected)
        assert check.found is answer
    # Of a column with stated errors it is the scatter beyond these.
    table = table_with()
    stated = replace(table, sd={"v_y2": np.full(len(table), 0.1)})
    checks = adequacy_of(stated).noise
    assert [check.column for check in checks if check.beyond] == ["v_y2"]


def test_few_impacts_of_a_good_model_are_no_misfit():
    """Columns with next to no freedom lend each other some: no test may take that for a pattern."""
    good = [adequacy_of(table_with(seed=seed, rows=4)) for seed in range(40)]
    assert sum(bool(kinds(result)) for result in good) <= 0.06 * len(good)
    assert not any(result.answer == "does not describe" for result in good)
    biased = [adequacy_of(table_with("bias", seed=seed, rows=8)) for seed in range(4)]
    assert sum(bool(kinds(result)) for result in biased) >= 2


def test_a_camera_that_is_off_is_named_with_its_size():
    table = table_of(TIMED, count=40)
    true = problem_of(table, scene_of(camera=True), "two-mass")
    values = true.values(near(true, 1, 0.0))
    values["tilt"] = np.array([0.03])
    seen = true.rebounds(values)
    rng = np.random.default_rng(2)
    sds = (0.21, 0.17, 6.0, 1.5e-4, 1e-4, 1e-3, 0.03)
    filmed = dict(table.values)
    for name, sd in zip(TIMED, sds, strict=True):
        filmed[name] = seen.column(name)[0] + sd * rng.standard_normal(40)
    camera_tests = {}
    for camera in (False, True):
        scene = scene_of(camera=camera)
        problem = problem_of(replace(table, values=filmed), scene, "two-mass")
        point = maximum_from(problem, near(problem, 1, 0.0)[0])
        result = adequacy(problem, point, first_order(problem, point))
        camera_tests[camera] = of_kind(result.tests, "camera")
    tests = {test.pattern.partition(" ")[0]: test for test in camera_tests[False]}
    assert set(tests) == {"scale", "clock", "tilt", "court_height"}
    assert tests["tilt"].found
    # Only the height of the court could explain as much.
    chances = sorted(test.p for test in tests.values())
    assert chances[1] >= tests["tilt"].p
    assert not camera_tests[True]


def test_long_tables_are_tested_thinned(monkeypatch):
    """A sure pattern that is too small is no exception, and moves what is known all the same."""
    monkeypatch.setattr(thinning, "LONG_ROWS", 600)
    table = table_with("constant", rows=1200)
    assert adequacy_of(table).answer == "describes"
    bias = 0.2 * (np.array(table.labels["group"]) == "clay")
    biased = table.values["v_y2"] + bias
    table = replace(table, values={**table.values, "v_y2": biased})
    _, first, result = fitted_and_judged(table)
    assert len(first.residual) == 1800
    assert result.answer == "describes except"
    assert result.moved["cor_10"] > 2.0
    monkeypatch.setattr(residuals, "SMALLEST_PATTERN", 2.0)
    fine = adequacy_of(table)
    assert fine.answer == "describes"
    assert fine.moved == result.moved


def test_chances_have_the_same_last_digit_in_each_process(monkeypatch):
    monkeypatch.setattr(module, "KIND_SHARES", dict.fromkeys("abcdefghij", 0.1))
    tests = [PatternTest(kind, "", "", 0.5) for kind in module.KIND_SHARES]
    assert module._chance_factor(tests, "a") == module.PATTERN_FACTOR / 0.1


# Rebounds [cm] of six balls from 254 cm, two drops each.
LOT = [142.6, 142.1, 143.3, 146.3, 147.1, 146.6, 149.5, 149.3, 152.2, 151.9, 152.6, 153.4]


def found_in(drops, balls):
    """Kinds and patterns that are found in drops (v_y1, v_y2) of balls by name, and the answer."""
    speed, rebound = drops
    ids = tuple(map(str, range(len(balls))))
    labels = {"id": ids, "ball": tuple(map(str, balls))}
    table = ImpactTable("drops", {"v_y1": speed, "v_y2": rebound}, {}, {}, labels)
    result = adequacy_of(table, pool={"all": "none"})
    return {(test.kind, test.pattern) for test in result.tests if test.found}, result.answer


def test_balls_listed_in_order_are_no_drift():
    fallen = np.full(12, 6.9)
    balls = np.repeat(["B1", "B2", "B3", "B4", "B5", "B6"], 2)
    risen = np.sqrt(2.0 * 9.81 * 0.01 * np.array(LOT))
    found, answer = found_in((fallen, risen), balls)
    assert answer == "describes except"
    assert {kind for kind, _ in found} <= {"group", "parameter"}
    assert any(" in ball " in pattern for _, pattern in found)


@pytest.mark.parametrize("order", ["in order", "in turn"])
def test_a_drift_is_found_whatever_the_order_of_balls(order):
    """Restitution falls while each ball is dropped, or over the session with balls in turn."""
    rng = np.random.default_rng(3)
    balls = np.repeat(list("abcd"), 6) if order == "in order" else np.tile(list("abcd"), 6)
    step = np.tile(np.arange(6.0), 4) if order == "in order" else np.arange(24.0) / 4.0
    speed = rng.permutation(np.linspace(5.0, 7.0, 24))
    rebound = (0.76 - 0.01 * step) * speed + 0.02 * rng.standard_normal(24)
    found, answer = found_in((speed, rebound), balls)
    assert answer == "does not describe"
    assert "row" in {kind for kind, _ in found}
    wanted = "rows of each ball" if order == "in order" else "along the rows"
    assert all(wanted in pattern for kind, pattern in found if kind == "row")


def test_every_kind_of_test_has_a_remedy():
    assert REMEDIES.keys() == module.KIND_SHARES.keys()
