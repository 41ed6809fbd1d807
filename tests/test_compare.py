"""Comparison of models: scores against closed forms, synthetic truths with a negative control, the ladder."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import softmax
from scipy.stats import norm

from fitball.data.read import load_table
from fitball.data.scene import Scene, load_scene
from fitball.data.table import Measurement
from fitball.errors import FitError, ModelError
from fitball.inference.calibrate import Effort, run
from fitball.inference.compare import compare
from fitball.inference.criteria import criteria
from fitball.inference.ladder import VARIANTS, build_ladder, default_names, parse_name
from fitball.inference.leave_out import IMPACTS, leave_out, make_folds
from fitball.inference.loo import exact_elpd, leave_one_out, smoothed_elpd
from fitball.inference.maximum import maximum_posterior
from fitball.inference.minimiser import Minimiser
from fitball.inference.outputs import measured_outputs, output_errors, root_mean_square
from fitball.inference.point import point_fit
from fitball.inference.problem import Choices, build_problem
from fitball.inference.residuals import Weighting
from fitball.inference.results import RunStatus
from fitball.inference.starts import starting_points
from fitball.inference.subsample import thinned_problem, withheld
from fitball.inference.weights import pseudo_bma_weights, stacking_weights
from fitball.report.compare_folder import json_text
from fitball.report.compare_words import words
from fitball.studies import ranking
from fitball.studies.published_sets import published_sets


def problem_of(name, **choices):
    return build_problem(load_table(name), load_scene(name), Choices(**choices))


def point_of(problem, seed=1):
    return point_fit(problem, np.random.default_rng(seed))[1]


# --- leave-one-out densities


def conjugate(rng, count, draws):
    """`y` and `z` (count,) with mean theta and unit variance, and draws of theta given both; prior N(0, 4)."""
    y, z = rng.standard_normal((2, count)) + 1.3
    precision = 0.25 + 2 * count
    theta = rng.normal((y.sum() + z.sum()) / precision, precision**-0.5, draws)
    return y, z, theta


def test_smoothed_loo_is_the_analytic_density_of_a_conjugate_normal():
    y, z, theta = conjugate(np.random.default_rng(4), 12, 20000)
    terms = [norm.logpdf(column[None, :], theta[:, None], 1.0) for column in (y, z)]
    whole = terms[0] + terms[1]
    # Without impact i: theta ~ N(m, v); then y_i ~ N(m, 1 + v) and (y_i, z_i) jointly normal.
    v = 1.0 / (0.25 + 2 * 11)
    m = v * (y.sum() - y + z.sum() - z)
    both = [np.log(np.linalg.det(2 * np.pi * (np.eye(2) + v))) for _ in range(12)]
    gaps = np.stack([y - m, z - m], axis=1)
    quadratic = np.einsum("ij,jk,ik->i", gaps, np.linalg.inv(np.eye(2) + v), gaps)
    elpd, k = smoothed_elpd(whole, whole, 1.0)
    np.testing.assert_allclose(elpd, -0.5 * (np.array(both) + quadratic), atol=0.02)
    assert np.all(k < 0.7)
    # A part of an impact scored, the whole of it left out.
    elpd, _ = smoothed_elpd(whole, terms[0], 1.0)
    np.testing.assert_allclose(elpd, norm.logpdf(y, m, np.sqrt(1.0 + v)), atol=0.02)


def test_withheld_takes_away_the_likelihood_of_those_rows_and_nothing_else():
    problem = problem_of("wang_zero_spin.csv")
    point = point_of(problem)
    top = problem.to_coordinates(np.array([[point.values[name] for name in problem.free_names]]))
    rng = np.random.default_rng(3)
    coordinates = top + 0.02 * problem.prior.width * rng.standard_normal((40, problem.dimension))
    coordinates = coordinates[np.isfinite(problem.log_posterior(coordinates))]
    assert len(coordinates) > 5
    rows = np.array([1, 5])
    held = withheld(problem, rows)
    values = problem.to_values(coordinates)
    terms = problem.log_likelihood_terms(values, problem.rebound(values))
    lost = sum(term[:, rows].sum(axis=1) for term in terms.values())
    np.testing.assert_allclose(held.log_posterior(coordinates), problem.log_posterior(coordinates) - lost, rtol=1e-11)
    again = withheld(held, np.array([0]))
    assert again.channels[0].rows.tolist() == [2, 3, 4, 6]


def test_thinning_keeps_withheld_rows_apart():
    problem = problem_of("wang_all.csv", model="brody")
    held = thinned_problem(withheld(problem, np.array([0, 4, 9])), 10)
    for channel, whole in zip(held.channels, problem.channels, strict=True):
        kept = [held.table.ids[k] for k in channel.rows]
        expected = [whole.observed[problem.table.ids.index(name)] for name in kept]
        np.testing.assert_array_equal(channel.observed, expected)
        assert not {problem.table.ids[k] for k in (0, 4, 9)} & set(kept)


def test_withholding_everything_is_refused():
    problem = problem_of("wang_zero_spin.csv", model="brody")
    with pytest.raises(FitError, match="nothing is left of v_x2"):
        withheld(problem, np.arange(7))


def test_exact_refit_and_importance_sampling_agree_where_k_is_good():
    problem = problem_of("wang_zero_spin.csv", model="brody")
    effort = Effort(seed=2, ess=400.0)
    fit = run(problem, effort)
    columns = ("v_x2", "v_y2", "omega_2")
    settings = replace(effort, seed=9, ensembles=2).settings(problem)
    found = leave_one_out(problem, fit, fit.posterior, columns, settings, exact=False)
    assert np.all(found.pareto_k < 0.7)
    assert not found.refitted
    for row in (2, 6):
        exact, settled = exact_elpd(problem, fit.point.optima, row, columns, settings)
        assert settled
        assert exact == pytest.approx(found.elpd[row], abs=0.1)
    # Effective parameters: some, but no more than there are.
    assert 1.0 < found.p_loo < 5.0


# --- errors of left-out impacts


def drop_table(rng, count=9, noise=0.05):
    table = load_table("wang_zero_spin.csv")
    speeds = np.linspace(3.0, 16.0, count)
    rebound = (0.76 - 0.014 * (speeds - 10.0)) * speeds + noise * rng.standard_normal(count)
    return replace(
        table,
        impacts=type(table.impacts)(np.zeros(count), speeds, np.zeros(count)),
        incident_columns=("v_y1",),
        measurements=(Measurement("v_y2", rebound),),
        redundant=(),
        ids=tuple(f"d{k}" for k in range(count)),
        labels={},
        notices=(),
    )


def linear_problem(table, **scene):
    flat = {"cor_10": "uniform(0, 1)", "cor_slope": "uniform(-0.1, 0.1)"}
    return build_problem(table, Scene(**scene), Choices(model="brody", priors=flat))


def design(table):
    speed = table.impacts.v_y1
    return np.stack([speed, speed * (speed - 10.0)], axis=1), table.measurement("v_y2").values


def test_left_out_errors_of_a_linear_model_are_those_of_the_hat_matrix():
    table = drop_table(np.random.default_rng(6))
    problem = linear_problem(table, velocity_sd=0.05)
    folds, _ = make_folds(table, np.random.default_rng(0))
    missed, notes = leave_out(problem, point_of(problem), folds, (), np.random.default_rng(1))
    assert not notes
    x, y = design(table)
    hat = x @ np.linalg.inv(x.T @ x) @ x.T
    press = -(y - hat @ y) / (1.0 - np.diag(hat))
    errors = next(item for item in missed if item.scheme == IMPACTS).errors["v_y2"]
    np.testing.assert_allclose(errors, press, atol=2e-5)
    # Several rows at once: (1 - H_SS)^-1 e_S.
    fast = next(item for item in missed if item.scheme == "fastest third")
    block = np.ix_(fast.rows, fast.rows)
    together = -np.linalg.solve(np.eye(3) - hat[block], (y - hat @ y)[fast.rows])
    np.testing.assert_allclose(fast.errors["v_y2"], together, atol=2e-4)


def test_criteria_of_a_linear_model_are_those_of_its_residuals():
    table = drop_table(np.random.default_rng(7))
    problem = linear_problem(table)
    found = criteria(problem, [point_of(problem).values])
    x, y = design(table)
    residual = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    log_likelihood = norm.logpdf(residual, 0.0, np.sqrt(np.mean(residual**2))).sum()
    assert found.log_likelihood == pytest.approx(log_likelihood, abs=1e-5)
    assert (found.parameters, found.measurements) == (3, 9)
    assert found.aicc == pytest.approx(-2 * log_likelihood + 6 + 24 / 5, abs=1e-4)
    assert found.bic == pytest.approx(-2 * log_likelihood + 3 * np.log(9), abs=1e-4)
    assert replace(found, measurements=4).aicc is None


def test_the_maximised_likelihood_is_no_less_than_that_of_the_posterior_maximum():
    problem = problem_of("wang_all.csv", closures={"offset": "grip"})
    point = point_of(problem)
    found = criteria(problem, point.optima[:2])
    assert point.log_likelihood <= found.log_likelihood < point.log_likelihood + 1.0


def test_grip_slip_on_wang_left_out_one_by_one():
    """An earlier, independent sketch by least squares with I/(M R^2) = 0.55 left 0.55 m/s and 17.7 rad/s in spin."""
    known = load_scene("wang_all.csv")
    ball = replace(known.ball, inertia=0.55 * known.ball.mass * known.ball.radius**2)
    scene = replace(known, ball=ball, velocity_sd=0.25, spin_sd=10.0, mu=None)
    flat = {"e_x": "uniform(-1, 1)", "offset": "uniform(-0.033, 0.033)", "cor_10": "uniform(0, 1)",
            "cor_slope": "uniform(-0.1, 0.1)", "mu": "uniform(0, 5)"}  # fmt: skip
    table = load_table("wang_all.csv")
    problem = build_problem(table, scene, Choices(model="grip-slip", priors=flat))
    folds = [fold for fold in make_folds(table, np.random.default_rng(0))[0] if fold.scheme == IMPACTS]
    missed, _ = leave_out(problem, point_of(problem), folds, (), np.random.default_rng(1))
    rms = {name: root_mean_square(column) for name, column in missed[0].errors.items()}
    assert rms["v_x2"] == pytest.approx(0.55, abs=0.005)
    assert rms["omega_2"] == pytest.approx(17.7, abs=0.05)


def test_angles_differ_by_the_short_way_round():
    near = output_errors({"theta_2": np.array([3.1, 0.2])}, {"theta_2": np.array([-3.1, 0.1])})
    np.testing.assert_allclose(near["theta_2"], [2 * np.pi - 6.2, -0.1])


def test_outputs_follow_from_speed_and_angle():
    table = load_table("wang_zero_spin.csv")
    polar = replace(table, measurements=table.redundant)
    found = measured_outputs(polar)
    np.testing.assert_allclose(np.hypot(found["v_x2"], found["v_y2"]), found["v_2"])
    assert "theta_2" in measured_outputs(table)


# --- weights


def brute_force(elpd, steps=100):
    """The best of all weights on a grid of the simplex of three models."""
    grid = np.array([(a, b, steps - a - b) for a in range(steps + 1) for b in range(steps + 1 - a)]) / steps
    with np.errstate(divide="ignore"):
        scores = np.log(grid @ np.exp(elpd).T).mean(axis=1)
    return grid[np.argmax(scores)], scores.max()


@pytest.mark.parametrize("seed", range(6))
def test_stacking_weights_are_the_best_on_the_simplex(seed):
    elpd = np.random.default_rng(seed).normal(-3.0, 1.2, (21, 3))
    weights = stacking_weights(elpd)
    best, score = brute_force(elpd)
    assert weights.sum() == pytest.approx(1.0)
    assert np.log(np.exp(elpd) @ weights).mean() >= score - 1e-9
    np.testing.assert_allclose(weights, best, atol=0.03)


def test_stacking_keeps_its_head_far_from_one():
    elpd = np.array([[-900.0, -2000.0], [-850.0, -700.0], [-800.0, -810.0]])
    np.testing.assert_allclose(stacking_weights(elpd), [2 / 3, 1 / 3], atol=1e-3)
    np.testing.assert_allclose(stacking_weights(elpd[:1]), [1.0, 0.0], atol=1e-4)


def test_pseudo_bma_weights():
    # The same gap at every impact: no bootstrap can change the totals, and the weights are those of Akaike's form.
    elpd = np.random.default_rng(0).normal(-3.0, 1.0, (15, 1)) + np.array([[0.0, -0.1, 0.05]])
    rng = np.random.default_rng(1)
    np.testing.assert_allclose(pseudo_bma_weights(elpd, rng), softmax(15 * np.array([0.0, -0.1, 0.05])), rtol=1e-9)
    # An uncertain gap is drawn towards equal weights.
    rough = np.random.default_rng(2).normal(0.0, 3.0, (15, 2))
    rough[:, 0] += 0.3 + rough[:, 1].mean() - rough[:, 0].mean()
    plain = softmax(rough.sum(axis=0))
    assert 0.5 < pseudo_bma_weights(rough, rng)[0] < plain[0]


# --- the truth is found, and only when it is there


def synthetic_table(model, seed, **truth):
    """Wang's incident conditions with rebounds of `model` and noise of 0.25 m/s and 8 rad/s."""
    problem = problem_of("wang_all.csv", model=model)
    rng = np.random.default_rng(seed)
    truth |= {"velocity_sd": 0.25, "spin_sd": 8.0}
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
    monkeypatch.setattr("fitball.inference.compare.make_folds", lambda _table, _rng: ((), []))
    monkeypatch.setattr("fitball.inference.scoring.criteria", lambda _problem, _starts: None)
    return compared


def compared(table, *models):
    scene = load_scene("wang_all.csv")
    effort = Effort(seed=3, max_steps=500, ensembles=2, ess=400.0, cores=1)
    return compare(table, build_ladder(table, scene, models), effort, quick=True)


COR = {"cor_10": 0.76, "cor_slope": -0.014}


def test_data_of_grip_slip_prefer_grip_slip_to_brody(duel):
    found = duel(synthetic_table("grip-slip", 5, mu=0.55, e_x=0.25, offset=2.5e-3, **COR), "brody", "grip-slip")
    gap = found.elpd_difference("grip-slip", "brody")
    assert gap.value > 4.0
    assert gap.sure
    assert found.models[0].name == found.simplest.name == "grip-slip"
    assert found.stacking["grip-slip"] > 0.8


def test_data_of_two_masses_prefer_two_masses_to_brody(duel):
    truth = {"mass_ratio": 0.88, "k_y": 2.5e4, "k_theta": 16.0, "mu": 0.55, "eps_10": 2.5e-3, "eps_slope": 0.0}
    found = duel(synthetic_table("two-mass", 6, **truth, **COR), "brody", "two-mass")
    assert found.elpd_difference("two-mass", "brody").sure
    assert found.models[0].name == "two-mass"
    assert found.stacking["two-mass"] > 0.8


def test_data_of_brody_do_not_pay_for_more_parameters(duel):
    """The negative control: the same comparison on data without restitution or offset along the court."""
    found = duel(synthetic_table("brody", 7, mu=0.55, **COR), "brody", "grip-slip")
    assert not found.elpd_difference("grip-slip", "brody").sure
    assert found.simplest.name == "brody"


def test_an_interrupted_comparison_keeps_what_is_done():
    table, scene = drop_table(np.random.default_rng(1)), Scene()
    ladder = build_ladder(table, scene, ("brody", "two-mass+cor=mean", "two-mass"))
    effort = Effort(seed=1, max_steps=100, ensembles=2, cores=1)

    def stop(at):
        def report(stage):
            if stage.startswith(at):
                raise KeyboardInterrupt

        return report

    found = compare(table, ladder, effort, quick=True, report=stop("two-mass (3 of 3)"))
    assert found.status is RunStatus.INTERRUPTED
    assert {item.name for item in found.models} == {"brody", "two-mass+cor=mean"}
    assert "interrupted: two-mass not compared" in found.notes
    with pytest.raises(KeyboardInterrupt):
        compare(table, ladder, effort, quick=True, report=stop("two-mass+cor=mean (2 of 3)"))


def test_the_same_seed_gives_the_same_scores():
    table, scene = drop_table(np.random.default_rng(1)), Scene()
    ladder = build_ladder(table, scene, ("brody", "two-mass+cor=mean"))
    one, two, other = (
        compare(table, ladder, Effort(seed=seed, cores=cores, max_steps=100, ensembles=2))
        for seed, cores in ((1, 1), (1, 2), (2, 1))
    )
    for first, second in zip(one.models, two.models, strict=True):
        assert first.loo.elpd.tobytes() == second.loo.elpd.tobytes()
    assert one.pseudo_bma == two.pseudo_bma
    assert one.models[0].loo.elpd.tobytes() != other.models[0].loo.elpd.tobytes()


# --- the ladder


def test_default_ladders():
    wang = load_table("wang_all.csv")
    names, said = default_names(wang)
    assert not said
    ladder = build_ladder(wang, load_scene("wang_all.csv"), names)
    assert len(ladder.rungs) == 4 + len(VARIANTS)
    assert ladder.columns == ("v_x2", "v_y2", "omega_2")
    assert not ladder.notes
    for first, second in itertools.combinations(ladder.rungs, 2):
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
    assert len(build_ladder(spinless, load_scene("wang_all.csv"), names).rungs) == 3


def test_a_model_that_equals_another_here_is_left_out():
    drop = drop_table(np.random.default_rng(0))
    ladder = build_ladder(drop, Scene(), ("two-mass", "two-mass+normal=total", "two-mass+cor=mean"))
    assert [rung.name for rung in ladder.rungs] == ["two-mass", "two-mass+cor=mean"]
    assert ladder.notes == ("two-mass+normal=total is two-mass on this table and is not fitted again",)


def test_only_common_columns_are_scored():
    table, scene = load_table("wang_zero_spin.csv"), load_scene("wang_zero_spin.csv")
    ladder = build_ladder(table, scene, ("grip-slip", "two-mass+cor=measured"))
    assert ladder.columns == ("v_x2", "omega_2")
    assert any(note.startswith("v_y2 enters no score") for note in ladder.notes)
    assert any("is told each measured v_y2" in note for note in ladder.notes)
    # The wall mass_ratio >= COR is there without a COR parameter.
    problem = ladder.rungs[1].problem
    best = maximum_posterior(problem, starting_points(problem, np.random.default_rng(0), 4))
    assert best.values["mass_ratio"] >= problem.impacts.cor.max()
    minimiser = Minimiser(problem, Weighting({}, penalised=False))
    values = np.array([[best.values[name] for name in problem.free_names]])
    assert minimiser.wall(values)[0] == pytest.approx(problem.impacts.cor.max(), rel=1e-9)
    drop = replace(table, measurements=(table.measurement("v_y2"),))
    with pytest.raises(FitError, match="predicts none of the measured columns"):
        build_ladder(drop, scene, ("grip-slip", "two-mass+cor=measured"))


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
        (("brody+cor=mean", "two-mass"), ModelError, "has no closures"),
    ],
)
def test_bad_ladders(names, error, message):
    table = load_table("wang_zero_spin.csv")
    with pytest.raises(error, match=message):
        build_ladder(table, load_scene(table.source), names)


def test_names_of_models():
    assert parse_name("two-mass + torsion=free+cor=mean") == ("two-mass", {"torsion": "free", "cor": "mean"})


def test_large_tables_are_left_out_in_folds():
    table = load_table("wang_all.csv")
    count = 63
    rows = np.arange(count) % 21
    large = replace(
        table,
        impacts=type(table.impacts)(*(getattr(table.impacts, name)[rows] for name in ("v_x1", "v_y1", "omega_1"))),
        ids=tuple(map(str, range(count))),
        labels={},
    )
    folds, notes = make_folds(large, np.random.default_rng(0))
    mine = [fold for fold in folds if fold.scheme == IMPACTS]
    assert len(mine) == 20
    assert sorted(np.concatenate([fold.rows for fold in mine])) == list(range(count))
    assert any("20 random folds" in note for note in notes)


# --- published sets


def test_published_sets_score_as_the_ranking_of_the_thesis_does():
    found = {item.name: item for item in published_sets(load_table("wang_all.csv"))}
    assert len(found) == 10
    own = {f"Table 9, case {case}": ranking.errors(one) for case, one in ranking.chapter_five_predictions().items()}
    for name, errors in own.items():
        for output in ("v_x2", "omega_2"):
            assert root_mean_square(found[name].errors[output]) == pytest.approx(root_mean_square(errors[output]))
    # Figures of the README's section on the thesis.
    assert root_mean_square(found["Table 9, case 3"].errors["omega_2"]) == pytest.approx(128.4, abs=0.1)
    best = found["Appendix C, 5: M1/M = 2/3, k_y = 80"]
    assert best.told == ("v_y2",)
    assert root_mean_square(best.errors["omega_2"]) == pytest.approx(23.04, abs=0.01)
    part = {item.name: item for item in published_sets(load_table("wang_topspin.csv"))}
    np.testing.assert_allclose(part["Table 9, case 1"].errors["v_x2"], found["Table 9, case 1"].errors["v_x2"][7:14])


def test_published_sets_need_wangs_data():
    table = load_table("wang_zero_spin.csv")
    moved = tuple(replace(item, values=item.values + 0.5 * (item.name == "omega_2")) for item in table.measurements)
    assert published_sets(replace(table, measurements=moved)) == ()
    assert len(published_sets(table)) == 10


# --- words


def test_a_pareto_k_without_a_number_is_null_in_json():
    table, scene = drop_table(np.random.default_rng(1)), Scene()
    ladder = build_ladder(table, scene, ("brody", "two-mass+cor=mean"))
    found = compare(table, ladder, Effort(seed=1, max_steps=100, ensembles=2, cores=1), quick=True)
    first = found.models[0]
    k = first.loo.pareto_k.copy()
    k[0] = np.inf
    broken = replace(first, loo=replace(first.loo, pareto_k=k))
    assert broken.loo.doubtful[0] == 0
    content = json.loads(json_text(replace(found, models=(broken, *found.models[1:])), "words"))
    assert content["models"][0]["pareto_k"]["d0"] is None


def test_words_of_a_duel(monkeypatch):
    """The paragraph on Wang's zero-spin impacts, from chains too short to converge: signs, units, counts."""
    table, scene = load_table("wang_zero_spin.csv"), load_scene("wang_zero_spin.csv")
    monkeypatch.setattr("fitball.inference.scoring.criteria", lambda _problem, _starts: None)
    effort = Effort(seed=1, max_steps=150, ensembles=2, cores=1)
    found = compare(table, build_ladder(table, scene, ("brody", "two-mass+torsion=rigid")), effort, quick=True)
    change = found.rms_difference("two-mass+torsion=rigid", "brody", "v_x2")
    rms = {item.name: item.out_of_sample()["v_x2"] for item in found.models}
    assert change.value == pytest.approx(rms["two-mass+torsion=rigid"] - rms["brody"])
    assert change.q05 <= change.value <= change.q95
    assert change.q95 < 0.0
    text = words(found)
    assert "two-mass+torsion=rigid against brody, 4 more free: elpd +" in text
    assert f"v_x2 {change.value:.2f} [" in text or f"v_x2 {change.value:.1f} [" in text
    assert "omega_2 +" in text
    assert "With 7 impacts" in text


def test_the_wanted_effective_sample_size_is_heeded():
    problem = linear_problem(drop_table(np.random.default_rng(2)))
    fit = run(problem, Effort(seed=1, ess=1e6, max_steps=750, ensembles=2))
    assert fit.status is RunStatus.NOT_CONVERGED
    assert "(wanted 1000000)" in fit.diagnostics.complaints[0]
    assert fit.diagnostics.steps == 750
    assert run(problem, Effort(seed=1, ess=100.0, max_steps=750, ensembles=2)).status is RunStatus.CONVERGED


def test_the_wall_of_the_mass_ratio_follows_the_restitution_that_is_fitted():
    """Not the measured one, which the table carries along whether or not a model asks for it."""
    for cor, expected in (("mean", 0.8), ("line", 0.8 - 0.01 * (4.81 - 10.0))):
        problem = problem_of("wang_all.csv", closures={"cor": cor})
        values = problem.prior.value(np.zeros((1, problem.dimension)))
        for name, value in (("cor_10", 0.8), ("cor_slope", -0.01)):
            if name in problem.free_names:
                values[0, problem.free_names.index(name)] = value
        wall = Minimiser(problem, Weighting({}, penalised=False)).wall(values)[0]
        assert wall == pytest.approx(expected, rel=1e-9)
