"""What a session's camera shares: the map to true states and back, its derivatives, and fits that know it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import fitball
from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.errors import FitError
from fitball.inference.prediction.posterior_predictive import _curve
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.camera import LEVEL, seen, true
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import Verdict
from fitball.models.types import OUTPUTS
from fitball.observables import OBSERVABLES
from fitball.report.fit.judged import tilt_line

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
    # Landing at (0, height) at time 0, release a path up the court: where do the flights pass the height 0?
    along, above = turned @ [path, 0.0]
    landing = height / measured[1][0]
    release = time - (height + above) / found["v_y2"][0]
    assert found["gap_time"][0] == pytest.approx(release - landing, rel=1e-12)
    ends = along + (release - time) * found["v_x2"][0], landing * measured[0][0]
    assert found["gap_path"][0] == pytest.approx(ends[0] - ends[1], rel=1e-12)
    angles = turn + (release - time) * omega_2, landing * omega_1
    assert found["gap_turn"][0] == pytest.approx(angles[0] - angles[1], rel=1e-12)


VALUES = {
    "mass_ratio": 0.883, "k_y": 2.0e4, "k_theta": 19.0, "mu": 0.568, "eps_10": 2.38e-3, "eps_slope": 0.0,
    "cor_10": 0.774, "cor_slope": -0.0151,
}  # fmt: skip
NOISE = {
    "v_x2": 0.1, "v_y2": 0.1, "omega_2": 4.0, "gap_time": 5e-5, "gap_path": 8e-4, "gap_turn": 0.035,
}  # fmt: skip


def filmed(seed: int, sessions: int = 1, **settings: tuple[float, ...]) -> pd.DataFrame:
    """Wang's incidences on a ball of VALUES, as cameras of these settings, one for each session, would show them."""
    given = fitball.load_table("wang_all").impacts
    rng, count = np.random.default_rng(seed), len(given)
    session = np.arange(count) % sessions
    known = {key: np.array(settings.get(key, (value,) * sessions))[session] for key, value in LEVEL.items()}
    bounced = fitball.model("two-mass").rebound(VALUES, given)
    # What the camera shows of true states: the inverse of `true`, a turn back and lengths over the scale.
    slow, cosine, sine = known["clock"] / known["scale"], np.cos(known["tilt"]), np.sin(known["tilt"])
    v_x1 = slow * (given.v_x1 * cosine + given.v_y1 * sine)
    v_y1 = slow * (given.v_y1 * cosine - given.v_x1 * sine)
    omega_1 = given.omega_1 * known["clock"]
    shown = seen(known, (v_x1, v_y1, omega_1), {name: getattr(bounced, name) for name in OUTPUTS})
    columns = {"v_x1 [m/s]": v_x1, "v_y1 [m/s]": v_y1, "omega_1 [rad/s]": omega_1}
    for name, sd in NOISE.items():
        columns[f"{name} [{OBSERVABLES[name].unit}]"] = shown[name] + sd * rng.standard_normal(count)
    frame = pd.DataFrame({"id": [f"r{k + 1}" for k in range(count)], **columns})
    return frame.assign(session=[f"day {k + 1}" for k in session]) if sessions > 1 else frame


CAMERA = """[ball]
mass = 0.0576
radius = 0.033
inertia_ratio = 0.56
[camera]
scale = { value = 1, sd = 0.01 }
tilt = { value = 0, sd = 0.005 }
court_height = { value = 0, sd = 0.003 }
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    place = tmp_path / "camera.toml"
    place.write_text(CAMERA, encoding="utf-8")
    return place


def problem_of(frame: pd.DataFrame, scene: Path, **choices: Any) -> Problem:
    return build_problem(load_table(frame), load_scene(None, scene), Choices(**choices))


@pytest.mark.parametrize("choices", [{}, {"pool": {"mu": "session"}}, {"model": "grip-slip"}])
def test_derivatives_against_differences(choices: dict[str, Any], scene: Path) -> None:
    problem = problem_of(filmed(1, 3), scene, **choices)
    names = problem.free_names
    assert {"scale[day 1]", "scale[day 2]", "tilt[day 3]"} <= {*names}
    assert ("court_height[day 1]" in names) is ("model" not in choices)
    rng = np.random.default_rng(5)
    middle = np.array([item.prior.quantile(np.array([0.5]))[0] for item in problem.free])
    known = {**VALUES, "e_x": 0.1, "offset": 2e-3}
    values = np.array([known.get(name, middle[k]) for k, name in enumerate(names)])[None, :]
    x = problem.to_coordinates(values) + 0.05 * rng.standard_normal(values.shape) * np.minimum(
        problem.prior.width, 0.3
    )
    rebound, slopes = problem.differentiated(x)
    np.testing.assert_array_equal(rebound.regime, problem.rebound(problem.to_values(x)).regime)
    for k, name in enumerate(names):
        step = np.zeros_like(x)
        step[0, k] = 1e-6 * problem.prior.width[k]
        ahead, behind = (problem.rebound(problem.to_values(x + sign * step)) for sign in (1.0, -1.0))
        alike = (ahead.regime == behind.regime)[0]
        for output in (item for item in OUTPUTS if problem.model.gives(OBSERVABLES[item])):
            size = np.nanmax(np.abs(getattr(rebound, output)))
            found = (getattr(ahead, output) - getattr(behind, output))[0] / (2.0 * step[0, k])
            error = np.abs(found - slopes[output][0, :, k])[alike] * problem.prior.width[k] / size
            assert error.max() < 1e-6, (name, output)


def test_incident_slopes_against_differences(scene: Path) -> None:
    problem = problem_of(filmed(1, 2), scene)
    middle = np.array([[item.prior.quantile(np.array([0.5]))[0] for item in problem.free]])
    columns = {**problem.all_values(middle), **{name: np.array([value]) for name, value in VALUES.items()}}
    columns |= {"tilt[day 1]": np.array([0.01]), "court_height[day 2]": np.array([-2e-3])}
    rows, impacts = np.arange(len(problem.impacts)), problem.impacts
    slopes = problem.slopes_like(columns, impacts, rows)
    for place, (name, step) in enumerate({"v_x1": 1e-4, "v_y1": 1e-4, "omega_1": 1e-2}.items()):
        moved = [replace(impacts, **{name: getattr(impacts, name) + sign * step}) for sign in (1.0, -1.0)]
        ahead, behind = (problem.seen_like(columns, item, rows) for item in moved)
        alike = (ahead.regime == behind.regime)[0]
        for output in OUTPUTS:
            found = (getattr(ahead, output) - getattr(behind, output))[0] / (2.0 * step)
            size = np.abs(getattr(ahead, output)).max() / np.abs(getattr(impacts, name)).max()
            np.testing.assert_allclose(slopes[output][0, alike, place] / size, found[alike] / size, atol=1e-5)


def test_a_height_that_is_off_misleads_where_it_is_held_and_not_where_it_is_free(scene: Path, tmp_path: Path) -> None:
    """1 mm of height is 0.23 ms of the time, and 10 % of k_y, which goes as its inverse square."""
    frame = filmed(4, court_height=(1e-3,))
    free = fitball.calibrate(frame, config=scene, point_only=True)
    assert free.parameters["court_height"].point == pytest.approx(1e-3, abs=4e-4)
    assert free.parameters["k_y"].point == pytest.approx(2.0e4, rel=0.04)
    held = tmp_path / "held.toml"
    held.write_text(CAMERA.replace("court_height = { value = 0, sd = 0.003 }", "court_height = 0"), encoding="utf-8")
    fit = fitball.calibrate(frame, config=held, point_only=True)
    assert fit.parameters["court_height"].verdict is Verdict.FIXED
    assert fit.parameters["k_y"].point > 1.06 * 2.0e4


def test_sessions_have_cameras_of_their_own(scene: Path, tmp_path: Path) -> None:
    truth = {"court_height": (2e-3, -1.5e-3), "tilt": (0.006, -0.006), "scale": (1.01, 0.995)}
    fit = fitball.calibrate(filmed(2, 2, **truth), config=scene, point_only=True)
    for day in range(2):
        found = fit.parameters[f"court_height[day {day + 1}]"].point
        assert found == pytest.approx(truth["court_height"][day], abs=5e-4)
    assert fit.parameters["tilt[day 1]"].point > fit.parameters["tilt[day 2]"].point
    assert fit.parameters["k_y"].point == pytest.approx(2.0e4, rel=0.04)
    fit.save(tmp_path / "fit")
    again = fitball.load_fit(tmp_path / "fit")
    assert again.parameters["court_height[day 2]"].unit == "m"
    assert "court_height[day 2]" in again.report()
    # Predictions are of true impacts: no camera in them.
    found = again.fitted.rebound(fitball.impacts(15.0, 8.0, 0.0))
    own = {name: fit.parameters[name].point for name in VALUES}
    bounced = fitball.model("two-mass").rebound(own, fitball.impacts(15.0, 8.0, 0.0))
    # The scale of 1 % would show.
    assert float(np.median(found.v_x2[:, 0])) == pytest.approx(float(bounced.v_x2[0]), rel=2e-3)


def test_what_acts_on_nothing_is_named(scene: Path) -> None:
    frame = filmed(1).drop(columns=["gap_time [s]", "gap_path [m]", "gap_turn [rad]"])
    problem = problem_of(frame, scene)
    assert "court_height" not in problem.free_names
    assert any("court_height of the camera is not used" in note for note in problem.notes)
    with pytest.raises(FitError, match="cor = measured takes the restitution as it was measured"):
        problem_of(frame, scene, closures={"cor": "measured"})


@pytest.mark.parametrize(("setting", "value"), [("court_height", 2e-3), ("court_height", -3e-3)])
def test_a_height_that_nobody_stated_is_found(setting: str, value: float) -> None:
    fit = fitball.calibrate(filmed(3, **{setting: (value,)}), point_only=True)
    (note,) = (note for note in fit.notes if "of the camera would explain" in note)
    found = float(note.split(" = ")[1].split()[0])
    assert found == pytest.approx(1e3 * value, abs=1.0)
    assert "depends on the speed" in note


def test_a_camera_that_is_right_is_not_suspected() -> None:
    fit = fitball.calibrate(filmed(3), point_only=True)
    assert not any("of the camera would explain" in note for note in fit.notes)


def test_what_a_tilt_would_move_is_said_where_nothing_is_stated(scene: Path) -> None:
    fit = fitball.calibrate("wang_all", point_only=True)
    assert fit.assumptions is not None and fit.assumptions.tilt is not None
    assert fit.assumptions.tilt.high == pytest.approx(math.radians(0.5))
    (line,) = tilt_line(fit)
    assert line.startswith("A camera tilted by 0.5 deg would move cor_10 by ")
    known = fitball.calibrate(filmed(3), config=scene, point_only=True)
    assert known.assumptions is not None and known.assumptions.tilt is None


def test_curves_beside_measurements_are_what_the_camera_shows(scene: Path) -> None:
    problem = problem_of(filmed(1), scene)
    middle = np.array([[item.prior.quantile(np.array([0.5]))[0] for item in problem.free]])
    for name, value in VALUES.items():
        middle[0, problem.free_names.index(name)] = value
    high = middle.copy()
    high[0, problem.free_names.index("court_height")] = 2e-3
    level, raised = (_curve(problem, values, "", 15.0, 0.0, np.array([0])) for values in (middle, high))
    early, late = (np.asarray(item).ravel() for item in (1.0 / level.impacts.v_y1, 1.0 / level.outputs["v_y2"][2]))
    fall = level.outputs["gap_time"][2] - raised.outputs["gap_time"][2]
    np.testing.assert_allclose(np.ravel(fall), 2e-3 * (early + late), rtol=1e-9)
