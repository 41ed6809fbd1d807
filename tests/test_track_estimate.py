"""From tracks to impacts: coverage against simulated truth, derivatives against differences, and words."""

from dataclasses import replace

import numpy as np
import pytest
from simulated_films import dropped_balls, errors, estimated, film, filmed_bounces

from fitball.data.scene import Camera, Quantity
from fitball.tracks import estimate as fits
from fitball.tracks import pooled, session
from fitball.tracks.estimate import COUNT, DRAG, OMEGA, PHI, V_X, V_Y, WIDTH, Batch, Priors, Sides
from fitball.tracks.find import pieces_of
from fitball.tracks.flight import GRAVITY, fly, lift_of, resistance
from fitball.tracks.frames import AFTER, BEFORE, NINE, Air, Filmed
from fitball.tracks.session import estimate
from fitball.values import Ball

BALL = Ball()


def one_impact(marked: bool = True) -> tuple[Batch, Sides, np.ndarray]:
    """Exact frames of two flights, fitted."""
    k = resistance(BALL, 1.2)
    before, after = np.arange(-40, 0) * 1e-3, np.arange(1, 43) * 1e-3
    rows = []
    for d, time, place, turn, omega, (v_x, v_y) in (
        (before, -2.4e-3, 0.0, 0.0, 120.0, (15.0, -9.0)), (after, 2.4e-3, 0.06, 1.0, 330.0, (11.0, 7.0))
    ):  # fmt: skip
        lift = lift_of(omega, np.hypot(v_x, v_y), BALL.radius) + 0.02
        flown = fly([place, BALL.radius, v_x, v_y], 0.52, lift, k, d)
        rows.append(np.column_stack([time + d, flown[:, :2], turn + omega * d]))
    frames = np.vstack(rows)
    batch = Batch(
        frames[:, 0][None], frames[:, 1][None], frames[:, 2][None], frames[:, 3][None], np.array([1.0]), BALL.radius,
        k, BALL.radius, np.array([[1e-3, 1.2e-3, 0.03]]), np.array([0.02, 0.05]), 4.7e-3,
    )  # fmt: skip
    sides, known = Sides.empty(batch), np.array([marked])
    priors = Priors(np.array([0.507]), np.array([0.05]), np.zeros((1, 2)), np.array([0.05]), known)
    fits.start(batch, sides, 0.507)
    sides.state[0, [OMEGA, WIDTH + OMEGA]] = 120.0, 330.0
    sides.state[0, WIDTH + PHI] = 1.0
    fits.refine(batch, sides, priors, first=True)
    return batch, sides, known


def test_derivatives_of_paths_are_differences_of_integrated_flights():
    batch, sides, known = one_impact()
    fits.evaluate(batch, sides, known)
    for f in (0, 20, 45, 80):
        side = 0 if sides.role[0, f] == BEFORE else 1
        d = batch.t[0, f] - sides.times[0, side]

        def path(state: np.ndarray, side: int = side, d: float = d) -> np.ndarray:
            x, v_x, y, v_y, c, _phi, omega = state[side * WIDTH : (side + 1) * WIDTH]
            lift = lift_of(omega, np.hypot(v_x, v_y), BALL.radius) + c
            return fly([x, y, v_x, v_y], state[DRAG], lift, batch.k, [d])[0, :2]

        for place, step in ((V_X, 1e-3), (V_Y, 1e-3), (4, 1e-3), (OMEGA, 1.0), (WIDTH, 1e-3)):
            unknown = DRAG if place == WIDTH else side * WIDTH + place
            move = np.zeros(COUNT)
            move[unknown] = step
            slope = (path(sides.state[0] + move) - path(sides.state[0] - move)) / (2 * step)
            assert np.allclose(sides.rows[0, f, :, place], slope, rtol=2e-3, atol=2e-7), (f, place)


def test_derivatives_of_the_nine_are_differences():
    """Each unknown is moved, both flights are followed to the height of contact again, and the nine read off."""
    batch, sides, known = one_impact()
    _values, slopes = fits.nine(batch, sides, known)
    state, times = sides.state.copy(), sides.times.copy()
    for unknown in range(COUNT):
        step = 1e-5
        read = []
        for sign in (1.0, -1.0):
            sides.state[:], sides.times[:] = state, times
            sides.state[0, unknown] += sign * step
            fits.to_contact(batch, sides, known)
            read.append(fits.nine(batch, sides, known)[0][0])
        assert np.allclose(slopes[0, :, unknown], (read[0] - read[1]) / (2 * step), rtol=1e-4, atol=1e-6), unknown


def test_a_minority_of_outliers_does_not_move_a_start():
    t = np.arange(12) * 1e-3
    values = 3.0 + 7.0 * t
    values[[0, 4, 7, 11]] += [0.04, -0.03, 0.05, 0.02]
    assert np.isclose(fits._slope(t, values), 7.0, atol=1e-9)


def test_states_end_at_the_height_of_contact():
    batch, sides, _known = one_impact()
    assert np.allclose(sides.state[0, [2, WIDTH + 2]], batch.height, atol=1e-9)
    assert np.allclose(sides.state[0, [V_X, V_Y, WIDTH + V_X, WIDTH + V_Y]], [15, -9, 11, 7], atol=5e-3)
    assert np.allclose(sides.times[0], [-2.4e-3, 2.4e-3], atol=5e-6)


def test_the_information_is_the_curvature_of_the_likelihood():
    """Of the mixture, where no frame's part is negative, by differences of its gradient."""
    batch, sides, known = one_impact()
    rng = np.random.default_rng(1)
    batch.x += 1.5e-3 * rng.standard_normal(batch.x.shape)
    # Frames that are nearly outliers, across the line of their residuals only.
    batch.y[0, 10] += 6.2e-3
    fits.evaluate(batch, sides, known)
    assert 0.1 < sides.weight[0, 10] < 0.9
    z = np.array([sides.r_x[0, 10] / 1e-3, sides.r_y[0, 10] / 1.2e-3])
    g, row = sides.weight[0, 10], sides.rows[0, 10].copy() / np.array([[1e-3], [1.2e-3]])
    row[:, PHI] = 0.0
    exact = g * np.eye(2) - g * min(1 - g, 1 / (z @ z)) * np.outer(z, z)
    whole = sides.info[0, :3].sum(axis=0) + sides.info[0, 3] - sides.info[0, 2]
    without = Batch(**{**vars(batch), "x": np.delete(batch.x, 10, 1), "y": np.delete(batch.y, 10, 1),
                       "t": np.delete(batch.t, 10, 1), "phi": np.delete(batch.phi, 10, 1)})  # fmt: skip
    other = Sides.empty(without)
    other.state[:], other.times[:], other.role[:] = sides.state, sides.times, np.delete(sides.role, 10, 1)
    fits.evaluate(without, other, known)
    rest = other.info[0, :2].sum(axis=0) + other.info[0, 3]
    assert np.allclose((whole - rest)[:PHI, :PHI], (row.T @ exact @ row)[:PHI, :PHI], rtol=1e-6, atol=1e-3)


def test_gravity_of_the_session_is_that_of_its_flights():
    """A scale that is 6 % too large makes gravity 6 % too large, and is noticed."""
    _true, tracks = filmed_bounces(60, film(240))
    plain = estimate(tracks, Filmed()).gravity[""]
    assert abs(plain.value - GRAVITY) < 3.0 * plain.sd < 1.0
    large = [replace(track, x=1.1 * track.x, y=1.1 * track.y) for track in tracks]
    found = estimate(large, Filmed(contact_time=(4e-3, 1e-3, 9e-3)))
    assert np.isclose(found.gravity[""].value, 1.1 * plain.value, atol=4.0 * plain.sd)
    assert found.gravity[""].value > plain.value + 0.5
    assert any("the scale is" in words and "too large or the clock" in words for words in found.notes)
    assert not any("g comes out" in words for words in estimate(tracks, Filmed()).notes)


@pytest.mark.parametrize(
    ("fps", "changes"),
    [(1000, {"outliers": 0.0}), (1000, {"outliers": 0.1, "noise": 2e-3}), (240, {}), (240, {"outliers": 0.1})],
)
def test_intervals_hold_the_truth(fps, changes):
    true, found = estimated(120, film(fps, **changes))
    assert len(found.impacts) >= 118
    z = errors(true, found)
    known = np.isfinite(z[:, 2])
    assert known.mean() >= 0.9
    for k, name in enumerate(NINE):
        inside = np.abs(z[np.isfinite(z[:, k]), k])
        # Four sds of a binomial share of 120, as 36 shares are looked at.
        assert 0.515 < np.mean(inside < 1.0) < 0.85, name
        assert np.mean(inside < 1.96) > 0.865, name
    assert 0.9 < np.sqrt(np.nanmean(z**2)) < 1.12
    positions = [NINE.index(name) for name in ("v_x1", "v_y1", "v_x2", "v_y2", "gap_time", "gap_path")]
    whole = [row[positions] for row in z]
    scaled = []
    for row, made in zip(whole, found.impacts, strict=True):
        part = made.covariance[np.ix_(positions, positions)]
        error = row * np.sqrt(np.diagonal(part))
        scaled.append(error @ np.linalg.solve(part, error))
    # Chi-squared of six: mean 6, its sd over 120 is 0.32.
    assert 4.9 < np.mean(scaled) < 7.3
    noise = found.noise[""]
    assert np.isclose(noise.x, changes.get("noise", 1e-3), rtol=0.05)
    assert np.isclose(noise.outliers, changes.get("outliers", 0.02), atol=0.012)
    assert noise.slow < 1.03
    assert np.isclose(np.degrees(noise.angle), 2.0, atol=0.1)


def test_without_air_intervals_miss_the_truth():
    """The negative control: drag and Magnus force left out."""
    true, found = estimated(80, film(240), Filmed(air=Air(density=1e-6)))
    z = errors(true, found)
    assert np.nanmean(np.abs(z[:, [0, 1, 3, 4]]) < 1.0) < 0.4


def test_a_wrong_height_moves_the_gaps_as_the_formula_says():
    height = 1e-3
    _true, tracks = filmed_bounces(12, film(1000, noise=2e-5, outliers=0.0, angle_noise=1e-4))
    plain, moved = estimate(tracks, Filmed()), estimate(tracks, Filmed(court=height))
    for one, two in zip(plain.impacts, moved.impacts, strict=True):
        v_x1, v_y1, omega_1, v_x2, v_y2, omega_2 = one.values[:6]
        shift = height * np.array([1 / v_y1 + 1 / v_y2, v_x1 / v_y1 + v_x2 / v_y2, omega_1 / v_y1 + omega_2 / v_y2])
        assert np.allclose((two.values - one.values)[6:], shift, rtol=0.01, atol=[1e-7, 1e-6, 1e-4])


def test_noise_is_not_biased_by_the_number_of_frames():
    """Short flights have few frames over their unknowns; dividing by frames gives two thirds of the noise."""
    _true, tracks = filmed_bounces(100, film(240, width=0.55, lost=0.0, outliers=0.0))
    found = estimate(tracks, Filmed())
    used = [np.isin(made.role, (BEFORE, AFTER)).sum() for made in found.impacts]
    assert np.median(used) < 14
    assert np.isclose(found.noise[""].x, 1e-3, rtol=0.06) and np.isclose(found.noise[""].y, 1e-3, rtol=0.06)


def test_noise_of_tracks_differs_where_it_does():
    _true, even = filmed_bounces(40, film(1000, outliers=0.0))
    _true, rough = filmed_bounces(40, film(1000, outliers=0.0, noise=3e-3), bounces=8)
    mixed = [*even, *(replace(track, id=f"r{track.id}") for track in rough)]
    sds = {made.id: made.sd("v_y1") for made in estimate(mixed, Filmed()).impacts}
    calm = np.median([sd for name, sd in sds.items() if not name.startswith("r")])
    loud = np.median([sd for name, sd in sds.items() if name.startswith("r")])
    assert 2.0 < loud / calm < 3.6


def test_drag_of_a_session_is_what_all_its_other_shots_determine():
    """Against the conditional mean of a joint normal distribution."""
    own, error, shot, prior, mean = np.array([0.55, 0.6, 0.58]), np.array([0.03, 0.05, 0.02]), 0.024, 0.05, 0.507
    sides = Sides.empty(Batch(*[np.zeros((3, 1))] * 4, np.ones(3), 0, 0, 0, np.ones((3, 3)), np.zeros(2), 0))
    priors = Priors(np.full(3, mean), np.full(3, 0.06), np.zeros((3, 2)), np.full(3, 0.05), np.ones(3, bool))
    sides.covariance[:, DRAG, DRAG] = 1.0 / (error**-2 + 0.06**-2)
    sides.state[:, DRAG] = sides.covariance[:, DRAG, DRAG] * (own / error**2 + mean / 0.06**2)
    pooled.session_drag(sides, priors, Air(drag=mean, drag_sd=prior, drag_shot_sd=shot))
    for i in range(3):
        rest = [j for j in range(3) if j != i]
        joint = prior**2 + np.diag(error[rest] ** 2 + shot**2)
        gain = prior**2 * np.ones(2) @ np.linalg.inv(joint)
        assert np.isclose(priors.drag[i], mean + gain @ (own[rest] - mean))
        assert np.isclose(priors.drag_sd[i] ** 2, prior**2 - gain @ np.full(2, prior**2) + shot**2)


def test_a_session_with_other_drag_is_found():
    _true, tracks = filmed_bounces(60, film(240, air=Air(drag=0.62)))
    drags = [made.before.drag for made in estimate(tracks, Filmed()).impacts]
    assert np.isclose(np.mean(drags), 0.62, atol=0.02)


@pytest.mark.parametrize("fps", [240, 1000])
def test_near_and_far_frames_agree_where_noise_is_white(fps):
    pieces = [pieces_of(track, Filmed())[0][0] for track in filmed_bounces(80, film(fps))[1]]
    batch, sides, _priors = session._positions(pieces, Filmed(), 0.0)
    total, pairs = pooled.near_and_far(batch, sides)
    # Chi-squared: the mean of 640 has an sd of 0.056.
    assert pairs > 550 and 0.83 < total / pairs < 1.17
    assert pooled.slow_errors(batch, sides)[0] < 1.08


def test_slow_errors_widen_what_positions_determine():
    _true, tracks = filmed_bounces(60, film(240, slow=2.5))
    found = estimate(tracks, Filmed())
    slow = found.noise[""].slow
    assert slow > 1.3
    plain = Filmed()
    batch_sd = np.median([made.sd("v_x1") for made in found.impacts])
    real = pooled.slow_errors
    try:
        pooled.slow_errors = lambda *_: (1.0, 0)
        narrow = np.median([made.sd("v_x1") for made in estimate(tracks, plain).impacts])
    finally:
        pooled.slow_errors = real
    # Priors of drag and lift are not widened.
    assert 1.0 + 0.7 * (slow - 1.0) < batch_sd / narrow <= slow + 0.01


def test_one_track_is_enough():
    true, tracks = filmed_bounces(6, film(1000))
    for track in tracks:
        found = estimate([track], Filmed())
        assert len(found.impacts) == 1 and 0.5e-3 < found.noise[""].x < 1.7e-3
        z = errors(true, found)
        assert np.nanmax(np.abs(z)) < 5.0
    assert estimate([], Filmed()).impacts == ()


def test_flights_to_the_left_are_mirrored():
    film_right, film_left = film(1000), film(1000, leftward=True)
    true, found = estimated(12, film_left)
    assert all(made.mirrored for made in found.impacts)
    assert np.nanmax(np.abs(errors(true, found))) < 4.5
    assert not any(made.mirrored for made in estimated(3, film_right)[1].impacts)


def test_balls_that_drop_straight_down_have_a_direction():
    """Where the sign of `v_x1` is noise the impact is turned round as a whole."""
    _true, tracks = dropped_balls(40, film(240, outliers=0.0))
    found = estimate(tracks, Filmed())
    assert len(found.impacts) == 40
    for made in found.impacts:
        assert made.values[0] >= 0.0
        assert np.isclose(made.before.v_x, made.values[0]) and np.isclose(made.after.v_x, made.values[3])
        assert np.isclose(made.after.x - made.before.x, made.values[7], atol=1e-12)
        # In the picture mirrored as stated, both flights go through the frames.
        used = np.isin(made.role, (BEFORE, AFTER)) & (made.weight > 0.5)
        x = -made.track.x if made.mirrored else made.track.x
        for role, side in ((BEFORE, made.before), (AFTER, made.after)):
            own = used & (made.role == role)
            line = side.x + side.v_x * (made.track.time[own] - side.time)
            assert np.max(np.abs(x[own] - line - made.residual[own, 0])) < 2e-2


def test_rows_of_a_rolling_shutter_correct_the_times():
    true, tracks = filmed_bounces(40, film(240, row_time=4e-3 / 1080))
    with_rows = errors(true, estimate(tracks, Filmed(row_time=4e-3 / 1080)))
    without = errors(true, estimate(tracks, Filmed()))
    assert np.sqrt(np.nanmean(with_rows[:, :6] ** 2)) < 1.3
    assert np.sqrt(np.nanmean(without[:, :6] ** 2)) > 2.0


def test_the_height_of_the_court_is_found_from_the_time_over_contact():
    true, tracks = filmed_bounces(12, film(1000))
    raised = [replace(track, y=track.y + 1.25) for track in tracks]
    found = estimate(raised, Filmed(court=None))
    time = [made.values[6] for made in found.impacts]
    assert np.isclose(np.median(time), 4.7e-3, atol=2e-5)
    assert np.allclose([made.values[1] for made in found.impacts], true[:, 1], atol=0.15)
    height = found.camera.court_height
    assert height.value == 0.0 and 3e-3 < height.sd < 15e-3
    assert any("No height was stated" in words and "12" in words for words in found.notes)


def test_a_track_may_hold_many_bounces():
    true, tracks = filmed_bounces(2, film(1000, outliers=0.0))
    first, second = tracks
    later = second.time - second.time[0] + first.time[-1] + 0.2
    joined = replace(
        first, time=np.r_[first.time, later], x=np.r_[first.x, second.x], y=np.r_[first.y, second.y],
        frame=np.arange(first.time.size + later.size), angle=np.r_[first.angle, second.angle], row=None, radius=None,
    )  # fmt: skip
    found = estimate([joined], Filmed())
    assert [made.id for made in found.impacts] == ["1-1", "1-2"]
    assert np.allclose([made.values[1] for made in found.impacts], true[:, 1], atol=0.2)
    assert all(made.role.size == joined.time.size for made in found.impacts)


def reasons(tracks, filmed=None) -> str:
    found = estimate(tracks, filmed or Filmed())
    assert found.impacts == ()
    return " | ".join(one.reason for one in found.refused)


def test_what_is_no_impact_gets_words():
    _true, tracks = filmed_bounces(4, film(240, outliers=0.0))
    track = tracks[0]
    low = int(np.argmin(track.y))

    def part(one, rows):
        arrays = {name: getattr(one, name)[rows] for name in ("frame", "time", "x", "y", "angle")}
        return replace(one, **arrays, row=None, radius=None)

    back = [
        replace(one, time=one.time[0] + one.time[-1] - one.time[::-1], x=one.x[::-1], y=one.y[::-1]) for one in tracks
    ]
    assert "coefficient of restitution 1." in reasons(back)
    assert "no bounce: the ball only falls from frame" in reasons([part(track, slice(0, low))])
    assert "If y grows downwards" in reasons([replace(one, y=-one.y) for one in tracks])
    assert "three on each side" in reasons([part(track, slice(low - 2, low + 3))])
    assert "the frame rate is 8" in reasons([replace(one, time=8.0 * one.time) for one in tracks])
    assert "2 × too high" in reasons([replace(one, time=0.5 * one.time) for one in tracks])
    assert "pixels" in reasons([replace(track, in_px=True)])
    assert "mm too high" in reasons(tracks, Filmed(court=0.12))
    few = part(track, slice(low - 2, low + 8))
    assert "frames before and" in reasons([few])
    sizes = np.full(track.time.size, 0.033)
    sizes[::2] = 0.16
    assert "more than one object" in reasons([replace(track, radius=sizes)])


@pytest.mark.parametrize("court", [0.0, None])
def test_no_track_breaks_the_others(court):
    """What is no flight at all is refused, and a good track beside it is found."""
    _true, (good, other) = filmed_bounces(2, film(240))
    rng = np.random.default_rng(1)
    frames = other.time.size
    broken = {
        "noise": replace(other, y=rng.standard_normal(frames)),
        "still": replace(other, x=np.zeros(frames), y=np.zeros(frames)),
        "no clock": replace(other, time=np.zeros(frames)),
        "kink": replace(other, y=5.0 * np.abs(other.time - other.time.mean())),
        "empty": replace(other, x=np.full(frames, np.nan)),
        "millimetres": replace(other, x=1e3 * other.x, y=1e3 * other.y),
        "one frame": replace(
            other, **{name: getattr(other, name)[:1] for name in ("frame", "time", "x", "y", "angle")}
        ),
    }
    for name, track in broken.items():
        alone = estimate([replace(track, id=name)], Filmed(court=court))
        assert len(alone.refused) >= 1 and alone.refused[0].reason, name
        assert all(np.isfinite(made.covariance).all() for made in alone.impacts), name
        both = estimate([replace(track, id=name, session="other"), good], Filmed(court=court))
        assert good.id in [made.id for made in both.impacts], name


def test_what_is_doubtful_gets_notes():
    _true, tracks = filmed_bounces(4, film(1000))
    sizes = np.full(tracks[0].time.size, 0.033)
    sizes[3] = 0.16
    made = estimate([replace(tracks[0], radius=sizes), *tracks[1:]], Filmed()).impacts[0]
    assert made.role[3] == 0 and "another object" in made.notes[0] and str(tracks[0].frame[3]) in made.notes[0]
    late = estimate(tracks, Filmed(contact_time=(3e-3, 1e-3, 4.5e-3))).impacts
    assert all("mm too high" in " ".join(made.notes) for made in late)


def test_pieces_have_three_frames_on_either_side():
    _true, tracks = filmed_bounces(3, film(240))
    for track in tracks:
        pieces, refused = pieces_of(track, Filmed())
        assert len(pieces) == 1 and not refused
        assert (pieces[0].t < 0).sum() >= 3 and (pieces[0].t > 0).sum() >= 3


def test_the_camera_states_what_the_session_shares():
    stated = estimate([], Filmed()).camera
    assert (stated.scale.sd, stated.clock.sd, stated.court_height.sd) == (0.01, 1e-3, 3e-3)
    assert np.isclose(stated.tilt.sd, np.radians(0.3))
    assert session.CAMERA_SDS["court_height"] == 3e-3


def test_the_radius_in_the_picture_gives_the_scale():
    _true, tracks = filmed_bounces(8, film(1000, radius_noise=3e-4))
    plain = estimate(tracks, Filmed())
    assert np.isclose(plain.scale[""].value, 1.0, atol=4 * plain.scale[""].sd) and plain.scale[""].sd < 3e-3
    assert not any("radius of the ball" in words for words in plain.notes)
    small = [replace(t, x=0.95 * t.x, y=0.95 * t.y, radius=0.95 * t.radius) for t in tracks]
    found = estimate(small, Filmed())
    assert np.isclose(found.scale[""].value, plain.scale[""].value / 0.95)
    assert any("too small, or its outline is" in words for words in found.notes)
    assert estimate(filmed_bounces(2, film(1000))[1], Filmed()).scale == {}


def test_landings_apart_have_heights_that_differ_by_the_unknown_tilt():
    """Two places a metre apart and a tilt of 5 mrad: 2.5 mm of height on either side of the middle."""
    true, tracks = filmed_bounces(6, film(1000))
    moved = [replace(one, x=one.x + (0.0 if k % 2 else 1.0)) for k, one in enumerate(tracks)]
    level, tilted = (estimate(moved, Filmed(camera=Camera(tilt=Quantity(0.0, sd)))).impacts for sd in (1e-9, 5e-3))
    for one, other in zip(level, tilted, strict=True):
        v_x1, v_y1, omega_1, v_x2, v_y2, omega_2 = one.values[:6]
        slope = 2.5e-3 * np.array(
            [1.0 / v_y1 + 1.0 / v_y2, v_x1 / v_y1 + v_x2 / v_y2, omega_1 / v_y1 + omega_2 / v_y2]
        )
        added = other.covariance - one.covariance
        assert np.allclose(added[6:, 6:], np.outer(slope, slope), rtol=0.05)
        assert np.allclose(added[:6], 0.0, atol=1e-12)
    assert len(level) == len(true)


def test_a_court_that_is_wrong_for_most_impacts_is_named_once():
    _true, found = estimated(6, film(1000), Filmed(court=-0.025))
    (said,) = [note for note in found.notes if "implausible" in note]
    assert "gap_time is implausible in " in said and "too low" in said and "court" in said
    assert not any("implausible" in note for note in estimated(6, film(1000))[1].notes)
