"""Comparisons: leave-one-out of a line in closed form, ArviZ, scipy; choices, failures and
interruptions.
"""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from arviz_stats.base.array import array_stats
from scipy import optimize, stats
from support import line
from support.drawn import cut_off
from support.made_fit import table_of

import fitball
from fitball.cli import main
from fitball.data.read import load_data
from fitball.data.scene import Scene
from fitball.inference.density import pointwise
from fitball.inference.effort import Effort
from fitball.inference.problem.problem import Choices
from fitball.report import compare as page
from fitball.result import Frames
from fitball.uses import compare, left_out
from fitball.uses.left_out import Weighted, held_out, leave_one_out

ONE = Choices(pool={"all": "none"})


def posed(y=None, **more):
    """The problem of a line, with other measurements, its maximum, and independent draws of its
    posterior.
    """
    problem = line.line_problem(**more)
    if y is not None:
        problem = replace(problem, rows=replace(problem.rows, y=y(problem.rows.y.copy())))
    centre, covariance = line.exact(problem)
    draws = np.random.default_rng(4).multivariate_normal(centre, covariance, 4000)
    q = problem.prior.coordinate(draws)
    best = problem.prior.coordinate(centre[None])
    return problem, best, Weighted(q, np.full(4000, -np.log(4000)), 1.0, True)


def without(problem, rows):
    """Mean and sd (impacts,) of what a line predicts of rows that it was not fitted to, in closed
    form.
    """
    kept = np.setdiff1d(np.arange(len(problem.rows.y)), rows)
    centre, covariance = line.exact(problem.part(kept))
    design = np.column_stack([problem.rows.states.v_x1[rows], np.ones(len(rows))])
    return design @ centre, np.sqrt(
        np.einsum("ri,ij,rj->r", design, covariance, design) + line.SD**2
    )


def exact_scores(problem):
    found = [without(problem, np.array([row])) for row in range(len(problem.rows.y))]
    mean, sd = (np.concatenate(part) for part in zip(*found, strict=True))
    return mean, stats.norm.logpdf(problem.rows.y[:, 0], mean, sd)


@pytest.mark.parametrize("weighted", [False, True])
def test_scores_and_predictions_of_a_line_are_those_in_closed_form(weighted):
    problem, best, draws = posed()
    if weighted:
        # From a proposal that is far too wide: without their weights draws would be no posterior.
        about = left_out.proposal(problem, best[0])
        draws = left_out.drawn(
            problem,
            [replace(about, factor=8.0 * about.factor)],
            Effort(),
            1500.0,
            "here",
        )
    found = leave_one_out(problem, best, draws, ("v_x2",), Effort())
    mean, scores = exact_scores(problem)
    assert not found.refitted.all()
    assert found.settled.all()
    np.testing.assert_allclose(found.elpd, scores, atol=0.06 if weighted else 0.03)
    # Means without an impact, known to some hundredths of their sds.
    np.testing.assert_allclose(
        found.predicted[:, 0],
        mean,
        atol=(0.15 if weighted else 0.1) * line.SD,
    )
    # Those with it lie elsewhere.
    fitted = line.exact(problem)[0] @ np.stack([problem.rows.states.v_x1, np.ones(12)])
    assert np.abs(fitted - mean).max() > 0.3 * line.SD


def test_scores_are_those_of_arviz(monkeypatch):
    monkeypatch.setattr(left_out, "REFIT", np.inf)
    problem, best, draws = posed()
    found = leave_one_out(problem, best, draws, ("v_x2",), Effort())
    likelihood = pointwise(problem, draws.q, ("v_x2",))
    elpd, k, _ = array_stats.loo(likelihood.T[:, None], chain_axis=-2, draw_axis=-1, r_eff=1.0)
    np.testing.assert_allclose(found.elpd, elpd, rtol=1e-12)
    np.testing.assert_allclose(found.k, k, rtol=1e-9)


def far(y):
    """The impact at the end of the line lies six sds beside it."""
    y[np.argmax(line.line_problem().rows.states.v_x1), 0] += 6.0 * line.SD
    return y


def test_an_impact_without_which_weights_are_unreliable_is_refitted(monkeypatch):
    problem, best, draws = posed(far)
    found = leave_one_out(problem, best, draws, ("v_x2",), Effort())
    _, scores = exact_scores(problem)
    row = np.argmax(problem.rows.states.v_x1)
    assert found.settled.all()
    np.testing.assert_array_equal(found.refitted, found.k > left_out.REFIT)
    assert found.k[row] > 0.7
    assert found.refitted[row]
    assert not found.refitted.all()
    np.testing.assert_allclose(found.elpd, scores, atol=0.1)
    # Without a refit the score is wrong.
    monkeypatch.setattr(left_out, "REFIT", np.inf)
    wrong = leave_one_out(problem, best, draws, ("v_x2",), Effort())
    assert not wrong.refitted.any()
    assert abs(wrong.elpd[row] - scores[row]) > 0.5


def test_long_tables_are_scored_by_parts(monkeypatch):
    problem, best, draws = posed()
    whole = leave_one_out(problem, best, draws, ("v_x2",), Effort())
    monkeypatch.setattr(left_out, "ENTRIES", 4000 * 5)
    monkeypatch.setattr(left_out, "FEWEST", 4000)
    part = leave_one_out(problem, best, draws, ("v_x2",), Effort())
    np.testing.assert_allclose(part.elpd, whole.elpd, rtol=1e-12)
    # Fewer draws, evenly spread, are less sure.
    monkeypatch.setattr(left_out, "FEWEST", 1000)
    thinned = leave_one_out(problem, best, draws, ("v_x2",), Effort())
    assert 0.0 < np.abs(thinned.elpd - whole.elpd).max() < 0.1


@pytest.mark.parametrize("chain", [False, True])
def test_weighted_draws_and_draws_of_chains_are_those_of_the_posterior(chain, monkeypatch):
    problem, best, _ = posed()
    if chain:
        weighted = left_out.importance
        monkeypatch.setattr(left_out, "importance", lambda *given: (*weighted(*given)[:2], np.inf))
    made = left_out.drawn(problem, [left_out.proposal(problem, best[0])], Effort(), 2000.0, "here")
    centre, covariance = line.exact(problem)
    values = problem.prior.value(made.q)
    weights = np.exp(made.weights)
    assert made.settled
    assert weights.sum() == pytest.approx(1.0)
    assert (np.ptp(weights) > 0.0) is not chain
    assert (made.efficiency < 0.9) is chain
    sd = np.sqrt(np.diagonal(covariance))
    assert np.abs(weights @ values - centre).max() < 0.1 * sd.max()
    np.testing.assert_allclose(np.sqrt(weights @ (values - centre) ** 2), sd, rtol=0.08)


def test_chains_are_short_and_none_are_made_of_three_impacts(monkeypatch, table):
    """Of four rows a two-mass ball took 20,000 steps, and again without each of them."""
    problem, best, _ = posed()
    weighted = left_out.importance
    efforts = []

    def chains(_problem, _begin, effort, _progress):
        efforts.append(effort)
        raise RuntimeError

    monkeypatch.setattr(left_out, "importance", lambda *given: (*weighted(*given)[:2], np.inf))
    monkeypatch.setattr(left_out, "sample", chains)
    begin = [left_out.proposal(problem, best[0])]
    made = left_out.drawn(problem.without(np.arange(3, 12)), begin, Effort(), 2000.0, "here")
    assert not efforts
    assert not made.settled
    assert len(made.q) > 2000
    (four, *_) = compare.problems_of(
        *load_data([table.iloc[:4]], Scene(), True),
        ONE,
        ["grip-slip"],
        False,
    )
    with pytest.raises(RuntimeError):
        compare._scored(compare._Task(four, ("v_x2",), {}, Effort()))
    assert efforts[0].max_steps == compare.STEPS < Effort().max_steps


def test_labels_left_out_are_predicted_by_the_maximum_without_them():
    problem, best, _ = posed()
    folds = [np.arange(3), np.arange(3, 12)]
    at, predicted = held_out(problem, best, folds)
    for rows, own in zip(folds, at, strict=True):
        np.testing.assert_allclose(
            predicted[rows, 0],
            without(problem, rows)[0],
            atol=2e-3 * line.SD,
        )
        kept = np.setdiff1d(np.arange(12), rows)
        np.testing.assert_allclose(
            problem.prior.value(own[None])[0],
            line.exact(problem.part(kept))[0],
            atol=2e-3,
        )


def test_stacking_is_the_best_mixture():
    elpd = np.random.default_rng(2).normal(-3.0, 1.0, (40, 4))
    elpd[:, 3] -= 6.0
    weights, gap = compare.stacking(elpd)

    def loss(free):
        # Softmax: on the simplex whatever the numbers.
        shares = np.exp(free - free.max())
        return -np.mean(np.log(np.exp(elpd) @ (shares / shares.sum())))

    best = min(optimize.minimize(loss, start, tol=1e-12).fun for start in np.eye(4))
    assert weights.sum() == pytest.approx(1.0)
    assert weights[3] < 1e-3
    assert gap < compare.GAP
    assert -np.mean(np.log(np.exp(elpd) @ weights)) == pytest.approx(best, abs=2e-6)
    # Equal models share; scores far apart overflow nothing.
    np.testing.assert_allclose(compare.stacking(np.full((5, 2), -800.0))[0], 0.5)
    np.testing.assert_allclose(compare.stacking(np.array([[0.0, -2000.0]] * 5))[0], [1.0, 0.0])


@pytest.fixture(scope="module")
def table():
    """What grip-slip says, on two surfaces that are alike."""
    return table_of(18, surfaces=("hard", "clay"))


@pytest.fixture(scope="module")
def compared(table):
    return fitball.compare(
        table,
        models="grip-slip,brody",
        pool={"all": "none"},
        cores=1,
        progress=False,
    )


def test_the_model_that_made_the_table_predicts_best(compared):
    models = compared.frames["models"]
    first, second = models.to_dict("records")
    assert (first["model"], first["simplest"], second["model"]) == ("grip-slip", True, "brody")
    assert second["worse"]
    assert first["weight"] > 0.95
    assert not first["worse"]
    assert first["difference"] == 0.0
    wide = compared.frames["left_out"].pivot_table(index="id", columns="model", values="elpd")
    less = wide["brody"] - wide["grip-slip"]
    assert second["difference"] == pytest.approx(less.sum())
    assert second["error"] == pytest.approx(np.sqrt(18) * less.std(ddof=1))
    assert first["elpd"] == pytest.approx(wide["grip-slip"].sum())
    # Noises were 0.3 m/s and 6 rad/s; one of 18 impacts more is left than was fitted.
    assert 0.2 < first["rms_v_x2"] < 0.45
    assert 4.0 < first["rms_omega_2_without_surface"] < 9.0
    assert second["rms_v_x2"] > 2.0 * first["rms_v_x2"]
    values = compared.frames["quantities"].set_index(["name", "model"])
    assert (
        abs(values.loc[("mu", "grip-slip"), "median"] - 0.6)
        < 3.0 * values.loc[("mu", "grip-slip"), "sd"]
    )
    assert compared.exit_code == 0


def test_equal_comparisons_are_equal_whatever_the_processes(table, compared):
    again = fitball.compare(
        table,
        models=["brody", "grip-slip"],
        pool={"all": "none"},
        cores=2,
        progress=False,
    )
    assert again.json()["frames"] == compared.json()["frames"]


def test_priors_and_fixed_values_count_in_every_model_that_has_them(table):
    known = load_data([table], Scene(), True)
    choices = Choices("", {"e_x": 0.1}, {"mu": "normal(0.3, 0.001)"}, {"all": "none"}, "student-t")
    grip, brody = compare.problems_of(*known, choices, ["grip-slip", "brody"], False)
    assert "e_x" not in grip.free
    assert "degrees_of_freedom" in brody.free
    made = compare.compare([grip, brody], Effort(cores=1), lambda _stage, _share: None)
    values = made.frames["quantities"].set_index(["name", "model"])
    for model in ("grip-slip", "brody"):
        assert values.loc[("mu", model), "median"] == pytest.approx(0.3, abs=0.005)
    assert ("e_x", "grip-slip") not in values.index


def refused(code, table, **asked):
    with pytest.raises(fitball.FitballError) as caught:
        fitball.compare(table, progress=False, **asked)
    assert caught.value.code == code


def test_what_cannot_be_compared_is_refused(table):
    refused("one-model", table, models="brody")
    refused("model-twice", table, models="two-mass,two-mass+offset=contact")
    refused("unknown-model", table, models="two-mass,tow-mass")
    refused("unknown-parameter", table, models="brody,grip-slip", fix={"eps_10": 0.0})
    refused("unknown-parameter", table, models="brody,grip-slip", prior={"mue": "normal(0.5, 0.1)"})
    refused("too-few-impacts", table.iloc[:2], models="brody,grip-slip")
    refused("one-model", table[["v_y1", "v_y2"]])


def never(v_x1, v_y1, omega_1, ball, a="normal(0, 1)"):
    return np.where(v_y1 > 15.0, np.nan, v_x1), v_y1, omega_1


def test_a_model_that_cannot_be_fitted_leaves_the_others(table):
    known = load_data([table], Scene(), True)
    problems = compare.problems_of(*known, ONE, ["grip-slip", "brody"], False)
    own = compare.build_problem(*known, ONE, fitball.model_from(never))
    made = compare.compare([*problems, own], Effort(cores=1), lambda _stage, _share: None)
    assert set(made.frames["models"]["model"]) == {"grip-slip", "brody"}
    assert made.exit_code == 1
    assert [note.code for note in made.notes].count("not-fitted") == 1
    with pytest.raises(fitball.FitballError) as caught:
        compare.compare([own, problems[0]], Effort(cores=1), lambda _stage, _share: None)
    assert caught.value.code == "one-model"


def test_interrupted_it_returns_what_is_done(table, monkeypatch):
    known = load_data([table], Scene(), True)
    problems = compare.problems_of(*known, ONE, ["grip-slip", "brody", "thesis-exact"], False)
    order = compare.as_completed

    def stops(after):
        def some(make, items, cores):
            for place, item in list(order(make, items[1:], 1))[:after]:
                yield place + 1, item
            raise KeyboardInterrupt

        return some

    monkeypatch.setattr(compare, "as_completed", stops(2))
    made = compare.compare(problems, Effort(), lambda _stage, _share: None)
    assert set(made.frames["models"]["model"]) == {"grip-slip", "brody"}
    assert made.exit_code == 1
    assert "interrupted" in {note.code for note in made.notes}
    monkeypatch.setattr(compare, "as_completed", stops(1))
    with pytest.raises(KeyboardInterrupt):
        compare.compare(problems, Effort(), lambda _stage, _share: None)


def test_what_not_all_predict_is_not_scored(table):
    timed = table.assign(contact_time=0.005)
    known = load_data([timed], Scene(), True)
    problems = compare.problems_of(*known, ONE, ["thesis-exact", "brody"], False)
    columns = compare._common(problems)
    assert columns == ("v_x2", "v_y2", "omega_2")
    notes = [
        note for note in compare._remarks(problems, columns, {}, 0.0) if note.code == "not-scored"
    ]
    assert len(notes) == 1
    assert "contact_time" in notes[0].text


def test_few_impacts_have_no_recommendation_and_pages_say_so(table, compared):
    few = fitball.compare(
        table.iloc[:5],
        models="brody,grip-slip",
        pool={"all": "none"},
        cores=1,
        progress=False,
    )
    assert not few.frames["models"][["simplest", "worse"]].any(axis=None)
    assert "few-impacts" in {note.code for note in few.notes}
    for result in (few, compared):
        assert page.report(result).summary[0].lines[0].tone == ("part" if result is few else "good")
        assert "brody" in result.report()
        assert result.plot("scores").get_axes()


def test_the_page_names_the_simplest_and_who_is_not_worse_and_the_figure_shows_the_frame(compared):
    models = compared.frames["models"]
    drawn = compared.plot("scores")
    assert not cut_off(drawn)
    for axis, name in zip(drawn.axes[1:], ("v_x2", "v_y2", "omega_2"), strict=True):
        np.testing.assert_allclose(
            axis.collections[0].get_offsets()[:, 0],
            models[f"rms_{name}"],
            rtol=1e-12,
        )
    alone = page.report(compared).summary[0].lines
    # brody is worse, and has fewer parameters.
    assert not any("brody" in one for one in alone[:3])
    assert any("fewer parameters predicts" in one for one in alone)
    equal = Frames("report.compare", {**compared.frames, "models": models.assign(worse=False)})
    assert any(
        "Not significantly worse" in one and "brody" in one
        for one in page.report(equal).summary[0].lines
    )
    fewest = Frames(
        "report.compare",
        {**compared.frames, "models": models.assign(parameters=[3, 9])},
    )
    assert any("No other has fewer" in one for one in page.report(fewest).summary[0].lines)


@pytest.mark.parametrize("better", [True, False])
@pytest.mark.parametrize("sure", [True, False])
def test_whether_the_second_mass_is_worth_it_is_said_of_the_one_that_is_behind(better, sure):
    models = [
        ("two-mass+normal=total", -50.0 - 9.0 * (not better)),
        ("brody", -50.0 - 9.0 * better),
    ]
    best = max(score for _, score in models)
    rows = [
        {"model": name, "elpd": score, "difference": score - best, "worse": sure and score < best}
        for name, score in models
    ]
    words = page._second_mass(rows)
    assert "9.0 higher" in words if better else "9.0 lower" in words
    assert ("not significantly" in words) != sure
    assert "significantly" in words
    assert not page._second_mass(rows[:1])


def test_by_the_command_line(tmp_path, capsys, table):
    place = tmp_path / "hits.csv"
    table.to_csv(place, index=False)
    words = [
        "compare",
        str(place),
        "--models",
        "brody,grip-slip",
        "--pool",
        "all=none",
        "--out",
        str(tmp_path / "c"),
    ]
    assert main([*words, "--json", "--cores", "1"]) == 0
    rows = json.loads(capsys.readouterr().out)["frames"]["models"]
    assert [row["model"] for row in rows] == ["grip-slip", "brody"]
    written = {one.name for one in (tmp_path / "c").iterdir()}
    assert {"models.csv", "left_out.csv", "quantities.csv", "scores.png", "report.html"} <= written
    assert pd.read_csv(tmp_path / "c" / "left_out.csv").shape[0] == 36
    assert main(["compare", str(place), "--models", "brody", "--out", str(tmp_path / "d")]) == 2
    assert not (tmp_path / "d").exists()
