"""What rests on an assumption: quick posteriors against closed forms, ranges over assumptions against truths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from samples import TWO_MASS, drop_table, linear_problem, problem_of, synthetic
from scipy.stats import norm

import fitball
from fitball.data.read import load_table
from fitball.inference.adequacy.made_tables import loo_pit
from fitball.inference.assemble import qualified
from fitball.inference.assumptions.look import ROWS, Compared, Fitted, alternatives, assumptions_generator, look
from fitball.inference.identifiability.information import about
from fitball.inference.identifiability.verdict import Judgement
from fitball.inference.likelihood.posterior import pointwise
from fitball.inference.point.point_fit import maximum_posterior
from fitball.inference.prediction.new_impacts import predict_new, with_assumptions
from fitball.inference.results.assumptions import MOVED, Summary, elpd_difference, reach, span, summary
from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.results import Posterior, Verdict
from fitball.inference.sampling.importance import equal_draws, importance_posterior, smoothed_elpd
from fitball.values import Ball

COURT = {"e_x": 0.1, "offset": 0.002, "cor_10": 0.77, "cor_slope": -0.012}
GRIPS_OFF_CENTRE = {**TWO_MASS, "mu": 0.53, "eps_10": 5.5e-3}


def looked(problem, near):
    """The look at a fit whose search begins `near` its optimum."""
    point = maximum_posterior(problem, np.array([[near[name] for name in problem.free_names]]))
    return look(problem, point, None, assumptions_generator(1))


def names(problem):
    rng = np.random.default_rng(3)
    probes = problem.to_coordinates(problem.prior.draw(rng, 200))
    return [change.name for change in alternatives(problem, probes)]


def of_other_closure(seed):
    """A table whose balls feel the offset while they grip only, fitted as if they felt it throughout."""
    problem = problem_of("wang_all.csv", without=("contact_time",))
    truth = {name: GRIPS_OFF_CENTRE[name] for name in problem.free_names}
    made = synthetic(problem_of("wang_all.csv", without=("contact_time",), closures={"offset": "grip"}), truth, seed)
    return problem_of(made.table, scene=problem.scene), truth


def closed_form(problem):
    """Of a line with a noise of 0.05: mean and covariance of its coefficients, and what all others predict of each
    measurement, less that: a residual and a variance that follow from its leverage.
    """
    speeds, measured = problem.impacts.v_y1, problem.observables[0].observed
    design = np.stack([speeds, speeds * (speeds - 10.0)], axis=1) / 0.05
    covariance = np.linalg.inv(design.T @ design)
    mean = covariance @ design.T @ (measured / 0.05)
    leverage = np.einsum("ij,jk,ik->i", design, covariance, design)
    return (
        mean,
        covariance,
        norm((measured - 0.05 * design @ mean) / (leverage - 1.0), 0.05 / np.sqrt(1.0 - leverage)),
    )


@pytest.fixture(scope="module")
def deceived():
    problem, truth = of_other_closure(5)
    return looked(problem, TWO_MASS), truth


def test_a_linear_normal_posterior_and_its_left_out_scores_are_those_of_the_closed_form():
    problem = linear_problem(drop_table(np.random.default_rng(8)), v_y_sd=0.05)
    mean, covariance, left_out = closed_form(problem)
    # So far away that several rounds are needed, whose proposals differ in place and size.
    start = problem.to_coordinates((mean + 6.0 * np.sqrt(np.diag(covariance)) * np.array([1.0, -1.0]))[None, :])
    draws = importance_posterior(problem, [about(problem, start[0])], np.random.default_rng(2))
    assert len(draws.values) > 600
    assert problem.free_names == ("cor_10", "cor_slope")
    assert draws.effective >= 400.0
    for k in range(2):
        sd = np.sqrt(covariance[k, k])
        told = summary(draws.values[:, k], np.exp(draws.log_weights))
        assert told.sd == pytest.approx(sd, rel=0.15)
        wanted = norm.ppf([0.025, 0.5, 0.975], mean[k], sd)
        np.testing.assert_allclose([told.q025, told.median, told.q975], wanted, atol=0.35 * sd)
    exact = left_out.logpdf(0.0)
    whole, scored = pointwise(problem, draws.values, ["v_y2"])
    elpd, _k = smoothed_elpd(whole, scored, 1.0, draws.log_weights)
    np.testing.assert_allclose(elpd, exact, atol=0.25)
    # Weights left out of the score, or of the posterior, show.
    unweighted, _k = smoothed_elpd(whole, scored, 1.0)
    assert np.abs(unweighted - exact).max() > np.abs(elpd - exact).max()


def test_an_impact_whose_weights_are_not_to_be_trusted_is_refitted():
    """The one fast impact of a drop test, off the line of the others: its score, and its place among predictions,
    against the conjugate normal.
    """
    rng = np.random.default_rng(3)
    speeds = np.append(np.linspace(4.0, 6.0, 8), 9.0)
    measured = (0.76 - 0.014 * (speeds - 10.0)) * speeds + 0.05 * rng.standard_normal(9) + 0.4 * (speeds == 9.0)
    table = drop_table(rng)
    table = replace(
        table,
        impacts=fitball.impacts(v_x1=0.0 * speeds, v_y1=speeds, omega_1=0.0),
        measurements=(replace(table.measurement("v_y2"), values=measured),),
    )
    problem = linear_problem(table, v_y_sd=0.05)
    mean, covariance, left_out = closed_form(problem)
    values = mean + rng.standard_normal((2000, 2)) @ np.linalg.cholesky(covariance).T
    whole, scored = pointwise(problem, values, ["v_y2"])
    alone, pareto_k = smoothed_elpd(whole, scored, 1.0)
    exact = left_out.logpdf(0.0)
    assert pareto_k[8] > 0.7
    assert abs(alone[8] - exact[8]) > 1.0
    np.testing.assert_allclose(Fitted(problem, equal_draws(values)).elpd(rng), exact, atol=0.3)
    posterior = Posterior(problem.free_names, values.reshape(2, 10, 100, 2), np.zeros((2, 10, 100)), values)
    np.testing.assert_allclose(loo_pit(problem, posterior, rng)[0], left_out.cdf(0.0), atol=0.08)


def test_every_choice_that_acts_is_changed_one_at_a_time(tmp_path):
    assert names(problem_of("wang_all.csv")) == [
        "release=zero_displacement", "normal=inner", "normal=total", "offset=grip", "spin=shell", "inertia=table",
        "torsion=free", "torsion=rigid", "cor=mean", "cor=saturating", "noise=student-t",
    ]  # fmt: skip
    # `repeat` states all priors, among them that of a noise which a model that is told v_y2 has not.
    assert "cor=measured" not in names(problem_of("wang_all.csv", priors={"v_y_sd": "lognormal(0.25, 0.7)"}))
    assert names(problem_of("wang_all.csv", noise="student-t"))[-1] == "noise=normal"
    assert names(problem_of("wang_all.csv", "brody")) == ["cor=saturating", "noise=student-t"]
    # A ball that turns as one has neither a twist nor a split of its inertia; without spin it is such a ball.
    rigid = names(problem_of("wang_all.csv", closures={"torsion": "rigid"}))
    assert not {"spin=shell", "inertia=table"} & set(rigid)
    spinless = tmp_path / "spinless.csv"
    spinless.write_text("v_x1,v_y1,v_x2,v_y2\n12,5,9,4\n12,7,8,5.4\n11,9,7,6.8\n14,6,10,4.7\n", encoding="utf-8")
    changed = ["release=zero_displacement", "cor=mean", "cor=saturating", "noise=student-t"]
    assert names(problem_of(spinless)) == changed
    assert "cor=mean" in names(problem_of(drop_table(np.random.default_rng(1))))
    # A model that is told a column has no score to set beside one that is not.
    told = names(problem_of("wang_all.csv", closures={"cor": "measured"}))
    assert told
    assert not [name for name in told if name.startswith("cor=")]


def test_knowledge_of_a_parameter_that_an_alternative_lacks_is_left_behind():
    problem = problem_of(
        "wang_all.csv", closures={"torsion": "free"}, priors={"zeta_theta": "lognormal(0.4, 0.5)"}, fix={"k_y": 2e4}
    )
    probes = problem.to_coordinates(problem.prior.draw(np.random.default_rng(1), 20))
    posed = {change.name: change.problem for change in alternatives(problem, probes)}
    assert "zeta_theta" not in posed["torsion=matched"].free_names
    assert "k_y" not in posed["torsion=matched"].free_names
    kept = {item.name: item.prior.text for item in posed["offset=grip"].free}
    assert kept["zeta_theta"] == "lognormal(0.4, 0.5)"


def test_an_alternative_is_the_same_problem_where_defaults_are_stated():
    """As `repeat` states them: of a ball that turns as one the stiffness acts nowhere, stated or not."""
    silent = problem_of("wang_all.csv", without=("contact_time",))
    stated = problem_of(
        "wang_all.csv", without=("contact_time",), priors={item.name: item.prior.text for item in silent.free}
    )
    probes = silent.to_coordinates(silent.prior.draw(np.random.default_rng(1), 20))
    for one, other in zip(alternatives(silent, probes), alternatives(stated, probes), strict=True):
        assert (one.name, one.problem.free_names) == (other.name, other.problem.free_names)


def test_the_range_over_assumptions_holds_a_truth_that_the_assumed_closure_misses(deceived):
    found, truth = deceived
    eps = found.parameters["eps_10"]
    assert not eps.own.q025 < truth["eps_10"] < eps.own.q975
    assert eps.q025 < truth["eps_10"] < eps.q975
    assert "offset=contact" in eps.given
    assert eps.shift > MOVED
    grips = next(item for item in found.alternatives if item.name == "offset=grip")
    assert grips.as_good
    assert grips.difference.value > 0.0
    # What the table refuses takes no part: a joint that does not twist lies far from all others.
    rigid = next(item for item in found.alternatives if item.name == "torsion=rigid")
    assert not rigid.as_good
    assert rigid.name not in {item.by for item in found.parameters.values()}


def test_the_same_seed_sees_the_same(deceived):
    found, _truth = deceived
    assert looked(of_other_closure(5)[0], TWO_MASS) == found


def test_of_balls_that_slide_throughout_friction_rests_on_no_twist_nor_release():
    """Their rebound is algebraic in friction, offset and restitution: only what the court feels counts."""
    problem = problem_of("wang_all.csv")
    shallow = replace(
        problem.table,
        impacts=fitball.impacts(v_x1=np.linspace(24.0, 34.0, 21), v_y1=np.linspace(4.0, 7.0, 21), omega_1=20.0),
    )
    truth = {name: TWO_MASS[name] for name in problem.free_names} | {"mu": 0.4, "mass_ratio": 0.92}
    table = synthetic(replace(problem, table=shallow, impacts=shallow.impacts), truth, 3).table
    found = looked(problem_of(table, scene=problem.scene), truth)
    own = found.parameters["mu"].own
    by_name = {item.name: item for item in found.alternatives}
    for name in ("torsion=rigid", "torsion=free", "inertia=table", "normal=total"):
        assert by_name[name].as_good, name
        assert abs(by_name[name].parameters["mu"].median - own.median) < 0.5 * own.sd, name
    # Without the landing impulse the same friction force asks for a larger coefficient.
    assert by_name["normal=inner"].parameters["mu"].median > own.median + own.sd
    assert found.parameters["mu"].given == ("normal=momentum",)


def test_of_few_impacts_no_alternative_is_refused():
    """Less data is no stronger verdict: with five rows scores mean nothing, and what moves a value still does."""
    table = replace(load_table("wang_all.csv"), redundant=())
    rows = np.array([0, 4, 8, 12, 16])
    part = replace(
        table,
        impacts=table.impacts.take(rows),
        ids=tuple(map(str, range(5))),
        labels={},
        measurements=tuple(replace(item, values=item.values[rows]) for item in table.measurements),
    )
    problem = problem_of(part)
    found = looked(problem, TWO_MASS | {"velocity_sd": 0.3})
    assert found.examined
    assert len(found.as_good) == len(found.alternatives) > 8
    assert all(item.difference is None for item in found.alternatives)
    told = Judgement(0.9, Verdict.IDENTIFIED, "")
    given = {name for name in problem.free_names if qualified(name, told, None, found)[0] is Verdict.GIVEN}
    assert {"mu", "eps_10"} <= given


def test_of_long_tables_and_many_parameters_all_is_to_first_order():
    """Against the hat matrix, where it is exact but for squares of leverages; and like is held against like."""
    problem = linear_problem(drop_table(np.random.default_rng(8), ROWS + 40), v_y_sd=0.05)
    mean, covariance, left_out = closed_form(problem)
    exact = left_out.logpdf(0.0)
    point = maximum_posterior(problem, mean[None, :])
    linear = Compared(problem, point, None, np.random.default_rng(1)).linear
    np.testing.assert_allclose(linear.elpd(np.random.default_rng(1)), exact, atol=0.05)
    for k in range(2):
        assert linear.parameters(problem.noise)[problem.free_names[k]].sd == pytest.approx(
            np.sqrt(covariance[k, k]), rel=0.1
        )
    found = look(problem, point, None, assumptions_generator(1))
    assert found.examined
    assert all(item.difference is not None for item in found.alternatives)


def test_what_could_not_be_examined_is_said_in_the_verdict(deceived):
    found, _truth = deceived
    told = Judgement(0.9, Verdict.IDENTIFIED, "")
    missing = replace(found, alternatives=(), parameters={}, missing="a reason")
    assert qualified("cor_10", told, None, missing) == (Verdict.UNEXAMINED, ())
    unsettled = replace(found.alternatives[0], difference=None, reason="a reason", unsettled=True)
    partly = replace(found, alternatives=(unsettled, *found.alternatives[1:]))
    assert qualified("cor_10", told, None, partly) == (Verdict.UNEXAMINED, ())
    assert qualified("eps_10", told, None, partly)[0] is Verdict.GIVEN
    assert qualified("cor_10", replace(told, verdict=Verdict.ONE_SIDED), None, missing)[0] is Verdict.ONE_SIDED


def test_a_value_rests_on_a_choice_where_another_moves_it_or_widens_it():
    own = Summary(1.0, 0.1, 0.8, 1.2)
    moved, wide, still = Summary(1.25, 0.1, 1.05, 1.45), Summary(1.0, 0.25, 0.5, 1.5), Summary(1.1, 0.1, 0.9, 1.3)
    assert reach(own, moved) == pytest.approx(2.5)
    assert reach(own, wide) == pytest.approx(3.0)
    assert reach(own, still) == pytest.approx(1.0)
    # A narrower one within the interval moves nothing.
    assert reach(own, Summary(1.0, 0.01, 0.98, 1.02)) == 0.0
    found = span(own, [("a=2", "a=1", moved), ("b=2", "b=1", wide), ("c=2", "c=1", still), ("a=3", "a=1", wide)])
    assert found.given == ("b=1", "a=1")
    assert (found.low, found.high, found.q025, found.q975) == (1.0, 1.25, 0.5, 1.5)
    assert (found.by, found.shift) == ("a=2", pytest.approx(2.5))
    assert span(own, []).given == ()


def test_a_difference_is_sure_beyond_two_errors_and_four():
    rng = np.random.default_rng(1)
    one, other = rng.standard_normal(30), rng.standard_normal(30)
    made = elpd_difference(one, other)
    assert made.value == pytest.approx(one.sum() - other.sum())
    assert made.se == pytest.approx(np.sqrt(30.0) * np.std(one - other, ddof=1))
    assert not replace(made, value=-3.9, se=0.1).sure
    assert not replace(made, value=-9.0, se=4.6).sure
    assert replace(made, value=-9.0, se=4.4).sure


def test_identified_becomes_given_where_an_assumption_moves_it(deceived):
    found, _truth = deceived
    told = Judgement(0.9, Verdict.IDENTIFIED, "")
    assert qualified("eps_10", told, None, found)[0] is Verdict.GIVEN
    assert qualified("cor_10", told, None, found) == (Verdict.IDENTIFIED, ())
    assert qualified("eps_10", replace(told, verdict=Verdict.ONE_SIDED), None, found) == (Verdict.ONE_SIDED, ())


def test_a_prediction_moves_over_the_alternatives_that_are_as_good_and_no_others(deceived):
    found, truth = deceived
    problem = of_other_closure(5)[0]
    names = tuple(truth)
    point = np.array([found.parameters[name].own.median for name in names])
    fitted = FittedModel(
        "two-mass", dict(problem.model.options), problem.model.ball, True, names, point, np.empty((0, len(names))),
        problem.impacts,
    )  # fmt: skip
    steep = fitball.impacts(v_x1=8.0, v_y1=12.0, omega_1=-50.0)
    prediction = predict_new(fitted, steep)
    moved = with_assumptions(prediction, fitted, found).output("omega_2")
    spins = [float(moved.point[0])]
    for item in found.alternatives:
        closure, _, option = item.name.partition("=")
        there = fitball.model("two-mass", ball=fitted.ball, **{} if closure == "noise" else {closure: option})
        values = {name: item.values[name] for name in there.parameter_names}
        spin = float(there.rebound(values, steep).omega_2[0])
        spins += [spin] if item.as_good else []
    np.testing.assert_allclose(moved.over[:, 0], [min(spins), max(spins)])
    assert moved.over[1, 0] > moved.over[0, 0]
    assert with_assumptions(prediction, fitted, None) is prediction


def test_what_is_told_of_the_fit_itself_is_what_its_estimates_tell(grip_slip_fit):
    """From every draw: those that are scored are fewer, and their median is another."""
    found = grip_slip_fit.assumptions.parameters
    assert set(found) == {item.name for item in grip_slip_fit.estimates}
    for item in grip_slip_fit.estimates:
        own = found[item.name].own
        assert (own.median, own.q025, own.q975) == pytest.approx(
            (item.median, item.q025, item.q975), abs=0.01 * item.sd
        )


def two_courts(rng, noise=0.05, each=30):
    parts = []
    for surface, mu in (("clay", 0.7), ("hard", 0.55)):
        angle, speed = np.radians(rng.uniform(14.0, 60.0, each)), rng.uniform(12.0, 30.0, each)
        before = fitball.impacts(speed * np.cos(angle), speed * np.sin(angle), rng.normal(0.0, 60.0, each))
        columns = before.__dict__ | fitball.model("grip-slip").rebound({**COURT, "mu": mu}, before).__dict__
        made = {name: np.ravel(columns[name]) for name in ("v_x1", "v_y1", "omega_1", "v_x2", "v_y2", "omega_2")}
        for name, sd in {"v_x2": noise, "v_y2": noise, "omega_2": 40.0 * noise}.items():
            made[name] = made[name] + sd * rng.standard_normal(each)
        parts.append(pd.DataFrame({"surface": surface, **made}))
    return pd.concat(parts, ignore_index=True)


def test_what_a_constant_moves_at_a_level_is_what_refits_move_it_by():
    """A point fit: spreads and places are not linear, and draws of both about the point are far from the data."""
    table = two_courts(np.random.default_rng(5))
    fit = fitball.calibrate(table, "grip-slip", point_only=True, cores=1)
    (constant,) = (item for item in fit.assumptions.constants if item.name == "inertia_ratio")
    ends = []
    for ratio in (constant.low, constant.high):
        scene = fitball.Scene(ball=Ball(0.0576, 0.03302, ratio * 0.0576 * 0.03302**2))
        ends.append(fitball.calibrate(table, "grip-slip", scene=scene, point_only=True, cores=1).summary()["point"])
    for name in ("mu[clay]", "mu[hard]"):
        low, high = constant.parameters[name]
        assert 0.5 < (high - low) / (ends[1][name] - ends[0][name]) < 1.5
    assert all(20.0 < rating < 60.0 for ends in constant.court_pace.values() for rating in ends)
