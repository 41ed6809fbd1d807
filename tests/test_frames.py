"""Curves and frames of a fit: every impact has a series, every series a curve, and numbers are
those of the model.
"""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from support.made_fit import made_fit, table_of

import fitball
from fitball.inference import frames
from fitball.inference.curves import curves, series
from fitball.inference.schema import Alternative, Summary
from fitball.inference.summary import summarise

SHOWN = ("v_x2", "v_y2", "omega_2")


@pytest.fixture(scope="module")
def fit():
    return made_fit(table_of(40, surfaces=("clay", "grass", "hard")))


@pytest.mark.parametrize(
    ("table", "count"),
    [(table_of(40, surfaces=("clay", "grass", "hard")), 3), (table_of(12, drop=True), 1)],
)
def test_every_impact_has_a_series_of_its_own_level_and_every_series_a_curve(table, count):
    made = made_fit(table, model="brody")
    found, which = series(made.problem)
    assert which.shape == (len(table),)
    assert count <= len(found) <= 6
    assert {*which} == {*range(len(found))}
    labels = made.problem.table.labels.get("surface", ("",) * len(table))
    assert all(label in found[k].name for k, label in zip(which, labels, strict=True))
    drawn = curves(made.problem, made.draws)
    assert {*drawn["series"]} == {*which}
    assert {*drawn["column"]} == {item.column.name for item in made.problem.observables}
    place = made.problem.rows.states
    along = place.v_y1 if count == 1 else place.polar()[1]
    for k, rows in drawn[drawn["within"]].groupby("series"):
        assert along[which == k].min() <= rows["along"].min()
        assert rows["along"].max() <= along[which == k].max()


def test_a_curve_is_the_model_at_its_speed_spin_and_level(fit):
    drawn = curves(fit.problem, fit.draws)
    model = fit.problem.forward.model
    for one in series(fit.problem)[0]:
        rows = drawn[
            (drawn["name"] == one.name)
            & (drawn["speed"] == one.speed)
            & (drawn["spin"] == one.spin)
        ]
        values = {
            spec.name: fit.draws.point.get(
                f"{spec.name}[{one.name}]",
                fit.draws.point.get(spec.name),
            )
            for spec in model.parameters
        }
        angle = rows[rows["column"] == "v_x2"]["along"].to_numpy()
        wanted = model.rebound(
            values,
            fitball.impacts(one.speed * np.cos(angle), one.speed * np.sin(angle), one.spin),
        )
        for name in SHOWN:
            points = rows[rows["column"] == name]
            np.testing.assert_allclose(points["point"], wanted.column(name), rtol=1e-12)
            assert np.all(np.diff(points[["q025", "q16", "median", "q84", "q975"]]) >= 0.0)


def test_predictions_have_a_row_for_each_impact_and_column(fit):
    found = fit.predictions
    table = fit.problem.table
    assert len(found) == 40 * 3
    assert found.groupby("column")["id"].apply(tuple).tolist() == [table.labels["id"]] * 3
    for name in SHOWN:
        rows = found[found["column"] == name]
        np.testing.assert_array_equal(rows["observed"], table.values[name])
        np.testing.assert_allclose(
            rows["z"],
            (rows["observed"] - rows["median"]) / rows["noise"],
            rtol=1e-12,
        )
    np.testing.assert_allclose(found["v_1"] * np.cos(found["theta_1"]), found["v_x1"], rtol=1e-12)
    assert found["surface"].tolist() == [*table.labels["surface"]] * 3


def test_shares_of_regimes_and_errors_of_balances_are_those_of_the_fit(fit, monkeypatch):
    found = fit.regimes
    impacts = fit.predictions.drop_duplicates("row")
    assert found.groupby("row")["share"].sum().tolist() == pytest.approx([1.0] * 40)
    most = found.sort_values("share").groupby("row").last()
    assert most["regime"].tolist() == impacts["regime"].tolist()
    assert most["id"].tolist() == impacts["id"].tolist()
    np.testing.assert_allclose(
        fit.balances["cor_sd"],
        fit.draws.best["v_y_sd"][0] / impacts["v_y1"],
        rtol=1e-12,
    )
    monkeypatch.setattr(frames, "PREDICTED", 3)
    assert [*dict.fromkeys(frames.regimes(fit.problem, fit.draws)["row"])] == [0, 20, 39]


def test_a_point_fit_has_curves_without_bands():
    drawn = curves((made := made_fit(sampled=False)).problem, made.draws)
    assert drawn[["q025", "q16", "median", "q84", "q975"]].isna().all(axis=None)
    assert drawn["point"].notna().all()
    assert made.predictions["z"].notna().all()


def test_what_another_choice_moves_is_in_sds_of_the_fit():
    here = SimpleNamespace(name="mu", half=0.02, median=0.5, q025=0.46, q975=0.54)
    there = Summary(0.53, 0.53, 0.03, 0.45, 0.5, 0.56, 0.62)
    shared = {"instead_of": "offset=contact", "score": None, "error": None, "as_good": True}
    parts = {
        name: SimpleNamespace(**shared, choice=name, reason=reason, summaries={"mu": there})
        for name, reason in (("offset=grip", ""), ("spin=shell", "no answer"))
    }
    assert {*shared, "choice", "reason", "summaries"} <= {*Alternative.__struct_fields__}
    held = SimpleNamespace(name="ball_radius", low=0.032, high=0.034, moves={"mu": -0.5})
    found = frames.variants([here], [*parts.values()], [held]).set_index("choice")
    far = np.append(np.random.default_rng(1).normal(0.5, 0.02, 4000), np.full(20, 50.0))
    assert summarise(far, 0.5).half == pytest.approx(0.02, rel=0.05)
    assert summarise(far, 0.5).sd > 1.0
    assert np.isnan(summarise(np.append(far, np.full(4020, np.nan)), 0.5).median)
    # (0.53 - 0.5)/0.02, and (0.62 - 0.54)/0.02 at the far end.
    assert found.loc["offset=grip", ["moved", "reach"]].tolist() == pytest.approx([1.5, 4.0])
    assert found.loc["spin=shell", "quantity"] == ""
    assert pd.isna(found.loc["spin=shell", "moved"])
    assert found.loc["ball_radius", ["moved", "q025", "q975"]].tolist() == pytest.approx(
        [0.5, 0.49, 0.51]
    )


def test_a_value_is_said_to_move_by_the_farthest_of_several_choices_instead_of_one():
    here = SimpleNamespace(
        name="mu",
        kind="model",
        unit="",
        meaning="",
        point=0.5,
        median=0.5,
        sd=0.02,
        half=0.02,
        q025=0.46,
        q16=0.48,
        q84=0.52,
        q975=0.54,
        prior="",
        contraction=0.9,
        verdict="given",
        reason="",
        given=("normal=momentum", "model"),
    )
    shared = {"instead_of": "normal=momentum", "score": None, "error": None, "reason": ""}
    shifts = ((0.002, 0.1, True), (0.06, 0.0, True), (0.001, 0.0, True), (0.4, 0.0, False))
    tried = [
        SimpleNamespace(
            **shared,
            choice=f"normal={k}",
            as_good=good,
            summaries={"mu": Summary(0.5 + by, 0.5 + by, 0.02, 0.46, 0.5, 0.5, 0.54 + end)},
        )
        for k, (by, end, good) in enumerate(shifts)
    ]
    row = frames.summary([here], {}, None, frames.variants([here], tried, [])).loc["mu"]
    # An end by 0.1 is farther than a median by 0.06; a variant that fits worse does not count.
    assert row["moved"] == pytest.approx(5.0)
    assert row["given"].split("; ")[0] == "normal=momentum"
