"""The clock of a clip: stamps against constant spacing, repeated frames, playback for capture rate, lost frames."""

from __future__ import annotations

import filmed
import numpy as np
import pandas
import pytest

from fitball.errors import TableError
from fitball.tracks.clips import Reading
from fitball.tracks.motion import gravity, kink, noise
from fitball.tracks.read import read_tracks

SHOT = filmed.film(fps=240.0, seconds=0.15, noise=5e-4)


def table(time, place, **more):
    return pandas.DataFrame({"t": time, "x [m]": place[:, 0], "y [m]": place[:, 1], **more})


def read_one(frame, **how):
    (track,) = read_tracks([frame], Reading(**how))
    return track


def replaced(track):
    return any("constant spacing" in note for note in track.notes)


def test_stamps_of_arrival_give_way_to_constant_spacing():
    """Stamps that scatter by 0.3 ms smear a ball at 15 m/s by 4.5 mm, with positions good to half a millimetre."""
    stamps = SHOT.time + 3e-4 * np.random.default_rng(5).standard_normal(len(SHOT.time))
    track = read_one(table(stamps, SHOT.place))
    assert replaced(track)
    # The clock may begin elsewhere, and run as much faster as the stamps of the ends do.
    steps = np.diff(track.time)
    np.testing.assert_allclose(steps, 1.0 / 240.0, rtol=3e-3)
    assert np.ptp(steps) < 1e-9
    (note,) = [note for note in track.notes if "constant spacing" in note]
    assert " 239.88 frames/s" in note and "from 2.4 to 0.45 mm" in note
    # With the rate stated the spacing is that.
    stated = read_one(table(stamps, SHOT.place), fps=240.0)
    np.testing.assert_allclose(np.diff(stated.time), 1.0 / 240.0, rtol=1e-9)


def test_stamps_rounded_to_a_millisecond():
    assert replaced(read_one(table(np.round(SHOT.time, 3), SHOT.place)))


def test_hundredths_of_a_second_at_thirty_frames():
    """Steps of 30 and 40 ms are frames of 33 ms, also where another rate replaces them."""
    shot = filmed.film(fps=30.0, seconds=1.0, v_1=(2.0, -7.0), v_2=(1.6, 6.0), noise=1e-3)
    stamps = table(np.floor(100.0 * (shot.time - shot.time[0])) / 100.0, shot.place)
    track = read_one(stamps)
    assert replaced(track)
    np.testing.assert_allclose(np.diff(track.time), 1.0 / 30.0, rtol=2e-3)
    np.testing.assert_allclose(np.diff(read_one(stamps, fps=60.0, as_read=True).time), 1.0 / 60.0, rtol=1e-9)


def test_true_stamps_of_an_uneven_camera_are_kept():
    """A camera that jitters and writes down when: constant spacing makes it worse."""
    generator = np.random.default_rng(6)
    time = SHOT.time + 3e-4 * generator.standard_normal(len(SHOT.time))
    place = np.zeros((len(time), 2))
    before = time < 0.0
    place[before] = filmed.flown(time[before], (0.0, filmed.RADIUS), (15.0, -7.0))
    place[~before] = filmed.flown(time[~before], (0.0, filmed.RADIUS), (9.5, 5.4))
    track = read_one(table(time, place + 5e-4 * generator.standard_normal(place.shape)))
    assert not replaced(track)
    np.testing.assert_array_equal(track.time, time)


def test_even_stamps_are_kept_as_they_are():
    track = read_one(table(SHOT.time, SHOT.place))
    assert not replaced(track)
    np.testing.assert_array_equal(track.time, SHOT.time)


def test_missing_frames_are_gaps_and_no_shift():
    kept = np.delete(np.arange(len(SHOT.time)), [4, 5, 6, 20, 50])
    frames = pandas.DataFrame({"frame": kept + 100, "x [m]": SHOT.place[kept, 0], "y [m]": SHOT.place[kept, 1]})
    track = read_one(frames, fps=240.0)
    np.testing.assert_array_equal(track.frame, kept + 100)
    np.testing.assert_allclose(np.diff(track.time), np.diff(SHOT.time[kept]), atol=1e-12)
    stamps = SHOT.time[kept] + 3e-4 * np.random.default_rng(7).standard_normal(len(kept))
    spaced = read_one(table(stamps, SHOT.place[kept]))
    assert replaced(spaced)
    np.testing.assert_array_equal(np.round(np.diff(spaced.time) * 240.0), np.diff(kept))


def test_frames_that_repeat_the_one_before_are_left_out_and_counted():
    """A film of 200 frames/s converted to 240: every sixth frame is a copy."""
    which = np.floor(np.arange(1.2 * len(SHOT.time)) / 1.2).astype(int)
    which = which[which < len(SHOT.time)]
    copies = int(np.sum(np.diff(which) == 0))
    shot = table(np.arange(len(which)) / 240.0, SHOT.place[which])
    track = read_one(shot)
    assert f"{copies} frames that repeat the one before left out" in track.notes
    assert len(track.time) == len(which) - copies


def test_a_third_of_the_frames_repeated_is_another_rate():
    which = np.repeat(np.arange(len(SHOT.time)), 2)
    time = np.arange(len(which)) / 480.0
    with pytest.raises(
        TableError, match=r"73 of 146 frames repeat the one before .*frames 2, 4, 6, .*lower|higher rate"
    ):
        read_one(table(time, SHOT.place[which]))


def test_a_slow_ball_whose_rounded_positions_repeat_is_none():
    """At 10,000 frames/s and whole pixels a ball is often where it was."""
    shot = filmed.film(fps=10_000.0, seconds=0.02, v_1=(2.0, -1.5), v_2=(1.5, 1.2))
    place = np.round(1e3 * shot.place / 0.8)
    assert np.mean(np.all(np.diff(place, axis=0) == 0.0, axis=1)) > 0.2
    pixels = pandas.DataFrame({"t": shot.time, "x [px]": place[:, 0], "y [px]": place[:, 1]})
    track = read_one(pixels, metres_per_px=0.8e-3)
    assert len(track.time) == len(shot.time) and not any("repeat" in note for note in track.notes)


def test_times_of_no_frames_and_another_rate_are_refused():
    time = np.sort(np.random.default_rng(9).uniform(0.0, 0.3, len(SHOT.time)))
    with pytest.raises(TableError, match=r"times of clip 'DataFrame' are not those of frames: .*or frame numbers"):
        read_one(table(time, SHOT.place), fps=1000.0)


@pytest.mark.parametrize("played", [30.0, 60.0])
def test_playback_for_capture_rate_is_refused_with_the_rate_that_gravity_shows(played):
    shot = filmed.film(fps=240.0, seconds=0.25, v_1=(6.0, -4.0), v_2=(4.0, 3.2), noise=1e-3)
    slow = table(np.arange(len(shot.time)) / played, shot.place)
    with pytest.raises(
        TableError, match=rf"g comes out as .* at {played:.0f} frames/s.*took about 240 frames/s"
    ) as caught:
        read_one(slow)
    assert "fps=N" in str(caught.value) and "as_read=True" in str(caught.value)
    # With the rate of the camera stated, or on request, it is read.
    track = read_one(slow, fps=240.0)
    np.testing.assert_allclose(np.diff(track.time), 1.0 / 240.0, rtol=1e-9)
    assert any(f"in place of {played:.0f} frames/s in the file" in note for note in track.notes)
    assert len(read_one(slow, as_read=True).time) == len(shot.time)


def test_a_scale_that_is_off_by_ten_is_seen_by_gravity():
    shot = filmed.film(fps=240.0, seconds=0.25, v_1=(6.0, -4.0), v_2=(4.0, 3.2), noise=1e-3)
    with pytest.raises(TableError, match=r"lengths are off by a factor of (9|10)"):
        read_one(table(shot.time, 0.1 * shot.place))


@pytest.mark.parametrize("fps", [120.0, 240.0, 1000.0])
@pytest.mark.parametrize("lift", [-0.25, 0.0, 0.25])
def test_spin_and_drag_at_high_speed_are_no_wrong_clock(fps, lift):
    """Backspin of a fast ball may cancel gravity."""
    time = np.arange(-int(0.1 * fps), int(0.1 * fps) + 1) / fps + 1e-4
    before, place = time < 0.0, np.zeros((2 * int(0.1 * fps) + 1, 2))
    place[before] = filmed.flown(time[before], (0.0, 0.033), (32.0, -9.0), lift=lift)
    place[~before] = filmed.flown(time[~before], (0.0, 0.033), (22.0, 7.0), lift=lift)
    place += 1e-3 * np.random.default_rng(8).standard_normal(place.shape)
    assert len(read_one(table(time, place)).time) == len(time)


# What motion shows.


def test_noise_is_that_of_the_positions_however_the_ball_flies():
    for spread in (2e-4, 2e-3):
        shot = filmed.film(fps=500.0, seconds=0.2, noise=spread)
        assert noise(shot.time, shot.place) == pytest.approx(spread, rel=0.2)


def test_the_kink_is_the_bounce_and_its_velocities_those_of_the_flights():
    bend = kink(SHOT.time, SHOT.place)
    assert abs(bend.time) < 2.0 / 240.0
    np.testing.assert_allclose(bend.before, [15.2, -6.9], atol=0.4)
    np.testing.assert_allclose(bend.after, [9.4, 5.3], atol=0.4)
    np.testing.assert_allclose(bend.jump, bend.after - bend.before)
    assert kink(SHOT.time[:6], SHOT.place[:6]) is None


def test_gravity_of_a_ball_without_air():
    time, place = filmed.bouncing(fps=240.0, heights=(1.0,), noise=1e-3)
    land = float(time[np.argmin(place[:, 1])])
    value, sd = gravity(time, place[:, 1], [land])
    assert value == pytest.approx(-filmed.G, abs=4.0 * sd) and 0.003 < sd < 0.3
    assert not np.isfinite(gravity(time[:4], place[:4, 1], [])[0])
