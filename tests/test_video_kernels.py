"""The fit of a blurred disc, and spins of textures, against pictures made without them."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from fitball.video import shake
from fitball.video.bounces import balls_of
from fitball.video.disc import BLUR, EXPOSURE, PLACE_AND_RADIUS, Disc
from fitball.video.flights import flights_of
from fitball.video.level import tilt_of
from fitball.video.shake import Steadying
from fitball.video.shared import common_of
from fitball.video.types import Crop
from fitball.video.views import View

GRAVITY = 9.81
DIAMETER = 0.066


def picture(x: float, y: float, radius: float, length: float) -> np.ndarray:
    """Share (60, 60) of pixels that a disc covers, smeared along x over a length: counted on a grid
    nine times as fine.
    """
    fine = (np.arange(60 * 9) + 0.5) / 9 - 0.5
    covered = np.zeros((60 * 9, 60 * 9))
    for share in (np.arange(9) + 0.5) / 9 - 0.5:
        covered += np.hypot(fine - x - share * length, fine[:, None] - y) < radius
    return covered.reshape(60, 9, 60, 9).mean((1, 3)) / 9


@pytest.mark.parametrize("length", [0.0, 4.0])
@pytest.mark.parametrize("turned", [False, True])
def test_the_centre_of_a_disc_is_found_to_a_fiftieth_of_a_pixel(
    length: float, turned: bool
) -> None:
    covered = picture(29.3, 30.6, 14.2, length)
    image = np.stack([0.1 + 0.6 * covered, 0.2 + 0.3 * covered, 0.5 - 0.4 * covered])
    back = np.broadcast_to(np.array([0.1, 0.2, 0.5])[:, None, None], image.shape).copy()
    crop = Crop(0, 0, 0, np.zeros((60, 60), np.uint8))
    velocity, exposure = np.array([4000.0, 0.0]), length / 4000.0
    view = View(0, 0.0, 0.0, 0.0, image, back, velocity, np.zeros(2), 0.0, crop, image)
    disc = Disc(view, np.array([30.0, 30.0]), 15.0, turned, 0.004)
    start = np.array([30.0, 30.0, 15.0, 0.0, 0.0, exposure, 0.5])
    found = disc.fit(start, PLACE_AND_RADIUS, 20)
    assert found.p[:2] == pytest.approx([29.3, 30.6], abs=0.02)
    # Its edge is sharper than the least blur of a fit: the radius is known less well.
    assert found.p[2] == pytest.approx(14.2, abs=0.15)
    assert found.quality > 0.95


def spots_of_ball(gravity: float) -> tuple[list[np.ndarray], np.ndarray]:
    """Spots of a ball of 20 px radius that falls and bounces, at 240/s."""
    times = np.arange(60) / 240.0
    metre = 40.0 / DIAMETER
    t = times - 0.12
    down = -3.0 * t - 0.5 * gravity * t**2
    up = 2.4 * t - 0.5 * gravity * t**2
    height = np.where(t < 0.0, down, up)
    rows = [
        np.array([[600.0 + 2.0 * s * metre, 500.0 - h * metre, 20.0, 9.0]])
        for s, h in zip(t, height, strict=True)
    ]
    return rows, times


@pytest.mark.parametrize(("gravity", "balls"), [(GRAVITY, 1), (0.15, 0), (80.0, 0)])
def test_only_what_falls_as_on_earth_is_a_ball(gravity: float, balls: int) -> None:
    found, times = spots_of_ball(gravity)
    chains = balls_of(flights_of(found, times, DIAMETER), DIAMETER)
    assert len(chains) == balls
    if balls:
        before, after = chains[0]
        assert before.times[-1] < 0.13 and after.times[0] > 0.11
        assert len(before.frames) > 20 and len(after.frames) > 20


def test_pieces_of_one_flight_are_joined_and_a_bounce_is_not() -> None:
    found, times = spots_of_ball(GRAVITY)
    for k in range(10, 16):
        found[k] = np.zeros((0, 4))
    flights = flights_of(found, times, DIAMETER)
    assert sorted(len(flight.frames) for flight in flights)[-2:] == pytest.approx([24, 30], abs=3)


@pytest.mark.parametrize("slope", [0.0, 0.02, -0.035])
def test_level_edges_show_the_tilt(slope: float) -> None:
    y, x = np.mgrid[:360, :960].astype(float)
    height = y + np.tan(slope) * (x - 480.0)
    noise = np.random.default_rng(5).normal(0.0, 3.0, y.shape)
    edges = 60.0 + 60.0 / (1.0 + np.exp(-np.clip(height - 160.0, -20.0, 20.0) / 0.7)) + noise
    tilt = tilt_of(np.clip(edges, 0, 255).astype(np.uint8))
    assert tilt.value == pytest.approx(slope, abs=0.002)
    assert tilt.sd < 0.002


def test_a_picture_without_edges_says_nothing_of_the_tilt() -> None:
    noise = np.random.default_rng(6).normal(100.0, 5.0, (240, 320))
    tilt = tilt_of(noise.astype(np.uint8))
    assert tilt.sd > 0.005


def test_the_shift_of_a_camera_is_found_beside_a_thing_that_moves() -> None:
    y, x = np.mgrid[:300, :400].astype(float)

    def scene(dx: float, dy: float, walker: float) -> np.ndarray:
        u, v = x + dx, y + dy
        waves = np.sin(u / 9.0) + np.sin(v / 11.0) + np.sin((u + v) / 13.0)
        picture = 120.0 + 30.0 * waves
        picture[:, int(walker) : int(walker) + 60] = 40.0
        return picture.astype(np.uint8)

    steady = Steadying(scene(0.0, 0.0, 100.0))
    assert steady.known
    moved = 2.0 * steady.shift(scene(1.7, -0.9, 130.0))
    assert moved == pytest.approx([-1.7, 0.9], abs=0.1)


def walls(squares: int) -> np.ndarray:
    """A picture of 8 x 4 squares that vote, so many with structure, the others grey."""
    side = 2 * shake._SIDE
    y, x = np.mgrid[: 4 * side, : 8 * side].astype(float)
    number = 8 * (y // side) + x // side
    waves = 120.0 + 30.0 * (np.sin(x / 4.0) + np.sin(y / 5.0))
    # The picture is softened: no structure may reach the next square.
    inner = (np.abs(y % side - side / 2) < 16) & (np.abs(x % side - side / 2) < 16)
    return np.where((number < squares) & inner, waves, 120.0).astype(np.uint8)


@pytest.mark.parametrize(("squares", "known"), [(11, False), (12, True)])
def test_a_shake_needs_twelve_squares_with_structure(squares: int, known: bool) -> None:
    steady = Steadying(walls(squares))
    assert steady.known == known
    # Below that number the camera is taken to stand still, and `find_balls` says so.
    moved = steady.shift(np.roll(walls(squares), 2, axis=1))
    assert moved.any() == known


def test_a_hand_that_leaves_the_picture_is_no_camera_that_moves() -> None:
    """A plain wall shows nothing but the hand by which a shift could be found."""
    rng = np.random.default_rng(4)
    wall = 120.0 + rng.normal(0.0, 1.0, (480, 640))
    grain = gaussian_filter(rng.normal(0.0, 1.0, (480, 640)), 4.0)
    first, moved = wall.copy(), wall.copy()
    hand = (slice(60, 320), slice(200, 640))
    first[hand] += 400.0 * grain[hand]
    moved[60:320, 202:640] += 400.0 * grain[60:320, 200:638]
    steady = Steadying(first.astype(np.uint8))
    assert steady.known
    true = steady.shift(moved.astype(np.uint8))
    assert 2.0 * true == pytest.approx([2.0, 0.0], abs=0.1)
    assert steady.confirms(moved.astype(np.uint8), true)
    found = steady.shift(wall.astype(np.uint8))
    assert np.abs(found).max() > 0.1
    assert not steady.confirms(wall.astype(np.uint8), found)


def ball_picture(x: float, y: float, radius: float, blur: float) -> np.ndarray:
    """Light (60, 60) of a matt ball before a grey wall, lit from the upper left, on a grid five
    times as fine, blurred.
    """
    fine = (np.arange(60 * 5) + 0.5) / 5 - 0.5
    u = (fine - x)[None, :] / radius
    v = (fine - y)[:, None] / radius
    inside = u * u + v * v < 1.0
    height = np.sqrt(np.maximum(1.0 - u * u - v * v, 0.0))
    direct = np.maximum(-0.35 * u - 0.62 * v + 0.7 * height, 0.0)
    light = np.where(inside, 0.6 * (0.38 + 0.75 * direct), 0.12)
    return gaussian_filter(light, 5 * blur).reshape(60, 5, 60, 5).mean((1, 3))


def shaded_discs(turned: bool) -> tuple[list[Disc], np.ndarray, float]:
    """Discs of a ball of 18.3 px in eight frames, starts (frames, 7) that are 0.4 px too small, in
    the coordinates of the discs, and the true radius.
    """
    rng = np.random.default_rng(7)
    discs, starts = [], []
    for _ in range(8):
        x, y = rng.uniform(28.0, 31.0, 2)
        light = ball_picture(x, y, 18.3, 0.8)
        image = np.stack([light, np.full_like(light, 0.5), np.full_like(light, 0.5)])
        back = np.stack([np.full_like(light, level) for level in (0.12, 0.5, 0.5)])
        crop = Crop(0, 0, 0, np.zeros((60, 60), np.uint8))
        at_rest = np.array([1.0, 0.0])
        view = View(0, 0.0, 0.0, 0.0, image, back, at_rest, np.zeros(2), 0.0, crop, image)
        disc = Disc(view, np.array([x, y]), 18.0, turned, 0.004)
        first = disc.fit(np.array([x, y, 17.9, 0.0, 0.0, 0.001, 0.9]), PLACE_AND_RADIUS).p
        first[2] = 17.9
        starts.append([first[1], first[0], *first[2:]] if turned else first)
        discs.append(disc)
    return discs, np.array(starts), 18.3


@pytest.mark.parametrize("turned", [False, True])
def test_the_radius_of_a_shaded_ball_is_that_of_all_frames_together(turned: bool) -> None:
    """What is left of 0.4 px is the border of light and shade, which nine shades do not have."""
    discs, starts, radius = shaded_discs(turned)
    light = np.mean([disc.shades for disc in discs], axis=0)
    common = common_of(discs, starts, light, np.ones(len(discs)))
    assert 17.9 + common.radius == pytest.approx(radius, abs=0.13)
    # A pixel blurs too, by the sd of its width.
    assert common.blur == pytest.approx(np.hypot(0.8, 12.0**-0.5), abs=0.06)
    # Light comes from the upper left: less of it to the right and down, or down and to the right.
    across, down = common.light[2:0:-1] if turned else common.light[1:3]
    assert down < across < 0.0


@pytest.mark.parametrize("length", [1.5, 3.0])
def test_a_smear_shorter_than_the_blur_shows_the_exposure(length: float) -> None:
    covered = gaussian_filter(picture(29.3, 30.6, 14.2, length), 0.8)
    image = np.stack([0.1 + 0.6 * covered, np.full_like(covered, 0.5), np.full_like(covered, 0.5)])
    back = np.broadcast_to(np.array([0.1, 0.5, 0.5])[:, None, None], image.shape).copy()
    crop = Crop(0, 0, 0, np.zeros((60, 60), np.uint8))
    velocity = np.array([4000.0, 0.0])
    view = View(0, 0.0, 0.0, 0.0, image, back, velocity, np.zeros(2), 0.0, crop, image)
    disc = Disc(view, np.array([29.3, 30.6]), 14.2, False, 0.004)
    start = np.array([29.3, 30.6, 14.2, 0.0, 0.0, 0.0012, 0.9])
    found = disc.fit(start, (*PLACE_AND_RADIUS, EXPOSURE, BLUR), 30)
    assert 4000.0 * found.p[EXPOSURE] == pytest.approx(length, abs=0.3)
    assert found.p[2] == pytest.approx(14.2, abs=0.05)


def test_pictures_of_one_level_show_no_tilt() -> None:
    tilt = tilt_of(np.full((240, 320), 90, np.uint8))
    assert np.isfinite(tilt.value)
    assert tilt.sd > 0.005
