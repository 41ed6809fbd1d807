"""`scripts/validate --plan`: what is simulated and refitted, and when a promise counts as kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm
from validation import command as validate
from validation.plan import run
from validation.plan.cases import CASES, Case
from validation.plan.findings import finding
from validation.plan.replicate import AGAIN, PLANNED, Narrowed, extended, planned_from, replicate

from fitball.errors import FitError
from fitball.inference.design.sensor import PlannedColumn
from fitball.inference.likelihood.posterior import log_posterior

CASE = Case(
    "friction", "wang_all", "grip-slip", "mu", 2, {"speed": "10:30:2", "angle": "15:60:3", "spin": "-200:200:2"}
)


@pytest.fixture(scope="module")
def ready(grip_slip_fit):
    return planned_from(CASE, grip_slip_fit, 1)


def test_new_impacts_enter_the_density_beside_those_of_the_table(ready):
    """The old density and that of each new measurement, by scipy."""
    problem, design = ready.known.problem, ready.designs[PLANNED]
    y = np.array([[3.0, 5.0, 100.0], [2.0, 6.0, 50.0]])
    at = ready.known.coordinates[:3]
    values = problem.all_values(problem.to_values(at))
    rebound = problem.rebound(problem.to_values(at), design.impacts)
    expected = log_posterior(problem, at)
    for k, column in enumerate(design.sensor.columns):
        sd = values[column.noise][:, None]
        expected = expected + norm.logpdf(y[:, k], getattr(rebound, column.name), sd).sum(axis=1)
    assert log_posterior(extended(problem, design.impacts, design.sensor, y), at) == pytest.approx(expected, rel=1e-9)


def test_a_new_column_has_the_sd_of_its_sensor_and_no_column_two_noises(ready):
    problem, design = ready.known.problem, ready.designs[PLANNED]
    angle, at = PlannedColumn("theta_2", sd=np.array(0.05)), ready.known.coordinates[:3]
    y = np.array([[3.0, 5.0, 100.0, 0.9], [2.0, 6.0, 50.0, 1.1]])
    sensor = replace(design.sensor, columns=(*design.sensor.columns, angle))
    rebound = problem.rebound(problem.to_values(at), design.impacts)
    more = norm.logpdf(y[:, 3], angle.column.predict(rebound), 0.05).sum(axis=1)
    found = log_posterior(extended(problem, design.impacts, sensor, y), at)
    assert found - log_posterior(extended(problem, design.impacts, design.sensor, y), at) == pytest.approx(more)
    better = replace(sensor, columns=tuple(replace(column, share=0.5) for column in design.sensor.columns))
    with pytest.raises(FitError, match="as the table was"):
        extended(problem, design.impacts, better, y)


def test_refits_narrow_as_promised_and_repeat_bit_for_bit(ready):
    made = [replicate(ready, 3, number) for number in range(6)]
    again = replicate(ready, 3, 2)
    assert again[PLANNED].nats == made[2][PLANNED].nats
    found = finding("friction", ready, {name: [one[name] for one in made] for name in ready.designs})
    assert found.replicates == 6 and found.lost == 0
    for line in found.lines:
        assert abs(line.off) < 0.25, line
    assert found.gains[0].found > found.gains[1].found


def test_a_broken_promise_and_a_plan_that_is_no_better_are_told(ready):
    plan = ready.designs[PLANNED]
    kept = [Narrowed(1.0, plan.sds * (1.0 + 0.01 * k), 1500.0) for k in (-1, 0, 1)]
    table = [Narrowed(0.2, ready.designs[AGAIN].sds * (1.0 + 0.01 * k), 1500.0) for k in (-1, 0, 1)]
    assert finding("x", ready, {PLANNED: kept, AGAIN: table}).holds
    wide = [replace(one, sds=1.3 * one.sds) for one in kept]
    assert not finding("x", ready, {PLANNED: wide, AGAIN: table}).kept
    assert not finding("x", ready, {PLANNED: [replace(one, nats=0.2 + 0.1 * k) for k, one in enumerate(kept, -1)],
                                    AGAIN: table}).better  # fmt: skip
    lost = finding("x", ready, {PLANNED: [*kept, None], AGAIN: [*table, table[0]]})
    assert lost.lost == 1 and lost.replicates == 3


def test_the_command_goes_on_where_it_stopped(ready, monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(CASES, "friction", CASE)
    monkeypatch.setattr(run, "prepared", lambda name, seed: ready)
    words = ["--plan", "--cases", "friction", "--out", str(tmp_path), "--quiet", "--replicates"]
    validate.main([*words, "2"])
    begun = (tmp_path / "friction.csv").read_bytes()
    assert validate.main([*words, "4"]) in (0, 1)
    assert (tmp_path / "friction.csv").read_bytes().startswith(begun)
    out = capsys.readouterr().out
    assert "4 simulated tables, 0 without a refit" in out
    assert (tmp_path / "sds.csv").read_text(encoding="utf-8").startswith("case,design,part,promised,found,se,off\n")
    assert validate.main(["--plan", "--cases", "wnag", "--out", str(tmp_path)]) == 2
    assert "unknown case 'wnag'" in capsys.readouterr().err
