"""Engine settings and lookup tables: against closed forms, direct integration and the model itself."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

import fitball
from fitball.cli.main import main
from fitball.data.lines import parse_grid
from fitball.errors import ModelError, ParameterError
from fitball.exports.tables import mujoco
from fitball.inference.prediction.engine_fit import default_axes, fit_engine, make_lookup, middle_impact
from fitball.inference.results.fitted_model import FittedModel

BALL = fitball.Ball()


def fitted(point, name="grip-slip", names=("mu", "e_x", "offset", "cor_10", "cor_slope"), ball=BALL, **options):
    corners = np.array([[x, y, w] for x in (8.0, 20.0) for y in (5.0, 15.0) for w in (-100.0, 100.0)])
    point = np.array(point)
    return FittedModel(
        name, options, ball, True, names, point, np.empty((0, len(names))), fitball.impacts(*corners.T)
    )


def engine_ball(mu=0.3, e=0.75):
    """A ball that engines can do: rigid, solid, one restitution."""
    solid = fitball.Ball(BALL.mass, BALL.radius, 0.4 * BALL.mass * BALL.radius**2)
    return fitted([mu, e, 0.0], "brody", ("mu", "cor_10", "cor_slope"), solid)


def sphere(e, mu, ratio, v_x, v_y, omega):
    """A rigid sphere under Coulomb friction, written anew: it slides, or friction stops the slip."""
    slip = v_x - BALL.radius * omega
    stopping = abs(slip) / (1.0 + 1.0 / ratio)
    change = math.copysign(min(mu * (1.0 + e) * v_y, stopping), slip)
    return v_x - change, e * v_y, omega + change / (ratio * BALL.radius)


def test_a_ball_that_engines_can_do_is_found_exactly():
    found = fit_engine(engine_ball(), fitball.impacts([20.0], [6.0], [0.0]), 0.4)
    for settings in (found.at_point, found.over_range):
        assert settings.e == pytest.approx(0.75, abs=1e-12)
        assert settings.mu == pytest.approx(0.3, abs=1e-5)
        assert all(abs(value) < 1e-2 for value in settings.rms.values())
    assert found.at_point.mu_from is None
    assert found.contact_time is None


@pytest.mark.parametrize("ratio", [0.4, 0.56, 2.0 / 3.0])
def test_the_engines_prediction_is_that_of_a_rigid_sphere(ratio):
    ball = fitted([0.55, 0.1, 2e-3, 0.77, -0.015])
    for impact in ((20.0, 5.0, -50.0), (8.0, 14.0, 30.0), (10.0, 8.0, 500.0)):
        found = fit_engine(ball, fitball.impacts(*([value] for value in impact)), ratio)
        settings = found.at_point
        expected = sphere(settings.e, settings.mu, ratio, *impact)
        for name, value in zip(("v_x2", "v_y2", "omega_2"), expected, strict=True):
            assert found.engine[name] == pytest.approx(value, rel=1e-12)
            assert settings.errors[name] == pytest.approx(value - found.fitted[name], abs=1e-11)
        assert settings.errors["v_y2"] == pytest.approx(0.0, abs=1e-12)


def energy_of_difference(found, e, mu, impact):
    v_x, _, omega = sphere(e, mu, 0.4, *impact)
    return (v_x - found.fitted["v_x2"]) ** 2 + BALL.inertia / BALL.mass * (omega - found.fitted["omega_2"]) ** 2


def test_no_other_friction_is_better_at_a_sliding_point():
    impact = (25.0, 4.0, 0.0)
    found = fit_engine(fitted([0.4, 0.1, 2e-3, 0.77, -0.015]), fitball.impacts(*([x] for x in impact)), 0.4)
    best = found.at_point
    assert best.mu_from is None
    least = energy_of_difference(found, best.e, best.mu, impact)
    for mu in np.linspace(0.0, 1.0, 301):
        assert energy_of_difference(found, best.e, mu, impact) >= least - 1e-9
    assert energy_of_difference(found, best.e, 1.05 * best.mu, impact) > least + 1e-4


@pytest.mark.parametrize("omega", [-150.0, 0.0, 120.0])
def test_spin_counts_in_the_slip_that_friction_must_stop(omega):
    """Backspin makes the surface faster along the court, topspin slower; the answer is checked by bouncing."""
    impact = (6.0, 15.0, omega)
    best = fit_engine(fitted([0.9, 0.1, 0.0, 0.77, -0.015]), fitball.impacts(*([x] for x in impact)), 0.4).at_point
    assert best.mu_from == pytest.approx((6.0 - BALL.radius * omega) / (3.5 * (1.0 + best.e) * 15.0), rel=1e-12)
    assert best.mu >= best.mu_from
    idle = sphere(best.e, 9.0, 0.4, *impact)
    assert sphere(best.e, 1.0001 * best.mu_from, 0.4, *impact) == pytest.approx(idle, rel=1e-12)
    assert sphere(best.e, 0.9 * best.mu_from, 0.4, *impact) != pytest.approx(idle, rel=1e-3)


def test_the_range_settings_err_less_over_the_range():
    found = fit_engine(fitted([0.55, 0.1, 2e-3, 0.77, -0.015]), fitball.impacts([20.0], [5.0], [0.0]), 0.4)
    near, wide = found.at_point.rms, found.over_range.rms
    assert wide["v_y2"] < near["v_y2"]
    cost = [item["v_x2"] ** 2 + BALL.inertia / BALL.mass * item["omega_2"] ** 2 for item in (near, wide)]
    assert cost[1] <= cost[0] * (1.0 + 1e-9)
    # A hollow sphere with the ball's own inertia is nearer to it.
    own = fit_engine(
        fitted([0.55, 0.1, 2e-3, 0.77, -0.015]), fitball.impacts([20.0], [5.0], [0.0]), BALL.inertia_ratio
    )
    assert own.over_range.rms["omega_2"] < wide["omega_2"]


def test_the_spring_and_damper_for_mujoco_bounce_as_asked():
    """Integrated directly: compression under `-k r - b v` until the force returns to zero."""
    found = fit_engine(fitted([0.55, 0.1, 2e-3, 0.77, -0.015]), fitball.impacts([20.0], [5.0], [0.0]), 0.4)
    soft = mujoco(found)
    k, b = (-item for item in soft["solref"])

    def force(_t, y):
        return k * y[0] + b * y[1]

    force.terminal, force.direction = True, -1
    path = solve_ivp(lambda t, y: [y[1], -force(t, y)], (0.0, 0.1), [0.0, 5.0], events=force, rtol=1e-11, atol=1e-13)
    assert -path.y_events[0][0][1] / 5.0 == pytest.approx(found.at_point.e, rel=1e-7)
    assert path.t_events[0][0] == pytest.approx(soft["contact_time"], rel=1e-7)


def test_engine_refuses_what_it_cannot_do():
    ball = fitted([0.55, 0.1, 2e-3, 0.77, -0.015])
    with pytest.raises(ParameterError, match="at most 1"):
        fit_engine(ball, middle_impact(ball), 1.5)
    told = replace(ball, model_name="two-mass", options={"cor": "measured"})
    for work in (lambda: fit_engine(told, middle_impact(told), 0.4), lambda: make_lookup(told, default_axes(told))):
        with pytest.raises(ModelError, match="takes the restitution of each impact"):
            work()


def test_engine_at_the_command_line(small_fit, capsys):
    call = ["export", str(small_fit), "--to", "engine", "--out", "-"]
    assert main([*call, "--at", "v=30 m/s, theta=16 deg, spin=0 rpm"]) == 0
    out = capsys.readouterr().out
    assert "30 m/s at 16 deg" in out
    assert "outside the calibrated range" in out
    for engine in ("Unity", "Godot", "Bullet", "MuJoCo"):
        assert f"**{engine}" in out
    assert main(call) == 0
    assert "outside" not in capsys.readouterr().out
    assert main([*call, "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    best = content["at_point"]
    ball = content["engines"]["unity"]["ball"]
    assert (ball["bounciness"], ball["dynamicFriction"]) == (best["restitution"], best["friction"])
    assert content["engines"]["godot"]["court"]["friction"] >= content["engines"]["godot"]["ball"]["friction"]
    assert main(["export", str(small_fit), "--to", "c", "--json"]) == 2
    assert "--json is an option of --to engine and lookup" in capsys.readouterr().err
    assert main([*call, "--at", "v=30 knots"]) == 2
    assert "impact 'v=30 knots'" in capsys.readouterr().err


def test_grid_text():
    axes = parse_grid("spin=-300..300 rpm:3, theta=10..60 deg:6, v=36 km/h")
    assert [axis.name for axis in axes] == ["v_1", "theta_1", "omega_1"]
    np.testing.assert_allclose(axes[0].values, [10.0])
    np.testing.assert_allclose(axes[1].values, np.radians([10, 20, 30, 40, 50, 60]))
    np.testing.assert_allclose(axes[2].values, [-10.0 * math.pi, 0.0, 10.0 * math.pi], atol=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("v=10..40 m/s:16", "expected v and theta"),
        ("v=40..10 m/s:4, theta=10..20:3", "increasing range"),
        ("v=10..40 m/s:1, theta=10..20:3", "two points"),
        ("v=10..40 m/s, theta=10..20:3", "expected LOW..HIGH UNIT:COUNT"),
        ("v=10..40 kg:3, theta=10..20:3", "unknown"),
        ("speed=10..40:3, theta=10..20:3", "unknown quantity 'speed'"),
        ("v=0..40:3, theta=10..20:3", "positive speed v"),
        ("v=1..40:3, theta=0..20:3", "between 0 and 180"),
        ("v=1..40:3, v=1..40:3", "given twice"),
        ("v=1..40:2000, theta=10..20:2000", "1,000,000 at most"),
        ("v", "read 'v'"),
    ],
)
def test_bad_grids_are_explained(text, words):
    with pytest.raises(ParameterError, match=r"grid '") as caught:
        parse_grid(text)
    assert words in str(caught.value)


def test_a_lookup_holds_the_models_rebounds_and_says_what_interpolation_costs(small_fit, tmp_path, capsys):
    place = tmp_path / "table.csv"
    grid = "v=10..20 m/s:5, theta=30..60 deg:4, spin=-1000..1000 rpm:3"
    assert main(["export", str(small_fit), "--to", "lookup", "--out", str(place), "--range", grid]) == 0
    assert "largest error of interpolation: v_x2" in capsys.readouterr().err
    table, about = pd.read_csv(place), json.loads((tmp_path / "table.json").read_text())
    assert len(table) == about["points"] == 60
    np.testing.assert_allclose(table["omega_1 [rpm]"][:4], [-1000, 0, 1000, -1000], atol=1e-9)
    angle = np.radians(table["theta_1 [deg]"])
    speed = table["v_1 [m/s]"]
    given = fitball.impacts(speed * np.cos(angle), speed * np.sin(angle), table["omega_1 [rpm]"] * math.pi / 30.0)
    expected = fitball.load_fit(small_fit).fitted.rebound(given)
    for name, unit in (("v_x2", "m/s"), ("v_y2", "m/s"), ("omega_2", "rad/s")):
        np.testing.assert_allclose(table[f"{name} [{unit}]"], getattr(expected, name)[0], rtol=1e-9, atol=1e-9)
        assert about["interpolation"]["errors"][name]["largest"] > about["interpolation"]["errors"][name]["rms"] > 0.0
    assert set(about["interpolation"]["errors"]["v_x2"]["largest_at"]) == {"v_1", "theta_1", "omega_1"}


def test_interpolation_error_of_a_parabola_is_the_textbook_one():
    """`v_y2 = (c + s (v - 10)) v` is a parabola in v: linear interpolation errs by s h^2/4 at midpoints."""
    ball = fitted([0.55, 0.1, 2e-3, 0.77, -0.015])
    found = make_lookup(ball, parse_grid("v_x=8..20:4, v_y=5..15:6, spin=-100..100:3"))
    assert found.errors["v_y2"].largest == pytest.approx(0.015 * 2.0**2 / 4.0, rel=1e-9)
    assert found.errors["v_y2"].place["v_y1"] % 2.0 == pytest.approx(0.0, abs=1e-9)


def test_beyond_the_range_of_the_model_tables_go_on_and_say_so(small_fit, tmp_path, capsys):
    call = ["export", str(small_fit), "--to", "lookup", "--out", str(tmp_path / "t.csv")]
    assert main([*call, "--range", "v_x=10..20:3, v_y=5..85:9"]) == 0
    table, about = pd.read_csv(tmp_path / "t.csv"), json.loads((tmp_path / "t.json").read_text())
    assert about["points_without_rebound"] == {} and not table.isna().any(axis=None)
    beyond = table["extrapolated"] == "yes"
    low, high = (about["valid_range"][f"v_y1_{end}"] for end in ("low", "high"))
    speed, rebound = table["v_y1 [m/s]"], table["v_y2 [m/s]"]
    np.testing.assert_array_equal(beyond, (speed < low) | (speed > high))
    assert 0 < about["points_extrapolated"] == beyond.sum() < len(table)
    assert f"{beyond.sum()} of 27 points are outside of v_y1" in capsys.readouterr().err
    # One restitution beyond the end, and a rebound that goes on growing.
    np.testing.assert_allclose((rebound / speed)[beyond], (rebound / speed)[beyond].iloc[0], rtol=1e-9)
    assert np.all(np.diff(rebound[table["v_x1 [m/s]"] == 10.0]) > 0.0)


def test_an_operating_point_beyond_the_range_is_told(small_fit, capsys):
    call = ["export", str(small_fit), "--to", "engine", "--out", "-", "--at"]
    assert main([*call, "v_x=20, v_y=70"]) == 0
    beyond = capsys.readouterr().out
    assert "beyond v_y1 = " in beyond and "v_y2 would fall while v_y1 grows" in beyond
    assert main([*call, "v_x=12, v_y=9"]) == 0
    assert "beyond v_y1" not in capsys.readouterr().out
    ball = fitted([0.55, 0.1, 2e-3, 0.77, -0.015])
    found = fit_engine(ball, fitball.impacts([20.0], [70.0], [0.0]), 0.4)
    assert found.extrapolated and found.unsolved == 0
    turning = 5.0 + 0.5 * 0.77 / 0.015
    assert found.at_point.e == pytest.approx(0.77 - 0.015 * (turning - 10.0), rel=1e-4)


def test_the_default_grid_spans_the_calibrated_range():
    ball = fitted([0.55, 0.1, 2e-3, 0.77, -0.015])
    speed, angle, spin = default_axes(ball)
    assert speed.values[0] == pytest.approx(math.hypot(8.0, 5.0))
    assert speed.values[-1] == pytest.approx(math.hypot(20.0, 15.0))
    assert angle.values[[0, -1]] == pytest.approx([math.atan2(5.0, 20.0), math.atan2(15.0, 8.0)])
    assert spin.values[[0, -1]] == pytest.approx([-100.0, 100.0])


def test_drop_tests_have_no_friction_and_one_axis():
    drop = replace(fitted([0.77, -0.015], names=("cor_10", "cor_slope")), tangential=False)
    drop = replace(drop, impacts=fitball.impacts([0.0, 0.0], [3.0, 8.0], [0.0, 0.0]))
    found = fit_engine(drop, middle_impact(drop), 0.4)
    assert found.at_point.mu is None
    assert found.at_point.e == pytest.approx(0.77 - 0.015 * (5.5 - 10.0))
    assert [axis.name for axis in default_axes(drop)] == ["v_y1"]
    with pytest.raises(ParameterError, match="vertical motion only"):
        make_lookup(drop, parse_grid("v_x=1..2:2, v_y=1..2:2"))
