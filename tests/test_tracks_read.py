"""Files of positions become tracks: every dialect, units, scale, rate; mistakes by code, row, line
and column.
"""

import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from support import trackers
from support.films import RADIUS, Camera, bounces, filmed

import fitball
from fitball import cli
from fitball.base.errors import InputError
from fitball.data.scene import BallSection, CameraSection, Scene
from fitball.tracks.read import read_tracks, scene_of

MISTAKES = tomllib.loads(
    (Path(__file__).parent / "data" / "mistakes.toml").read_text(encoding="utf-8")
)
FPS = 240.0
MM = 0.8
RNG = np.random.default_rng(1)
TABLE = filmed(bounces(2, RNG), Camera(FPS, 1e-4, outliers=0.0, lost=0.0), RNG)
FIRST_CLIP = TABLE[TABLE["id"] == "1"].reset_index(drop=True)
SECOND_CLIP = TABLE[TABLE["id"] == "2"].reset_index(drop=True)
X = FIRST_CLIP["x [m]"].to_numpy()
Y = FIRST_CLIP["y [m]"].to_numpy()
FRAME = FIRST_CLIP["frame"].to_numpy()
TIME = FRAME / FPS
# Positions in pixels, at the scale of MM.
X_PX = 1e3 * X / MM
Y_PX = 1e3 * Y / MM
PIXELS = {"fps": FPS, "mm_per_px": MM}


def with_comma(value):
    return f"{value:.6f}".replace(".", ",")


def write_text(folder, text, name="clip.csv"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def read(source, columns=None, ball=None, **camera):
    """Tracks and notes of one file or frame."""
    scene = Scene(
        camera=CameraSection(**camera),
        ball=ball or BallSection(),
    )
    return read_tracks([source], scene, columns or {})


def read_text(folder, text, **camera):
    """Tracks of a file with this text."""
    tracks, _ = read(write_text(folder, text), **camera)
    return tracks


def assert_same_positions(track, rows=slice(None), x=X, y=Y):
    """Hold that positions are those of the film, and times but for where they begin."""
    steps = np.diff(TIME[rows])
    assert_allclose(track.x, x[rows], atol=2e-5)
    assert_allclose(track.y, y[rows], atol=2e-5)
    assert_allclose(np.diff(track.time), steps, atol=2e-6)


def rows_of(*columns, sign=";"):
    """The lines of a file of these columns."""
    lines = []
    for row in zip(*columns, strict=True):
        cells = map(str, row)
        lines.append(sign.join(cells))
    return "\n".join(lines)


def with_commas(*columns):
    return rows_of(*(map(with_comma, column) for column in columns))


# Times of playback at 30 frames a second, rounded to a millisecond.
PLAYBACK = np.round(FRAME / 30.0, 3)
NAMES = ["a"] * len(X)
IN_SECONDS = {}
IN_FRAMES = {"fps": FPS}
DOWNWARD = {**PIXELS, "y": "down"}
# Header, rows, what the scene states of the camera.
LONG = [
    ("id,t [s],x [m],y [m]", rows_of(NAMES, TIME, X, Y, sign=","), IN_SECONDS),
    ("Time [ms];X [mm];Y [mm]", with_commas(1e3 * TIME, 1e3 * X, 1e3 * Y), IN_SECONDS),
    ("frame x_cm y_cm", rows_of(FRAME, 100 * X, 100 * Y, sign=" "), IN_FRAMES),
    ("bild;x_pos [px];y_pos [px]", rows_of(FRAME, X_PX, Y_PX), PIXELS),
    ("frame\tx\ty", rows_of(FRAME, X_PX, Y_PX, sign="\t"), PIXELS),
    ("t;x;y\ns;cm;cm", rows_of(TIME, 100 * X, 100 * Y), IN_SECONDS),
    ("t,x [m],y [m]", rows_of(PLAYBACK, X, Y, sign=","), IN_FRAMES),
    ("frame,x [px],y [px]", rows_of(FRAME, X_PX, -Y_PX, sign=","), DOWNWARD),
]
HEADERS = [header for header, *_ in LONG]


@pytest.mark.parametrize(("header", "rows", "camera"), LONG, ids=HEADERS)
def test_long_tables_as_people_write_them(tmp_path, header, rows, camera):
    (track,) = read_text(tmp_path, f"{header}\n{rows}\n", **camera)
    assert_same_positions(track)
    if header.startswith("id"):
        assert track.id == "a"
    else:
        assert track.id == "clip"


def test_a_frame_a_workbook_and_a_file_are_read_alike(tmp_path):
    FIRST_CLIP.to_excel(tmp_path / "clip.xlsx", index=False)
    FIRST_CLIP.to_csv(tmp_path / "clip.csv", index=False)
    for source in (FIRST_CLIP, tmp_path / "clip.xlsx", tmp_path / "clip.csv"):
        tracks, _ = read(source, fps=FPS)
        track = tracks[0]
        assert_same_positions(track)
        assert_allclose(track.angle, FIRST_CLIP["angle [rad]"], atol=1e-12)
        assert track.id == "1"
        assert track.fold == 1
        assert track.frame[0] == FRAME[0]


def test_tracker_has_names_above_and_velocities_that_are_left_out(tmp_path):
    head = "mass_A\t\t\t\nt\tx\ty\tv_{x}\n"
    rows = rows_of(TIME, X, Y, [99] * len(X), sign="\t")
    tracks, _ = read(write_text(tmp_path, head + rows, "clip.txt"))
    assert_same_positions(tracks[0])


@pytest.mark.parametrize("head", ["t;x;y;x;y", "t;x;y;t;x;y"])
def test_tracker_has_masses_side_by_side(tmp_path, head):
    count = min(len(X), len(SECOND_CLIP))
    u = SECOND_CLIP["x [m]"].to_numpy()
    v = SECOND_CLIP["y [m]"].to_numpy()
    lines = []
    for k in range(count):
        numbers = [TIME[k], X[k], Y[k]]
        if head.count("t") == 2:
            numbers.append(TIME[k])
        # The second ball is lost in two frames.
        if k in (3, 4):
            cells = [*map(with_comma, numbers), "", ""]
        else:
            cells = map(with_comma, [*numbers, u[k], v[k]])
        lines.append(";".join(cells))
    text = "\n".join([";mass_A;;mass_B;", head, *lines])
    first, second = read_text(tmp_path, text)
    assert first.id == "clip-1"
    assert second.id == "clip-2"
    assert_same_positions(first, slice(count))
    seen = np.delete(np.arange(count), (3, 4))
    assert_same_positions(second, seen, x=u, y=v)


def test_kinovea_has_objects_in_one_table(tmp_path):
    head = '"Time (ms)","Trajectory 1/0/X","Trajectory 1/0/Y","Marker 1/0/X","Marker 1/0/Y"'
    lines = []
    for row in zip(1e3 * (TIME + 1.0), X, Y, strict=True):
        quoted = [f'"{with_comma(value)}"' for value in row]
        lines.append(",".join(quoted) + ",,")
    lines[5] = lines[5][:-1] + '"0,5","0,5"'
    text = "\n".join([head, *lines])
    ball, marker = read_text(tmp_path, text)
    assert_same_positions(ball)
    assert ball.id == "Trajectory 1"
    assert marker.id == "Marker 1"
    assert len(marker.x) == 1


def test_dltdv_counts_rows_and_is_in_pixels(tmp_path):
    lines = ["pt1_cam1_X,pt1_cam1_Y,pt2_cam1_X,pt2_cam1_Y", "NaN,NaN,1,1"]
    for x, y in zip(X_PX, Y_PX, strict=True):
        lines.append(f"{x:.4f},{y:.4f},NaN,NaN")
    text = "\n".join(lines)
    ball, other = read_text(tmp_path, text, **PIXELS)
    assert_same_positions(ball)
    assert ball.id == "clip-pt1_cam1"
    assert ball.frame[0] == 2
    assert len(other.x) == 1


def test_the_ball_itself_is_a_scale(tmp_path):
    errors = 0.01 * RNG.standard_normal(len(X))
    radius = 1e3 * RADIUS / MM * (1.0 + errors)
    table = pd.DataFrame(
        {
            "t": TIME,
            "x [px]": X_PX,
            "y [px]": Y_PX,
            "diameter [px]": 2.0 * radius,
        }
    )
    scene = scene_of([table], Scene(), 0.0, 0.0, f"{2e3 * RADIUS} mm")
    (track,), _ = read_tracks([table], scene, {})
    assert_allclose(track.x, X, rtol=0.01)
    assert scene.ball_value().radius == pytest.approx(RADIUS)
    stated, notes = read(table, ball=BallSection(radius=RADIUS), mm_per_px=0.84)
    assert_allclose(stated[0].x, 1.05 * X)
    assert "scales-differ" in {note.code for note in notes}


def test_frames_without_a_ball_are_left_out():
    table = FIRST_CLIP.assign(quality=1.0)
    table = table.astype({"x [m]": float})
    table.loc[3, "quality"] = 0.5
    table.loc[7, ["x [m]", "y [m]"]] = -999.0
    table.loc[9, "x [m]"] = -99.0
    position = ["x [m]", "y [m]"]
    table.loc[12, position] = table.loc[11, position].to_numpy()
    table.loc[20, "y [m]"] = np.nan
    (track,), notes = read(table, fps=FPS)
    # The 99 m of row 9 is a number like others; four rows are none.
    assert len(track.x) == len(X) - 4
    numbers = track.frame - FRAME[0]
    assert {3, 7, 12, 20}.isdisjoint(numbers)
    assert [note.code for note in notes] == ["frames-left-out"] * 3


def test_rows_in_any_order_names_of_ones_own_labels_and_many_files(tmp_path):
    mixed = FIRST_CLIP.sample(frac=1.0, random_state=1)
    mixed = mixed.rename(columns={"x [m]": "Hor", "y [m]": "Ver"})
    labelled = mixed.assign(surface="clay", mood="good")
    names = {"x": "Hor [m]", "y": "Ver [m]"}
    (track,), _ = read(labelled, names, fps=FPS)
    assert_same_positions(track)
    assert track.labels == {"surface": "clay"}
    FIRST_CLIP.to_csv(tmp_path / "a.csv", index=False)
    FIRST_CLIP.iloc[1:].to_csv(tmp_path / "b.csv", index=False)
    scene = Scene(camera=CameraSection(fps=FPS))
    tracks, _ = read_tracks([tmp_path / "a.csv", tmp_path / "b.csv"], scene, {})
    assert [track.id for track in tracks] == ["1 (1)", "1 (2)"]
    # Without ids a clock that starts again begins a clip, whatever is missing between.
    both = pd.concat([FIRST_CLIP, SECOND_CLIP], ignore_index=True)
    both = both.drop(columns="id").astype({"frame": float})
    for last in (FRAME[-1], np.nan):
        both.loc[len(FIRST_CLIP) - 1, "frame"] = last
        tracks, _ = read(both, fps=FPS)
        assert [track.id for track in tracks] == ["positions-1", "positions-2"]


def test_times_of_playback_count_frames_that_are_missing():
    number = np.arange(len(X)) % 5
    seen = np.flatnonzero((number != 2) & (number != 3))
    table = pd.DataFrame({"t": PLAYBACK, "x [m]": X, "y [m]": Y})
    tracks, _ = read(table.iloc[seen], fps=FPS)
    assert_same_positions(tracks[0], seen)


def test_a_rolling_shutter_reads_lower_rows_later():
    table = FIRST_CLIP.drop(columns=["x [m]", "y [m]"])
    table = table.assign(**{"x [px]": X_PX, "y [px]": -Y_PX})
    (still,), _ = read(table, **PIXELS, y="down", row_time=0.0)
    (late,), _ = read(table, **PIXELS, y="down", row_time=1e-6)
    assert_allclose(late.time - still.time, 1e-6 * -Y_PX, atol=1e-15)


@pytest.mark.parametrize("case", MISTAKES["film"], ids=lambda case: case["faults"][0])
def test_mistakes_are_told_by_place(tmp_path, case):
    path = write_text(tmp_path, case["text"])
    camera = case.get("camera", {})
    with pytest.raises(InputError) as caught:
        read(path, case.get("columns"), **camera)
    faults = []
    for fault in caught.value.faults:
        numbers = (fault.row, fault.line, fault.column)
        written_out = ["-" if number is None else str(number) for number in numbers]
        faults.append(" ".join([fault.code, *written_out]))
    assert sorted(faults) == sorted(case["faults"])


def test_frames_of_no_confidence_at_all_are_used_where_the_limit_is_zero(tmp_path):
    path = tmp_path / "film.csv"
    trackers.clip(frame=trackers.FRAME, confidence=0.0).to_csv(path, index=False)
    path.with_suffix(".toml").write_text('[camera]\nfps = 240\nmm_per_px = 2.0\ny = "down"\n')
    with pytest.raises(InputError) as caught:
        fitball.track(path)
    assert caught.value.code == "low-confidence"
    _, _, limit = str(caught.value).partition("--min-confidence ")
    options = ["--min-confidence", limit, "--figures", "none"]
    assert cli.main(["track", str(path), *options, "--out", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "impacts.csv").exists()
