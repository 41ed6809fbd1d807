"""The bench: its rivals solve the same bounce, its errors are errors, its files are whole."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from fitball.cli.main import main
from fitball.studies.bench import measure as bench
from fitball.studies.bench.hard_cases import BASE
from fitball.studies.bench.measure import Bench, Pace, batch_costs, errors, spread_draws, timed, work_precision
from fitball.studies.bench.page import FIGURE, summary
from fitball.studies.bench.rivals import adaptive, set_up, stepped
from fitball.studies.bench.scenes import Scene, default_model
from fitball.values import impacts

TINY = Pace(1e-3, (100, 400), (1e-6,), 210, 1)


@pytest.fixture(scope="module")
def scene():
    chosen = default_model()
    names = chosen.parameter_names
    given = impacts([12.0, 9.0, 16.0, 5.0], [13.0, 15.0, 4.0, 16.0], [0.0, 100.0, 0.0, 145.0])
    values = np.array([[BASE[name] for name in names]] * 4)
    found = chosen.evaluate(names, values[:1], given)
    return Scene("mixed", names, values, given, found.v_x2[0], found.omega_2[0])


def setups_of(scene):
    ball = default_model().ball
    named = dict(zip(scene.names, scene.values[0].tolist(), strict=True))
    given = scene.impacts
    return np.array([set_up(ball, named, given.v_x1[k], given.v_y1[k], given.omega_1[k]) for k in range(len(given))])


@pytest.mark.parametrize("method", ["RK45", "DOP853", "LSODA"])
def test_rivals_solve_the_same_bounce(scene, method):
    """Scipy's integrators, written without our closed forms, arrive where they do."""
    for k, setup in enumerate(setups_of(scene)):
        v_x2, omega_2 = adaptive(setup, method, 1e-9)
        assert v_x2 == pytest.approx(scene.v_x2[k], rel=1e-6)
        assert omega_2 == pytest.approx(scene.omega_2[k], rel=1e-6)


def test_fixed_steps_converge(scene):
    setups, work, out = setups_of(scene), np.empty((5, 6)), np.empty((4, 2))
    found = []
    for steps in (50, 400, 100_000):
        stepped(setups, steps, work, out)
        found.append(errors(scene, (out[:, 0].copy(), out[:, 1].copy())))
    # Without an event the order is four; events are noticed at steps only, so that short grips are missed.
    assert found[1][2] < 4.0 * found[0][2] / 8.0**4
    assert found[1].max() > 1e-4
    assert found[2].max() < 1e-6


def test_errors_are_relative_to_the_incident_surface_speed(scene):
    radius = default_model().ball.radius
    wrong = (scene.v_x2 + 0.01, scene.omega_2.copy())
    speed = np.hypot(scene.impacts.v_x1, scene.impacts.v_y1) + radius * np.abs(scene.impacts.omega_1)
    np.testing.assert_allclose(errors(scene, wrong), 0.01 / speed)
    wrong = (scene.v_x2.copy(), scene.omega_2 - 5.0)
    np.testing.assert_allclose(errors(scene, wrong), 5.0 * radius / speed)


def test_work_precision_holds_every_solver(scene):
    frame = pd.DataFrame(list(work_precision((scene,), TINY)))
    assert {"closed form, batch", "closed form, one by one", "matrix exponentials", "RK4, compiled"} <= set(
        frame["solver"]
    )
    assert sum(frame["solver"].str.startswith("solve_ivp")) == 4
    closed = frame[frame["solver"].str.startswith("closed form")]
    rivals = frame[frame["solver"].str.startswith(("RK4", "solve_ivp"))]
    assert (closed["largest error"] < 1e-13).all()
    assert rivals["largest error"].min() > 1e-9
    assert (frame["microseconds"] > 0.0).all()


def test_timed_counts_calls(monkeypatch):
    """On a clock that only the calls move: 2 ms each, once 5 ms."""
    taken = [2e-3] * 8 + [5e-3] + [2e-3] * 100
    now, calls = [0.0], []

    def action():
        now[0] += taken[len(calls)]
        calls.append(0)

    monkeypatch.setattr(bench.time, "perf_counter", lambda: now[0])
    # One call to warm up, one to see how long it takes, then three times five in 0.03 s: the median knows no 5 ms.
    assert timed(action, 0.0301, 3) == pytest.approx(2e-3, rel=1e-9)
    assert len(calls) == 17


def test_batches_are_named_by_what_they_hold():
    found = batch_costs(TINY, 2)
    assert found["call"].iloc[-1] == "batch of 210, 2 threads"
    assert spread_draws(3, seed=5).tolist() == spread_draws(3, seed=5).tolist()


def test_files_and_words(scene, tmp_path, monkeypatch, capsys):
    frame = pd.DataFrame(list(work_precision((scene,), TINY)))
    frame["scene"] = "Wang's 21"
    small = pd.DataFrame([{"call": "x", "microseconds an impact": 1.5}])
    made = Bench(frame, small, small, small, small, "a machine")
    monkeypatch.setattr(bench, "measure", lambda pace, cores, report: made)
    out = tmp_path / "bench"
    assert main(["bench", "--quick", "--out", str(out), "--cores", "1"]) == 0
    printed = capsys.readouterr().out
    assert "closed form, batch" in printed
    assert {item.name for item in out.iterdir()} == {
        FIGURE, "summary.md", "precision.csv", "batches.csv", "growth.csv", "start_up.csv", "stages.csv",
    }  # fmt: skip
    assert "\n".join(summary(made)) in (out / "summary.md").read_text(encoding="utf-8")
    assert main(["bench", "--quick", "--out", str(out), "--json", "--quiet"]) == 0
    assert json.loads(capsys.readouterr().out)["machine"] == "a machine"
    (tmp_path / "file").write_text("")
    assert main(["bench", "--quick", "--out", str(tmp_path / "file")]) == 2
    assert "--out" in capsys.readouterr().err


@pytest.mark.parametrize("verb", [["bench"], ["calibrate", "wang_all.csv"]])
@pytest.mark.parametrize("count", ["0", "-2", "two", "1.5"])
def test_bad_counts_of_threads(verb, count, capsys):
    with pytest.raises(SystemExit) as ended:
        main([*verb, "--cores", count])
    assert ended.value.code == 2
    assert f"--cores: read '{count}', expected a whole number, 1 or more" in capsys.readouterr().err
