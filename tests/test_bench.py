"""`bench`: rivals, kernels and scenes against answers of fifty digits; what is timed, page and
figure.
"""

import time
from functools import partial
from importlib import import_module

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support import answers, taylor, taylor_series

import fitball

bench = import_module("fitball.speed")
SCENES = bench.scenes()


def solvers_of(name):
    """What solves a scene, by rival and setting."""
    solvers = {}
    for rival, setting, solve, _ in bench.solvers(name, SCENES[name]):
        solvers[rival, setting] = solve
    return solvers


def test_the_answers_are_those_of_the_oracle():
    rows = [scene.rows.iloc[-1] for name, scene in SCENES.items() if name != bench.HARD]
    assert len(rows) == 4
    for row in rows:
        values = {spec.name: float(row[spec.name]) for spec in fitball.model().parameters}
        impact = [float(row[name]) for name in answers.IMPACT]
        answer = taylor.solve({}, values, impact, kind=taylor_series.FIFTY)
        assert float(answer.v_x2) == row["v_x2"]
        assert float(answer.omega_2) == row["omega_2"]
        assert f"{answer.regime(1e-12):o}" == str(int(row["regime"]))


def test_scenes_are_of_the_kinds_that_they_are_named_after():
    assert [len(scene.rows) for scene in SCENES.values()] == [21, 7, 7, 7, 108]
    for name, regime in (
        ("slide", 1),
        ("slide, grip, slide back", 0o231),
        ("grip, slide back", 0o23),
    ):
        scene = SCENES[name]
        assert fitball.regime_name(regime) == name
        for k in range(7):
            model, values = scene.model(k)
            impact = scene.impacts.take(np.array([k]))
            assert model.rebound(values, impact).regime[0] == regime


@pytest.mark.parametrize("name", SCENES)
def test_fitball_has_sixteen_digits(name):
    scene = SCENES[name]
    solvers = solvers_of(name)
    bound = 1e-15 + 2.0 * scene.rows["rounding"].to_numpy(float)
    for rival in (bench.OURS_SINGLY, bench.OURS):
        if (rival, "") in solvers:
            solve = solvers[rival, ""]
            assert (scene.errors(solve()) <= bound).all()


@pytest.mark.parametrize("name", ["Wang's 21", "slide", "grip, slide back"])
def test_rivals_have_the_order_of_their_methods(name):
    """Ends of phases are located: errors fall by 2^4 and 2^8 as steps halve, down to rounding."""
    solvers = solvers_of(name)

    def errors(order, steps):
        solve = solvers[bench.FIXED[order], f"{steps} steps"]
        return SCENES[name].errors(solve())

    for order, steps in ((4, 50), (8, 5)):
        coarse = np.median(errors(order, steps))
        fine = np.median(errors(order, 2 * steps))
        assert 2.0 ** (order - 1.5) < coarse / fine < 2.0 ** (order + 2.5)
    assert errors(8, 80).max() < 1e-13
    assert errors(4, 1600).max() < 1e-12


def test_solve_ivp_reaches_its_tolerance():
    name = "slide, grip, slide back"
    solvers = solvers_of(name)
    careful = solvers["solve_ivp DOP853, short steps", "rtol 1e-12"]
    usual = solvers["solve_ivp RK45", "rtol 1e-06"]
    assert SCENES[name].errors(careful()).max() < 1e-11
    assert 1e-9 < SCENES[name].errors(usual()).max() < 1e-4


def test_errors_are_shares_of_the_incident_surface_speed():
    scene = SCENES["slide"]
    impacts = scene.impacts
    faster = scene.exact + np.array([0.01, 0.0])
    with_more_spin = scene.exact + np.array([0.0, 1.0])
    surface_speed = np.hypot(impacts.v_x1, impacts.v_y1) + 0.03302 * np.abs(impacts.omega_1)
    assert_allclose(scene.errors(faster), 0.01 / surface_speed, rtol=1e-9)
    assert_allclose(scene.errors(with_more_spin), 0.03302 / surface_speed, rtol=1e-9)


def test_rivals_take_turns_and_the_least_time_counts(monkeypatch):
    """By a clock of our own: the first, slow call is not counted, nor the slower turns."""
    clock = [0.0]
    order = []
    monkeypatch.setattr(time, "process_time", lambda: clock[0])
    cost = {
        "a": iter([9.0, 1.5e-3] + [3e-3, 1e-3] * 99),
        "b": iter([9.0, 1e-2] + [5e-3] * 99),
    }

    def action(name):
        order.append(name)
        clock[0] += next(cost[name])

    spent = bench.by_turns({name: partial(action, name) for name in cost})
    assert spent["a"] == pytest.approx(2e-3)
    assert spent["b"] == pytest.approx(5e-3)
    assert order[:2] == ["a", "a"]
    assert order[4:7] == ["a", "a", "b"]
    assert len(order) == 4 + bench.ROUNDS * 3


def test_page_and_figure(monkeypatch, tmp_path):
    for name, value in {
        "ROUNDS": 1,
        "TURN": 0.0,
        "RELATIVE_TOLERANCES": (1e-3,),
        "STEPS": {4: (100,), 8: (40,)},
    }.items():
        monkeypatch.setattr(bench, name, value)
    result = fitball.bench(progress=False)
    frame = result.frames["bench"]
    assert len(frame) == 4 * 6 + 1
    assert (frame["microseconds"] > 0.0).all()
    assert frame["largest_error"].max() < 0.1
    names = {path.name for path in result.save(tmp_path / "made")}
    assert names == {"report.html", "bench.csv", "bench.png"}
    axes = result.plot("bench").axes
    assert [axis.get_title(loc="left") for axis in axes] == [*SCENES][:4]
    assert [len(axis.lines) for axis in axes] == [6] * 4
    text = result.report()
    for name in SCENES:
        assert name in text
