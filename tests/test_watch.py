"""The road from a film to impacts: times, turned pictures, files, refusals. What finds the ball is
tested with films that show one; here it is a stand-in whose flights are known.
"""

import json
from fractions import Fraction

import numpy as np
import pandas as pd
import pytest
from pandas.testing import assert_frame_equal
from scipy.io import wavfile
from support.clips import tagged, write
from support.sightings import COUNT, SPEEDS, nothing_in, seen_in
from support.sounds import recording

import fitball
from fitball.base.errors import InputError, ParameterError
from fitball.cli import main
from fitball.tracks import watch

pytest.importorskip("av")


@pytest.fixture
def seen(monkeypatch):
    """Sets what is seen in a film by its name."""
    settings = {}

    def find(clip, look, progress):
        """What is seen: by default the known flights."""
        return settings.get(clip.name, seen_in)(clip)

    monkeypatch.setattr(watch, "find_balls", find)
    return settings


def film(folder, name="clip.mp4", **options):
    """A film whose ball is a stand-in."""
    return write(folder / name, count=COUNT, **options)


def speeds(found):
    """The four speeds of the only impact."""
    [row] = found.impacts.to_dict("records")
    return [row[f"{name} [m/s]"] for name in ("v_x1", "v_y1", "v_x2", "v_y2")]


def test_a_film_gives_the_speeds_of_its_ball(tmp_path, seen):
    found = fitball.track(film(tmp_path))
    assert speeds(found) == pytest.approx(SPEEDS, rel=0.015)
    assert list(found.frames) == ["impacts", "tracks", "session", "scales", "positions"]
    assert found.exit_code == 0


def test_positions_that_a_film_leaves_give_the_same_impacts(tmp_path, seen):
    """The table and its scene say all that the film said."""
    seen["clip"] = lambda clip: seen_in(clip, row_time=4e-6, tilt=0.01)
    assert main(["track", str(film(tmp_path)), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    names = {path.name for path in (tmp_path / "out").iterdir()}
    wanted = {"impacts.csv", "positions.csv", "positions.toml", "report.html", "strip-clip.png"}
    assert wanted <= names
    again = fitball.track(tmp_path / "out" / "positions.csv")
    first = pd.read_csv(tmp_path / "out" / "impacts.csv").set_index("id")
    assert_frame_equal(again.impacts, first, check_exact=False, rtol=1e-9, check_names=False)


@pytest.mark.parametrize("rotation", [None, 90, 180, -90])
@pytest.mark.parametrize("tilt", [0.0, 0.03])
def test_rows_are_read_in_whatever_direction_the_camera_was_held(tmp_path, seen, rotation, tilt):
    """4 us a row change speeds by up to 1.4 % where they are not taken into account."""
    seen["clip"] = lambda clip: seen_in(clip, row_time=4e-6, tilt=tilt)
    turned = fitball.track(film(tmp_path, rotation=rotation), mm_per_px=1.4)
    seen["clip"] = lambda clip: seen_in(clip)
    still = fitball.track(film(tmp_path), mm_per_px=1.4)
    assert speeds(turned) == pytest.approx(speeds(still), rel=1e-3)


def test_the_sd_of_a_row_that_is_read_across_widens_the_clock(tmp_path, seen):
    across = fitball.track(film(tmp_path, rotation=90)).scene.camera
    # 1e-7 s/px at 6 m/s, that is 4,286 px/s, are 4.3e-4.
    assert across.clock.sd == pytest.approx(np.hypot(1e-3, 4.3e-4), rel=0.02)
    assert across.row_delay is None


def test_slow_motion_is_undone(tmp_path, seen):
    tags = {"com.android.capture.fps": "240"}
    android = tagged(tmp_path / "clip.mp4", tags, rate=30, count=COUNT)
    assert speeds(fitball.track(android)) == pytest.approx(SPEEDS, rel=0.015)
    apple = tagged(tmp_path / "b.mov", {"com.apple.quicktime.make": "Apple"}, 30, COUNT)
    stated = fitball.track(apple, fps=240)
    assert speeds(stated) == pytest.approx(SPEEDS, rel=0.015)


def test_a_part_of_a_film_has_the_same_impact(tmp_path, seen):
    path = film(tmp_path)
    part = fitball.track(path, to=0.35)
    assert speeds(part) == pytest.approx(speeds(fitball.track(path)), rel=5e-3)
    assert len(part.frames["positions"]) == 0.35 * 240


def test_of_several_films_the_good_ones_go_on(tmp_path, seen, capsys):
    seen["none"] = nothing_in
    paths = [film(tmp_path, "a.mp4"), film(tmp_path, "none.mp4"), film(tmp_path, "b.mp4")]
    (tmp_path / "text.mp4").write_text("no film")
    out = tmp_path / "out"
    words = ["track", *map(str, paths), str(tmp_path / "text.mp4"), "--out", str(out), "--json"]
    assert main(words) == 1
    read = json.loads(capsys.readouterr().out)
    assert [row["id"] for row in read["frames"]["impacts"]] == ["a", "b"]
    assert read["exit_code"] == 1
    assert main(["track", str(paths[1]), "--out", str(tmp_path / "no")]) == 2
    assert not (tmp_path / "no").exists()
    with pytest.raises(InputError) as caught:
        fitball.track([paths[1], tmp_path / "text.mp4"])
    assert [fault.code for fault in caught.value.faults] == ["no-ball", "not-a-film"]


def test_positions_alone(tmp_path, seen):
    out = tmp_path / "out"
    assert main(["track", str(film(tmp_path)), "--film-only", "--out", str(out), "--quiet"]) == 0
    names = {path.name for path in out.iterdir()} - {".fitball-files"}
    assert names == {"positions.csv", "positions.toml", "report.html", "strip-clip.png"}


def test_an_error_in_positions_says_how_to_look_at_them(tmp_path, seen):
    """At a scale of ten times too much no ball falls as on earth."""
    with pytest.raises(InputError) as caught:
        fitball.track(film(tmp_path), mm_per_px=14.0)
    assert caught.value.code == "gravity"
    assert "--film-only" in str(caught.value)


def test_options_and_sources_of_other_kinds_are_refused(tmp_path, seen):
    path = film(tmp_path)
    table = tmp_path / "t.csv"
    table.write_text("t [s],x [m],y [m]\n0,0,0\n")
    for sources, options, code in (
        ([path, table], {}, "mixed-sources"),
        (path, {"columns": {"x": "y"}}, "other-option"),
        (table, {"film_only": True}, "other-option"),
        (table, {"to": 1.0}, "other-option"),
        (path, {"region": "1,2,3"}, "region"),
        (path, {"region": "1,2,0,3"}, "region"),
        ([path, path], {}, "film-twice"),
    ):
        with pytest.raises(ParameterError) as caught:
            fitball.track(sources, **options)
        assert caught.value.code == code


def test_what_a_file_says_of_itself_reaches_no_page(tmp_path, seen):
    """Neither tags nor names of files are read as a page."""
    script = "<script>alert(1)</script>"
    tags = {"title": script, "comment": script, "com.android.capture.fps": script}
    path = tagged(tmp_path / "<b>&x.mp4", tags, rate=240, count=COUNT)
    out = tmp_path / "out"
    assert main(["track", str(path), "--out", str(out), "--quiet"]) == 0
    page = (out / "report.html").read_text(encoding="utf-8")
    assert script not in page
    assert "<b>&x" not in page
    assert "&lt;b&gt;&amp;x" in page


def test_the_sound_of_a_film_and_a_recording_give_bounces(tmp_path, capsys):
    signal, times = recording(3)
    samples = np.round(30_000 * signal).astype("i2")
    wavfile.write(tmp_path / "drops.wav", 48_000, samples)
    out = tmp_path / "out"
    assert main(["track", str(tmp_path / "drops.wav"), "--out", str(out)]) == 0
    assert {"impacts.csv", "bounces.csv", "recording-1.png"} <= {p.name for p in out.iterdir()}
    # The next command: from here, and from the folder of the page.
    assert f"fitball calibrate {out}/impacts.csv," in " ".join(capsys.readouterr().out.split())
    assert "<code>fitball calibrate impacts.csv</code>" in (out / "report.html").read_text("utf-8")
    clip = film_with_sound(tmp_path / "clip.mov", samples)
    heard = fitball.track(clip, sound=True)
    assert np.diff(heard.frames["bounces"]["time [s]"]) == pytest.approx(np.diff(times), abs=3e-4)
    with pytest.raises(InputError) as caught:
        fitball.track(film(tmp_path, "silent.mp4"), sound=True)
    assert caught.value.code == "no-sound"


def film_with_sound(path, samples):
    """Write a film whose sound is not compressed."""
    av = pytest.importorskip("av")
    with av.open(str(path), "w") as container:
        picture = container.add_stream("libx264", rate=30)
        picture.width, picture.height, picture.pix_fmt = 64, 48, "yuv420p"
        sound = container.add_stream("pcm_s16le", rate=48_000)
        sound.layout = "mono"
        for k in range(20):
            frame = av.VideoFrame.from_ndarray(np.zeros((48, 64, 3), np.uint8), "rgb24")
            frame.pts, frame.time_base = k, Fraction(1, 30)
            container.mux(picture.encode(frame.reformat(format="yuv420p")))
        container.mux(picture.encode())
        frame = av.AudioFrame.from_ndarray(samples[None], format="s16", layout="mono")
        frame.sample_rate, frame.pts = 48_000, 0
        container.mux(sound.encode(frame))
        container.mux(sound.encode())
    return path
