"""Predictions of new impacts: coverage with stated errors, levels, ranges, scores; readings and
refusals.
"""

import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from msgspec.structs import replace as replace_fields
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from support.drawn import bars, cut_off, dots
from support.fit_by_hand import fit_by_hand, table_of

import fitball
from fitball.base import environment
from fitball.cli import main
from fitball.data.scene import Scene
from fitball.inference import predictive
from fitball.inference.forward import Draws
from fitball.inference.judgement.rivals import Rival
from fitball.inference.schema import Alternative, NoiseCheck, ResidualTest
from fitball.report import predict as page
from fitball.report.render import to_text
from fitball.uses.misfit import misfit_sds
from fitball.uses.predict import table_in_words

REBOUND = ("v_x2", "v_y2", "omega_2")
NOISES = {"v_x2": "v_x_sd", "v_y2": "v_y_sd", "omega_2": "spin_sd"}


def fit_with_variants(*table, tried=(), **choices):
    """A fit of which these variants were tried."""
    plain = fit_by_hand(*table, **choices)
    fit = replace(plain, alternatives=tried)
    fit.__dict__["built"] = plain.built
    return fit


@pytest.fixture(scope="module")
def fit():
    return fit_with_variants()


@pytest.fixture(scope="module")
def surfaces():
    """A fit to clay, hit slowly, and hard, hit fast: surfaces in turn, clay even rows."""
    frame = table_of(surfaces=("clay", "hard"))
    fast = frame.loc[1::2, ["v_x1", "v_y1", "v_x2", "v_y2"]] * 1.6
    frame.loc[1::2, ["v_x1", "v_y1", "v_x2", "v_y2"]] = fast
    fit = fit_with_variants(frame)
    draws = fit.draws
    prior = fit.problem.prior
    rng = np.random.default_rng(6)
    free = np.stack([draws.values[name] for name in fit.problem.free], axis=1)
    beyond = prior.draw_new_levels(prior.coordinate(free), rng)
    values = {**draws.values, **beyond}
    best = dict(draws.best)
    for name, column in beyond.items():
        best[name] = np.median(column, keepdims=True)
    fit.built.draws = Draws(draws.point, values, best)
    return fit


def predictions(fit, *table, **choices):
    return fit.predict(*table, **choices).frames["predictions"]


def scores_of(fit, table):
    return fit.predict(table).frames["scores"].set_index("column")


def rows_of(result, column):
    """Predictions of one column."""
    frame = result.frames["predictions"]
    return frame[frame["column"] == column].reset_index(drop=True)


def new_table(count, rng, fit, errors):
    """Impacts within the fit's range whose states are measured with `errors`, each with the rebound
    of a draw of the posterior at its true state, and noise; what a laboratory would have.
    """
    fitted = fit.problem.rows.states
    draw = rng.integers(len(fit.draws.values["mu"]), size=count)
    measured = fitted.take(rng.integers(len(fitted), size=count))
    values = {name: column[draw] for name, column in fit.draws.values.items()}
    true = []
    for name, sd in errors.items():
        error = sd * rng.standard_normal(count)
        true.append(getattr(measured, name) + error)
    # Each impact has the values of its own draw.
    rebounds = []
    for k in range(count):
        of_draw = {name: column[k : k + 1] for name, column in values.items()}
        state = fitball.impacts(*(column[k] for column in true))
        rebounds.append(fit.problem.forward.rebound(of_draw, state))
    table = {name: getattr(measured, name) for name in errors}
    noise = {"v_x2": "v_x_sd", "v_y2": "v_y_sd", "omega_2": "spin_sd"}
    for name in REBOUND:
        exact = np.array([getattr(rebound, name)[0, 0] for rebound in rebounds])
        scatter = values[noise[name]] * rng.standard_normal(count)
        table[name] = exact + scatter
    return pd.DataFrame(table)


def test_intervals_hold_with_errors_of_the_incident_state_and_do_not_without(fit):
    errors = {"v_x1": 0.6, "v_y1": 0.5, "omega_1": 12.0}
    table = new_table(400, np.random.default_rng(11), fit, errors)
    stated = table.assign(**{f"{name}_sd": sd for name, sd in errors.items()})
    # What is left outside of 95 % of 400 is so much, but once in a thousand.
    low, high = stats.binom.ppf([5e-4, 1.0 - 5e-4], 400, 0.95) / 400
    good = scores_of(fit, stated)
    blind = scores_of(fit, table)
    for name in REBOUND:
        assert low <= good.loc[name, "within_95"] <= high, name
        assert blind.loc[name, "within_95"] < low, name
        assert good.loc[name, "rms_z"] < blind.loc[name, "rms_z"]


def test_scores_are_those_of_the_frame_and_say_what_the_fit_had_seen(fit):
    table = table_of()
    mine = fit.predict(table.iloc[:10])
    scores = mine.frames["scores"].set_index("column")
    assert list(scores.index) == list(REBOUND)
    assert (scores["seen"] == 10).all()
    assert (scores["impacts"] == 10).all()
    median = rows_of(mine, "v_x2")["median"].to_numpy()
    residuals = table["v_x2"].to_numpy()[:10] - median
    rms = np.sqrt(np.mean(residuals**2))
    assert scores.loc["v_x2", "bias"] == pytest.approx(residuals.mean())
    assert scores.loc["v_x2", "rms"] == pytest.approx(rms)
    # The same impacts by speed and angle are recognised; others, or other rebounds, are not.
    angle = np.arctan2(table.v_y1, table.v_x1)
    polar = table.assign(v_1=np.hypot(table.v_x1, table.v_y1), theta_1=np.degrees(angle))
    polar = polar.drop(columns=["v_x1", "v_y1"])
    assert scores_of(fit, polar)["seen"].tolist() == [24] * 3
    other = table.copy()
    other.loc[0, "v_y2"] += 0.1
    assert scores_of(fit, other)["seen"].tolist() == [23] * 3
    bare = table.drop(columns=list(REBOUND))
    assert fit.predict(bare).frames["scores"].empty


def test_an_impact_is_predicted_alike_in_a_table_in_words_and_beside_others(fit):
    frame = pd.DataFrame(
        {
            "v_1": [17.0, 20.0],
            "theta_1": [25.0, 40.0],
            "omega_1": [100.0, 0.0],
            "omega_1_sd": 5.0,
        }
    )
    whole = fit.predict(frame).frames["predictions"]
    alone = fit.predict(frame.iloc[1:]).frames["predictions"]
    words = fit.predict(impact="v_1=17, theta_1=25 deg, omega_1=100±5 rad/s").frames["predictions"]
    numbers = ["point", "median", "sd", "q025", "new_q975", "noise", "distance"]
    for row, single in ((0, words), (1, alone)):
        same = whole[whole["row"] == row][numbers].to_numpy()
        assert_allclose(single[numbers].to_numpy(), same, rtol=1e-9)
    grid = table_in_words("v_x1=10..12:3, v_y1=6..8 m/s:2, omega_1=50", Scene())
    assert len(grid) == 6
    assert not grid.sd
    assert set(grid.impacts.v_y1) == {6.0, 8.0}
    assert table_in_words("v_1=20±1, theta_1=45 deg", Scene()).sd["v_x1"] == pytest.approx(
        np.sqrt(0.5)
    )


def test_columns_are_those_that_the_model_predicts(fit):
    state = {"v_x1": [15.0], "v_y1": [7.0], "omega_1": [0.0]}
    columns = predictions(fit, state)["column"].tolist()
    assert columns == ["v_x2", "v_y2", "theta_2", "omega_2"]
    columns = predictions(fit, state | {"v_2": [10.0]})["column"].tolist()
    assert "v_2" in columns
    drop = fit_with_variants(table_of(drop=True), model="two-mass")
    columns = predictions(drop, impact="v_y1=7")["column"].tolist()
    assert columns == ["v_y2", "contact_time"]


def test_levels_by_column_by_option_and_new(surfaces):
    states = pd.DataFrame(
        {
            "v_x1": [15.0] * 2,
            "v_y1": [8.0] * 2,
            "omega_1": [0.0] * 2,
            "surface": ["Clay", "hard"],
        }
    )
    by_column = rows_of(surfaces.predict(states), "v_x2")
    bare = states.drop(columns="surface")
    for row, label in enumerate(("clay", "hard")):
        by_option = rows_of(surfaces.predict(bare, level={"surface": label}), "v_x2")
        assert_array_equal(by_option["median"], [by_column["median"][row]] * 2)
        assert set(by_option["surface"]) == {label}
        assert by_column["surface"][row] == label
    new = surfaces.predict(bare.iloc[:1], level={"surface": "new"})
    # A surface of which nothing was measured is less sure than either.
    sd = rows_of(new, "v_x2")["sd"][0]
    assert sd > 1.5 * by_column["sd"].max()
    assert "new-level" in {note.code for note in new.notes}
    assert {*new.frames["predictions"]["surface"]} == {"new"}


def refused(code, function, *values, **choices):
    """The error, with this code, that a function raises."""
    with pytest.raises(fitball.FitballError) as caught:
        function(*values, **choices)
    assert caught.value.code == code
    return caught.value


def test_what_cannot_be_predicted_is_refused(fit, surfaces, tmp_path):
    state = {"v_x1": [15.0], "v_y1": [8.0], "omega_1": [0.0]}
    on_clay = state | {"surface": ["clay"]}
    on_grass = state | {"surface": ["grass"]}
    not_a_number = {"v_x1": [1.0, "x"], "v_y1": [1, 2], "omega_1": [0, 0]}
    refused("no-impacts", fit.predict)
    refused("no-impacts", fit.predict, state, impact="v_y1=7")
    refused("impact", fit.predict, impact="v_1=17")
    refused("impact", fit.predict, impact="v_1=17, theta_1=200 deg")
    refused("label-missing", surfaces.predict, state)
    refused("unknown-label", surfaces.predict, state, level={"surface": "grass"})
    refused("unknown-label", surfaces.predict, on_grass)
    refused("unknown-level", surfaces.predict, state, level={"court": "clay"})
    refused("unknown-level", fit.predict, state, level={"surface": "clay"})
    refused("level-twice", surfaces.predict, on_clay, level={"surface": "hard"})
    error = refused("not-a-number", fit.predict, not_a_number)
    (fault,) = error.faults
    assert fault.row == 2
    assert fault.column == "v_x1"
    refused("not-found", fit.predict, tmp_path / "none.csv")
    refused("no-fit", fitball.predict, tmp_path, impact="v_y1=7")


def test_extrapolation_is_judged_within_the_surface(surfaces):
    """An impact as the fastest on hard is far from all on clay."""
    table = surfaces.run.table
    speed, _ = table.impacts.polar()
    fastest = int(np.argmax(speed))
    assert table.labels["surface"][fastest] == "hard"
    states = {"surface": ["hard", "clay", "new"]}
    for name in ("v_x1", "v_y1", "omega_1"):
        states[name] = [float(getattr(table.impacts, name)[fastest])] * 3
    frame = rows_of(surfaces.predict(states), "v_x2")
    assert frame["outside"].tolist() == [False, True, False]
    on_hard, on_clay = frame["distance"][:2]
    assert on_hard < 1e-6
    assert on_clay > 3.0


def test_the_range_over_variants_that_fit_equally_well(fit):
    base = dict(fit.draws.point)
    moved = {"mu": 0.3, "e_x": 0.3}

    def alternative(choice, as_good, reason="", **values):
        return Alternative(
            choice,
            "noise=normal",
            "grip-slip",
            {**base, **values},
            {},
            0.0,
            1.0,
            as_good,
            reason,
        )

    tried = (
        alternative("first", True, **moved),
        alternative("other", True, e_x=0.2),
        alternative("worse", False, mu=0.05),
        alternative("none", True, reason="no answer", mu=0.01),
    )
    fit_of_several = fit_with_variants(tried=tried)
    state = {"v_x1": [15.0], "v_y1": [8.0], "omega_1": [0.0]}
    frame = rows_of(fit_of_several.predict(state), "v_x2")
    model = fit.problem.forward.model
    impact = fitball.impacts(15.0, 8.0, 0.0)
    free = {spec.name: base[spec.name] for spec in model.parameters}
    each = []
    for change in ({}, moved, {"e_x": 0.2}):
        rebound = model.rebound({**free, **change}, impact)
        each.append(float(rebound.v_x2[0]))
    assert frame["variant_low"][0] == pytest.approx(min(each), rel=1e-12)
    assert frame["variant_high"][0] == pytest.approx(max(each), rel=1e-12)
    assert max(each) > min(each) + 0.1
    alone = rows_of(fit.predict(state), "v_x2")
    assert alone["variant_low"].isna().all()


def test_new_measurements_are_as_uncertain_as_models_that_predict_as_well(fit):
    base = dict(fit.draws.point)
    state = {"v_x1": [15.0], "v_y1": [8.0], "omega_1": [0.0]}
    alone = fit.predict(state).frames["predictions"].set_index("column")

    def widened(score, count=1, **values):
        """The predictions with rivals of these values that score so much more."""
        best = {name: np.array([value]) for name, value in {**base, **values}.items()}
        rivaled = fit_with_variants()
        rivaled.__dict__["rivals"] = (Rival(fit.problem.forward, best, score),) * count
        return rivaled.predict(state).frames["predictions"].set_index("column")

    shift = 15.0 - alone["point"]["v_x2"]
    assert shift > 1.0
    # Without friction v_x2 stays.
    moved = widened(-3.5, mu=0.0)
    ends = alone.loc["v_x2", ["new_q025", "new_q975"]]
    assert moved["new_q025"]["v_x2"] == ends.iloc[0]
    assert moved["new_q975"]["v_x2"] == pytest.approx(ends.iloc[1] + shift, rel=1e-9)
    assert moved["q975"].equals(alone["q975"])
    # A noise that is larger by half; several rivals widen the fit's interval, not each other's.
    middle = alone["median"]["v_x2"]
    wider = middle + 1.5 * (ends - middle)
    for count in (1, 3):
        noisy = widened(None, count, v_x_sd=1.5 * base["v_x_sd"])
        new = noisy.loc["v_x2", ["new_q025", "new_q975"]].astype(float)
        assert_allclose(new, wider.astype(float))
        assert noisy.loc["omega_2", "new_q975"] == alone.loc["omega_2", "new_q975"]
    # One of which a mixture has less than 2 % is named, and widens nothing.
    behind = widened(-4.5, mu=0.0)
    assert behind["new_q975"].equals(alone["new_q975"])
    assert behind["variant_high"]["v_x2"] == pytest.approx(15.0)


@pytest.mark.parametrize(
    ("answer", "code"),
    [("does not describe", "does-not-describe"), ("describes except", "exceptions")],
)
def test_rebounds_of_a_fit_that_misses_its_data_are_as_uncertain(answer, code):
    """Of v_x2 a trend was found that explains 38 % of the variance of its scatter."""
    good = fit_with_variants()
    bad = fit_with_variants(answer=answer)
    frames = {}
    for name, fit in (("good", good), ("bad", bad)):
        result = fit.predict(table_of(12))
        codes = [note.code for note in result.notes]
        assert (code in codes) == (name == "bad")
        frames[name] = {column: rows_of(result, column) for column in REBOUND}
        first_screen = to_text(page.report(result), full=False)
        assert (fit.adequacy.sentence in first_screen) == (name == "bad")
    scatter = bad.draws.best["v_x_sd"][0]
    added = frames["bad"]["v_x2"]["sd"] ** 2 - frames["good"]["v_x2"]["sd"] ** 2
    assert_allclose(np.sqrt(added), np.sqrt(0.38) * scatter, rtol=0.15)
    new = ["new_q025", "new_q975"]
    assert frames["bad"]["v_x2"][new].equals(frames["good"]["v_x2"][new])
    assert frames["bad"]["omega_2"]["sd"].equals(frames["good"]["omega_2"]["sd"])


def test_the_misfit_is_what_found_patterns_of_the_mean_explain_together():
    fit = fit_with_variants(answer="describes except")

    def sds(tests, noise=()):
        adequacy = replace_fields(fit.adequacy, tests=tests, noise=noise)
        changed = replace(fit, adequacy=adequacy)
        changed.__dict__["built"] = fit.built
        return misfit_sds(changed)

    def found(kind, column, explained, is_found=True):
        return ResidualTest(kind, column, "", 0.001, explained, is_found)

    scatter = {name: fit.draws.best[noise][0] for name, noise in NOISES.items()}
    of_two = sds((found("trend", "v_x2", 0.2), found("drift", "v_x2", 0.3)))
    assert of_two == pytest.approx({"v_x2": np.sqrt(0.5) * scatter["v_x2"]})
    assert sds((found("bias", "v_y2", 0.7), found("law", "v_y2", 0.6)))["v_y2"] == scatter["v_y2"]
    of_all = sds((found("group", "", 0.1),))
    assert of_all == pytest.approx({name: np.sqrt(0.1) * sd for name, sd in scatter.items()})
    assert sds((found("outlier", "v_x2", 0.5), found("trend", "v_x2", 0.5, False))) == {}
    noisy = NoiseCheck("omega_2", 20.0, 5.0, True, True, True)
    assert sds((), (noisy,)) == {"omega_2": scatter["omega_2"]}


def test_no_new_measurement_where_its_error_is_not_known():
    """The fit knows what columns scatter beyond their stated errors; a new table without these has
    no intervals.
    """
    fit = fit_with_variants(table_of().assign(v_x2_sd=0.2))
    state = pd.DataFrame(
        {
            "v_x1": [15.0] * 2,
            "v_y1": [8.0] * 2,
            "omega_1": [0.0] * 2,
            "v_x2": [9.0, 9.5],
        }
    )
    bare = fit.predict(state)
    stated = fit.predict(state.assign(v_x2_sd=[0.1, 0.5]))
    unknown = rows_of(bare, "v_x2")
    assert unknown["new_q025"].isna().all()
    assert unknown["noise"].isna().all()
    assert rows_of(bare, "v_y2")["new_q025"].notna().all()
    assert "unknown-noise" in {note.code for note in bare.notes}
    wide = rows_of(stated, "v_x2")["noise"]
    scatter = np.sqrt(np.mean(fit.draws.values["v_x_sd"] ** 2))
    assert_allclose(wide, np.hypot(scatter, [0.1, 0.5]), rtol=1e-9)
    # Errors of states beside it change nothing in that.
    both = fit.predict(state.assign(v_y1_sd=0.3))
    assert rows_of(both, "v_x2")["new_q025"].isna().all()
    assert rows_of(both, "v_y2")["new_q025"].notna().all()


def test_blocks_and_threads_are_one_piece_and_long_tables_use_fewer_draws(fit, monkeypatch):
    rng = np.random.default_rng(3)
    table = {
        "v_x1": rng.uniform(8, 20, 300),
        "v_y1": rng.uniform(4, 12, 300),
        "omega_1": rng.uniform(-100, 100, 300),
    }
    at_once = predictions(fit, table)
    all_draws = len(fit.draws.values["mu"])
    monkeypatch.setattr(predictive, "_BLOCK", 7 * all_draws)
    for cores in (1, 3):
        with environment.threads(cores):
            in_blocks = predictions(fit, table)
        pd.testing.assert_frame_equal(in_blocks, at_once, rtol=1e-12)
    monkeypatch.setattr(predictive, "_FEWEST", 40)
    monkeypatch.setattr(predictive, "PREDICTED_ROWS", 4)
    fewer = predictions(fit, table)
    count = predictive.PREDICTION_DRAWS * 4 // 300
    chosen = (np.arange(count) * 400) // count
    values = {name: column[chosen] for name, column in fit.draws.values.items()}
    thinned = fit_with_variants()
    thinned.__dict__["built"] = type(fit.built)(
        problem=fit.problem,
        draws=Draws(fit.draws.point, values, fit.draws.best),
    )
    monkeypatch.setattr(predictive, "PREDICTED_ROWS", 20_000)
    assert_array_equal(predictions(thinned, table)["q975"], fewer["q975"])
    assert len(values["mu"]) == count
    assert count < all_draws


def rows_of_page(result):
    """Rows of the first table of the page."""
    blocks = page.report(result).summary
    return next(block.rows for block in blocks if getattr(block, "rows", None))


def test_pages_of_one_impact_of_many_and_without_an_answer(fit):
    single = fit.predict(impact="v_1=17, theta_1=30 deg, omega_1=0")
    many = fit.predict(impact="v_1=15..60:4, theta_1=30 deg, omega_1=0")
    assert page.report(single).summary[0].lines[0].tone == "good"
    assert page.report(many).summary[0].lines[0].tone == "part"
    remarks = [row["remark"] for row in rows_of_page(many)]
    assert remarks == ["", "extrapolated", "extrapolated", "extrapolated"]
    for result in (single, many):
        assert len(result.plot("rebounds").get_axes()) == 4
    shown = {row[""]: float(row["median"]) for row in rows_of_page(single)}
    median = rows_of(single, "v_x2")["median"][0]
    assert shown["v_x2"] == pytest.approx(median, abs=0.06)
    point = fit_with_variants(sampled=False).predict(impact="v_1=17, theta_1=30 deg, omega_1=0")
    frame = point.frames["predictions"]
    assert frame[["median", "new_q025"]].isna().all(axis=None)
    assert frame["point"].notna().all()
    assert "theta_2" in point.report()
    assert point.plot("rebounds").get_axes()
    hostile = fit.predict(
        {
            "id": ["<b>$x", "a\x1b[31m"],
            "v_x1": [15, 16],
            "v_y1": [7, 8],
            "omega_1": [0, 0],
        }
    )
    assert "\x1b" not in hostile.report()
    assert hostile.plot("rebounds").get_axes()


def test_the_page_says_which_impacts_are_outside_and_the_figure_shows_the_frame(fit):
    table = table_of().iloc[:6]
    within = fit.predict(table)
    assert "outside" not in within.report(full=False)
    assert "all within" in within.report(full=False)
    frame = fit.predict(table.assign(v_x1=table["v_x1"] * [1, 9, 1, 1, 1, 1]))
    assert "1 outside" in frame.report(full=False)
    assert "(impact 2)" in frame.report(full=False)
    drawn = within.plot("rebounds")
    assert not cut_off(drawn)
    for axis, name in zip(drawn.axes, ("v_x2", "v_y2", "theta_2", "omega_2"), strict=True):
        mine = rows_of(within, name)
        unit = 180.0 / np.pi if name == "theta_2" else 1.0
        new = unit * mine[["new_q025", "new_q975"]].to_numpy()
        central = unit * mine[["q16", "q84"]].to_numpy()
        wide, narrow = bars(axis)
        assert_allclose(wide[:, :, 1], new, rtol=1e-12)
        assert_allclose(narrow[:, :, 1], central, rtol=1e-12)
        assert_allclose(dots(axis, "_")[:, 1], unit * mine["median"], rtol=1e-12)
        assert_allclose(dots(axis, "o")[:, 1], unit * mine["observed"], rtol=1e-12)


def test_new_impacts_are_read_as_those_of_the_fit(tmp_path, capsys):
    """Names, units and signs of the fit's own file, of which the spin counts backwards; by the
    command line.
    """
    table = table_of(16)
    theirs = pd.DataFrame(
        {
            "Vin": table.v_x1 * 3.6,
            "down": table.v_y1,
            "spin": -table.omega_1,
            "Vout": table.v_x2 * 3.6,
            "v_y2": table.v_y2,
            "omega_2 [rpm]": -table.omega_2 * 30 / np.pi,
        }
    )
    theirs.to_csv(tmp_path / "theirs.csv", index=False)
    table.drop(columns="id").to_csv(tmp_path / "ours.csv", index=False)
    options = ["--model", "brody", "--point-only", "--figures", "none", "--quiet"]
    named = [
        "--columns",
        "v_x1=Vin [km/h],v_y1=down,omega_1=spin,v_x2=Vout [km/h]",
        "--flip",
        "omega_1,omega_2",
    ]
    ours = tmp_path / "ours"
    for name, more in (("theirs", named), ("ours", [])):
        file = str(tmp_path / f"{name}.csv")
        out = ["--out", str(tmp_path / name)]
        assert main(["calibrate", file, *more, *options, *out]) == 0
    # Without rebounds, and without a unit in the header.
    their_states = theirs[["Vin", "down", "spin"]].iloc[:4]
    our_states = table[["v_x1", "v_y1", "omega_1"]].iloc[:4]
    their_states.to_csv(tmp_path / "new.csv", index=False)
    our_states.to_csv(tmp_path / "same.csv", index=False)
    capsys.readouterr()
    points = []
    for name, new_states in (("theirs", "new.csv"), ("ours", "same.csv")):
        assert main(["predict", str(tmp_path / name), str(tmp_path / new_states), "--json"]) == 0
        record = json.loads(capsys.readouterr().out)
        frame = pd.DataFrame(record["frames"]["predictions"])
        points.append(frame["point"].astype(float))
    assert_allclose(points[0], points[1], rtol=1e-5)
    written = {path.name for path in (ours / "predict").iterdir()}
    assert {"predictions.csv", "report.html", "rebounds.png"} <= written
    assert not [*ours.glob("*.png")]
    out = ["--out", str(tmp_path / "x")]
    assert main(["predict", str(ours), "--impact", "v_1=17", *out]) == 2
    assert not (tmp_path / "x").exists()
    refused("own-model", fitball.load_fit, ours, "brody")


def test_a_fit_of_ones_own_model_needs_its_function(tmp_path):
    table_of(10).to_csv(tmp_path / "balls.csv", index=False)
    file = tmp_path / "mine.py"
    file.write_text(
        "def roll(v_x1, v_y1, omega_1, ball, k='normal(0.6, 0.2)'):\n    return k * v_x1, v_y1, "
        "v_x1\n"
    )
    model = f"{file}:roll"
    table = tmp_path / "balls.csv"
    folder = tmp_path / "fit"
    fitball.calibrate(table, model=model, point_only=True, progress=False).save(folder)
    impact = "v_x1=10, v_y1=7"
    result = fitball.predict(folder, impact=impact, model=model)
    best = fitball.load_fit(folder, model).point.optima[0]["k"]
    predicted = rows_of(result, "v_x2")["point"][0]
    assert predicted == pytest.approx(10.0 * best, rel=1e-12)
    refused("own-model", fitball.predict, folder, impact=impact)


def test_shares_inside_and_outside_of_the_range_are_told_apart(fit):
    """Measured as predicted within the range, and far from it beyond."""
    states = pd.DataFrame({"v_x1": [14.0, 15.0, 90.0], "v_y1": [8.0, 9.0, 50.0], "omega_1": 0.0})
    frame = fit.predict(states).frames["predictions"]
    assert frame.groupby("row")["outside"].first().tolist() == [False, False, True]
    medians = frame.pivot(index="row", columns="column", values="median")[list(REBOUND)]
    measured = medians.reset_index(drop=True)
    measured.loc[2] += 1e-3 * measured.loc[2] + [9.0, 9.0, 900.0]
    both = fit.predict(pd.concat([states, measured], axis=1))
    # After the shares of 95 % intervals of all.
    assert percents_of(both)[2:] == [100, 0]
    # Where all are inside there is nothing to tell apart.
    inside = fit.predict(pd.concat([states, measured], axis=1).iloc[:2])
    assert percents_of(inside) == [95, 100]


def percents_of(result):
    """The percentages in the first sentences of a page of predictions."""
    words = " ".join(str(line) for line in page.report(result).summary[0].lines)
    return [int(number) for number in re.findall(r"(\d+) %", words)]
