"""`fitball track` and `fitball.track`: from files to a folder that calibrate takes, and a user's mistakes."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from tracked import VALUES, incident

import fitball
from fitball.api.filmed import SPREAD
from fitball.api.tracking import _without_impact
from fitball.cli.fitting import _by_weight
from fitball.cli.main import main
from fitball.data.scene import Scene
from fitball.errors import FitballError, ParameterError, TrackError
from fitball.tracks.filmed import filmed_from
from fitball.tracks.frames import NINE, Refused
from fitball.tracks.simulate import Film, simulated_tracks, truth

COUNT = 8


def frame_of(film, count=COUNT, seed=4, px=None):
    """A long table of simulated tracks, in metres, or in pixels with rows downwards."""
    impacts = incident(count, seed)
    rebound = fitball.model("two-mass").rebound(VALUES, impacts)
    parts = []
    for track in simulated_tracks(impacts, rebound, film, np.random.default_rng(seed)):
        part = {"id": track.id, "frame": track.frame}
        if px is None:
            part |= {"t [s]": track.time, "x [m]": track.x, "y [m]": track.y}
        else:
            part |= {"x [px]": 500.0 + track.x / px, "y [px]": 900.0 - track.y / px}
        if track.angle is not None:
            part |= {"angle [deg]": np.degrees(track.angle), "angle_fold": track.fold}
        if track.radius is not None:
            part["radius [m]" if px is None else "radius [px]"] = track.radius / (px or 1.0)
        parts.append(pd.DataFrame(part))
    return pd.concat(parts, ignore_index=True), truth(impacts, rebound)


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """A file of eight impacts, and their truth."""
    frame, true = frame_of(Film(fps=1000.0))
    place = tmp_path_factory.mktemp("film") / "clip.csv"
    frame.to_csv(place, index=False)
    return place, true


def pulls_of(result, true):
    ids = [int(impact.id) - 1 for impact in result.tracks.impacts]
    return np.array(
        [
            (it.values - true[k]) / np.sqrt(np.diagonal(it.covariance))
            for it, k in zip(result.tracks.impacts, ids, strict=True)
        ]
    )


def test_a_clip_becomes_a_folder_that_calibrate_takes(clip, tmp_path, monkeypatch, capsys):
    place, true = clip
    monkeypatch.chdir(tmp_path)
    assert main(["track", str(place), "--court", "0m"]) == 0
    said = capsys.readouterr()
    assert f"{COUNT} impacts found in 1 file." in said.out
    assert "Report: tracks/clip/tracks.html\nNext: fitball calibrate tracks/clip/impacts.csv" in said.out
    folder = tmp_path / "tracks" / "clip"
    names = {item.name for item in folder.iterdir()}
    assert {
        "impacts.csv",
        "impacts_covariance.csv",
        "impacts.toml",
        "tracks.csv",
        "spins.csv",
        "tracks.html",
    } == names
    frame = pd.read_csv(folder / "impacts.csv")
    assert len(frame) == COUNT
    for k, name in enumerate(NINE):
        column = next(head for head in frame.columns if head.startswith(f"{name} ["))
        off = (frame[column] - true[:, k]) / frame[column.replace(" [", "_sd [")]
        assert np.abs(off).max() < 5.0, name
    # Again: only where asked, which is known before the work.
    with monkeypatch.context() as patch:
        patch.setattr("fitball.api.tracking.track", None)
        assert main(["track", str(place)]) == 2
    assert "use --overwrite" in capsys.readouterr().err
    assert main(["track", str(place), "--overwrite", "--quiet", "--no-figures"]) == 0
    assert capsys.readouterr().out == "tracks/clip/impacts.csv\n"


@pytest.mark.slow
def test_calibrate_goes_on_in_one_go(clip, tmp_path, capsys):
    place, _true = clip
    out = tmp_path / "out"
    command = ["track", str(place), "--court", "0m", "--out", str(out), "--calibrate", "--point-only", "--no-figures"]
    assert main(command) == 0
    said = capsys.readouterr()
    assert "impacts: 8 impacts, two-mass model" in said.out
    fit = fitball.load_fit(out / "fit")
    assert {"scale", "tilt", "court_height"} <= set(fit.parameters)
    assert fit.parameters["mu"].point == pytest.approx(VALUES["mu"], abs=0.02)


def test_pixels_downwards_with_a_scale_and_a_row_of_the_court(tmp_path):
    frame, true = frame_of(Film(fps=1000.0, radius_noise=2e-4), px=8e-4)
    for scale, more in (("0.8mm/px", {}), (None, {"ball_diameter": 2.0 * fitball.Ball().radius})):
        result = fitball.track(frame, fps=1000, scale=scale, court="900px", **more)
        assert len(result.tracks.impacts) == COUNT
        assert np.abs(pulls_of(result, true)[:, [1, 4, 6]]).max() < 6.0
    # Stated, the scale is checked by the radius; found by the radius, it is not.
    stated = fitball.track(frame, fps=1000, scale="0.8mm/px", court="900px")
    assert stated.tracks.scale[""].value == pytest.approx(1.0, abs=5 * stated.tracks.scale[""].sd)
    assert result.tracks.scale == {}
    wrong = fitball.track(frame, fps=1000, scale=7.6e-4, court="900px")
    assert wrong.tracks.scale[""].value == pytest.approx(8.0 / 7.6, rel=3e-3)


@pytest.mark.parametrize(("fps", "fold"), [(240.0, 2), (1000.0, 1)])
def test_marks_that_turn_the_other_way_are_refused_and_clockwise_ones_are_read(tmp_path, capsys, fps, fold):
    frame, true = frame_of(Film(fps=fps, fold=fold, width=1.2))
    right = fitball.track(frame, court=0.0)
    frame["angle [deg]"] *= -1.0
    place = tmp_path / "clip.csv"
    frame.to_csv(place, index=False)
    assert main(["track", str(place), "--court", "0mm", "--out", str(tmp_path / "out")]) == 2
    words = capsys.readouterr().err
    assert "the marks turn the other way than was read" in words and "pass --clockwise" in words
    assert not (tmp_path / "out").exists()
    other = fitball.track(place, court=0.0, clockwise=True)
    for one, two in zip(right.tracks.impacts, other.tracks.impacts, strict=True):
        np.testing.assert_allclose(one.values, two.values, rtol=1e-6)
    assert np.nanmax(np.abs(pulls_of(other, true))) < 5.0
    # What is stated against the bounces is accepted with words.
    assert any("other way" in note for note in fitball.track(place, court=0.0, as_read=True).notes)


def test_balls_that_fly_to_the_left_give_the_same_table():
    right, true = frame_of(Film(fps=1000.0))
    left, _true = frame_of(Film(fps=1000.0, leftward=True))
    one, two = (fitball.track(frame, court=0.0) for frame in (right, left))
    places = [0, 1, 3, 4, 6, 7]
    np.testing.assert_allclose(pulls_of(one, true)[:, places], pulls_of(two, true)[:, places], atol=0.1)
    assert np.abs(pulls_of(two, true)).max() < 5.0


def test_json_is_for_other_programs(clip, tmp_path, capsys):
    place, _true = clip
    assert main(["track", str(place), "--json", "--out", str(tmp_path / "o"), "--no-figures"]) == 0
    made = json.loads(capsys.readouterr().out)
    assert len(made["impacts"]) == COUNT and set(made["impacts"][0]["values"]) == set(NINE)


def test_a_scene_beside_the_file_has_ball_and_frame_rate(tmp_path):
    frame, _true = frame_of(Film(fps=1000.0))
    frame.drop(columns="t [s]").to_csv(tmp_path / "a.csv", index=False)
    (tmp_path / "a.toml").write_text('[ball]\nmass = 0.058\n[surface]\nname = "clay"\n[camera]\nfps = 1000\n')
    result = fitball.track(tmp_path / "a.csv", court=0.0)
    assert result.scene.surface == "clay" and result.tracks.filmed.ball.mass == 0.058
    result.save(tmp_path / "out", figures=False)
    assert fitball.load_scene(tmp_path / "out" / "impacts.csv").surface == "clay"


def test_other_balls_have_wider_priors():
    assert filmed_from(Scene()).contact_time == (4.7e-3, 2e-3, 9e-3)
    small = filmed_from(Scene(ball=fitball.Ball(0.0027, 0.02, 0.0027 * 0.02**2 * 0.6)))
    assert small.contact_time[1] < 1e-3 and small.air.drag_sd > 0.05 and small.spin_sd > 400.0
    stated = filmed_from(Scene(contact_time=(1e-3, 1e-4)))
    assert stated.contact_time == pytest.approx((1e-3, 5e-4, 1.5e-3))


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--scale", "0.8"], "expected the size of a pixel, such as 0.8mm/px"),
        (["--scale", "0.8kg/px"], "expected a length with its unit"),
        (["--court", "3"], "expected a height with its unit"),
        (["--court", "800px"], "pixels need a scale"),
        (["--fps", "-5"], "expected a positive number of frames"),
        (["--ball-diameter", "40mm"], "not the diameter of a tennis ball"),
        (["--calibrate", "--json"], "leave one of them out"),
        (["--framerate", "5"], "unknown option"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_mistakes_are_one_line_and_leave_nothing(clip, tmp_path, capsys, more, words):
    out = tmp_path / "out"
    with_exit = pytest.raises(SystemExit) if "--framerate" in more else None
    command = ["track", str(clip[0]), "--out", str(out), *more]
    if with_exit:
        with with_exit as left:
            main(command)
        assert left.value.code == 2
    else:
        assert main(command) == 2
    said = capsys.readouterr()
    assert words in said.err and said.out == "" and not out.exists()


def test_a_film_without_an_impact_gets_words(tmp_path, capsys):
    t = np.arange(60) / 500.0
    frame = pd.DataFrame({"t [s]": t, "x [m]": 10.0 * t, "y [m]": 1.0 + 3.0 * t - 4.903 * t**2})
    frame.to_csv(tmp_path / "lob.csv", index=False)
    assert main(["track", str(tmp_path / "lob.csv")]) == 2
    assert "no impact in 1 track" in capsys.readouterr().err
    with pytest.raises(TrackError, match="no impact in 1 track"):
        fitball.track(frame)
    with pytest.raises(ParameterError, match="ball_diameter"):
        fitball.track(frame, ball_diameter="66")


def test_simulated_tracks_are_read_again_and_have_their_truth(tmp_path, capsys):
    out = tmp_path / "sim"
    command = [
        "simulate",
        "--tracks",
        "v=15..20, theta=20..50",
        "--camera",
        "fps=2000, noise=0.5mm",
        "--impacts",
        "6",
    ]
    assert main([*command, "--out", str(out)]) == 0
    said = capsys.readouterr()
    assert "6 impacts at 2000 frames/s, noise 0.5 mm, view 0.8 m" in said.out
    assert {item.name for item in out.iterdir()} == {"tracks.csv", "tracks.toml", "truth.csv", "simulate.json"}
    result = fitball.track(out / "tracks.csv", court=0.0)
    true = pd.read_csv(out / "truth.csv")
    speed = np.hypot(true["v_x1 [m/s]"], true["v_y1 [m/s]"])
    assert speed.between(15.0, 20.0).all()
    assert np.abs(pulls_of(result, true[[c for c in true if c != "id"]].to_numpy())).max() < 5.0
    # What was expected is what the estimator states.
    row = next(line for line in said.out.splitlines() if line.startswith("v_x1"))
    found = np.median([impact.sd("v_x1") for impact in result.tracks.impacts])
    assert float(row.split()[1]) == pytest.approx(found, rel=0.25)
    first = (out / "tracks.csv").read_bytes()
    assert main([*command, "--out", str(out), "--overwrite", "--quiet"]) == 0
    assert (out / "tracks.csv").read_bytes() == first


def test_default_impacts_are_those_that_the_default_model_can_return(tmp_path):
    """The slowest and flattest of them rebounds too."""
    slowest = f"v={SPREAD['v_1'][0]}, theta={np.degrees(SPREAD['theta_1'][0])} deg"
    command = ["simulate", "--tracks", slowest, "--impacts", "1", "--quiet", "--out", str(tmp_path / "s")]
    assert main(command) == 0


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--tracks", "--camera", "fps=240, noise=1"], "noise=1: expected a unit of length"),
        (["--tracks", "--camera", "fsp=240"], "unknown name 'fsp'"),
        (["--tracks", "--camera", "fps=240, fps=30"], "fps is given twice"),
        (["--tracks", "--camera", "mark=0"], "fold = 0"),
        (["--tracks", "--camera", "lost=2"], "expected a share"),
        (["--tracks", "v=20, x=3"], "unknown quantity 'x'"),
        (["--tracks", "v=20..10"], "an increasing range"),
        (["--tracks", "--model", "brody"], "tracks need a model"),
        (["--tracks", "--impact", "v=3"], "leave out --impact"),
        (["--impact", "v=17, theta=18", "--camera", "fps=3"], "--camera needs --tracks"),
    ],
    ids=lambda value: " ".join(value[-2:]) if isinstance(value, list) else "",
)
def test_mistakes_of_simulated_tracks(tmp_path, capsys, more, words):
    assert main(["simulate", "--out", str(tmp_path / "s"), *more]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"up": "w"}, "expected an axis: x, y or z"),
        ({"fold": 0}, "expected 1 for a dot, 2 for a stripe"),
        ({"unit": "furlong"}, "furlong"),
        ({"columns": {"place": "x"}}, "unknown name 'place': expected one of"),
    ],
)
def test_what_is_stated_of_a_file_is_checked_before_it_is_read(asked, said):
    clip = pd.DataFrame({"frame": [1, 2, 3], "x": [0.0, 0.1, 0.2], "y": [0.5, 0.4, 0.5]})
    with pytest.raises(FitballError, match=said):
        fitball.track(clip, **asked)


def test_a_column_that_is_not_there_is_named(tmp_path):
    place = tmp_path / "clip.csv"
    place.write_text("frame,Ball X,y [m]\n1,0.1,0.5\n2,0.2,0.4\n", encoding="utf-8")
    with pytest.raises(FitballError, match="no column 'Ball Z' for x; the header has frame, Ball X"):
        fitball.track(place, fps=240.0, columns={"x": "Ball Z"})


def test_texts_of_other_columns_go_with_their_clips(tmp_path, capsys):
    """Clips of two courts in one file: their impacts are of two courts."""
    frame, _true = frame_of(Film(fps=1000.0, fold=None))
    odd = frame["id"].astype(int) % 2 == 1
    frame["Belag"] = np.where(odd, "clay", "hard")
    frame["speed"], frame["who"] = "3.5", np.where(frame["frame"] % 2 == 0, "me", "you")
    frame.to_csv(tmp_path / "courts.csv", index=False)
    out = tmp_path / "out"
    assert main(["track", str(tmp_path / "courts.csv"), "--court", "0mm", "--out", str(out), "--no-figures"]) == 0
    made = pd.read_csv(out / "impacts.csv")
    assert list(made.columns[:3]) == ["id", "Belag", "v_x1 [m/s]"] and "who" not in made
    assert list(made["Belag"]) == ["clay" if number % 2 else "hard" for number in made["id"]]
    capsys.readouterr()
    assert main(["datasets", "check", str(out / "impacts.csv")]) == 0
    assert "column Belag: 2 surfaces: clay (4 rows), hard (4)" in capsys.readouterr().out


def test_impacts_without_marks_beside_marked_ones_are_counted(clip, tmp_path, capsys):
    """A fit would leave them out: that is said where they are made, and first where they are read."""
    frame = pd.read_csv(clip[0])
    frame.loc[frame["id"] > 3, "angle [deg]"] = np.nan
    frame.to_csv(tmp_path / "some.csv", index=False)
    out = tmp_path / "out"
    assert main(["track", str(tmp_path / "some.csv"), "--court", "0mm", "--out", str(out), "--no-figures"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "Spins of all 3 impacts with marks are sure. 5 of 8 impacts have no marks" in said
    table = fitball.load_table(out / "impacts.csv")
    lost = next(note for note in table.remarks if "ignored" in note)
    assert lost == "rows 4, 5, 6 and 2 more: ignored, since omega_1 of the incident ball was not measured"
    problem = fitball.api.pose(str(out / "impacts.csv"), fitball.api.calibrating.Choices(None))
    assert _by_weight(problem)[0] == lost


def test_each_reason_is_given_once_and_how_the_files_were_read(tmp_path):
    """Frame numbers called t: read as milliseconds, at 240 frames/s gravity is off by a factor."""
    frame, _true = frame_of(Film(fps=240.0, fold=None, width=1.2))
    frame = frame.drop(columns="t [s]").rename(columns={"frame": "t"})
    with pytest.raises(FitballError, match=r"(?s)g comes out .* were read as milliseconds.*state the rate: fps=N"):
        fitball.track(frame, court=0.0)
    found = fitball.track(frame, court=0.0, fps=240.0)
    assert len(found.tracks.impacts) == 8
    read = [
        replace(it.track, id=str(k), notes=("times as ms", str(k % 2))) for k, it in enumerate(found.tracks.impacts)
    ]
    refused = [Refused(it.id, "a.csv", "no bounce" if k else "two objects") for k, it in enumerate(read)]
    assert _without_impact(read, refused).splitlines() == [
        "no impact in 8 tracks:",
        "  - 0 (a.csv): two objects",
        "  - 1 (a.csv), 2 (a.csv), 3 (a.csv) and 4 more: no bounce",
        "  - how all were read: times as ms",
    ]


def test_x_upwards_is_exchanged_by_name(tmp_path):
    frame, _true = frame_of(Film(fps=1000.0, fold=None))
    turned = frame.rename(columns={"x [m]": "y [m]", "y [m]": "x [m]"})
    with pytest.raises(FitballError, match=r"bounces along x .* exchange the columns: columns={'x': 'y', 'y': 'x'}"):
        fitball.track(turned, court=0.0)
    found = fitball.track(turned, court=0.0, columns={"x": "y", "y": "x"})
    pd.testing.assert_frame_equal(found.frame, fitball.track(frame, court=0.0).frame)


def test_calibrate_knows_positions_when_it_reads_them(clip):
    with pytest.raises(FitballError, match=r"these are positions on film: .* finds their impacts"):
        fitball.load_table(clip[0])
