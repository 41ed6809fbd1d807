"""Verdicts against what is known without them: scaling laws, refits at another constant, lines at measured speeds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fitball
from fitball.inference.calibrate import search
from fitball.inference.effort import Effort, Stopwatch
from fitball.inference.identifiability.derived import extrapolated
from fitball.inference.identifiability.examine import joined, several_fits, traded
from fitball.inference.identifiability.profile import degrees_of_freedom, profiles
from fitball.inference.likelihood.posterior import densities
from fitball.inference.point.surface import surface_of
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.results.evidence import End
from fitball.inference.results.results import Verdict
from fitball.values import Ball

NAMES = ("v_x1", "v_y1", "omega_1", "v_x2", "v_y2", "omega_2")


def grip_slip(v_x, v_y, omega, *, mu, e_x=0.15, offset=0.002, cor_10=0.77, cor_slope=-0.012):
    """Rebounds after Walton (1993) and Cross (2002), written here anew."""
    ball = Ball()
    a, m, r = ball.inertia_ratio, ball.mass, ball.radius
    cor = cor_10 + cor_slope * (v_y - 10.0)
    normal = m * (1.0 + cor) * v_y
    grip = m * a / (1.0 + a) * ((1.0 + e_x) * (v_x - r * omega) + offset * normal / (a * m * r))
    along = np.clip(grip, -mu * normal, mu * normal)
    return v_x - along / m, cor * v_y, omega + (r * along - offset * normal) / ball.inertia


def frame(v_x, v_y, omega, rebound):
    return dict(zip(NAMES, (v_x, v_y, omega, *rebound), strict=True))


def slow_table():
    """Impacts at 0.8 to 2.7 m/s towards the court with errors that follow no pattern in speed."""
    v_y = np.tile(np.linspace(0.8, 2.7, 8), 2)
    v_x, omega = np.linspace(1.0, 6.0, 16)[::-1], np.tile([-40.0, 0.0, 40.0, 10.0], 4)
    rebound = grip_slip(v_x, v_y, omega, mu=0.65)
    wiggles = [np.roll(np.tile([1.0, -1.0, -1.0, 1.0], 4), k) for k in range(3)]
    errors = (0.03 * wiggles[0], 0.03 * wiggles[1], 1.5 * wiggles[2])
    return frame(v_x, v_y, omega, [one + error for one, error in zip(rebound, errors, strict=True)])


def wang(name="wang_zero_spin.csv", scene=None, **choices):
    table, known = fitball.load_table(name), fitball.load_scene(name)
    return build_problem(table, scene or known, Choices(**choices))


def coordinates(problem, point):
    values = np.array([[point.values[name] for name in problem.free_names]])
    return problem.to_coordinates(values)


def found(problem):
    return search(problem, Effort(point_only=True, cores=1), Stopwatch())[1]


def test_stiffnesses_are_traded_unless_a_time_was_measured():
    problem = wang()
    point = found(problem)
    at = coordinates(problem, point)
    assert dict(traded(problem, at)) == {"k_y": ("k_theta",), "k_theta": ("k_y",)}
    # The law behind it: both doubled, no rebound moves.
    values = problem.to_values(at)
    both = values.copy()
    both[:, [problem.free_names.index(name) for name in ("k_y", "k_theta")]] *= 2.0
    for name in ("v_x2", "v_y2", "omega_2"):
        assert getattr(problem.rebound(both), name) == pytest.approx(getattr(problem.rebound(values), name), rel=1e-9)
    time = problem.rebound(values).contact_time[0]
    timed = fitball.load_table({**problem.table.to_frame().to_dict("list"), "contact_time": time})
    assert not traded(build_problem(timed, problem.scene, Choices()), at_of(timed, problem, point))


def at_of(table, problem, point):
    other = build_problem(table, problem.scene, Choices())
    known = {**point.values, "contact_time_sd": 2e-4}
    return other.to_coordinates(np.array([[known[name] for name in other.free_names]]))


def test_stiffnesses_rest_on_the_contact_time_and_without_one_on_priors():
    told = fitball.calibrate("wang_zero_spin.csv", point_only=True, progress=False)
    silent = replace(fitball.load_scene("wang_zero_spin.csv"), contact_time=None)
    untold = fitball.calibrate("wang_zero_spin.csv", scene=silent, point_only=True, progress=False)
    for name in ("k_y", "k_theta"):
        assert told.parameters[name].verdict is Verdict.GIVEN
        assert told.parameters[name].given[0] == "contact_time"
        assert untold.parameters[name].verdict is Verdict.PRIOR_DOMINATED
    ratio = untold.derived["k_theta/k_y"]
    assert ratio.verdict in (Verdict.IDENTIFIED, Verdict.GIVEN)
    assert ratio.point == pytest.approx(untold.parameters["k_theta"].point / untold.parameters["k_y"].point)


def test_what_rests_on_a_held_constant_moves_as_a_refit_does():
    scene = fitball.load_scene("wang_all.csv")
    fit = fitball.calibrate("wang_all.csv", "grip-slip", scene=scene, point_only=True, progress=False)
    (constant,) = [item for item in fit.assumptions.constants if item.name == "inertia_ratio"]
    assert constant.held
    assert (constant.low, constant.value, constant.high) == pytest.approx((0.53, 0.56, 0.59))
    assert "inertia_ratio" in fit.parameters["offset"].given
    assert "inertia_ratio" not in fit.parameters["cor_10"].given
    for end, promised in zip((constant.low, constant.high), constant.parameters["offset"], strict=True):
        ball = replace(scene.ball, inertia=end * scene.ball.mass * scene.ball.radius**2)
        other = wang("wang_all.csv", replace(scene, ball=ball), model="grip-slip")
        own = fit.parameters["offset"].point
        assert promised - own == pytest.approx(found(other).values["offset"] - own, rel=0.25)


def test_what_is_free_under_a_prior_is_identified_given_that_prior():
    scene = replace(fitball.load_scene("wang_all.csv"), ball_sd={"inertia_ratio": 0.015})
    free = fitball.calibrate("wang_all.csv", "grip-slip", scene=scene, point_only=True, progress=False)
    assert free.parameters["offset"].verdict is Verdict.GIVEN
    assert "the prior of inertia_ratio" in free.parameters["offset"].given
    held = fitball.calibrate("wang_all.csv", "grip-slip", point_only=True, progress=False)
    wide, narrow = (float(np.ptp(fit.identifiability.evidence["offset"].profile.interval_95)) for fit in (free, held))
    # 0.22 mm for each sd of the inertia beside the fit's own: a root of squares.
    (constant,) = [item for item in held.assumptions.constants if item.name == "inertia_ratio"]
    more = 1.96 * abs(constant.parameters["offset"][1] - constant.parameters["offset"][0]) / 4.0
    assert wide / 2.0 == pytest.approx(float(np.hypot(narrow / 2.0, more)), rel=0.1)


def test_an_anchor_that_was_not_measured_is_extrapolated():
    fit = fitball.calibrate(slow_table(), "grip-slip", point_only=True, progress=False)
    assert fit.parameters["cor_10"].verdict is Verdict.EXTRAPOLATED
    assert fit.parameters["cor_slope"].verdict is not Verdict.EXTRAPOLATED
    assert "COR at 1.75 m/s" in fit.verdict
    cor = fit.derived["COR at 1.75 m/s"]
    assert cor.verdict is Verdict.IDENTIFIED
    at_10, slope = fit.parameters["cor_10"].point, fit.parameters["cor_slope"].point
    assert cor.point == pytest.approx(at_10 + slope * (1.75 - 10.0))
    assert cor.q025 < 0.77 - 0.012 * (1.75 - 10.0) < cor.q975
    assert extrapolated(wang()) == ()


def test_two_rows_tell_no_noise():
    table = slow_table()
    short = {name: column[[0, 13]] for name, column in table.items()}
    fit = fitball.calibrate(short, "brody", point_only=True, progress=False)
    noises = [item for name, item in fit.parameters.items() if name.endswith("_sd") and item.verdict != "fixed"]
    assert noises
    assert all(item.verdict in (Verdict.PRIOR_DOMINATED, Verdict.NOT_JUDGED) for item in noises)
    problem = wang(model="grip-slip")
    # Seven spins of 21 measurements, five parameters.
    assert degrees_of_freedom(problem, ("spin_sd",)) == pytest.approx(7 - 5 / 3)


def test_a_wall_that_others_make_ends_no_profile():
    problem = wang("wang_all.csv", pool={"cor_10": "group"})
    near = {
        "mass_ratio": 0.88, "k_y": 2e4, "k_theta": 20.0, "mu": 0.57, "eps_10": 0.0024, "eps_slope": 0.0,
        "cor_10": 0.77, "cor_slope": -0.015, "v_x_sd": 0.5, "v_y_sd": 0.3, "spin_sd": 14.0,
    }  # fmt: skip
    near |= {name: 0.05 if name.endswith("spread") else 0.0 for name in problem.free_names if name not in near}
    profile = profiles(problem, [near], names=["cor_slope"]).by_name["cor_slope"]
    assert profile.ends == (End.CLOSED, End.CLOSED)


def test_two_fits_are_said_and_what_they_agree_on():
    """All impacts grip but one: a friction that fits it, or any that is large, which misses it by little."""
    v_y = np.linspace(12.0, 28.0, 40)
    v_x, omega = np.full(40, 3.0), np.tile([-20.0, 20.0], 20)
    rebound = [column.copy() for column in grip_slip(v_x, v_y, omega, mu=2.0)]
    v_x, v_y, omega = (np.append(column, end) for column, end in ((v_x, 20.0), (v_y, 14.0), (omega, -60.0)))
    last = (v_x[-1:], v_y[-1:], omega[-1:])
    slid, gripped = grip_slip(*last, mu=0.39), grip_slip(*last, mu=2.0)
    assert slid[0] != pytest.approx(gripped[0])
    rebound = [np.append(one, end) for one, end in zip(rebound, slid, strict=True)]
    sds = {"v_x2_sd": np.full(41, 0.6), "v_y2_sd": np.full(41, 0.6), "omega_2_sd": np.full(41, 25.0)}
    table = fitball.load_table({**frame(v_x, v_y, omega, rebound), **sds})
    problem = build_problem(table, fitball.load_scene(None), Choices(model="grip-slip", velocity_noise="stated"))
    truth = {"mu": 0.39, "e_x": 0.15, "offset": 0.002, "cor_10": 0.77, "cor_slope": -0.012}
    words, agree = several_fits(problem, [truth, {**truth, "mu": 2.0}])
    misfit = densities(
        problem, np.array([[{**truth, "mu": mu}[n] for n in problem.free_names] for mu in (0.39, 2.0)])
    )
    assert 0.1 < float(np.diff(-misfit.likelihood)[0]) < 1.9
    assert words.startswith("Two fits")
    assert agree == {"e_x", "offset", "cor_10", "cor_slope"}
    assert several_fits(problem, [truth]) == ("", frozenset())
    # Places on the plateau are one fit, the peak beside it is another.
    objective = surface_of(problem)
    rows = [[{**truth, "mu": mu}[name] for name in problem.free_names] for mu in (2.0, 3.0, 0.39)]
    at = objective.from_values(np.array(rows))
    assert joined(objective, at[1], at[0]) and not joined(objective, at[2], at[0])
