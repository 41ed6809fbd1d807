"""Comparisons: leave-one-out of a line in closed form, ArviZ, scipy; choices, failures and
interruptions.
"""

import json

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from scipy import optimize
from support.drawn import cut_off
from support.fit_by_hand import table_of

import fitball
from fitball.base.findings import Findings
from fitball.cli import main
from fitball.data.load import load_data
from fitball.data.scene import Scene
from fitball.inference.effort import Effort
from fitball.inference.problem.problem import Choices
from fitball.report import compare as page
from fitball.report.frame_rows import frame_rows
from fitball.uses import compare

ONE = Choices(pool={"all": "none"})


def no_progress(_stage, _share):
    """Shows nothing."""


def test_stacking_is_the_best_mixture():
    elpd = np.random.default_rng(2).normal(-3.0, 1.0, (40, 4))
    elpd[:, 3] -= 6.0
    weights, gap = compare.stacking(elpd)

    def loss(shares):
        return -np.mean(np.log(np.exp(elpd) @ shares))

    def loss_of_free(free):
        # Softmax: on the simplex whatever the numbers.
        shares = np.exp(free - free.max())
        return loss(shares / shares.sum())

    minima = [optimize.minimize(loss_of_free, start, tol=1e-12) for start in np.eye(4)]
    best = min(minimum.fun for minimum in minima)
    assert weights.sum() == pytest.approx(1.0)
    assert weights[3] < 1e-3
    assert gap < compare.STACKING_GAP
    assert loss(weights) == pytest.approx(best, abs=2e-6)
    # Equal models share; scores far apart overflow nothing.
    weights_of_equals, _ = compare.stacking(np.full((5, 2), -800.0))
    assert_allclose(weights_of_equals, 0.5)
    weights_far_apart, _ = compare.stacking(np.array([[0.0, -2000.0]] * 5))
    assert_allclose(weights_far_apart, [1.0, 0.0])


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
    assert first["model"] == "grip-slip"
    assert first["simplest"]
    assert second["model"] == "brody"
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
    mu = values.loc[("mu", "grip-slip")]
    assert abs(mu["median"] - 0.6) < 3.0 * mu["sd"]
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
    loaded = load_data([table], Scene(), True)
    choices = Choices(
        "",
        fix={"e_x": 0.1},
        prior={"mu": "normal(0.3, 0.001)"},
        pool={"all": "none"},
        noise="student-t",
    )
    grip, brody = compare.problems_of(*loaded, choices, ["grip-slip", "brody"], False)
    assert "e_x" not in grip.free
    assert "degrees_of_freedom" in brody.free
    result = compare.compare([grip, brody], Effort(cores=1), no_progress)
    values = result.frames["quantities"].set_index(["name", "model"])
    for model in ("grip-slip", "brody"):
        assert values.loc[("mu", model), "median"] == pytest.approx(0.3, abs=0.005)
    assert ("e_x", "grip-slip") not in values.index


def refused(code, table, **asked):
    with pytest.raises(fitball.FitballError) as caught:
        fitball.compare(table, progress=False, **asked)
    assert caught.value.code == code


DROPS = "two-mass+normal=total"


def test_what_cannot_be_compared_is_refused(table):
    refused("one-model", table, models="brody")
    refused("model-twice", table, models="two-mass,two-mass+offset=contact")
    refused("unknown-model", table, models="two-mass,tow-mass")
    refused("unknown-parameter", table, models="brody,grip-slip", fix={"eps_10": 0.0})
    refused("unknown-parameter", table, models="brody,grip-slip", prior={"mue": "normal(0.5, 0.1)"})
    refused("too-few-impacts", table.iloc[:2], models="brody,grip-slip")
    refused("one-model", table[["v_y1", "v_y2"]], models="two-mass+normal=total")


def straight(v_x1, v_y1, omega_1, ball, e="uniform(0, 1)"):
    """A function of one's own: what falls straight rises straight."""
    return v_x1, e * v_y1, omega_1


CHOICES = {"pool": {"all": "none"}, "fix": {"mu": 0.55}, "prior": {"e_x": "normal(0.1, 0.2)"}}


def test_a_fit_compares_on_its_own_table_with_its_own_choices(table):
    """As the verb does that is given all of them."""
    fit = fitball.calibrate(table, model="grip-slip", point_only=True, seed=3, **CHOICES)
    result = fit.compare(models="grip-slip,brody", cores=1, progress=False)
    wanted = fitball.compare(
        table, models="grip-slip,brody", seed=3, cores=1, progress=False, **CHOICES
    )
    assert isinstance(result, fitball.Frames)
    for name, frame in wanted.frames.items():
        pd.testing.assert_frame_equal(result.frames[name], frame)


def test_choices_of_a_fit_that_concern_no_other_model_are_idle(table):
    """The offset is a parameter of grip-slip, and places have no spread in a fit."""
    fit = fitball.calibrate(
        table,
        model="grip-slip",
        fix={"offset": 0.001},
        prior={"rating_spread": "half-normal(2)", "mu": "normal(0.5, 0.2)"},
        pool={"e_x": "surface"},
        point_only=True,
    )
    for problem in compare.problems_of_fit(fit, ["brody", "thesis-exact"], False):
        assert problem.choices.prior == {"mu": "normal(0.5, 0.2)"}
        assert not problem.choices.fix
        assert not problem.choices.pool
    # A misspelt choice of the verb is refused.
    loaded = (fit.run.table, fit.run.scene, fit.run.choices)
    with pytest.raises(fitball.FitballError) as caught:
        compare.problems_of(*loaded, ["brody", "thesis-exact"], False)
    assert caught.value.code == "unknown-parameter"


@pytest.mark.parametrize(
    ("model", "text"),
    [("grip-slip", "grip-slip"), ("two-mass+spin=shell+offset=grip", ""), (straight, "")],
)
def test_a_fit_compares_its_own_model_with_those_that_can_differ(table, model, text):
    user_model = fitball.model_from(model) if callable(model) else model
    fit = fitball.calibrate(table, model=user_model, point_only=True, as_read=True)
    problems = compare.problems_of_fit(fit, (), True)
    texts = [problem.forward.model.text for problem in problems]
    assert texts.count(fit.problem.forward.model.text) == 1
    assert len(texts) == len({*texts})
    usual = [
        problem.forward.model.text
        for problem in compare.problems_of(fit.run.table, fit.run.scene, Choices(), (), True)
    ]
    assert {*usual} - {*texts} == set()
    assert len(texts) == len(usual) + (text == "")


def test_columns_that_part_the_impacts_alike_are_one_way_to_leave_them_out(table):
    """As surfaces that have a table each, which are fitted together."""
    hard, clay = (rows for _, rows in table.groupby("surface"))
    fit = fitball.calibrate(
        [hard, clay], model="grip-slip", point_only=True, pool={"mu": "surface"}
    )
    assert {"surface", "table"} <= fit.run.table.labels.keys()
    assert list(compare._folds(fit.run.table)) == ["surface"]
    result = fit.compare(models="grip-slip,brody", cores=1, progress=False)
    models = result.frames["models"]
    assert "rms_v_x2_without_surface" in models
    assert not any("without_table" in name for name in models)
    # The pool of the fit counts in both models.
    quantities = result.frames["quantities"]
    for model in ("grip-slip", "brody"):
        names = {*quantities["name"][quantities["model"] == model]}
        assert "mu[hard]" in names
        assert "mu" not in names
    other = hard.assign(day=["a", "b"] * (len(hard) // 2) + ["a"] * (len(hard) % 2))
    folds = compare._folds(fitball.load_table(other))
    assert list(folds) == ["day"]
    assert sorted(np.concatenate(folds["day"])) == list(range(len(hard)))


def drops_by_a_power(rng):
    """Drops whose restitution is a power of their speed, from a crawl to a smash."""
    speed = np.geomspace(2.0, 30.0, 40)
    v_y2 = 0.76 * (speed / 10.0) ** -0.158 * speed
    return pd.DataFrame({"v_y1": speed, "v_y2": v_y2 + 0.05 * rng.standard_normal(40)})


def test_laws_of_restitution_are_compared_on_drops():
    drops = drops_by_a_power(np.random.default_rng(2))
    result = fitball.compare(drops, cores=1, progress=False)
    models = result.frames["models"].set_index("model")
    power = "two-mass+normal=total+cor=power"
    assert {*models.index} == {f"{DROPS}+cor=line", power, DROPS}
    assert models.index[0] == power
    assert models["worse"].drop(power).all()
    quantities = result.frames["quantities"].set_index(["model", "name"])
    slope = quantities.loc[(power, "cor_slope")]
    # The slope of the power at 10 m/s.
    assert slope["q025"] < -0.158 * 0.076 < slope["q975"]


def test_models_of_drops_are_compared_where_they_are_named():
    """By the vertical motion, which is all that the table has."""
    fit = fitball.calibrate("synthetic_drop", point_only=True)
    result = fit.compare(models="two-mass+normal=total,grip-slip", cores=1, progress=False)
    models = result.frames["models"]
    # Both have the same law of restitution, and nothing else acts.
    assert np.ptp(models["elpd"]) < 0.1
    assert np.ptp(models["rms_v_y2"]) < 1e-3
    assert "rms_v_x2" not in models
    assert "few-impacts" in {note.code for note in result.notes}


def never(v_x1, v_y1, omega_1, ball, a="normal(0, 1)"):
    return np.where(v_y1 > 15.0, np.nan, v_x1), v_y1, omega_1


def test_a_model_that_cannot_be_fitted_leaves_the_others(table):
    loaded = load_data([table], Scene(), True)
    problems = compare.problems_of(*loaded, ONE, ["grip-slip", "brody"], False)
    impossible = compare.build_problem(*loaded, ONE, fitball.model_from(never))
    result = compare.compare([*problems, impossible], Effort(cores=1), no_progress)
    assert set(result.frames["models"]["model"]) == {"grip-slip", "brody"}
    assert result.failed
    codes = [note.code for note in result.notes]
    assert codes.count("not-fitted") == 1
    with pytest.raises(fitball.FitballError) as caught:
        compare.compare([impossible, problems[0]], Effort(cores=1), no_progress)
    assert caught.value.code == "one-model"


def test_interrupted_it_returns_what_is_done(table, monkeypatch):
    loaded = load_data([table], Scene(), True)
    models = ["grip-slip", "brody", "thesis-exact"]
    problems = compare.problems_of(*loaded, ONE, models, False)
    as_completed = compare.as_completed

    def interrupted_after(count):
        """As the real one, of all tasks but the first, until the interruption."""

        def as_completed_until(make, tasks, _cores):
            results = list(as_completed(make, tasks[1:], 1))
            for number, result in results[:count]:
                yield number + 1, result
            raise KeyboardInterrupt

        return as_completed_until

    monkeypatch.setattr(compare, "as_completed", interrupted_after(2))
    result = compare.compare(problems, Effort(), no_progress)
    assert set(result.frames["models"]["model"]) == {"grip-slip", "brody"}
    assert result.failed
    assert "interrupted" in {note.code for note in result.notes}
    monkeypatch.setattr(compare, "as_completed", interrupted_after(1))
    with pytest.raises(KeyboardInterrupt):
        compare.compare(problems, Effort(), no_progress)


def test_what_not_all_predict_is_not_scored(table):
    timed = table.assign(contact_time=0.005)
    loaded = load_data([timed], Scene(), True)
    problems = compare.problems_of(*loaded, ONE, ["thesis-exact", "brody"], False)
    columns = compare._common_columns(problems)
    assert columns == ("v_x2", "v_y2", "omega_2")
    notes = compare._remarks(problems, columns, {}, 0.0)
    (not_scored,) = (note for note in notes if note.code == "not-scored")
    assert "contact_time" in not_scored.text


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
    for result, tone in ((few, "part"), (compared, "good")):
        first_line = page.report(result).summary[0].lines[0]
        assert first_line.tone == tone
        assert "brody" in result.report()
        assert result.plot("scores").get_axes()


def test_the_page_names_the_simplest_and_who_is_not_worse_and_the_figure_shows_the_frame(compared):
    models = compared.frames["models"]
    drawn = compared.plot("scores")
    assert not cut_off(drawn)
    for axis, name in zip(drawn.axes[1:], ("v_x2", "v_y2", "omega_2"), strict=True):
        drawn_at = axis.collections[0].get_offsets()[:, 0]
        assert_allclose(drawn_at, models[f"rms_{name}"], rtol=1e-12)

    def answer(models):
        """First lines of the page of a comparison with these models."""
        changed = Findings({**compared.frames, "models": models})
        return page.report(changed).summary[0].lines

    alone = answer(models)
    # brody is worse, and has fewer parameters.
    assert not any("brody" in words for words in alone[:3])
    assert any("fewer parameters predicts" in words for words in alone)
    equal = answer(models.assign(worse=False))
    assert any("Not significantly worse" in words and "brody" in words for words in equal)
    fewest = answer(models.assign(parameters=[3, 9]))
    assert any("No other has fewer" in words for words in fewest)


@pytest.mark.parametrize("better", [True, False])
@pytest.mark.parametrize("sure", [True, False])
def test_whether_the_second_mass_is_worth_it_is_said_of_the_one_that_is_behind(better, sure):
    ahead = {"elpd": -50.0, "difference": 0.0, "worse": False}
    behind = {"elpd": -59.0, "difference": -9.0, "worse": sure}
    rows = [
        {"model": "two-mass+normal=total", **(ahead if better else behind)},
        {"model": "brody", **(behind if better else ahead)},
    ]
    words = page._second_mass(frame_rows(pd.DataFrame(rows)))
    assert ("9.0 higher" if better else "9.0 lower") in words
    assert ("not significantly" in words) != sure
    assert "significantly" in words
    assert not page._second_mass(frame_rows(pd.DataFrame(rows[:1])))


def test_by_the_command_line(tmp_path, capsys, table):
    path = tmp_path / "hits.csv"
    table.to_csv(path, index=False)
    words = [
        "compare",
        str(path),
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
    names = {path.name for path in (tmp_path / "c").iterdir()}
    assert {"models.csv", "left_out.csv", "quantities.csv"} <= names
    assert {"scores.png", "report.html"} <= names
    assert pd.read_csv(tmp_path / "c" / "left_out.csv").shape[0] == 36
    assert main(["compare", str(path), "--models", "brody", "--out", str(tmp_path / "d")]) == 2
    assert not (tmp_path / "d").exists()
