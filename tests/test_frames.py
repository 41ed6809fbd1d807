"""Curves and frames of a fit: every impact has a series, every series a curve, and numbers are
those of the model.
"""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from support.fit_by_hand import fit_by_hand, table_of

import fitball
from fitball.inference import frames
from fitball.inference.curves import curves_frame, series
from fitball.inference.schema import Alternative, Summary
from fitball.inference.summary import summarise

SHOWN = ("v_x2", "v_y2", "omega_2")
QUANTILES = ["q025", "q16", "median", "q84", "q975"]


@pytest.fixture(scope="module")
def fit():
    return fit_by_hand(table_of(40, surfaces=("clay", "grass", "hard")))


@pytest.mark.parametrize(
    ("table", "count"),
    [
        (table_of(40, surfaces=("clay", "grass", "hard")), 3),
        (table_of(12, drop=True), 1),
    ],
)
def test_every_impact_has_a_series_of_its_level_and_every_series_a_curve(table, count):
    fit = fit_by_hand(table, model="brody")
    all_series, which = series(fit.problem)
    assert which.shape == (len(table),)
    assert count <= len(all_series) <= 6
    assert {*which} == {*range(len(all_series))}
    no_labels = ("",) * len(table)
    labels = fit.problem.table.labels.get("surface", no_labels)
    for k, label in zip(which, labels, strict=True):
        assert label in all_series[k].name
    drawn = curves_frame(fit.problem, fit.draws)
    assert {*drawn["series"]} == {*which}
    columns = {observable.column.name for observable in fit.problem.observables}
    assert {*drawn["column"]} == columns
    states = fit.problem.rows.states
    if count == 1:
        along = states.v_y1
    else:
        _, along = states.polar()
    for k, rows in drawn[drawn["within"]].groupby("series"):
        impacts = along[which == k]
        assert impacts.min() <= rows["along"].min()
        assert rows["along"].max() <= impacts.max()


def test_a_curve_is_the_model_at_its_speed_spin_and_level(fit):
    drawn = curves_frame(fit.problem, fit.draws).set_index(["name", "speed", "spin"])
    model = fit.problem.forward.model
    point = fit.draws.point
    all_series, _ = series(fit.problem)
    for each in all_series:
        rows = drawn.xs((each.name, each.speed, each.spin)).set_index("column")
        values = {}
        for spec in model.parameters:
            of_level = f"{spec.name}[{each.name}]"
            values[spec.name] = point.get(of_level, point.get(spec.name))
        angle = rows.loc["v_x2", "along"].to_numpy()
        v_x = each.speed * np.cos(angle)
        v_y = each.speed * np.sin(angle)
        rebound = model.rebound(values, fitball.impacts(v_x, v_y, each.spin))
        for name in SHOWN:
            points = rows.loc[name]
            assert_allclose(points["point"], rebound.column(name), rtol=1e-12)
            assert np.all(np.diff(points[QUANTILES]) >= 0.0)


def test_predictions_have_a_row_for_each_impact_and_column(fit):
    predictions = fit.predictions
    table = fit.problem.table
    assert len(predictions) == 40 * 3
    ids = predictions.groupby("column")["id"].apply(tuple)
    assert ids.tolist() == [table.labels["id"]] * 3
    for name in SHOWN:
        rows = predictions[predictions["column"] == name]
        assert_array_equal(rows["observed"], table.values[name])
        z = (rows["observed"] - rows["median"]) / rows["noise"]
        assert_allclose(rows["z"], z, rtol=1e-12)
    v_x1 = predictions["v_1"] * np.cos(predictions["theta_1"])
    assert_allclose(v_x1, predictions["v_x1"], rtol=1e-12)
    surfaces = [*table.labels["surface"]]
    assert predictions["surface"].tolist() == surfaces * 3


def test_shares_of_regimes_and_errors_of_balances_are_those_of_the_fit(fit, monkeypatch):
    regimes = fit.regimes
    impacts = fit.predictions.drop_duplicates("row")
    shares = regimes.groupby("row")["share"].sum()
    assert shares.tolist() == pytest.approx([1.0] * 40)
    most = regimes.sort_values("share").groupby("row").last()
    assert most["regime"].tolist() == impacts["regime"].tolist()
    assert most["id"].tolist() == impacts["id"].tolist()
    sd_of_cor = fit.draws.best["v_y_sd"][0] / impacts["v_y1"]
    assert_allclose(fit.balances["cor_sd"], sd_of_cor, rtol=1e-12)
    monkeypatch.setattr(frames, "PREDICTED_ROWS", 3)
    thinned = frames.regimes_frame(fit.problem, fit.draws)
    assert thinned["row"].unique().tolist() == [0, 20, 39]


def test_a_point_fit_has_curves_without_bands():
    fit = fit_by_hand(sampled=False)
    drawn = curves_frame(fit.problem, fit.draws)
    assert drawn[QUANTILES].isna().all(axis=None)
    assert drawn["point"].notna().all()
    assert fit.predictions["z"].notna().all()


def test_what_another_choice_moves_is_in_sds_of_the_fit():
    here = SimpleNamespace(name="mu", half=0.02, median=0.5, q025=0.46, q975=0.54)
    there = Summary(0.53, 0.53, 0.03, 0.45, 0.5, 0.56, 0.62)

    def alternative(choice, reason):
        fields = {
            "choice": choice,
            "reason": reason,
            "summaries": {"mu": there},
            "instead_of": "offset=contact",
            "score": None,
            "error": None,
            "as_good": True,
            "better": False,
        }
        assert {*fields} <= {*Alternative.__struct_fields__}
        return SimpleNamespace(**fields)

    alternatives = [
        alternative("offset=grip", reason=""),
        alternative("spin=shell", reason="no answer"),
    ]
    held = SimpleNamespace(name="ball_radius", low=0.032, high=0.034, moves={"mu": -0.5})
    variants = frames.variants_frame([here], alternatives, [held]).set_index("choice")
    grip = variants.loc["offset=grip"]
    shell = variants.loc["spin=shell"]
    radius = variants.loc["ball_radius"]
    # (0.53 - 0.5)/0.02, and (0.62 - 0.54)/0.02 at the far end.
    assert grip["moved"] == pytest.approx(1.5)
    assert grip["reach"] == pytest.approx(4.0)
    assert shell["quantity"] == ""
    assert pd.isna(shell["moved"])
    assert radius["moved"] == pytest.approx(0.5)
    assert radius["q025"] == pytest.approx(0.49)
    assert radius["q975"] == pytest.approx(0.51)
    # An sd is that of the bulk of the draws.
    bulk = np.random.default_rng(1).normal(0.5, 0.02, 4000)
    with_far = np.append(bulk, np.full(20, 50.0))
    assert summarise(with_far, 0.5).half == pytest.approx(0.02, rel=0.05)
    assert summarise(with_far, 0.5).sd > 1.0
    with_gaps = np.append(with_far, np.full(4020, np.nan))
    assert np.isnan(summarise(with_gaps, 0.5).median)


def test_a_value_moves_by_the_farthest_of_several_choices():
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
    shifts = [
        (0.002, 0.1, True),
        (0.06, 0.0, True),
        (0.001, 0.0, True),
        (0.4, 0.0, False),
    ]
    alternatives = []
    for k, (shift, shift_of_end, as_good) in enumerate(shifts):
        median = 0.5 + shift
        end = 0.54 + shift_of_end
        alternative = SimpleNamespace(
            choice=f"normal={k}",
            instead_of="normal=momentum",
            score=None,
            error=None,
            reason="",
            as_good=as_good,
            better=False,
            summaries={"mu": Summary(median, median, 0.02, 0.46, 0.5, 0.5, end)},
        )
        alternatives.append(alternative)
    variants = frames.variants_frame([here], alternatives, [])
    row = frames.summary_frame([here], {}, None, variants).loc["mu"]
    # An end by 0.1 is farther than a median by 0.06; a variant that fits worse does not count.
    assert row["moved"] == pytest.approx(5.0)
    assert row["given"].split("; ")[0] == "normal=momentum"
