"""Drops by heights, fitted: against tables made with another drag, and by an independent road."""

import numpy as np
import pytest
from support.near import assert_near, assert_within

import fitball
from fitball.report.flights import scatter_as

TWICE_G = 2.0 * 9.80665
# What a drag coefficient of one brakes: rho pi R^2/m [1/m].
AREA = np.pi * 0.03302**2
PER_DRAG = 1.2 * AREA / 0.0576
FALLS = np.repeat([1.0, 1.5, 2.0, 2.54], 5)
# The lowest and the highest drop.
ENDS = [0, -1]


def landing_speeds(braking):
    """Speeds of falls from `FALLS`: v^2 = V^2 (1 - exp(-2 g h/V^2)) with V^2 = 2 g/braking."""
    terminal = TWICE_G / braking
    lost = 1.0 - np.exp(-braking * FALLS)
    return np.sqrt(terminal * lost)


def rises(speeds, braking):
    """Heights of rises at these speeds: v^2 = V^2 (exp(2 g r/V^2) - 1)."""
    shares = braking * speeds**2 / TWICE_G
    return np.log(1.0 + shares) / braking


def dropped(cor, drag, noise=0.0, density=1.2):
    """Heights of 20 drops of a ball with such a restitution, in such a drag."""
    braking = drag * PER_DRAG * density / 1.2
    landing = landing_speeds(braking)
    rebounds = rises(cor * landing, braking)
    rng = np.random.default_rng(1)
    errors = noise * rng.standard_normal(rebounds.size)
    return {"drop_height": FALLS, "rebound_height": rebounds + errors}


def fitted(columns, scene=None):
    return fitball.calibrate(
        columns,
        scene=scene or fitball.Scene(),
        max_steps=1000,
        cores=1,
    )


@pytest.fixture(scope="module")
def usual():
    """A ball with a restitution of 0.77 at every speed, flown with a drag of 0.55."""
    return fitted(dropped(0.77, 0.55, noise=0.004))


def test_restitution_is_right_and_its_slope_is_none(usual):
    median = usual.summary["median"]
    verdict = usual.summary["verdict"]
    assert_within(median["cor_median"], 0.770, 0.002)
    assert abs(median["cor_slope"]) < 1.5e-3
    assert verdict["cor_median"] == "given"
    assert verdict["drag"] == "prior-dominated"


def test_the_drag_is_one_error_of_all_rows(usual):
    """Of 0.03 of COR at 254 cm for 0.55 of the drag, 0.08 are 0.0043; the rebound has no such
    error.
    """
    values = usual.draws.values
    drag = values["drag"]
    cor = usual.quantity("cor_254cm").rule(values)
    height = usual.quantity("rebound_254cm").rule(values)
    slope, _ = np.polyfit(drag, cor, 1)
    assert_within(0.08 * slope, 0.0043, 6e-4)
    correlations = np.corrcoef([drag, cor, height])
    of_cor, of_height = correlations[0, 1:]
    assert of_cor > 0.8
    assert abs(of_height) < 0.5
    table = dropped(0.77, 0.55)
    highest = table["rebound_height"][-1]
    assert_within(np.median(height), highest, 0.005)


def test_another_drag_is_within_the_interval():
    """Flown with 0.45, read at the usual drag: the truth is within."""
    table = dropped(0.77, 0.45, noise=0.004)
    summary = fitted(table).summary
    low, high = summary.loc["cor_median", ["q025", "q975"]]
    assert low < 0.77 < high
    exact = dropped(0.77, 0.45)
    highest = exact["rebound_height"][-1]
    rebound = summary.loc["rebound_254cm", "median"]
    assert_within(rebound, highest, 0.005)


def test_a_stated_drag_is_held():
    scene = fitball.Scene(flight={"drag": 0.45})
    table = dropped(0.77, 0.45, noise=0.004)
    summary = fitted(table, scene).summary
    verdict = summary["verdict"]
    assert verdict["drag"] == "fixed"
    assert verdict["cor_median"] == "identified"
    median = summary.loc["cor_median", "median"]
    assert_within(median, 0.770, 0.002)


def test_a_stored_fit_keeps_its_heights(usual, tmp_path):
    folder = tmp_path / "fit"
    usual.save(folder)
    again = fitball.load_fit(folder)
    fall = again.problem.fall
    assert fall.dropped.all()
    assert fall.risen.all()
    states = again.problem.rows.states
    best = again.draws.best
    before = usual.problem.rebounds(best, states)
    after = again.problem.rebounds(best, states)
    assert np.array_equal(after.v_y2, before.v_y2)


def test_heights_beside_speeds_are_told_apart():
    """Of a table of heights and one of speeds, fitted together, only heights depend on the drag."""
    heights = dropped(0.77, 0.55, noise=0.004)
    speeds = {"v_y1": np.full(5, 6.0), "v_y2": np.full(5, 4.6)}
    tables = [fitball.load_table(heights), fitball.load_table(speeds)]
    fit = fitball.calibrate(tables, point_only=True)
    problem = fit.problem
    is_dropped = np.arange(25) < 20
    assert np.array_equal(problem.fall.dropped, is_dropped)
    best = fit.draws.best
    values = {name: np.repeat(value, 2) for name, value in best.items()}
    values["drag"] = np.array([0.45, 0.65])
    predicted = problem.rebounds(values).v_y2
    assert np.isfinite(predicted).all()
    weak, strong = predicted
    assert np.array_equal(weak != strong, is_dropped)


def test_heights_are_predicted_by_the_heights_of_drops(usual):
    """The table's own heights come back within 5 mm, however uncertain the drag is."""
    frames = usual.predict(impact="drop_height=100..254 cm:2").frames["predictions"]
    heights = frames[frames["column"] == "rebound_height"]
    table = dropped(0.77, 0.55)
    truth = table["rebound_height"][ENDS]
    assert_within(heights["median"], truth, 0.005)
    assert (heights["new_q025"] < truth).all()
    assert (heights["new_q975"] > truth).all()
    # The noise of heights is 4 mm; an error of the drag alone would move 254 cm by 8 mm.
    assert (heights["sd"] < 0.004).all()
    assert_near(heights["noise"], 0.004, 0.8)
    speeds = frames[frames["column"] == "v_y2"]
    landing = landing_speeds(0.55 * PER_DRAG)
    assert_near(speeds["v_y1"], landing[ENDS], 1e-9)


def test_heights_of_a_table_are_compared_with_predictions(usual):
    table = dropped(0.77, 0.55, noise=0.004)
    frames = usual.predict(table).frames
    scores = frames["scores"].set_index("column")
    of_heights = scores.loc["rebound_height"]
    assert of_heights["impacts"] == 20
    # Those of a line through ratios of the heights themselves.
    rebounds = table["rebound_height"]
    line = np.polyfit(FALLS, rebounds / FALLS, 1)
    residual = rebounds - np.polyval(line, FALLS) * FALLS
    rms = np.sqrt(np.mean(residual**2))
    assert_near(of_heights["rms"], rms, 0.05)
    assert abs(of_heights["bias"]) < 0.003


def test_what_was_not_dropped_has_no_height(usual):
    frame = usual.predict(impact="v_y1=5").frames["predictions"]
    columns = {*frame["column"]}
    assert "rebound_height" not in columns


def test_no_number_of_drops_by_heights_determines_the_drag(usual):
    """Of 40 drops more the error of the drag stays, 0.0043 of COR at 254 cm."""
    plan = usual.plan(target="cor_254cm", count=40)
    expected = plan.frames["targets"].loc["cor_254cm"]
    now = expected["now"]
    # Of three times as many velocities without that error it would be a half.
    assert now > expected["as before"] > 0.7 * now


def test_the_air_of_the_scene_is_that_of_the_heights():
    """In air half as dense heights are other speeds, at the usual drag and at any other."""
    scene = fitball.Scene(air={"density": 0.6})
    heights = dropped(0.77, 0.55, noise=0.004, density=0.6)
    fit = fitball.calibrate(heights, scene=scene, point_only=True, cores=1)
    point = fit.summary.loc["cor_median", "point"]
    assert_within(point, 0.770, 0.002)
    problem = fit.problem
    landing = landing_speeds(0.7 * 0.5 * PER_DRAG)
    other_drag = {"drag": np.array([0.7])}
    truth = problem.fall.true_states(other_drag, problem.table.impacts)
    assert_near(truth.v_y1[0], landing, 1e-3)


def test_what_was_measured_is_named():
    """Words have the column of the table, keys that of the model."""
    columns = dropped(0.77, 0.55, noise=0.004)
    columns["rebound_height"][7] += 0.1
    fit = fitball.calibrate(columns, point_only=True)
    [far_off] = [test for test in fit.adequacy.tests if test.kind == "outlier"]
    assert far_off.column == "v_y2"
    assert far_off.pattern.startswith("rebound_height:")
    assert "v_y2" not in fit.adequacy.sentence
    assert "v_y2" not in fit.report(full=False)


def test_a_scatter_is_that_of_heights():
    """Half of the range of rises at speeds one scatter about the median."""
    table = dropped(0.77, 0.55, noise=0.004)
    fit = fitball.calibrate(table, point_only=True)
    braking = 0.55 * PER_DRAG
    speed = np.median(np.sqrt(TWICE_G * np.expm1(braking * table["rebound_height"]) / braking))
    ends = rises(np.array([speed - 0.1, speed + 0.1]), braking)
    name, size, unit, *_ = scatter_as(fit, "v_y2", 0.1).split()
    assert (name, unit) == ("rebound_height", "cm")
    assert_within(float(size), 50.0 * np.ptp(ends), 0.1)
