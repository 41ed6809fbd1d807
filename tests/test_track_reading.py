"""Files of positions become tracks: every dialect, units, scale, axes, and words for what cannot be read."""

from __future__ import annotations

import filmed
import h5py
import numpy as np
import pandas
import pytest

from fitball.data.bundled import bundled_tracks, resolve_tracks
from fitball.data.scene import Scene, load_scene
from fitball.errors import TableError, TrackError
from fitball.tracks.clips import Reading
from fitball.tracks.filmed import assumptions_of, density_of, filmed_from, like_table_tennis, reading_from
from fitball.tracks.motion import bounces
from fitball.tracks.read import read_tracks
from fitball.tracks.split import bounces_of, split_bounces
from fitball.values import Ball

SHOT = filmed.film(noise=2e-4)
MM_PER_PX = 0.8


def written(tmp_path, text, name="clip.csv", encoding="utf-8"):
    place = tmp_path / name
    place.write_text(text, encoding=encoding)
    return place


def read_one(place, **how):
    (track,) = read_tracks([place], Reading(**how))
    return track


def same_place(track, shot=SHOT, within=2e-5):
    """Positions are those of the film, apart from where the axes begin."""
    assert len(track.time) == len(shot.time)
    for found, true in ((track.x, shot.place[:, 0]), (track.y, shot.place[:, 1]), (track.time, shot.time)):
        np.testing.assert_allclose(found - found[0], true - true[0], atol=within)


def pixels(shot=SHOT, down=True):
    """Columns and rows of a picture 1,080 px high, counted from 0 at the top."""
    place = 1e3 * shot.place / MM_PER_PX + np.array([500.0, 100.0])
    return np.column_stack([place[:, 0], 1079.0 - place[:, 1] if down else place[:, 1]])


def test_a_long_table(tmp_path):
    track = read_one(written(tmp_path, filmed.long_table(SHOT, **{"angle [deg]": np.degrees(SHOT.angle)})))
    same_place(track)
    assert track.id == "a" and track.fold == 1 and track.line[0] == 2
    np.testing.assert_allclose(track.angle, SHOT.angle, atol=1e-6)


def test_semicolons_decimal_commas_millimetres_and_milliseconds(tmp_path):
    rows = [
        ";".join(["7", filmed.comma(1e3 * t), filmed.comma(1e3 * x), filmed.comma(1e3 * y), "2"])
        for t, (x, y) in zip(SHOT.time, SHOT.place, strict=True)
    ]
    track = read_one(written(tmp_path, "\n".join(["id;t [ms];x [mm];y [mm];angle_fold", *rows])))
    same_place(track)
    assert track.id == "7" and track.fold == 2


def test_units_in_a_row_below_the_header_and_a_workbook(tmp_path):
    frame = pandas.DataFrame({"Time": SHOT.time, "X": 1e2 * SHOT.place[:, 0], "Y": 1e2 * SHOT.place[:, 1]})
    rows = [["s", "cm", "cm"], *frame.to_numpy().tolist()]
    place = tmp_path / "clip.xlsx"
    pandas.DataFrame(rows, columns=list(frame)).to_excel(place, index=False)
    same_place(read_one(place))


def test_a_data_frame_is_read_as_a_file_is(tmp_path):
    frame = pandas.DataFrame({"frame": np.arange(len(SHOT.time)), "x [px]": pixels()[:, 0], "y [px]": pixels()[:, 1]})
    place = tmp_path / "clip.csv"
    frame.to_csv(place, index=False)
    how = Reading(fps=240.0, metres_per_px=1e-3 * MM_PER_PX)
    (one,), (other,) = read_tracks([frame], how), read_tracks([place], how)
    same_place(one)
    np.testing.assert_array_equal(one.x, other.x)
    assert one.notes == other.notes and one.source == "DataFrame"


def test_tracker_one_mass_with_tabs_and_velocities_that_are_left_out(tmp_path):
    rows = [f"{t:.5f}\t{x:.6f}\t{y:.6f}\t99" for t, (x, y) in zip(SHOT.time, SHOT.place, strict=True)]
    track = read_one(written(tmp_path, "\n".join(["mass_A", "t\tx\ty\tv_{x}", *rows]), "clip.txt"))
    same_place(track)
    assert "read as an export of Tracker" in track.notes


@pytest.mark.parametrize("shared", [True, False])
def test_tracker_masses_side_by_side_with_decimal_commas(tmp_path, shared):
    other = filmed.film(v_1=(12.0, -6.0), v_2=(8.0, 4.5))
    names, head = (";mass_A;;;mass_B;", "t;x;y;vx;x;y") if shared else ("mass_A;;;mass_B;;", "t;x;y;t;x;y")
    lines = []
    for k, t in enumerate(SHOT.time):
        (x, y), (u, v) = SHOT.place[k], other.place[k]
        middle = [9.0] if shared else [t]
        # The second ball was lost in some frames.
        lost = ["", ""] if k in (3, 4) else [filmed.comma(u), filmed.comma(v)]
        lines.append(";".join([*map(filmed.comma, (t, x, y, *middle)), *lost]))
    place = written(tmp_path, "\n".join([names, head, *lines]))
    one, two = read_tracks([place])
    assert (one.id, two.id) == ("clip-mass_A", "clip-mass_B")
    same_place(one)
    kept = np.delete(np.arange(len(SHOT.time)), (3, 4))
    np.testing.assert_allclose(two.x, other.place[kept, 0], atol=1e-5)
    np.testing.assert_allclose(np.diff(two.time), np.diff(other.time[kept]), atol=2e-5)


def test_kinovea_two_tracks_one_below_the_other(tmp_path):
    """At 25 frames/s, as its text export writes them: hundredths of a second, pixels from the bottom."""
    shot = filmed.film(fps=25.0, seconds=0.4, v_1=(3.0, -5.0), v_2=(2.2, 4.0))
    stamps = [f"0:00:{int(t):02d}:{round(100 * t) % 100:02d}" for t in np.arange(len(shot.time)) / 25.0]
    lines = [f"{t} {x:.2f} {y:.2f} " for t, (x, y) in zip(stamps, pixels(shot, down=False), strict=True)]
    text = "\n".join(["#Kinovea Trajectory data export", "#T X Y", "", *lines, "", *lines])
    one, two = read_tracks([written(tmp_path, text, "kinovea.txt")], Reading(metres_per_px=1e-3 * MM_PER_PX))
    assert (one.id, two.id) == ("kinovea-1", "kinovea-2")
    same_place(one, shot, within=1e-4)
    np.testing.assert_array_equal(one.y, two.y)


def test_kinovea_with_semicolons_and_milliseconds(tmp_path):
    lines = [f"{1e3 * t:.3f};{100 * x:.4f};{100 * y:.4f}" for t, (x, y) in zip(SHOT.time, SHOT.place, strict=True)]
    track = read_one(written(tmp_path, "\n".join(["Time (ms);X;Y", *lines]).replace(".", ",")), unit="cm")
    same_place(track)


def test_kinovea_one_table_of_objects_in_quotes_with_times_in_ms_of_no_unit(tmp_path):
    head = '"Time","Trajectory 1/0/X","Trajectory 1/0/Y","Marker 1/0/X","Marker 1/0/Y"'
    lines = [
        ",".join(f'"{filmed.comma(v)}"' for v in (1e3 * (t + 1.0), x, y)) + (',"0,5","0,5"' if k == 2 else ",,")
        for k, (t, (x, y)) in enumerate(zip(SHOT.time, SHOT.place, strict=True))
    ]
    track, marker = read_tracks([written(tmp_path, "\n".join([head, *lines]))])
    same_place(track)
    assert (track.id, marker.id, len(marker.time)) == ("Trajectory 1", "Marker 1", 1)
    assert any("read as milliseconds" in note for note in track.notes)


@pytest.mark.parametrize("down", [True, False])
def test_dltdv_counts_y_from_the_top_or_the_bottom_and_it_is_said(tmp_path, down):
    place = pixels(down=down)
    lines = ["NaN,NaN,1,1"] + [f"{x:.3f},{y:.3f},NaN,NaN" for x, y in place]
    text = "\n".join(["pt1_cam1_X,pt1_cam1_Y,pt2_cam1_X,pt2_cam1_Y", *lines])
    ball, _other = read_tracks([written(tmp_path, text)], Reading(fps=240.0, metres_per_px=1e-3 * MM_PER_PX))
    same_place(ball)
    assert ball.id == "clip-pt1" and ball.frame[0] == 2
    assert any(note.startswith("y was read as downwards") for note in ball.notes) == down
    # A rolling shutter reads rows from the top, whatever the program counts.
    np.testing.assert_allclose(np.diff(ball.row), np.diff(pixels(down=True)[:, 1]), atol=2e-3)


def test_deeplabcut_leaves_out_what_it_is_not_sure_of(tmp_path):
    lines = [f"{k},{x:.3f},{y:.3f},{0.3 if k == 5 else 0.99},9,9,0.1" for k, (x, y) in enumerate(pixels())]
    head = [
        "scorer,DLC,DLC,DLC,DLC,DLC,DLC",
        "bodyparts,ball,ball,ball,net,net,net",
        "coords,x,y,likelihood,x,y,likelihood",
    ]
    track = read_one(written(tmp_path, "\n".join([*head, *lines])), fps=240.0, metres_per_px=1e-3 * MM_PER_PX)
    assert track.id == "ball" and 5 not in track.frame and len(track.frame) == len(SHOT.time) - 1
    assert any("1 of 49 frames with a quality below 0.9 left out" in note for note in track.notes)


def turned(shot, angle=0.6, bend=0.0):
    """The film in three dimensions, x away at an angle, the flight turned by `bend` after the bounce."""
    along, height = shot.place.T
    direction = np.where(shot.time > 0.0, angle + bend, angle)
    return np.column_stack([along * np.cos(direction), height + 0.76, along * np.sin(direction)])


@pytest.mark.parametrize("separate", [True, False])
def test_hdf5_in_three_dimensions_whose_second_axis_points_up(tmp_path, separate):
    place, xyz = tmp_path / "clip.hdf5", turned(SHOT)
    with h5py.File(place, "w") as file:
        group = file.create_group("originals/3")
        if separate:
            for name, column in zip(("t", "x", "y", "z"), (SHOT.time, *xyz.T), strict=True):
                group[name] = column
        else:
            group["time_stamps"], group["positions"] = SHOT.time, xyz
    track = read_one(place)
    same_place(track, within=1e-3)
    assert track.id == "3" and any(note.startswith("y points upwards") for note in track.notes)
    assert not any("turns by" in note for note in track.notes)


def test_a_flight_that_leaves_its_plane_is_said(tmp_path):
    place = tmp_path / "clip.h5"
    with h5py.File(place, "w") as file:
        file["t"], (file["x"], file["y"], file["z"]) = SHOT.time, turned(SHOT, bend=0.1).T
    (note,) = [note for note in read_one(place).notes if "turns by" in note]
    # From x to y of the horizontal plane by 0.1 rad.
    assert "turns by 5.7 ±" in note


def test_a_file_without_header_or_time_needs_a_rate(tmp_path):
    text = "\n".join(",".join(f"{v:.5g}" for v in row) for row in turned(SHOT)[:, [0, 2, 1]])
    place = written(tmp_path, text)
    with pytest.raises(TableError, match=r"frames 1 to 49 and no time; expected the frame rate: pass fps=N"):
        read_tracks([place])
    track = read_one(place, fps=240.0)
    same_place(track, within=1e-3)
    assert "the file has no header: columns were read as x, y, z" in track.notes


def test_pixels_need_a_scale_and_the_ball_itself_is_one(tmp_path):
    radius = 1e3 * filmed.RADIUS / MM_PER_PX * (1.0 + 0.01 * np.random.default_rng(4).standard_normal(len(SHOT.time)))
    table = pandas.DataFrame(
        {"t": SHOT.time, "x [px]": pixels()[:, 0], "y [px]": pixels()[:, 1], "diameter": 2 * radius}
    )
    with pytest.raises(TableError, match=r"clip 'DataFrame' is in pixels; expected their size"):
        read_tracks([table])
    (track,) = read_tracks([table], Reading(ball_diameter=2.0 * filmed.RADIUS))
    assert track.metres_per_px == pytest.approx(1e-3 * MM_PER_PX, rel=0.006)
    assert np.median(track.radius) == pytest.approx(filmed.RADIUS, rel=1e-6)
    (both,) = read_tracks([table], Reading(metres_per_px=0.84e-3, ball=Ball(), states_ball=True))
    assert both.metres_per_px == pytest.approx(0.84e-3)
    (note,) = [note for note in both.notes if "the ball's radius gives" in note]
    assert "the stated scale is 0.84 mm/px" in note and note.endswith("% apart")


def test_numbers_without_a_unit_are_metres_or_refused(tmp_path):
    table = pandas.DataFrame({"t": SHOT.time, "x": SHOT.place[:, 0], "y": SHOT.place[:, 1]})
    (track,) = read_tracks([table])
    assert "coordinates have no unit and were read as metres" in track.notes
    table[["x", "y"]] = pixels()
    with pytest.raises(TableError, match=r"have no unit and span 3\d\d\d.*expected a unit, such as 'x \[px\]'"):
        read_tracks([table])
    (track,) = read_tracks([table], Reading(metres_per_px=1e-3 * MM_PER_PX))
    same_place(track)


def test_a_stated_direction_that_the_ball_contradicts_is_refused():
    table = pandas.DataFrame({"t": SHOT.time, "x [px]": pixels()[:, 0], "y [px]": pixels()[:, 1]})
    scale = {"metres_per_px": 1e-3 * MM_PER_PX}
    (track,) = read_tracks([table], Reading(y_down=True, **scale))
    same_place(track)
    with pytest.raises(TableError, match=r"y is stated to point upwards, but -y does by the motion"):
        read_tracks([table], Reading(y_down=False, **scale))
    swapped = table.rename(columns={"x [px]": "y [px]", "y [px]": "x [px]"})
    with pytest.raises(TableError, match="the ball bounces along x"):
        read_tracks([swapped], Reading(**scale))


def test_a_flight_without_bounce_is_turned_by_gravity():
    time = np.arange(60) / 240.0
    place = filmed.flown(time, (0.0, 1.0), (6.0, 2.0))
    table = pandas.DataFrame({"t": time, "x [m]": place[:, 0], "y [m]": -place[:, 1]})
    (track,) = read_tracks([table])
    np.testing.assert_allclose(track.y, place[:, 1], atol=1e-12)
    assert any("gravity" in note for note in track.notes)


def test_rows_in_no_order_are_sorted_by_time():
    rows = np.random.default_rng(3).permutation(len(SHOT.time))
    table = pandas.DataFrame({"t": SHOT.time[rows], "x [m]": SHOT.place[rows, 0], "y [m]": SHOT.place[rows, 1]})
    (track,) = read_tracks([table])
    np.testing.assert_array_equal(track.x, SHOT.place[:, 0])


def test_many_clips_of_one_table_and_of_files_with_the_same_ids(tmp_path):
    text = filmed.long_table(SHOT)
    one = written(tmp_path, text + text.partition("\n")[2].replace("a,", "b,"), "one.csv")
    two = written(tmp_path, text, "two.csv")
    assert [track.id for track in read_tracks([one, two])] == ["one-a", "b", "two-a"]


def test_files_of_one_name_in_two_folders_are_called_by_their_folders(tmp_path):
    places = [tmp_path / name / "one.csv" for name in ("clay", "hard")]
    for place in places:
        place.parent.mkdir()
        place.write_text(filmed.long_table(SHOT))
    assert [track.id for track in read_tracks(places)] == ["clay-one-a", "hard-one-a"]


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("mm", 1e3)])
def test_a_code_in_the_place_of_a_lost_ball_is_no_position(tmp_path, unit, factor):
    table = pandas.DataFrame({"t": SHOT.time, f"x [{unit}]": factor * SHOT.place[:, 0]})
    table[f"y [{unit}]"] = factor * SHOT.place[:, 1]
    table.loc[[3, 7, 20], [f"x [{unit}]", f"y [{unit}]"]] = -999.0
    # One coordinate alone may be there.
    table.loc[9, f"x [{unit}]"] = -99.0
    (track,) = read_tracks([table], Reading(as_read=True))
    assert len(track.time) == len(SHOT.time) - 3
    assert any(f"3 of {len(SHOT.time)} frames left out" in note for note in track.notes)


def mistaken(tmp_path, old, new, count=1):
    return written(tmp_path, filmed.long_table(SHOT).replace(old, new, count))


def test_mistakes_are_named_with_row_and_column(tmp_path):
    line = filmed.long_table(SHOT).splitlines()[7]
    folds = filmed.long_table(SHOT, angle=SHOT.angle, fold=np.where(np.arange(len(SHOT.time)) == 8, 2.0, 1.0))
    with pytest.raises(TableError, match=r"column 'angle_fold': clip 'a' has several folds"):
        read_tracks([written(tmp_path, folds)])
    with pytest.raises(TableError, match=r"row 9 .*: read 0.5; expected 1 for a dot, 2 for a stripe"):
        read_tracks([written(tmp_path, folds.replace("2.00000", "0.5"))])
    with pytest.raises(TableError, match=r"row 7 \(line 8\), column 't': read 'soon'"):
        read_tracks([mistaken(tmp_path, line, "a,soon,1,1")])
    with pytest.raises(TableError, match=r"\[furlong\].*unknown"):
        read_tracks([mistaken(tmp_path, "x [m]", "x [furlong]")])
    with pytest.raises(TableError, match=r"read units x \[mm\], y \[m\]; expected one unit"):
        read_tracks([mistaken(tmp_path, "x [m]", "x [mm]")])
    with pytest.raises(TableError, match=r"no header of positions; expected columns x and y"):
        read_tracks([written(tmp_path, "speed,spin\nfast,none\n")])
    with pytest.raises(TableError, match=r"lines 8 and 9; 1 of \d+ frames.*give each ball its own id"):
        read_tracks([mistaken(tmp_path, line, f"{line}\n{line}")])
    with h5py.File(tmp_path / "bad.h5", "w") as file:
        file["positions"] = np.zeros((5, 4))
    with pytest.raises(TableError, match=r"shape \(5, 4\); expected frames x 2 or 3"):
        read_tracks([tmp_path / "bad.h5"])
    with pytest.raises(TableError, match="not an HDF5 file"):
        read_tracks([written(tmp_path, "nothing", "text.h5")])


# Splitting.


def test_each_bounce_of_a_clip_is_a_track_as_far_as_halfway():
    time, place = filmed.bouncing(noise=5e-4)
    (whole,) = read_tracks([pandas.DataFrame({"t": time, "x [m]": place[:, 0], "y [m]": place[:, 1]})])
    parts = split_bounces(whole)
    assert [part.id for part in parts] == [f"DataFrame-{k}" for k in (1, 2, 3)]
    assert sum(len(part.time) for part in parts) == len(time)
    fall = np.sqrt(2.0 * np.array([1.0, 0.55, 0.3]) / filmed.G)
    lands = np.cumsum([fall[0], *(2.0 * fall[1:])])
    for part, land in zip(parts, lands, strict=True):
        assert abs(part.time[np.argmin(part.y)] - land) < 1.5 / 240.0
    np.testing.assert_allclose([part.time[0] for part in parts[1:]], 0.5 * (lands[1:] + lands[:-1]), atol=2.0 / 240.0)


@pytest.mark.parametrize("fps", [60.0, 240.0, 1000.0, 10_000.0])
@pytest.mark.parametrize("spread", [2e-4, 1.5e-3])
def test_one_bounce_is_found_at_every_rate_and_noise(fps, spread):
    shot = filmed.film(fps=fps, seconds=0.1, noise=spread)
    table = pandas.DataFrame({"t": shot.time, "x [m]": shot.place[:, 0], "y [m]": -shot.place[:, 1]})
    (track,) = split_bounces(read_tracks([table])[0])
    assert len(track.time) == len(shot.time)
    np.testing.assert_array_equal(track.y, shot.place[:, 1])


def outlying(shot, share, seed):
    """The film with a share of its frames 5 to 50 mm off, as wrong clicks are."""
    generator, place = np.random.default_rng(seed), shot.place.copy()
    bad = generator.random(len(place)) < share
    place[bad] += generator.choice([-1.0, 1.0], (bad.sum(), 2)) * generator.uniform(0.005, 0.05, (bad.sum(), 2))
    return place


def test_outliers_and_noise_are_no_bounces_and_turn_no_axes():
    """40 clips with a tenth of outliers, or noise of 4 mm."""
    right = 0
    for seed in range(40):
        shot = filmed.film(fps=500.0, noise=2e-3 if seed % 2 else 4e-3, seed=seed, phase=0.02 * seed)
        place = outlying(shot, 0.1 if seed % 2 else 0.0, seed)
        (track,) = read_tracks([pandas.DataFrame({"t": shot.time, "x [m]": place[:, 0], "y [m]": -place[:, 1]})])
        found, refused = bounces_of([track])
        lowest = [abs(part.time[bounces(part.time, part.y)]).min() for part in found]
        right += not refused and len(lowest) == 1 and lowest[0] < 8e-3 and np.array_equal(track.y, place[:, 1])
    assert right >= 38


def refusal_of(time, x, y, **more):
    (track,) = read_tracks([pandas.DataFrame({"t": time, "x [m]": x, "y [m]": y, **more})], Reading(up="y"))
    found, (refused,) = bounces_of([track])
    assert not found
    with pytest.raises(TrackError):
        split_bounces(track)
    return refused.reason


def test_clips_that_hold_no_bounce_are_refused_in_words():
    time, (x, y) = SHOT.time, SHOT.place.T
    assert "the ball falls until the last frame (frames 1 to 20)" in refusal_of(time[:20], x[:20], y[:20])
    assert "the ball rises from the first frame on" in refusal_of(time[28:], x[28:], y[28:])
    few = refusal_of(time[:27], x[:27], y[:27])
    assert "24 frames before the lowest, frame 25, and 2 after it; expected at least 3" in few


def test_another_object_and_two_balls_are_refused_with_frames():
    time, (x, y) = SHOT.time, SHOT.place.T
    radius = np.where((np.arange(len(time)) > 9) & (np.arange(len(time)) < 16), 0.2, 0.033)
    reason = refusal_of(time, x, y, **{"radius [m]": radius})
    assert "another object: the radius is 6.1 times the usual one in frames 11 to 16" in reason
    swapped = np.arange(len(time)) % 2 == 1
    reason = refusal_of(time, np.where(swapped, -x + 3.0, x), np.where(swapped, y + 1.0, y))
    assert "two objects: frames" in reason and "give each ball its own id" in reason
    middle = (np.arange(len(time)) > 9) & (np.arange(len(time)) < 16)
    reason = refusal_of(time, np.where(middle, 5.0 + 0.01 * np.arange(len(time)), x), y)
    assert "two objects: frames 1 to 10 are" in reason


@pytest.mark.parametrize("pause", [0.1, 0.5])
def test_shots_one_after_the_other_in_one_clip_are_divided_where_no_ball_was_seen(tmp_path, pause):
    rows = filmed.long_table(SHOT).splitlines()
    length = SHOT.time[-1] - SHOT.time[0] + pause
    again = [row.split(",") for row in rows[1:]]
    later = [",".join([a, f"{float(t) + k * length:.6f}", *rest]) for k in (1, 2) for a, t, *rest in again]
    tracks = read_tracks([written(tmp_path, "\n".join([*rows, *later]))], Reading(as_read=True))
    if pause < 0.15:
        assert [track.id for track in tracks] == ["a"]
        return
    assert [track.id for track in tracks] == ["a-1", "a-2", "a-3"]
    assert all("divided into 3" in " ".join(track.notes) for track in tracks)
    found, refused = bounces_of(tracks)
    assert len(found) == 3 and not refused
    for track in tracks:
        same_place(track)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        (
            "bounce.MP4",
            "\0ftypmp42",
            "is a film; expected positions of the ball in its frames: open it in a tracking",
        ),
        ("bounce.trk", "<?xml?>", "is a project of Tracker; expected positions"),
        ("impacts.csv", "id,v_x1 [m/s],v_y1 [m/s]\n1,2,3", "this is a table of impacts, not of positions; fitball."),
    ],
)
def test_files_of_other_kinds_are_called_what_they_are(tmp_path, name, text, words):
    with pytest.raises(TableError, match=words):
        read_tracks([written(tmp_path, text, name)])


def test_what_is_tracked_after_the_ball_was_lost_is_left_out_with_its_frames():
    time, (x, y) = SHOT.time.copy(), SHOT.place.T.copy()
    x[-6:], y[-6:] = 9.0 + 0.01 * np.arange(6), 2.0
    # One outlier is none of another object: the estimator weighs it.
    y[10] += 0.8
    (track,) = read_tracks([pandas.DataFrame({"t": time, "x [m]": x, "y [m]": y})], Reading(up="y"))
    (kept,) = split_bounces(track)
    assert len(kept.time) == len(time) - 6 and any("frames 44 to 49 left out" in note for note in kept.notes)


# Bundled positions, and what a scene says of a film.


def test_the_bundled_film_is_read_by_its_name():
    """Launches were repeated by a robot; the court is a table 76 cm high, its ball has a radius of 2 cm."""
    assert bundled_tracks() == ("table_tennis_topspin",)
    place = resolve_tracks("table_tennis_topspin")
    scene = load_scene(place)
    assert like_table_tennis(scene.ball) and "BSD 3-Clause" in scene.citation
    assert "BSD 3-Clause" in place.with_suffix(".LICENSE").read_text(encoding="utf-8")
    tracks = read_tracks(["table_tennis_topspin"], reading_from(scene))
    assert [track.id for track in tracks] == [str(k) for k in range(15)]
    assert all(any("constant spacing" in note for note in track.notes) for track in tracks)
    found, refused = bounces_of(tracks)
    assert [one.id for one in refused] == ["9", "10", "13", "14"]
    for track in found:
        assert 0.755 < track.y.min() < 0.80 and track.x[-1] > track.x[0]
    with pytest.raises(TableError, match=r"no bundled positions of this name \(bundled: table_tennis_topspin\)"):
        read_tracks(["table_tennis_backspin"])


def scene_of(tmp_path, text):
    place = tmp_path / "film.toml"
    place.write_text(text, encoding="utf-8")
    return load_scene(None, place)


def test_a_scene_says_how_its_files_are_read(tmp_path):
    scene = scene_of(
        tmp_path, '[ball]\nradius = 0.0331\n[camera]\nfps = 240\nmm_per_px = 0.8\ny = "down"\nrow_time = 1e-5'
    )
    how = reading_from(scene)
    assert (how.fps, how.metres_per_px, how.y_down, how.states_ball) == (240.0, pytest.approx(8e-4), True, True)
    # What the user states goes before.
    assert reading_from(scene, Reading(fps=120.0, y_down=False)).fps == 120.0
    assert reading_from(scene, Reading(fps=120.0, y_down=False)).y_down is False
    assert filmed_from(scene).row_time == 1e-5 and filmed_from(scene).camera.fps == 240.0
    assert reading_from(Scene()).y_down is None and not reading_from(Scene()).states_ball


def test_what_is_known_of_a_ball_is_that_of_its_kind(tmp_path):
    tennis = filmed_from(Scene())
    assert tennis.contact_time == (4.7e-3, 2e-3, 9e-3) and tennis.spin_sd == 250.0 and tennis.court is None
    assert assumptions_of(Scene()) == ()
    scene = scene_of(tmp_path, "[ball]\nmass = 0.0027\nradius = 0.02\ninertia_ratio = 0.667")
    small = filmed_from(scene, court=0.76)
    # A shell of 0.4 mm of celluloid, 2.2 GPa, as a spring.
    stiffness = 4.0 * 2.2e9 * (4e-4) ** 2 / (0.02 * np.sqrt(3.0 * (1.0 - 0.35**2)))
    assert small.contact_time[0] == pytest.approx(np.pi * np.sqrt(0.0027 / stiffness), rel=0.2)
    assert small.contact_time[1] < 1e-3 < small.contact_time[2] and small.court == 0.76
    assert small.spin_sd * 0.02 == pytest.approx(250.0 * 0.03302) and small.air.drag_sd > tennis.air.drag_sd
    assert any("of table tennis" in words for words in assumptions_of(scene))
    text = "[ball]\nmass = 0.43\nradius = 0.11\n[contact_time]\nvalue = 0.008\nsd = 0.001\n[flight]\nspin_sd = 60\n"
    stated = scene_of(tmp_path, text + "drag = { value = 0.25, sd = 0.02 }\nlift = { value = 0.1, sd = 0.03 }")
    ball = filmed_from(stated)
    assert ball.contact_time == pytest.approx((8e-3, 3e-3, 13e-3)) and ball.spin_sd == 60.0
    assert (ball.air.drag, ball.air.drag_sd, ball.air.lift, ball.air.lift_sd) == (0.25, 0.02, 0.1, 0.03)
    assert assumptions_of(stated) == ()


def test_air_is_that_of_its_temperature_and_pressure(tmp_path):
    assert density_of(Scene()) == pytest.approx(1.204)
    assert density_of(scene_of(tmp_path, "[air]\ndensity = 1.1")) == 1.1
    # Dry air of the standard atmosphere at 2,000 m (ISO 2533): 2 degrees Celsius, 795 hPa, 1.0066 kg/m^3.
    high = scene_of(tmp_path, "[air]\ntemperature = 2.0\npressure = 79501.4")
    assert density_of(high) == pytest.approx(1.0066, rel=1e-3)
    assert filmed_from(high).air.density == density_of(high)
