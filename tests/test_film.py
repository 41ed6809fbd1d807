"""The film of a bounce: it shows the computed motion, its flights are straight, equal bounces are equal bytes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from matplotlib.animation import FFMpegWriter
from PIL import Image

import fitball
from fitball.cli.main import main
from fitball.inference.prediction.simulate import chosen_parameters, simulate
from fitball.report.history.film import FLIGHT, LASTS, motion, write_film

FRAMES_PER_SECOND = 100


@pytest.fixture(scope="module")
def bounce():
    model = fitball.model("two-mass")
    return simulate(model, chosen_parameters(model, {}), fitball.impacts(14.0, 9.0, 100.0))


def test_the_ball_moves_as_computed(bounce):
    history, found = bounce.history, motion(bounce, FRAMES_PER_SECOND)
    time, inside = found.time, (found.time > 0.0) & (found.time < history.contact_time)
    assert time[0] == pytest.approx(-FLIGHT * history.contact_time)
    assert time[-1] == pytest.approx((1.0 + FLIGHT) * history.contact_time)
    # In flight at constant velocity and spin, above the court; in contact on it.
    before, after = time < 0.0, time > history.contact_time
    left = history.release.after
    assert found.x[before] == pytest.approx(14.0 * time[before])
    assert found.height[before] == pytest.approx(-9.0 * time[before])
    assert found.shell_turned[before] == pytest.approx(100.0 * time[before])
    assert np.ptp(found.x[after] - left.v_x * time[after]) < 1e-12
    assert found.height[after] == pytest.approx(-left.v_y * (time[after] - history.contact_time))
    assert np.all(found.height[inside] == 0.0) and left.v_y < 0.0
    # Places and turns are integrals of velocities and spins, without a jump anywhere.
    for place, rate in (
        (found.x, found.v_x),
        (found.shell_turned, found.omega_2),
        (found.core_turned, found.omega_1),
    ):
        moved = np.diff(place)[inside[1:] & inside[:-1]]
        expected = (0.5 * (rate[1:] + rate[:-1]) * np.diff(time))[inside[1:] & inside[:-1]]
        assert moved == pytest.approx(expected, abs=2e-4 * float(np.abs(moved).sum()))
        assert np.abs(np.diff(place)).max() < 1.05 * np.abs(rate).max() * np.diff(time).max()
    # The court's push is the change of momentum.
    mass = bounce.model.ball.mass
    pushed = np.trapezoid(found.friction_force, time) + history.landing.friction_impulse
    assert pushed == pytest.approx(mass * (left.v_x - 14.0), rel=0.01)


def test_it_says_what_the_contact_does_and_how_slow_it_runs(bounce):
    found = motion(bounce, FRAMES_PER_SECOND)
    states = list(dict.fromkeys(found.state))
    assert states == ["in flight", *bounce.history.regime_name.split("-")]
    assert found.state[-1] == "in flight"
    changes = [k for k in range(1, len(found.state)) if found.state[k] != found.state[k - 1]][1:-1]
    starts = [span.start for span in bounce.history.spans[1:]]
    assert found.time[changes] == pytest.approx(starts, abs=np.diff(found.time)[0])
    mantissa = found.slowed / 10.0 ** np.floor(np.log10(found.slowed))
    assert mantissa in (1.0, 2.0, 5.0)
    assert 0.6 * LASTS < (found.time[-1] - found.time[0]) * found.slowed < 1.7 * LASTS


def test_equal_bounces_are_equal_small_files(bounce, tmp_path):
    one, other = tmp_path / "one.gif", tmp_path / "other.gif"
    for place in (one, other):
        write_film(bounce, "a bounce", place, 2)
    assert one.read_bytes() == other.read_bytes()
    with Image.open(one) as film:
        frames = film.n_frames
        assert frames == motion(bounce, 2).time.size and film.info["duration"] == 500 and film.info["loop"] == 0
        pictures = []
        for k in range(frames):
            film.seek(k)
            pictures.append(np.asarray(film.convert("RGB"), dtype=int))
    # A film at its usual rate stays below 2 MB.
    assert one.stat().st_size / frames * 20 * LASTS * 1.7 < 2e6
    assert all(np.abs(a - b).max() > 100 for a, b in pairwise(pictures))


def test_command_writes_a_film_beside_the_rest(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("fitball.report.history.film.FRAMES_PER_SECOND", 2)
    monkeypatch.setattr(write_film, "__defaults__", (2,))
    line = ["simulate", "--impact", "v_y=7", "--animate", "drop.gif", "--out", "here"]
    assert main(line) == 0
    assert "drop.gif" in capsys.readouterr().out and (tmp_path / "here" / "simulate.json").exists()
    assert main([*line, "--out", "there"]) == 2
    assert "drop.gif: exists already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--impact", "v=17, theta=18", "--animate", "bounce.avi"], "ends in .gif or .mp4"),
        (["--impact", "v=17, theta=18", "--animate", "bounce.mp4"], "MP4 needs ffmpeg"),
        (["--impact", "v=17, theta=18", "--animate", "nowhere/bounce.gif"], "there is no folder nowhere"),
        (["--example", "fig8", "--animate", "bounce.gif"], "--animate shows one bounce"),
        (["--map", "--animate", "bounce.gif"], "leave out --animate"),
        (["--impact", "v=17, theta=18", "--model", "brody", "--animate", "bounce.gif"], "models with a history"),
    ],
)
def test_mistakes_are_named_before_anything_is_written(words, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(FFMpegWriter, "isAvailable", classmethod(lambda cls: False))
    assert main(["simulate", *words]) == 2
    assert said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
