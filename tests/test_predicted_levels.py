"""Predictions where parameters differ between surfaces and balls: each impact has those of its own label."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_predict import CENTRE, NAMES, bounce, fitted_grip_slip

import fitball
from fitball.api.simulating import Subject, page_of, regimes_of
from fitball.cli.main import main
from fitball.errors import ParameterError
from fitball.inference.prediction.impact_levels import levels_of_impacts, new_words
from fitball.inference.prediction.new_impacts import _point_rebound, predict_new
from fitball.inference.problem.pooling import Levels
from fitball.report.predict.document import answer, predict_document
from fitball.report.predict.rows import prediction_csv_rows, prediction_json

MU, COR = (0.05, 3.0), (0.05, 0.999)
LEVELS = (
    Levels("mu", "surface", ("clay", "hard"), True, MU),
    Levels("cor_10", "ball", ("old", "new", "Dünn"), False, COR),
)
PLACES = {"clay": 1.0, "hard": -0.5, "old": -1.0, "new": 0.0, "Dünn": 1.5}
SPREADS = {"mu": 0.3, "cor_10": 0.03}


def with_levels(draws=2000, levels=LEVELS, spreads=SPREADS):
    """Grip-slip with mu by surface and cor_10 by ball, places and spreads the same in every draw."""
    plain = fitted_grip_slip(draws=draws)
    names, extra = list(NAMES), []
    for item in levels:
        names += [item.spread_name, *map(item.place_name, item.labels)]
        extra += [spreads[item.parameter], *(PLACES[label] for label in item.labels)]
    rows = np.tile(extra, (draws, 1))
    return replace(
        plain, names=tuple(names), point=np.concatenate([CENTRE, extra]), draws=np.hstack([plain.draws, rows]),
        levels=tuple(levels),
    )  # fmt: skip


def own(plain_draws, surface, ball):
    """The draws (draws, 7) of a surface and a ball, written anew."""
    values = plain_draws[:, :7].copy()
    values[:, 0] *= np.exp(SPREADS["mu"] * PLACES[surface])
    values[:, 3] += SPREADS["cor_10"] * PLACES[ball]
    return values


# Combinations that come again, in an order that its inverse is not.
IMPACTS = fitball.impacts(
    [15.0, 15.0, 12.0, 14.0, 15.0, 13.0], [6.0, 6.0, 9.0, 7.0, 6.0, 8.0], [0.0, 0.0, 20.0, -30.0, 0.0, 10.0]
)
WHERE = {
    "surface": ("clay", "hard", "hard", "clay", "hard", "clay"),
    "ball": ("old", "Dünn", "Dünn", "old", "new", "old"),
}


def test_each_impact_has_the_parameters_of_its_own_surface_and_ball():
    fitted = with_levels()
    found = predict_new(fitted, IMPACTS, levels=WHERE)
    for k, (surface, ball) in enumerate(zip(WHERE["surface"], WHERE["ball"], strict=True)):
        state = IMPACTS.v_x1[k], IMPACTS.v_y1[k], IMPACTS.omega_1[k]
        truth = bounce(own(fitted.draws, surface, ball), *state)
        point = bounce(own(fitted.point[None, :], surface, ball), *state)
        for name, drawn, one in zip(("v_x2", "v_y2", "omega_2"), truth, point, strict=True):
            assert found.output(name).rebound[2, k] == pytest.approx(np.median(drawn), rel=1e-9)
            assert found.output(name).point[k] == pytest.approx(one[0], rel=1e-9)
    assert found.levels == WHERE
    assert found.regimes[0] != found.regimes[1]


def test_the_order_of_rows_changes_nothing_but_their_order():
    fitted, order = with_levels(), np.array([3, 1, 5, 0, 2, 4])
    found = predict_new(fitted, IMPACTS, levels=WHERE)
    turned = {column: [labels[k] for k in order] for column, labels in WHERE.items()}
    again = predict_new(fitted, IMPACTS.take(order), levels=turned)
    assert np.array_equal(again.output("v_x2").rebound, found.output("v_x2").rebound[:, order])
    assert again.regimes == tuple(found.regimes[k] for k in order)


def test_the_alternatives_of_a_fit_are_taken_at_the_levels_of_each_impact():
    fitted = replace(with_levels(), draws=np.empty((0, len(with_levels().names))))
    made = _point_rebound(fitted, IMPACTS, WHERE)
    assert made.v_x2[0] == pytest.approx(predict_new(fitted, IMPACTS, levels=WHERE).output("v_x2").point)


def test_a_surface_of_which_nothing_was_measured_is_drawn_from_the_population():
    """Against the truncated lognormal of scipy, and with the median of the draws for a point."""
    from scipy import stats

    fitted = with_levels(draws=20_000, spreads={"mu": 1.2, "cor_10": 0.4})
    one = fitted.at({"surface": "new", "ball": "old"})
    mu = one.draws[:, 0]
    assert MU[0] <= mu.min() < 0.06 and 2.8 < mu.max() <= MU[1]
    common = np.log(fitted.draws[:, 0])
    ends = [(np.log(end) - common) / 1.2 for end in MU]
    shares = stats.truncnorm.cdf((np.log(mu) - common) / 1.2, *ends)
    # Uniform if each draw is from the truncated law about its own common value; clipping would pile up at the ends.
    assert stats.kstest(shares, "uniform").statistic < 0.015
    assert one.point[0] == np.median(mu)
    assert one.point[0] != pytest.approx(fitted.point[0], rel=1e-3)
    assert np.array_equal(one.draws[:, 3], fitted.draws[:, 3] - 0.4)


def test_a_ball_that_is_called_new_is_that_ball():
    fitted = with_levels()
    at = fitted.at({"surface": "hard", "ball": "NEW"})
    assert np.array_equal(at.draws[:, 3], fitted.draws[:, 3])


def test_a_new_surface_is_one_for_all_impacts_and_its_intervals_are_wider():
    fitted = with_levels()
    found = predict_new(fitted, IMPACTS.take(np.array([0, 0, 0])), levels={
        "surface": ("new", "clay", "new"), "ball": ("old", "old", "new"),
    })  # fmt: skip
    wide = np.ptp(found.output("v_x2").rebound, axis=0)
    assert wide[0] > 1.5 * wide[1]
    assert "the prior of the spread" in new_words(fitted, ["surface"])[0]
    many = replace(fitted, levels=(replace(LEVELS[0], labels=("a", "b", "c", "d", "e")),))
    assert "the prior of the spread" not in new_words(many, ["surface"])[0]


@pytest.mark.parametrize(
    ("asked", "cells", "words"),
    [
        ({"ball": "old"}, {}, "mu differs between the levels of surface (clay, hard): name one"),
        ({"surface": "gras", "ball": "old"}, {}, "surface 'gras' was not fitted. Fitted: clay, hard"),
        ({"court": "1", "surface": "clay", "ball": "old"}, {}, "no parameter of this fit differs between levels"),
        ({"surface": "clay", "ball": "old"}, {"surface": ("clay", "hard")}, "the table names a surface in every row"),
        ({"ball": "old"}, {"surface": ("clay", "")}, "column surface is empty for second"),
        ({"ball": "old"}, {"surface": ("clay", "grass")}, "second: surface 'grass' was not fitted"),
        ({"surface": ("clay",), "ball": "old"}, {}, "1 labels, expected one for each of 2 impacts"),
    ],
)  # fmt: skip
def test_labels_that_cannot_be_followed_are_refused(asked, cells, words):
    with pytest.raises(ParameterError, match=words.replace("(", r"\(").replace(")", r"\)")):
        levels_of_impacts(with_levels(), 2, asked, cells, ("first", "second"))


def test_the_option_fills_what_the_table_leaves_empty():
    found = levels_of_impacts(
        with_levels(), 2, {"surface": "hard", "ball": "DUNN"}, {"surface": (" Clay", "")}, ("first", "second")
    )
    assert found == {"surface": ("clay", "hard"), "ball": ("Dünn", "Dünn")}


@pytest.mark.parametrize("column", ["Surface", "surface ", "court", "playing_surface"])
def test_a_column_of_surfaces_is_followed_whatever_it_is_called(column):
    cells = {column: ("hard", "clay"), "ball": ("old", "new")}
    assert levels_of_impacts(with_levels(), 2, {}, cells)["surface"] == ("hard", "clay")
    assert levels_of_impacts(with_levels(), 2, {"SURFACE": "clay", "ball": "old"}, {})["surface"] == ("clay",) * 2


def test_of_two_other_columns_of_surfaces_none_is_followed():
    with pytest.raises(ParameterError, match="mu differs between the levels of surface"):
        levels_of_impacts(with_levels(), 2, {"ball": "old"}, {"court": ("clay",) * 2, "floor": ("hard",) * 2})
    with pytest.raises(ParameterError, match="surface is named twice"):
        levels_of_impacts(with_levels(), 2, {"ball": "old", "Surface": "clay", "surface": "hard"}, {})


def test_a_new_surface_needs_a_posterior():
    with pytest.raises(ParameterError, match="a point fit has none"):
        with_levels(draws=0).at({"surface": "new", "ball": "old"})


def test_every_output_names_the_level_of_each_impact():
    found = predict_new(with_levels(), IMPACTS, levels=WHERE)
    ids = ["a", "b", "c", "d", "e", "f"]
    assert [row["surface"] for row in prediction_csv_rows(found, ids)] == list(WHERE["surface"])
    content = prediction_json(found, ids, (), ())["impacts"][1]
    assert content["levels"] == {"surface": "hard", "ball": "Dünn"}
    table = predict_document(found, ids).lead[2]
    assert [row[:3] for row in table.rows[1:]] == [
        ["a", "clay", "old"], ["b", "hard", "Dünn"], ["c", "hard", "Dünn"], ["d", "clay", "old"],
        ["e", "hard", "new"], ["f", "clay", "old"],
    ]  # fmt: skip
    alone = predict_new(with_levels(), fitball.impacts(15.0, 6.0, 0.0), levels={"surface": "hard", "ball": "old"})
    assert answer(alone, ["x"], (), 0)[0].startswith("Predicted rebound (surface hard, ball old): v_x2")


@pytest.fixture(scope="module")
def two_surfaces(tmp_path_factory):
    """A point fit of a table with two surfaces."""
    folder = tmp_path_factory.mktemp("levels")
    rng = np.random.default_rng(5)
    speed, angle = rng.uniform(10.0, 20.0, 24), np.radians(rng.uniform(15.0, 50.0, 24))
    v_x, v_y, spin = speed * np.cos(angle), speed * np.sin(angle), rng.uniform(-100.0, 100.0, 24)
    surface = ["clay", "hard"] * 12
    lines = ["v_x1,v_y1,omega_1,v_x2,v_y2,omega_2,surface"]
    for k, name in enumerate(surface):
        values = np.array([[0.7 if name == "clay" else 0.5, 0.1, 2e-3, 0.75, -0.015]])
        made = [float(part[0]) for part in bounce(values, v_x[k], v_y[k], spin[k])]
        noise = rng.normal(0.0, [0.1, 0.1, 3.0])
        cells = [v_x[k], v_y[k], spin[k], *(np.array(made) + noise)]
        lines.append(",".join([*(f"{cell:.3f}" for cell in cells), name]))
    (folder / "two.csv").write_text("\n".join(lines), encoding="utf-8")
    (folder / "new.csv").write_text("v_x1,v_y1,surface\n19,5,CLAY\n19,5,hard\n", encoding="utf-8")
    fit = fitball.calibrate(folder / "two.csv", model="grip-slip", pool={"mu": "surface"}, point_only=True)
    fit.save(folder / "fit", figures=False)
    return folder


def test_the_summary_has_the_value_of_each_surface(two_surfaces):
    table = fitball.load_fit(two_surfaces / "fit").summary()
    assert table.index.tolist()[:3] == ["mu[clay]", "mu[hard]", "mu"] and table.index.is_unique
    assert table.loc["mu[clay]", "point"] == pytest.approx(0.7, rel=0.05)
    assert table.loc["mu[hard]", "point"] == pytest.approx(0.5, rel=0.05)


def test_the_rows_of_a_table_follow_its_own_column(two_surfaces, capsys):
    fit = fitball.load_fit(two_surfaces / "fit")
    frame = fit.predict(two_surfaces / "new.csv")
    assert frame["surface"].tolist() == ["clay", "hard"]
    clay, hard = frame["v_x2_point [m/s]"]
    assert clay < hard - 1.0
    for name, value in (("clay", clay), ("hard", hard)):
        alone = fit.predict(fitball.impacts(19.0, 5.0, 0.0), levels={"surface": name})
        assert alone["v_x2_point [m/s]"].tolist() == [pytest.approx(value)]
    assert main(["predict", str(two_surfaces / "fit"), "--impact", "v=19, theta=15"]) == 2
    assert "name one, such as --level surface=clay" in capsys.readouterr().err
    assert main(["predict", str(two_surfaces / "fit"), "--impact", "v=19, theta=15", "--level", "surface=hard"]) == 0
    assert "Predicted rebound (surface hard)" in capsys.readouterr().out


def test_one_impact_through_time_is_on_a_named_surface(two_surfaces, capsys, tmp_path):
    fit = fitball.load_fit(two_surfaces / "fit")
    with pytest.raises(ParameterError, match="differ between the levels of surface"):
        Subject.from_fit(fit, None, {})
    clay, hard = (Subject.from_fit(fit, None, {}, {"surface": name}) for name in ("CLAY", "hard"))
    assert clay.parameters["mu"] == pytest.approx(0.7, rel=0.05) and hard.parameters["mu"] == pytest.approx(
        0.5, rel=0.05
    )
    assert clay.name == "fit_grip-slip_clay" and clay.title.endswith(", surface clay")
    assert regimes_of(clay, "v=20", None).found.areas["slide"] < regimes_of(hard, "v=20", None).found.areas["slide"]
    assert "surface hard" in page_of(hard, None)
    with pytest.raises(ParameterError, match="only a fit has levels"):
        fitball.simulate("v=17, theta=18", levels={"surface": "clay"})
    command = ["simulate", "--map", "v=20", "--fit", str(two_surfaces / "fit"), "--out", str(tmp_path / "map")]
    assert main(command) == 2
    assert main([*command, "--level", "surface=hard", "--json"]) == 0
    assert '"levels": {' in capsys.readouterr().out
