"""Films whose ball was measured as a disc: scale by the disc and by gravity, the court by a ball
that rolls on it, errors that last, and errors that all impacts of a camera share.
"""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from support.discs import Noise, disc_films, rolled
from support.films import RADIUS, RATIO, UNITS, Camera, bounces, filmed, scores

import fitball
from fitball.base.errors import InputError, ParameterError
from fitball.data.scene import BallSection, CameraSection, Scene, ValueWithSd
from fitball.inference.effort import Effort
from fitball.inference.judgement.first_order import first_order
from fitball.inference.problem.build import problem_from_sources
from fitball.inference.search.best_fit import best_fit
from fitball.report.total_errors import shared_sds, total_sds

ROW_TIME = 4.6e-6
ROW_TIME_SD = 0.7e-6
SEEN_ROW_TIME = ValueWithSd(ROW_TIME, ROW_TIME_SD)
PHONE = Camera(240, row_time=ROW_TIME, mm_per_px=1.4)
SPEEDS = [0, 1, 3, 4]
SPINS = [2, 5]
GAP_TIME = 6


def slow_bounces(count, rng):
    """Impacts of balls that people throw before a phone, (count, 9)."""
    truth = bounces(40 * count, rng)
    slow = np.hypot(truth[:, 0], truth[:, 1]) < 15.0
    return truth[slow & (truth[:, 3] > 1.0)][:count]


def scene_of(row_time=SEEN_ROW_TIME, **camera):
    """What is known of the phone and the ball."""
    section = CameraSection(fps=240.0, row_time=row_time, **camera)
    return Scene(ball=BallSection(radius=RADIUS, inertia_ratio=RATIO), camera=section)


def codes_of(film):
    return [note.code for note in film.notes]


@pytest.fixture(scope="module")
def session():
    """Impacts, the positions of their films, those of a ball that rolls, and what `track` says."""
    rng = np.random.default_rng(5)
    truth = slow_bounces(24, rng)
    camera = Camera(
        240,
        row_time=ROW_TIME + ROW_TIME_SD * rng.standard_normal(),
        mm_per_px=1.4,
        court_height=0.04,
        tilt=0.01,
    )
    table = disc_films(truth, camera, Noise(), rng)
    roll = rolled(camera, Noise(), rng)
    film = fitball.track(table, scene=scene_of(), roll=roll, progress=False)
    return truth, table, roll, film


def columns_of(film):
    """Values and sds (impacts,) of a film by column."""
    frame = film.impacts
    values = {name: frame[f"{name} [{unit}]"].to_numpy() for name, unit in UNITS.items()}
    sds = {name: frame[f"{name}_sd [{unit}]"].to_numpy() for name, unit in UNITS.items()}
    return values, sds


def total_scores(film, truth):
    """Errors (impacts, 9) over total sds."""
    _, errors = scores(film, truth)
    totals = total_sds(*columns_of(film), film.scene.camera)
    return errors / np.column_stack([*totals.values()])


def test_errors_of_states_are_as_their_total_sds_say(session):
    truth, _, _, film = session
    z = total_scores(film, truth)
    for columns in (SPEEDS, SPINS, [GAP_TIME]):
        rms = np.sqrt(np.nanmean(z[:, columns] ** 2))
        assert 0.5 < rms < 1.5
    assert np.nanmax(np.abs(z)) < 4.5


def test_sds_of_frames_alone_would_be_too_small_since_errors_of_discs_last():
    """Spins of films whose marks err by themselves in each frame, and whose errors last."""
    ratios = {}
    for lasting in (0.0, 0.015):
        rng = np.random.default_rng(6)
        truth = slow_bounces(12, rng)
        noise = Noise(lasting=0.0, angle_lasting=lasting, angle_frame=0.005)
        film = fitball.track(disc_films(truth, PHONE, noise, rng), scene=scene_of(), progress=False)
        spins = film.spins.set_index("id")["omega_1_sd [rad/s]"]
        ratios[lasting] = float(np.median(spins)) / film.session["noise_angle [rad]"].item()
    # Over so many frames errors that last count two to four times.
    assert 1.8 < ratios[0.015] / ratios[0.0] < 4.5


def test_the_scale_is_that_of_the_disc_and_of_gravity_together(session):
    _, _, _, film = session
    scales = film.scales
    for other in ("by_ball", "by_gravity"):
        assert (scales["scale_sd"] <= 1.01 * scales[f"{other}_sd"]).all()
    middle = (scales["by_ball [mm/px]"] - scales["scale [mm/px]"]) * (
        scales["by_gravity [mm/px]"] - scales["scale [mm/px]"]
    )
    assert (middle <= 0.0).all()
    # What all films share is not in the rows.
    assert 0.0 < film.scene.camera.scale.sd < 0.01
    assert "scale" in codes_of(film)


def test_a_disc_that_is_far_off_is_corrected_by_gravity():
    rng = np.random.default_rng(8)
    truth = slow_bounces(8, rng)
    table = disc_films(truth, PHONE, Noise(radius=0.0, distance=0.0), rng)
    errors = {}
    for radius in (1.0, 0.95):
        smaller = table.assign(**{"radius [px]": radius * table["radius [px]"]})
        scales = fitball.track(smaller, scene=scene_of(), as_read=True, progress=False).scales
        errors[radius] = scales["scale [mm/px]"].to_numpy() / 1.4 - 1.0
        # The mean by inverse variances.
        weights = [scales[f"by_{way}_sd"] ** -2.0 for way in ("ball", "gravity")]
        sums = [scales[f"by_{way} [mm/px]"] for way in ("ball", "gravity")]
        mean = (weights[0] * sums[0] + weights[1] * sums[1]) / (weights[0] + weights[1])
        assert_allclose(scales["scale [mm/px]"], mean, rtol=1e-9)
        assert_allclose(scales["by_gravity [mm/px]"], 1.4, rtol=0.1)
    # The longer flights are seen, the more gravity corrects: by its share of the weights.
    moved = errors[0.95] - errors[1.0]
    share = (weights[0] / (weights[0] + weights[1])).to_numpy()
    assert_allclose(moved, (1.0 / 0.95 - 1.0) * share, atol=0.004)
    assert (moved < 0.0526).all()
    # With a disc known to 1 % that of the longest flights is more than a third.
    assert share.min() < 2.0 / 3.0


def test_a_stated_scale_is_only_checked(session):
    _, table, roll, _ = session
    film = fitball.track(
        table, scene=scene_of(mm_per_px=1.4), roll=roll, as_read=True, progress=False
    )
    assert not len(film.scales)
    assert film.scene.camera.scale.sd == 0.01
    # Discs of these films are off by 1.5 %, some by more than 2.
    assert "scales-differ" in codes_of(film)


def test_a_ball_that_rolls_shows_the_court(session):
    truth, table, roll, film = session
    assert "court-seen" in codes_of(film)
    assert "court-found" not in codes_of(film)
    camera = film.scene.camera
    assert 1e-4 < camera.court_height.sd < 6e-4
    assert camera.tilt.sd < 1e-3
    bare = fitball.track(table, scene=scene_of(), progress=False)
    assert "court-found" in codes_of(bare)
    assert bare.scene.camera.court_height.sd > 2e-3
    # Two points of the court, 0.3 m to both sides of the landing place: y grows upwards here.
    points = []
    for x in (-0.3, 0.3):
        points += [x / 1.4e-3, (0.04 + x * np.tan(0.01)) / 1.4e-3]
    points = ",".join(f"{number:.2f}" for number in points)
    seen = fitball.track(table, scene=scene_of(), court=points, progress=False)
    assert_allclose(seen.impacts["v_y1 [m/s]"], film.impacts["v_y1 [m/s]"], rtol=2e-3)
    for one in (film, seen):
        _, errors = scores(one, truth)
        assert np.sqrt(np.nanmean(errors[:, GAP_TIME] ** 2)) < 3e-4
    # The other way up it is the same.
    down = table.assign(**{"y [px]": 700.0 - table["y [px]"], "angle [rad]": table["angle [rad]"]})
    roll_down = roll.assign(**{"y [px]": 700.0 - roll["y [px]"]})
    turned = scene_of(y="down")
    again = fitball.track(down, scene=turned, roll=roll_down, progress=False)
    assert_allclose(again.impacts["gap_time [s]"], film.impacts["gap_time [s]"], atol=1e-8)


@pytest.mark.parametrize("text", ["", "1,2,3", "1,2,1,9", "a,b,c,d", "1,2,3,4,5"])
def test_a_court_that_is_no_two_points_is_refused(text):
    rng = np.random.default_rng(5)
    table = filmed(bounces(1, rng), PHONE, rng)
    if not text:
        text = " "
    with pytest.raises(ParameterError) as refused:
        fitball.track(table, scene=scene_of(mm_per_px=1.4), court=text, progress=False)
    assert refused.value.code == "court"


def test_a_ball_that_does_not_roll_shows_no_court(session):
    _, table, roll, _ = session
    bouncing = table[table["id"] == "1"].drop(columns=["radius [px]", "radius_sd [px]"])
    lying = roll.assign(**{"x [px]": 3.0})
    for other in (bouncing, lying, roll[:5]):
        with pytest.raises(InputError) as refused:
            fitball.track(table, scene=scene_of(mm_per_px=1.4), roll=other, progress=False)
        assert refused.value.code == "roll"


def fit_of(film):
    """The centre and the sds of a fit to a film, in SI, by name."""
    problem, _ = problem_from_sources(
        [film.table], scene=film.scene, as_read=True, model="grip-slip"
    )
    return fit_of_problem(problem)


def fit_of_problem(problem):
    """The centre and the sds of a fit, in SI, by name."""
    first = first_order(problem, best_fit(problem, Effort().stream("search")))
    q = first.proposal.centre[None]
    values = problem.values(q)
    steps = np.linalg.norm(first.root, axis=1) * first.sds
    sds = {}
    for name, step in zip(first.names, steps, strict=True):
        move = np.zeros_like(q)
        move[0, problem.free.index(name)] = step
        sds[name] = abs(problem.values(q + move)[name] - values[name]).item()
    return {name: values[name].item() for name in problem.free}, sds


# A ball that grips.
GRIPPING = {"mu": 0.56, "e_x": 0.1, "offset": 2.4e-3, "cor_10": 0.775, "cor_slope": -0.0151}


def sharp_film(row_time, count=24):
    """Impacts of a ball that grips by a phone whose rows take ROW_TIME, at a stated row time;
    errors of frames are small.
    """
    rng = np.random.default_rng(12)
    truth = slow_bounces(count, rng)
    ball = fitball.model("grip-slip", ball=scene_of().ball_value())
    rebound = ball.rebound(GRIPPING, fitball.impacts(*truth[:, :3].T))
    truth[:, 3:6] = np.transpose([rebound.v_x2, rebound.v_y2, rebound.omega_2])
    camera = Camera(240, noise=1e-4, outliers=0.0, row_time=ROW_TIME, mm_per_px=1.4, lift_sd=0.02)
    table = filmed(truth, camera, rng)
    return fitball.track(
        table, scene=scene_of(row_time, mm_per_px=1.4, court=0.0), as_read=True, progress=False
    )


def test_a_row_time_that_is_off_moves_restitution_out_of_its_interval_unless_its_sd_is_known():
    off = ROW_TIME - 1.2e-6
    exact, exact_sds = fit_of(sharp_film(off))
    assert abs(exact["cor_10"] - 0.775) > 2.5 * exact_sds["cor_10"]
    known, known_sds = fit_of(sharp_film(ValueWithSd(off, 0.7e-6)))
    assert "row_delay" in known
    assert abs(known["cor_10"] - 0.775) < 2.0 * known_sds["cor_10"]
    # Its value is that of the row time: 1.2 us a row of 1.4 mm.
    assert abs(known["row_delay"] - 1.2e-6 / 1.4e-3) < 2.0 * known_sds["row_delay"]


def drops_by_a_phone(count, delay, rng):
    """Drops whose rows are read later than taken, by a delay [s/m], and the scene."""
    v_y1 = rng.uniform(7.0, 13.0, count)
    v_y2 = v_y1 * (0.775 - 0.015 * (v_y1 - 10.0))
    # Heights read later the lower they are: a fall takes longer, a rise less time.
    seen_1 = v_y1 / (1.0 - delay * v_y1)
    seen_2 = v_y2 / (1.0 + delay * v_y2)
    table = pd.DataFrame(
        {
            "v_y1 [m/s]": seen_1 + 2e-3 * rng.standard_normal(count),
            "v_y1_sd [m/s]": 2e-3,
            "v_y2 [m/s]": seen_2 + 2e-3 * rng.standard_normal(count),
            "v_y2_sd [m/s]": 2e-3,
        }
    )
    return table, Scene(camera=CameraSection(row_delay=ValueWithSd(0.0, 5e-4)))


def cor_of(table, scene):
    """The fitted cor_10 with its sd."""
    problem, _ = problem_from_sources([table], scene=scene, as_read=True)
    values, sds = fit_of_problem(problem)
    return values["cor_10"], sds["cor_10"]


def test_what_all_rows_share_does_not_average_out():
    """Drops of a phone whose row time is off: more of them do not show it."""
    errors = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        delay = 5e-4 * rng.standard_normal()
        cor, sd = cor_of(*drops_by_a_phone(64, delay, rng))
        errors.append((cor - 0.775) / sd)
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) < 1.7
    rng = np.random.default_rng(1)
    few, scene = drops_by_a_phone(8, 0.0, rng)
    many, _ = drops_by_a_phone(64, 0.0, rng)
    assert cor_of(many, scene)[1] > 0.7 * cor_of(few, scene)[1]
    # Of a known shutter they average out.
    assert cor_of(many, Scene())[1] < 0.5 * cor_of(few, Scene())[1]


def test_total_errors_are_those_of_rows_and_of_the_camera():
    values = {
        "v_x1": np.array([9.0]),
        "v_y1": np.array([6.0]),
        "omega_1": np.array([50.0]),
        "v_x2": np.array([6.0]),
        "v_y2": np.array([5.0]),
        "omega_2": np.array([180.0]),
        "gap_time": np.array([4.8e-3]),
        "gap_path": np.array([0.03]),
        "gap_turn": np.array([0.5]),
    }
    camera = CameraSection(
        scale=ValueWithSd(1.0, 0.01),
        court_height=ValueWithSd(0.0, 1e-3),
        row_delay=ValueWithSd(0.0, 5e-4),
        clock=1.0,
    )
    shared = shared_sds(values, camera)
    assert set(shared) == {"scale", "court_height", "row_delay"}
    assert_allclose(shared["scale"]["v_x1"], 0.09, rtol=1e-3)
    assert_allclose(shared["scale"]["omega_2"], 0.0, atol=1e-12)
    # 1 mm of 6 and 5 m/s, in time and in speed.
    assert_allclose(shared["court_height"]["gap_time"], 1e-3 / 6.0 + 1e-3 / 5.0, rtol=1e-2)
    assert_allclose(shared["court_height"]["v_y2"], 9.80665e-3 / 5.0, rtol=1e-2)
    # The row velocity is that of the fall before, of the rise after the contact.
    assert_allclose(shared["row_delay"]["v_x1"], 5e-4 * 9.0 * 6.0, rtol=1e-2)
    assert_allclose(shared["row_delay"]["v_y2"], 5e-4 * 5.0**2, rtol=1e-2)
    assert_allclose(shared["row_delay"]["omega_2"], 5e-4 * 180.0 * 5.0, rtol=1e-2)
    own = {name: np.array([0.01]) for name in values}
    total = total_sds(values, own, camera)
    expected = np.sqrt(0.01**2 + 0.09**2 + (5e-4 * 54.0) ** 2)
    assert_allclose(total["v_x1"], expected, rtol=1e-3)
