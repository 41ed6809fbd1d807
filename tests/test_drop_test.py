"""Drop tests: restitution at the tested speed, the ITF's rebound, balls apart from noise, air."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from samples import drop_table, linear_problem, problem_of
from scipy.integrate import solve_ivp
from scipy.stats import chi2, norm
from scipy.stats import t as student

from fitball.data.heights import BALL_TYPES
from fitball.data.read import load_table
from fitball.data.scene import Scene
from fitball.data.table import Measurement
from fitball.inference.prediction.drop_test import drop_test, one_way, plain_mean, spread_of_balls
from fitball.inference.results.lab import (
    drag,
    fall_speed,
    fall_speed_in_air,
    launch_speed_in_air,
    rise_height,
    rise_height_in_air,
    share_within,
)
from fitball.inference.results.results import PointFit, Posterior
from fitball.report.fit.drop_words import ball_rows, drop_lead, drop_remarks, speed_rows, type_rows
from fitball.report.form.numbers import percent
from fitball.values import Ball, Impacts

V0 = 7.058171
FREE = ("cor_10", "cor_slope", "velocity_sd")


def rng(seed=0):
    return np.random.default_rng(seed)


def dropped(speeds, cor, balls=None, sd=None):
    """A table of drops with these measured restitutions."""
    speeds, cor = np.asarray(speeds, float), np.asarray(cor, float)
    table = drop_table(rng(), speeds.size)
    measured = replace(table.measurements[0], values=cor * speeds)
    impacts = Impacts(np.zeros(speeds.size), speeds, np.zeros(speeds.size), cor)
    return replace(
        table, impacts=impacts, measurements=(measured,), labels={} if balls is None else {"ball": tuple(balls)},
        incident_sd={} if sd is None else {"v_y1": np.full(speeds.size, sd)},
    )  # fmt: skip


def told(table, mean=0.745, sd=0.002, slope_sd=0.02, noise=0.03, draws=4000, **scene):
    """The drop test under a posterior that knows the restitution at 254 cm to `sd` and its slope to `slope_sd`."""
    problem = linear_problem(table, **scene)
    assert set(problem.free_names) == set(FREE)
    slope = slope_sd * rng(1).standard_normal(draws)
    at = mean + sd * rng(2).standard_normal(draws)
    columns = {"cor_10": at + slope * (10.0 - V0), "cor_slope": slope, "velocity_sd": np.full(draws, noise)}
    values = np.stack([columns[name] for name in problem.free_names], axis=1)
    best = {"cor_10": mean, "cor_slope": 0.0, "velocity_sd": noise}
    point = PointFit({**{item.name: item.fixed for item in problem.parameters}, **best}, 0, 0, {}, None, (), ())
    posterior = Posterior(problem.free_names, values[None, :, None], np.zeros((1, draws, 1)), values[:1])
    return drop_test(problem, point, posterior, rng(3)), (problem, point, posterior)


def test_one_speed_tells_the_restitution_there():
    """cor_10 is known to 0.06 and the slope not at all; the restitution at the tested speed to 0.002."""
    found, (_, _, posterior) = told(dropped([V0] * 12, [0.745] * 12))
    assert posterior.draws[:, 0].std() > 0.05
    (speed,) = found.speeds
    assert (speed.impacts, speed.speed) == (12, pytest.approx(V0))
    expected = norm(0.745, 0.002).ppf([0.5, 0.025, 0.16, 0.84, 0.975])
    cor = speed.cor
    np.testing.assert_allclose([cor.median, cor.q025, cor.q16, cor.q84, cor.q975], expected, atol=3e-4)
    rebound = found.rebound
    assert rebound.height.median == pytest.approx(2.54 * 0.745**2, abs=2e-4)
    assert rebound.height.q975 == pytest.approx(2.54 * expected[-1] ** 2, abs=1.5e-3)
    # One more drop has the measurement noise besides: 0.03 m/s of 7.06.
    wide = np.hypot(0.002, 0.03 / V0)
    assert rebound.drop.q975 - rebound.drop.q025 == pytest.approx(2.54 * 2 * 0.745 * 2 * 1.96 * wide, rel=0.06)
    lead, remarks = drop_lead(found), drop_remarks(found)
    assert lead[0].startswith("COR at 7.06 m/s: 0.745")
    assert "type 2" in lead[-1] and "ball.type" in lead[-1]
    assert any("cor_10 and cor_slope" in line for line in remarks)
    assert any("No column names the ball" in line for line in remarks)


def test_other_balls_are_not_judged_by_the_rules_of_tennis():
    """A basketball has a restitution, but no limits of the ITF; a foam ball, and what is stated as a type, have."""
    drops, basketball = dropped([6.0] * 12, [0.745] * 12), Ball(0.62, 0.12, 0.6 * 0.62 * 0.12**2)
    found, _ = told(drops, ball=basketball)
    assert found.rebound is None and not found.missing
    assert speed_rows(found)[0]["COR"].startswith("0.7") and type_rows(found) == []
    words = " ".join((*drop_lead(found), *drop_remarks(found)))
    assert "COR at 6.00 m/s" in words and "no tennis ball" in words
    assert not any(item in words for item in ("passes", "Limits:", "The ITF tests"))
    foam = Ball(0.03, 0.044, 0.5 * 0.03 * 0.044**2)
    assert told(drops, ball=foam)[0].rebound and told(drops, ball=basketball, ball_type="stage-1")[0].rebound


@pytest.mark.parametrize(
    ("mean", "kind"), [(0.745, "type-2"), (0.760, "type-2"), (0.760, "type-1"), (0.70, "stage-1")]
)
def test_probability_to_pass_is_that_of_the_limits(mean, kind):
    found, _ = told(dropped([V0] * 6, [mean] * 6), mean=mean, sd=0.004, ball_type=kind)
    ends = np.sqrt(np.array([BALL_TYPES[kind].lowest, BALL_TYPES[kind].highest]) / 2.54)
    low, high = norm(mean, 0.004).cdf(ends)
    assert found.rebound.passing[kind].mean == pytest.approx(high - low, abs=0.025)
    assert found.rebound.passing[kind].ball is None
    assert "ball.type" not in drop_lead(found)[-1]
    assert [row["ball"] for row in type_rows(found)] == [item.words for item in BALL_TYPES.values()]


def test_limits_are_those_of_the_itf():
    limits = {name: (round(100 * item.lowest), round(100 * item.highest)) for name, item in BALL_TYPES.items()}
    assert limits == {
        "type-1": (138, 151), "type-2": (135, 147), "type-3": (135, 147), "high-altitude": (122, 135),
        "stage-1": (120, 135), "stage-2": (105, 120), "stage-3": (90, 105), "stage-3-foam": (85, 105),
    }  # fmt: skip
    assert share_within(np.array([1.349, 1.35, 1.47, 1.471, np.nan]), "type-2") == 0.5


def test_speeds_that_were_meant_to_be_the_same_count_as_one():
    found, _ = told(dropped([4.0, 4.02, 4.05, 7.0, 7.1, 10.0], [0.8, 0.8, 0.8, 0.75, 0.75, 0.7]), slope_sd=0.001)
    assert [item.impacts for item in found.speeds] == [3, 2, 1]
    assert found.speeds[0].measured == pytest.approx(0.8) and found.speeds[0].scatter == pytest.approx(0.0, abs=1e-9)
    assert found.speeds[2].scatter is None
    spread = np.linspace(3.0, 12.0, 40)
    found, _ = told(dropped(spread, np.full(40, 0.75)))
    assert [item.speed for item in found.speeds] == pytest.approx([3.0, 7.5, 12.0], rel=0.03)


def test_a_landing_speed_beyond_the_tested_ones_is_told():
    found, _ = told(dropped([4.0] * 8, [0.75] * 8))
    assert found.rebound.beyond == pytest.approx(V0 - 4.0, abs=1e-3)
    assert any("3.1 m/s above the tested ones" in line and "prior" in line for line in drop_remarks(found))


def test_air_is_that_of_an_integrated_fall():
    k = drag(Ball())
    fall = solve_ivp(
        lambda _, y: [y[1], 9.80665 - k * y[1] ** 2], (0, 2), [0.0, 0.0], rtol=1e-10, atol=1e-12,
        events=[lambda _, y: y[0] - 2.54],
    )  # fmt: skip
    assert fall.y_events[0][0][1] == pytest.approx(fall_speed_in_air(2.54, k), rel=1e-7)
    rise = solve_ivp(
        lambda _, y: [y[1], -9.80665 - k * y[1] ** 2], (0, 2), [0.0, 5.0], rtol=1e-10, atol=1e-12,
        events=[lambda _, y: y[1]],
    )  # fmt: skip
    assert rise.y_events[0][0][0] == pytest.approx(float(rise_height_in_air(np.array(5.0), k)), rel=1e-7)
    assert fall_speed(2.54) == pytest.approx(V0, rel=1e-6)
    assert float(rise_height(np.array(V0))) == pytest.approx(2.54, rel=1e-6)
    up = float(rise_height_in_air(np.array(5.0), k))
    assert launch_speed_in_air(up, k) == pytest.approx(5.0)
    # Without air the two agree.
    assert fall_speed_in_air(2.54, 1e-9) == pytest.approx(V0, rel=1e-6)
    found, _ = told(dropped([V0] * 6, [0.745] * 6))
    assert found.rebound.with_air.median == pytest.approx(0.933 * found.rebound.height.median, rel=0.01)
    assert found.rebound.with_air.point == pytest.approx(0.933 * found.rebound.height.point, rel=0.01)
    assert found.rebound.passing_with_air < 0.1 < found.rebound.passing["type-2"].mean


def test_heights_are_known_as_such(tmp_path):
    """A table of heights: the rebound is theirs, whatever the air does, and restitution is a little more with it."""
    place = tmp_path / "heights.csv"
    place.write_text("drop_height [cm],rebound_height [cm]\n" + "254,141\n254,140\n254,142\n" * 2, encoding="utf-8")
    found, _ = told(load_table(place), mean=np.sqrt(141 / 254))
    assert found.from_heights
    k = drag(Ball())
    assert found.rebound.height.median == pytest.approx(1.41, abs=1e-3)
    share = launch_speed_in_air(1.41, k) / fall_speed_in_air(2.54, k) / np.sqrt(141 / 254) - 1
    assert found.rebound.air_share == pytest.approx(share, rel=1e-3)
    assert 0.03 < share < 0.04
    said = drop_remarks(found)
    assert any("heights" in line and f"{100 * share:.1f} % larger" in line for line in said)
    assert not told(dropped([V0] * 6, [0.745] * 6))[0].from_heights


def test_stated_errors_and_temperature_are_told():
    found, _ = told(dropped([V0] * 6, [0.745] * 6, sd=0.0353), ball_temperature=28.0)
    assert found.shared_error == pytest.approx(0.745 * 0.0353 / V0)
    said = drop_remarks(found)
    assert any("an sd of 0.0037" in line for line in said)
    assert any("28 degrees Celsius" in line and "at 20" in line for line in said)


def repeats(balls, each, between, within, seed):
    source = rng(seed)
    names = [f"b{k}" for k in range(balls) for _ in range(each)]
    values = 0.745 + np.repeat(between * source.standard_normal(balls), each)
    return names, values + within * source.standard_normal(balls * each)


def test_balls_are_told_apart_from_noise_and_count_as_a_sample():
    names, cor = repeats(12, 4, 0.010, 0.003, 5)
    found, _ = told(dropped([V0] * 48, cor, names))
    means = cor.reshape(12, 4).mean(axis=1)
    # The analysis of variance: mean squares between and within.
    inside = np.sqrt(np.mean(cor.reshape(12, 4).var(axis=1, ddof=1)))
    outside = np.sqrt(means.var(ddof=1) - inside**2 / 4)
    assert found.balls_counted
    assert found.variation.within.median == pytest.approx(inside, rel=0.05)
    assert found.variation.between.median == pytest.approx(outside, rel=0.15)
    cor_there = found.speeds[0].cor
    assert cor_there.median == pytest.approx(means.mean(), abs=5e-4)
    assert (cor_there.q975 - cor_there.q025) / 3.92 == pytest.approx(means.std(ddof=1) / np.sqrt(12), rel=0.25)
    assert [ball.label for ball in found.balls] == list(dict.fromkeys(names))
    heights = [ball.height.median for ball in found.balls]
    np.testing.assert_allclose(heights, 2.54 * means**2, atol=0.006)
    worst = int(np.argmax(np.abs(np.array(heights) - 1.41)))
    assert found.balls[worst].passes == min(ball.passes for ball in found.balls)
    passing = found.rebound.passing["type-2"]
    assert passing.drop <= passing.ball <= passing.mean
    # The next of twelve normal numbers follows Student's t.
    next_ball = student(11, means.mean(), means.std(ddof=1) * np.sqrt(1 + 1 / 12))
    low, high = next_ball.cdf(np.sqrt(np.array([1.35, 1.47]) / 2.54))
    assert passing.ball == pytest.approx(high - low, abs=0.06)
    assert passing.mean > 0.99
    assert ball_rows(found)[0]["ball"] == "b0"
    # To the slower landing in air the slope of the fit carries it, of which little is known.
    height, air = (item.q975 - item.q025 for item in (found.rebound.height, found.rebound.with_air))
    assert air > 1.2 * height
    assert drop_lead(found)[-1].endswith(f"with {percent(passing.drop)}.")
    assert f"another ball of this make with {percent(passing.ball)}" in drop_lead(found)[-1]


@pytest.mark.parametrize(
    ("names", "why"),
    [(["a", "b", "c", "d", "e", "f"], "too few repeats"), (["a", "a", "a", "a", "a", "a"], "fewer than two")],
)
def test_without_repeats_nothing_is_told_of_balls(names, why):
    found, _ = told(dropped([V0] * 6, 0.745 + 0.002 * np.arange(6), names))
    assert not found.balls_counted and found.balls == ()
    assert why in found.variation.missing
    assert any(found.variation.missing in line for line in drop_remarks(found))
    found, _ = told(dropped([V0] * 6, [0.745] * 6, ["a", "a", "b", "b", "c", "c"]))
    assert "identical" in found.variation.missing


def test_intervals_of_one_way_hold_the_truth_and_those_that_forget_the_balls_do_not():
    rounds, balls, each = 150, 8, 3
    inside = {"mean": 0, "between": 0, "within": 0, "ball": 0, "forgetting": 0}
    index = np.repeat(np.arange(balls), each)
    for k in range(rounds):
        source = rng([7, k])
        shift = 0.010 * source.standard_normal(balls)
        values = 0.745 + shift[index] + 0.004 * source.standard_normal(index.size)
        found = one_way(values, np.ones((index.size, 1)), index, spread_of_balls(True), source)
        truths = {"mean": 0.745, "between": 0.010, "within": 0.004, "ball": 0.745 + shift[0]}
        drawn = {
            "mean": found.coefficients[:, 0], "between": found.between, "within": found.within,
            "ball": found.coefficients[:, 0] + found.shifts[:, 0],
        }  # fmt: skip
        truths["forgetting"], drawn["forgetting"] = 0.745, plain_mean(values, source)[0]
        for name, draws in drawn.items():
            low, high = np.quantile(draws, (0.025, 0.975))
            inside[name] += low <= truths[name] <= high
    shares = {name: count / rounds for name, count in inside.items()}
    assert all(0.89 <= shares[name] <= 0.995 for name in ("mean", "between", "within", "ball")), shares
    assert shares["forgetting"] < 0.85


def test_a_plain_mean_is_known_as_students_distribution_has_it():
    mean, spread = plain_mean(np.array([1.0, 2.0, 3.0, 4.0]), rng(4))
    half = student.ppf(0.975, 3) * np.sqrt(5.0 / 3.0) / 2.0
    np.testing.assert_allclose(np.quantile(mean, [0.025, 0.975]), [2.5 - half, 2.5 + half], rtol=0.1)
    np.testing.assert_allclose(np.median(spread), np.sqrt(5.0 / chi2.ppf(0.5, 3)), rtol=0.04)


def test_where_nothing_was_dropped_there_is_no_drop_test():
    for name in ("wang_all.csv", "wang_zero_spin.csv"):
        problem = problem_of(load_table(name), "grip-slip")
        assert drop_test(problem, PointFit({}, 0, 0, {}, None, (), ()), None, rng()) is None
    found, (problem, point, _) = told(dropped([V0] * 6, [0.745] * 6))
    assert found.missing == ""
    table = dropped([V0] * 6, [0.745] * 6)
    table = replace(table, measurements=(*table.measurements, Measurement("contact_time", np.full(6, 5e-3))))
    measured = problem_of(table, "two-mass", scene=Scene(), closures={"cor": "measured"})
    said = drop_test(measured, point, None, rng())
    assert "cor = measured" in said.missing and said.speeds == ()
    alone = drop_test(problem, point, None, rng())
    assert alone.speeds[0].cor.median is None and alone.rebound.passing["type-2"].mean is None
    assert "best value is within" in drop_lead(alone)[-1]
