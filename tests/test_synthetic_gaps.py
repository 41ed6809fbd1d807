"""The bundled table of filmed impacts: its bytes, its errors against films of frames, and what it determines."""

import numpy as np
import synthetic_gaps as made

from fitball.api.calibrating import pose
from fitball.data.bundled import bundled_folder, bundled_names
from fitball.data.read import load_table
from fitball.inference.identifiability.information import about
from fitball.inference.problem.camera import LEVEL, true
from fitball.inference.problem.problem import Choices
from fitball.inference.sampling.importance import importance_posterior

GAPS = ("gap_time", "gap_path", "gap_turn")
SCATTER = {"v_x_sd": "v_x2", "v_y_sd": "v_y2", "spin_sd": "omega_2", **{f"{name}_sd": name for name in GAPS}}


def test_the_bundled_table_is_what_its_script_writes(tmp_path):
    made.write(tmp_path)
    for name in ("synthetic_gaps.csv", "synthetic_gaps_covariance.csv"):
        assert (tmp_path / name).read_bytes() == (bundled_folder() / name).read_bytes()
    assert "synthetic_gaps.csv" in bundled_names() and "synthetic_gaps_covariance.csv" not in bundled_names()


def test_the_table_has_the_errors_of_its_film():
    table = load_table("synthetic_gaps")
    assert table.covariance is not None and table.covariance.columns == made.COLUMNS
    values = np.stack([*(getattr(table.impacts, name) for name in made.INCIDENT), *_measured(table)])
    own = made.film_covariance(dict(zip(made.COLUMNS, values, strict=True)))
    size = np.sqrt(np.einsum("kii->ki", own))
    # At measured instead of true speeds and spins, of which gap_turn depends most on the spins.
    apart = np.abs(table.covariance.values - own) / (size[:, :, None] * size[:, None, :])
    assert apart.max() < 0.05
    stated = np.median(size, axis=0) * [1, 1, 1, 1, 1, 1, 1e3, 1e3, 180 / np.pi]
    np.testing.assert_allclose(stated, [0.025, 0.025, 0.8, 0.025, 0.025, 0.8, 0.05, 0.7, 2.0], rtol=0.1)


def _measured(table):
    return [table.measurement(name).values for name in made.SCATTER]


def test_covariances_are_those_of_lines_through_frames():
    """Two thousand films of one bounce: frames with errors, lines by least squares, and the flights followed to the
    court by solving for the times when they are there.
    """
    rng = np.random.default_rng(5)
    v_x1, v_y1, omega_1, v_x2, v_y2, omega_2, time, path, turn = 14.0, 9.0, -160.0, 8.0, 6.5, 220.0, 4.7e-3, 0.05, 0.3
    before = -(np.arange(made.FRAMES) + 0.5) / made.RATE
    after = time - before
    found = []
    for _ in range(2000):
        sides = []
        for times, start, rates in (
            (before, (0.0, 0.0, 0.0), (v_x1, -v_y1, omega_1)),
            (after, (path - v_x2 * time, -v_y2 * time, turn - omega_2 * time), (v_x2, v_y2, omega_2)),
        ):
            frames = np.array([a + b * times for a, b in zip(start, rates, strict=True)])
            frames += np.array([[made.POINT], [made.POINT], [made.ANGLE]]) * rng.standard_normal(frames.shape)
            sides.append(np.polyfit(times, frames.T, 1))
        (rate, here), (later_rate, later) = sides
        landing, release = -here[1] / rate[1], -later[1] / later_rate[1]
        place = here + rate * landing, later + later_rate * release
        # The mark looks different from another side.
        angle = place[1][2] - place[0][2] + made.MARK * rng.standard_normal()
        found.append([
            rate[0], -rate[1], rate[2], *later_rate, release - landing, place[1][0] - place[0][0], angle
        ])  # fmt: skip
    exact = np.array([v_x1, v_y1, omega_1, v_x2, v_y2, omega_2, time, path, turn])
    expected = made.film_covariance(dict(zip(made.COLUMNS, exact[:, None], strict=True)))[0]
    factor = np.linalg.inv(np.linalg.cholesky(expected))
    # Whitened, its covariance is that of independent numbers: to 5 sds of a sample of 2000, root 2 on the diagonal.
    white = factor @ np.cov(np.array(found).T) @ factor.T
    assert np.abs(white - np.eye(9)).max() < 5.0 * np.sqrt(2.0 / 2000)
    assert np.abs((np.mean(found, axis=0) - exact) / np.sqrt(np.diag(expected))).max() < 5.0 / np.sqrt(2000)


def test_what_the_camera_shows_leads_back_to_the_truth():
    impacts = made.incidence(made.ROWS, np.random.default_rng(2))
    camera = {"scale": 1.02, "clock": 0.99, "tilt": 0.03}
    back = true({**LEVEL, **camera}, made.pictured(impacts, camera))
    np.testing.assert_allclose(back, [impacts.v_x1, impacts.v_y1, impacts.omega_1], rtol=1e-13)


def intervals(**choices):
    """Ends of 95 % intervals by importance sampling about the truth, by name, and the truth."""
    problem = pose("synthetic_gaps", Choices(), **choices)
    truth = {**made.TRUTH, **made.CAMERA, **{name: made.SCATTER[column] for name, column in SCATTER.items()}}
    truth |= {"ball_mass": 0.0576, "ball_radius": 0.03302, "inertia_ratio": 0.56}
    begun = about(problem, problem.to_coordinates(problem.free_rows([truth]))[0])
    drawn = importance_posterior(problem, [begun], np.random.default_rng(1))
    assert drawn.settled
    weights, ends = np.exp(drawn.log_weights), {}
    for k, name in enumerate(problem.free_names):
        order = np.argsort(drawn.values[:, k])
        ends[name] = np.interp([0.025, 0.975], np.cumsum(weights[order]), drawn.values[order, k])
    return ends, truth


def test_the_gaps_determine_both_stiffnesses_and_rebounds_do_not():
    ends, truth = intervals()
    assert {name for name, (low, high) in ends.items() if not low <= truth[name] <= high} == set()
    for name, width in (("k_y", 0.1), ("k_theta", 0.3)):
        assert np.ptp(ends[name]) < width * truth[name]
    alone, _truth = intervals(ignore=GAPS)
    for name in ("k_y", "k_theta"):
        assert alone[name][1] > 8.0 * alone[name][0]
