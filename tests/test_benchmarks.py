"""What scripts/benchmark measures: rivals draw from the same posterior, batches are watched as they go on."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from benchmarks import __main__ as command
from benchmarks import processes, samplers

from fitball.batch.many import Going
from fitball.bench import clock
from fitball.bench.errors import OURS, SCRIPT
from fitball.bench.problems import posed, spread_coordinates
from fitball.data.read import load_table


def test_effective_draws():
    """Independent draws count whole, each of ten equal ones a tenth; burn-in does not."""
    rng = np.random.default_rng(1)
    free = rng.standard_normal((3000, 4, 2))
    assert samplers.effective(free) == pytest.approx(0.67 * 12_000, rel=0.2)
    assert samplers.effective(free[:12]) <= 9 * 4
    assert samplers.effective(np.repeat(free[:300], 10, axis=0)) == pytest.approx(0.67 * 1200, rel=0.3)


class Turns:
    """A budget of so many looks instead of seconds."""

    def __init__(self, turns):
        self.turns, self.spent = turns, 1.0

    @property
    def left(self):
        self.turns -= 1
        return self.turns >= 0


def test_a_rival_sampler_is_asked_for_its_draws():
    problem = posed("wang_zero_spin")
    target = samplers.Target(problem, spread_coordinates(problem, 3))
    draws = samplers.emcee_stretch(target, Turns(2))
    assert target.evaluations == pytest.approx(40 * (2 * samplers.BLOCK + 1), abs=80)
    assert 0.0 < draws < target.evaluations
    value, slopes = target.with_gradient(target.optima[0])
    ahead = target.optima[0] + 1e-3 * problem.prior.width * np.eye(problem.dimension)[3]
    rise = target.one(ahead) - value
    assert rise == pytest.approx(slopes[3] * 1e-3 * problem.prior.width[3], rel=0.2)


def test_a_table_of_samplers_says_what_is_known(monkeypatch):
    """The script on solve_ivp costs what its densities cost; too few draws tell nothing; missing rivals are named."""
    monkeypatch.setattr(samplers, "problems", lambda: [("zero", posed("wang_zero_spin"))])
    monkeypatch.setattr(samplers, "_ours", lambda problem, optima: (OURS, "1", 2.0, 50_000, 1000.0))
    fakes = [
        samplers.Sampler(samplers.STRETCH, "emcee", lambda target, budget: 100.0),
        samplers.Sampler("slow", "numpy", lambda target, budget: 3.0),
        samplers.Sampler("absent", "no-such-package", lambda target, budget: 1e9),
    ]
    monkeypatch.setattr(samplers, "RIVALS", fakes)
    monkeypatch.setattr(samplers, "point_fit", lambda problem, rng: (None, Point(problem)))
    monkeypatch.setattr(samplers, "Target", lambda problem, optima: Asked())
    densities = pd.DataFrame([{"table": "zero", "log posterior": SCRIPT, "microseconds": 5e5}])
    frame = samplers.sampling_costs(1.0, densities, lambda _stage: None).set_index("sampler")
    assert list(frame.index) == [OURS, samplers.STRETCH, samplers.NAIVE, "slow"]
    assert frame.loc[OURS, "draws a CPU second"] == 500.0
    assert frame.loc[samplers.NAIVE, "CPU seconds"] == 1000.0
    assert frame.loc[samplers.NAIVE, "draws a CPU second"] == 0.1
    assert math.isnan(frame.loc["slow", "draws a CPU second"])
    assert samplers.missing() == ["no-such-package"]


class Point:
    def __init__(self, problem):
        self.optima = [dict(zip(problem.free_names, np.ones(problem.dimension), strict=True))]


class Asked:
    evaluations = 2000


def test_batches_of_tables_are_watched_as_they_go_on(capsys):
    """CPU a table is that since the look before: a table that costs more and more is seen."""
    seen = iter([processes.Family(30.0, 200.0, 300.0), processes.Family(110.0, 210.0, 300.0)])
    watch = processes.Watch(2, lambda: next(seen))
    for done in range(15):
        watch(Going(done, 14, 0, 0))
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [(line[0], line[2], *line[4:]) for line in lines] == [
        ("2", "10", "3.0", "200.0", "300.0"), ("2", "14", "20.0", "210.0", "300.0"),
    ]  # fmt: skip


def test_many_tables_are_fitted_in_a_process_of_its_own(monkeypatch):
    asked = []

    def fresh(code, **environment):
        folder = Path(re.search(r"calibrate_many\('(.*?)'", code).group(1))
        asked.append([load_table(place) for place in sorted(folder.iterdir())])
        return clock.Spent(
            ["2", "20", "10", "60.5", "2.5", "210", "nan", "2", "20", "12", "70", "2", "210", "300"], 1.0, 1.0
        )

    monkeypatch.setattr(processes, "fresh_process", fresh)
    frame = processes.many_costs(3, 2)
    assert list(frame["tables"]) == [10, 12]
    assert frame["worker [MB]"].isna().tolist() == [True, False]
    (tables,) = asked
    assert [len(table) for table in tables] == [processes.ROWS] * 3
    assert len({table.digest for table in tables}) == 3


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="this system does not tell")
def test_processes_that_were_started_count():
    # The system counts CPU in hundredths of a second.
    code = "import time\nwhile time.process_time() < 0.1: pass\nprint(flush=True); input()"
    alone = processes.running()
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        child.stdout.readline()
        both = processes.running()
        child.communicate(b"\n")
    assert 3.0 < both.worker < both.parent
    assert both.seconds >= alone.seconds + 0.05


def test_what_is_named_is_measured_and_kept(tmp_path, monkeypatch, capsys):
    frame = pd.DataFrame([{"table": table, "sampler": name, "draws a CPU second": 10.0 + k}
                          for table in ("one", "two") for k, name in enumerate((OURS, "other"))])  # fmt: skip
    monkeypatch.setattr(command, "density_costs", lambda *_given: pd.DataFrame())
    monkeypatch.setattr(samplers, "sampling_costs", lambda *_given: frame)
    monkeypatch.setattr(samplers, "missing", lambda: ["dynesty", "pints"])
    assert command.main(["samplers", "--quick", "--out", str(tmp_path)]) == 0
    told = capsys.readouterr()
    assert "| one | fitball | 10 |" in told.out and "pip install dynesty pints" in told.err
    assert {"samplers.csv", "samplers.png"} <= {item.name for item in tmp_path.iterdir()}
    with pytest.raises(SystemExit):
        command.main(["sampler"])
