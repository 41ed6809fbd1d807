"""Drops by heights, fitted: against tables made with another drag, and by an independent road."""

import numpy as np
import pytest

import fitball

TWICE_G = 2.0 * 9.80665
PER_DRAG = 1.2 * np.pi * 0.03302**2 / 0.0576
FALLS = np.repeat([1.0, 1.5, 2.0, 2.54], 5)


def dropped(cor, drag, slope=0.0, noise=0.0, seed=1, density=1.2):
    """Heights of 20 drops of a ball with such a restitution at 5 m/s, in such a drag."""
    braking = drag * PER_DRAG * density / 1.2
    landing = np.sqrt(TWICE_G / braking * (1.0 - np.exp(-braking * FALLS)))
    launch = (cor + slope * (landing - 5.0)) * landing
    risen = np.log(1.0 + braking * launch**2 / TWICE_G) / braking
    risen += noise * np.random.default_rng(seed).standard_normal(risen.size)
    return {"drop_height": FALLS, "rebound_height": risen}


def fitted(columns, scene=None):
    return fitball.calibrate(columns, scene=scene or fitball.Scene(), max_steps=1000, cores=1)


@pytest.fixture(scope="module")
def usual():
    """A ball with a restitution of 0.77 at every speed, flown with a drag of 0.55."""
    return fitted(dropped(0.77, 0.55, noise=0.004))


def test_restitution_is_right_and_its_slope_is_none(usual):
    summary = usual.summary
    assert summary.loc["cor_median", "median"] == pytest.approx(0.770, abs=0.002)
    assert abs(summary.loc["cor_slope", "median"]) < 1.5e-3
    assert summary.loc["cor_median", "verdict"] == "given"
    assert summary.loc["drag", "verdict"] == "prior-dominated"


def test_the_drag_is_one_error_of_all_rows(usual):
    """Of 0.03 of COR at 254 cm for 0.55 of the drag, 0.08 are 0.0043; the rebound has no such
    error.
    """
    draws = usual.draws
    cor = usual.quantity("cor_254cm").rule(draws.values)
    drag = draws.values["drag"]
    slope = np.polyfit(drag, cor, 1)[0]
    assert 0.08 * slope == pytest.approx(0.0043, abs=6e-4)
    assert np.corrcoef(drag, cor)[0, 1] > 0.8
    height = usual.quantity("rebound_254cm").rule(draws.values)
    table = dropped(0.77, 0.55)
    assert np.median(height) == pytest.approx(table["rebound_height"][-1], abs=0.005)
    assert abs(np.corrcoef(drag, height)[0, 1]) < 0.5


def test_another_drag_is_within_the_interval(usual):
    """Flown with 0.45, read at the usual drag: the truth is within."""
    summary = fitted(dropped(0.77, 0.45, noise=0.004)).summary
    low, high = summary.loc["cor_median", ["q025", "q975"]]
    assert low < 0.77 < high
    assert summary.loc["rebound_254cm", "median"] == pytest.approx(
        dropped(0.77, 0.45)["rebound_height"][-1],
        abs=0.005,
    )


def test_a_stated_drag_is_held():
    scene = fitball.Scene(flight={"drag": 0.45})
    summary = fitted(dropped(0.77, 0.45, noise=0.004), scene).summary
    assert summary.loc["drag", "verdict"] == "fixed"
    assert summary.loc["cor_median", "median"] == pytest.approx(0.770, abs=0.002)
    assert summary.loc["cor_median", "verdict"] == "identified"


def test_a_stored_fit_keeps_its_heights(usual, tmp_path):
    usual.save(tmp_path / "fit")
    again = fitball.load_fit(tmp_path / "fit")
    assert again.problem.fall is not None
    assert again.problem.fall.dropped.all()
    assert again.problem.fall.risen.all()
    states = again.problem.rows.states
    values = again.draws.best
    assert np.array_equal(
        again.problem.rebounds(values, states).v_y2,
        usual.problem.rebounds(values, states).v_y2,
    )


def test_heights_beside_speeds_are_told_apart():
    """Of a table of heights and one of speeds, fitted together, only heights depend on the drag."""
    speeds = {"v_y1": np.full(5, 6.0), "v_y2": np.full(5, 4.6)}
    table = [
        fitball.load_table(dropped(0.77, 0.55, noise=0.004)),
        fitball.load_table(speeds),
    ]
    fit = fitball.calibrate(table, point_only=True)
    problem = fit.problem
    assert problem.fall.dropped.tolist() == [True] * 20 + [False] * 5
    values = {name: np.repeat(value, 2) for name, value in fit.draws.best.items()}
    values["drag"] = np.array([0.45, 0.65])
    predicted = problem.rebounds(values).v_y2
    assert np.isfinite(predicted).all()
    assert np.array_equal(predicted[0, 20:], predicted[1, 20:])
    assert np.all(predicted[0, :20] != predicted[1, :20])


def test_heights_are_predicted_by_the_heights_of_drops(usual):
    """The table's own heights come back within 5 mm, however uncertain the drag is."""
    frames = usual.predict(impact="drop_height=100..254 cm:2").frames["predictions"]
    heights = frames[frames["column"] == "rebound_height"]
    table = dropped(0.77, 0.55)["rebound_height"]
    assert heights["median"].to_numpy() == pytest.approx(table[[0, -1]], abs=0.005)
    inside = heights["new_q025"].lt(table[[0, -1]]) & heights["new_q975"].gt(table[[0, -1]])
    assert inside.all()
    # The noise of heights is 4 mm; an error of the drag alone would move 254 cm by 8 mm.
    assert (heights["sd"] < 0.004).all()
    assert heights["noise"].to_numpy() == pytest.approx(0.004, rel=0.8)
    speeds = frames[frames["column"] == "v_y2"]
    landing = np.sqrt(TWICE_G / (0.55 * PER_DRAG) * (1.0 - np.exp(-0.55 * PER_DRAG * FALLS)))
    assert speeds["v_y1"].to_numpy() == pytest.approx(landing[[0, -1]], rel=1e-9)


def test_heights_of_a_table_are_compared_with_predictions(usual):
    frames = usual.predict(dropped(0.77, 0.55, noise=0.004)).frames
    scores = frames["scores"].set_index("column")
    assert scores.loc["rebound_height", "impacts"] == 20
    # Those of a line through ratios of the heights themselves.
    table = dropped(0.77, 0.55, noise=0.004)
    ratio = np.polyval(np.polyfit(FALLS, table["rebound_height"] / FALLS, 1), FALLS)
    rms_of_fit = np.sqrt(np.mean((table["rebound_height"] - ratio * FALLS) ** 2))
    assert scores.loc["rebound_height", "rms"] == pytest.approx(rms_of_fit, rel=0.05)
    assert abs(scores.loc["rebound_height", "bias"]) < 0.003


def test_what_was_not_dropped_has_no_height(usual):
    frame = usual.predict(impact="v_y1=5").frames["predictions"]
    assert "rebound_height" not in {*frame["column"]}


def test_no_number_of_drops_by_heights_determines_the_drag(usual):
    """Of 40 drops more the error of the drag stays, 0.0043 of COR at 254 cm."""
    expected = usual.plan(target="cor_254cm", count=40).frames["targets"].loc["cor_254cm"]
    # Of three times as many velocities without that error it would be a half.
    assert expected["now"] > expected["as before"] > 0.7 * expected["now"]


def test_the_air_of_the_scene_is_that_of_the_heights():
    """In air half as dense heights are other speeds, at the usual drag and at any other."""
    scene = fitball.Scene(air={"density": 0.6})
    heights = dropped(0.77, 0.55, noise=0.004, density=0.6)
    fit = fitball.calibrate(heights, scene=scene, point_only=True, cores=1)
    assert fit.summary.loc["cor_median", "point"] == pytest.approx(0.770, abs=0.002)
    problem = fit.problem
    braking = 0.7 * 0.5 * PER_DRAG
    landing = np.sqrt(TWICE_G / braking * (1.0 - np.exp(-braking * FALLS)))
    truth = problem.fall.true_states({"drag": np.array([0.7])}, problem.table.impacts)
    assert truth.v_y1[0] == pytest.approx(landing, rel=1e-3)
