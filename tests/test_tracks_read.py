"""Files of positions become tracks: every dialect, units, scale, rate; mistakes by code, row, line
and column.
"""

import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support.films import RADIUS, Camera, bounces, filmed

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
ONE, TWO = (TABLE[TABLE["id"] == name].reset_index(drop=True) for name in "12")
X, Y, FRAME = (ONE[name].to_numpy() for name in ("x [m]", "y [m]", "frame"))
TIME = FRAME / FPS


def comma(value):
    return f"{value:.6f}".replace(".", ",")


def written(folder, text, name="clip.csv"):
    place = folder / name
    place.write_text(text, encoding="utf-8")
    return place


def read(source, columns=None, ball=None, **camera):
    scene = Scene(camera=CameraSection(**camera), ball=ball or BallSection())
    return read_tracks([source], scene, columns or {})


def same(track, rows=slice(None), within=2e-5, x=X, y=Y):
    """Positions are those of the film, times too but for where they begin."""
    for found, true in ((track.x, x[rows]), (track.y, y[rows])):
        np.testing.assert_allclose(found, true, atol=within)
    np.testing.assert_allclose(np.diff(track.time), np.diff(TIME[rows]), atol=2e-5)


def rows_of(*columns, sign=";"):
    return "\n".join(sign.join(map(str, row)) for row in zip(*columns, strict=True))


LONG = [
    ("id,t [s],x [m],y [m]", lambda: rows_of(["a"] * len(X), TIME, X, Y, sign=","), {}),
    ("Time [ms];X [mm];Y [mm]", lambda: rows_of(*(map(comma, 1e3 * v) for v in (TIME, X, Y))), {}),
    ("frame x_cm y_cm", lambda: rows_of(FRAME, 100 * X, 100 * Y, sign=" "), {"fps": FPS}),
    (
        "bild;x_pos [px];y_pos [px]",
        lambda: rows_of(FRAME, 1e3 * X / MM, 1e3 * Y / MM),
        {"fps": FPS, "mm_per_px": MM},
    ),
    (
        "frame\tx\ty",
        lambda: rows_of(FRAME, 1e3 * X / MM, 1e3 * Y / MM, sign="\t"),
        {"fps": FPS, "mm_per_px": MM},
    ),
    ("t;x;y\ns;cm;cm", lambda: rows_of(TIME, 100 * X, 100 * Y), {}),
    # Times of playback at 30 frames a second, rounded to a millisecond.
    ("t,x [m],y [m]", lambda: rows_of(np.round(FRAME / 30.0, 3), X, Y, sign=","), {"fps": FPS}),
    (
        "frame,x [px],y [px]",
        lambda: rows_of(FRAME, 1e3 * X / MM, -1e3 * Y / MM, sign=","),
        {"fps": FPS, "mm_per_px": MM, "y": "down"},
    ),
]


@pytest.mark.parametrize(("header", "rows", "camera"), LONG, ids=[header for header, *_ in LONG])
def test_long_tables_as_people_write_them(tmp_path, header, rows, camera):
    (track,), _ = read(written(tmp_path, f"{header}\n{rows()}\n"), **camera)
    same(track)
    assert track.id == ("a" if header.startswith("id") else "clip")


def test_a_frame_a_workbook_and_a_file_are_read_alike(tmp_path):
    ONE.to_excel(tmp_path / "clip.xlsx", index=False)
    ONE.to_csv(tmp_path / "clip.csv", index=False)
    tracks = [
        read(source, fps=FPS)[0][0]
        for source in (ONE, tmp_path / "clip.xlsx", tmp_path / "clip.csv")
    ]
    for track in tracks:
        same(track)
        np.testing.assert_allclose(track.angle, ONE["angle [rad]"], atol=1e-12)
        assert (track.id, track.fold, track.frame[0]) == ("1", 1, FRAME[0])


def test_tracker_has_names_above_and_velocities_that_are_left_out(tmp_path):
    text = "mass_A\t\t\t\nt\tx\ty\tv_{x}\n" + rows_of(TIME, X, Y, [99] * len(X), sign="\t")
    same(read(written(tmp_path, text, "clip.txt"))[0][0])


@pytest.mark.parametrize("head", ["t;x;y;x;y", "t;x;y;t;x;y"])
def test_tracker_has_masses_side_by_side(tmp_path, head):
    count = min(len(X), len(TWO))
    u = TWO["x [m]"].to_numpy()
    v = TWO["y [m]"].to_numpy()
    lines = []
    for k in range(count):
        # The second ball is lost in two frames.
        other = ["", ""] if k in (3, 4) else [comma(u[k]), comma(v[k])]
        again = [comma(TIME[k])] if head.count("t") == 2 else []
        lines.append(";".join([comma(TIME[k]), comma(X[k]), comma(Y[k]), *again, *other]))
    tracks, _ = read(written(tmp_path, "\n".join([";mass_A;;mass_B;", head, *lines])))
    assert [track.id for track in tracks] == ["clip-1", "clip-2"]
    same(tracks[0], slice(count))
    kept = np.delete(np.arange(count), (3, 4))
    same(tracks[1], kept, x=u, y=v)


def test_kinovea_has_objects_in_one_table(tmp_path):
    head = '"Time (ms)","Trajectory 1/0/X","Trajectory 1/0/Y","Marker 1/0/X","Marker 1/0/Y"'
    lines = [
        ",".join(f'"{comma(v)}"' for v in row) + ",,"
        for row in zip(1e3 * (TIME + 1.0), X, Y, strict=True)
    ]
    lines[5] = lines[5][:-1] + '"0,5","0,5"'
    ball, marker = read(written(tmp_path, "\n".join([head, *lines])))[0]
    same(ball)
    assert (ball.id, marker.id, len(marker.x)) == ("Trajectory 1", "Marker 1", 1)


def test_dltdv_counts_rows_and_is_in_pixels(tmp_path):
    lines = [
        "NaN,NaN,1,1",
        *(f"{a:.4f},{b:.4f},NaN,NaN" for a, b in zip(1e3 * X / MM, 1e3 * Y / MM, strict=True)),
    ]
    text = "\n".join(["pt1_cam1_X,pt1_cam1_Y,pt2_cam1_X,pt2_cam1_Y", *lines])
    ball, other = read(written(tmp_path, text), fps=FPS, mm_per_px=MM)[0]
    same(ball)
    assert (ball.id, ball.frame[0], len(other.x)) == ("clip-pt1_cam1", 2, 1)


def test_the_ball_itself_is_a_scale(tmp_path):
    radius = 1e3 * RADIUS / MM * (1.0 + 0.01 * RNG.standard_normal(len(X)))
    table = pd.DataFrame(
        {"t": TIME, "x [px]": 1e3 * X / MM, "y [px]": 1e3 * Y / MM, "diameter [px]": 2.0 * radius}
    )
    scene = scene_of([table], Scene(), 0.0, 0.0, f"{2e3 * RADIUS} mm")
    (track,), _ = read_tracks([table], scene, {})
    np.testing.assert_allclose(track.x, X, rtol=0.01)
    assert scene.ball_value().radius == pytest.approx(RADIUS)
    stated, notes = read(table, ball=BallSection(radius=RADIUS), mm_per_px=0.84)
    np.testing.assert_allclose(stated[0].x, 1.05 * X)
    assert "scales-differ" in {note.code for note in notes}


def test_frames_without_a_ball_are_left_out():
    table = ONE.assign(quality=1.0).astype({"x [m]": float})
    table.loc[3, "quality"] = 0.5
    table.loc[7, ["x [m]", "y [m]"]] = -999.0
    table.loc[9, "x [m]"] = -99.0
    table.loc[12, ["x [m]", "y [m]"]] = table.loc[11, ["x [m]", "y [m]"]].to_numpy()
    table.loc[20, "y [m]"] = np.nan
    (track,), notes = read(table, fps=FPS)
    assert len(track.x) == len(X) - 4 and {3, 7, 12, 20}.isdisjoint(track.frame - FRAME[0])
    assert [note.code for note in notes] == ["frames-left-out"] * 3


def test_rows_in_any_order_names_of_ones_own_labels_and_many_files(tmp_path):
    mixed = ONE.sample(frac=1.0, random_state=1).rename(columns={"x [m]": "Hor", "y [m]": "Ver"})
    (track,), _ = read(
        mixed.assign(surface="clay", mood="good"),
        {"x": "Hor [m]", "y": "Ver [m]"},
        fps=FPS,
    )
    same(track)
    assert track.labels == {"surface": "clay"}
    for name, film in (("a", ONE), ("b", ONE.iloc[1:])):
        film.to_csv(tmp_path / f"{name}.csv", index=False)
    scene = Scene(camera=CameraSection(fps=FPS))
    tracks, _ = read_tracks([tmp_path / "a.csv", tmp_path / "b.csv"], scene, {})
    assert [track.id for track in tracks] == ["1 (1)", "1 (2)"]
    # Without ids a clock that starts again begins a clip, whatever is missing between.
    both = pd.concat([ONE, TWO], ignore_index=True).drop(columns="id").astype({"frame": float})
    for last in (FRAME[-1], np.nan):
        both.loc[len(ONE) - 1, "frame"] = last
        assert [track.id for track in read(both, fps=FPS)[0]] == ["positions-1", "positions-2"]


def test_times_of_playback_count_frames_that_are_missing():
    kept = np.array([k for k in range(len(X)) if k % 5 not in (2, 3)])
    table = pd.DataFrame({"t": np.round(FRAME / 30.0, 3), "x [m]": X, "y [m]": Y}).iloc[kept]
    same(read(table, fps=FPS)[0][0], kept)


def test_a_rolling_shutter_reads_lower_rows_later():
    table = ONE.drop(columns=["x [m]", "y [m]"]).assign(
        **{"x [px]": 1e3 * X / MM, "y [px]": -1e3 * Y / MM}
    )
    (still,), (late,) = (
        read(table, fps=FPS, mm_per_px=MM, y="down", row_time=tau)[0] for tau in (0.0, 1e-6)
    )
    np.testing.assert_allclose(late.time - still.time, 1e-6 * -1e3 * Y / MM, atol=1e-15)


@pytest.mark.parametrize("case", MISTAKES["film"], ids=lambda case: case["faults"][0])
def test_mistakes_are_told_by_place(tmp_path, case):
    with pytest.raises(InputError) as caught:
        read(written(tmp_path, case["text"]), case.get("columns"), **case.get("camera", {}))
    found = [(one.code, one.row, one.line, one.column) for one in caught.value.faults]
    found = [" ".join("-" if part is None else str(part) for part in parts) for parts in found]
    assert sorted(found) == sorted(case["faults"])
