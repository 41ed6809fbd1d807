"""Tables of programs that track balls: frames, objects and confidences are those of the film. Each
is read to the positions and times of one bounce of which six frames are lost.
"""

import os
import pickle
import shlex
import sys
from io import StringIO

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from support.trackers import (
    CAMERA,
    COUNT,
    FPS,
    FRAME,
    METRES,
    RACKET,
    TIME,
    TRUTH,
    X,
    Y,
    clip,
    csv_text,
    deeplabcut,
    deeplabcut_hdf5,
    labels_of_frames,
    movement_dataset,
    sleap,
    sleap_hdf5,
    trackmate,
)

import fitball
from fitball.base.errors import InputError
from fitball.data.scene import BallSection, CameraSection, Scene
from fitball.tracks.read import read_tracks


def read(source, columns=None, ball="", **camera):
    """Tracks and the codes of notes of a file or frame."""
    scene = Scene(camera=CameraSection(**{**CAMERA, **camera}), ball=BallSection())
    tracks, notes = read_tracks([source], scene, columns or {}, ball)
    return tracks, [note.code for note in notes]


def read_text(folder, text, columns=None, ball="", name="clip.csv", **camera):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return read(path, columns, ball, **camera)


def refused(source, columns=None, ball="", **camera):
    """The error of a file or frame."""
    with pytest.raises(InputError) as caught:
        read(source, columns, ball, **camera)
    return caught.value


def assert_is_the_bounce(track, rows=slice(None), places=1e-9, times=1e-9):
    """Hold that positions are those of the film, and times but for where they begin."""
    seen = TIME[rows]
    assert_allclose(track.time - track.time[0], seen - seen[0], atol=times)
    assert_allclose(np.diff(track.x), np.diff(METRES[rows, 0]), atol=places)
    assert_allclose(np.diff(track.y), np.diff(METRES[rows, 1]), atol=places)


def test_the_speeds_are_those_of_the_bounce(tmp_path):
    """With frames counted by rows they were 16.4, 6.7, 11.1 and 5.4 m/s."""
    camera = CameraSection(**CAMERA)
    scene = Scene(camera=camera, flight={"drag": 0.01, "lift": 0.0})
    path = tmp_path / "film.csv"
    tables = [
        sleap("sleap"),
        csv_text(deeplabcut(("ball", "racket"))),
        csv_text(clip(frame=np.arange(len(FRAME)), t=np.round(TIME, 5))),
        trackmate(),
        labels_of_frames(),
    ]
    for text in tables:
        path.write_text(text, encoding="utf-8")
        (impact,) = fitball.track(path, scene=scene).impacts.itertuples(index=False)
        speeds = dict(zip(("v_x1", "v_y1", "v_x2", "v_y2"), impact[0:8:2], strict=True))
        assert speeds == pytest.approx(TRUTH, abs=0.06)


# ---- time

FRAMES = [
    *("frame", "frame_idx", "frame_id", "frame_num", "frame_number", "frameIndex", "Frame #"),
    *("Frame No.", "Slice", "Slice n°", "imageNumber", "image_id", "video_frame", "#frame"),
    *("Bildnummer", "fotograma", "img_idx", "source frame", "frame count", "FrameId"),
]


@pytest.mark.parametrize("name", FRAMES)
def test_numbers_of_frames_as_programs_call_them(name):
    (track,), notes = read(clip(**{name: FRAME}))
    assert_is_the_bounce(track)
    assert "rows-counted" not in notes
    assert track.frame.tolist() == FRAME.tolist()


STAMPS = [
    *(("msec", 1e3), ("PTS", 90_000.0), ("elapsed", 1.0), ("time_ns", 1e9), ("elapsedMs", 1e3)),
    *(("CAP_PROP_POS_MSEC", 1e3), ("pts_time", 1.0), ("timestamp_us", 1e6), ("X_Value", 1.0)),
    *(("time (ns)", 1e9), ("t_ms", 1e3), ("tiempo [s]", 1.0), ("milliseconds", 1e3)),
]


@pytest.mark.parametrize(("name", "per_second"), STAMPS)
def test_times_as_programs_call_them(name, per_second):
    table = clip(**{name: TIME * per_second})
    (track,), notes = read(table)
    assert_is_the_bounce(track)
    assert "rows-counted" not in notes
    if name == "PTS":
        assert [fault.code for fault in refused(table, fps=None).faults] == ["no-rate"]
    else:
        (track,), _ = read(table, fps=None)
        assert_is_the_bounce(track)


def test_times_in_hours_minutes_seconds_and_dates():
    for start in ("0:00:", "00:", "2026-03-01T10:00:0"):
        stamps = [f"{start}{1.0 + time:.6f}" for time in TIME]
        (track,), _ = read(clip(time=stamps), fps=None)
        assert_is_the_bounce(track, times=2e-6)


def test_names_of_files_are_numbers_of_frames(tmp_path):
    for pattern in ("{:04d}.jpg", "clip1/img_{}.png", "frames/frame{:05d}_v2.PNG", "f{}.json"):
        names = [pattern.format(frame) for frame in FRAME]
        for column in ("file name", "image", "frame", "path"):
            (track,), _ = read(clip(**{column: names}))
            assert_is_the_bounce(track)
        (track,), _ = read(clip(picture_of=names), {"frame": "picture_of"})
        assert_is_the_bounce(track)


def test_a_film_in_each_row_names_the_clip_not_the_frame():
    table = clip(file=["clip_07.mp4"] * len(FRAME), frame=FRAME)
    (track,), _ = read(table)
    assert track.id == "clip_07.mp4"
    assert_is_the_bounce(track)


def test_an_index_without_a_name_has_the_frames_where_it_has_gaps(tmp_path):
    table = clip()
    table.index = FRAME
    for source in (table, tmp_path / "clip.csv"):
        table.to_csv(tmp_path / "clip.csv")
        (track,), notes = read(source)
        assert_is_the_bounce(track)
        assert "index-as-frame" in notes
        assert "rows-counted" not in notes
    # Beside a column of frames it has no meaning.
    (track,), notes = read(table.assign(frame=FRAME).set_index(FRAME[::-1]))
    assert_is_the_bounce(track)
    assert "index-as-frame" not in notes


def test_rows_are_counted_with_a_note_where_none_can_be_missing():
    whole = pd.DataFrame({"x": [*X[:8]], "y": [*Y[:8]]})
    for table in (whole, whole.assign(n=range(1, 9)), whole.assign(mood=[3, 1, 2, 5, 4, 6, 8, 7])):
        (track,), notes = read(table)
        assert_allclose(np.diff(track.time), 1.0 / FPS)
        assert notes.count("rows-counted") == 1


@pytest.mark.parametrize(
    ("name", "numbers", "ours"),
    [("n", FRAME, "frame"), ("shot time", TIME, "t"), ("n", 2 * FRAME + 4, "t")],
)
def test_rows_are_never_counted_beside_a_column_with_gaps(name, numbers, ours):
    table = clip(**{name: numbers})
    error = refused(table)
    assert [fault.code for fault in error.faults] == ["unread-clock"]
    _, _, remedy = str(error).partition("--columns ")
    (pair,) = shlex.split(remedy)
    their = dict([pair.split("=")])
    assert their == {ours: name}
    (track,), _ = read(table, their)
    assert_is_the_bounce(track)


def test_every_second_frame_is_no_row():
    table = clip(n=2 * np.arange(len(X)))
    assert refused(table).code == "unread-clock"
    (track,), _ = read(table, {"frame": "n"})
    assert_allclose(np.diff(track.time), 2.0 / FPS)


def test_stamps_with_gaps_count_before_numbers_of_decoded_frames():
    decoded = np.arange(len(FRAME))
    for fps in (FPS, None):
        (track,), notes = read(clip(frame=decoded, t=np.round(TIME, 5)), fps=fps)
        assert_is_the_bounce(track, times=2e-5)
        assert "clocks-differ" in notes


def test_numbers_with_gaps_count_before_stamps_of_rows():
    for fps in (FPS, None):
        (track,), notes = read(clip(frame=FRAME, t=np.arange(len(FRAME)) / FPS), fps=fps)
        assert_is_the_bounce(track)
        assert "clocks-differ" in notes


def test_stamps_and_numbers_with_different_gaps_are_refused():
    some = np.delete(np.arange(COUNT), [20, 30, 31, 60, 61, 62])
    error = refused(clip(frame=FRAME, t=some / FPS))
    (fault,) = error.faults
    assert fault.code == "clocks-differ"
    # The first row where steps differ is that behind the first lost frame.
    assert fault.row == 9


@pytest.mark.parametrize(
    "stamps",
    [TIME, TIME * 8.0, np.round(TIME, 3), np.round(TIME, 2), TIME + 4e-4 * np.sin(FRAME)],
    ids=["exact", "slow motion", "in ms", "in hundredths", "jitter"],
)
def test_stamps_that_agree_with_numbers_make_no_note(stamps):
    (track,), notes = read(clip(frame=FRAME, t=stamps))
    assert_is_the_bounce(track)
    assert notes == ["no-unit"]


# ---- objects

PARTS = [((("ball",), ()), False), ((("ball", "racket"), ()), True)]
ANIMALS = [((("centre",), ("racket", "ball")), True), ((("ball",), ("single",)), False)]


@pytest.mark.parametrize("dropped", [True, False])
@pytest.mark.parametrize(("names", "is_noted"), [*PARTS, *ANIMALS])
def test_tables_of_deeplabcut(tmp_path, names, is_noted, dropped):
    table = deeplabcut(*names, dropped)
    deeplabcut_hdf5(tmp_path / "film.h5", table)
    table.to_csv(tmp_path / "film.csv")
    for source in (table, tmp_path / "film.csv", tmp_path / "film.h5"):
        (track,), notes = read(source)
        assert_is_the_bounce(track)
        assert ("objects" in notes) == is_noted
        assert ("frames-left-out" in notes) == (not dropped)
        assert {"above-header", "rows-counted"}.isdisjoint(notes)
        assert track.id == ("positions" if source is table else "film")


def test_labelled_pictures_of_deeplabcut(tmp_path):
    table = deeplabcut(("ball",))
    table.index = [f"labeled-data/film/img{frame:04d}.png" for frame in FRAME]
    (track,), _ = read_text(tmp_path, csv_text(table))
    assert_is_the_bounce(track)


def test_parts_that_do_not_say_which_is_the_ball_are_listed(tmp_path):
    table = deeplabcut(("tip", "handle"))
    error = refused(table)
    assert error.code == "several-objects"
    assert "tip and handle" in str(error)
    _, _, remedy = str(error).partition("--ball ")
    (track,), _ = read(table, ball=remedy.strip())
    assert_allclose(track.x, RACKET[FRAME, 0] * 2e-3)
    error = refused(table, ball="ball")
    assert error.code == "no-object"
    assert "tip and handle" in str(error)


def test_the_ball_is_chosen_by_any_level_of_a_name():
    table = deeplabcut(("ball", "racket"))
    for name in ("racket", "Racket"):
        (track,), notes = read(table, ball=name)
        assert_allclose(track.x, RACKET[FRAME, 0] * 2e-3)
        assert "objects" in notes
    table = deeplabcut(("centre",), ("a", "ball"))
    (track,), _ = read(table, ball="ball")
    assert_is_the_bounce(track)


LAYOUTS = ("sleap", "instances", "points", "frames")


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize(
    ("nodes", "tracks"), [(("ball",), ("0",)), (("ball", "tip"), ("0",)), (("m",), ("ball", "b"))]
)
def test_layouts_of_sleap(tmp_path, layout, nodes, tracks):
    (track,), notes = read_text(tmp_path, sleap(layout, nodes, tracks))
    assert_is_the_bounce(track)
    assert ("objects" in notes) == (len(nodes) + len(tracks) > 2)
    assert "rows-counted" not in notes


def test_instances_of_sleap_that_change_places_stay_what_they_are(tmp_path):
    text = sleap("frames", ("m",), ("ball", "racket"))
    table = pd.read_csv(StringIO(text), dtype=object)
    first = [name for name in table.columns if name.startswith("inst0.")]
    second = [name.replace("inst0", "inst1") for name in first]
    table.loc[20:40, [*first, *second]] = table.loc[20:40, [*second, *first]].to_numpy()
    (track,), _ = read_text(tmp_path, csv_text(table, index=False))
    assert_is_the_bounce(track)


@pytest.mark.parametrize(
    ("axes", "stated"),
    [
        (("track", "xy", "node", "frame"), False),
        (("track", "xy", "node", "frame"), True),
        (("frame", "track", "node", "xy"), True),
    ],
)
def test_analysis_files_of_sleap(tmp_path, axes, stated):
    for nodes, tracks in ((("ball",), ("0",)), (("ball", "tip"), ("0",)), (("m",), ("b", "ball"))):
        path = tmp_path / "film.analysis.h5"
        sleap_hdf5(path, axes, stated, nodes, tracks)
        (track,), _ = read(path)
        assert_is_the_bounce(track)
        assert track.frame.tolist() == FRAME.tolist()


@pytest.mark.parametrize("in_frames", [True, False])
@pytest.mark.parametrize(
    "names",
    [
        {},
        {"animals": ("racket", "ball")},
        {"parts": ("tip", "ball"), "animals": ("a",)},
        {"parts": (), "space": "xy"},
        {"space": "xyz"},
        {"space": "yx"},
        {"space": "zxy"},
    ],
)
def test_datasets_of_movement(tmp_path, names, in_frames):
    path = tmp_path / "film.nc"
    movement_dataset(path, in_frames=in_frames, **names)
    (track,), notes = read(path, fps=FPS if in_frames else None)
    assert_is_the_bounce(track)
    assert "rows-counted" not in notes
    is_chosen = any(len(names.get(level, ())) > 1 for level in ("animals", "parts"))
    assert ("objects" in notes) == is_chosen


def test_datasets_of_movement_in_polar_coordinates_are_refused(tmp_path):
    path = tmp_path / "film.nc"
    movement_dataset(path, space=("rho", "phi"))
    assert refused(path).code == "no-positions"


def test_older_netcdf_is_named(tmp_path):
    path = tmp_path / "film.nc"
    path.write_bytes(b"CDF\2" + bytes(100))
    error = refused(path)
    assert error.code == "other-format"
    assert "xarray" in str(error)


def test_what_a_pickle_names_is_never_run(tmp_path):
    class Trap:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "trapped"),)

    path = tmp_path / "film.h5"
    deeplabcut_hdf5(path, deeplabcut(("ball",)), pickle.dumps(Trap(), protocol=0))
    assert refused(path).code == "other-format"
    assert not (tmp_path / "trapped").exists()


def test_other_files_in_hdf5_are_named(tmp_path):
    path = tmp_path / "film.h5"
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    assert refused(path).code == "other-format"
    deeplabcut_hdf5(path, clip(frame=FRAME))
    (track,), _ = read(path)
    assert_is_the_bounce(track)


def test_spots_of_trackmate(tmp_path):
    (track,), notes = read_text(tmp_path, trackmate())
    assert_is_the_bounce(track, places=3e-6)
    assert track.id == "0"
    assert {"flat-coordinate", "no-confidence", "frames-left-out"}.isdisjoint(notes)


def test_a_number_of_each_row_is_no_id():
    for name in ("id", "particle", "track"):
        (track,), _ = read(clip(**{name: np.arange(70) + 900, "frame": FRAME}))
        assert_is_the_bounce(track)
    for name in ("Track n°", "tracker_id", "TID"):
        (track,), _ = read(clip(id=np.arange(70), **{name: [3] * 70}, frame=FRAME))
        assert track.id == "3"


BOXES = {
    "x_min": X - 16.0,
    "y_min": Y - 15.0,
    "x_max": X + 16.0,
    "y_max": Y + 15.0,
}


def test_boxes_of_detectors_are_read_by_their_centres():
    corners = pd.DataFrame(BOXES)
    sizes = pd.DataFrame(
        {"bb_left": X - 16.0, "bb_top": Y - 15.0, "bb_width": 32.0, "bb_height": 30.0}
    )
    mot = pd.DataFrame(
        {"FrameId": FRAME, "Id": 1, "X": X - 9.0, "Y": Y, "Width": 18.0, "Height": 2.0}
    )
    for table in (corners, corners.set_axis(["x1", "y1", "x2", "y2"], axis=1), sizes):
        (track,), _ = read(table.assign(frame=FRAME))
        assert_is_the_bounce(track)
        assert_allclose(track.x, X * 2e-3)
        assert_allclose(track.y, -Y * 2e-3)
    (track,), _ = read(mot)
    assert_allclose(track.x, X * 2e-3)
    two_balls = pd.DataFrame({"frame": FRAME, "x1": X, "y1": Y, "x2": Y, "y2": X})
    assert refused(two_balls).code == "no-positions"


def test_classes_of_detectors_are_objects():
    ball = pd.DataFrame({**BOXES, "class_name": "sports ball", "class_id": 32, "frame": FRAME})
    racket = pd.DataFrame(
        {
            "x_min": RACKET[:, 0],
            "y_min": RACKET[:, 1],
            "x_max": RACKET[:, 0] + 40.0,
            "y_max": RACKET[:, 1] + 90.0,
            "class_name": "tennis racket",
            "class_id": 38,
            "frame": np.arange(COUNT),
        }
    )
    both = pd.concat([ball, racket]).sort_values("frame", kind="stable")
    (track,), notes = read(both)
    assert_is_the_bounce(track)
    assert "objects" in notes
    numbers = both.drop(columns="class_name")
    assert refused(numbers).code == "several-objects"
    (track,), _ = read(numbers, ball="32")
    assert_is_the_bounce(track)


def test_clips_whose_ids_name_balls_stay_clips():
    first = clip(id="ball 7 shot 1", frame=FRAME)
    second = clip(id="shot 2", frame=FRAME + 500)
    tracks, notes = read(pd.concat([first, second]))
    assert [track.id for track in tracks] == ["ball 7 shot 1", "shot 2"]
    assert "objects" not in notes
    tracks, notes = read(pd.concat([first, second.assign(frame=FRAME)]))
    assert [track.id for track in tracks] == ["ball 7 shot 1"]
    assert "objects" in notes


# ---- frames without a ball


def test_confidence_below_the_limit_everywhere_is_said():
    heads = {"confidence": 0.62, "likelihood": 0.62, "score": 0.62, "conf (%)": 62, "score %": 62}
    for name, number in heads.items():
        table = clip(frame=FRAME, **{name: number})
        error = refused(table)
        assert error.code == "low-confidence"
        _, _, remedy = str(error).partition("--min-confidence ")
        (track,), notes = read(table, min_confidence=float(remedy))
        assert_is_the_bounce(track)
        assert notes == ["no-unit"]
    some = clip(frame=FRAME, confidence=np.where(FRAME % 7, 0.95, 0.4))
    (track,), notes = read(some)
    assert_is_the_bounce(track, FRAME % 7 > 0)
    assert "frames-left-out" in notes


def test_qualities_that_are_no_share_are_not_used():
    (track,), notes = read(clip(frame=FRAME, quality=12.0))
    assert_is_the_bounce(track)
    assert "no-confidence" in notes
    (track,), notes = read(clip(frame=FRAME, **{"quality [%]": np.where(FRAME % 7, 95.0, 40.0)}))
    assert_is_the_bounce(track, FRAME % 7 > 0)


def test_labels_of_frames(tmp_path):
    (track,), notes = read_text(tmp_path, labels_of_frames())
    assert_is_the_bounce(track, places=2.1e-3)
    assert "frames-left-out" in notes
    assert "rows-counted" not in notes


@pytest.mark.parametrize("code", [0.0, -1.0, -999.0])
def test_codes_in_place_of_positions_are_left_out(code):
    table = pd.DataFrame({"frame": range(COUNT), "x": code, "y": code})
    table.loc[FRAME, "x"] = X
    table.loc[FRAME, "y"] = Y
    (track,), notes = read(table)
    assert_is_the_bounce(track)
    assert "frames-left-out" in notes
    # So it is for each ball of a file, whatever rows of others stand between.
    both = pd.concat([table.assign(id="a"), table.assign(id="b", x=table["x"] + 1.0)])
    tracks, _ = read(both.sort_values("frame", kind="stable"))
    assert len(tracks[0].x) == len(FRAME)


def test_a_ball_at_zero_is_no_code():
    nearest = np.abs(METRES[:, 1]).argmin()
    table = pd.DataFrame(
        {"frame": FRAME, "x [m]": METRES[:, 0] - METRES[nearest, 0], "y [m]": METRES[:, 1]}
    )
    table.loc[nearest, "y [m]"] = 0.0
    (track,), notes = read(table, y="up", mm_per_px=None)
    assert len(track.x) == len(FRAME)
    assert notes == []


@pytest.mark.parametrize("word", ["0", "False", "no"])
def test_a_ball_that_is_not_visible_is_left_out(word):
    seen = np.where(FRAME % 7, "1", word)
    for name in ("visibility", "visible", "detected", "valid"):
        (track,), notes = read(clip(frame=FRAME, **{name: seen}))
        assert_is_the_bounce(track, FRAME % 7 > 0)
        assert "frames-left-out" in notes
    (track,), notes = read(clip(frame=FRAME, visibility=-1))
    assert_is_the_bounce(track)
    assert "frames-left-out" not in notes


# ---- three coordinates


def test_a_coordinate_that_hardly_moves_is_none():
    (track,), notes = read(clip(frame=FRAME, z=0.0))
    assert_is_the_bounce(track)
    assert "flat-coordinate" not in notes
    (track,), notes = read(clip(frame=FRAME, z=np.sin(FRAME)))
    assert_is_the_bounce(track)
    assert "flat-coordinate" in notes


def in_space(direction, sideways=0.0):
    """The bounce in three coordinates [mm], z upwards, along a direction [rad]."""
    x = 1e3 * METRES[:, 0]
    off = sideways * np.maximum(x, 0.0)
    return {
        "ball X [mm]": np.cos(direction) * x - np.sin(direction) * off + 900.0,
        "ball Y [mm]": np.sin(direction) * x + np.cos(direction) * off + 100.0,
        "ball Z [mm]": 1e3 * METRES[:, 1],
    }


@pytest.mark.parametrize("direction", [0.0, 0.6, np.pi / 2.0, 2.5])
def test_three_coordinates_are_put_into_the_plane_of_flight(direction):
    table = pd.DataFrame({"frame": FRAME, **in_space(direction)})
    (track,), _ = read(table, y="up")
    assert_allclose(np.abs(np.diff(track.x)), np.abs(np.diff(METRES[:, 0])), atol=2e-6)
    assert_allclose(np.diff(track.y), np.diff(METRES[:, 1]), atol=1e-9)


def test_a_ball_that_leaves_its_plane_is_refused():
    error = refused(pd.DataFrame({"frame": FRAME, **in_space(0.6, sideways=0.3)}), y="up")
    assert error.code == "three-coordinates"


def test_markers_of_a_motion_capture(tmp_path):
    ezc3d = pytest.importorskip("ezc3d")
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [FPS]
    file["parameters"]["POINT"]["LABELS"]["value"] = ["ball", "racket"]
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    points = np.full((4, 2, COUNT), np.nan)
    points[3] = 1.0
    points[:3, 0, FRAME] = [*in_space(0.6).values()]
    points[:3, 1] = 500.0
    file["data"]["points"] = points
    file.write(str(tmp_path / "film.c3d"))
    (track,), notes = read(tmp_path / "film.c3d", y="up", fps=None)
    assert_allclose(np.diff(track.time), np.diff(TIME), atol=1e-9)
    # The file has single precision.
    assert_allclose(np.diff(track.x), np.diff(METRES[:, 0]), atol=1e-5)
    assert_allclose(np.diff(track.y), np.diff(METRES[:, 1]), atol=1e-5)
    assert "objects" in notes


def test_markers_need_the_package_that_reads_them(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    path = tmp_path / "film.c3d"
    path.write_bytes(b"\x02\x50" + bytes(600))
    error = refused(path)
    assert error.code == "other-format"
    assert "ezc3d" in str(error)
