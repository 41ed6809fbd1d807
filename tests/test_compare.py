"""Comparison of models: scores against closed forms, synthetic truths with a negative control, the candidates."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
from samples import TWO_MASS, drop_table, linear_problem, problem_of, search_briefly
from validation.harness import SCHEDULE

from fitball.data.read import load_table
from fitball.data.scene import Scene, load_scene
from fitball.data.table import Measurement
from fitball.errors import FitError, ModelError
from fitball.inference.calibrate import run
from fitball.inference.comparison.candidates import build_candidates, default_names, parse_name
from fitball.inference.comparison.compare import compare
from fitball.inference.comparison.results import published_sets
from fitball.inference.effort import Effort
from fitball.inference.point.point_fit import maximum_posterior, starting_points
from fitball.inference.prediction.outputs import root_mean_square
from fitball.inference.results.results import RunStatus
from fitball.inference.sampling.ensembles import Schedule
from fitball.report.compare.document import words
from fitball.report.compare.rows import json_content
from fitball.report.form.files import json_text
from fitball.scheduling.engine import engine
from fitball.thesis import judgement
from fitball.thesis.printed_tables import chapter_five_predictions


def synthetic_table(model, seed, **truth):
    """Wang's incident conditions with rebounds of `model` and noise of 0.25 m/s and 8 rad/s."""
    problem = problem_of("wang_all.csv", model=model)
    rng = np.random.default_rng(seed)
    truth |= {"v_x_sd": 0.25, "v_y_sd": 0.25, "spin_sd": 8.0}
    values = np.array([[truth[name] for name in problem.free_names]])
    rebound = problem.rebound(values)
    assert not np.any(rebound.status)
    noise = {"v_x2": 0.25, "v_y2": 0.25, "omega_2": 8.0}
    measured = {name: getattr(rebound, name)[0] + sd * rng.standard_normal(21) for name, sd in noise.items()}
    return replace(
        problem.table, measurements=tuple(Measurement(*item) for item in measured.items()), redundant=(), labels={}
    )


@pytest.fixture
def duel(monkeypatch):
    """A function that compares models by densities alone: the refits without some impacts have tests of their own."""
    search_briefly(monkeypatch)
    monkeypatch.setattr("fitball.inference.comparison.compare.make_folds", lambda _table, _rng: ((), []))
    monkeypatch.setattr("fitball.inference.comparison.compare.criteria", lambda _problem, _starts: None)
    return compared


def compared(table, *models):
    scene = load_scene("wang_all.csv")
    effort = Effort(seed=3, max_steps=500, ensembles=2, ess=400.0, cores=1)
    return compare(table, build_candidates(table, scene, models), effort, engine(1), quick=True)


COR = {"cor_10": 0.76, "cor_slope": -0.014}


@pytest.mark.parametrize(
    ("name", "truth"),
    [
        ("grip-slip", {"mu": 0.55, "e_x": 0.25, "offset": 2.5e-3, **COR}),
        ("two-mass", {**TWO_MASS, "k_y": 2.5e4, "k_theta": 16.0, "mass_ratio": 0.88, **COR}),
    ],
)
def test_data_of_a_model_prefer_it_to_brody(duel, name, truth):
    found = duel(synthetic_table(name, 5, **truth), "brody", name)
    gap = found.elpd_difference(name, "brody")
    assert gap.value > 4.0
    assert gap.sure
    assert found.models[0].name == found.simplest.name == name
    assert found.stacking[name] > 0.8
    # What the table refuses takes part in the mixture by its weight, and in no range.
    friction = found.assumptions["mu"]
    assert friction.as_good == (name,)
    assert (friction.span.low, friction.span.high) == (friction.by_model[name].median,) * 2
    assert set(friction.by_model) == {name, "brody"}
    assert "e_x" not in found.assumptions


def test_data_of_brody_do_not_pay_for_more_parameters(duel):
    """The negative control: the same comparison on data without restitution or offset along the court."""
    found = duel(synthetic_table("brody", 7, mu=0.55, **COR), "brody", "grip-slip")
    assert not found.elpd_difference("grip-slip", "brody").sure
    assert found.simplest.name == "brody"
    friction = found.assumptions["mu"]
    assert set(friction.as_good) == {"brody", "grip-slip"}
    assert friction.weight == pytest.approx(1.0)
    for level, name in ((0.025, "q025"), (0.5, "median"), (0.975, "q975")):
        below = 0.0
        for score in found.models:
            column = score.fit.posterior.draws[:, score.fit.posterior.names.index("mu")]
            below += found.stacking[score.name] * np.mean(column <= getattr(friction.stacked, name))
        assert below == pytest.approx(level, abs=0.02)


def test_an_interrupted_comparison_keeps_what_is_done(brief):
    table, scene = drop_table(np.random.default_rng(1), count=4), Scene()
    candidates = build_candidates(table, scene, ("brody", "two-mass+cor=mean", "two-mass"))
    effort = Effort(seed=1, max_steps=100, ensembles=2, cores=1)

    def stop(at):
        def report(stage):
            if stage.endswith(at):
                raise KeyboardInterrupt

        return report

    found = compare(table, candidates, effort, engine(1), quick=True, report=stop("(2 of 3 done)"))
    assert found.status is RunStatus.INTERRUPTED
    (missing,) = {item.name for item in candidates.candidates} - {item.name for item in found.models}
    assert f"interrupted: {missing} not compared" in found.notes
    with pytest.raises(KeyboardInterrupt):
        compare(table, candidates, effort, engine(1), quick=True, report=stop("(1 of 3 done)"))


def test_fewer_draws_take_fewer_steps_after_the_warm_up_of_the_validation():
    assert Schedule.for_ess(1000.0) == Schedule()
    assert Schedule.for_ess(400.0) == Schedule(warm_up=160, first_check=240, target_ess=400.0)
    least, more = Schedule.for_ess(10.0), Schedule.for_ess(4000.0)
    assert (least.warm_up, least.first_check) == (SCHEDULE.warm_up, 240)
    assert (more.warm_up, more.first_check, more.target_ess) == (SCHEDULE.warm_up, SCHEDULE.first_check, 4000.0)


# --- the candidates


def test_default_ladders():
    wang = load_table("wang_all.csv")
    names, said = default_names(wang)
    assert not said
    candidates = build_candidates(wang, load_scene("wang_all.csv"), names)
    assert len(candidates.candidates) == 4 + 8
    assert candidates.columns == ("v_x2", "v_y2", "omega_2")
    assert not candidates.notes
    for first, second in itertools.combinations(candidates.candidates, 2):
        assert (first.problem.model.name, first.problem.model.options) != (
            second.problem.model.name,
            second.problem.model.options,
        )
    drop = drop_table(np.random.default_rng(0))
    names, said = default_names(drop)
    assert names == ("two-mass", "two-mass+cor=mean")
    assert "along the court" in said[0]
    spinless = replace(wang, measurements=wang.measurements[:2], incident_columns=("v_x1", "v_y1"))
    names, said = default_names(spinless)
    assert names == ("brody", "grip-slip", "two-mass+cor=mean")
    assert "without spin" in said[0]
    assert len(build_candidates(spinless, load_scene("wang_all.csv"), names).candidates) == 3


def test_a_model_that_equals_another_here_is_left_out():
    drop = drop_table(np.random.default_rng(0))
    candidates = build_candidates(drop, Scene(), ("two-mass", "two-mass+normal=total", "two-mass+cor=mean"))
    assert [candidate.name for candidate in candidates.candidates] == ["two-mass", "two-mass+cor=mean"]
    assert candidates.notes == ("two-mass+normal=total is two-mass on this table and is not fitted again",)


def test_only_common_columns_are_scored():
    table, scene = load_table("wang_zero_spin.csv"), load_scene("wang_zero_spin.csv")
    candidates = build_candidates(table, scene, ("grip-slip", "two-mass+cor=measured"))
    assert candidates.columns == ("v_x2", "omega_2")
    assert any(note.startswith("v_y2 ") and "left out of all scores" in note for note in candidates.notes)
    assert any("takes as an input each measured v_y2" in note for note in candidates.notes)
    # The wall mass_ratio >= COR is there without a COR parameter.
    problem = candidates.candidates[1].problem
    best = maximum_posterior(problem, starting_points(problem, np.random.default_rng(0), 4))
    assert best.values["mass_ratio"] >= problem.impacts.cor.max()
    assert wall_of(problem, best.values) == pytest.approx(problem.impacts.cor.max(), rel=1e-9)
    drop = replace(table, measurements=(table.measurement("v_y2"),))
    with pytest.raises(FitError, match="predicts none of the measured columns"):
        build_candidates(drop, scene, ("grip-slip", "two-mass+cor=measured"))


@pytest.mark.parametrize(
    ("names", "error", "message"),
    [
        (("thesis", "brody"), ModelError, "is not ranked"),
        (("brody",), FitError, "at least two different models"),
        (("brody", "brody"), ModelError, "named twice"),
        (("brody", "grip-slop"), ModelError, "did you mean 'grip-slip'"),
        (("brody", "two-mass+torsion"), ModelError, "expected CLOSURE=OPTION"),
        (("brody", "two-mass+torsion=free+torsion=rigid"), ModelError, "given twice"),
        (("brody", "two-mass+torsion=fre"), ModelError, "did you mean 'free'"),
        (("brody+cor=mean", "two-mass"), ModelError, "unknown option 'mean' of closure cor"),
    ],
)
def test_bad_ladders(names, error, message):
    table = load_table("wang_zero_spin.csv")
    with pytest.raises(error, match=message):
        build_candidates(table, load_scene(table.source), names)


def test_names_of_models():
    assert parse_name("two-mass + torsion=free+cor=mean") == ("two-mass", {"torsion": "free", "cor": "mean"})


def test_published_sets_score_as_the_ranking_of_the_thesis_does():
    found = {item.name: item for item in published_sets(load_table("wang_all.csv"))}
    assert len(found) == 10
    own = {f"Table 9, case {case}": judgement.errors(one) for case, one in chapter_five_predictions().items()}
    for name, errors in own.items():
        for output in ("v_x2", "omega_2"):
            assert root_mean_square(found[name].errors[output]) == pytest.approx(root_mean_square(errors[output]))
    # Figures of the README's section on the thesis.
    assert root_mean_square(found["Table 9, case 3"].errors["omega_2"]) == pytest.approx(128.4, abs=0.1)
    best = found["Appendix C, 5: M1/M = 2/3, k_y = 80 lb/in"]
    assert best.given_columns == ("v_y2",)
    assert root_mean_square(best.errors["omega_2"]) == pytest.approx(23.04, abs=0.01)
    part = {item.name: item for item in published_sets(load_table("wang_topspin.csv"))}
    np.testing.assert_allclose(part["Table 9, case 1"].errors["v_x2"], found["Table 9, case 1"].errors["v_x2"][7:14])


def test_published_sets_need_wangs_data():
    table = load_table("wang_zero_spin.csv")
    moved = tuple(replace(item, values=item.values + 0.5 * (item.name == "omega_2")) for item in table.measurements)
    assert published_sets(replace(table, measurements=moved)) == ()
    assert len(published_sets(table)) == 10


# --- words


def test_a_pareto_k_without_a_number_is_null_in_json(brief):
    table, scene = drop_table(np.random.default_rng(1)), Scene()
    candidates = build_candidates(table, scene, ("brody", "two-mass+cor=mean"))
    found = compare(table, candidates, Effort(seed=1, max_steps=100, ensembles=2, cores=1), engine(1), quick=True)
    first = found.models[0]
    k = first.loo.pareto_k.copy()
    k[0] = np.inf
    broken = replace(first, loo=replace(first.loo, pareto_k=k))
    assert broken.loo.doubtful[0] == 0
    content = json.loads(json_text(json_content(replace(found, models=(broken, *found.models[1:])), "words")))
    assert content["models"][0]["pareto_k"]["d0"] is None


def test_words_of_a_duel(monkeypatch, brief):
    """The paragraph on Wang's zero-spin impacts, from chains too short to converge: signs, units, counts."""
    table, scene = load_table("wang_zero_spin.csv"), load_scene("wang_zero_spin.csv")
    monkeypatch.setattr("fitball.inference.comparison.compare.criteria", lambda _problem, _starts: None)
    effort = Effort(seed=1, max_steps=150, ensembles=2, cores=1)
    found = compare(
        table, build_candidates(table, scene, ("brody", "two-mass+torsion=rigid")), effort, engine(1), quick=True
    )
    change = found.rms_difference("two-mass+torsion=rigid", "brody", "v_x2")
    rms = {item.name: item.out_of_sample()["v_x2"] for item in found.models}
    assert change.value == pytest.approx(rms["two-mass+torsion=rigid"] - rms["brody"])
    assert change.q05 <= change.value <= change.q95
    assert change.q95 < 0.0
    text = words(found)
    assert "two-mass+torsion=rigid has 4 more than brody" in text
    assert f"v_x2 {change.value:.2f} [" in text or f"v_x2 {change.value:.1f} [" in text
    assert "omega_2 +" in text
    assert "With 7 impacts" in text


def test_the_wanted_effective_sample_size_is_heeded():
    problem = linear_problem(drop_table(np.random.default_rng(2)))
    fit = run(problem, Effort(seed=1, ess=1e6, max_steps=750, ensembles=2))
    assert fit.status is RunStatus.NOT_CONVERGED
    assert "target 1000000" in fit.diagnostics.complaints[0]
    assert fit.diagnostics.steps == 750
    assert run(problem, Effort(seed=1, ess=100.0, max_steps=750, ensembles=2)).status is RunStatus.CONVERGED


def wall_of(problem, values):
    """The least mass ratio that the model's linear constraints allow."""
    walls = [wall for wall in problem.linear_constraints if wall.lower_bound_of == "mass_ratio"]
    return max(
        sum(factor * values[name] for name, factor in wall.coefficients.items() if name != "mass_ratio") - wall.bound
        for wall in walls
    )


@pytest.mark.parametrize(("cor", "expected"), [("mean", 0.8), ("line", 0.8 - 0.01 * (4.81 - 10.0))])
def test_the_wall_of_the_mass_ratio_follows_the_restitution_that_is_fitted(cor, expected):
    """Not the measured one, which the table carries along whether or not a model asks for it."""
    problem = problem_of("wang_all.csv", closures={"cor": cor})
    assert wall_of(problem, {"cor_10": 0.8, "cor_slope": -0.01}) == pytest.approx(expected, rel=1e-9)
