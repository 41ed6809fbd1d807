"""The bench: its rivals solve the same bounce, its errors are errors, its files are whole, and it sees what slows."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fitball.bench import clock, measure
from fitball.bench.clock import Pace, by_turns
from fitball.bench.errors import (
    CAREFUL,
    FASTEST,
    LOCATED_8,
    OURS,
    SCRIPT,
    by_order_8,
    by_solve_ivp,
    density_costs,
    errors,
    plain_log_posterior,
    work_precision,
)
from fitball.bench.integrators import adaptive, fixed_steps, set_up
from fitball.bench.measure import RATIO, WORK, Bench, batch_costs
from fitball.bench.problems import (
    Scene,
    base_values,
    default_model,
    posed,
    problems,
    spread_coordinates,
    spread_draws,
)
from fitball.cli.main import main
from fitball.inference.likelihood.posterior import log_posterior
from fitball.values import impacts

TINY = Pace(1, 1e-5)


def scene_of(given):
    chosen = default_model()
    names = chosen.parameter_names
    values = np.array([list(base_values().values())] * len(given))
    found = chosen.evaluate(names, values[:1], given)
    return Scene("Wang's 21", names, values, given, found.v_x2[0], found.omega_2[0])


@pytest.fixture(scope="module")
def scene():
    return scene_of(impacts([12.0, 9.0, 16.0, 5.0], [13.0, 15.0, 4.0, 16.0], [0.0, 100.0, 0.0, 145.0]))


def setups_of(scene):
    given = scene.impacts
    states = zip(given.v_x1, given.v_y1, given.omega_1, strict=True)
    return np.array([set_up(default_model().ball, base_values(), *map(float, state)) for state in states])


@pytest.mark.parametrize("method", ["RK45", "DOP853", "LSODA"])
def test_rivals_solve_the_same_bounce(scene, method):
    """Scipy's integrators, written without our closed forms, arrive where they do."""
    solved = np.array([adaptive(setup, method, 1e-9) for setup in setups_of(scene)])
    assert errors(scene, solved).max() < 1e-6


def test_short_steps_do_not_step_over_a_grip(wang_impacts):
    scene = scene_of(wang_impacts)
    careless, careful = (
        errors(scene, np.array([adaptive(setup, "DOP853", 1e-9, most) for setup in setups_of(scene)]))
        for most in (math.inf, CAREFUL)
    )
    assert careful.max() < 1e-9
    assert careless.max() > 1e-4


def test_a_short_first_step_sees_slip_that_soon_ends():
    """On the simulated court a slip begins at zero and ends within a twentieth of the contact."""
    problem = posed("synthetic_court")
    at = spread_coordinates(problem, 1)
    values = {name: float(column[0]) for name, column in problem.all_values(problem.to_values(at)).items()}
    v_x2 = by_order_8(problem, values)[0]
    assert np.abs(by_solve_ivp(problem, values, CAREFUL)[0] - v_x2).max() < 1e-7


@pytest.mark.parametrize(("order", "steps", "bound"), [(4, 200, 1e-9), (8, 20, 1e-11), (8, 80, 1e-13)])
def test_located_events_keep_the_order(wang_impacts, order, steps, bound):
    """Where the end of each phase is searched for, equal steps converge as on smooth problems."""
    scene = scene_of(wang_impacts)
    setups = setups_of(scene)
    located = [errors(scene, fixed_steps(setups, order, n, located=True)).max() for n in (steps // 2, steps)]
    between = errors(scene, fixed_steps(setups, order, steps, located=False)).max()
    assert located[1] < bound
    assert located[1] < located[0]
    assert between > 1e-3


def test_errors_are_relative_to_the_incident_surface_speed(scene):
    radius = default_model().ball.radius
    right = np.stack([scene.v_x2, scene.omega_2], axis=1)
    speed = np.hypot(scene.impacts.v_x1, scene.impacts.v_y1) + radius * np.abs(scene.impacts.omega_1)
    np.testing.assert_allclose(errors(scene, right + np.array([0.01, 0.0])), 0.01 / speed)
    np.testing.assert_allclose(errors(scene, right - np.array([0.0, 5.0])), 5.0 * radius / speed)


@pytest.fixture(scope="module")
def precision(scene):
    return work_precision((scene,), TINY)


@pytest.fixture(scope="module")
def densities():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fitball.bench.errors.JUDGED", 2)
        return density_costs("zero", posed("wang_zero_spin"), TINY)


def test_work_precision_holds_careless_and_careful_rivals(precision):
    frame = precision
    assert sum(solver.startswith("solve_ivp") for solver in frame["solver"].unique()) == 4
    best = frame.groupby("solver")["largest error"].min()
    assert (best[best.index.str.startswith("closed form")] < 1e-13).all()
    assert best["RK4 compiled, events between steps"] > 1e-6
    assert best[LOCATED_8] < 1e-13
    assert (frame["microseconds"] > 0.0).all()


@pytest.mark.parametrize("name", [name for name, _ in problems()])
def test_the_plain_log_posterior_is_the_same(name):
    """By scipy's densities and integrated rebounds, for normal and Student noise, a contact time, missing cells."""
    problem = dict(problems())[name]
    at = spread_coordinates(problem, 2)
    plain = [plain_log_posterior(problem, one, by_order_8) for one in at]
    assert log_posterior(problem, at) == pytest.approx(plain, abs=1e-6)


def test_densities_are_timed_beside_their_errors(densities):
    frame = densities.set_index("log posterior")
    assert frame.loc[[way for way in frame.index if way.startswith(OURS)], "largest error"].max() < 1e-10
    assert frame.loc[SCRIPT, "microseconds"] > frame.loc[f"{OURS}, one at a time", "microseconds"]


def test_rivals_take_turns(monkeypatch):
    """On a clock that only the calls move: the least of the rounds counts, and no call before them."""
    now, calls = [0.0], []
    taken = {"a": iter([9.0, 2.0, 2.0, 3.0, 1.5, 2.5]), "b": iter([9.0, 1.0, 0.9, 0.9, 0.9, 0.7, 0.7, 0.7])}

    def action(name):
        now[0] += next(taken[name])
        calls.append(name)

    monkeypatch.setattr(clock.time, "process_time", lambda: now[0])
    least = by_turns({name: lambda name=name: action(name) for name in "ab"}, Pace(2, 2.1))
    assert "".join(calls) == "aabb" + "aabbb" + "aabbb"
    assert least == pytest.approx({"a": 2.0, "b": 0.7})


def test_batches_are_named_by_what_they_hold():
    found = batch_costs(210, TINY)
    assert found["call"].iloc[-2] == "batch of 210"
    assert spread_draws(3, seed=5).tolist() == spread_draws(3, seed=5).tolist()


def test_a_fresh_process_tells_its_time_and_memory():
    told = clock.fresh_process("print('done')")
    assert told.printed == ["done"]
    assert told.seconds > 0.0
    large = clock.fresh_process("x = b'1' * 200_000_000").megabytes
    assert math.isnan(large) or 180.0 < large - told.megabytes < 220.0


def bench_of(precision, densities):
    kinds = pd.DataFrame([{"call": "x", "microseconds an impact": 1.5}])
    frames = {
        "ratios": pd.DataFrame({WORK: ["a", "b"], "yardstick": "y", RATIO: [2.0, 3.0]}),
        "precision": precision,
        "densities": densities,
        "batches": kinds,
    }  # fmt: skip
    return Bench(frames, "a machine")


def test_files_and_words(precision, densities, tmp_path, monkeypatch, capsys):
    made = bench_of(precision, densities)
    monkeypatch.setattr(measure, "measure", lambda extent, cores, report: made)
    out = tmp_path / "bench"
    assert main(["bench", "--quick", "--out", str(out), "--cores", "1"]) == 0
    printed = capsys.readouterr().out
    assert FASTEST in printed
    assert {item.name for item in out.iterdir()} == {
        measure.FIGURE, "summary.md", *(f"{name}.csv" for name in made.frames),
    }  # fmt: skip
    assert "\n".join(measure.summary(made)) in (out / "summary.md").read_text(encoding="utf-8")
    monkeypatch.setattr(measure, "save_figure", lambda figure, path: None)
    assert main(["bench", "--quick", "--out", str(out), "--json", "--quiet"]) == 0
    assert json.loads(capsys.readouterr().out)["machine"] == "a machine"
    (tmp_path / "file").write_text("")
    begun = []
    monkeypatch.setattr(measure, "measure", lambda *rest: begun.append(rest))
    assert main(["bench", "--quick", "--out", str(tmp_path / "file")]) == 2
    assert "is a file; name a folder" in capsys.readouterr().err and not begun


@pytest.mark.parametrize(
    ("text", "code", "said"),
    [
        ("work,over the yardstick\na,2\nb,3\n", 0, "| b | 3 | 3 | 1 |"),
        ("work,over the yardstick\na,1.3\nb,1.9\n", 1, "b: 1.58 times slower"),
        ("work,over the yardstick\na,200\nb,300\n", 0, "| 0.01 |"),
        ("work,over the yardstick\na,2\nc,3\n", 2, "(b; c)"),
        ("work,over the yardstick\na,2\nb,-3\n", 2, "expected 'work' and 'over the yardstick' with positive numbers"),
        ("work,over the yardstick\na,2\nb,many\n", 2, "many"),
        ("nothing\n1\n", 2, "read columns nothing"),
        (None, 2, "kept.csv: read No such file or directory, expected the ratios"),
    ],
)
def test_what_became_slower_is_told(text, code, said, tmp_path, monkeypatch, capsys):
    """Ratios 2 and 3 now; no clock is asked."""
    now = pd.DataFrame({WORK: ["a", "b"], RATIO: [2.0, 3.0]})
    monkeypatch.setattr(measure, "ratios", lambda pace: now)
    kept = tmp_path / "kept.csv"
    if text is not None:
        kept.write_text(text)
    assert main(["bench", "--check", str(kept)]) == code
    told = capsys.readouterr()
    assert said in told.out + told.err
    assert ("a: 1.54 times slower" in told.out) == (code == 1)


def test_ratios_are_of_the_work_that_is_kept(monkeypatch):
    """What a run measures is what the ratios in the repository are of."""
    kept = measure.read_ratios(Path(__file__).parent.parent / "fits" / "bench" / "ratios.csv")
    monkeypatch.setattr(measure, "by_turns", lambda actions, pace: dict.fromkeys(actions, 2.0))
    monkeypatch.setattr(measure, "fresh_process", lambda code: clock.Spent([], 2.0, 1.0))
    now = measure.ratios(TINY)
    assert (now[RATIO] == 1.0).all()
    assert len(measure.compared(kept, now)) == len(now)


@pytest.mark.parametrize("verb", [["bench"], ["calibrate", "wang_all.csv"]])
@pytest.mark.parametrize("count", ["0", "-2", "two", "1.5"])
def test_bad_counts_of_threads(verb, count, capsys):
    with pytest.raises(SystemExit) as ended:
        main([*verb, "--cores", count])
    assert ended.value.code == 2
    assert f"--cores: read '{count}', expected a whole number, 1 or more" in capsys.readouterr().err
