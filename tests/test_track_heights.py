"""Tracks of heights over time alone, by a motion sensor or a camera beside the ball: drops, with
speeds against bounces that scipy integrated.
"""

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import brentq
from scipy.signal import lfilter
from support.films import RADIUS, flight
from support.near import assert_near, assert_within

import fitball
from fitball.base.errors import InputError
from fitball.data.scene import CameraSection, Scene

# Restitution of the ball, and time of each contact [s].
COR = 0.8
CONTACT = 5e-3
# Landing speed of a fall through air from the hand [m/s], and how many bounces are followed.
FIRST_LANDING = 4.8
BOUNCES = 4


def fall_time(falling, landing):
    """The time [s] before landing at which a ball that lands so fast was at rest."""
    return -brentq(
        lambda t: falling(t)[3],
        -1.2 * landing / 9.8,
        0.0,
    )


def rise_time(rising, launch):
    """The time [s] after launch at which the ball is back on the ground."""
    return brentq(
        lambda t: rising(t)[1],
        0.05,
        2.2 * launch / 9.8,
    )


def bounced(rate, noise, seed=0):
    """Times and heights of the centre of a ball that falls and rebounds, and its speeds (bounces,
    2) before and after each bounce.
    """
    rng = np.random.default_rng(seed)
    landing = FIRST_LANDING
    falling = flight(
        0.0,
        -landing,
        0.0,
        0.507,
        0.0,
        -1.0,
    )
    lands = fall_time(falling, landing)
    t = np.arange(0.0, 10.0, 1.0 / rate)
    heights = np.where(t < lands, falling(np.minimum(t - lands, 0.0))[1], np.nan)
    speeds = []
    for _ in range(BOUNCES):
        launch = COR * landing
        speeds.append((landing, launch))
        leaves = lands + CONTACT
        # Pressed in by some millimetres.
        heights[(t >= lands) & (t < leaves)] = -0.004
        rising = flight(0.0, launch, 0.0, 0.507, 0.0, 1.2)
        lands = leaves + rise_time(rising, launch)
        aloft = (t >= leaves) & (t < lands)
        heights[aloft] = rising(t[aloft] - leaves)[1]
        landing = -rising(lands - leaves)[3]
    seen = np.isfinite(heights)
    errors = noise * rng.standard_normal(seen.sum())
    return t[seen], heights[seen] + RADIUS + errors, np.array(speeds)


def speeds_of(film):
    """Speeds (impacts, 2) of a film of drops, and their sds."""
    frame = film.impacts
    values = frame[["v_y1 [m/s]", "v_y2 [m/s]"]].to_numpy()
    sds = frame[["v_y1_sd [m/s]", "v_y2_sd [m/s]"]].to_numpy()
    return values, sds


@pytest.mark.parametrize(("rate", "noise"), [(60.0, 1e-3), (240.0, 2e-3)])
def test_heights_over_time_are_drops(rate, noise):
    t, y, truth = bounced(rate, noise)
    film = fitball.track(pd.DataFrame({"t [s]": t, "y [m]": y}))
    heads = ["v_y1 [m/s]", "v_y1_sd [m/s]", "v_y2 [m/s]", "v_y2_sd [m/s]", "corr(v_y1,v_y2)"]
    assert film.impacts.columns.tolist() == heads
    values, sds = speeds_of(film)
    assert values.shape == truth.shape
    assert np.abs((values - truth) / sds).max() < 3.5
    assert np.abs(values / truth - 1.0).max() < 0.02
    assert "heights-alone" in {note.code for note in film.notes}
    fit = fitball.calibrate(
        film.table,
        scene=film.scene,
        point_only=True,
    )
    assert_within(fit.derived["cor_median"].point, COR, 0.01)
    assert "camera-idle" not in {note.code for note in fit.notes}


def test_heights_may_have_the_names_of_sensors_and_grow_downwards():
    t, y, _ = bounced(100.0, 1e-3)
    upwards = fitball.track(pd.DataFrame({"t [s]": t, "y [m]": y}))
    expected, _ = speeds_of(upwards)
    for name in ("z [m]", "height [m]", "Position [m]", "Latest: Position (m)"):
        film = fitball.track(pd.DataFrame({"Time [s]": t, name: y}))
        assert speeds_of(film)[0] == pytest.approx(expected, rel=1e-12), name
    # A sensor above the ball measures how far away it is.
    from_above = pd.DataFrame({"Time [s]": t, "Distance [m]": 2.0 - y})
    with pytest.raises(InputError) as refused:
        fitball.track(from_above)
    assert refused.value.code == "gravity"
    assert 'y = "down"' in str(refused.value)
    film = fitball.track(from_above, scene=Scene(camera=CameraSection(y="down")))
    assert_near(speeds_of(film)[0], expected, 1e-4)


def test_an_x_that_stands_still_is_none():
    """Else a friction would be fitted to its rounding errors."""
    t, y, _ = bounced(60.0, 1e-3)
    expected, _ = speeds_of(fitball.track(pd.DataFrame({"t [s]": t, "y [m]": y})))
    for x in (0.0, 0.25):
        film = fitball.track(pd.DataFrame({"t [s]": t, "x [m]": x, "y [m]": y}))
        assert "v_x1 [m/s]" not in film.impacts
        values, _ = speeds_of(film)
        assert_near(values, expected, 1e-9)


def test_check_of_positions_names_the_verb_that_reads_them(tmp_path):
    path = tmp_path / "sensor.csv"
    t, y, truth = bounced(60.0, 1e-3)
    np.savetxt(path, np.column_stack([t, y]), delimiter=",", header="t [s],y [m]", comments="")
    with pytest.raises(InputError) as refused:
        fitball.load_table(path)
    assert refused.value.faults[0].code == "no-incident"
    _, _, file = refused.value.faults[0].message.partition("fitball track ")
    film = fitball.track(file)
    assert len(film.impacts) == len(truth)


def test_outliers_of_heights_are_left_out():
    """By the model of a fit a frame that is 9 mm off is none of a noise of 1 mm, in a plane or on
    a line.
    """
    t, y, truth = bounced(240.0, 1e-3)
    exact = bounced(240.0, 0.0)[1]
    wrong = np.arange(20, y.size, 37)
    y[wrong] = exact[wrong] + 9e-3
    film = fitball.track(pd.DataFrame({"t [s]": t, "y [m]": y}))
    values, _ = speeds_of(film)
    assert np.abs(values / truth - 1.0).max() < 0.02
    tracks = film.frames["tracks"]
    of_flights = tracks[tracks["role"] != "contact"]
    is_wrong = np.isin(of_flights["t [s]"], t[wrong])
    assert is_wrong.sum() > 5
    assert (of_flights["outlier"][is_wrong] > 0.5).mean() > 0.7
    assert (of_flights["outlier"][~is_wrong] < 0.5).mean() > 0.99
    assert of_flights["x [m]"].isna().all()


def test_errors_of_heights_that_last_are_noticed():
    """A sensor that smooths: neighbours have a correlation of 0.8."""
    t, y, _ = bounced(240.0, 0.0)
    rng = np.random.default_rng(3)
    error = lfilter(
        [1.0],
        [1.0, -0.8],
        2e-3 * rng.standard_normal(t.size),
    )
    smoothed = fitball.track(pd.DataFrame({"t [s]": t, "y [m]": y + error}))
    assert "lasting-errors" in {note.code for note in smoothed.notes}
    independent = rng.permutation(error)
    plain = fitball.track(
        pd.DataFrame(
            {
                "t [s]": t,
                "y [m]": y + independent,
            }
        )
    )
    assert "lasting-errors" not in {note.code for note in plain.notes}


def test_a_page_draws_heights_over_time():
    t, y, _ = bounced(60.0, 1e-3)
    film = fitball.track(pd.DataFrame({"t [s]": t, "y [m]": y}))
    figure = film.plot("track-1")
    (first, *_) = figure.axes
    assert first.get_xlabel() == "time [s]"
    drawn = first.lines[1].get_xdata()
    assert np.isin(drawn, t).all()
    assert np.ptp(drawn) > 0.1
    # The restitution fills its figure: there are no gaps below it.
    session = film.plot("session")
    session.draw_without_rendering()
    (alone,) = session.axes
    assert alone.get_position().height > 0.6


def test_two_coordinates_without_a_clock_or_two_heights_are_no_drops():
    t, y, _ = bounced(60.0, 1e-3)
    for table in ({"y [m]": y}, {"t [s]": t, "y [m]": y, "z [m]": y}):
        with pytest.raises(InputError) as refused:
            fitball.track(pd.DataFrame(table))
        assert refused.value.code == "no-positions"
