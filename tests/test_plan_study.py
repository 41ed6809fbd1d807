"""`scripts/validate --plan`: what is simulated and refitted, and when a promise counts as kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm
from validation import command as validate
from validation import plans
from validation.plans import AGAIN, CASES, PLANNED, Case, extended, finding, planned_from, replicate

from fitball.errors import FitError
from fitball.inference.design.asked import PlannedColumn
from fitball.inference.likelihood.posterior import log_posterior

CASE = Case(
    "friction", "wang_all", "grip-slip", "mu", 2, {"speed": "10:30:2", "angle": "15:60:3", "spin": "-200:200:2"}
)


@pytest.fixture(scope="module")
def ready(grip_slip_fit):
    return planned_from("friction", CASE, grip_slip_fit, 1)


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
    made = [row for number in range(6) for row in replicate(ready, 3, number)]
    assert replicate(ready, 3, 2) == [made[2]]
    found = finding(ready, made)
    assert found.replicates == 6 and found.lost == 0
    for line in found.lines:
        assert abs(line.off) < 0.25, line
    assert found.gains[0].found > found.gains[1].found


def test_a_broken_promise_and_a_plan_that_is_no_better_are_told(ready):
    def made(planned=1.0, factor=1.0, step=0.0):
        """Three refits each, within a hundredth of what is promised times a `factor`."""
        designs = {PLANNED: (planned, factor, step), AGAIN: (0.2, 1.0, 0.0)}
        return [
            {name: {"nats": nats + k * each, "sds": (times * (1.0 + 0.01 * k) * ready.designs[name].sds).tolist()}
             for name, (nats, times, each) in designs.items()}
            for k in (-1, 0, 1)
        ]  # fmt: skip

    assert finding(ready, made()).holds
    assert not finding(ready, made(factor=1.3)).kept
    assert not finding(ready, made(planned=0.2, step=0.1)).better
    lost = finding(ready, [*made(), {PLANNED: None, AGAIN: made()[0][AGAIN]}])
    assert lost.lost == 1 and lost.replicates == 3


def test_the_command_goes_on_where_it_stopped(ready, monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(CASES, "friction", CASE)
    monkeypatch.setattr(plans, "prepared", lambda name, seed: ready)
    words = ["--plan", "--cases", "friction", "--out", str(tmp_path), "--quiet", "--replicates"]
    validate.main([*words, "2"])
    begun = (tmp_path / "friction.jsonl").read_bytes()
    assert validate.main([*words, "4"]) in (0, 1)
    assert (tmp_path / "friction.jsonl").read_bytes().startswith(begun)
    out = capsys.readouterr().out
    assert "4 simulated tables, 0 without a refit" in out
    assert (tmp_path / "sds.csv").read_text(encoding="utf-8").startswith("case,design,part,promised,found,se,off\n")
    assert validate.main(["--plan", "--cases", "wnag", "--out", str(tmp_path)]) == 2
    assert "unknown case 'wnag'" in capsys.readouterr().err
