"""Files of tracked impacts: the table with covariances and scene as calibrate reads them, frames, spins, the page."""

import dataclasses
import json
import re
import tomllib

import numpy as np
import pandas as pd
import pytest
from tracked import SDS, VALUES, covariance, incident, tracks_of

import fitball
from fitball.api.reading import read
from fitball.api.tracking import TrackResult
from fitball.data.scene import Camera, Quantity, Scene, load_scene
from fitball.errors import ParameterError, ResultFolderError
from fitball.report.tracks.document import MOST_PICTURES, pictured, track_json
from fitball.report.tracks.folder import OTHERS, TABLE, write_all
from fitball.tracks import lines
from fitball.tracks.frames import AFTER, BEFORE, NINE
from fitball.tracks.impacts import columns_of, frame_rows, impact_rows, spin_rows
from fitball.tracks.simulate import Film, truth


def written(tmp_path, tracks, figures=False, scene=None):
    """The folder with all files."""
    write_all(tracks, ["clip.csv"], scene, tmp_path, "fitball track clip.csv", figures)
    return tmp_path


def test_calibrate_reads_what_was_written_without_another_word(tmp_path):
    tracks = tracks_of(6)
    table, scene, _notes, _files = read(str(written(tmp_path, tracks) / TABLE))
    assert table.incident_columns == NINE[:3]
    assert tuple(item.name for item in table.measurements) == NINE[3:]
    for k, name in enumerate(NINE):
        column = getattr(table.impacts, name) if k < 3 else table.measurement(name).values
        np.testing.assert_allclose(column, [impact.values[k] for impact in tracks.impacts], rtol=1e-11)
    # The whole matrix, with its order and its units.
    assert table.covariance.columns == NINE
    for found in table.covariance.values:
        np.testing.assert_allclose(found, covariance(), rtol=1e-9, atol=1e-14)
    assert scene.camera == tracks.camera
    assert scene.camera.scale == Quantity(1.0, 0.01)


def test_what_the_session_shares_is_a_parameter_of_the_fit_and_in_no_row(tmp_path):
    """Scale, tilt and height are in `[camera]` alone: the rows' covariances do not change with them."""
    narrow = tracks_of(4, camera=Camera(scale=Quantity(1.0, 1e-4)))
    wide = tracks_of(4, camera=Camera(scale=Quantity(1.0, 0.05), court_height=Quantity(0.0, 0.02)))
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    one, two = (written(tmp_path / name, it) for name, it in (("a", narrow), ("b", wide)))
    assert (one / OTHERS[0]).read_bytes() == (two / OTHERS[0]).read_bytes()
    assert (one / TABLE).read_bytes() == (two / TABLE).read_bytes()
    assert load_scene(two / TABLE).camera.court_height == Quantity(0.0, 0.02)
    names = {
        parameter.name
        for parameter in fitball.api.pose(str(two / TABLE), fitball.api.calibrating.Choices(None)).parameters
    }
    assert {"scale", "court_height"} <= names


def test_spins_that_are_not_sure_are_empty_and_calibrate_goes_on(tmp_path):
    tracks = tracks_of(8, unsure=(1, 4))
    folder = written(tmp_path, tracks)
    frame = pd.read_csv(folder / TABLE, dtype={"id": str}).set_index("id")
    empty = frame[["omega_1 [rad/s]", "omega_1_sd [rad/s]", "omega_2 [rad/s]", "gap_turn [rad]"]].isna()
    assert empty.loc[["2", "5"]].all(axis=None)
    assert not empty.drop(index=["2", "5"]).any(axis=None)
    assert not frame[["v_x1 [m/s]", "gap_time [s]", "gap_path_sd [m]"]].isna().any(axis=None)
    entries = pd.read_csv(folder / OTHERS[0], dtype={"id": str})
    assert (
        not entries[entries["id"].isin(["2", "5"])][["column_1", "column_2"]]
        .isin(["omega_1", "gap_turn"])
        .any(axis=None)
    )
    table, *_rest = read(str(folder / TABLE))
    assert len(table) == 6
    assert sum("omega_1 of the incident ball was not measured" in str(note) for note in table.notices) == 2
    spins = pd.read_csv(folder / "spins.csv", dtype={"id": str})
    assert (spins.groupby("id").size() == 2).all()
    chosen = spins[spins["used"] == "yes"]
    assert list(chosen["id"]) == ["1", "3", "4", "6", "7", "8"]
    assert spins.loc[spins["id"] == "2", "probability"].tolist() == [0.8, 0.2]


def test_without_marks_there_are_no_columns_of_spin(tmp_path):
    tracks = tracks_of(4, film=Film(fold=None), unmarked=range(4))
    assert columns_of(tracks) == ["v_x1", "v_y1", "v_x2", "v_y2", "gap_time", "gap_path"]
    folder = written(tmp_path, tracks)
    assert not (folder / "spins.csv").exists()
    assert "angle" not in (folder / "tracks.csv").read_text().splitlines()[0]
    table, *_rest = read(str(folder / TABLE))
    assert len(table) == 4 and not table.has_spin


def test_sessions_are_a_label_only_where_there_are_several(tmp_path):
    assert "session" not in impact_rows(tracks_of(3))[0]
    tracks = tracks_of(4, sessions=("left", "right"))
    table, *_rest = read(str(written(tmp_path, tracks) / TABLE))
    assert table.labels["session"] == ("left", "right", "left", "right")


def test_every_frame_is_in_the_table_of_frames_with_its_role():
    tracks = tracks_of(2)
    rows = list(frame_rows(tracks))
    assert len(rows) == sum(impact.track.time.size for impact in tracks.impacts)
    first = [row for row in rows if row["id"] == "1"]
    roles = [row["role"] for row in first]
    assert roles == sorted(roles, key=["before", "contact", "after"].index)
    impact = tracks.impacts[0]
    for row, k in zip(first, range(len(first)), strict=True):
        assert row["frame"] == impact.track.frame[k]
        assert (row["role"] == "contact") == (row["outlier"] is None) == (row["residual_x [mm]"] is None)
    off = next(k for k in range(len(first)) if impact.role[k] == BEFORE)
    assert first[off]["residual_y [mm]"] == pytest.approx(1e3 * impact.residual[off, 1], rel=1e-10)
    assert first[off]["outlier"] == pytest.approx(1.0 - impact.weight[off], abs=1e-6)


def test_a_scene_keeps_its_keys_and_gets_the_camera_that_was_found(tmp_path):
    scene = tmp_path / "session.toml"
    scene.write_text('[ball]\nmass = 0.0575\n[surface]\nname = "clay"\n[camera]\nfps = 240\nscale = 1.0\n')
    (tmp_path / "out").mkdir()
    folder = written(tmp_path / "out", tracks_of(3), scene=scene)
    tree = tomllib.loads((folder / "impacts.toml").read_text())
    assert tree["surface"] == {"name": "clay"} and tree["ball"] == {"mass": 0.0575}
    assert tree["camera"]["scale"] == {"value": 1.0, "sd": 0.01}
    assert "3 impacts" in tree["source"]["description"]
    assert load_scene(folder / TABLE).surface == "clay"


def test_files_are_written_all_or_none(tmp_path, monkeypatch):
    def fail(*_args):
        raise ResultFolderError("the disk is full")

    monkeypatch.setattr("fitball.report.tracks.folder.csv_text", fail)
    with pytest.raises(ResultFolderError):
        written(tmp_path, tracks_of(2))
    assert list(tmp_path.iterdir()) == []


def test_the_page_has_the_answer_first_and_says_which_pictures_it_leaves_out(tmp_path):
    tracks = tracks_of(MOST_PICTURES + 3, unsure=(14,))
    folder = written(tmp_path, tracks, figures=True)
    page = (folder / "tracks.html").read_text(encoding="utf-8")
    lead = page[: page.index("<section")]
    assert "15 impacts found in 1 file; 1 track without one" in lead
    assert "Spins of 14 of 15 impacts with marks are sure" in lead
    assert page.count('alt="track and residuals of impact') == MOST_PICTURES
    assert f"Pictures of {MOST_PICTURES} of 15 impacts" in page
    # The doubtful one is among them.
    assert "track and residuals of impact 15" in page
    assert [impact.id for impact in pictured(tracks)][-1] == "15"
    assert "two pairs of spins are possible" in page
    assert page.count('alt="COR and gaps over incident speed"') == 1
    assert "2 frames after the contact" in page


def test_what_the_session_says_of_scale_and_clock_is_among_the_first_lines_of_the_page(tmp_path):
    note = "gravity comes out as 11.9 ± 0.3 m/s²: the scale is 21 % too large or the clock 10 % too fast"
    tracks = dataclasses.replace(tracks_of(3), notes=(note,))
    page = (written(tmp_path, tracks) / "tracks.html").read_text(encoding="utf-8")
    assert "21 % too large" in page[: page.index("<section")].replace("\u00a0", " ")


def test_numbers_for_other_programs_are_json():
    made = json.loads(json.dumps(track_json(tracks_of(3, unsure=(0,))), allow_nan=False))
    assert [item["spins_sure"] for item in made["impacts"]] == [False, True, True]
    assert set(made["impacts"][0]["values"]) == {*NINE} - {"omega_1", "omega_2", "gap_turn"}
    assert made["impacts"][1]["sd"]["v_x1"] == pytest.approx(SDS[0])


def test_five_frame_lines_are_those_of_a_least_squares_line():
    impact = tracks_of(1, film=Film(outliers=0.0)).impacts[0]
    found = lines.five_frame_lines(impact)
    for side, role, rows in ((0, BEFORE, slice(-5, None)), (1, AFTER, slice(0, 5))):
        own = np.flatnonzero(impact.role == role)[rows]
        t = impact.track.time[own]
        up = np.polyfit(t, impact.track.y[own], 1)[0]
        assert found[2 * side] == pytest.approx(np.polyfit(t, impact.track.x[own], 1)[0], rel=1e-9)
        assert found[2 * side + 1] == pytest.approx(-up if side == 0 else up, rel=1e-9)
    # Of a ball that flies to the left the same.
    left = tracks_of(1, film=Film(outliers=0.0, leftward=True)).impacts[0]
    assert left.mirrored and lines.five_frame_lines(left)[0] > 0.0


def test_lines_miss_by_as_much_as_noise_and_five_frames_let_them():
    """sigma f sqrt(12/(N(N^2-1))) is 0.32 m/s for 1 mm, 1000/s and five frames."""
    off = lines.line_errors(tracks_of(60, film=Film(outliers=0.0, lost=0.0)).impacts)
    assert np.sqrt(np.mean(off**2)) == pytest.approx(0.32, rel=0.15)


def test_a_result_is_a_table_a_frame_and_figures(tmp_path):
    tracks = tracks_of(5)
    result = TrackResult(tracks, ("clip.csv",), Scene(camera=tracks.camera))
    assert list(result.frame.index) == ["1", "2", "3", "4", "5"]
    np.testing.assert_allclose(result.table.covariance.values[2], covariance(), rtol=1e-9, atol=1e-14)
    assert len(result.frames) == sum(impact.track.time.size for impact in tracks.impacts)
    assert any("3 on a side are needed" in note for note in result.notes)
    assert result.plot("2").axes and result.plot().axes
    with pytest.raises(ParameterError, match="no impact has this id"):
        result.plot("77")
    places = result.save(tmp_path / "new", figures=False)
    assert {place.name for place in places} == {TABLE, *OTHERS}
    with pytest.raises(ResultFolderError, match=r"has impacts\.csv of an older run"):
        result.save(tmp_path / "new")
    result.save(tmp_path / "new", overwrite=True, figures=False)
    assert re.search(r"5 impacts found in 1 file; 1 track without one\.", result.report())


def test_candidates_are_listed_with_the_most_probable_first():
    rows = spin_rows(tracks_of(2, unsure=(0, 1)))
    assert [row["probability"] for row in rows] == [0.8, 0.2, 0.8, 0.2]
    assert {row["used"] for row in rows} == {"no"}


def test_the_fake_estimator_of_these_tests_is_near_the_truth():
    impacts = incident(6)
    true = truth(impacts, fitball.model("two-mass").rebound(VALUES, impacts))
    pulls = (np.array([impact.values for impact in tracks_of(6).impacts]) - true) / SDS
    assert np.abs(pulls).max() < 4.5
