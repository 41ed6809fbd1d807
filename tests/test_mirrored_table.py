"""A table of which some rows are mirror images is the same table to everything that asks it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import fitball
from fitball.base.columns import MIRRORED
from fitball.data.balances import impact_balances
from fitball.report.figures.shared import to_one_side
from fitball.uses.pace import measured_pace

ROWS = 24
SIDE = np.where(np.arange(ROWS) % 3 == 1, -1.0, 1.0)


def columns_of(side):
    """Rebounds of a ball with a noise and one impact far off, each flying to its side; friction
    wears off along the rows.
    """
    rng = np.random.default_rng(8)
    v_y1 = rng.uniform(4.0, 14.0, ROWS)
    v_x1 = v_y1 * rng.uniform(0.5, 3.0, ROWS)
    omega_1 = rng.uniform(-100.0, 200.0, ROWS)
    model = fitball.model("grip-slip")
    draws = []
    for k in range(ROWS):
        mu = 0.6 - 0.012 * k
        draws.append([mu, 0.12, 2e-3, 0.76, -0.01])
    names = ["mu", "e_x", "offset", "cor_10", "cor_slope"]
    at = fitball.impacts(v_x1, v_y1, omega_1)
    rebound = model.evaluate(names, np.array(draws), at)
    k = np.arange(ROWS)
    columns = {"v_x1": v_x1, "v_y1": v_y1, "omega_1": omega_1}
    for name, noise in (("v_x2", 0.2), ("v_y2", 0.15), ("omega_2", 8.0)):
        columns[name] = getattr(rebound, name)[k, k] + noise * rng.standard_normal(ROWS)
    return {name: values * side if name in MIRRORED else values for name, values in columns.items()}


@pytest.fixture(scope="module")
def fits():
    """Point fits of the table as it is, and with mirrored rows."""
    options = {"model": "grip-slip", "point_only": True}
    return [fitball.calibrate(columns_of(side), **options) for side in (1.0, SIDE)]


def test_the_fit_and_its_verdict_are_the_same(fits):
    plain, mirrored = fits
    for name, estimate in plain.parameters.items():
        assert mirrored.parameters[name].point == pytest.approx(estimate.point, rel=1e-9), name
        assert mirrored.parameters[name].verdict == estimate.verdict
    assert mirrored.adequacy.answer == plain.adequacy.answer
    # Signs that are mixed along the rows would hide the friction that wears off.
    assert len(plain.adequacy.tests) == len(mirrored.adequacy.tests)
    for test, other in zip(plain.adequacy.tests, mirrored.adequacy.tests, strict=True):
        assert (test.kind, test.column, test.pattern) == (other.kind, other.column, other.pattern)
        assert other.p == pytest.approx(test.p, rel=1e-6, abs=1e-12)
    assert any(test.found for test in plain.adequacy.tests)
    for name, quantity in plain.derived.items():
        assert mirrored.derived[name].point == pytest.approx(quantity.point, rel=1e-9), name


def test_topspin_that_is_positive_to_either_side_is_seen():
    """The reading is proposed, and names the spins; of a table that is read well nothing is."""
    columns = columns_of(SIDE)
    assert fitball.check(columns).frames["doubts"].empty
    for name in ("omega_1", "omega_2"):
        columns[name] = SIDE * columns[name]
    ((reading, *_),) = fitball.check(columns).frames["doubts"].to_numpy().tolist()
    assert "omega_1 and omega_2" in reading
    assert "negative v_x" in reading


def test_predictions_of_its_rows_are_mirror_images(fits):
    plain, mirrored = (fit.predictions for fit in fits)
    side = SIDE[plain["row"]]
    turned = np.where(plain["column"].isin(MIRRORED), side, 1.0)
    for name in ("observed", "point", "z"):
        assert_allclose(mirrored[name], turned * plain[name], rtol=1e-6, atol=1e-9)
    assert (mirrored["v_x1"] == side * plain["v_x1"]).all()
    assert (mirrored["regime"] == plain["regime"]).all()


def test_figures_draw_it_as_if_all_balls_flew_to_one_side(fits):
    plain, mirrored = fits
    names = ["along", "point"]
    assert_allclose(mirrored.curves[names], plain.curves[names], rtol=1e-7, atol=1e-9)
    assert mirrored.curves["series"].tolist() == plain.curves["series"].tolist()
    drawn = to_one_side(mirrored.predictions)
    names = ["theta_1", "omega_1", "v_x1", "observed", "point", "z", "series"]
    assert_allclose(drawn[names], plain.predictions[names], rtol=1e-6, atol=1e-9)
    assert np.isnan(drawn["median"]).all()
    # An angle of 140 degrees is the mirror image of one of 40.
    frame = plain.predictions.head(2).assign(column="theta_2", observed=[2.5, 0.6], v_x1=[-9.0, 9])
    turned = to_one_side(frame)["observed"].to_numpy()
    assert turned == pytest.approx([np.pi - 2.5, 0.6], rel=1e-12)


def test_balances_of_its_rows_are_the_same():
    ball = fitball.Ball()
    noise = {"v_x2": 0.2, "v_y2": 0.15, "omega_2": 8.0}
    plain, mirrored = (
        impact_balances(fitball.load_table(columns_of(side)), ball, noise) for side in (1.0, SIDE)
    )
    assert np.isfinite(plain.to_numpy()).all()
    assert_allclose(mirrored.to_numpy(), plain.to_numpy(), rtol=1e-12, atol=1e-15)


def test_new_impacts_are_predicted_alike_and_extrapolated_alike(fits):
    words = "v_x1={}, v_y1=8, omega_1={}"
    frames = []
    for fit in fits:
        for v_x1, omega_1 in ((12, 40), (-12, -40), (60, 0), (-60, 0)):
            answer = fitball.predict(fit, impact=words.format(v_x1, omega_1))
            frames.append(answer.frames["predictions"].set_index("column"))
    for right, left in zip(frames[::2], frames[1::2], strict=True):
        for name in ("v_x2", "omega_2"):
            assert left.loc[name, "point"] == -right.loc[name, "point"]
        assert left.loc["v_y2", "point"] == right.loc["v_y2", "point"]
        angle = right.loc["theta_2", "point"] + left.loc["theta_2", "point"]
        assert angle == pytest.approx(np.pi, rel=1e-12)
        assert left.loc["v_x2", "outside"] == right.loc["v_x2", "outside"]
        assert left.loc["v_x2", "distance"] == pytest.approx(right.loc["v_x2", "distance"])
    assert [bool(frame["outside"].iloc[0]) for frame in frames[:4]] == [False, False, True, True]


def test_angles_are_ranges_through_the_vertical(fits):
    """From one side to the other nothing jumps, and straight down a ball without spin leaves
    straight up.
    """
    answer = fitball.predict(fits[0], impact="v_1=12, theta_1=80..100 deg:401")
    frame = answer.frames["predictions"]
    v_x2 = frame[frame["column"] == "v_x2"]["point"].to_numpy()
    assert v_x2 == pytest.approx(-v_x2[::-1], abs=1e-12)
    assert abs(v_x2[200]) < 1e-12
    assert np.abs(np.diff(v_x2)).max() < 0.1 * np.ptp(v_x2)


def test_the_pace_of_a_court_and_angles_count_to_either_side():
    """Friction 0.6 and restitution 0.85: 100 (1 - 0.6) + 150 (0.81 - 0.85) = 34."""
    speed = 30.0
    v_y1 = speed * np.sin(np.radians(16.0))
    v_x1 = speed * np.cos(np.radians(16.0))
    v_x2 = v_x1 - 0.6 * 1.85 * v_y1
    right = {
        "v_1": [speed] * 6,
        "theta_1": [16.0] * 6,
        "v_x2": [v_x2] * 6,
        "v_y2": [0.85 * v_y1] * 6,
        "surface": ["hard"] * 6,
    }
    left = {**right, "theta_1": [164.0] * 6, "v_x2": [-v_x2] * 6}
    ratings = []
    for columns in (right, left):
        rated = measured_pace(fitball.load_table(columns), fitball.Scene())
        ratings.append(float(rated["rating"].iloc[0]))
    assert ratings == pytest.approx([34.0, 34.0], abs=1e-9)
