"""What a session's camera shares: the map to true states and back against geometry, and fits that
have it.
"""

from dataclasses import replace

import numpy as np
import pytest
from support.density import REBOUND, TIMED, problem_of, scene_of, table_of, truth_of
from support.density import log_posterior as written_out

from fitball.base.values import Impacts
from fitball.data.scene import CameraSection, Quantity, Scene
from fitball.inference.density import log_posterior
from fitball.inference.problem.camera import CameraModel
from fitball.models.types import Rebound, Status

KEYS = ("scale", "clock", "tilt", "court_height")


def rebound_of(**columns):
    arrays = {
        name: np.atleast_2d(np.array(values, dtype=float)) for name, values in columns.items()
    }
    zero = np.zeros(arrays["v_x2"].shape, np.int64)
    return Rebound(**arrays, regime=zero, status=zero)


def camera(**settings):
    """Camera of one session, and its values of one draw."""
    held = {"scale": 1.0, "clock": 1.0, "tilt": 0.0, "court_height": 0.0, **settings}
    return CameraModel(KEYS, ("",), np.zeros(2, np.int64)), {
        name: np.array([value]) for name, value in held.items()
    }


@pytest.mark.parametrize("height", [-2e-3, 3e-3])
@pytest.mark.parametrize("tilt", [0.0, 0.01])
@pytest.mark.parametrize("scale", [1.0, 1.03])
def test_flights_in_a_picture_against_the_gaps(height, tilt, scale):
    """Both flights as points in the plane, turned as a camera would, and cut at the height that was
    assumed.
    """
    v_1 = (14.0, 9.0)
    omega_1 = 40.0
    v_2 = (10.0, 6.5)
    omega_2 = 260.0
    time = 4.7e-3
    path = 0.055
    turn = 0.6
    # The axes of the picture in those of the court, which rises in it; lengths in it are shorter by
    # the scale.
    turned = np.array([[np.cos(tilt), -np.sin(tilt)], [np.sin(tilt), np.cos(tilt)]]) / scale
    before = turned @ [v_1[0], -v_1[1]]
    after = turned @ v_2
    known, values = camera(tilt=tilt, court_height=height, scale=scale)
    measured = Impacts(np.array([before[0]]), np.array([-before[1]]), np.array([omega_1]))
    bounced = {
        "v_x2": v_2[0],
        "v_y2": v_2[1],
        "omega_2": omega_2,
        "contact_time": time,
        "gap_time": time,
    }
    bounced |= {"gap_path": path, "gap_turn": turn}
    seen = known.seen(values, measured, rebound_of(**bounced))
    back = known.true(values, measured)
    np.testing.assert_allclose(
        [back.v_x1[0, 0], back.v_y1[0, 0], back.omega_1[0, 0]],
        [*v_1, omega_1],
        rtol=1e-14,
    )
    np.testing.assert_allclose([seen.v_x2[0, 0], seen.v_y2[0, 0]], after, rtol=1e-14)
    # Landing at (0, height) at time 0, release a path up the court: where do the flights pass the
    # height 0?
    along, above = turned @ [path, 0.0]
    landing = -height / before[1]
    release = time - (height + above) / after[1]
    assert seen.gap_time[0, 0] == pytest.approx(release - landing, rel=1e-12)
    ends = along + (release - time) * after[0] - landing * before[0]
    assert seen.gap_path[0, 0] == pytest.approx(ends, rel=1e-12)
    angle = turn + (release - time) * omega_2 - landing * omega_1
    assert seen.gap_turn[0, 0] == pytest.approx(angle, rel=1e-12)
    # Without height and tilt it is another time.
    level = known.seen(camera(scale=scale)[1], measured, rebound_of(**bounced))
    assert abs(level.gap_time[0, 0] - seen.gap_time[0, 0]) > 1e-4


def test_what_does_not_reach_the_court_has_no_answer():
    problem = problem_of(table_of(TIMED), scene_of(camera=True), "two-mass")
    values = dict(problem.values(problem.prior.draw(np.random.default_rng(0), 2)))
    values["tilt"] = np.array([0.0, -0.6])
    seen = problem.seen(values)
    steep = problem.rows.states.polar()[1] > 0.6 + 1e-9
    assert steep.any()
    assert not steep.all()
    assert np.all(seen.status[1, ~steep] == Status.NO_IMPACT)
    assert not np.any(seen.status[1, steep] == Status.NO_IMPACT)
    away = Impacts(np.array([10.0]), np.array([-1.0]), np.zeros(1))
    values["tilt"] = np.array([0.0, 0.5])
    # Measured as moving away: even where the tilt turns it towards the court there is no time of
    # landing.
    assert problem.seen(values, away, np.array([0])).status.tolist() == [
        [Status.NO_IMPACT],
        [Status.NO_IMPACT],
    ]


@pytest.mark.parametrize("key", KEYS)
def test_of_a_camera_of_which_one_thing_is_stated_all_else_is_right(key):
    known = Scene(camera=CameraSection(**{key: Quantity(float(key in ("scale", "clock")), 0.003)}))
    problem = problem_of(table_of(TIMED, "sd"), known, "two-mass")
    at = truth_of(problem)
    assert {*KEYS} & {*at} == {key}
    found = log_posterior(problem, problem.coordinates(at)[None])[0]
    assert found == pytest.approx(written_out(problem, at), rel=1e-10)
    assert abs(written_out(problem, at, ("camera",)) - found) > 1e-3


def test_what_is_stated_asked_for_and_idle():
    known = Scene(
        camera=CameraSection(
            scale=Quantity(1.01, 0.02),
            clock=1.0005,
            court_height=Quantity(0.0, 0.003),
        )
    )
    problem = problem_of(table_of(REBOUND), known, prior={"tilt": "normal(0, 0.01)"})
    named = {item.spec.name: item for item in problem.parameters}
    assert problem.camera.keys == ("scale", "clock", "tilt")
    assert named["scale"].prior.text == "normal(1.01, 0.02)"
    assert named["tilt"].prior.text == "normal(0, 0.01)"
    assert named["clock"].fixed == 1.0005
    assert "clock" not in problem.free
    assert "camera-idle" in {note.code for note in problem.notes}
    assert problem_of(table_of(REBOUND)).camera is None
    two = replace(
        table_of(REBOUND),
        labels={"id": tuple("abcdefghij"), "session": ("mon", "tue") * 5},
    )
    filmed = problem_of(two, known).camera
    assert filmed.sessions == ("mon", "tue")
    assert filmed.session.tolist() == [0, 1] * 5
