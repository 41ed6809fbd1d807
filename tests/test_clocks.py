"""Clocks of films that order nothing, or only some of the frames: another clock counts, or the film
is refused. The truth is a bounce of which six frames are lost.
"""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from support.trackers import CAMERA, FRAME, METRES, TIME, clip

from fitball.base.errors import InputError
from fitball.data.scene import CameraSection, Scene
from fitball.tracks.read import read_tracks

SOME = np.arange(len(FRAME)) % 3 == 0
EARLY = np.arange(len(FRAME)) < 30
# Stamps that several frames share.
COARSE = np.floor(100.0 * TIME) / 100.0


def read(table, **camera):
    """Tracks and the codes of notes of a frame."""
    scene = Scene(camera=CameraSection(**{**CAMERA, **camera}))
    tracks, notes = read_tracks([table], scene, {})
    return tracks, [note.code for note in notes]


def codes_of_refusal(table, **camera):
    with pytest.raises(InputError) as caught:
        read(table, **camera)
    return [fault.code for fault in caught.value.faults]


def assert_is_the_bounce(track):
    """Hold that all frames are there, at their times but for where these begin."""
    assert_allclose(track.time - track.time[0], TIME - TIME[0], atol=1e-9)
    assert_allclose(np.diff(track.x), np.diff(METRES[:, 0]), atol=1e-9)
    assert_allclose(np.diff(track.y), np.diff(METRES[:, 1]), atol=1e-9)


# Columns of a clip, and the note that is due.
OTHER_CLOCKS = {
    "time stands": ({"t": 1.0, "frame": FRAME}, "idle-clock"),
    "time is empty": ({"t": np.nan, "frame": FRAME}, "idle-clock"),
    "time is a date": ({"t": "2026-03-01", "frame": FRAME}, "idle-clock"),
    "frame stands": ({"frame": 3, "t": TIME}, "idle-clock"),
    "frame is empty": ({"frame": np.nan, "t": TIME}, "idle-clock"),
    "frame repeats": ({"frame": FRAME // 2, "t": TIME}, "clocks-differ"),
    "frame begins late": ({"frame": np.where(EARLY, 0.0, FRAME), "t": TIME}, "clocks-differ"),
    "frame in some rows": ({"frame": np.where(SOME, np.nan, FRAME), "t": TIME}, "clocks-differ"),
    "time repeats": ({"t": COARSE, "frame": FRAME}, None),
    "time begins late": ({"t": np.where(EARLY, 0.0, TIME), "frame": FRAME}, None),
    "another time": ({"time": 1.0, "msec": 1e3 * TIME}, None),
    "another time, empty": ({"time": "", "timestamp": TIME}, None),
    "another frame": ({"frame": 0, "frame_idx": FRAME}, None),
}


@pytest.mark.parametrize("kind", [*OTHER_CLOCKS])
def test_a_clock_that_orders_nothing_gives_way_to_another_one(kind):
    columns, code = OTHER_CLOCKS[kind]
    (track,), notes = read(clip(**columns))
    assert_is_the_bounce(track)
    assert [note for note in notes if note != "no-unit"] == [code] * (code is not None)
    has_times = any(np.array_equal(values, TIME) for values in columns.values())
    if has_times:
        (track,), _ = read(clip(**columns), fps=None)
        assert_is_the_bounce(track)
        assert len({*track.frame}) == len(FRAME)


def test_an_idle_clock_of_each_clip_gives_way_too():
    halves = [clip(t=float(k), frame=FRAME, id=k) for k in range(2)]
    tracks, notes = read(pd.concat(halves))
    assert notes.count("idle-clock") == 2
    for track in tracks:
        assert_is_the_bounce(track)
    # Without ids, numbers of frames that begin again part the clips.
    same_time = pd.concat([clip(t=1.0, frame=FRAME), clip(t=1.0, frame=FRAME)])
    tracks, _ = read(same_time)
    for track in tracks:
        assert_is_the_bounce(track)
    assert len(tracks) == 2


@pytest.mark.parametrize("fps", [240.0, None])
@pytest.mark.parametrize(
    "columns", [{"t": 1.0}, {"t": np.nan}, {"frame": 3}, {"t": 1.0, "frame": 3}, {"msec": ""}]
)
def test_rows_are_not_counted_in_place_of_an_idle_clock(columns, fps):
    """They were, or a traceback was shown; speeds would be 16.4 for 14.0 m/s."""
    assert codes_of_refusal(clip(**columns), fps=fps) == ["idle-clock"]


def test_a_column_that_is_not_read_is_named_before_an_idle_clock():
    assert codes_of_refusal(clip(t=1.0, n=FRAME)) == ["unread-clock"]


def test_times_that_repeat_are_refused():
    for stamps in (COARSE, np.where(EARLY, 0.0, TIME)):
        assert codes_of_refusal(clip(t=stamps)) == ["two-positions"]


@pytest.mark.parametrize("name", ["frame", "t"])
def test_rows_in_any_order_are_one_clip(name):
    whole = clip(**{name: FRAME if name == "frame" else TIME})
    for table in (whole[::-1], whole.sample(frac=1.0, random_state=1)):
        (track,), _ = read(table)
        assert_is_the_bounce(track)


def test_an_object_that_is_never_seen_has_no_idle_clock():
    both = pd.concat([clip(frame=FRAME, id="a"), clip(frame=7, id="b").iloc[:3]])
    both.loc[both["id"] == "b", ["x", "y"]] = np.nan
    (track,), notes = read(both)
    assert_is_the_bounce(track)
    assert "idle-clock" not in notes


@pytest.mark.parametrize(
    ("gaps", "counter"),
    [
        ({"t": (9, 40)}, "t"),
        ({"frame": (9, 40)}, "frame"),
        ({"t": (9,), "frame": (40,)}, ""),
    ],
)
def test_of_two_clocks_that_part_the_one_with_the_gaps_counts(gaps, counter):
    """One frame is lost before each of these rows, which the other clock does not count."""
    clocks = {}
    for name in ("t", "frame"):
        steps = np.ones(TIME.size)
        steps[[*gaps.get(name, ())]] += 1.0
        clocks[name] = np.cumsum(steps)
    table = clip(t=clocks["t"] / CAMERA["fps"], frame=clocks["frame"])
    if not counter:
        assert codes_of_refusal(table) == ["clocks-differ"]
        return
    (track,), notes = read(table)
    assert "clocks-differ" in notes
    expected = (clocks[counter] - clocks[counter][0]) / CAMERA["fps"]
    assert_allclose(track.time - track.time[0], expected, atol=1e-9)
