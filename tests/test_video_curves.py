"""Flights of balls: bounces in place, sds of places by their scatter, the row time of cameras."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.clips import write

from fitball.video.bounces import balls_of
from fitball.video.curves import smoothed, with_scatter
from fitball.video.films import open_film
from fitball.video.find import _no_ball, _slow_motion, find_balls
from fitball.video.flights import Flight, flights_of
from fitball.video.shape import Discs
from fitball.video.spots import Spots
from fitball.video.types import Crop, Estimate, Look
from fitball.video.views import View

GRAVITY = 9.81
DIAMETER = 0.066
# Pixels a metre of a ball of 11 px radius.
METRE = 11.0 / 0.033
RATE = 120.0


def spots_of_drops(bounces, junk, seed=1, rate=RATE):
    """Spots (x, y, radius, strength) of a ball that bounces in place, and of other things about its
    line, with the times of frames.
    """
    rng = np.random.default_rng(seed)
    rises = 3.5 * 0.75 ** np.arange(bounces + 1)
    lands = np.cumsum([0.0, *(2.0 * rises[1:] / GRAVITY)])
    times = np.arange(-0.3, lands[-1], 1.0 / rate)
    number = np.searchsorted(lands, times, side="right")
    since = times - lands[np.maximum(number - 1, 0)]
    speed = np.where(number == 0, -rises[0], rises[np.minimum(number, bounces)])
    height = np.maximum(speed * since - 0.5 * GRAVITY * since**2, 0.0)
    found = []
    for h in height:
        ball = [320.0 + rng.normal(0.0, 0.3), 300.0 - METRE * h + rng.normal(0.0, 0.3), 11.0, 9.0]
        other = np.column_stack(
            [
                320.0 + rng.normal(0.0, 2.0, junk),
                rng.uniform(50.0, 310.0, junk),
                rng.uniform(2.0, 8.0, junk),
                np.full(junk, 6.0),
            ]
        )
        found.append(np.vstack([ball, other]))
    return found, times


def test_a_ball_that_bounces_in_place_is_one_ball_with_all_flights_higher_than_itself():
    found, times = spots_of_drops(bounces=5, junk=0)
    longest = balls_of(flights_of(found, times, DIAMETER), DIAMETER)[0]
    rises = 3.5 * 0.75 ** np.arange(1, 6)
    high = rises[rises**2 / (2.0 * GRAVITY) > DIAMETER]
    starts = [flight.times[0] for flight in longest]
    assert starts[1:] == pytest.approx(np.cumsum([0.0, *(2.0 * high[:-1] / GRAVITY)]), abs=0.02)


@pytest.mark.parametrize(("filmed", "says"), [(240.0, "--fps 240"), (30.0, "")])
def test_slow_motion_without_a_tag_is_known_by_a_ball_that_hardly_falls(filmed, says):
    found, times = spots_of_drops(bounces=2, junk=0, rate=filmed)
    played = np.arange(len(times)) / 30.0
    shifts = np.zeros((len(times), 2))
    spots = Spots(np.arange(len(times)), played, found, shifts, True, np.zeros((9, 9), np.uint8))
    chains = balls_of(flights_of(found, played, DIAMETER), DIAMETER)
    said = _slow_motion(spots, chains, SimpleNamespace(camera_rate=30.0), Look(DIAMETER))
    assert said.endswith(says)
    assert bool(said) == bool(says)


def test_low_bounces_which_one_path_follows_are_cut_apart_and_not_joined_again():
    found, times = spots_of_drops(bounces=5, junk=0, rate=240.0)
    longest = balls_of(flights_of(found, times, DIAMETER), DIAMETER)[0]
    lands = np.cumsum([0.0, *(2.0 * 3.5 * 0.75 ** np.arange(1, 5) / GRAVITY)])
    assert [flight.times[0] for flight in longest[1:]] == pytest.approx(lands, abs=0.03)


def test_the_top_of_a_flight_is_no_bounce():
    """A ball that comes nearer falls faster than it rose: two parabolas, which meet at the top."""
    times = np.arange(-9, 10) / 30.0
    fall = np.where(times < 0.0, 0.8, 1.1) * GRAVITY * METRE
    y = 60.0 + 0.5 * fall * times**2
    spots = np.column_stack([300.0 - 15.0 * times, y, np.full(19, 11.0), np.full(19, 9.0)])
    rows = (np.arange(8), np.arange(11, 19))
    rise, drop = (Flight(k, times[k], spots[k]) for k in rows)
    assert balls_of([rise, drop], DIAMETER) == []


def test_of_many_paths_the_longest_are_looked_at():
    found, times = spots_of_drops(bounces=2, junk=16)
    flights = flights_of(found, times, DIAMETER)
    assert 50 < len(flights) <= 120
    assert any(len(flight.frames) > 15 for flight in flights)


def discs_of(scatter, edge, seed=3):
    """Discs whose places scatter about two flights, with the sds of their edges."""
    rng = np.random.default_rng(seed)
    times = np.arange(80) / 240.0
    p = np.zeros((80, 7))
    p[:, 0] = 100.0 + 900.0 * times + scatter[0] * rng.standard_normal(80)
    p[:, 1] = 50.0 + 1500.0 * np.abs(times - 0.16) + scatter[1] * rng.standard_normal(80)
    p[:, 2] = 20.0
    discs = Discs(
        np.arange(80),
        times,
        p,
        np.full((80, 7), edge),
        np.ones(80),
        np.full(80, 20.0),
        1e-3,
        0.9,
        Estimate(0.0, 1e-6),
        {},
    )
    return discs, [np.arange(38), np.arange(39, 80)]


def test_sds_of_places_are_those_of_their_scatter_or_of_their_edges_if_larger():
    discs, flights = discs_of((0.2, 0.1), 0.02)
    sd = with_scatter(discs, flights).sd
    assert np.median(sd[:, :2], axis=0) == pytest.approx([0.2, 0.1], rel=0.25)
    # Sds of what is no place stay.
    assert (sd[:, 2:] == 0.02).all()
    discs, flights = discs_of((0.001, 0.001), 0.3)
    assert with_scatter(discs, flights).sd[:, :2] == pytest.approx(0.3, rel=1e-3)


def test_a_place_that_is_far_off_moves_no_curve():
    discs, flights = discs_of((0.02, 0.02), 0.02)
    good = np.ones(80, bool)
    places = discs.p[:, :2].copy()
    usual = smoothed(discs.times, places, flights, good)
    places[20] += 30.0
    assert smoothed(discs.times, places, flights, good) == pytest.approx(usual, abs=0.03)


def test_a_film_in_which_nothing_moves_shows_no_row_time_and_no_ball(tmp_path):
    clip = open_film(write(tmp_path / "still.mp4", count=20))
    seen = find_balls(clip, Look(), lambda _stage, _share: None)
    assert seen.balls == ()
    assert seen.nothing
    assert not np.isfinite(seen.row_time.sd)
    # Twelve squares with structure are needed, and this picture has fewer.
    assert "film-background" in [note.code for note in seen.notes]


def stand_in(radius, spots_radius, contrast=0.0, change=0.0):
    """Discs of a ball with a radius, and the chain of its flights with that of its spots [px]. Its
    colour has a contrast to the background, and changes by so much from frame to frame [levels].
    """
    times = np.arange(40) / 240.0
    metre = 2.0 * radius / DIAMETER
    t = times - 0.08
    fallen = 0.5 * GRAVITY * t**2
    height = np.where(t < 0.0, -3.0 * t - fallen, 2.4 * t - fallen)
    p = np.zeros((40, 7))
    p[:, 0] = 50.0 + 2.0 * metre * times
    p[:, 1] = 300.0 - metre * height
    p[:, 2] = radius
    spots = np.column_stack([p[:, :2], np.full(40, spots_radius), np.full(40, 9.0)])
    chain = tuple(Flight(k, times[k], spots[k]) for k in (np.arange(18), np.arange(21, 40)))
    grey = np.full((3, 400, 300), 0.5)
    crop = Crop(0, 0, 0, np.zeros((2, 2), np.uint8))
    seen = [
        np.full((3, 400, 300), 128.0 - contrast + side * change, np.float32) for side in (-1, 1)
    ]
    two = [
        View(0, 0.0, 0.0, 0.0, grey, grey, np.zeros(2), np.zeros(2), 0.0, crop, colours)
        for colours in seen
    ]
    frames = np.arange(40)
    sd = np.full((40, 7), 0.05)
    row_time = Estimate(0.0, 1e-6)
    views = {k: two[k % 2] for k in range(40)}
    discs = Discs(frames, times, p, sd, np.ones(40), p[:, 2], 1e-3, 0.9, row_time, views)
    return chain, discs


def test_a_disc_of_another_size_than_what_moves_is_no_ball():
    assert _no_ball(*stand_in(12.0, 11.0), Look()) == ""
    assert _no_ball(*stand_in(4.0, 11.0), Look())
    assert _no_ball(*stand_in(25.0, 11.0), Look())
    # A disc of a pixel is none, as small as its spots may be.
    assert _no_ball(*stand_in(1.5, 1.5), Look())


@pytest.mark.parametrize(("contrast", "change"), [(0.0, 3.0), (60.0, 8.0)])
def test_the_colour_of_a_ball_changes_by_less_than_a_quarter_of_its_contrast(contrast, change):
    """Light, reflections and prints change it; of something else each frame has another one."""
    assert _no_ball(*stand_in(12.0, 11.0, contrast, change), Look()) == ""
    assert "colour" in _no_ball(*stand_in(12.0, 11.0, contrast, 2.5 * change), Look())
