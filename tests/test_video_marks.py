"""What a film shows of a ball: angles of its marks, spots that move, parts of frames about it, and
the time of a row where the picture hardly shows it.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from fitball.data.bundled import path_of_source
from fitball.tracks.roads import _with_bundled
from fitball.video.films import open_film
from fitball.video.find import _chosen, _row_time
from fitball.video.flights import Flight
from fitball.video.marks import marks_of
from fitball.video.spots import Spots, spots_of
from fitball.video.types import Clip, Estimate, Frame, Look
from fitball.video.views import GAMMA, Course, course_of, views_of

RATE = 240.0
RADIUS = 20.0
SIZE = 61
MIDDLE = 30.0


def ball_of(turn, fold):
    """Light of a ball, brighter at the upper left, with `fold` dark dots, turned by an angle
    counterclockwise in the picture.
    """
    y, x = np.mgrid[:SIZE, :SIZE] - MIDDLE
    level = 0.6 - 0.1 * (x + y) / RADIUS
    for k in range(fold):
        at = turn + 2.0 * np.pi * k / fold
        d = np.hypot(x - 0.55 * RADIUS * np.cos(at), y + 0.55 * RADIUS * np.sin(at))
        level -= 0.35 / (1.0 + np.exp(np.clip(2.0 * (d - 4.0), -30.0, 30.0)))
    return level**GAMMA


def marks_seen(spins, fold, frames=24):
    """The marks of a ball with these spins in two flights, and the true turns."""
    times = np.arange(2 * frames) / RATE
    turns = np.concatenate([spins[0] * times[:frames], spins[1] * times[frames:]])
    rng = np.random.default_rng(4)
    noise = 0.01 * rng.standard_normal((2 * frames, 1, SIZE, SIZE))
    views = []
    for turn, grain in zip(turns, noise, strict=True):
        image = np.clip(ball_of(turn, fold) + grain, 0.01, 1.0)
        views.append(SimpleNamespace(left=0.0, top=0.0, image=image))
    places = np.tile([MIDDLE, MIDDLE, RADIUS], (2 * frames, 1))
    flights = [np.arange(frames), np.arange(frames, 2 * frames)]
    return marks_of(views, places, times, flights, RATE), turns


def away(a, b, period):
    """The distance of angles modulo a period."""
    return np.abs((a - b + period / 2.0) % period - period / 2.0)


@pytest.mark.parametrize(("fold", "spins"), [(1, (60.0, -150.0)), (2, (-45.0, 110.0))])
def test_angles_are_those_of_the_mark_modulo_its_fold(fold, spins):
    """Spins modulo their aliases, and angles to a degree but for where they are counted from."""
    marks, turns = marks_seen(spins, fold)
    assert marks.fold == fold
    for found, spin in zip(marks.spins, spins, strict=True):
        assert away(found[0].value, spin, 2.0 * np.pi * RATE / fold) < 1.0
    start = marks.angle[0] - turns[0]
    assert away(marks.angle, turns + start, 2.0 * np.pi / fold).max() < 0.02


def test_a_ball_without_a_mark_shows_no_angle():
    """Its light stands still."""
    marks, _ = marks_seen((60.0, 60.0), 0)
    assert np.isnan(marks.angle).all()


PICTURE = (240, 360)


def clip_of(centres, radius=9.0):
    """A clip of a bright disc at centres (frames, 2) [px] before a wall with structure."""
    y, x = np.mgrid[: PICTURE[0], : PICTURE[1]].astype(float)
    wall = 80.0 + 20.0 * np.sin(x / 7.0) + 20.0 * np.sin(y / 5.0)
    times = np.arange(len(centres)) / RATE

    def frames():
        for k, (column, row) in enumerate(centres):
            cover = np.clip(0.5 + radius - np.hypot(x - column, y - row), 0.0, 1.0)
            luma = (wall + (220.0 - wall) * cover).astype(np.uint8)
            chroma = np.full((PICTURE[0] // 2, PICTURE[1] // 2, 2), 128, np.uint8)
            yield Frame(k, float(times[k]), luma, chroma)

    return Clip(
        "made",
        PICTURE[1],
        PICTURE[0],
        len(centres),
        times,
        RATE,
        RATE,
        "stamps",
        1.0,
        (0, 1),
        0.0,
        255.0,
        0,
        (),
        frames,
    )


def quiet(_stage, _share):
    """No progress."""


def test_a_disc_that_moves_is_a_spot_in_each_frame_and_a_region_leaves_it_out():
    at = np.stack([40.0 + 6.0 * np.arange(40), 60.0 + 2.0 * np.arange(40)], 1)
    spots = spots_of(clip_of(at), Look(), quiet)
    assert np.abs(spots.shifts).max() < 0.2
    for centre, found in zip(at[5:-5], spots.found[5:-5], strict=True):
        nearest = found[np.argmin(np.hypot(*(found[:, :2] - centre).T))]
        assert nearest[:2] == pytest.approx(centre, abs=1.5)
        # Its outlines alone, or all of it.
        assert 3.0 < nearest[2] < 12.0
    left_half = spots_of(clip_of(at), Look(region=(0, 0, 120, 240)), quiet)
    assert all((found[:, 0] < 120.0).all() for found in left_half.found)
    assert any(len(found) for found in left_half.found)


def flight_of(frames, x, fall=0.0):
    """A flight along x [px/frame] from 40 that falls by `fall` [px/s^2]."""
    frames = np.asarray(frames)
    times = frames / RATE
    down = 0.5 * fall * (times - times[0]) ** 2
    columns = 40.0 + x * frames
    ones = np.ones(len(frames))
    return Flight(frames, times, np.stack([columns, 100.0 + down, 9.0 * ones, 9.0 * ones], 1))


def test_a_course_falls_as_on_earth_beyond_what_was_seen():
    """A radius of 9 px is 33 mm: gravity is 9.80665 m/s^2 times 9 px over 33 mm."""
    gravity = 9.80665 * 9.0 / 0.033
    seen = np.arange(20, 40)
    course = course_of([flight_of(seen, 2.0, gravity)], np.arange(60) / RATE, 0.066)
    assert course.frames.tolist() == list(range(60))
    assert course.seen == frozenset(seen.tolist())
    since = (course.frames - 20) / RATE
    assert course.places[:, 0] == pytest.approx(40.0 + 2.0 * course.frames, abs=1e-6)
    assert course.places[:, 1] == pytest.approx(100.0 + 0.5 * gravity * since**2, abs=1e-3)
    assert course.velocities[:, 1] == pytest.approx(gravity * since, abs=0.1)


def test_views_are_the_part_about_the_ball_and_the_wall_behind_it():
    at = np.stack([30.0 + 7.0 * np.arange(40), np.full(40, 120.0)], 1)
    clip = clip_of(at)
    none = np.zeros((0, 4))
    spots = Spots(
        np.arange(40),
        clip.times,
        [none] * 40,
        np.zeros((40, 2)),
        True,
        np.zeros(PICTURE, np.uint8),
    )
    every = np.arange(40)
    course = Course(every, at, np.tile([7.0 * RATE, 0.0], (40, 1)), frozenset(every.tolist()))
    views = views_of(clip, spots, course, 9.0, quiet)
    assert {*views} == {*every.tolist()}
    y, x = np.mgrid[: PICTURE[0], : PICTURE[1]].astype(float)
    wall = np.floor(80.0 + 20.0 * np.sin(x / 7.0) + 20.0 * np.sin(y / 5.0)) / 255.0
    for k in (3, 20, 36):
        view = views[k]
        rows, columns = view.back.shape[1:]
        left, top = int(view.left), int(view.top)
        here = wall[top : top + rows, left : left + columns]
        assert view.back[0] == pytest.approx(here**GAMMA, abs=0.004)
        bright = view.image[0] > 0.55
        v, u = np.nonzero(bright)
        assert [u.mean() + left, v.mean() + top] == pytest.approx(at[k], abs=0.3)
        assert bright.sum() == pytest.approx(np.pi * 81.0, rel=0.08)
        assert view.velocity == pytest.approx([7.0 * RATE, 0.0])


def seen_row_time(sd, stated=None):
    """The row time of a clip of 240 rows, of which two balls show 6 us with this sd each."""
    ball = SimpleNamespace(discs=SimpleNamespace(row_time=Estimate(6e-6, sd)))
    return _row_time(clip_of([(50.0, 50.0)]), [ball, ball], Look(row_time=stated))


def test_a_row_time_that_is_hardly_seen_is_drawn_to_that_of_usual_cameras():
    """0.8 +- 0.2 of the time between frames over the rows, by inverse variances."""
    longest = 1.0 / (RATE * PICTURE[0])
    sure = seen_row_time(1e-7)
    assert sure.value == pytest.approx(6e-6)
    assert sure.sd == pytest.approx(1e-7 / np.sqrt(2.0))
    unsure = seen_row_time(longest)
    weights = np.array([2.0 / longest**2, 1.0 / (0.2 * longest) ** 2])
    mean = weights @ [6e-6, 0.8 * longest] / weights.sum()
    assert unsure.value == pytest.approx(mean)
    assert unsure.sd == pytest.approx(weights.sum() ** -0.5)
    assert seen_row_time(longest, 4e-6) == Estimate(4e-6, 0.0)


def test_a_bundled_film_is_found_by_its_name():
    pytest.importorskip("av")
    for name in ("four_throws", "four_throws.mp4"):
        found = _with_bundled(name)
        assert found == path_of_source("four_throws", "tracks")
    clip = open_film(found)
    assert (clip.width, clip.height, clip.count) == (640, 360, 324)
    assert clip.camera_rate == pytest.approx(240.0)
    assert found.stat().st_size < 600_000
    assert _with_bundled("table_tennis_topspin") == "table_tennis_topspin"


def test_throws_one_after_the_other_are_many_and_few_fly_at_once():
    one_by_one = [(flight_of(np.arange(k, k + 20), 2.0),) for k in range(0, 250, 25)]
    assert [chain[0].frames[0] for chain in _chosen(one_by_one[::-1])] == [*range(0, 250, 25)]
    at_once = [(flight_of(np.arange(k, k + 20), 2.0),) for k in range(6)]
    assert len(_chosen(at_once)) == 3
    short = (flight_of(np.arange(300, 306), 2.0),)
    assert short not in _chosen([*one_by_one, short])
