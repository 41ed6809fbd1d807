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
from fitball.inference.judgement.adequacy import EXCEPT, adequacy, farthest
from fitball.inference.judgement.first_order import first_order
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
    rng = np.random.default_rng([seed, rows])
    slow = 5.0 if fault == "growth" else 10.0
    steep = 45.0 if fault == "surfaces" else 70.0
    speed = rng.uniform(slow, 30.0 if slow < 10.0 else 25.0, rows)
    angle = np.radians(rng.uniform(15.0, steep, rows))
    incident = np.stack(
        [speed * np.cos(angle), speed * np.sin(angle), rng.uniform(-180.0, 180.0, rows)]
    )
    along = np.linspace(-1.0, 1.0, rows)
    clay = np.arange(rows) % 2 == 0
    friction = np.full(rows, 0.6)
    restitution = 0.77 - 0.012 * (incident[1] - 10.0)
    noise = np.array([0.2, 0.2, 8.0])[:, None] * rng.standard_normal((3, rows))
    seen = incident
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
        friction = 0.6 * (np.abs(incident[0] - TENNIS[1] * incident[2]) / 14.0) ** -0.35
    elif fault == "group":
        noise[1] += 0.4 * clay
    elif fault == "incidence":
        seen = incident + np.array([[0.9], [0.0], [0.0]]) * rng.standard_normal((3, rows))
    made = np.stack(bounce(*incident, TENNIS, (friction, 0.15, 2e-3, restitution, 0.0))) + noise
    labels = {
        "id": tuple(f"r{k}" for k in range(rows)),
        "group": tuple("clay" if one else "hard" for one in clay),
    }
    names = ("v_x1", "v_y1", "omega_1", *REBOUND)
    return ImpactTable("made", dict(zip(names, [*seen, *made], strict=True)), {}, {}, labels)


def said(table, text="grip-slip", **choices):
    """Problem, linearisation at the maximum near the truth, adequacy."""
    problem = problem_of(table, None, text, **choices)
    start = problem.coordinates({name: START[name.partition("[")[0]] for name in problem.free})
    point = at(problem, descend(Objective(problem), start[None])[0][0])
    first = first_order(problem, point)
    return problem, first, adequacy(problem, point, first)


def kinds(found):
    return {(test.kind, test.column) for test in found.tests if test.found}


def line(bend=0.0, rows=12):
    """A drop test under a nearly straight restitution: two parameters of wide priors, one column,
    two groups.
    """
    speed = np.linspace(4.0, 16.0, rows)
    v_y2 = (0.76 - 0.012 * (speed - 10.0)) * speed + 0.05 * np.random.default_rng(
        8
    ).standard_normal(rows)
    labels = {"id": tuple(map(str, range(rows))), "group": tuple("aab"[k % 3] for k in range(rows))}
    labels["remark"] = tuple(f"w{k}" if k % 2 else "" for k in range(rows))
    table = ImpactTable(
        "drops",
        {"v_y1": speed, "v_y2": v_y2 + bend * (speed - 9.5) ** 2},
        {},
        {},
        labels,
    )
    return said(table, prior={"cor_10": "uniform(0.1, 1)", "cor_slope": "normal(-0.01, 1)"})


def test_a_trend_is_the_t_test_of_one_more_column():
    problem, first, found = line(bend=0.012)
    speed = problem.rows.states.v_y1
    residual = first.residual
    centred = speed - speed.mean()
    design = np.stack([*first.slopes[:12].T, centred], axis=1)
    design[:, :2] /= np.linalg.norm(design[:, :2], axis=0)
    best, rest = np.linalg.lstsq(design, residual, rcond=None)[:2]
    t = best[2] / np.sqrt(rest[0] / 9.0 * np.linalg.inv(design.T @ design)[2, 2])
    alone = 2.0 * stats.t.sf(abs(t), 9)
    both = t**2 / (t**2 + 9.0)
    (trend,) = (test for test in found.tests if test.pattern == "v_y2: trend with v_y1")
    assert trend.explained == pytest.approx(both, rel=1e-3)
    # Its chance among all: shares of the kinds that there are, of 3/5 of 5 %.
    shares = {"trend": 0.25, "drift": 0.15, "bias": 0.1, "row": 0.1, "growth": 0.1, "outlier": 0.05}
    shares |= {"group": 0.1, "parameter": 0.1}
    tested = [test.kind for test in found.tests]
    whole = sum(shares[kind] for kind in {*tested})
    assert trend.p == pytest.approx(
        min(1.0, alone * tested.count("trend") * whole / 0.25 / 0.6),
        rel=1e-2,
    )
    assert trend.p < 1.0
    assert not any("remark" in test.pattern for test in found.tests)


def test_false_alarms_of_a_linear_model_are_rarer_than_promised():
    """400 tables of the linearised model, and the same with a bias of a group: it is found."""
    problem, first, _ = line(rows=24)
    point = at(problem, first.proposal.centre)
    rng = np.random.default_rng(7)
    size = first.residual.size
    bias = first.direction("v_y2", 0.12 * (np.array(problem.table.labels["group"]) == "b"))
    alarms = seen = 0
    for k in range(400):
        clean = rng.standard_normal(size)
        tests = adequacy(problem, point, first._replace(residual=first.after_refit(clean))).tests
        alarms += any(test.found for test in tests)
        if k < 40:
            spoilt = first._replace(residual=first.after_refit(clean + bias))
            seen += any(test.found for test in adequacy(problem, point, spoilt).tests)
    assert 1 <= alarms <= stats.binom.ppf(0.999, 400, EXCEPT)
    assert seen >= 20


def test_how_many_are_far_off_is_the_least_of_beta_bounds():
    own = np.random.default_rng(3).standard_normal(18)
    own[[2, 7, 9]] += 9.0
    own *= np.sqrt(15.0 / np.sum(own**2))
    largest = np.cumsum(np.sort(own**2)[::-1][:3]) / 15.0
    bounds = [comb(18, k) * stats.beta.sf(largest[k - 1], k / 2, (15 - k) / 2) for k in (1, 2, 3)]
    assert farthest(largest, 18, 15.0) == (3, pytest.approx(3.0 * min(bounds), rel=1e-9))
    assert 3.0 * bounds[2] < 1e-3 < bounds[0]


def test_growth_is_a_likelihood_ratio():
    """Of normal densities whose sds are a power of the speed, the power on a grid, by scipy."""
    problem, first, found = said(table_with("growth", 5))
    speed = problem.rows.states.polar()[0][first.rows]
    left = 1.0 - np.sum(first.basis**2, axis=1)
    best = {0: -np.inf, 1: -np.inf}
    for power in np.linspace(-4.0, 4.0, 1601):
        density = 0.0
        for k in range(3):
            own = first.column == k
            z = first.residual[own] / np.sqrt(left[own])
            sd = speed[own] ** power
            density += stats.norm.logpdf(z, scale=sd * np.sqrt(np.mean((z / sd) ** 2))).sum()
        best[1] = max(best[1], density)
        if abs(power) < 1e-9:
            best[0] = density
    alone = stats.chi2.sf(2.0 * (best[1] - best[0]) * left.mean(), 1)
    (growth,) = (test for test in found.tests if test.kind == "growth")
    alone *= module._times(found.tests, "growth")
    assert growth.found
    assert growth.p == pytest.approx(alone, rel=1e-2)
    assert "increases" in growth.pattern


def test_what_is_far_off_is_judged_by_a_fit_to_all_others():
    """Shares of the variance by least squares without the farthest rows, one of them at the end,
    where it pulls.
    """
    problem, first, _ = line(rows=24)
    residual = first.residual.copy()
    residual[[4, 23]] += 9.0 * np.std(residual)
    spoilt = first._replace(residual=first.after_refit(residual))
    tests = adequacy(problem, at(problem, first.proposal.centre), spoilt).tests
    (found,) = (test for test in tests if test.kind == "outlier")
    design = first.slopes[:24, :2]
    left = 1.0 - np.sum(first.basis**2, axis=1)
    order = np.argsort(-np.abs(spoilt.residual) / np.sqrt(left))

    def rest(kept):
        return np.linalg.lstsq(design[kept], residual[kept], rcond=None)[1][0]

    shares = np.array([1.0 - rest(order[k:]) / rest(order) for k in range(1, 5)])
    alone = farthest(shares, 24, float(left[:24].sum()))[1]
    assert found.found
    assert found.p == pytest.approx(
        alone * module._times(tests, "outlier"),
        rel=0.02,
    )


def test_of_noise_alone_no_few_are_far_off():
    """In 900 columns of 24 rows: their residuals, each over its own sd, have more squares than
    there is freedom.
    """
    problem, first, _ = said(table_with("", 5))
    point = at(problem, first.proposal.centre)
    rng = np.random.default_rng(4)
    least = []
    for _ in range(300):
        clean = first._replace(residual=first.after_refit(rng.standard_normal(first.residual.size)))
        least += [
            test.p for test in adequacy(problem, point, clean).tests if test.kind == "outlier"
        ]
    assert len(least) == 900
    assert min(least) > 2e-3
    residual = first.residual.copy()
    residual[np.argmax(np.abs(residual))] *= 20.0
    wild = adequacy(problem, point, first._replace(residual=first.after_refit(residual))).tests
    assert min(test.p for test in wild if test.kind == "outlier") < 2e-3


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
    found = [kinds(said(table_with(fault, seed, rows))[2]) for seed in range(4)]
    assert sum(FAULTS[fault] in one for one in found) >= 3
    clean = [kinds(said(table_with("", seed, rows))[2]) for seed in range(2)]
    assert not any(FAULTS[fault] in one for one in clean)


def test_answers():
    assert [said(table_with("", seed))[2].answer for seed in range(4)].count("describes") >= 3
    _, _, biased = said(table_with("bias"))
    assert biased.answer == "does not describe"
    assert max(biased.moved.values()) > 5.0
    _, _, group = said(table_with("group", rows=60))
    assert group.answer == "describes except"
    assert group.moved["cor_10"] > 1.0 > group.moved["mu"]
    _, _, few = said(table_with(rows=6))
    assert few.answer == "undecided"
    assert min(few.unseen.values()) > 0.6
    # What a bend of the restitution looks like once its slope is fitted.
    for fix, alike in (({}, True), ({"cor_slope": -0.012}, False)):
        tests = said(table_with(seed=1), fix=fix)[2].tests
        assert [
            "v_y1" in one.pattern for one in tests if (one.kind, one.column) == ("bias", "v_y2")
        ] == [alike]


def test_the_remedy_of_surfaces_removes_the_fault():
    table = table_with("surfaces")
    tests = [test for test in said(table)[2].tests if test.found and test.kind == "parameter"]
    assert tests
    assert all("--pool mu=group" in test.pattern for test in tests)
    assert said(table, pool={"mu": "group"})[2].answer == "describes"


def test_three_outliers_do_not_hide_each_other_and_students_t_allows_them():
    _, _, found = said(table_with("wild"))
    (test,) = (test for test in found.tests if test.found and test.kind == "outlier")
    assert all(name in test.pattern for name in ("r3", "r11", "r20"))
    assert said(table_with("wild"), noise="student-t")[2].answer == "describes"


def test_a_pattern_moves_what_follows_from_parameters_that_it_moves_little():
    """Drops from one height, one of two balls higher: in sds of the rebound, by a regression with
    that ball.
    """
    speed = np.linspace(7.0, 7.1, 12)
    high = np.arange(12) % 2
    values = {"v_y1": speed, "v_y2": 0.74 * speed + 0.1 * high + 0.01 * np.sin(5.0 * speed)}
    labels = {"id": tuple("abcdefghijkl"), "group": tuple("xy"[k] for k in high)}
    problem, first, _ = said(ImpactTable("drops", values, {}, {}, labels))
    found = adequacy(problem, at(problem, first.proposal.centre), first, problem.derived)
    padded = np.zeros((2, len(first.slopes)))
    padded[:, :12] = first.residual, first.direction("v_y2", 1.0 * high)
    designs = first.slopes, np.column_stack([first.slopes, padded[1]])
    without, both = (np.linalg.lstsq(design, padded[0], rcond=None)[0][:2] for design in designs)
    # A drop from 254 cm lands with 7.06 m/s, as the seventh does.
    rate = first.slopes[6]
    sd = np.sqrt(rate @ np.linalg.inv(first.slopes.T @ first.slopes) @ rate)
    assert found.moved["cor_254cm"] == pytest.approx(abs(rate @ (both - without)) / sd, rel=0.05)
    assert (
        found.moved["cor_254cm"] > 1.0 > 2.0 * max(found.moved["cor_10"], found.moved["cor_slope"])
    )


def test_columns_of_few_measurements_are_not_vouched_for_by_others():
    table = table_with()
    values = {
        **table.values,
        "omega_2": np.where(np.arange(24) < 5, table.values["omega_2"], np.nan),
    }
    _, _, found = said(replace(table, values=values))
    assert found.answer == "undecided"
    assert found.unseen["omega_2"] > 0.6 > found.unseen["v_y2"]


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
    _, first, found = said(table, fix={"v_y_sd": 0.0})
    (check,) = (check for check in found.noise if check.column == "v_y2")
    own = first.residual[first.column == 1]
    freedom = 40 - np.sum(first.basis[first.column == 1] ** 2)
    assert check.stated
    assert check.reference == pytest.approx(stated)
    assert check.size == pytest.approx(stated * np.sqrt(own @ own / freedom))
    assert found.answer == answer
    assert (
        check.found == (stats.chi2.sf(own @ own, freedom) * 7.5 < 0.05) == (answer != "describes")
    )


def test_an_expected_noise_is_an_exception_from_three_times():
    for size, answer in ((2.0, False), (4.0, True)):
        _, _, found = said(table_with(), prior={"v_y_sd": f"lognormal({0.2 / size}, 0.7)"})
        (check,) = (check for check in found.noise if check.column == "v_y2")
        assert not (check.stated or check.beyond)
        assert check.reference == pytest.approx(0.2 / size)
        assert check.found is answer
    # Of a column with stated errors it is the scatter beyond these.
    table = table_with()
    _, _, found = said(replace(table, sd={"v_y2": np.full(len(table), 0.1)}))
    assert [check.column for check in found.noise if check.beyond] == ["v_y2"]


def test_few_impacts_of_a_good_model_are_no_misfit():
    """Columns with next to no freedom lend each other some: no test may take that for a pattern."""
    found = [said(table_with(seed=seed, rows=4))[2] for seed in range(40)]
    assert sum(any(test.found for test in one.tests) for one in found) <= 0.06 * len(found)
    assert not any(one.answer == "does not describe" for one in found)
    biased = [said(table_with("bias", seed=seed, rows=8))[2] for seed in range(4)]
    assert sum(any(test.found for test in one.tests) for one in biased) >= 2


def test_a_camera_that_is_off_is_named_with_its_size():
    table = table_of(TIMED, count=40)
    problem = problem_of(table, scene_of(camera=True), "two-mass")
    x = near(problem, 1, 0.0)
    tilted = {**problem.values(x), "tilt": np.array([0.03])}
    seen = problem.seen(tilted)
    rng = np.random.default_rng(2)
    sds = (0.21, 0.17, 6.0, 1.5e-4, 1e-4, 1e-3, 0.03)
    made = {
        name: seen.column(name)[0] + sd * rng.standard_normal(40)
        for name, sd in zip(TIMED, sds, strict=True)
    }
    found = {}
    for camera in (False, True):
        problem = problem_of(
            replace(table, values={**table.values, **made}),
            scene_of(camera=camera),
            "two-mass",
        )
        point = at(problem, descend(Objective(problem), near(problem, 1, 0.0))[0][0])
        found[camera] = adequacy(problem, point, first_order(problem, point))
    tests = {
        test.pattern.partition(" ")[0]: test for test in found[False].tests if test.kind == "camera"
    }
    assert set(tests) == {"scale", "clock", "tilt", "court_height"}
    assert tests["tilt"].found
    # Only the height of the court could explain as much.
    assert sorted(tests.values(), key=lambda test: test.p)[1].p >= tests["tilt"].p
    assert not any(test.kind == "camera" for test in found[True].tests)


def test_long_tables_are_tested_thinned(monkeypatch):
    """A sure pattern that is too small is no exception, and moves what is known all the same."""
    monkeypatch.setattr(thinning, "LONG", 600)
    table = table_with("constant", rows=1200)
    assert said(table)[2].answer == "describes"
    bias = 0.2 * (np.array(table.labels["group"]) == "clay")
    table = replace(table, values={**table.values, "v_y2": table.values["v_y2"] + bias})
    _, first, found = said(table)
    assert len(first.residual) == 1800
    assert found.answer == "describes except"
    assert found.moved["cor_10"] > 2.0
    monkeypatch.setattr(module, "SMALL", 2.0)
    _, _, fine = said(table)
    assert fine.answer == "describes"
    assert fine.moved == found.moved


def test_chances_have_the_same_last_digit_in_each_process(monkeypatch):
    monkeypatch.setattr(module, "SHARES", dict.fromkeys("abcdefghij", 0.1))
    looks = [module._Look(kind, "", "", 0.5) for kind in module.SHARES]
    assert module._times(looks, "a") == module.OF_PATTERNS / 0.1
