"""Predictions of new impacts: against independent Monte Carlo, at the command line, and where they must warn."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import fitball
from fitball.data.lines import parse_impact
from fitball.errors import ModelError, ParameterError
from fitball.inference.prediction.new_impacts import BATCH, impacts_seen, predict_new, scores
from fitball.inference.prediction.reach import calibrated_range, hull_distances
from fitball.inference.problem.observables import Observable
from fitball.inference.results.fitted_model import FittedModel
from fitball.report.predict.rows import prediction_csv_rows, prediction_json, remarks_on

NAMES = ("mu", "e_x", "offset", "cor_10", "cor_slope", "velocity_sd", "spin_sd")
BALL = fitball.Ball()
CENTRE = np.array([0.6, 0.1, 2e-3, 0.75, -0.015, 0.4, 12.0])
LEVELS = (0.025, 0.16, 0.5, 0.84, 0.975)


def fitted_grip_slip(draws=3000, spread=0.05, names=NAMES, **changes):
    """A grip-slip model with draws around CENTRE, calibrated on a box of impacts."""
    rng = np.random.default_rng(7)
    values = CENTRE * (1.0 + spread * rng.standard_normal((draws, len(NAMES))))
    kept = [NAMES.index(name) for name in names]
    corners = np.array([[x, y, w] for x in (8.0, 16.0) for y in (5.0, 15.0) for w in (-100.0, 100.0)])
    made = FittedModel("grip-slip", {}, BALL, True, names, CENTRE[kept], values[:, kept], fitball.impacts(*corners.T))
    return replace(made, **changes)


def bounce(values, v_x, v_y, omega):
    """Cross (2002): the algebraic bounce written anew, one impact, many draws."""
    mu, e_x, offset, cor_10, slope = values.T[:5]
    mass, radius, inertia = BALL.mass, BALL.radius, BALL.inertia
    cor = cor_10 + slope * (v_y - 10.0)
    push = mass * (1.0 + cor) * v_y
    # Grip: (1 + e_x) of the slip is undone by the impulse J and its torque, with the normal force ahead by offset.
    reach = 1.0 / mass + radius**2 / inertia
    impulse = ((1.0 + e_x) * (v_x - radius * omega) + radius * offset * push / inertia) / reach
    impulse = np.minimum(np.maximum(impulse, -mu * push), mu * push)
    return v_x - impulse / mass, cor * v_y, omega + (radius * impulse - offset * push) / inertia


def test_intervals_against_direct_monte_carlo():
    fitted = fitted_grip_slip(draws=40_000)
    found = predict_new(fitted, fitball.impacts([12.0, 15.0], [9.0, 6.0], [20.0, -50.0]), seed=3)
    rng = np.random.default_rng(99)
    for k, impact in enumerate([(12.0, 9.0, 20.0), (15.0, 6.0, -50.0)]):
        v_x, v_y, omega = bounce(fitted.draws, *impact)
        truth = {
            "v_x2": v_x,
            "v_y2": v_y,
            "omega_2": omega,
            "v_2": np.hypot(v_x, v_y),
            "theta_2": np.arctan(v_y / v_x),
        }
        sd = dict.fromkeys(truth, fitted.draws[:, 5]) | {"omega_2": fitted.draws[:, 6]}
        sd["theta_2"] = sd["theta_2"] / truth["v_2"]
        for name, values in truth.items():
            item = found.output(name)
            np.testing.assert_allclose(item.rebound[:, k], np.quantile(values, LEVELS), rtol=1e-10)
            # Half a million independent measurements against forty thousand: the standard error of the difference
            # is 0.014 sd at the ends of 95 %, less inside.
            which = rng.integers(len(values), size=500_000)
            measured = values[which] + sd[name][which] * rng.standard_normal(which.size)
            errors = (item.measured[:, k] - np.quantile(measured, LEVELS)) / measured.std()
            assert np.all(np.abs(errors) < 0.06), (name, errors)
            assert item.sd[k] == pytest.approx(measured.std(), rel=0.02)
            assert item.mean[k] == pytest.approx(measured.mean(), abs=0.03 * measured.std())


def test_intervals_nest_and_noise_widens():
    found = predict_new(fitted_grip_slip(), fitball.impacts([9.0, 12.0, 15.0], [6.0, 9.0, 14.0], [0.0, 90.0, -90.0]))
    assert [item.name for item in found.outputs] == ["v_x2", "v_y2", "v_2", "theta_2", "omega_2"]
    for item in found.outputs:
        assert np.all(np.diff(item.rebound, axis=0) > 0.0)
        assert np.all(np.diff(item.measured, axis=0) > 0.0)
        for low, high in ((0, 4), (1, 3)):
            assert np.all(item.measured[low] < item.rebound[low])
            assert np.all(item.measured[high] > item.rebound[high])
    assert all(sum(shares.values()) == pytest.approx(1.0) for shares in found.regimes)


def test_seed_moves_the_noise_only_and_batches_do_not_matter():
    fitted = fitted_grip_slip(draws=40)
    rng = np.random.default_rng(0)
    many = fitball.impacts(*(rng.uniform(low, high, BATCH + 3) for low, high in ((8, 16), (5, 15), (-100, 100))))
    first, again, other = (predict_new(fitted, many, seed=seed) for seed in (1, 1, 2))
    for a, b, c in zip(first.outputs, again.outputs, other.outputs, strict=True):
        assert a.measured.tobytes() == b.measured.tobytes() != c.measured.tobytes()
        assert a.rebound.tobytes() == c.rebound.tobytes()
    last = fitball.impacts(*(getattr(many, name)[-1] for name in ("v_x1", "v_y1", "omega_1")))
    alone = predict_new(fitted, last)
    assert alone.output("v_x2").rebound[:, 0].tobytes() == first.output("v_x2").rebound[:, -1].tobytes()


def test_without_draws_only_the_point():
    found = predict_new(fitted_grip_slip(draws=0), fitball.impacts(12.0, 9.0, 20.0))
    assert found.draws == 0
    for item, value in zip(
        (found.output(name) for name in ("v_x2", "v_y2", "omega_2")),
        bounce(CENTRE[None], 12.0, 9.0, 20.0),
        strict=True,
    ):
        assert item.point[0] == pytest.approx(value[0], rel=1e-12)
        assert item.rebound is item.measured is item.sd is None


def test_unknown_noise_gives_no_measurement_but_stated_noise_does():
    fitted = fitted_grip_slip(names=NAMES[:6])
    impacts = fitball.impacts([12.0, 13.0], 9.0, 20.0)
    found = predict_new(fitted, impacts)
    assert found.output("omega_2").measured is None
    assert found.output("v_x2").measured is not None
    stated = Observable("omega_2", np.array([200.0, 210.0]), np.array([1.0, 50.0]), None)
    item = predict_new(fitted, impacts, [stated]).output("omega_2")
    inner = item.rebound[4] - item.rebound[0]
    outer = item.measured[4] - item.measured[0]
    assert outer[0] < 1.2 * inner[0]
    assert outer[1] > 150.0


def test_draws_that_cannot_be_solved_are_told_with_the_reason():
    fitted = fitted_grip_slip()
    raised = fitted.draws.copy()
    raised[: len(raised) // 4, 3] = 1.2
    raised[:, 4] = -0.01
    found = predict_new(replace(fitted, draws=raised), fitball.impacts([12.0, 12.0], [9.0, 100.0], 0.0))
    (reason, share), = found.failures[0].items()  # fmt: skip
    assert share == pytest.approx(0.25)
    assert "(0, 1]" in reason
    v_y = bounce(raised[len(raised) // 4 :], 12.0, 9.0, 0.0)[1]
    np.testing.assert_allclose(found.output("v_y2").rebound[:, 0], np.quantile(v_y, LEVELS), rtol=1e-10)
    assert sum(found.regimes[0].values()) == pytest.approx(1.0)
    assert set(found.regimes[0]) <= {"slide", "slide back", "grip"}
    # At 100 m/s the line has no restitution left for all but the raised quarter, which keeps 0.3.
    assert sum(found.failures[1].values()) == pytest.approx(0.75)
    np.testing.assert_allclose(found.unsolved, [0.25, 0.75])
    # Intervals of the rest where they are most, none of a minority; the same in words, in CSV and in JSON.
    assert found.withheld.tolist() == [False, True]
    for output in found.outputs:
        for array in (output.rebound, output.measured, output.mean, output.sd):
            assert np.all(np.isnan(array[..., 1])) and not np.any(np.isnan(array[..., 0]))
    remarks = [" ".join(remarks_on(found, row)) for row in (0, 1)]
    assert "25 % of the draws" in remarks[0] and "no intervals" not in remarks[0]
    assert "75 % of the draws" in remarks[1] and "no intervals" in remarks[1]
    rows = prediction_csv_rows(found, ("a", "b"))
    assert [row["intervals"] for row in rows] == ["the draws that can be solved", "withheld"]
    assert [row["failed"] for row in rows] == pytest.approx([0.25, 0.75])
    assert rows[1]["v_y2_median [m/s]"] is None and rows[0]["v_y2_median [m/s]"] is not None
    told = prediction_json(found, ("a", "b"), (), ())["impacts"]
    assert [item["intervals"] for item in told] == ["the draws that can be solved", "withheld"]
    assert told[1]["outputs"]["v_y2"]["median"] is None


def test_hull_distance_of_a_cube_a_plane_and_a_point():
    cube = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    places = np.array([[0.5, 0.5, 0.5], [2.0, 0.5, 0.5], [2.0, 2.0, 0.5], [-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
    np.testing.assert_allclose(
        hull_distances(cube, places), [0.0, 1.0, math.sqrt(2.0), math.sqrt(3.0), 0.0], atol=1e-12
    )
    flat = cube[cube[:, 2] == 0.0] * 1e3
    np.testing.assert_allclose(hull_distances(flat, np.array([[500.0, 500.0, 7.0]])), [7.0], rtol=1e-9)
    np.testing.assert_allclose(hull_distances(cube[:1], np.array([[3.0, 4.0, 0.0]])), [5.0], rtol=1e-9)


def test_range_flags_say_which_quantity_and_by_how_much():
    known = fitball.impacts([16.0, 12.0, 6.0], [5.0, 12.0, 16.0], [-100.0, 0.0, 100.0])
    new = fitball.impacts(
        [12.0, 12.0, 12.0, 12.0, 20.0], [12.0, 18.0, 12.0, 12.0, 5.0], [0.0, 0.0, 150.0, -130.0, 0.0]
    )
    found = calibrated_range(known, new, 0.033, True, ("COR",))
    np.testing.assert_allclose(found.beyond["v_y1"], [0.0, 2.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(found.beyond["omega_1"], [0.0, 0.0, 50.0, -30.0, 0.0])
    assert found.beyond["theta_1"][4] == pytest.approx(math.atan2(5.0, 20.0) - math.atan2(5.0, 16.0))
    assert found.outside.tolist() == [False, True, True, True, True]
    itself = calibrated_range(known, known, 0.033, True, ())
    assert not itself.outside.any()
    np.testing.assert_allclose(itself.hull_distance, 0.0, atol=1e-12)
    # Every quantity within its limits, and yet new: half as fast at the middle angle.
    slow = calibrated_range(known, fitball.impacts(6.0, 6.0, 0.0), 0.033, True, ())
    assert all(column[0] == 0.0 for column in slow.beyond.values())
    assert slow.new_combination[0]
    assert slow.outside[0]
    drop = calibrated_range(fitball.impacts(0.0, [3.0, 9.0]), fitball.impacts(0.0, [2.0, 5.0]), 0.033, False, ())
    assert drop.hull_distance is None
    assert drop.outside.tolist() == [True, False]


def test_a_drop_test_predicts_the_vertical_motion_and_nothing_else():
    names, values = ("k_y", "cor_10", "cor_slope", "velocity_sd"), np.array([2e4, 0.75, -0.01, 0.1])
    known = fitball.impacts(0.0, [3.0, 9.0])
    drop = FittedModel("two-mass", {"normal": "total"}, BALL, False, names, values, values[None, :], known)
    found = predict_new(drop, fitball.impacts(0.0, [5.0, 10.0]))
    assert [item.name for item in found.outputs] == ["v_y2", "contact_time"]
    np.testing.assert_allclose(found.output("v_y2").point, [5.0 * 0.8, 10.0 * 0.75])
    assert found.regimes == ({}, {})
    assert found.range.outside.tolist() == [False, True]


def test_validation_counts_what_it_says():
    fitted = fitted_grip_slip()
    impacts = fitball.impacts(np.full(4, 12.0), 9.0, 20.0)
    plain = predict_new(fitted, impacts)
    mean, sd = plain.output("v_y2").mean, plain.output("v_y2").sd
    observed = mean + sd * np.array([0.0, 0.5, -1.5, 3.0])
    found = predict_new(fitted, impacts, [Observable("v_y2", observed, None, "velocity_sd")])
    (score,) = scores(found)
    assert (score.output, score.impacts, score.within_68, score.within_95) == ("v_y2", 4, 0.5, 0.75)
    np.testing.assert_allclose(found.output("v_y2").z, [0.0, 0.5, -1.5, 3.0], atol=0.1)
    assert score.rms_z == pytest.approx(math.sqrt((0.25 + 2.25 + 9.0) / 4), rel=0.05)
    assert score.bias == pytest.approx(np.mean(observed - found.output("v_y2").rebound[2]))
    assert impacts_seen(fitted.impacts, fitball.impacts([8.0, 9.0], [5.0, 5.0], [100.0, 100.0])) == 1


def test_measured_restitution_needs_its_column():
    fitted = FittedModel(
        "two-mass", {"cor": "measured"}, BALL, True, ("mass_ratio",), np.array([0.9]), np.empty((0, 1)),
        fitball.impacts(10.0, 10.0),
    )  # fmt: skip
    with pytest.raises(ModelError, match="v_y2 of every impact"):
        predict_new(fitted, fitball.impacts(10.0, 10.0))


@pytest.mark.parametrize(
    ("text", "speed", "degrees", "spin"),
    [
        ("v=38 mph, theta=18 deg, spin=950 rpm top", 38 * 0.44704, 18.0, 950 * math.pi / 30),
        ("v=61.2km/h,theta=0.3 rad,spin=950rpm back", 17.0, math.degrees(0.3), -950 * math.pi / 30),
        ("v=17, theta=18, omega=-100", 17.0, 18.0, -100.0),
        ("v_1=17 m/s, theta_1=18 deg", 17.0, 18.0, 0.0),
        ("v_x=3, v_y=4, omega=2 rev/s topspin", 5.0, math.degrees(math.atan2(4, 3)), 4 * math.pi),
        ("v_y=5 m/s", 5.0, 90.0, 0.0),
        ("v_x=3, v_y=4, spin=180 deg/s backspin", 5.0, math.degrees(math.atan2(4, 3)), -math.pi),
        ("v_x1=-3, v_y1=4, omega_1=1e2", 5.0, math.degrees(math.atan2(4, -3)), 100.0),
    ],
)
def test_an_impact_in_words(text, speed, degrees, spin):
    found = parse_impact(text)
    assert math.hypot(found.v_x1[0], found.v_y1[0]) == pytest.approx(speed, rel=1e-12)
    assert math.degrees(math.atan2(found.v_y1[0], found.v_x1[0])) == pytest.approx(degrees, rel=1e-12)
    assert found.omega_1[0] == pytest.approx(spin, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "expected NAME=VALUE UNIT"),
        ("v=38 mph", "read v_1; expected v and theta"),
        ("v=38 mhp, theta=18", "did you mean 'mph'"),
        ("v=38 deg, theta=18", "measures angle"),
        ("v=fast, theta=18", "read 'fast', expected a number"),
        ("speed=38, theta=18", "unknown quantity 'speed'"),
        ("v=38, theta=18, v=37", "given twice"),
        ("v=38, theta=18, v_x=3", "expected v and theta"),
        ("v=38, theta=0", "between 0 and 180 deg"),
        ("v=-3, theta=10", "positive speed v"),
        ("v_x=3, v_y=-2", "positive speed v_y"),
        ("v=38, theta=18, spin=-9 rpm top", "either a sign or top/back"),
        ("v=38, theta=18, spin=9 rpm up", "unknown"),
        ("v=1e999, theta=18", "finite"),
        ("spin=100", "no velocity"),
    ],
)
def test_a_bad_impact_is_quoted(text, words):
    with pytest.raises(ParameterError) as caught:
        parse_impact(text)
    assert words in str(caught.value)
    assert f"impact '{text}'" in str(caught.value)
