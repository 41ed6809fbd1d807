"""Laws of restitution: their slopes, where a search for another begins, what rests on them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from support.density import REBOUND, problem_of, table_of

import fitball
from fitball.base.values import Impacts
from fitball.inference.judgement.laws import values_under
from fitball.models.kernels.contact import FLAG_CHOICES

DATA = Path(__file__).parent / "data"
LAWS = dict(FLAG_CHOICES)["cor"]
MODELS = ("two-mass", "two-mass+normal=total", "grip-slip")
# 0.76 (v/10)^-0.158, by which two tables were simulated.
SLOPE_OF_POWER = -0.158 * 0.076


def drops(speeds):
    return Impacts(np.zeros(len(speeds)), np.array(speeds), np.zeros(len(speeds)))


def restitution(model, parameters, speeds):
    """The restitution at vertical speeds, of the parameters that the model has."""
    names = {spec.name for spec in model.parameters}
    of_model = {name: value for name, value in parameters.items() if name in names}
    return model.rebound(of_model, drops(speeds)).v_y2 / speeds


@pytest.mark.parametrize("cor_slope", [-0.02, -1e-6, 0.0, 1e-6, 0.004])
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("text", MODELS)
def test_a_law_has_its_value_and_slope_at_10_m_per_s(text, law, cor_slope):
    model = fitball.model(text, cor=law)
    parameters = {spec.name: spec.typical for spec in model.parameters}
    parameters |= {"cor_10": 0.75, "cor_slope": cor_slope}
    step = 1e-3
    slower, cor, faster = restitution(model, parameters, [10.0 - step, 10.0, 10.0 + step])
    assert cor == pytest.approx(0.75, rel=1e-14)
    slope = -0.75 / 40.0 if law == "root" else cor_slope
    # The third derivatives are below 1e-2 (m/s)^-3.
    assert (faster - slower) / (2.0 * step) == pytest.approx(slope, abs=1e-8)


def test_without_a_slope_all_laws_are_constant():
    parameters = {"mu": 0.5, "e_x": 0.0, "offset": 0.0, "cor_10": 0.7, "cor_slope": 0.0}
    for law in ("saturating", "power", "line"):
        model = fitball.model(f"grip-slip+cor={law}")
        assert_allclose(restitution(model, parameters, [0.01, 3.0, 80.0]), 0.7, rtol=1e-15)


@pytest.mark.parametrize("factor", [0.2, 1.0, 2.0])
@pytest.mark.parametrize("law", LAWS[1:])
@pytest.mark.parametrize("text", ["two-mass", "grip-slip"])
def test_a_search_begins_at_the_same_restitution_and_slope(text, law, factor):
    """At the median speed of the table, usual or twice that; of slow impacts none is beyond what
    the law allows.
    """
    problem = problem_of(table_of(REBOUND, count=12), None, text)
    speeds = factor * problem.rows.states.v_y1
    rows = replace(problem.rows, states=drops(speeds))
    values = {spec.name: spec.typical for spec in problem.forward.model.parameters}
    changed = values_under(law, replace(problem, rows=rows), values)
    other = fitball.model(text, cor=law)
    assert np.all(restitution(other, changed, speeds) > 0.0)
    if factor < 1.0:
        return
    median = float(np.median(speeds))
    near = median * np.array([0.999, 1.0, 1.001])
    here = restitution(fitball.model(text), values, near)
    there = restitution(other, changed, near)
    # Extrapolated to 10 m/s, a power of fast balls may come to the limit.
    assert there[1] == pytest.approx(here[1], rel=1e-12 if factor == 1.0 else 3e-3)
    slope = (here[2] - here[0]) / (near[2] - near[0])
    if law == "root":
        slope = -0.25 * here[1] / median
    assert (there[2] - there[0]) / (near[2] - near[0]) == pytest.approx(slope, rel=3e-3)


@pytest.mark.parametrize("name", ["power_law_rigid", "power_law_sphere"])
def test_a_slope_rests_on_the_law(name):
    """A rigid ball, and an elastic sphere, whose restitution is a power of the speed."""
    fit = fitball.calibrate(DATA / f"{name}.csv", point_only=True, cores=1)
    row = fit.summary.loc["cor_slope"]
    inside = row["profile_low"] <= SLOPE_OF_POWER <= row["profile_high"]
    assert inside or row["verdict"] in ("given", "conditional")
    assert "cor=saturating" in row["given"].split("; ")
    tried = {alternative.choice: alternative for alternative in fit.alternatives}
    assert {"cor=power", "cor=line", "cor=root"} <= {*tried}
    power = tried["cor=power"]
    assert power.model == "two-mass+cor=power"
    assert power.as_good
    slope = power.summaries["cor_slope"]
    assert slope.q025 < SLOPE_OF_POWER < slope.q975
    assert not tried["cor=root"].as_good


def test_slopes_at_10_m_per_s_are_extrapolated_from_slow_drops():
    """Restitution is 0.78 - 0.020 (v - 3 m/s), from 1.5 to 4.5 m/s."""
    table = DATA / "line_of_slow_drops.csv"
    fit = fitball.calibrate(table, point_only=True, cores=1)
    summary = fit.summary
    assert summary.loc["cor_slope", "verdict"] == "extrapolated"
    assert summary.loc["cor_10", "verdict"] == "extrapolated"
    measured = pd.read_csv(table)
    speed = measured["v_y1 [m/s]"]
    line, _ = np.polyfit(speed, measured["v_y2 [m/s]"] / speed, 1)
    here = fit.derived["cor_slope_median"]
    assert here.verdict in ("identified", "given")
    assert here.point == pytest.approx(line, abs=3e-3)
    assert here.point == pytest.approx(-0.020, abs=4e-3)
    # A line through the same drops says so too, at any speed.
    straight = fitball.calibrate(
        table, model="two-mass+normal=total+cor=line", point_only=True, cores=1
    )
    at_10 = straight.parameters["cor_slope"]
    assert at_10.verdict == "extrapolated"
    assert straight.derived["cor_slope_median"].point == pytest.approx(at_10.point, rel=1e-9)


def test_the_slope_of_the_offset_is_extrapolated_as_the_offset():
    table = table_of(REBOUND, count=24)
    slow = np.flatnonzero(table.impacts.v_y1 < 8.0)
    fit = fitball.calibrate(table.take(slow), point_only=True, cores=1)
    for name in ("eps_10", "eps_slope", "cor_10", "cor_slope"):
        assert fit.parameters[name].verdict in ("extrapolated", "prior-dominated"), name
    slope = fit.derived["eps_slope_median"]
    assert slope.point == pytest.approx(fit.parameters["eps_slope"].point, rel=1e-9)
    assert slope.verdict != "extrapolated"


def test_a_root_has_no_slope_and_its_value_is_extrapolated():
    fit = fitball.calibrate(
        DATA / "line_of_slow_drops.csv",
        model="two-mass+normal=total+cor=root",
        point_only=True,
        cores=1,
    )
    assert "cor_slope" not in fit.parameters
    assert fit.parameters["cor_10"].verdict == "extrapolated"
    assert fit.derived["cor_median"].verdict in ("identified", "given", "conditional")
