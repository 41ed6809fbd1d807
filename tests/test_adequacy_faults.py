"""Faults that a table may have, each said as what it is: tables of code that shares nothing with the models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from samples import GRIP_SLIP, TWO_MASS
from scipy.optimize import minimize_scalar
from scipy.special import comb
from scipy.stats import beta, f, norm
from validation.scenarios import INERTIA_RATIO, MASS, RADIUS, foreign_rebound, foreign_text

from fitball.data.read import load_table
from fitball.data.scene import Scene, load_scene
from fitball.inference.adequacy import describe, looks
from fitball.inference.adequacy.describe import adequacy
from fitball.inference.adequacy.looks import Tables, farthest, spreads, uneven
from fitball.inference.adequacy.refit import patterns, refit
from fitball.inference.adequacy.words import strongest
from fitball.inference.assemble import qualified
from fitball.inference.point.point_fit import maximum_posterior
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.results import sentences
from fitball.inference.results.assumptions import Alternative, Assumptions, ElpdDifference
from fitball.inference.results.evidence import Answer, Check
from fitball.inference.results.results import Verdict
from fitball.models.registry import model
from fitball.values import Ball, Impacts

START = {**TWO_MASS, **GRIP_SLIP, "mu": 0.6, "spin_sd": 8.0, "degrees_of_freedom": 8.0}
NOTHING = load_scene(None)


def foreign(folder, name, size=1.0, seed=5):
    place = folder / f"{name}.csv"
    place.write_text(foreign_text(name, size, np.random.default_rng(seed)), encoding="utf-8")
    return load_table(place)


def fitted(table, fitted_model="grip-slip", scene=NOTHING, **choices):
    # One value for all surfaces, so that what differs is a fault.
    choices = {"pool": {"all": "none"}, **choices}
    problem = build_problem(table, scene, Choices(model=fitted_model, **choices))
    return problem, maximum_posterior(problem, np.array([[START[name] for name in problem.free_names]]))


def said(table, fitted_model="grip-slip", scene=NOTHING, assumptions=None, **choices):
    problem, point = fitted(table, fitted_model, scene, **choices)
    return problem, adequacy(problem, point, None, 1, assumptions)


def ordered(table, by):
    """The same table with its rows in the order of `by` (rows,)."""
    order = np.argsort(by)
    measured = tuple(replace(item, values=item.values[order]) for item in table.measurements)
    return replace(table, impacts=table.impacts.take(order), measurements=measured)


class Judged:
    """An identified parameter."""

    verdict = Verdict.IDENTIFIED
    given = ()


def test_the_other_code_bounces_as_the_model_that_it_stands_for():
    rng = np.random.default_rng(1)
    incident = np.stack([rng.uniform(2, 25, 50), rng.uniform(3, 20, 50), rng.uniform(-300, 300, 50)])
    friction, restitution = rng.uniform(0.3, 0.8, 50), rng.uniform(0.6, 0.8, 50)
    made = foreign_rebound(incident, friction, restitution)
    ball = Ball(MASS, RADIUS, INERTIA_RATIO * MASS * RADIUS**2)
    for k in range(50):
        values = {"mu": friction[k], "e_x": 0.15, "offset": 2e-3, "cor_10": restitution[k], "cor_slope": 0.0}
        one = model("grip-slip", ball=ball).rebound(values, Impacts(*incident[:, k : k + 1]))
        np.testing.assert_allclose(made[:, k], [one.v_x2[0], one.v_y2[0], one.omega_2[0]], rtol=1e-12)


# Of each fault the words that name it, with each model.
NAMED = {
    "bias": "v_x2 is biased in all rows", "growing": sentences.GROWS.format(quantity="v_1"),
    "drift": " along the rows", "surfaces": "mu differs for surface",
}  # fmt: skip


@pytest.mark.parametrize("name", NAMED)
@pytest.mark.parametrize("fitted_model", ["grip-slip", "two-mass"])
def test_a_fault_is_called_by_its_name(name, fitted_model, tmp_path):
    """In most of some tables, whatever the draws."""
    words = 0
    for seed in range(3):
        _, found = said(foreign(tmp_path, name, seed=seed), fitted_model)
        words += any(NAMED[name] in text for text in found.exceptions)
    assert words >= 2


def test_good_tables_have_no_fault(tmp_path):
    answers = [said(foreign(tmp_path, "clean", seed=seed))[1].answer for seed in range(4)]
    assert answers.count(Answer.DESCRIBES) >= 3


def test_a_model_that_is_too_simple_leaves_a_bias(tmp_path):
    """A ball that rolls off leaves with another velocity than one that is wound up, in every row."""
    _, found = said(foreign(tmp_path, "clean"), "brody")
    assert any(text.startswith("v_x2 is biased in all rows") for text in found.exceptions)
    assert found.answer is Answer.FAILS


def test_a_drift_names_the_order_that_the_rows_are_in(tmp_path):
    table = foreign(tmp_path, "drift")
    plain = [check for check in said(table)[1].checks if check.kind == "row"]
    assert plain and not any("order of" in check.words for check in plain)
    angle = np.arctan2(table.impacts.v_y1, table.impacts.v_x1)
    nearly = angle + 0.12 * np.random.default_rng(1).standard_normal(angle.size)
    rows = [check for check in said(ordered(table, nearly))[1].checks if check.kind == "row"]
    assert rows and all("(in the order of theta_1)" in check.words for check in rows)
    # In exactly that order a drift is a trend over the angle, and called that.
    kinds = {check.kind for check in said(ordered(table, angle))[1].checks if check.column == "v_y2"}
    assert "trend" in kinds and "row" not in kinds


def test_the_growth_of_a_noise_is_a_likelihood_ratio(tmp_path):
    """The signed root of it, against a search by scipy over one exponent and three scales."""
    problem, point = fitted(foreign(tmp_path, "growing"))
    fit = refit(problem, point)
    observed = Tables(fit, fit.measured[None, :])
    (look,) = (
        one
        for one in spreads(observed, {"v_1": np.hypot(problem.impacts.v_x1, problem.impacts.v_y1)})
        if one.over == "v_1"
    )
    residual = fit.measured / np.sqrt(1.0 - fit.leverage)
    speed = np.concatenate([np.hypot(problem.impacts.v_x1, problem.impacts.v_y1)[places] for places in fit.places])

    def minus(exponent):
        total = 0.0
        for number, freedom in enumerate(fit.freedom):
            mine = fit.noise == number
            shape = speed[mine] / np.exp(np.log(speed[mine]).mean())
            total += 0.5 * freedom * np.log(np.sum((residual[mine] / shape**exponent) ** 2))
        return total

    best = minimize_scalar(minus, bounds=(-5.0, 5.0), method="bounded", options={"xatol": 1e-8})
    assert best.x > 0.3
    assert float(look.seen[0]) == pytest.approx(np.sqrt(2.0 * (minus(0.0) - best.fun)), rel=1e-5)
    # Noise that falls has the other sign.
    down = next(iter(spreads(observed, {"v_1": 1.0 / speed[:24]})))
    assert float(down.seen[0]) == pytest.approx(-float(look.seen[0]), rel=1e-5)


def test_of_equally_sure_patterns_those_that_name_an_impact_are_first():
    """One row with a wrong unit makes the noise seem to change with all that it is far out in."""
    known = {"statistic": 9.0, "usual": 2.0, "explained": None, "size": None, "found": True}
    fading = Check("uneven", "all columns", "v_1", "the noise decreases with v_1", p=0.001, **known)
    far = Check("outlier", "v_2", "impacts", "impact 15 is an outlier", p=0.001, **known)
    trend = Check("trend", "omega_2", "theta_1", "trend with theta_1", p=0.0005, **known)
    assert strongest([fading, far, trend]) == [trend, far, fading]


@pytest.mark.parametrize("fitted_model", ["grip-slip", "two-mass"])
def test_three_outliers_do_not_hide_each_other(fitted_model, tmp_path):
    """Each is named, and no other; the noise that they make is given the kind of noise."""
    table = foreign(tmp_path, "wild", seed=8)
    problem, found = said(table, fitted_model)
    clean = foreign_rebound(
        np.stack([table.impacts.v_x1, table.impacts.v_y1, table.impacts.omega_1]),
        np.full(24, 0.6),
        0.77 - 0.012 * (table.impacts.v_y1 - 10.0),
    )
    far = np.flatnonzero(np.abs(table.measurement("omega_2").values - clean[2]) > 40.0)
    assert far.size == 3
    (check,) = (one for one in found.checks if one.kind == "outlier" and one.column == "omega_2")
    assert check.found
    named = check.words.partition("impacts ")[2].partition(" are")[0].split(", ")
    assert sorted(named) == sorted(table.ids[k] for k in far)
    assert qualified("spin_sd", Judged(), found, None) == (Verdict.GIVEN, ("noise=normal",))
    assert qualified("v_y_sd", Judged(), found, None)[0] is not Verdict.GIVEN
    assert "cor_10" in problem.free_names
    assert not said(table, fitted_model, noise="student-t")[1].given


def test_how_far_off_some_are_is_a_bound_on_a_share_of_the_variance():
    """Of one the largest of n squares, as a beta variable each; of more the least over their number."""
    rng = np.random.default_rng(3)
    own = rng.standard_normal((4, 18))
    own[1, [2, 7, 9]] += 9.0
    own *= np.sqrt(15.0 / np.sum(own**2, axis=1, keepdims=True))
    count, p = farthest(own, 15.0)
    squares = np.sort(own**2, axis=1)[:, ::-1]
    bounds = np.stack(
        [comb(18, k) * beta.sf(squares[:, :k].sum(axis=1) / 15.0, k / 2, (15 - k) / 2) for k in (1, 2, 3)], axis=1
    )
    np.testing.assert_allclose(p, np.minimum(bounds.min(axis=1), 1.0), rtol=1e-9)
    assert count[1] == 3 and p[1] < 1e-3 < bounds[1, 0]
    # Few are looked at one at a time.
    assert farthest(own[:, :7], 5.0)[0].tolist() == [1, 1, 1, 1]


def test_columns_that_share_a_noise_are_compared(tmp_path):
    table = foreign(tmp_path, "clean")
    spoilt = tuple(
        replace(item, values=item.values + (1.5 * np.random.default_rng(2).standard_normal(24) if k == 0 else 0.0))
        for k, item in enumerate(table.measurements)
    )
    problem, point = fitted(replace(table, measurements=spoilt), velocity_noise="tied")
    fit = refit(problem, point)
    (look,) = uneven(Tables(fit, fit.measured[None, :]))
    sizes = [np.sum(fit.measured[fit.rows(k)] ** 2) for k in (0, 1)]
    freedom = [np.sum(1.0 - fit.leverage[fit.rows(k)]) for k in (0, 1)]
    ratio = (sizes[0] / freedom[0]) / (sizes[1] / freedom[1])
    assert float(look.seen[0]) == pytest.approx(np.log(ratio))
    assert float(look.p[0]) == pytest.approx(2.0 * f.sf(ratio, *freedom), rel=1e-6)
    _, found = said(replace(table, measurements=spoilt), velocity_noise="tied")
    assert any(check.found for check in found.checks if check.kind == "uneven")
    # With a noise of its own each there is nothing to compare.
    assert not list(uneven(Tables(refit(*fitted(table)), fit.measured[None, :])))


def test_one_column_does_not_vouch_for_another(tmp_path):
    table = foreign(tmp_path, "clean")
    few = tuple(
        replace(item, values=np.where(np.arange(24) < 5, item.values, np.nan)) if item.name == "omega_2" else item
        for item in table.measurements
    )
    _, found = said(replace(table, measurements=few))
    assert found.unseen["omega_2"] > 0.6 > found.unseen["v_y2"]
    assert found.answer is Answer.UNDECIDED
    assert found.sentence.startswith("Five measurements") and " omega_2" in found.sentence
    assert sentences.ELSEWHERE.format(columns="v_x2 and v_y2") in found.sentence


def alternative(name, instead_of, value, se):
    return Alternative(name, instead_of, ElpdDifference(value, se), "", {}, {}, {})


@pytest.mark.parametrize(
    ("gain", "answer"), [(10.0, Answer.EXCEPT), (4.0, Answer.DESCRIBES), (-10.0, Answer.DESCRIBES)]
)
def test_what_fits_surely_better_is_an_exception(gain, answer, tmp_path):
    changes = (alternative("noise=student-t", "noise=normal", gain, 3.0),)
    _, found = said(foreign(tmp_path, "clean"), assumptions=Assumptions(changes, {}, {}))
    assert found.answer is answer
    better = answer is Answer.EXCEPT
    assert ("noise=student-t" in found.sentence) is better
    assert bool(found.exceptions) is better
    assert found.given == (dict.fromkeys(("v_x_sd", "v_y_sd", "spin_sd"), ("noise=normal",)) if better else {})
    # Another closure says nothing of the noise.
    closure = alternative("cor=saturating", "cor=line", gain, 3.0)
    _, other = said(foreign(tmp_path, "clean"), assumptions=Assumptions((closure,), {}, {}))
    assert other.answer is answer and not other.given


def test_one_of_many_closures_has_to_be_better_by_more():
    """A gain of 2.2 errors has a chance of one in 72; among twenty that is no surprise (Bonferroni)."""
    one = alternative("cor=saturating", "cor=line", 11.0, 5.0)
    others = tuple(alternative(f"normal={k}", "normal=momentum", -1.0, 1.0) for k in range(19))
    noise = alternative("noise=student-t", "noise=normal", 11.0, 5.0)
    assert describe.surely_better((one,)) == (one,)
    assert describe.surely_better((one, *others, noise)) == (noise,)
    sure = alternative("cor=saturating", "cor=line", 5.0 * norm.isf(norm.sf(2.0) / 20) + 1e-6, 5.0)
    assert describe.surely_better((sure, *others)) == (sure,)


def test_a_noise_three_times_the_scenes_is_an_exception_three_times_the_usual_a_sentence(tmp_path):
    table = foreign(tmp_path, "clean")
    large = np.random.default_rng(4).permutation(np.linspace(-1.0, 1.0, 24))
    scaled = tuple(
        replace(item, values=item.values + 60.0 * large) if item.name == "omega_2" else item
        for item in table.measurements
    )
    noisy = replace(table, measurements=scaled)
    place = tmp_path / "scene.toml"
    place.write_text("[measurement]\nnominal_spin_sd = 10.0\n", encoding="utf-8")
    _, silent = said(noisy)
    _, stated = said(noisy, scene=load_scene(None, place))
    own, its = (next(check for check in one.noise if check.noise == "spin_sd") for one in (silent, stated))
    assert own.ratio == pytest.approx(its.ratio) and own.ratio > 3.0
    assert own.assumed and not own.found
    assert its.found and not its.assumed
    wide = sentences.WIDE_RATIO.format(columns="omega_2", ratio=f"{own.ratio:.2g}")
    assert wide in silent.sentence and wide not in stated.sentence
    assert stated.answer is not Answer.DESCRIBES
    # A wide prior that somebody chose says that such a noise is no surprise.
    _, wide = said(noisy, scene=Scene(), priors={"spin_sd": "lognormal(10, 1.5)"})
    assert not next(check for check in wide.noise if check.noise == "spin_sd").found


def test_friction_of_a_surface_shows_where_balls_grip_at_the_mean(tmp_path):
    """The change of friction that is looked for is one at which balls that grip begin to slide."""
    problem, point = fitted(foreign(tmp_path, "surfaces"))
    fit = refit(problem, point)
    moved = np.count_nonzero(np.abs(fit.effects["mu"][fit.rows(0)]) > 1e-6)
    values = np.array([[point.values[name] for name in problem.free_names]])
    kinds = problem.rebound(values).regime[0]
    sliding = np.count_nonzero(kinds == np.bincount(kinds).argmin()) if np.unique(kinds).size > 1 else 0
    assert moved > sliding
    assert {item.kind for item in patterns(problem, point, fit) if item.column < 0} == {"drift", "level"}


def test_every_kind_of_check_has_its_share_of_the_chance():
    assert {kind.tier for kind in looks.KINDS.values()} == set(range(len(looks.TIERS)))
    assert sum(looks.TIERS) == pytest.approx(1.0)
    assert sum(1.0 / times for times in (describe.OF_PATTERNS, describe.OF_NOISE)) == pytest.approx(1.0)
