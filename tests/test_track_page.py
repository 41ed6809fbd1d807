"""What `track` writes: files that `calibrate` reads as they are, a page and figures, the command
line.
"""

import json
import re
import shlex
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from support.drawn import bars
from support.films import Camera, bounces, filmed

import fitball
from fitball import cli
from fitball.data.load import load_data
from fitball.data.scene import CameraSection, Scene
from fitball.tracks.types import TRACKED

HOSTILE = "<script>alert(1)</script>\x1b[31m=1+1"


@pytest.fixture(scope="module")
def film():
    rng = np.random.default_rng(20)
    table = filmed(bounces(7, rng), Camera(240, fold=2), rng)
    # A film in which spins are sure in some impacts, ambiguous in others, and one clip has no
    # bounce.
    table.loc[table["id"] == "7", "y [m]"] = 0.1
    table["surface"] = HOSTILE
    # Of a frame "name" is a column, of a file what it is called.
    table = table.rename(columns={"id": "name"})
    scene = Scene(camera=CameraSection(fps=240.0, court=0.0), columns={"x": "x [m]"})
    return fitball.track(table, scene=scene, progress=False)


def test_calibrate_reads_what_track_writes(film, tmp_path):
    names = {path.name for path in film.save(tmp_path / "out", figures=False)}
    assert names >= {
        "impacts.csv",
        "impacts.toml",
        "tracks.csv",
        "spins.csv",
        "session.csv",
        "report.html",
    }
    table, scene = load_data([tmp_path / "out" / "impacts.csv"], None, True)
    assert scene == film.scene
    assert not scene.columns
    assert scene.camera.tilt.sd == pytest.approx(np.radians(0.3), rel=1e-3)
    sure = film.impacts["omega_1 [rad/s]"].notna()
    assert 1 < sure.sum() < len(film.impacts) == 6
    assert [*table.values] == list(TRACKED)
    assert len(table) == sure.sum() == len(film.table)
    for name in TRACKED:
        assert_array_equal(table.values[name], film.table.values[name])
        assert_array_equal(table.sd[name], film.table.sd[name])
    matrix = table.covariance(TRACKED[3:])
    assert np.all(
        np.linalg.eigvalsh(matrix / np.sqrt(np.einsum("rii,rjj->rij", matrix, matrix)))[:, 0] > 0.0
    )
    fit = fitball.calibrate(
        tmp_path / "out" / "impacts.csv",
        model="grip-slip",
        point_only=True,
        progress=False,
    )
    assert {"scale", "clock", "tilt"} <= {*fit.parameters}
    assert abs(fit.parameters["mu"].point - 0.56) < 0.05


def test_the_frames_of_the_film_have_roles_and_outliers(film):
    frames = film.tracks[film.tracks["id"] == "1"]
    assert [*frames["role"].unique()] == ["before", "contact", "after"]
    contact = frames["role"] == "contact"
    assert frames.loc[contact, ["outlier", "residual_x [m]"]].isna().all(axis=None)
    flying = frames.loc[~contact]
    assert flying["outlier"].between(0.0, 1.0).all()
    assert flying["residual_y [m]"].abs().median() < 2e-3
    assert set(film.refused) == {"7"}
    assert sum(film.spins["used"] == "yes") == film.impacts["omega_1 [rad/s]"].notna().sum()


def test_the_page_has_all_impacts_and_runs_nothing(film):
    html = film._repr_html_()
    text = film.report()
    assert "<script>alert" not in html
    assert "\x1b" not in text
    for word in ("6 impacts", "gap_time", "court_height", "no minimum"):
        assert word in text
    # Most doubtful impacts first: those without sure spins have pictures.
    shown = film._report.pictures()
    open_ = [k for k, name in enumerate(film.impacts["omega_1 [rad/s]"].isna()) if name]
    assert {f"track-{k + 1}" for k in open_} <= {*shown}
    assert "session" in shown
    for name in shown:
        axes = film.plot(name).axes
        assert axes
        assert all(axis.lines or axis.collections for axis in axes)
    impacts = film.impacts
    session = film.plot("session").axes
    for axis, values in zip(
        session,
        (
            impacts["v_y2 [m/s]"] / impacts["v_y1 [m/s]"],
            1e3 * impacts["gap_time [s]"],
            1e3 * impacts["gap_path [m]"],
            np.degrees(impacts["gap_turn [rad]"]),
        ),
        strict=True,
    ):
        shown = axis.lines[0].get_xydata()
        assert_allclose(
            shown,
            np.column_stack([impacts["v_y1 [m/s]"], values]),
            rtol=1e-12,
        )
    # The sd of a ratio, by its gradient.
    (fall, fall_sd), (rise, rise_sd) = (
        (impacts[f"{n} [m/s]"], impacts[f"{n}_sd [m/s]"]) for n in ("v_y1", "v_y2")
    )
    both = impacts["corr(v_y1,v_y2)"] * fall_sd * rise_sd
    sd = np.sqrt(
        (rise_sd / fall) ** 2 + (rise * fall_sd / fall**2) ** 2 - 2.0 * rise / fall**3 * both
    )
    ends = bars(session[0])[0][:, :, 1]
    assert_allclose(0.5 * (ends[:, 1] - ends[:, 0]), sd, rtol=1e-9)
    frames = film.tracks[film.tracks["id"] == "1"]
    rings = [line for line in film.plot("track-1").axes[0].lines if line.get_markersize() == 8]
    assert sum(len(line.get_xdata()) for line in rings) == (frames["outlier"] > 0.5).sum()
    # The contact lies between the flights.
    ends = (
        frames.loc[frames["role"] == "after", "t [s]"].min()
        - frames.loc[frames["role"] == "before", "t [s]"].max()
    )
    assert film.plot("track-1").axes[1].patches[0].get_width() == pytest.approx(1e3 * ends)


def test_the_command_line_tracks_a_file(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(9)
    filmed(bounces(3, rng), Camera(500), rng).to_csv("clip.csv", index=False)
    (tmp_path / "clip.toml").write_text("[camera]\nfps = 500.0\ncourt = 0.0\n")
    assert cli.main(["track", "clip.csv", "--json", "--figures", "none"]) == 0
    printed = json.loads(capsys.readouterr().out)["frames"]
    assert len(printed["impacts"]) == 3
    assert len(printed["session"]) == 1
    again = pd.read_csv("fits/clip/track/impacts.csv")
    assert again["v_x1 [m/s]"].tolist() == [row["v_x1 [m/s]"] for row in printed["impacts"]]
    assert cli.main(["track", "clip.csv", "--figures", "none", "--out", "a b"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    proposed = shlex.split(re.search(r"Next: fitball (calibrate [^;]*);", said)[1])
    assert proposed == ["calibrate", "a b/impacts.csv"]
    assert cli.main(["check", *proposed[1:]]) == 0
    # What is stated on the line holds over the scene.
    assert cli.main(["track", "clip.csv", "--fps", "25", "--out", "x"]) == 2
    assert "frames/s" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()
    assert cli.main(["track"]) == 2


def test_a_fit_of_a_single_impact_which_would_be_refused_is_not_proposed(tmp_path):
    rng = np.random.default_rng(9)
    scene = Scene(camera=CameraSection(fps=500.0, court=0.0))
    for count in (1, 2):
        film = fitball.track(filmed(bounces(count, rng), Camera(500), rng), scene=scene)
        film.save(tmp_path / str(count), figures=False)
        impacts = tmp_path / str(count) / "impacts.csv"
        assert len(pd.read_csv(impacts)) == count
        assert ("fitball calibrate" in film.report()) is (count > 1)
        assert fitball.check(impacts).exit_code == int(count == 1)


def test_the_estimator_is_not_loaded_before_it_is_needed():
    code = (
        "import sys, fitball.cli as cli; cli.make_parser(); sys.exit('fitball.tracks.session' "
        "in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
