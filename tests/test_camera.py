"""What a session's camera shares: the map to true states and back against geometry, and fits that
have it.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.density import REBOUND, TIMED, problem_of, scene_of, table_of, truth_of
from support.density import log_posterior as written_out

from fitball.base.values import Impacts
from fitball.data.scene import CameraSection, Scene, ValueWithSd
from fitball.inference.density import log_posterior
from fitball.inference.problem.camera import CameraModel
from fitball.models.types import Rebound, Status

# An ideal camera.
IDEAL = {
    "scale": 1.0,
    "clock": 1.0,
    "tilt": 0.0,
    "court_height": 0.0,
    "row_delay": 0.0,
}
# Standard gravity [m/s^2].
G = 9.80665
KEYS = tuple(IDEAL)


def rebound_of(**numbers):
    """The answer (1, 1) of one draw and one impact."""
    arrays = {name: np.array([[number]]) for name, number in numbers.items()}
    zero = np.zeros((1, 1), np.int64)
    return Rebound(**arrays, regime=zero, status=zero)


def camera_values(**settings):
    """Values of one draw."""
    return {name: np.array([value]) for name, value in {**IDEAL, **settings}.items()}


def lower_down(speed, height):
    """The vertical speed [m/s] at a place from which a ball, with this speed where it is `height`
    [m] higher, flies straight: to first order in the height.
    """
    return 0.5 * (speed + np.sqrt(speed**2 + 4.0 * G * height))


@pytest.mark.parametrize("delay", [0.0, -8e-4])
@pytest.mark.parametrize("height", [0.0, -2e-3, 3e-3])
@pytest.mark.parametrize("tilt", [0.0, 0.01])
@pytest.mark.parametrize("scale", [1.0, 1.03])
def test_flights_in_a_picture_against_the_gaps(height, tilt, scale, delay):
    """Both flights as points in the plane, turned as a camera would, slower at a higher court, cut
    at the height that was assumed, lower rows read later by the delay.
    """
    v_x1 = 14.0
    v_y1 = 9.0
    omega_1 = 40.0
    v_x2 = 10.0
    v_y2 = 6.5
    omega_2 = 260.0
    time = 4.7e-3
    path = 0.055
    turn = 0.6
    # The axes of the picture in those of the court, which rises in it; lengths in it are shorter by
    # the scale.
    cos = np.cos(tilt) / scale
    sin = np.sin(tilt) / scale
    turned = np.array([[cos, -sin], [sin, cos]])
    x_before, y_before = turned @ [v_x1, -v_y1]
    x_after, y_after = turned @ [v_x2, v_y2]
    along, above = turned @ [path, 0.0]
    down = lower_down(-y_before, height)
    # The same as the camera has it: to first order, and of the height at landing.
    up = y_after + G * height / y_after
    # A picture shows each height at a time that is its own: less the higher it is.
    faster = 1.0 - delay * down
    slower = 1.0 + delay * up
    x_before, y_before, turning_before = np.array([x_before, -down, omega_1]) / faster
    x_after, y_after, turning_after = np.array([x_after, up, omega_2]) / slower
    camera = CameraModel(KEYS, ("",), np.zeros(2, np.int64))
    values = camera_values(tilt=tilt, court_height=height, scale=scale, row_delay=delay)
    measured = Impacts(np.array([x_before]), np.array([-y_before]), np.array([turning_before]))
    rebound = rebound_of(
        v_x2=v_x2,
        v_y2=v_y2,
        omega_2=omega_2,
        contact_time=time,
        gap_time=time,
        gap_path=path,
        gap_turn=turn,
    )
    seen = camera.measured_rebounds(values, measured, rebound)
    true = camera.true_states(values, measured)
    assert_allclose(true.v_x1, [[v_x1]], rtol=1e-14)
    assert_allclose(true.v_y1, [[v_y1]], rtol=1e-14)
    assert_allclose(true.omega_1, [[omega_1]], rtol=1e-14)
    assert_allclose(seen.v_x2, [[x_after]], rtol=1e-14)
    assert_allclose(seen.v_y2, [[y_after]], rtol=1e-14)
    assert_allclose(seen.omega_2, [[turning_after]], rtol=1e-14)
    # Landing at (0, height) at time 0, release a path up the court: where do the flights pass the
    # height 0? The delay counts from there.
    landed = delay * height
    released = time + delay * (height + above)
    landing = landed - height / y_before
    release = released - (height + above) / y_after
    late = release - released
    early = landing - landed
    assert seen.gap_time[0, 0] == pytest.approx(release - landing, rel=1e-12)
    distance = along + late * x_after - early * x_before
    assert seen.gap_path[0, 0] == pytest.approx(distance, rel=1e-12)
    angle = turn + late * turning_after - early * turning_before
    assert seen.gap_turn[0, 0] == pytest.approx(angle, rel=1e-12)
    # Without height and tilt it is another time.
    if height:
        level = camera.measured_rebounds(camera_values(scale=scale), measured, rebound)
        assert abs(level.gap_time[0, 0] - seen.gap_time[0, 0]) > 1e-4


def fallen(speed, height):
    """The speed [m/s] of a ball that falls by a height [m] without air, by its energy."""
    return np.sqrt(speed**2 + 2.0 * G * height)


@pytest.mark.parametrize("height", [-2e-3, 3e-3])
def test_a_ball_is_slower_at_a_higher_court(height):
    """Slow drops, by energy, to second order in the height."""
    camera = CameraModel(("court_height",), ("",), np.zeros(1, np.int64))
    values = camera_values(court_height=height)
    measured = Impacts(np.zeros(1), np.array([2.0]), np.zeros(1))
    true = camera.true_states(values, measured)
    second_order = 0.5 * (G * height) ** 2 / 2.0**3
    expected = fallen(2.0, -height)
    assert true.v_y1[0, 0] == pytest.approx(expected, abs=1.1 * second_order)
    assert abs(expected - 2.0) > 20.0 * second_order
    zero = dict.fromkeys(("v_x2", "omega_2", "gap_path", "gap_turn"), 0.0)
    rebound = rebound_of(v_y2=1.5, contact_time=5e-3, gap_time=5e-3, **zero)
    seen = camera.measured_rebounds(values, measured, rebound)
    second_order = 0.5 * (G * height) ** 2 / 1.5**3
    assert seen.v_y2[0, 0] == pytest.approx(fallen(1.5, height), abs=1.1 * second_order)


def test_rows_that_are_read_for_longer_than_the_ball_flies_have_no_answer():
    camera = CameraModel(("row_delay",), ("",), np.zeros(2, np.int64))
    measured = Impacts(np.zeros(2), np.array([6.0, 60.0]), np.zeros(2))
    zero = dict.fromkeys(("v_x2", "omega_2", "gap_path", "gap_turn"), 0.0)
    rebound = rebound_of(v_y2=4.0, contact_time=5e-3, gap_time=5e-3, **zero)
    seen = camera.measured_rebounds(camera_values(row_delay=-0.02), measured, rebound)
    assert seen.status.tolist() == [[Status.OK, Status.NO_IMPACT]]


def test_what_does_not_reach_the_court_has_no_answer():
    problem = problem_of(table_of(TIMED), scene_of(camera=True), "two-mass")
    draws = problem.prior.draw(np.random.default_rng(0), 2)
    values = dict(problem.values(draws))
    values["tilt"] = np.array([0.0, -0.6])
    _, status_when_tilted = problem.rebounds(values).status
    _, angle = problem.rows.states.polar()
    steep = angle > 0.6 + 1e-9
    assert steep.any()
    assert not steep.all()
    assert np.all(status_when_tilted[~steep] == Status.NO_IMPACT)
    assert not np.any(status_when_tilted[steep] == Status.NO_IMPACT)
    away = Impacts(np.array([10.0]), np.array([-1.0]), np.zeros(1))
    values["tilt"] = np.array([0.0, 0.5])
    # Measured as moving away: even where the tilt turns it towards the court there is no time of
    # landing.
    seen = problem.rebounds(values, away, np.array([0]))
    assert seen.status.tolist() == [[Status.NO_IMPACT], [Status.NO_IMPACT]]


@pytest.mark.parametrize("key", KEYS)
def test_of_a_camera_of_which_one_thing_is_stated_all_else_is_right(key):
    section = CameraSection(**{key: ValueWithSd(IDEAL[key], 0.003)})
    problem = problem_of(table_of(TIMED, "sd"), Scene(camera=section), "two-mass")
    values = truth_of(problem)
    assert {*KEYS} & {*values} == {key}
    q = problem.coordinates(values)
    (score,) = log_posterior(problem, q[None])
    assert score == pytest.approx(written_out(problem, values), rel=1e-10)
    without_camera = written_out(problem, values, ("camera",))
    assert abs(without_camera - score) > 1e-3


def test_what_is_stated_asked_for_and_idle():
    section = CameraSection(
        scale=ValueWithSd(1.01, 0.02),
        clock=1.0005,
        court_height=ValueWithSd(0.0, 0.003),
    )
    scene = Scene(camera=section)
    problem = problem_of(table_of(REBOUND), scene, prior={"tilt": "normal(0, 0.01)"})
    parameters = {parameter.spec.name: parameter for parameter in problem.parameters}
    assert problem.camera.keys == ("scale", "clock", "tilt")
    assert parameters["scale"].prior.text == "normal(1.01, 0.02)"
    assert parameters["tilt"].prior.text == "normal(0, 0.01)"
    assert parameters["clock"].fixed == 1.0005
    assert "clock" not in problem.free
    assert "camera-idle" in {note.code for note in problem.notes}
    assert problem_of(table_of(REBOUND)).camera is None
    labels = {
        "id": tuple("abcdefghij"),
        "session": ("mon", "tue") * 5,
    }
    two_sessions = replace(table_of(REBOUND), labels=labels)
    camera = problem_of(two_sessions, scene).camera
    assert camera.sessions == ("mon", "tue")
    assert camera.session.tolist() == [0, 1] * 5
