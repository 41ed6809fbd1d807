"""What a session's camera shares: the map to true states and back, its derivatives, and fits that know it."""

import numpy as np
import pytest

from fitball.inference.problem.camera import LEVEL, seen, true
from fitball.models.types import OUTPUTS

MEASURED = np.array([12.0, 25.0]), np.array([8.0, 4.0]), np.array([-50.0, 300.0])
REBOUND = {
    "v_x2": np.array([9.0, 20.0]), "v_y2": np.array([6.0, 3.2]), "omega_2": np.array([150.0, 500.0]),
    "contact_time": np.full(2, 4.6e-3), "gap_time": np.full(2, 4.8e-3), "gap_path": np.array([0.05, 0.11]),
    "gap_turn": np.array([0.3, 1.9]),
}  # fmt: skip


def told(**moved):
    return {**LEVEL, **moved}


def test_a_length_and_a_clock_that_are_wrong_scale_what_has_them():
    v_x, v_y, omega = true(told(scale=1.02, clock=1.01), MEASURED)
    np.testing.assert_allclose(v_x, MEASURED[0] * 1.02 / 1.01)
    np.testing.assert_allclose(v_y, MEASURED[1] * 1.02 / 1.01)
    np.testing.assert_allclose(omega, MEASURED[2] / 1.01)
    found = seen(told(scale=1.02, clock=1.01), MEASURED, REBOUND)
    units = {"v_x2": 1.01 / 1.02, "v_y2": 1.01 / 1.02, "omega_2": 1.01, "gap_time": 1 / 1.01, "gap_path": 1 / 1.02}
    for name in OUTPUTS:
        np.testing.assert_allclose(found[name], REBOUND[name] * units.get(name, 1.0), err_msg=name)


@pytest.mark.parametrize("height", [-2e-3, 3e-3])
@pytest.mark.parametrize("tilt", [0.0, 0.01])
def test_flights_of_a_camera_against_the_gaps(height, tilt):
    """Both flights as points in the plane, turned as a camera would, and cut at the height that was assumed."""
    v_x1, v_y1, omega_1 = 14.0, 9.0, 40.0
    v_x2, v_y2, omega_2, time, path, turn = 10.0, 6.5, 260.0, 4.7e-3, 0.055, 0.6
    cosine, sine = np.cos(tilt), np.sin(tilt)
    # The axes of the picture in those of the court, which rises in it.
    turned = np.array([[cosine, -sine], [sine, cosine]])
    before, after = turned @ [v_x1, -v_y1], turned @ [v_x2, v_y2]
    measured = np.array([before[0]]), np.array([-before[1]]), np.array([omega_1])
    truth = {"v_x2": v_x2, "v_y2": v_y2, "omega_2": omega_2, "contact_time": time, "gap_time": time}
    truth |= {"gap_path": path, "gap_turn": turn}
    rebound = {name: np.array([value]) for name, value in truth.items()}
    found = seen(told(tilt=tilt, court_height=height), measured, rebound)
    back = true(told(tilt=tilt), measured)
    np.testing.assert_allclose([back[0][0], back[1][0], back[2][0]], [v_x1, v_y1, omega_1], rtol=1e-14)
    np.testing.assert_allclose([found["v_x2"][0], found["v_y2"][0]], after, rtol=1e-14)
    # Landing at (0, height) at time 0, release at (path, height): where do the flights pass the height 0?
    landing = height / measured[1][0]
    release = time - height / found["v_y2"][0]
    assert found["gap_time"][0] == pytest.approx(release - landing, rel=1e-12)
    ends = path + (release - time) * found["v_x2"][0], landing * measured[0][0]
    assert found["gap_path"][0] == pytest.approx(ends[0] - ends[1], rel=1e-12)
    angles = turn + (release - time) * omega_2, landing * omega_1
    assert found["gap_turn"][0] == pytest.approx(angles[0] - angles[1], rel=1e-12)
