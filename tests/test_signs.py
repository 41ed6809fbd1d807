"""Signs and zeros of angles: flips of signed angles, balls that fly the other way."""

import numpy as np
import pytest

import fitball

# Cricket balls that slide: incidence at -76 to -81 degrees from the normal, rebound at 82 to 85.
FROM_NORMAL = {
    "v_1 [mph]": [70.8, 58.9, 72.2, 62.4],
    "theta_1 [deg]": [-76.152, -80.707, -75.935, -75.722],
    "v_2 [mph]": [60.4, 53.3, 61.5, 53.0],
    "theta_2 [deg]": [82.016, 84.395, 81.817, 81.822],
}


def notes_of(table):
    return [note.code for note in table.notices]


def backwards_of(table):
    return [note.text for note in table.notices if note.code == "backwards"]


def test_flips_of_signed_angles_change_the_sign_first():
    """90 - 76.152, not 90 + 76.152."""
    table = fitball.load_table(FROM_NORMAL, flip="theta_1,theta_2")
    expected = 90.0 - np.abs(FROM_NORMAL["theta_1 [deg]"])
    assert np.degrees(table.values["theta_1"]) == pytest.approx(expected)
    assert np.degrees(table.values["theta_2"])[0] == pytest.approx(7.984)
    assert sorted(notes_of(table)) == ["flipped", "flipped", "turned"]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_ball_that_bounces_back_is_beyond_the_normal(sign):
    """The sign of most rows is the direction of travel."""
    columns = {
        "v_1": [10, 11, 12, 13],
        "theta_1": [-20, -21, -22, -23],
        "v_2": [7, 7, 8, 8],
        "theta_2": sign * np.array([30.0, 25.0, 40.0, -5.0]),
    }
    table = fitball.load_table(columns, flip="theta_1,theta_2")
    assert np.degrees(table.values["theta_2"]) == pytest.approx([60.0, 65.0, 50.0, 95.0])


def test_angles_beyond_the_normal_are_turned_after_the_flip():
    """Between the velocity, which points down, and the normal, which points up."""
    columns = {**FROM_NORMAL, "theta_1 [deg]": [103.848, 99.293, 104.065, 104.278]}
    table = fitball.load_table(columns, flip="theta_1,theta_2")
    expected = 90.0 - np.abs(FROM_NORMAL["theta_1 [deg]"])
    assert np.degrees(table.values["theta_1"]) == pytest.approx(expected)


def test_errors_of_flipped_angles_keep_their_correlation():
    """The sign changes once where it is negative throughout, and once with the zero."""
    errors = {"theta_1_sd": [0.1] * 4, "v_2_sd": [0.1] * 4, "corr(theta_1,v_2)": [0.5] * 4}
    signed = fitball.load_table({**FROM_NORMAL, **errors}, flip="theta_1,theta_2")
    assert signed.corr["theta_1,v_2"][0] == 0.5
    unsigned = np.abs(FROM_NORMAL["theta_1 [deg]"])
    columns = {**FROM_NORMAL, **errors, "theta_1 [deg]": unsigned}
    positive = fitball.load_table(columns, flip="theta_1,theta_2")
    assert positive.corr["theta_1,v_2"][0] == -0.5


BOTH_WAYS = {
    "v_x1": [15.0, -14.0, 13.0, -12.0],
    "v_y1": [5.0, 5.0, 5.0, 5.0],
    "v_x2": [10.0, -9.0, 9.0, -8.0],
    "v_y2": [4.0, 4.0, 4.0, 4.0],
}
BY_ANGLE = {
    "v_1": [15, 14, 13],
    "theta_1": [20, 160, 25],
    "v_2": [9, 8, 8],
    "theta_2": [24, 156, 29],
    "omega_2": [200, -200, 200],
}


def test_balls_that_fly_the_other_way_are_read_as_they_are_and_their_spins_named():
    columns = {**BOTH_WAYS, "omega_1": [0.0, 10.0, 0.0, 5.0]}
    table = fitball.load_table(columns)
    (text,) = backwards_of(table)
    assert "rows 2 and 4" in text
    for name, values in columns.items():
        assert table.values[name].tolist() == values
    # Without a spin there is no sign to ask for.
    assert not backwards_of(fitball.load_table(BOTH_WAYS))
    backwards = {"v_x1": [-15.0, -14.0], "v_y1": [5.0] * 2, "v_x2": [-9.0, -8.0], "v_y2": [4.0] * 2}
    (text,) = backwards_of(fitball.load_table({**backwards, "omega_2": [-200.0, -190.0]}))
    assert "every row" in text


def test_angles_beyond_the_normal_are_those_of_balls_that_fly_the_other_way():
    table = fitball.load_table(BY_ANGLE)
    (text,) = backwards_of(table)
    assert "row 2" in text
    expected = 14.0 * np.cos(np.radians(160.0))
    assert table.impacts.v_x1[1] == pytest.approx(expected, rel=1e-12)
    assert table.impacts.side.tolist() == [1.0, -1.0, 1.0]


@pytest.mark.parametrize(
    "columns",
    [
        # A ball that is dropped has some v_x of either sign.
        {"v_x1": [-0.1, 0.2, -0.2], "v_y1": [7.0, 7.0, 7.0], "v_x2": [0.0, 0.1, -0.1]},
        {"v_x1": [-0.9, 0.7, 0.2], "v_x1_sd": [0.4] * 3, "v_y1": [7.0, 7.0, 7.0]},
        # A ball with backspin may bounce back.
        {"v_x1": [3.0, 4.0, 5.0], "v_y1": [9.0, 9.0, 9.0], "v_x2": [-1.0, -0.5, 1.0]},
    ],
)
def test_balls_that_are_dropped_or_bounce_back_are_not_named(columns):
    measured = {**columns, "v_y2": [5.0, 5.2, 5.1], "omega_2": [1.0, 2.0, 3.0]}
    assert not backwards_of(fitball.load_table(measured))
