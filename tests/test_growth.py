"""`bench --rows`: what fits of simulated tables cost, and how that grows."""

import os
import sys

import numpy as np
import pandas as pd
import pytest

import fitball
from fitball.base.errors import MachineError, ParameterError
from fitball.base.findings import Findings
from fitball.speed import growth, growth_page

POSIX = pytest.mark.skipif(not hasattr(os, "wait4"), reason="counts of a POSIX system")


@POSIX
def test_fits_of_every_size_are_measured_by_turns(monkeypatch, tmp_path):
    """With quick fits: what is measured is the process, whatever it does."""
    program = "import sys; n = len(open(sys.argv[1]).readlines()); sum(range(n * 10**5))"
    seen = []

    def commands(counts, editions, folder):
        for count, edition, command in growth_commands(counts, editions, folder):
            seen.append((count, edition, command[0]))
            yield count, edition, [command[0], "-c", program, command[4]]

    growth_commands = growth._commands
    monkeypatch.setattr(growth, "_commands", commands)
    result = fitball.bench(rows="40,20", beside=sys.executable, progress=False)
    order = [(20, growth.OURS), (20, sys.executable), (40, growth.OURS), (40, sys.executable)]
    assert [entry[:2] for entry in seen] == order
    frame = result.frames["growth"]
    assert list(zip(frame["rows"], frame["fitball"], strict=True)) == order
    assert (frame["seconds"] > 0.0).all()
    names = {path.name for path in result.save(tmp_path / "made")}
    assert names == {"report.html", "growth.csv", "growth.png"}
    assert [len(axes.lines) for axes in result.plot("growth").axes] == [2, 2]


@POSIX
def test_cost_is_that_of_the_process_alone(tmp_path):
    """One fills memory of a known size, one works for a known time."""
    fill = "data = bytearray(b'x' * 400_000_000)"
    idle = growth.cost_of([sys.executable, "-c", "pass"], tmp_path)
    full = growth.cost_of([sys.executable, "-c", fill], tmp_path)
    assert 390.0 < full.megabytes - idle.megabytes < 900.0
    spin = "import time\nwhile time.process_time() < 1.5: pass"
    assert growth.cost_of([sys.executable, "-c", spin], tmp_path).seconds >= 1.5


@POSIX
def test_a_fit_that_fails_is_said_and_one_with_a_warning_is_not(tmp_path):
    growth.cost_of([sys.executable, "-c", "import sys; sys.exit(1)"], tmp_path)
    with pytest.raises(MachineError) as caught:
        growth.cost_of([sys.executable, "-c", "import sys; sys.exit(2)"], tmp_path)
    assert caught.value.code == "growth"


def test_simulated_tables_have_the_noise_that_is_stated():
    frame = growth.simulated(4_000)
    again = growth.simulated(4_000)
    pd.testing.assert_frame_equal(frame, again)
    ball = fitball.model(growth.MODEL)
    values = {spec.name: spec.typical for spec in ball.parameters if spec.typical is not None}
    states = (frame[name].to_numpy() for name in growth.STATES)
    exact = ball.rebound(values, fitball.Impacts(*states))
    for name, sd in growth.SDS.items():
        deviation = frame[name] - np.ravel(getattr(exact, name))
        assert deviation.std() == pytest.approx(sd, rel=0.05)


@pytest.mark.parametrize("text", ["sixty", "1", "-60", "6e1", "²"])
def test_rows_that_are_no_numbers_are_refused(text):
    with pytest.raises(ParameterError) as caught:
        fitball.bench(rows=text, progress=False)
    assert caught.value.code == "rows"


def test_another_python_needs_rows():
    with pytest.raises(ParameterError) as caught:
        fitball.bench(beside="python3", progress=False)
    assert caught.value.code == "no-rows"


def test_powers_are_those_of_a_power_law():
    counts = np.array([60, 1_000, 10_000])
    frame = pd.DataFrame({"fitball": growth.OURS, "rows": counts, "seconds": 1e-3 * counts**1.25})
    assert growth_page.exponents(frame) == pytest.approx([1.25, 1.25])
    frame["megabytes"] = 300.0
    assert "1.25" in growth_page.PAGE.of(Findings({"growth": frame})).report().summary[0].lines[0]
